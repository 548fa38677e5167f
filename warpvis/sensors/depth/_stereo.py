# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras that use triangulation: passive and active stereo, and structured light."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.checks import as_floats
from warpvis.cameras.pinhole import Camera, require_camera
from warpvis.core.checks import check_choice, check_flag, check_number, check_whole, is_number
from warpvis.core.kernel_cache import launch
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, CameraError
from warpvis.kernels.constants import STREAM_DISPARITY, STREAM_DROPOUT
from warpvis.rendering import Exposure
from warpvis.scene import Scene
from warpvis.sensors.depth._base import (
    RANDOM_WORDS,
    Device,
    check_positive,
    draw_normal_image,
    kernel_images,
)

if TYPE_CHECKING:
    from warpvis.kernels.sensors.noise import SensorInputs
    from warpvis.kernels.sensors.stereo import SmoothField, StereoModel

Side = Literal["right", "left"]

_SHADOW_TOLERANCE = 2.0**-6
"""Minimum difference of disparity for a surface to hide another from the other eye [px].

Positions in the image of that eye are rounded to 2^-14 px in images of 512 to 1024 pixels, and depth has a relative
error of 6e-8. The tolerance exceeds the effect of both for surfaces whose disparity changes by up to 100 px between
adjacent pixels. The width of a shadow is the difference of disparities, so shadows wider than a tenth of a pixel are
not missed.
"""
_EDGE_ON_SIGNAL = 0.05
"""Signal of a white surface at an angle of incidence of 87 degrees."""
# Longer than the baseline of any device [m], and shorter than one in millimeters.
_LONG_BASELINE = 5.0
# Maximum relative difference of focal lengths between devices of one kind.
_FOCAL_LENGTH_TOLERANCE = 0.05
_MAX_SPACING, _MAX_WINDOW, _MAX_MARGIN = 64, 63, 8192


@lru_cache(maxsize=1024)  # warn once for each pair
def _warn_of_focal_length(fx: float, native_fx: float) -> None:
    """Warn if the focal length of a camera differs from that of the device."""
    if abs(fx / native_fx - 1.0) > _FOCAL_LENGTH_TOLERANCE:
        warn_user(
            f"fx of the camera is {fx:g} px, but {native_fx:g} px for the device. Noise, edges and the invalid band "
            "are in pixels and will differ from the device. Render with sensor.camera(), or create the profile for "
            "images of this size.",
            UserWarning,
        )


def check_baseline(baseline: object) -> None:
    """Check the distance between the eyes of a depth camera [m]; warn if it is longer than that of any device."""
    length = check_positive(baseline, "baseline", "m, the distance between a sensor's two eyes")
    if length >= _LONG_BASELINE:
        warn_user(
            f"baseline is {length:g} m, longer than that of any depth camera. If it is in millimeters, pass "
            f"{length / 1000:g}.",
            UserWarning,
        )


