# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Range finders and cameras of Webots worlds: where they are, what they measure, and the images they give."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np
from numpy.typing import NDArray

from warpvis.camera import Camera
from warpvis.errors import FileFormatError, SceneError
from warpvis.panorama import render_wide
from warpvis.pose import poses_to_matrices, poses_to_opencv
from warpvis.renderer import Renderer
from warpvis.scene import Scene
from warpvis.webots import ranges
from warpvis.webots.nodes import Node, Version

if TYPE_CHECKING:
    from warpvis.webots.world import WebotsWorld

Kind = Literal["range-finder", "camera", "kinect"]
Projection = Literal["planar", "cylindrical", "spherical"]

# The first release whose range finders are right about depth; before, see `warpvis.webots.ranges`.
_UNBIASED = Version(2022, 1)

DEFAULT_FOV = 0.785398
"""Field of view that Webots takes where none or a wrong one is given [rad]."""


@dataclass(frozen=True)
class Lens:
    """Brown's model of distortion, a `Lens` node."""

    center: tuple[float, float] = (0.5, 0.5)
    """Centre of the distortion, in widths from the left and heights from the bottom of the image."""
    radial: tuple[float, float] = (0.0, 0.0)
    """Radial coefficients."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """Tangential coefficients."""


@dataclass(frozen=True, eq=False)
class Device:
    """A range finder or a camera of a Webots world."""

    name: str
    """What its controller calls it."""
    robot: str
    """Name of the robot that it is part of; empty if it is part of none."""
    kind: Kind
    """``"range-finder"``, ``"kinect"`` for the range finder of a Kinect, or ``"camera"``."""
    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    fov: float
    """Horizontal field of view [rad]."""
    near: float
    """Nearer than this Webots draws nothing, so that it hides nothing either [m]."""
    min_range: float
    """Least range that is measured [m]."""
    max_range: float
    """Greatest range that is measured [m]; infinite for a camera without `far`."""
    projection: Projection
    """``"planar"``, a pinhole's; or ``"cylindrical"``, ``"spherical"``."""
    noise: float
    """The file's `noise`."""
    resolution: float
    """Step of the ranges [m], or -1."""
    lens: Lens | None
    """Its distortion, if any."""
    pose: NDArray[np.float64]
    """OpenCV camera to world, ``x y z qx qy qz qw``, shape ``(7,)``."""
    version: Version
    """Version of the file that it is in, which decides about the device's axes."""
    recognition: Node | None = None
    """A camera's `Recognition` node."""
    notes: tuple[str, ...] = ()
    """What was corrected in its fields, as Webots corrects it."""

    @property
    def measures(self) -> bool:
        """Whether its images are ranges."""
        return self.kind != "camera"

    @property
    def camera(self) -> Camera:
        """The device as a pinhole camera, whose depth range is what it measures.

        Its vertical field of view is that of square pixels, ``2 atan(tan(fov / 2) height / width)``, in all versions.

        Raises:
            SceneError: Its projection is another one.
        """
        if self.projection != "planar":
            raise SceneError(f"{self.name!r} has a {self.projection} projection, so it is no pinhole camera")
        return Camera.from_fov(self.width, self.height, hfov=self.fov, near=self.min_range, far=self.max_range)

    def describe(self) -> str:
        """It in a few words."""
        reach = f"{self.min_range:g} to {self.max_range:g} m"
        return f"{self.kind}, {self.width}x{self.height}, fov {self.fov:g}, {self.projection}, {reach}"

    def at_origin_of(self, proto: str) -> Device:
        """The same device, with a note that it was plugged into a PROTO whose slots are not known."""
        note = f"{self.name!r} is taken to be at the origin of {proto}, whose slots are not known without its file"
        return dataclasses.replace(self, notes=(*self.notes, note))


