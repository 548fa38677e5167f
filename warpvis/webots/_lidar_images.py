# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The images of lidars, as Webots' version of a world gives them."""

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
    """Find the lidar of that name.

    Raises:
        SceneError: There is none.
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

    As in Webots, back faces are not seen, and transparent things are; so is the robot's own body. A rotating lidar's
    image is that of a whole turn while nothing moves.

    Args:
        world: The world, from `load_webots`.
        lidar_name: The lidar.
        webots_version: By default ranges are the true ones along `Lidar.rays` (REP 117): +inf where nothing is hit or
            it is farther than `Lidar.max_range`, -inf where it is nearer than `Lidar.min_range`. ``"header"`` gives the
            values that the Webots of the world's header gives, as of `render_range`: along `Lidar.drawn_rays`, with
            resolution, and nothing nearer than `Lidar.near` in the way; another version's name, like ``"R2019a"``, that
            version's limits. Webots takes them from images of pixels as fine as its columns; these here are exact.
        exclude_body: Whether to see through the robot that the lidar is part of.
        seed: Seed of the lidar's noise, which Webots' values have only if it is given.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        Ranges [m], shape ``(layers, columns)``: lengths of the rays; with `webots_version`, of a planar projection,
        planar depth.

    Raises:
        SceneError: There is no such lidar, or it has too many rays.
        FileFormatError: `webots_version` is no version.
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
    return ranges.quantise(values, lidar.resolution)[0]
