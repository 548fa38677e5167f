# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Range finders and cameras of Webots worlds: their poses and parameters."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.poses import poses_to_opencv
from warpvis.errors import SceneError
from warpvis.webots._nodes import Node, Version, correction, replaced

Kind = Literal["range-finder", "camera", "kinect"]
Projection = Literal["planar", "cylindrical", "spherical"]
PROJECTIONS: tuple[Projection, ...] = ("planar", "cylindrical", "spherical")

_COSMETIC = {
    "noise": 0.0,
    "colorNoise": 0.0,
    "motionBlur": 0.0,
    "ambientOcclusionRadius": 0.0,
    "bloomThreshold": -1.0,
    "exposure": 1.0,
}
"""Fields of a Camera that change its colors, and their values without an effect."""

DEFAULT_FOV = 0.785398
"""Webots' default field of view, which also replaces invalid ones [rad]."""


@dataclass(frozen=True)
class Lens:
    """A `Lens` node: Brown's distortion model."""

    center: tuple[float, float] = (0.5, 0.5)
    """Center of the distortion, in widths from the left and heights from the bottom of the image."""
    radial: tuple[float, float] = (0.0, 0.0)
    """Radial coefficients."""
    tangential: tuple[float, float] = (0.0, 0.0)
    """Tangential coefficients."""


@dataclass(frozen=True, eq=False)
class Device:
    """A range finder or a camera of a Webots world."""

    name: str
    """Name for the controller."""
    robot: str
    """Name of its robot; empty without a robot."""
    kind: Kind
    """``"range-finder"``, ``"kinect"`` for the range finder of a Kinect, or ``"camera"``."""
    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    fov: float
    """Horizontal field of view [rad]."""
    near: float
    """Distance of Webots' near clipping plane [m]: nearer geometry is neither drawn nor occludes."""
    min_range: float
    """Minimum range [m]."""
    max_range: float
    """Maximum range [m]; infinite for a camera without `far`."""
    projection: Projection
    """``"planar"`` (pinhole), ``"cylindrical"`` or ``"spherical"``."""
    noise: float
    """The node's field `noise`."""
    resolution: float
    """Resolution of the ranges [m], or -1 for none."""
    lens: Lens | None
    """Lens distortion, if any."""
    pose: NDArray[np.float64]
    """OpenCV camera to world, ``x y z qx qy qz qw``, shape ``(7,)``."""
    version: Version
    """Version of its file, which determines the device's axes."""
    recognition: Node | None = None
    """A camera's `Recognition` node."""
    ignored: tuple[str, ...] = ()
    """Fields of a camera that change its colors in Webots, but not in `render_color`, such as ``"motionBlur"``."""
    notes: tuple[str, ...] = ()
    """Corrections of invalid fields, the same that Webots makes."""
    link: str = ""
    """Name of the link of `Scene.joints` that it moves with; empty if it is static."""

    @property
    def measures(self) -> bool:
        """Whether it measures ranges."""
        return self.kind != "camera"

    @property
    def bends(self) -> bool:
        """Whether Webots distorts its image: the projection is planar and its `Lens` has nonzero coefficients."""
        bent = self.lens is not None and any((*self.lens.radial, *self.lens.tangential))
        return bent and self.projection == "planar"

    @property
    def camera(self) -> Camera:
        """The device as a pinhole camera without its `lens`, with the device's range limits.

        In all versions pixels are square: the vertical field of view is ``2 atan(tan(fov / 2) height / width)``.

        Raises:
            SceneError: If the projection is not planar.
        """
        if self.projection != "planar":
            raise SceneError(f"{self.name!r} has a {self.projection} projection, so it is not a pinhole camera")
        return Camera.from_fov(self.width, self.height, hfov=self.fov, near=self.min_range, far=self.max_range)

    def describe(self) -> str:
        """Return a one-line description."""
        reach = f"{self.min_range:g} to {self.max_range:g} m"
        return f"{self.kind}, {self.width}x{self.height}, fov {self.fov:g}, {self.projection}, {reach}"


