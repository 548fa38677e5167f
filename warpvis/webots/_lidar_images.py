# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Range images of lidars in Webots worlds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_flag
from warpvis.errors import SceneError
from warpvis.rendering import Renderer
from warpvis.webots import _ranges as ranges
from warpvis.webots._lidars import Lidar
from warpvis.webots._nodes import Version
from warpvis.webots._range_images import require_world
from warpvis.webots._world import WebotsWorld


def find_lidar(world: WebotsWorld, name: str) -> Lidar:
    """Return the lidar of the given name.

    Raises:
        SceneError: If the world has no such lidar.
    """
    require_world(world)
    if not isinstance(name, str) or name not in world.lidars:
        known = ", ".join(map(repr, world.lidars)) or "none"
        raise SceneError(f"the world has no lidar {name!r}; it has {known}")
    return world.lidars[name]


def render_lidar(
    world: WebotsWorld,
    lidar_name: str,
    *,
    webots_version: str | None = None,
    exclude_body: bool = False,
    seed: int | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Render the range image of a lidar.

    As in Webots, back faces are invisible, and transparent objects and the robot's own body are visible. The image of a
    rotating lidar is that of one revolution in a static world.

    Args:
        world: The world, from `load_webots`.
        lidar_name: The lidar.
        webots_version: By default, ranges are exact, along `Lidar.rays` (REP 117): +inf where nothing is hit or the hit
            is farther than `Lidar.max_range`, -inf where it is nearer than `Lidar.min_range`. ``"header"`` reproduces
            the Webots release in the world's header, as in `render_range`: rays are `Lidar.drawn_rays`, ranges are
            quantized, and geometry nearer than `Lidar.near` does not occlude. The name of another release, like
            ``"R2019a"``, applies that release's limits. Webots samples rendered images whose pixels are as wide as
            columns; ranges here are computed exactly along the rays.
        exclude_body: Whether to hide the robot that the lidar is part of.
        seed: Seed of the lidar's noise. Noise is added only if `seed` and `webots_version` are given.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Ranges [m], shape ``(layers, columns)``: lengths of the rays, or planar depth for a planar projection with
        `webots_version`.

    Raises:
        SceneError: If there is no such lidar, or it has too many rays.
        FileFormatError: If `webots_version` is not a version.
    """
    lidar = find_lidar(world, lidar_name)
    exclude = (list(world.robots.get(lidar.robot, ())) if check_flag(exclude_body, "exclude_body") else []) or None
    if webots_version is None:
        seen = Renderer(world.scene, lidar.rays, outputs=("depth",), cull_backfaces=True, threads=threads)
        return seen.render(lidar.pose, exclude=exclude).depth.numpy()[0]
    version = world.version if str(webots_version) == "header" else Version.parse(webots_version)
    drawn = Renderer(
        world.scene,
        lidar.drawn_rays,
        outputs=("depth",),
        cull_backfaces=True,
        near_plane="clip",
        threads=threads,
    )
    lengths = drawn.render(lidar.pose, exclude=exclude).depth.numpy()
    planar = lidar.projection == "planar" and not lidar.rotates
    values = ranges.range_values(
        (lengths * lidar.cosines()).astype(np.float32) if planar else lengths,
        near=lidar.near,
        min_range=lidar.min_range,
        max_range=lidar.max_range,
        version=version,
        projection="planar" if planar else "cylindrical",
        near_bias=planar and version < ranges.UNBIASED,
    )
    if seed is not None:
        values = ranges.add_noise(values, lidar.noise, lidar.max_range, version, seed)
    return ranges.quantize(values, lidar.resolution)[0]
