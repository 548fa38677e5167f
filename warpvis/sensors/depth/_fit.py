# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fit the parameters of a stereo depth camera to its depth images of flat walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.depth_images import check_meters
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_items, check_number, check_whole, format_percent, pluralize
from warpvis.errors import ArrayError
from warpvis.sensors.depth._stereo import StereoDepth, check_baseline
from warpvis.sensors.depth._walls import (
    Wall,
    correlation,
    expected_correlation,
    find_quantum,
    find_spacing,
    fit_spread,
    measure_wall,
)

# Maximum distance of a wall for cameras without a finite `far` [m].
_FARTHEST_WALL = 20.0

# Relative tolerance for the step of disparity to be 1/n px.
_STEP_TOLERANCE = 0.05


@dataclass(frozen=True)
class WallReport:
    """Measures of one depth image of a wall, as defined by Intel's ``rs-depth-quality``."""

    distance: float
    """Depth of the wall on the axis of the camera [m]."""
    angle: float
    """Angle between that axis and the normal of the wall [rad]."""
    plane_rms: float
    """RMS error of depth about the plane [m]."""
    subpixel_rms: float
    """RMS error of disparity about the plane [px]."""
    fill_rate: float
    """Fraction of pixels with depth, from 0 to 1."""


@dataclass(frozen=True)
class StereoFit:
    """Parameters of a stereo depth camera, fitted to depth images of walls."""

    camera: Camera
    focal_baseline: float
    """Focal length times baseline, f b [px m]: disparity is f b / depth."""
    found_by: str
    """Source of f b: ``"baseline"``, ``"subpixel"`` or ``"band"``."""
    sigma: float
    """Standard deviation of the noise of disparity before rounding [px]."""
    step: float
    """Quantization step of disparity [px]; 0 if disparities are not rounded."""
    noise_spacing: int
    """Spacing of the nodes between which noise is interpolated, as in `StereoDepth` [px]; 1 is white noise."""
    dropout: float
    """Fraction of pixels without depth, from 0 to 1, outside of the invalid band."""
    correlation: NDArray[np.float64]
    """Autocorrelation of disparity about the planes at lags of 0, 1, 2, ... px, without the rounding error."""
    walls: tuple[WallReport, ...]
    """Measures of each image."""
    errors: tuple[NDArray[np.float32], ...]
    """Disparity minus the disparity of the plane for each image [px]; NaN where there is no depth or no wall."""

    @property
    def baseline(self) -> float:
        """Distance between the two eyes [m]."""
        return self.focal_baseline / self.camera.fx

    @property
    def expected_correlation(self) -> NDArray[np.float64]:
        """Autocorrelation of noise with this spacing at lags of 0, 1, 2, ... px."""
        return expected_correlation(self.noise_spacing, len(self.correlation))

    def sensor(self) -> StereoDepth:
        """Return a model with these parameters, for `warpvis.Renderer`.

        Raises:
            ArrayError: If the step of disparity is not 1/n px.
        """
        levels = round(1.0 / self.step) if self.step > 0 else 0
        if self.step > 0 and abs(levels * self.step - 1.0) > _STEP_TOLERANCE:
            raise ArrayError(
                f"step of disparity must be 1/n px, got {self.step:.4g} px. Pass the correct baseline or subpixel."
            )
        return StereoDepth(
            self.baseline,
            sigma=self.sigma,
            noise_spacing=self.noise_spacing,
            subpixel=levels,
            dropout=self.dropout,
            native_camera=self.camera,
        )

    def report(self) -> str:
        """Return the result as lines of text."""
        rounded = f"{self.step:.4g} px (1/{1 / self.step:.4g})" if self.step > 0 else "not found"
        lines = [
            f"{pluralize(len(self.walls), 'wall')}; f b {self.focal_baseline:.4g} px m, by the {self.found_by}",
            f"sigma of disparity  {self.sigma:.4g} px",
            f"step of disparity   {rounded}",
            f"noise spacing       {self.noise_spacing} px",
            f"dropout             {format_percent(self.dropout, digits=2)}",
            "",
            "distance  angle  plane-fit RMS  subpixel RMS  fill rate",
        ]
        lines += [
            f"{wall.distance:6.3f} m  {math.degrees(wall.angle):4.1f}   {1e3 * wall.plane_rms:8.2f} mm  "
            f"{wall.subpixel_rms:9.4f} px  {format_percent(wall.fill_rate, digits=1):>8}"
            for wall in self.walls
        ]
        return "\n".join(lines)


