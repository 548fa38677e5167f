# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Robots of Webots worlds, which see what their range finders see."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import LensCamera
from warpvis.cameras.lenses import KannalaBrandt, Lens
from warpvis.cameras.pinhole import Camera
from warpvis.errors import IntrinsicsWarning, SceneError
from warpvis.rendering import Output, Renderer
from warpvis.scene import Scene
from warpvis.visibility import Agent
from warpvis.webots._devices import Device
from warpvis.webots._range_images import find_device, require_world
from warpvis.webots._world import WebotsWorld

_DEPTH_TOLERANCE = 1e-4
"""Maximum difference of two depths of the same surface, relative to the depth, but at least 1 m."""


def choose_range_finder(devices: Mapping[str, Device]) -> str | None:
    """Return the name of the only range finder; None without one.

    Raises:
        SceneError: If there are several.
    """
    finders = {name: device for name, device in devices.items() if device.measures}
    if len(finders) > 1:
        listed = ", ".join(f"{name!r} of {device.robot!r}" for name, device in finders.items())
        raise SceneError(f"device_name must be one of the world's range finders, {listed}, got none")
    return next(iter(finders), None)


def robot_agent(world: WebotsWorld, device_name: str | None = None, *, name: str = "robot") -> Agent:
    """Create an agent that sees what a range finder or a camera of a world sees, from its place on its robot.

    The camera has the device's resolution, field of view and range. Cylindrical and spherical devices become a
    `LensCamera` with the same rays. Noise, resolution of ranges and `Lens` are ignored, the latter with a warning.

    The agent's body are the objects of the device's robot. Range finders of Webots do not see back faces, for example
    the inside of a housing around the sensor, but agents see surfaces from both sides. `Agent.head` therefore consists
    of the objects that would hide something by a back face, or nearer than the device's near plane. The robot sees all
    other parts of itself, as in Webots.

    Args:
        world: The world, from `load_webots`.
        device_name: The device; by default the world's only range finder.
        name: Name of the agent.

    Raises:
        SceneError: If there is no such device, or there is not exactly one range finder and `device_name` is not given.
    """
    chosen = choose_range_finder(require_world(world).devices) if device_name is None else device_name
    if chosen is None:
        known = ", ".join(map(repr, world.devices)) or "none"
        raise SceneError(f"device_name must be given for a world without a range finder; its cameras are: {known}")
    device = find_device(world, chosen)
    if device.bends:
        warnings.warn(f"{chosen!r} has a Lens, which the agent's camera ignores", IntrinsicsWarning, stacklevel=2)
    body = world.robots.get(device.robot, ())
    camera = device_camera(device)
    return Agent(name, camera, device.pose, body=body, head=_invisible(world.scene, device, camera, body))


def device_camera(device: Device) -> Camera | LensCamera:
    """Return a device's camera without its `Device.lens`, for any projection."""
    if device.projection == "planar":
        return device.camera
    width, height, fov = device.width, device.height, device.fov
    center = (width / 2, height / 2)
    if device.projection == "spherical":
        lens: Lens = KannalaBrandt(width / fov, height / fov, *center)
    else:
        lens = EqualAngles(width / fov, *center)
    return LensCamera(lens, width, height, device.min_range, device.max_range, kind="range")


def _invisible(scene: Scene, device: Device, camera: Camera | LensCamera, body: tuple[str, ...]) -> tuple[str, ...]:
    """Return the objects of a robot of which the device's image would show a back face, or what it clips."""
    hidden: list[str] = []
    others = [item.name for item in scene if item.name not in body]
    outputs: tuple[Output, ...] = ("depth", "segmentation")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", IntrinsicsWarning)  # the caller's camera warned of pixels without a ray
        clipped, whole = (replace(camera, near=near, far=math.inf) for near in (device.near, 0.0))
    drawn = Renderer(scene, clipped, outputs=outputs, cull_backfaces=True, near_plane="clip")
    cast = Renderer(scene, whole, outputs=outputs)
    while len(hidden) < len(body):
        images = [renderer.render(device.pose, exclude=[*others, *hidden] or None) for renderer in (drawn, cast)]
        seen, found = (views.segmentation.numpy()[0] for views in images)
        depth, exact = (views.depth.numpy()[0] for views in images)
        with np.errstate(invalid="ignore"):
            differs = (seen != found) | (np.abs(depth - exact) > _DEPTH_TOLERANCE * np.maximum(1.0, exact))
        wrong = [scene.objects[index].name for index in np.unique(found[differs & (found >= 0)]).tolist()]
        if not wrong:
            break
        hidden += wrong
    return tuple(name for name in body if name in hidden)


@dataclass(frozen=True)
class EqualAngles(Lens):
    """A cylindrical camera of Webots: columns and rows are equal steps of azimuth and elevation."""

    scale: float
    """Pixels per radian."""
    cx: float
    """Column of the forward direction [px]."""
    cy: float
    """Row of the horizon [px]."""

    @property
    def max_angle(self) -> float:
        """Pi: all directions."""
        return math.pi

    @property
    def turns_back(self) -> bool:
        """Always False."""
        return False

    def _project(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        x, y, z = points.T
        angles = np.stack([np.arctan2(x, z), np.arctan2(y, np.hypot(x, z))], axis=-1)
        is_zero = ~(np.abs(points).sum(axis=1) > 0)
        return np.where(is_zero[:, None], np.nan, self.scale * angles + (self.cx, self.cy))

    def _unproject(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        azimuth, down = ((pixels - (self.cx, self.cy)) / self.scale).T
        inside = (np.abs(azimuth) <= math.pi) & (np.abs(down) <= math.pi / 2)
        azimuth = np.where(inside, azimuth, np.nan)
        across = np.cos(down)
        return np.stack([across * np.sin(azimuth), np.sin(down), across * np.cos(azimuth)], axis=-1)