def read_device(
    node: Node, rotation: NDArray[np.float64], offset: NDArray[np.float64], robot: str, protos: Sequence[str] = ()
) -> Device | None:
    """The device that a node is, or None.

    Args:
        node: Any node.
        rotation: Node to world, shape ``(3, 3)``.
        offset: The node's origin in the world [m], shape ``(3,)``.
        robot: Name of its robot.
        protos: The PROTOs that it is within.

    Raises:
        FileFormatError: A field is not what it has to be.
    """
    if node.type not in ("RangeFinder", "Camera"):
        return None
    # Up to V8.4 a camera could be one.
    measures = node.type == "RangeFinder" or node.text("type", "color") == "range-finder"
    notes: list[str] = []
    width, height = (_size(node, name) for name in ("width", "height"))
    projection = _projection(node)
    near, least, greatest = _ranges(node, measures, notes)
    noise, resolution = node.number("noise", 0.0), node.number("resolution", -1.0)
    if node.type == "Camera" and measures:
        noise, resolution = node.number("rangeNoise", noise), node.number("rangeResolution", resolution)
    if resolution <= 0 and resolution != -1:
        notes.append(_correction(node, "resolution", resolution, -1))
        resolution = -1.0
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, offset
    default = "range-finder" if node.type == "RangeFinder" else "camera"
    kind: Kind = "camera"
    if measures:
        kind = "kinect" if "Kinect" in protos else "range-finder"
    return Device(
        name=node.text("name", default),
        robot=robot,
        kind=kind,
        width=width,
        height=height,
        fov=_field_of_view(node, projection, notes),
        near=near,
        min_range=least,
        max_range=greatest,
        projection=projection,
        noise=noise,
        resolution=resolution,
        lens=_lens(node.node("lens")),
        pose=poses_to_opencv(matrix, "ros" if node.version.z_up else "opengl")[0],
        version=node.version,
        recognition=None if measures else node.node("recognition"),
        notes=tuple(notes),
    )


def _size(node: Node, name: str) -> int:
    size = node.integer(name, 64)
    if size < 1:
        raise FileFormatError(f"{node.file}:{node.line}: expected {name} of {node.type} from 1 up, got {size}")
    return size


def _projection(node: Node) -> Projection:
    projection = node.text("projection", "cylindrical" if node.flag("spherical", False) else "planar")
    if projection not in ("planar", "cylindrical", "spherical"):
        wanted = '"planar", "cylindrical" or "spherical"'
        raise FileFormatError(f"{node.file}:{node.line}: expected projection {wanted}, got {projection!r}")
    return cast(Projection, projection)


def _field_of_view(node: Node, projection: Projection, notes: list[str]) -> float:
    fov, fixed = node.number("fieldOfView", DEFAULT_FOV), None
    if fov <= 0 or (projection == "planar" and fov >= math.pi):
        fixed = DEFAULT_FOV
    elif projection != "planar" and fov > 2 * math.pi + 1e-4:
        fixed = 2 * math.pi
    if fixed is None:
        return fov
    notes.append(_correction(node, "fieldOfView", fov, fixed))
    return fixed


def _ranges(node: Node, measures: bool, notes: list[str]) -> tuple[float, float, float]:
    """`near`, least and greatest range, corrected in the order of Webots' own checks (``WbRangeFinder.cpp``)."""
    near = node.number("near", 0.01)
    if near <= 0:
        notes.append(_correction(node, "near", near, 0.01))
        near = 0.01
    if not measures:
        far = node.number("far", 0.0)
        if 0 < far <= near:
            notes.append(_correction(node, "far", far, near + 1))
            far = near + 1
        return near, near, far if far > 0 else math.inf
    # A range finder of the time when it was a type of camera measured from `near` on.
    least = node.number("minRange", 0.01 if node.type == "RangeFinder" else near)
    if least <= 0:
        notes.append(_correction(node, "minRange", least, near))
        least = near
    if near > least:
        notes.append(_correction(node, "near", near, least))
        near = least
    greatest = node.number("maxRange", 1.0)
    if greatest <= least:
        notes.append(_correction(node, "maxRange", greatest, least + 1))
        greatest = least + 1
    return near, least, greatest


def _lens(node: Node | None) -> Lens | None:
    if node is None or node.type != "Lens":
        return None
    fields = (("center", 0.5), ("radialCoefficients", 0.0), ("tangentialCoefficients", 0.0))
    pairs = [node.vector(name, (default, default)).tolist() for name, default in fields]
    return Lens(*((x, y) for x, y in pairs))


def _correction(node: Node, name: str, given: float, taken: float) -> str:
    return f"{node.file}:{node.line}: {name} {given:g} of {node.type} is {taken:g}"


def find_device(world: WebotsWorld, name: str) -> Device:
    """The device of that name.

    Raises:
        SceneError: There is none.
    """
    if name not in world.devices:
        known = ", ".join(map(repr, world.devices)) or "none"
        raise SceneError(f"the world has no device {name!r}; it has {known}")
    return world.devices[name]


