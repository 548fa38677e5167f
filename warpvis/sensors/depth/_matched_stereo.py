# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Active stereo by matching: the infrared images of both imagers are rendered, and OpenCV finds their disparities."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import check_number, check_whole
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering import Exposure
from warpvis.scene import Scene
from warpvis.sensors._echoes import reflectivities
from warpvis.sensors.depth._base import Device, Reason, check_positive
from warpvis.sensors.depth._stereo import check_baseline

# OpenCV's disparities are multiples of 1/16 px; it searches multiples of 16 of them.
_STEPS, _DISPARITY_BLOCK = 16, 16
_MAX_WINDOW, _MAX_DISPARITY, _MAX_DOTS = 31, 1024, 10**6
# Resolution of the pattern, in pixels of the camera, and standard deviation of a dot [px].
_PATTERN_SCALE, _DOT_SIGMA = 2, 0.7
# Standard deviation of noise in the dark, as a fraction of that of white.
_DARK_NOISE = 0.3
# Relative difference of depth from which a surface hides another from the projector.
_SHADOW_MARGIN = 1e-3
# Difference of disparity from which a surface hides another from the other imager [px].
_HIDDEN = 1.0


@dataclass(frozen=True)
class MatchedStereo(Device):
    """An active stereo camera whose infrared images are rendered and matched: slower than `StereoDepth`, with no model.

    Two imagers, the camera and another one `baseline` to its right, see dots of a projector half-way between them.
    The brightness of a surface is its reflectivity times the sum of `ambient` and of the pattern, which decreases with
    the cosine of incidence and the square of distance, and is missing in the projector's shadow. Holes, silhouettes and
    errors are those of OpenCV's semi-global matcher (`StereoSGBM`), which requires ``warpvis[stereo]``. It runs on the
    CPU and copies images of a GPU to host memory. Textures are not visible.

    Lost pixels have the first of these reasons that applies: EMPTY, RANGE, BAND, SHADOW, and DROPOUT for those that the
    matcher does not find.
    """

    baseline: float
    """Distance between the imagers [m]."""
    max_disparity: int = 128
    """Maximum disparity [px], which is rounded up to a multiple of 16."""
    window: int = 7
    """Side of the matching window, odd [px]."""
    dots: int = 5000
    """Number of dots of the pattern, which fills the image of the camera. About 5000 of a D435, according to Intel's
    "Projectors for D400 Series Depth Cameras"."""
    ambient: float = 0.05
    """Light without a pattern, relative to a dot on a white surface at 1 m at normal incidence."""
    noise: float = 0.02
    """Standard deviation of white, relative to it. Images are exposed so that 1 % of their pixels are white."""
    min_contrast: float = 0.05
    """Minimum difference of brightness, relative to white, within `window` pixels of a pixel that is found. The D400
    finds differences below 5 %, according to Intel's "Optical Filters for Intel RealSense Depth Cameras D400"."""
    uniqueness: int = 10
    """Margin by which the best disparity must be better than all others [%]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_baseline(self.baseline)
        _check_at_most(check_whole(self.max_disparity, "max_disparity"), "max_disparity", _MAX_DISPARITY)
        if check_whole(self.window, "window") % 2 == 0:
            raise ArrayError(f"window must be odd, got {self.window}")
        _check_at_most(self.window, "window", _MAX_WINDOW)
        _check_at_most(check_whole(self.dots, "dots"), "dots", _MAX_DOTS)
        check_positive(self.ambient, "ambient")
        check_number(self.noise, "noise", minimum=0.0, maximum=1.0)
        check_number(self.min_contrast, "min_contrast", minimum=0.0, maximum=1.0)
        _check_at_most(check_whole(self.uniqueness, "uniqueness", minimum=0), "uniqueness", 100)

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]: points and images of the other imager."""
        return 8 + 4 + 12 + 4

    @property
    def edge_shift(self) -> int:
        """Distance by which nearer surfaces spread: half a window [px]."""
        return self.window // 2

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera if it can be used with the sensor and the scene.

        Raises:
            CameraError: If OpenCV is missing.
        """
        _load_opencv()
        return super().check(scene, camera)

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        left, right = self._render(exposure)
        scale = exposure.camera.fx * self.baseline
        depth, reasons = np.empty(left.depth.shape, np.float32), np.empty(left.depth.shape, np.uint8)
        for view, key in enumerate(exposure.numbers):
            images = self._expose(left.light[view], right.light[view], exposure.seed, key)
            disparity = self._match(*images)
            depth[view], reasons[view] = _judge(
                disparity, left.depth[view], right.depth[view], scale, self.max_disparity, exposure.camera
            )
        exposure.depth_out.assign(depth)
        if exposure.reasons_out is not None:
            exposure.reasons_out.assign(reasons)

    def _render(self, exposure: Exposure) -> tuple[_Sight, _Sight]:
        """Return what both imagers see, in light that is not exposed yet."""
        shape = exposure.true_depth.shape
        own = {"depth": exposure.true_depth, "normals": exposure.normals, "segmentation": exposure.segmentation}
        left = {name: image.numpy() for name, image in own.items() if image is not None}
        centers = np.stack(np.meshgrid(np.arange(shape[2]) + 0.5, np.arange(shape[1]) + 0.5), axis=-1)
        points = np.broadcast_to(centers, (*shape, 2))
        right = self._cast(exposure, self.baseline, points, ("depth", *self.needs))
        half = self.baseline / 2
        return self._illuminate(exposure, left, half), self._illuminate(exposure, right, -half)

    def _cast(
        self, exposure: Exposure, offset: float, points: NDArray[Any], names: tuple[str, ...]
    ) -> dict[str, NDArray[Any]]:
        """Return images at points of the camera, moved along its x axis by `offset` [m]."""
        device, poses = exposure.scene.device, exposure.poses.numpy().copy()
        poses[:, :3] += offset * poses_to_matrices(poses)[:, :3, 0]
        camera = dataclasses.replace(exposure.camera, near=exposure.clip_near, far=math.inf)
        there = wp.array(points.astype(np.float32), dtype=wp.vec2, device=device)
        seen = exposure.cast_images_at(camera, wp.array(poses, dtype=wp.transform, device=device), there, names)
        return {name: image.numpy().copy() for name, image in seen.items()}

    def _illuminate(self, exposure: Exposure, image: dict[str, NDArray[Any]], offset: float) -> _Sight:
        """Return the light of an imager whose projector is `offset` to its right [m]."""
        camera, depth = exposure.camera, image["depth"]
        axes = poses_to_matrices(exposure.poses.numpy())[:, :3, :3].astype(np.float32)
        normals = np.einsum("vij,vyxi->vyxj", axes, image["normals"])
        with np.errstate(invalid="ignore", divide="ignore"):
            to_projector = np.array([offset, 0.0, 0.0], dtype=np.float32) - depth[..., None] * _rays(camera)
            distance = np.linalg.norm(to_projector, axis=-1)
            cosine = np.abs((normals * to_projector).sum(axis=-1)) / distance
            slopes = to_projector[..., :2] / to_projector[..., 2:]
        focal, center = (np.array(pair, dtype=np.float32) for pair in ((camera.fx, camera.fy), (camera.cx, camera.cy)))
        pixels = (slopes * focal + center).astype(np.float32)
        shown = self._cast(exposure, self.baseline / 2, pixels, ("depth",))["depth"]
        albedo: Any = 1.0
        if "segmentation" in image:
            values = reflectivities(exposure.scene, self.reflectivity)
            albedo = np.append(values, np.float32(0.0))[image["segmentation"]]
        with np.errstate(invalid="ignore"):
            is_lit = shown > depth * (1 - _SHADOW_MARGIN)
            pattern = np.where(is_lit, _look_up(pixels, camera, self.dots) * cosine / distance**2, 0.0)
        light = np.where(np.isfinite(depth), albedo * (self.ambient + pattern), 0.0)
        return _Sight(depth, light.astype(np.float32))

    def _expose(
        self, left: NDArray[np.float32], right: NDArray[np.float32], seed: int, key: NDArray[np.uint32]
    ) -> list[NDArray[np.uint8]]:
        """Return images with 8 bits and noise; both have the exposure of the first one."""
        white = max(float(np.quantile(left, 0.99)), 1e-6)
        random = np.random.Generator(np.random.Philox(key=[seed | int(key[0]) << 32, int(key[1])]))
        images = []
        for light in (left, right):
            bright = np.minimum(light / white, 1.0)
            deviation = self.noise * np.sqrt(_DARK_NOISE**2 + (1 - _DARK_NOISE**2) * bright)
            noisy = bright + deviation * random.standard_normal(light.shape, dtype=np.float32)
            images.append(np.clip(255 * noisy + 0.5, 0, 255).astype(np.uint8))
        return images

    def _match(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Return disparities [px], 0 or below where there is none."""
        cv2 = _load_opencv()
        count = -(-self.max_disparity // _DISPARITY_BLOCK) * _DISPARITY_BLOCK
        matcher = cv2.StereoSGBM_create(
            minDisparity=0,
            numDisparities=count,
            blockSize=self.window,
            P1=8 * self.window**2,
            P2=32 * self.window**2,
            disp12MaxDiff=1,
            uniquenessRatio=self.uniqueness,
            speckleWindowSize=4 * self.window**2,
            speckleRange=1,
        )
        # It has no result for the first `count` columns.
        padded = [cv2.copyMakeBorder(image, 0, 0, count, 0, cv2.BORDER_CONSTANT) for image in (left, right)]
        disparity = matcher.compute(*padded)[:, count:].astype(np.float32) / _STEPS
        around = np.ones(2 * [2 * self.window + 1], dtype=np.uint8)
        contrast = cv2.dilate(left, around) - cv2.erode(left, around)
        return np.where(contrast < 255 * self.min_contrast, np.float32(0.0), disparity)


@dataclass(frozen=True)
class _Sight:
    """Depth [m] and light that an imager sees, ``(V, H, W)``."""

    depth: NDArray[np.float32]
    light: NDArray[np.float32]


def _judge(
    disparity: NDArray[np.float32],
    true_depth: NDArray[np.float32],
    other_depth: NDArray[np.float32],
    scale: float,
    max_disparity: int,
    camera: Camera,
) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
    """Return depth and reasons of a view from the disparities found."""
    columns = np.broadcast_to(np.arange(disparity.shape[1]) + 0.5, disparity.shape)
    with np.errstate(divide="ignore"):
        depth = np.where(disparity > 0, scale / disparity, np.nan).astype(np.float32)
        true_disparity = scale / true_depth
    seen_at = columns - true_disparity
    index = np.clip(seen_at, 0, disparity.shape[1] - 1).astype(int)
    hidden = scale / np.take_along_axis(other_depth, index, axis=1) > true_disparity + _HIDDEN
    reasons = np.full(disparity.shape, int(Reason.DROPOUT), dtype=np.uint8)
    reasons[hidden] = Reason.SHADOW
    reasons[seen_at < 0] = Reason.BAND
    reasons[true_disparity > max_disparity] = Reason.RANGE
    reasons[~np.isfinite(true_depth)] = Reason.EMPTY
    # No pixel of the other image matches those whose disparity leads out of it.
    found = (disparity > 0) & (columns - disparity >= 0)
    too_near, too_far = found & (depth < camera.near), found & (depth > camera.far)
    reasons[found] = Reason.VALID
    reasons[too_near | too_far] = Reason.RANGE
    depth[~found] = np.nan
    depth[too_near | (~found & (reasons == Reason.RANGE))] = -np.inf
    depth[too_far | (reasons == Reason.EMPTY)] = np.inf
    return depth, reasons


def _rays(camera: Camera) -> NDArray[np.float32]:
    """Return points of pixels at a depth of 1, ``(H, W, 3)``."""
    x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1).astype("f4")


