# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fit the numbers of a camera that triangulates to its pictures of flat walls."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.camera import Camera, require_camera
from warpvis.core.checks import as_items, check_number, check_whole, format_percent, pluralize
from warpvis.core.depth_images import check_meters
from warpvis.errors import ArrayError
from warpvis.sensors.depth._noise_spacing import correlation, expected_correlation, find_spacing
from warpvis.sensors.depth._quantisation import find_quantum, fit_spread
from warpvis.sensors.depth._stereo import StereoDepth, check_baseline
from warpvis.sensors.depth._walls import Wall, measure_wall

# Cameras that triangulate measure no wall beyond it; a camera with a `far` has its own limit [m].
_FARTHEST_WALL = 20.0

# Below this, a step of disparity and a whole part of a pixel differ by rounding of what both were found from.
_WHOLE = 0.05


@dataclass(frozen=True)
class WallReport:
    """What one picture of a wall says, by the measures of Intel's ``rs-depth-quality``."""

    distance: float
    """Depth of the wall on the camera's axis [m]."""
    angle: float
    """Between that axis and the wall's normal [rad]."""
    plane_rms: float
    """Root mean square of depth about the plane [m]."""
    subpixel_rms: float
    """The same of disparity [px]."""
    fill_rate: float
    """Share of pixels that have depth, from 0 to 1."""


@dataclass(frozen=True)
class StereoFit:
    """What pictures of walls say of a camera that triangulates."""

    camera: Camera
    focal_baseline: float
    """Focal length times baseline, f b [px m]: disparity is this divided by depth."""
    found_by: str
    """What f b was found by: ``"baseline"``, ``"subpixel"`` or ``"band"``."""
    sigma: float
    """Standard deviation of the random part of disparities, before they are rounded [px]."""
    step: float
    """What disparities are rounded to [px]; 0 if they are not."""
    noise_spacing: int
    """Distance of the nodes between which that part is interpolated, as in `StereoDepth` [px]; 1 is white noise."""
    dropout: float
    """Share of pixels that have no depth, from 0 to 1, without those of the invalid band."""
    correlation: NDArray[np.float64]
    """Autocorrelation of disparities about the planes at 0, 1, 2, ... px, without what rounding adds."""
    walls: tuple[WallReport, ...]
    """Of each picture."""
    errors: tuple[NDArray[np.float32], ...]
    """Of each picture, how much more disparity is than the plane's [px]; NaN where there is none or it is no wall's."""

    @property
    def baseline(self) -> float:
        """Distance of the two eyes [m]."""
        return self.focal_baseline / self.camera.fx

    @property
    def expected_correlation(self) -> NDArray[np.float64]:
        """Autocorrelation of noise of this spacing at 0, 1, 2, ... px."""
        return expected_correlation(self.noise_spacing, len(self.correlation))

    def sensor(self) -> StereoDepth:
        """Return a model with these numbers, for `warpvis.Renderer`.

        Raises:
            ArrayError: Disparities are rounded to what is no whole part of a pixel.
        """
        levels = round(1.0 / self.step) if self.step > 0 else 0
        if self.step > 0 and abs(levels * self.step - 1.0) > _WHOLE:
            raise ArrayError(
                f"disparities are rounded to {self.step:.4g} px, which is no whole part of one: give the right "
                "baseline or subpixel"
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
        """Return what was found as lines of text."""
        rounded = f"{self.step:.4g} px (1/{1 / self.step:.4g})" if self.step > 0 else "none was found"
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
    resolution: float = 0.0,
    region: float = 0.8,
) -> StereoFit:
    """Fit sigma of disparity, its step, f b, correlation and dropout to pictures of flat walls.

    Every picture shows one wall, at any distance and angle; several at different distances say more, the far ones of
    the step, and ones of a wall that leans have many steps. Of a plane, 1 / z is linear in the pixel's coordinates
    (x - cx) / fx and (y - cy) / fy: what is left beside the best plane is noise. From 1 / z alone one cannot tell a
    camera of little noise and a short baseline from one of more noise and a longer one: f b comes from `baseline`, from
    `subpixel` and the step, or from the invalid band at one side, which is f b / z wide.

    Noise of less than half a step is found by its likelihood, but its correlation is then that of rounding as well.

    Args:
        depth_images: Planar depth [m], shape ``(N, H, W)`` or a list of images ``(H, W)``; 0, NaN or infinite where
            there is none.
        camera: Intrinsics of the images; its `fx` is the focal length of disparities.
        baseline: Distance of the two eyes [m], if known.
        subpixel: Into how many parts of a pixel disparities are rounded, if known.
        resolution: What depth itself was rounded to [m], such as 0.001 for files of millimetres.
        region: Which part of the image's width and height to look at, about its middle, as Intel does.

    Raises:
        ArrayError: A picture is of another size, is in millimeters or shows no wall, or nothing tells f b.
    """
    require_camera(camera)
    if baseline is not None:
        check_baseline(baseline)
    if subpixel is not None:
        check_whole(subpixel, "subpixel")
    check_number(resolution, "resolution", least=0.0)
    check_number(region, "region", least=0.1, most=1.0)
    walls = [
        measure_wall(image, camera, region, f"depth_images[{index}]")
        for index, image in enumerate(_images(depth_images, camera))
    ]
    quantum = find_quantum(walls, resolution)
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
    whole = hasattr(depth_images, "__dlpack__") or hasattr(depth_images, "__array__")
    images: list[NDArray[np.floating]]
    if whole:
        stack = as_numpy(depth_images, name="depth_images")
        images = list(stack) if stack.ndim else [stack]
    else:
        images = [as_numpy(image, name="depth_images") for image in as_items(depth_images, "depth_images")]
    if not images:
        raise ArrayError("depth_images must hold a picture of a wall, got none")
    for index, image in enumerate(images):
        size = (camera.height, camera.width)
        if image.shape != size:
            raise ArrayError(f"depth_images[{index}] must have shape {size} as the camera has, got {image.shape}")
        far = _FARTHEST_WALL if math.isinf(camera.far) else camera.far
        check_meters(image, f"depth_images[{index}]", camera.near, far)
    return images


def _find_scale(
    walls: list[Wall], camera: Camera, quantum: float, baseline: float | None, subpixel: int | None
) -> tuple[float, str]:
    """Return f b and what it was found by."""
    if baseline is not None:
        return camera.fx * baseline, "baseline"
    if subpixel is not None:
        if quantum == 0.0:
            raise ArrayError("no steps of disparity were found, of which subpixel would tell f b: give baseline")
        return 1.0 / (quantum * subpixel), "subpixel"
    sides = [[wall for wall in walls if wall.band[side] > 1] for side in range(2)]
    side = 0 if len(sides[0]) >= len(sides[1]) else 1
    if not sides[side]:
        raise ArrayError("nothing tells f b: no picture has an invalid band at a side; give baseline or subpixel")
    return _scale_of_bands(sides[side], side), "band"


def _scale_of_bands(walls: list[Wall], side: int) -> float:
    """Return the f b that makes the band of the most rows as wide as it is.

    A pixel's centre is in it if that is less than f b / z from the side: a row of n such pixels says that f b / z is
    from n - 1/2 to n + 1/2.
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