def fit(
    depth_images: ArrayLike | Sequence[ArrayLike],
    camera: Camera,
    *,
    baseline: float | None = None,
    subpixel: int | None = None,
    depth_step: float = 0.0,
    region: float = 0.8,
) -> StereoFit:
    """Fit noise, quantization step, f b, correlation and dropout of disparity to depth images of flat walls.

    Each image shows one wall, at any distance and angle. Several images at different distances give better results: far
    walls determine the step, and slanted walls have many steps. On a plane, 1 / z is linear in the pixel coordinates
    (x - cx) / fx and (y - cy) / fy; the residual of the best plane is noise. f b cannot be determined from 1 / z alone,
    because 1 / z depends only on the ratio of the noise of disparity to f b. It is computed from `baseline`, from
    `subpixel` and the step, or from the width f b / z of the invalid band at one side.

    Noise below half a step is estimated by maximum likelihood, but its correlation then includes that of the rounding
    error.

    Args:
        depth_images: Planar depth [m], shape ``(N, H, W)`` or a list of images ``(H, W)``; 0, NaN or infinite where
            there is no depth.
        camera: Intrinsics of the images; its `fx` is the focal length of disparities.
        baseline: Distance between the two eyes [m], if known.
        subpixel: Steps of disparity per pixel, if known.
        depth_step: Quantization step of depth [m], such as 0.001 for files in millimeters.
        region: Fraction of the width and height of the image to use, about its center, as in Intel's tool.

    Raises:
        ArrayError: If an image has another size than the camera, is in millimeters or shows no wall, or if f b cannot
            be determined.
    """
    require_camera(camera)
    if baseline is not None:
        check_baseline(baseline)
    if subpixel is not None:
        check_whole(subpixel, "subpixel")
    check_number(depth_step, "depth_step", minimum=0.0)
    check_number(region, "region", minimum=0.1, maximum=1.0)
    walls = [
        measure_wall(image, camera, region, f"depth_images[{index}]")
        for index, image in enumerate(_images(depth_images, camera))
    ]
    quantum = find_quantum(walls, depth_step)
    focal_baseline, found_by = _find_scale(walls, camera, quantum, baseline, subpixel)
    walls, spread = fit_spread(walls, quantum)
    measured = correlation(walls, quantum**2 / 12)
    return StereoFit(
        camera=camera,
        focal_baseline=focal_baseline,
        found_by=found_by,
        sigma=spread * focal_baseline,
        step=quantum * focal_baseline,
        noise_spacing=find_spacing(measured) if spread > 0 else 1,
        dropout=float(np.average([wall.missing for wall in walls], weights=[wall.known.size for wall in walls])),
        correlation=measured,
        walls=tuple(_report(wall, focal_baseline) for wall in walls),
        errors=tuple((wall.residuals * focal_baseline).astype(np.float32) for wall in walls),
    )


def _images(depth_images: ArrayLike | Sequence[ArrayLike], camera: Camera) -> list[NDArray[np.floating]]:
    is_array = hasattr(depth_images, "__dlpack__") or hasattr(depth_images, "__array__")
    images: list[NDArray[np.floating]]
    if is_array:
        stack = as_numpy(depth_images, name="depth_images")
        images = list(stack) if stack.ndim else [stack]
    else:
        images = [as_numpy(image, name="depth_images") for image in as_items(depth_images, "depth_images")]
    if not images:
        raise ArrayError("depth_images must contain at least one image, got none")
    for index, image in enumerate(images):
        size = (camera.height, camera.width)
        if image.shape != size:
            raise ArrayError(f"depth_images[{index}] must have the shape {size} of the camera, got {image.shape}")
        far = _FARTHEST_WALL if math.isinf(camera.far) else camera.far
        check_meters(image, f"depth_images[{index}]", camera.near, far)
    return images


def _find_scale(
    walls: list[Wall], camera: Camera, quantum: float, baseline: float | None, subpixel: int | None
) -> tuple[float, str]:
    """Return f b and its source."""
    if baseline is not None:
        return camera.fx * baseline, "baseline"
    if subpixel is not None:
        if quantum == 0.0:
            raise ArrayError(
                "f b cannot be determined from subpixel because no steps of disparity were found. Pass baseline."
            )
        return 1.0 / (quantum * subpixel), "subpixel"
    sides = [[wall for wall in walls if wall.band[side] > 1] for side in range(2)]
    side = 0 if len(sides[0]) >= len(sides[1]) else 1
    if not sides[side]:
        raise ArrayError(
            "f b cannot be determined because no image has an invalid band at a side. Pass baseline or subpixel."
        )
    return _scale_of_bands(sides[side], side), "band"


def _scale_of_bands(walls: list[Wall], side: int) -> float:
    """Return the f b that agrees with the width of the band in the largest number of rows.

    A pixel is in the band if its center is less than f b / z from the side: if the band of a row has n pixels, f b / z
    is between n - 1/2 and n + 1/2.
    """
    width = np.concatenate([wall.edges[side] for wall in walls])
    inverse = np.concatenate([wall.edge_planes[side] for wall in walls])
    ends = np.concatenate([(width - 0.5) / inverse, (width + 0.5) / inverse])
    change = np.repeat([1, -1], len(width))
    order = np.argsort(ends, kind="stable")
    best = int(np.argmax(np.cumsum(change[order])))
    return float(ends[order][best : best + 2].mean())


def _report(wall: Wall, focal_baseline: float) -> WallReport:
    residuals = wall.residuals[wall.known]
    return WallReport(
        distance=wall.distance,
        angle=wall.angle,
        plane_rms=wall.plane_rms,
        subpixel_rms=float(np.sqrt(np.mean(residuals**2))) * focal_baseline,
        fill_rate=1.0 - wall.missing,
    )