def _look_up(pixels: NDArray[np.float32], camera: Camera, dots: int) -> NDArray[np.float32]:
    """Return the brightness of the pattern at pixels of the projector, ``(V, H, W)``; 0 outside."""
    cv2 = _load_opencv()
    pattern = _make_pattern(camera.width, camera.height, dots)
    places = np.nan_to_num(pixels * _PATTERN_SCALE - 0.5, nan=-9.0)
    return np.stack(
        [
            cv2.remap(
                pattern, view[..., 0].copy(), view[..., 1].copy(), cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
            )
            for view in places
        ]
    )


@lru_cache(maxsize=8)
def _make_pattern(width: int, height: int, dots: int) -> NDArray[np.float32]:
    """Return an image of dots, one at a random place in each cell of a grid; the brightest pixel is 1."""
    cv2 = _load_opencv()
    side = math.sqrt(width * height / dots)
    columns, rows = max(1, round(width / side)), max(1, round(height / side))
    random = np.random.default_rng(0)
    shape = height * _PATTERN_SCALE, width * _PATTERN_SCALE
    y, x = np.mgrid[:rows, :columns] + random.uniform(size=(2, rows, columns))
    image = np.zeros(shape, dtype=np.float32)
    image[(y * (shape[0] / rows)).astype(int), (x * (shape[1] / columns)).astype(int)] = 1.0
    spread = cv2.GaussianBlur(image, (0, 0), _DOT_SIGMA * _PATTERN_SCALE)
    return spread / spread.max()


def _check_at_most(value: int, name: str, maximum: int) -> None:
    if value > maximum:
        raise ArrayError(f"{name} must be at most {maximum}, got {value}")


def _load_opencv() -> Any:
    try:
        import cv2
    except ImportError:
        raise CameraError("MatchedStereo needs OpenCV, which is missing: pip install 'warpvis[stereo]'") from None
    return cv2