@dataclass(frozen=True)
class StereoDepth(Device):
    """A depth camera that measures disparities between its imager and another eye: an imager or a projector.

    The other eye is the camera translated along its x axis. A pixel of depth z has the disparity d = f b / z [px]. The
    measured disparity is d + `locking` sin(2 pi d) + `sigma` n, with a standard normal n, rounded to multiples of
    1 / `subpixel` px unless `subpixel` is 0. Measured depth is f b divided by it. A pixel has no depth if one of these
    conditions is true; the first gives its `Reason`: the ray hits nothing (EMPTY); the disparity is above
    `max_disparity` (RANGE); the point is outside of the image of the other eye (BAND), or hidden from it (SHADOW, by a
    ray to the exact point); the surroundings have another depth (EDGE); too little light is reflected because of the
    angle (GRAZING) or because the surface is dark, or the pixel is lost at random (DROPOUT); measured depth is outside
    of `near` and `far` of the camera (RANGE).

    By default, a sensor has no noise, and measures all surfaces that both eyes see.
    """

    baseline: float
    """Distance between the two eyes [m]."""
    other_eye: Side = "right"
    """Side of the other eye, in the viewing direction. Invalid band and shadows are on the opposite side of the image
    and of objects."""
    focal_length: float | None = None
    """Focal length of disparities [px]; the camera's `fx` by default."""
    max_disparity: float = math.inf
    """Maximum disparity that is searched [px], which limits the minimum depth."""
    sigma: float = 0.0
    """Standard deviation of the noise of disparity [px]."""
    noise_spacing: int = 1
    """Spacing of the nodes between which noise is interpolated with constant standard deviation [px]; it models the
    smoothing by matching windows. 1 is white noise."""
    subpixel: int = 0
    """Steps of disparity per pixel, such as 8 or 32; 0 for no rounding."""
    locking: float = 0.0
    """Amplitude of the systematic error of disparity toward whole pixels, or away from them if negative [px]."""
    shadow: bool = True
    """Whether points that are hidden from the other eye have no depth."""
    band: bool = True
    """Whether points outside of the image of the other eye have no depth. The image of a projector is often larger than
    that of the imager."""
    fattening: int = 0
    """Distance by which nearer surfaces spread over farther ones [px]: half the side of a matching window. A pixel gets
    the depth of the closest pixel of its row within this distance whose disparity is greater by at least `edge_step`;
    then, likewise, of its column."""
    edge_window: int = 1
    """Side of the window about a pixel for the detection of edges, odd [px]; 1 for no detection."""
    edge_step: float = 1.0
    """Minimum difference of disparity between different surfaces [px]."""
    min_support: float = 0.0
    """Minimum support of a pixel in that window: the fraction of its row that belongs to the same surface, times the
    fraction of its column."""
    min_signal: float = 0.0
    """Reflectivity times the cosine of the angle of incidence up to which no pixel is measured."""
    full_signal: float = 0.0
    """The same product from which on all pixels are measured; in between, the probability increases linearly. If 0, the
    signal is not checked. With a reflectivity of 1, it is not checked up to 0.05 either, which saves rendering normals:
    only surfaces seen at more than 87 degrees would be lost."""
    dropout: float = 0.0
    """Probability that a pixel is lost at random, from 0 to 1."""
    hole_spacing: int = 1
    """Spacing of the nodes between which the random numbers that decide on the loss of pixels are interpolated [px].
    Pixels have the same probability as with 1, which loses each of them independently, but are lost in clumps, as if by
    matching windows of about twice this size."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_baseline(self.baseline)
        check_choice(self.other_eye, "other_eye", ("right", "left"))
        if self.focal_length is not None:
            check_positive(self.focal_length, "focal_length", "px")
        if not is_number(self.max_disparity) or not self.max_disparity > 0:
            raise ArrayError(f"max_disparity must be a number of pixels above 0, got {self.max_disparity!r}")
        check_number(self.sigma, "sigma", minimum=0.0)
        check_number(self.locking, "locking")
        _check_at_most(check_whole(self.noise_spacing, "noise_spacing"), "noise_spacing", _MAX_SPACING)
        check_whole(self.subpixel, "subpixel", minimum=0)
        check_flag(self.shadow, "shadow")
        check_flag(self.band, "band")
        _check_at_most(check_whole(self.fattening, "fattening", minimum=0), "fattening", _MAX_WINDOW // 2)
        if check_whole(self.edge_window, "edge_window") % 2 == 0:
            raise ArrayError(f"edge_window must be odd, got {self.edge_window}")
        _check_at_most(self.edge_window, "edge_window", _MAX_WINDOW)
        check_number(self.edge_step, "edge_step", minimum=0.0)
        check_number(self.min_support, "min_support", minimum=0.0, maximum=1.0)
        min_signal = check_number(self.min_signal, "min_signal", minimum=0.0)
        full = check_number(self.full_signal, "full_signal", minimum=0.0)
        if full <= min_signal and full + min_signal > 0:
            raise ArrayError(f"full_signal must be above min_signal, got {full:g} and {min_signal:g}")
        check_number(self.dropout, "dropout", minimum=0.0, maximum=1.0)
        _check_at_most(check_whole(self.hole_spacing, "hole_spacing"), "hole_spacing", _MAX_SPACING)

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read."""
        return super().needs if self._checks_signal else ()

    @property
    def _checks_signal(self) -> bool:
        is_white = is_number(self.reflectivity) and self.reflectivity == 1.0
        return self.full_signal > (_EDGE_ON_SIGNAL if is_white else 0.0)

    @property
    def bytes_per_pixel(self) -> int:
        """Scratch memory per pixel [B]."""
        fattened = 16 if self.needs else 8
        nodes = 4 * (self._has_smooth_noise + self._has_clumps)
        return (16 if self.shadow else 0) + nodes + (fattened if self.fattening else 0)

    @property
    def edge_shift(self) -> int:
        """Distance by which nearer surfaces spread [px]."""
        return self.fattening

    @property
    def _has_smooth_noise(self) -> bool:
        return self.sigma > 0 and self.noise_spacing > 1

    @property
    def _has_clumps(self) -> bool:
        return self.hole_spacing > 1 and (self._checks_signal or self.dropout > 0)

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera if it can be used with the sensor and the scene."""
        pinhole = super().check(scene, camera)
        if self.native_camera is not None:
            _warn_of_focal_length(pinhole.fx, self.native_camera.fx)
        if self.shadow:
            self._other_camera(pinhole, 0.0)
        return pinhole

    def _scale(self, camera: Camera) -> float:
        """Return focal length times baseline [px m]."""
        return (require_camera(camera).fx if self.focal_length is None else self.focal_length) * self.baseline

    def _other_camera(self, camera: Camera, clip_near: float) -> Camera:
        """Return the camera of the other eye; with ``band=False``, its image is widened by the maximum disparity."""
        other = dataclasses.replace(camera, near=clip_near, far=math.inf)
        if self.band:
            return other
        min_depth = max(camera.near, self._scale(camera) / self.max_disparity)
        max_shift = camera.fx * self.baseline / min_depth if min_depth > 0 else math.inf
        if max_shift > _MAX_MARGIN:
            raise CameraError(
                f"near of the camera, or max_disparity, must limit disparities to {_MAX_MARGIN} px if band=False"
            )
        margin = math.ceil(max_shift) + 1
        return dataclasses.replace(other, width=camera.width + 2 * margin, cx=camera.cx + margin)

    def depth_sigma(self, depth: ArrayLike, camera: Camera) -> NDArray[np.float64]:
        """Return z^2 / (f b) times the standard deviation of disparity: noise, locking and rounding."""
        rounding = 1 / (12 * self.subpixel**2) if self.subpixel else 0.0
        disparity_sigma = math.sqrt(self.sigma**2 + self.locking**2 / 2 + rounding)
        return as_floats(depth, "depth") ** 2 * (disparity_sigma / self._scale(camera))

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.stereo import OtherEye, measure_stereo, place_in_other_eyes, place_other_eyes

        inputs = self.inputs(exposure)
        if self.fattening and self.edge_step > 0:
            self._fatten(exposure, inputs)
        poses, device = exposure.poses, exposure.scene.device
        other_poses = exposure.scratch("other poses", poses.shape, wp.transform)
        eyes = wp.empty(len(poses), dtype=OtherEye, device=device)
        side = self.baseline if self.other_eye == "right" else -self.baseline
        launch(place_other_eyes, len(poses), [poses, wp.float64(side), other_poses, eyes], device)
        model = self._model(exposure)
        if self.shadow:
            other = self._other_camera(exposure.camera, exposure.clip_near)
            model.other_width, model.added_columns = other.width, other.cx - exposure.camera.cx
            model.min_depth = self._scale(exposure.camera) / self.max_disparity
            points = exposure.scratch("points", exposure.true_depth.shape, wp.vec2)
            limits = None
            if device.is_cpu and exposure.clip_near == 0.0:
                limits = exposure.scratch("limits", points.shape, wp.float32)
            exposure.launch(place_in_other_eyes, model, inputs, points, limits, cameras=[eyes], rows=RANDOM_WORDS)
            model.other_depth = exposure.cast_at(other, other_poses, points, limits)
        exposure.launch(measure_stereo, model, inputs, kernel_images(exposure), cameras=[eyes], rows=RANDOM_WORDS)

    def _fatten(self, exposure: Exposure, inputs: SensorInputs) -> None:
        """Replace depth of the inputs, and the pixels of normals and objects, by those of nearer surfaces."""
        from warpvis.kernels.sensors.fattening import FatteningModel, fatten_surfaces

        model = FatteningModel()
        model.disparity_scale, model.step, model.reach = self._scale(exposure.camera), self.edge_step, self.fattening
        for along in ("rows", "columns"):
            depth = exposure.scratch(f"depth fattened along {along}", exposure.true_depth.shape, wp.float32)
            shown = exposure.scratch(f"pixels along {along}", depth.shape, wp.int32) if self.needs else None
            model.along_columns = along == "columns"
            exposure.launch(fatten_surfaces, model, inputs, depth, shown, rows=RANDOM_WORDS)
            inputs.true_depth = depth
            if shown is not None:
                inputs.shown = shown

    def _model(self, exposure: Exposure) -> StereoModel:
        """Return the parameters as a struct for kernels, without the image of the other eye."""
        from warpvis.kernels.sensors.stereo import StereoModel

        camera, model = exposure.camera, StereoModel()
        model.disparity_scale = self._scale(camera)
        model.shift_scale = camera.fx * self.baseline * (1.0 if self.other_eye == "right" else -1.0)
        model.first_column, model.last_column = (0.0, camera.width) if self.band else (-math.inf, math.inf)
        model.max_disparity, model.shadow_tolerance = self.max_disparity, _SHADOW_TOLERANCE
        model.min_support, model.window, model.edge_step = self.min_support, self.edge_window // 2, self.edge_step
        # If the signal is not checked, slope 1 accepts the default cosine of 1.
        model.min_signal = self.min_signal if self._checks_signal else 0.0
        model.signal_slope = 1.0 / (self.full_signal - self.min_signal) if self._checks_signal else 1.0
        model.detection_rate = 1.0 - self.dropout
        model.sigma, model.locking, model.levels = self.sigma, self.locking, self.subpixel
        model.column_slopes, model.row_slopes = _slopes(camera, str(exposure.scene.device))
        if self._has_smooth_noise:
            model.noise = _draw_field(exposure, STREAM_DISPARITY, self.noise_spacing)
        if self._has_clumps:
            model.holes = _draw_field(exposure, STREAM_DROPOUT, self.hole_spacing)
        return model


def _draw_field(exposure: Exposure, stream: int, spacing: int) -> SmoothField:
    """Draw normal numbers of a stream at the nodes of each view, and set the interpolation weights of pixels."""
    from warpvis.kernels.sensors.stereo import SmoothField

    views, height, width = exposure.true_depth.shape
    shape = (views, (height - 1) // spacing + 2, (width - 1) // spacing + 2)
    field = SmoothField()
    field.nodes = draw_normal_image(exposure, stream, f"nodes of stream {stream}", shape)
    field.spacing = spacing
    field.weights, field.column_nodes, field.left_weights, field.right_weights = _node_weights(
        spacing, width, str(exposure.scene.device)
    )
    return field


@lru_cache(maxsize=64)
def _node_weights(spacing: int, width: int, device: str) -> tuple[wp.array, ...]:
    """Return the weights of nodes by position, the left node of each column, and the weights of both its nodes."""
    angles = np.arange(spacing) / spacing * (math.pi / 2)
    weights = np.stack([np.cos(angles), np.sin(angles)], axis=-1).astype(np.float32)
    columns = np.arange(width, dtype=np.int32) // spacing
    sides = weights[np.arange(width) % spacing].T.copy()
    return (
        wp.array(weights, dtype=wp.vec2, device=device),
        wp.array(columns, dtype=wp.int32, device=device),
        *(wp.array(side, dtype=wp.float32, device=device) for side in sides),
    )


@lru_cache(maxsize=64)
def _slopes(camera: Camera, device: str) -> tuple[wp.array, wp.array]:
    """Return x of the rays of columns and y of the rays of rows, for z = 1."""
    columns = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    rows = (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
    return tuple(wp.array(slopes.astype(np.float32), dtype=wp.float32, device=device) for slopes in (columns, rows))


def _check_at_most(value: int, name: str, maximum: int) -> None:
    if value > maximum:
        raise ArrayError(f"{name} must be at most {maximum} px, got {value}")
