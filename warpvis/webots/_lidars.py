# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lidars of Webots worlds: poses, parameters and rays (``WbLidar.cpp``, ``WbWrenCamera.cpp``)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import Rays
from warpvis.cameras.rays import MAX_RAYS
from warpvis.core.arrays import as_numpy
from warpvis.core.poses import convert_axes
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, SceneError
from warpvis.sensors.lidars import directions_at
from warpvis.webots._devices import check_resolution, read_field_of_view, read_ranges
from warpvis.webots._nodes import Node, Version, correction, replaced

# From this release on, images of rotating lidars begin behind them, and points of fixed lidars use the correct azimuths
# of their columns (Webots' pull requests 6324 and 6417).
_BEGINS_BEHIND = Version(2024, 1)


@dataclass(frozen=True, eq=False)
class Lidar:
    """A `Lidar` node of a Webots world."""

    name: str
    """Name for the controller."""
    robot: str
    """Name of its robot; empty without a robot."""
    layers: int
    """Number of layers, ``numberOfLayers``: rows of the image, from the highest layer down."""
    columns: int
    """Points per layer, ``horizontalResolution``: columns of the image, from left to right."""
    fov: float
    """Horizontal field of view [rad]. For a rotating lidar, that of its head; its image covers a whole revolution."""
    vertical_fov: float
    """Angle from the lowest to the highest layer [rad]."""
    tilt: float
    """Upward tilt [rad]."""
    rotates: bool
    """Whether its type is ``"rotating"``."""
    projection: Literal["planar", "cylindrical"]
    """``"cylindrical"``, whose ranges are lengths of rays, or ``"planar"``, whose ranges in Webots are planar depth."""
    near: float
    """Distance of Webots' near clipping plane [m]: nearer geometry is neither drawn nor occludes."""
    min_range: float
    """Minimum range [m]."""
    max_range: float
    """Maximum range [m]."""
    noise: float
    """The node's field `noise`."""
    resolution: float
    """Resolution of the ranges [m], or -1 for none."""
    frequency: float
    """Revolutions per second [Hz] of a rotating lidar."""
    pose: NDArray[np.float64]
    """Lidar (x forward, y left, z up, in all versions) to world, ``x y z qx qy qz qw``, shape ``(7,)``."""
    version: Version
    """Version of its file."""
    notes: tuple[str, ...] = ()
    """Corrections of invalid fields, the same that Webots makes."""
    link: str = ""
    """Name of the link of `Scene.joints` that it moves with; empty if it is static."""

    @cached_property
    def rays(self) -> Rays:
        """The lidar's nominal rays, one per value of its image, shape ``(layers, columns)``.

        Layers are evenly spaced over the vertical field of view, and columns are at the centers of equal parts of the
        horizontal one. A fixed lidar is tilted as a whole about y; a rotating one has the tilt added to each layer's
        elevation. Columns of a rotating lidar go clockwise, from behind (up to R2023b, from ahead), and have times.
        Rings are layers. Rays of a planar projection are those of pinhole pixels.
        """
        return self._cast(self.min_range, self.max_range, drawn=False)

    @cached_property
    def drawn_rays(self) -> Rays:
        """The rays that Webots renders, without range limits.

        Each layer is the row of Webots' coarse image at or above it. `near` of the rays is Webots' near plane.
        """
        return self._cast(self.near, math.inf, drawn=True)

    def describe(self) -> str:
        """Return a one-line description."""
        kind = "rotating lidar" if self.rotates else "lidar"
        around = 2 * math.pi if self.rotates else self.fov
        reach = f"{self.min_range:g} to {self.max_range:g} m"
        image = f"{self.layers}x{self.columns}, fov {around:g} x {self.vertical_fov:g}"
        return f"{kind}, {image}, {self.projection}, {reach}"

    def points(self, ranges: ArrayInput) -> NDArray[np.float32]:
        """Compute Webots' point cloud of a range image, in the device frame.

        Webots uses the nominal angles of layers and columns, not those of the rendered pixels. Up to R2023b, it spreads
        the columns of a fixed lidar from edge to edge of the field of view, up to half a column off their rays. Layers
        of a tilted lidar are assumed to be cones.

        Args:
            ranges: Values of `warpvis.webots.render_lidar` [m], shape ``(layers, columns)``.

        Returns:
            Points [m], shape ``(layers, columns, 3)``: x forward, y left, z up; up to R2021b x right, y up, z backward.
            Points of non-finite ranges are not finite.
        """
        image = as_numpy(ranges, name="ranges").astype(np.float64)
        if image.shape != (self.layers, self.columns):
            raise ArrayError(f"ranges must have shape ({self.layers}, {self.columns}), got {image.shape}")
        column = np.arange(self.columns)
        late = self.version >= _BEGINS_BEHIND
        if self.rotates:
            azimuth = -2 * math.pi * column / self.columns - (math.pi if late else 0.0)
        elif late:
            azimuth = self.fov / 2 - (column + 0.5) * self.fov / self.columns
        else:
            azimuth = self.fov / 2 - column * self.fov / max(self.columns - 1, 1)
        forward, left, up = np.moveaxis(directions_at(azimuth, (self._elevations() + self.tilt)[:, None]), -1, 0)
        axes = (forward, left, up) if self.version.z_up else (-left, up, -forward)
        with np.errstate(invalid="ignore"):  # inf * 0 for infinite ranges along an axis
            return (image[..., None] * np.stack(axes, axis=-1)).astype(np.float32)

    def _elevations(self) -> NDArray[np.float64]:
        """Compute the elevations of the layers, from the highest down, without the tilt [rad]."""
        if self.layers == 1:
            return np.zeros(1)
        return self.vertical_fov * (0.5 - np.arange(self.layers) / (self.layers - 1))

    def cosines(self) -> NDArray[np.float64]:
        """Compute the cosines of the angles between `drawn_rays` and the optical axis of a planar projection."""
        forward = np.array([math.cos(self.tilt), 0.0, math.sin(self.tilt)])
        return self.drawn_rays.directions @ forward

    def _cast(self, near: float, far: float, *, drawn: bool) -> Rays:
        if self.layers * self.columns > MAX_RAYS:
            raise SceneError(
                f"{self.name!r} must have at most {MAX_RAYS} rays, got {self.layers} layers of {self.columns} points"
            )
        width = image_width(self.columns, self.fov, self.rotates)
        height = image_height(self.layers, self.fov, self.vertical_fov, width)
        line = np.arange(self.layers) * ((height - 1) / max(self.layers - 1, 1))
        above = (height - 1) / 2 - (np.floor(line) if drawn else line)  # rows above the center of the image
        column = np.arange(self.columns) + 0.5
        elevation = np.asarray(above * (self.fov / width) if drawn else self._elevations(), dtype=np.float64)
        times = None
        if self.rotates:
            first = math.pi if self.version >= _BEGINS_BEHIND else 0.0
            directions = directions_at(first - 2 * math.pi * column / self.columns, (elevation + self.tilt)[:, None])
            each = np.arange(self.columns) / (self.columns * self.frequency)
            times = np.broadcast_to(each, (self.layers, self.columns))
        else:
            if self.projection == "planar":
                pitch = 2 * math.tan(self.fov / 2) / self.columns
                left, up = np.broadcast_arrays((self.columns / 2 - column) * pitch, above[:, None] * pitch)
                directions = np.stack([np.ones_like(left), left, up], axis=-1)
                directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
            else:
                directions = directions_at(self.fov / 2 - column * self.fov / self.columns, elevation[:, None])
            sine, cosine = math.sin(self.tilt), math.cos(self.tilt)
            directions = directions @ np.array([(cosine, 0, sine), (0, 1, 0), (-sine, 0, cosine)])
        rings = np.broadcast_to(np.arange(self.layers)[:, None], (self.layers, self.columns))
        return Rays(directions, times=times, rings=rings, near=near, far=far, axes="ros_body")