def render_range(
    world: WebotsWorld,
    device_name: str,
    *,
    webots_version: str | None = None,
    exclude_body: bool = False,
    seed: int | None = None,
    threads: int | None = None,
) -> NDArray[np.float32]:
    """The image of a range finder, or of a camera as if it measured ranges.

    As in Webots, back faces are not seen, and transparent things are; so is the robot's own body.

    Args:
        world: The world, from `load_webots`.
        device_name: The device.
        webots_version: By default ranges are the true ones (REP 117): +inf where nothing is hit or it is farther than
            `Device.max_range`, -inf where it is nearer than `Device.min_range`. ``"header"`` gives the values that the
            Webots of the world's header gives, with its lens, near plane and resolution, and nothing nearer than
            `Device.near` in the way; another version's name, like ``"R2019a"``, that version's values. R2022a is taken
            to be its revision 1.
        exclude_body: Whether to see through the robot that the device is part of.
        seed: Seed of the device's noise, which Webots' values have only if it is given.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        Ranges [m], shape ``(H, W)``: planar depth, or the ray's length if the projection is cylindrical or spherical.

    Raises:
        SceneError: There is no such device, or `webots_version` is given and it is a camera.
        FileFormatError: `webots_version` is no version.
    """
    device = find_device(world, device_name)
    exclude = list(world.robots.get(device.robot, ())) if exclude_body else []
    if webots_version is None:
        return _depth(world.scene, device, device.min_range, device.max_range, exclude, threads)
    if not device.measures:
        raise SceneError(f"{device_name!r} is a camera: Webots gives no ranges of it, so ask for true depth")
    version = world.version if webots_version == "header" else Version.parse(webots_version)
    pixels = None
    if device.lens is not None and device.projection == "planar":
        lens = device.lens
        pixels = ranges.distort_pixels(device.width, device.height, lens.center, lens.radial, lens.tangential)
    values = ranges.range_values(
        _drawn_depth(world.scene, device, exclude, threads, pixels)[None],
        near=device.near,
        min_range=device.min_range,
        max_range=device.max_range,
        version=version,
        projection=device.projection,
        near_bias=device.projection == "planar" and version < _UNBIASED,
    )
    if pixels is not None:  # the image that is bent ends where it does
        size = (device.width, device.height)
        values[0, ~((pixels >= 0) & (pixels < size)).all(axis=2)] = 0
    if seed is not None:
        values = ranges.add_noise(values, device.noise, device.max_range, version, seed)
    return ranges.quantise(values, device.resolution)[0]


def _depth(
    scene: Scene,
    device: Device,
    near: float,
    far: float,
    exclude: Sequence[str],
    threads: int | None,
    pixels: NDArray[np.float32] | None = None,
) -> NDArray[np.float32]:
    """Ranges by REP 117, shape ``(H, W)``; of other points of the image than the pixels' centres if they are given."""
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
    """Depth of what OpenGL draws: nothing nearer than `near`, which then hides nothing; +inf where there is nothing."""
    depth = _depth(scene, device, device.near, math.inf, exclude, threads, pixels)
    too_near = np.isneginf(depth)
    if too_near.any() and device.projection == "planar":
        cut = _cut_near(scene, device, exclude)
        depth = np.full_like(depth, np.inf)
        if len(cut):
            depth = _depth(cut, device, 0.0, math.inf, (), threads, pixels)
    elif too_near.any():  # put together of planar images with near planes of their own
        depth = _depth(scene, device, 0.0, math.inf, exclude, threads)
    return depth


def _cut_near(scene: Scene, device: Device, exclude: Sequence[str]) -> Scene:
    """The scene's triangles as the near plane leaves them."""
    matrix = poses_to_matrices(device.pose)
    axis, origin = matrix[:3, 2], matrix[:3, 3]
    cut = Scene(device=scene.device, up=scene.up)
    for item in scene.objects:
        if item.name in exclude:
            continue
        triangles = item.vertices.astype(np.float64)[item.faces]
        depth = (triangles - origin) @ axis - device.near
        inside = depth > 0
        whole = triangles[inside.all(axis=1)]
        parts = [whole]
        crossing = inside.any(axis=1) & ~inside.all(axis=1)
        for corners, d in zip(triangles[crossing], depth[crossing], strict=True):
            parts.append(_clip(corners, d))
        left = np.concatenate(parts)
        if len(left):
            cut.add((left.reshape(-1, 3), np.arange(len(left) * 3).reshape(-1, 3)), name=item.name, label=item.label)
    return cut


def _clip(corners: NDArray[np.float64], depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """The part of a triangle whose depth is positive (Sutherland and Hodgman 1974), shape ``(1 or 2, 3, 3)``."""
    polygon = []
    for k in range(3):
        a, b, da, db = corners[k], corners[(k + 1) % 3], depth[k], depth[(k + 1) % 3]
        if da > 0:
            polygon.append(a)
        if (da > 0) != (db > 0):
            polygon.append(a + (b - a) * (da / (da - db)))
    return np.array([[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)])