def read_device(node: Node, place: NDArray[np.float64], robot: str, protos: Sequence[str] = ()) -> Device | None:
    """Read a device node within the given PROTOs, as `read_lidar` does; return None for any other node."""
    if node.type not in ("RangeFinder", "Camera"):
        return None
    # Up to V8.4, a Camera with this type was a range finder.
    measures = node.type == "RangeFinder" or node.text("type", "color") == "range-finder"
    notes: list[str] = []
    width, height = (_size(node, name, notes) for name in ("width", "height"))
    projection = _projection(node, notes)
    near, min_range, max_range = read_ranges(node, measures, notes)
    noise, resolution = node.number("noise", 0.0), node.number("resolution", -1.0)
    if node.type == "Camera" and measures:
        noise, resolution = node.number("rangeNoise", noise), node.number("rangeResolution", resolution)
    kind: Kind = "camera" if not measures else "kinect" if "Kinect" in protos else "range-finder"
    return Device(
        name=node.text("name", "range-finder" if node.type == "RangeFinder" else "camera"),
        robot=robot,
        kind=kind,
        width=width,
        height=height,
        fov=read_field_of_view(node, projection, notes),
        near=near,
        min_range=min_range,
        max_range=max_range,
        projection=projection,
        noise=noise,
        resolution=check_resolution(node, resolution, notes),
        lens=_lens(node.node("lens")),
        pose=poses_to_opencv(place, node.version.axes)[0],
        version=node.version,
        recognition=None if measures else node.node("recognition"),
        ignored=() if measures else _ignored_fields(node),
        notes=tuple(notes),
    )


def _ignored_fields(node: Node) -> tuple[str, ...]:
    """Return the fields of a Camera that have an effect on its colors, but are ignored."""
    found = [name for name, neutral in _COSMETIC.items() if node.number(name, neutral) != neutral]
    found += ["antiAliasing"] if node.flag("antiAliasing", False) else []
    found += ["noiseMaskUrl"] if any(node.texts("noiseMaskUrl")) else []
    return (*found, *(name for name in ("focus", "lensFlare") if node.node(name) is not None))


def _size(node: Node, name: str, notes: list[str]) -> int:
    size = node.integer(name, 64)
    return replaced(node, name, size, 1, notes) if size < 1 else size


def _projection(node: Node, notes: list[str]) -> Projection:
    projection = node.text("projection", "cylindrical" if node.flag("spherical", False) else "planar")
    known = next((known for known in PROJECTIONS if known == projection), None)
    if known is None:
        notes.append(correction(node, "projection", projection, "planar"))
    return known or "planar"


def check_resolution(node: Node, resolution: float, notes: list[str]) -> float:
    """Replace an invalid resolution [m] by -1, none."""
    is_valid = resolution > 0 or resolution == -1
    return resolution if is_valid else replaced(node, "resolution", resolution, -1.0, notes)


def read_field_of_view(node: Node, projection: Projection, notes: list[str], default: float = DEFAULT_FOV) -> float:
    """Read the horizontal field of view [rad], corrected as by Webots (``WbAbstractCamera.cpp``)."""
    fov, fixed = node.number("fieldOfView", default), None
    if fov <= 0 or (projection == "planar" and fov >= math.pi):
        fixed = DEFAULT_FOV
    elif projection != "planar" and fov > 2 * math.pi + 1e-4:
        fixed = 2 * math.pi
    return fov if fixed is None else replaced(node, "fieldOfView", fov, fixed, notes)


def read_ranges(node: Node, measures: bool, notes: list[str]) -> tuple[float, float, float]:
    """Read `near`, minimum and maximum range [m], corrected in the order of Webots' checks (``WbRangeFinder.cpp``)."""
    near = node.number("near", 0.01)
    if near <= 0:
        near = replaced(node, "near", near, 0.01, notes)
    if not measures:
        far = node.number("far", 0.0)
        if 0 < far <= near:
            far = replaced(node, "far", far, near + 1, notes)
        return near, near, far if far > 0 else math.inf
    # Range finders that are a type of Camera measured from `near` on.
    lower = node.number("minRange", near if node.type == "Camera" else 0.01)
    if lower <= 0:
        lower = replaced(node, "minRange", lower, near, notes)
    if near > lower:
        near = replaced(node, "near", near, lower, notes)
    upper = node.number("maxRange", 1.0)
    if upper <= lower:
        upper = replaced(node, "maxRange", upper, lower + 1, notes)
    return near, lower, upper


def _lens(node: Node | None) -> Lens | None:
    if node is None or node.type != "Lens":
        return None
    fields = (("center", 0.5), ("radialCoefficients", 0.0), ("tangentialCoefficients", 0.0))
    pairs = [node.vector(name, (default, default)).tolist() for name, default in fields]
    return Lens(*((x, y) for x, y in pairs))