def image_width(columns: int, fov: float, rotates: bool) -> int:
    """Compute the width [px] of the image that Webots renders for the columns; a rotating head's is narrower."""
    return max(math.ceil(columns * (fov / (2 * math.pi))), 1) if rotates else columns


def image_height(layers: int, fov: float, vertical_fov: float, width: int) -> int:
    """Compute the height of that image [px], from the highest to the lowest layer."""
    # Webots' expression, for the same rounding.
    return 1 if layers == 1 else math.ceil((vertical_fov + fov / width) * (width / fov))


def read_lidar(node: Node, place: NDArray[np.float64], robot: str) -> Lidar | None:
    """Read a lidar node, whose pose is a matrix without scale; return None for any other node."""
    if node.type != "Lidar":
        return None
    notes: list[str] = []
    projection = _projection(node, notes)
    fov = read_field_of_view(node, projection, notes, 1.5708)
    near, min_range, max_range = read_ranges(node, True, notes)
    resolution = check_resolution(node, node.number("resolution", -1.0), notes)
    kind = node.text("type", "fixed")
    if kind.lower() not in ("fixed", "rotating"):
        notes.append(correction(node, "type", kind, "fixed"))
    rotates = kind.lower() == "rotating"
    layers, columns, vertical = _image(node, fov, rotates, notes)
    return Lidar(
        name=node.text("name", "lidar"),
        robot=robot,
        layers=layers,
        columns=columns,
        fov=fov,
        vertical_fov=vertical,
        tilt=node.number("tiltAngle", 0.0),
        rotates=rotates,
        projection=projection,
        near=near,
        min_range=min_range,
        max_range=max_range,
        noise=node.number("noise", 0.0),
        resolution=resolution,
        frequency=_frequency(node, notes),
        pose=convert_axes(place, node.version.axes, "ros_body")[0],
        version=node.version,
        notes=tuple(notes),
    )


