# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Range images of range finders and lidars in Webots worlds."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_flag
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import IntrinsicsWarning, SceneError
from warpvis.rendering import Renderer, render_wide
from warpvis.scene import Scene
from warpvis.webots import _ranges as ranges
from warpvis.webots._devices import Device, Lens, Projection
from warpvis.webots._lidars import Lidar
from warpvis.webots._nodes import Version
from warpvis.webots._world import WebotsWorld

_Item = TypeVar("_Item")


def require_world(world: object) -> WebotsWorld:
    """Return `world`; raise `SceneError` if it is not a `WebotsWorld`."""
    if not isinstance(world, WebotsWorld):
        raise SceneError(f"world must be a WebotsWorld from load_webots, got {type(world).__name__}")
    return world


def find_device(world: WebotsWorld, name: str) -> Device:
    """Return the device of the given name."""
    return _find(require_world(world).devices, "device", name)


def render_range(
    world: WebotsWorld,
    device_name: str,
    *,
    webots_version: str | None = None,
    exclude_body: bool = False,
    seed: int | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """Render the image of a range finder, or of a camera as if it measured ranges.

    As in Webots, back faces are invisible, and transparent objects and the robot's own body are visible.

    Args:
        world: The world, from `load_webots`.
        device_name: The device.
        webots_version: By default, ranges are exact (REP 117): +inf where nothing is hit or the hit is farther than
            `Device.max_range`, -inf where it is nearer than `Device.min_range`; a `Lens` is ignored with a warning.
            ``"header"`` reproduces the values of the Webots release in the world's header, including lens, near plane
            and resolution; geometry nearer than `Device.near` does not occlude. The name of another release, like
            ``"R2019a"``, reproduces that release. R2022a is assumed to be its revision 1.
        exclude_body: Whether to hide the robot that the device is part of.
        seed: Seed of the device's noise. Noise is added only if `seed` and `webots_version` are given.
        threads: Number of CPU threads; by default all cores available to the process.

    Returns:
        Ranges [m], shape ``(H, W)``: planar depth, or lengths of rays for a cylindrical or spherical projection.

    Raises:
        SceneError: If there is no such device, or `webots_version` is given for a camera.
    """
    device = find_device(world, device_name)
    exclude = hidden_body(world, device, exclude_body)
    if webots_version is None:
        if device.bends:
            warnings.warn(
                f"{device_name!r} has a Lens, which exact depth ignores; pass "
                'webots_version="header" (on the command line --version-exact) for a distorted image',
                IntrinsicsWarning,
                stacklevel=2,
            )
        return _depth(world.scene, device, device.min_range, device.max_range, exclude, threads)
    if not device.measures:
        raise SceneError(
            f"{device_name!r} is a camera, which has no ranges in Webots: omit webots_version for exact depth"
        )
    version = _release(world, webots_version)
    pixels: NDArray[np.float32] | None = None
    outside: NDArray[np.bool_] | None = None
    if device.bends:
        pixels, outside = distorted_pixels(device)
    depth = _drawn_depth(world.scene, device, exclude, threads, pixels)[None]
    return _measured(depth, device, version, device.projection, seed, outside)


def distorted_pixels(device: Device) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return where each pixel of a distorted image is in the undistorted one, and whether that is outside of it."""
    lens = device.lens or Lens()
    pixels = ranges.distort_pixels(device.width, device.height, lens.center, lens.radial, lens.tangential)
    return pixels, np.any(~((pixels >= 0) & (pixels < (device.width, device.height))), axis=2)


def _depth(
    scene: Scene,
    device: Device,
    near: float,
    far: float,
    exclude: Sequence[str],
    threads: int | None,
    pixels: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Render ranges by REP 117 [m], shape ``(H, W)``, at pixel centers or at other points of the image."""
    hidden = list(exclude) or None
    if device.projection != "planar":
        views = render_wide(
            scene,
            device.width,
            device.height,
            device.fov,
            device.pose,
            projection=device.projection,
            near=near,
            far=far,
            cull_backfaces=True,
            exclude=hidden,
            threads=threads,
        )
        return views.depth.numpy()[0]
    camera = dataclasses.replace(device.camera, near=near, far=far)
    renderer = Renderer(scene, camera, outputs=("depth",), cull_backfaces=True, threads=threads)
    if pixels is None:
        return renderer.render(device.pose, exclude=hidden).depth.numpy()[0]
    views = renderer.render_at(device.pose, pixels.reshape(1, -1, 2), exclude=hidden)
    return views.depth.numpy().reshape(device.height, device.width)


def _drawn_depth(
    scene: Scene, device: Device, exclude: Sequence[str], threads: int | None, pixels: NDArray[np.float32] | None
) -> NDArray[np.float32]:
    """Render depth as OpenGL does [m]: geometry nearer than `near` is clipped and does not occlude; +inf for no hit."""
    depth = _depth(scene, device, device.near, math.inf, exclude, threads, pixels)
    too_near = np.isneginf(depth)
    if too_near.any() and device.projection == "planar":
        cut = _cut_near(scene, device, exclude)
        depth = np.full_like(depth, np.inf)
        if len(cut):
            depth = _depth(cut, device, 0.0, math.inf, (), threads, pixels)
    elif too_near.any():  # Webots composes these of planar images, each with a near plane
        depth = _depth(scene, device, 0.0, math.inf, exclude, threads)
    return depth


def _cut_near(scene: Scene, device: Device, exclude: Sequence[str]) -> Scene:
    """Clip the scene's triangles at the near plane."""
    matrix = poses_to_matrices(device.pose)
    axis, origin = matrix[:3, 2], matrix[:3, 3]
    cut = Scene(device=scene.device, up=scene.up)
    for item in scene.objects:
        if item.name in exclude:
            continue
        triangles = item.vertices.astype(np.float64)[item.faces]
        depth = (triangles - origin) @ axis - device.near
        inside = depth > 0
        uncut = triangles[inside.all(axis=1)]
        parts = [uncut]
        crossing = inside.any(axis=1) & ~inside.all(axis=1)
        for corners, d in zip(triangles[crossing], depth[crossing], strict=True):
            parts.append(_clip(corners, d))
        soup = np.concatenate(parts)
        if len(soup):
            cut.add((soup.reshape(-1, 3), np.arange(len(soup) * 3).reshape(-1, 3)), name=item.name, label=item.label)
    return cut


def _clip(corners: NDArray[np.float64], depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """Clip a triangle to positive depth (Sutherland and Hodgman 1974); return triangles ``(1 or 2, 3, 3)``."""
    polygon = []
    for k in range(3):
        a, b, da, db = corners[k], corners[(k + 1) % 3], depth[k], depth[(k + 1) % 3]
        if da > 0:
            polygon.append(a)
        if (da > 0) != (db > 0):
            polygon.append(a + (b - a) * (da / (da - db)))
    return np.array([[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)])


def find_lidar(world: WebotsWorld, name: str) -> Lidar:
    """Return the lidar of the given name."""
    return _find(require_world(world).lidars, "lidar", name)


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

    Arguments are as for `render_range`. By default, ranges are exact, along `Lidar.rays`. A release as `webots_version`
    determines limits and resolution of ranges along `Lidar.drawn_rays`; geometry nearer than `Lidar.near` does not
    occlude. Webots samples rendered images whose pixels are as wide as columns; ranges here are computed exactly along
    the rays.

    Returns:
        Ranges [m], shape ``(layers, columns)``: lengths of the rays (REP 117: +inf for no hit or one farther than
        `Lidar.max_range`, -inf for one nearer than `Lidar.min_range`), or planar depth for a planar projection with
        `webots_version`.

    Raises:
        SceneError: If there is no such lidar, or it has too many rays.
    """
    lidar = find_lidar(world, lidar_name)
    exclude = hidden_body(world, lidar, exclude_body) or None
    if webots_version is None:
        seen = Renderer(world.scene, lidar.rays, outputs=("depth",), cull_backfaces=True, threads=threads)
        return seen.render(lidar.pose, exclude=exclude).depth.numpy()[0]
    version = _release(world, webots_version)
    drawn = Renderer(
        world.scene, lidar.drawn_rays, outputs=("depth",), cull_backfaces=True, near_plane="clip", threads=threads
    )
    lengths = drawn.render(lidar.pose, exclude=exclude).depth.numpy()
    if lidar.projection == "planar" and not lidar.rotates:
        return _measured((lengths * lidar.cosines()).astype(np.float32), lidar, version, "planar", seed)
    return _measured(lengths, lidar, version, "cylindrical", seed)


def _find(known: Mapping[str, _Item], kind: str, name: str) -> _Item:
    if not isinstance(name, str) or name not in known:
        raise SceneError(f"the world has no {kind} {name!r}; it has {', '.join(map(repr, known)) or 'none'}")
    return known[name]


def hidden_body(world: WebotsWorld, item: Device | Lidar, exclude_body: bool) -> list[str]:
    """List the objects of an item's robot, if they are to be hidden."""
    return list(world.robots.get(item.robot, ())) if check_flag(exclude_body, "exclude_body") else []


def _release(world: WebotsWorld, name: str) -> Version:
    return world.version if str(name) == "header" else Version.parse(name)


def _measured(
    depth: NDArray[np.float32],
    item: Device | Lidar,
    version: Version,
    projection: Projection,
    seed: int | None,
    outside: NDArray[np.bool_] | None = None,
) -> NDArray[np.float32]:
    """Convert exact ranges to those of a Webots release; pixels that look outside of an undistorted image are 0."""
    values = ranges.range_values(
        depth,
        near=item.near,
        min_range=item.min_range,
        max_range=item.max_range,
        version=version,
        projection=projection,
        near_bias=projection == "planar" and version < ranges.UNBIASED,
    )
    if outside is not None:
        values[0, outside] = 0
    if seed is not None:
        values = ranges.add_noise(values, item.noise, item.max_range, version, seed)
    return ranges.quantize(values, item.resolution)[0]
