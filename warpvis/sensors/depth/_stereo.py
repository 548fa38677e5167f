# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras that triangulate: passive and active stereo, and structured light."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import warp as wp

from warpvis.core.camera import Camera
from warpvis.core.checks import check_choice, check_flag, check_number, check_whole, is_number
from warpvis.core.kernel_cache import launch
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, CameraError
from warpvis.kernels.constants import STREAM_DISPARITY
from warpvis.rendering import Exposure
from warpvis.scene import Scene
from warpvis.sensors.depth._device import Device
from warpvis.sensors.depth._fattening import fatten
from warpvis.sensors.depth._normal_images import drawing_kernel

if TYPE_CHECKING:
    from warpvis.kernels.stereo import StereoModel, StereoViews

Side = Literal["right", "left"]

_SHADOW_TOLERANCE = 2.0**-6
"""A surface hides another from the other eye where its disparity is greater by more than this [px].

Where a point is in that eye's image is rounded to 2^-14 px in images of 512 to 1024 pixels, and depth to 6e-8 of
itself: the tolerance is more than either makes of surfaces whose disparity there changes by up to 100 px from one pixel
to the next. A shadow is as wide as disparities differ, so that none is missed that has a tenth of a pixel's width.
"""
# Longer than any device's [m], and shorter than one's in millimetres.
_LONG_BASELINE = 5.0
# Share by which focal lengths of devices of one kind differ.
_SAME_FOCAL_LENGTH = 0.05
_MAX_SPACING, _MAX_WINDOW, _MAX_BESIDE = 64, 63, 8192


@lru_cache(maxsize=1024)  # once for each
def _warn_of_focal_length(fx: float, native_fx: float) -> None:
    """Warn of a camera whose disparities differ from the device's."""
    if abs(fx / native_fx - 1.0) > _SAME_FOCAL_LENGTH:
        warn_user(
            f"the device's camera has fx={native_fx:g} px, and this one fx={fx:g} px: noise, edges and the invalid "
            "band are in pixels, so they are not the device's; render with sensor.camera(), or make the profile for "
            "images of this size",
            UserWarning,
        )


def check_baseline(baseline: object) -> None:
    """Check a distance between the eyes of a depth camera [m], and warn of one that is longer than any device's.

    Raises:
        ArrayError: If it is not a number above 0.
    """
    length = check_number(baseline, "baseline", least=0.0)
    if length == 0.0:
        raise ArrayError("baseline must be above 0 m, the distance between a sensor's two eyes")
    if length >= _LONG_BASELINE:
        warn_user(
            f"a baseline of {length:g} m is that of no depth camera: is it in millimetres, {length / 1000:g} m?",
            UserWarning,
        )