def _projection(node: Node, notes: list[str]) -> Literal["planar", "cylindrical"]:
    projection = node.text("projection", "cylindrical")
    if projection not in ("planar", "cylindrical"):
        return replaced(node, "projection", projection, "planar", notes)
    # The older field `spherical` overrides the newer one.
    return "planar" if projection == "planar" or not node.flag("spherical", True) else "cylindrical"


def _image(node: Node, fov: float, rotates: bool, notes: list[str]) -> tuple[int, int, float]:
    """Read layers, columns and the vertical field of view [rad], corrected in the order of Webots' checks."""
    layers, columns = node.integer("numberOfLayers", 4), node.integer("horizontalResolution", 512)
    vertical = node.number("verticalFieldOfView", 0.2)
    if columns < 1:
        columns = replaced(node, "horizontalResolution", columns, 1, notes)
    if vertical <= 0 or vertical > math.pi:
        fixed = 0.1 if vertical <= 0 else math.pi
        vertical = replaced(node, "verticalFieldOfView", vertical, fixed, notes)
    if layers < 1:
        layers = replaced(node, "numberOfLayers", layers, 1, notes)
    width = image_width(columns, fov, rotates)
    if max(vertical * width / fov, layers * 2 * math.pi / vertical) > MAX_RAYS:
        node.refuse("fieldOfView", f"angles [rad] for an image of at most {MAX_RAYS} rows", f"{fov:g}")
    # Every layer needs a separate row.
    if image_height(layers, fov, vertical, width) < layers:
        needed = math.ceil(layers * fov / vertical)
        needed = int(needed * (2 * math.pi / fov)) if rotates else needed
        columns = replaced(node, "horizontalResolution", columns, needed, notes)
    return layers, columns, vertical


def _frequency(node: Node, notes: list[str]) -> float:
    """Read the rotation frequency [Hz], clipped to its limits."""
    lower, upper = node.number("minFrequency", 1.0), node.number("maxFrequency", 25.0)
    lower = lower if lower > 0 else 0.01
    frequency = node.number("defaultFrequency", 10.0)
    clipped = min(max(frequency, lower), max(upper, lower))
    return frequency if clipped == frequency else replaced(node, "defaultFrequency", frequency, clipped, notes)
