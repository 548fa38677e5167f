# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commercial depth cameras as `StereoDepth`, with their native cameras.

Geometry (baseline, field of view, disparities) is from the manufacturers. Noise has been measured or published for the
device or for similar devices; see the docstrings. Use `dataclasses.replace` to change parameters of a profile.
"""

from __future__ import annotations

import math

from warpvis.cameras.pinhole import Camera, check_size
from warpvis.sensors.depth._stereo import StereoDepth

# Intel's depth processor searches 126 disparities and rounds them to 1/32 px ("Best-Known-Methods for Tuning Intel
# RealSense D400 Depth Cameras for Best Performance"; 126 yields the minimum depths of the data sheet: 0.45 m for a D415
# at 1280x720, 0.17 m for a D435 at 848x480).
_D400_DISPARITIES, _D400_STEPS = 126.0, 32
# The RMS error of disparity is below 0.1 px on textured or illuminated surfaces, according to the same paper.
_D400_SIGMA, _D400_SPACING = 0.08, 4
# No source: all pixels are found up to an angle of incidence of 60 degrees, and none beyond 85 degrees.
_MIN_SIGNAL, _FULL_SIGNAL = math.cos(math.radians(85.0)), math.cos(math.radians(60.0))


def realsense_d415(width: int = 1280, height: int = 720) -> StereoDepth:
    """Return an Intel RealSense D415: active stereo with a baseline of 55 mm, 65 degrees, 0.45 to 10 m at 1280x720.

    Baseline and field of view: Intel's data sheet of the D400 series. With fewer pixels, disparities are smaller: the
    minimum depth decreases and noise increases, as on the device.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _realsense(width, height, hfov=65.0, baseline=0.055)


def realsense_d435(width: int = 848, height: int = 480) -> StereoDepth:
    """Return an Intel RealSense D435 or D435i: active stereo, baseline 50 mm, 90 degrees, 0.17 to 10 m at 848x480.

    Baseline: Intel's data sheet of the D400 series. The focal length at a width of 848 px is 424 px, that of 90
    degrees, as in rotors_simulator; SAPIEN's calibrated device has 430 px.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _realsense(width, height, hfov=90.0, baseline=0.05)


def realsense_d455(width: int = 848, height: int = 480) -> StereoDepth:
    """Return an Intel RealSense D455: active stereo with a baseline of 95 mm, 87 degrees, 0.34 to 10 m at 848x480.

    Baseline and field of view: Intel's data sheet of the D400 series.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _realsense(width, height, hfov=87.0, baseline=0.095)


def oak_d(width: int = 1280, height: int = 800) -> StereoDepth:
    """Return a Luxonis OAK-D Pro: active stereo, baseline 75 mm, focal length 805 px at 1280x800, 0.64 to 12 m.

    Focal length, baseline, 95 disparities, range, and noise of 0.2 px with a correlation length of 2 px are from a
    user's profile for NVIDIA's simulator. Disparities have 3 fractional bits, Luxonis' default.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    focal, baseline, disparities = _scaled(805.0, 1280, width), 0.075, 95.0
    return StereoDepth(
        baseline,
        max_disparity=disparities,
        sigma=0.2,
        noise_spacing=2,
        subpixel=8,
        edge_window=5,
        min_support=0.6,
        min_signal=_MIN_SIGNAL,
        full_signal=_FULL_SIGNAL,
        native_camera=_camera(width, height, focal, focal * baseline / disparities, 12.0),
    )


def kinect_v1(width: int = 640, height: int = 480) -> StereoDepth:
    """Return a Microsoft Kinect of 2010: structured light, 75 mm, focal length 580 px at 640x480, 0.5 to 5 m.

    Disparities are rounded to 1/8 px. The standard deviation is half a step, including rounding (Khoshelham and
    Elberink, "Accuracy and Resolution of Kinect Depth Data", Sensors 12(2), 2012); the random part is 0.05 px. Pixels
    at edges are lost according to windows of 9 pixels, as in Handa's simulation ("A Benchmark for RGB-D Visual
    Odometry", ICRA 2014). There is no invalid band, because the projector illuminates more than the image. The device
    measures at 640x480. Images of other sizes are treated as resampled: windows scale with the width, disparities do
    not.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _structured_light(_camera(width, height, _scaled(580.0, 640, width), 0.5, 5.0), 0.075, 580.0)


def structure(width: int = 640, height: int = 480) -> StereoDepth:
    """Return an Occipital Structure Sensor: structured light, baseline 65 mm, 58 degrees, 0.4 to 3.5 m.

    Field of view and range are from the manufacturer. The baseline is unconfirmed. Noise is that of a Kinect, which has
    the same chip.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _structured_light(_camera(width, height, _focal(width, 58.0), 0.4, 3.5), 0.065, _focal(640, 58.0))


def _realsense(width: int, height: int, *, hfov: float, baseline: float) -> StereoDepth:
    focal = _focal(width, hfov)
    return StereoDepth(
        baseline,
        max_disparity=_D400_DISPARITIES,
        sigma=_D400_SIGMA,
        noise_spacing=_D400_SPACING,
        subpixel=_D400_STEPS,
        edge_window=5,
        min_support=0.6,
        min_signal=_MIN_SIGNAL,
        full_signal=_FULL_SIGNAL,
        native_camera=_camera(width, height, focal, focal * baseline / _D400_DISPARITIES, 10.0),
    )


def _structured_light(camera: Camera, baseline: float, focal_length: float) -> StereoDepth:
    """Return a device that measures at 640x480; images of other sizes are treated as resampled."""
    scale = camera.width / 640
    return StereoDepth(
        baseline,
        focal_length=focal_length,
        sigma=0.05,
        noise_spacing=max(1, round(3 * scale)),
        subpixel=8,
        band=False,
        edge_window=2 * round(4 * scale) + 1,
        min_support=1 / 1.2,
        min_signal=_MIN_SIGNAL,
        full_signal=_FULL_SIGNAL,
        native_camera=camera,
    )


def _focal(width: int, hfov: float) -> float:
    """Return the focal length [px] for a horizontal field of view [deg]."""
    return check_size(width, "width") / (2 * math.tan(math.radians(hfov) / 2))


def _scaled(focal: float, of_width: int, width: int) -> float:
    """Return the focal length for images of another width [px]."""
    return focal * check_size(width, "width") / of_width


def _camera(width: int, height: int, focal: float, near: float, far: float) -> Camera:
    center = check_size(width, "width") / 2, check_size(height, "height") / 2
    return Camera(width, height, focal, focal, *center, near, far)