@dataclass(frozen=True)
class StereoDepth(Device):
    """A depth camera that measures disparities between its imager and another eye: an imager or a projector.

    The other eye is the camera moved along its x axis. A pixel of depth z has the disparity d = f b / z [px]; what is
    measured of it is d + `locking` sin(2 pi d) + `sigma` n, with n a standard normal number, rounded to whole parts of
    a pixel if there is a `subpixel`; depth is f b divided by that. A pixel has no depth, for the first `Reason` of
    these that holds: nothing is there (EMPTY); its disparity is above `max_disparity` (RANGE); its point is beside the
    other eye's image (BAND), or hidden from that eye (SHADOW, by a ray to the point itself); its surroundings are of
    another depth (EDGE); too little comes back, because of the angle (GRAZING), or because the surface is dark, or by
    chance (DROPOUT); what was measured is outside of the camera's `near` and `far` (RANGE).

    By default a sensor has no noise, and sees all that both of its eyes see.
    """

    baseline: float
    """Distance between the two eyes [m]."""
    other_eye: Side = "right"
    """Where the other eye is, as the camera looks: the invalid band is then on the left, and so are shadows."""
    focal_length: float | None = None
    """Focal length of disparities [px]; the camera's `fx` by default."""
    max_disparity: float = math.inf
    """Greatest disparity that is searched [px], which makes a least depth."""
    sigma: float = 0.0
    """Standard deviation of the random part of disparities [px]."""
    noise_spacing: int = 1
    """Distance of nodes between which that part is interpolated, with the same deviation everywhere [px]: matching
    windows make it smooth over several pixels. 1 is white noise."""
    subpixel: int = 0
    """Into how many parts of a pixel disparities are rounded, such as 8 or 32; 0 for none."""
    locking: float = 0.0
    """Amplitude of the systematic error that draws disparities to whole pixels, or away from them if negative [px]."""
    shadow: bool = True
    """Whether points that the other eye does not see have no depth."""
    band: bool = True
    """Whether points beside the other eye's image have none; a projector's is often larger than the imager's."""
    fattening: int = 0
    """How far a nearer surface spreads over what is behind it [px]: half the side of a matching window. Each pixel
    within has the depth of the closest pixel whose disparity is greater by `edge_step` or more."""
    edge_window: int = 1
    """Side of the window about a pixel that is looked at for edges, odd [px]; 1 is none."""
    edge_step: float = 1.0
    """Disparities that differ by this or more are of different surfaces [px]."""
    least_support: float = 0.0
    """How much of that window has to be of the pixel's surface: the share of its row times the share of its column."""
    least_signal: float = 0.0
    """Reflectivity times the cosine of incidence up to which no pixel is found,"""
    full_signal: float = 0.0
    """and from which on every one is; between them probability rises in proportion. 0 is for sensors without."""
    dropout: float = 0.0
    """Share of pixels that are lost by chance, from 0 to 1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_baseline(self.baseline)
        check_choice(self.other_eye, "other_eye", ("right", "left"))
        if self.focal_length is not None and check_number(self.focal_length, "focal_length", least=0.0) == 0.0:
            raise ArrayError("focal_length must be above 0 px")
        if not is_number(self.max_disparity) or not self.max_disparity > 0:
            raise ArrayError(f"max_disparity must be a number of pixels above 0, got {self.max_disparity!r}")
        check_number(self.sigma, "sigma", least=0.0)
        check_number(self.locking, "locking")
        _check_at_most(check_whole(self.noise_spacing, "noise_spacing"), "noise_spacing", _MAX_SPACING)
        check_whole(self.subpixel, "subpixel", least=0)
        check_flag(self.shadow, "shadow")
        check_flag(self.band, "band")
        _check_at_most(check_whole(self.fattening, "fattening", least=0), "fattening", _MAX_WINDOW // 2)
        if check_whole(self.edge_window, "edge_window") % 2 == 0:
            raise ArrayError(f"edge_window must be odd, got {self.edge_window}")
        _check_at_most(self.edge_window, "edge_window", _MAX_WINDOW)
        check_number(self.edge_step, "edge_step", least=0.0)
        check_number(self.least_support, "least_support", least=0.0, most=1.0)
        least = check_number(self.least_signal, "least_signal", least=0.0)
        full = check_number(self.full_signal, "full_signal", least=0.0)
        if full <= least and full + least > 0:
            raise ArrayError(f"full_signal must be above least_signal, got {full:g} and {least:g}")
        check_number(self.dropout, "dropout", least=0.0, most=1.0)

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Which images of the first surface are read."""
        return super().needs if self.full_signal > 0.0 else ()

    @property
    def bytes_per_pixel(self) -> int:
        """How much room a pixel takes."""
        fattened = 8 + (12 if "normals" in self.needs else 0) + (4 if "segmentation" in self.needs else 0)
        return (12 if self.shadow else 0) + (4 if self._smooth else 0) + (fattened if self.fattening else 0)

    @property
    def _smooth(self) -> bool:
        return self.sigma > 0 and self.noise_spacing > 1

    def check(self, scene: Scene, camera: object) -> Camera:
        """Return the camera, if the model is one of it in a scene.

        Raises:
            WarpvisError: It is not.
        """
        pinhole = super().check(scene, camera)
        if self.native_camera is not None:
            _warn_of_focal_length(pinhole.fx, self.native_camera.fx)
        if self.shadow:
            self._other_camera(pinhole, 0.0)
        return pinhole

    def _scale(self, camera: Camera) -> float:
        """Return focal length times baseline [px m]."""
        return (camera.fx if self.focal_length is None else self.focal_length) * self.baseline

    def _other_camera(self, camera: Camera, clip_near: float) -> Camera:
        """Return the other eye: the camera, or one whose image has room beside it for all disparities."""
        other = dataclasses.replace(camera, near=clip_near, far=math.inf)
        if self.band:
            return other
        least = max(camera.near, self._scale(camera) / self.max_disparity)
        beside = camera.fx * self.baseline / least if least > 0 else math.inf
        if beside > _MAX_BESIDE:
            raise CameraError(
                f"band=False needs a camera whose near, or max_disparity, keeps disparities below {_MAX_BESIDE} px"
            )
        room = math.ceil(beside) + 1
        return dataclasses.replace(other, width=camera.width + 2 * room, cx=camera.cx + room)

    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons."""
        from warpvis.kernels.stereo import OtherEye, place_other_eyes

        if self.fattening:
            scale = self._scale(exposure.camera)
            exposure = fatten(exposure, reach=self.fattening, scale=scale, step=self.edge_step)
        poses, device = exposure.poses, exposure.scene.device
        other_poses = exposure.room("other poses", poses.shape, wp.transform)
        eyes = wp.empty(len(poses), dtype=OtherEye, device=device)
        side = self.baseline if self.other_eye == "right" else -self.baseline
        launch(place_other_eyes, len(poses), [poses, wp.float64(side), other_poses, eyes], device)
        model, given = self._model(exposure), self._views(exposure)
        if self.shadow:
            given.other_depth = self._look(exposure, given, eyes, other_poses)
        _, kernel, span = _kernels(device)
        written = [exposure.depth_out, exposure.reasons_out]
        launch_images(
            kernel,
            exposure.depth_out.shape,
            lambda window: [eyes, window, model, given, *written],
            device=device,
            threads=exposure.threads,
            span=span,
        )

    def _look(self, exposure: Exposure, given: StereoViews, eyes: wp.array, poses: wp.array) -> wp.array:
        """Return the depth that the other eye sees where each pixel's point is in its image."""
        shape, device = exposure.true_depth.shape, exposure.scene.device
        other = self._other_camera(exposure.camera, exposure.clip_near)
        points = exposure.room("points", shape, wp.vec2)
        kernel, _, span = _kernels(device)
        lens, added = other.device_struct(), other.cx - exposure.camera.cx
        least = self._scale(exposure.camera) / self.max_disparity
        launch_images(
            kernel,
            shape,
            lambda window: [lens, eyes, window, given, added, least, points],
            device=device,
            threads=exposure.threads,
            span=span,
        )
        return exposure.cast_at(other, poses, points)

    def _model(self, exposure: Exposure) -> StereoModel:
        """Return the numbers as kernels take them."""
        from warpvis.kernels.stereo import StereoModel

        camera, model = exposure.camera, StereoModel()
        model.disparity_scale = self._scale(camera)
        model.shift_scale = camera.fx * self.baseline * (1.0 if self.other_eye == "right" else -1.0)
        model.first_column, model.last_column = (0.0, camera.width) if self.band else (-math.inf, math.inf)
        model.near, model.far, model.most_disparity = camera.near, camera.far, self.max_disparity
        model.shadow_tolerance = _SHADOW_TOLERANCE
        model.least_support, model.window, model.edge_step = self.least_support, self.edge_window // 2, self.edge_step
        # Without a signal that counts, a cosine of 1 is enough.
        counts = self.full_signal > 0.0
        model.least_signal = self.least_signal if counts else 0.0
        model.signal_slope = 1.0 / (self.full_signal - self.least_signal) if counts else 1.0
        model.kept = 1.0 - self.dropout
        model.sigma, model.locking, model.levels = self.sigma, self.locking, self.subpixel
        model.seed, model.spacing = exposure.seed, self.noise_spacing
        return model

    def _views(self, exposure: Exposure) -> StereoViews:
        """Return what is read of every view, but for what the other eye sees."""
        from warpvis.kernels.stereo import StereoViews

        given = StereoViews()
        given.true_depth, given.draws = exposure.true_depth, exposure.draws
        given.column_slopes, given.row_slopes = _slopes(exposure.camera, exposure.scene.device)
        if exposure.normals is not None:
            given.normals = exposure.normals
        if exposure.segmentation is not None:
            given.segmentation = exposure.segmentation
            given.reflectivity = self.reflectivity_of_objects(exposure)
        if self._smooth:
            self._draw_nodes(exposure, given)
        return given

    def _draw_nodes(self, exposure: Exposure, given: StereoViews) -> None:
        """Draw noise at nodes of every view, and say how much of two nodes a pixel between them takes."""
        views, height, width = exposure.true_depth.shape
        device, spacing = exposure.scene.device, self.noise_spacing
        shape = (views, (height - 1) // spacing + 2, (width - 1) // spacing + 2)
        given.nodes = nodes = exposure.room("nodes", shape, wp.float32)
        kernel, span = drawing_kernel(device)
        drawn: list[Any] = [exposure.draws, wp.uint32(exposure.seed), wp.uint32(STREAM_DISPARITY), nodes]
        launch_images(
            kernel, shape, lambda window: [window, *drawn], device=device, threads=exposure.threads, span=span
        )
        angles = np.arange(spacing) / spacing * (math.pi / 2)
        weights = np.stack([np.cos(angles), np.sin(angles)], axis=-1).astype(np.float32)
        of_columns = weights[np.arange(width) % spacing].T.copy()
        columns = np.arange(width, dtype=np.int32) // spacing
        given.weights = wp.array(weights, dtype=wp.vec2, device=device)
        given.column_nodes = wp.array(columns, dtype=wp.int32, device=device)
        given.left_weights, given.right_weights = (
            wp.array(side, dtype=wp.float32, device=device) for side in of_columns
        )


def _kernels(device: wp.Device) -> tuple[wp.Kernel, wp.Kernel, int]:
    """Return what finds points in the other eye, and the model, on a device; and how many pixels a thread takes."""
    if device.is_cpu:
        from warpvis.kernels.stereo_rows import measure_stereo_rows, place_rows_in_other_eyes

        return place_rows_in_other_eyes, measure_stereo_rows, WHOLE_ROW
    from warpvis.kernels.stereo import measure_stereo, place_in_other_eyes

    return place_in_other_eyes, measure_stereo, 1


def _slopes(camera: Camera, device: wp.Device) -> tuple[wp.array, wp.array]:
    """Return x of the rays of columns and y of the rays of rows, where z is 1."""
    across = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
    down = (np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
    return tuple(wp.array(slopes.astype(np.float32), dtype=wp.float32, device=device) for slopes in (across, down))


def _check_at_most(value: int, name: str, most: int) -> None:
    if value > most:
        raise ArrayError(f"{name} must be at most {most} px, got {value}")
