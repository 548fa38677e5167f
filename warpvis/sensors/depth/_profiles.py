# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras that one can buy, as `StereoDepth` with the camera that each has.

Geometry (baseline, field of view, disparities) is the makers'. Noise is what has been measured or published for the
device, or for its kind, as each docstring says; `dataclasses.replace` gives a profile other numbers.
"""

from __future__ import annotations

import math

from warpvis.core.camera import Camera, check_size
from warpvis.sensors.depth._stereo import StereoDepth

# Intel's depth processor searches 126 disparities and rounds them to 1/32 px ("Best-Known-Methods for Tuning Intel
# RealSense D400 Depth Cameras for Best Performance"; 126 gives the least depths of the data sheet: 0.45 m of a D415 of
# 1280x720 pixels, 0.17 m of a D435 of 848x480).
_D400_DISPARITIES, _D400_STEPS = 126.0, 32
# Its RMS of disparities is below 0.1 px where there is texture or the projector's, by the same paper.
_D400_SIGMA, _D400_SPACING = 0.08, 4
# No source: pixels are found for sure up to 60 degrees of incidence, and not at all beyond 85.
_MIN_SIGNAL, _FULL_SIGNAL = math.cos(math.radians(85.0)), math.cos(math.radians(60.0))


def realsense_d415(width: int = 1280, height: int = 720) -> StereoDepth:
    """Make an Intel RealSense D415: active stereo of 55 mm, 65 degrees wide, 0.45 to 10 m at 1280x720.

    Baseline and field of view: Intel's data sheet of the D400 series. With fewer pixels, disparities are smaller: the
    least depth comes nearer, and noise grows, as on the device.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _realsense(width, height, hfov=65.0, baseline=0.055)


def realsense_d435(width: int = 848, height: int = 480) -> StereoDepth:
    """Make an Intel RealSense D435 or D435i: active stereo of 50 mm, 90 degrees wide, 0.17 to 10 m at 848x480.

    Baseline: Intel's data sheet of the D400 series. The focal length of 424 px at 848 pixels is that of 90 degrees, as
    rotors_simulator has it; SAPIEN's calibrated device has 430.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _realsense(width, height, hfov=90.0, baseline=0.05)


def realsense_d455(width: int = 848, height: int = 480) -> StereoDepth:
    """Make an Intel RealSense D455: active stereo of 95 mm, 87 degrees wide, 0.34 to 10 m at 848x480.

    Baseline and field of view: Intel's data sheet of the D400 series.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _realsense(width, height, hfov=87.0, baseline=0.095)


def oak_d(width: int = 1280, height: int = 800) -> StereoDepth:
    """Make a Luxonis OAK-D Pro: active stereo of 75 mm, 805 px of focal length at 1280x800, 0.64 to 12 m.

    Focal length, baseline, 95 disparities, range and 0.2 px of noise, smooth over 2 px, are those of a profile that its
    users give NVIDIA's simulator; with 3 bits of sub-pixels, Luxonis' default.

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
        least_support=0.6,
        least_signal=_MIN_SIGNAL,
        full_signal=_FULL_SIGNAL,
        native_camera=_camera(width, height, focal, focal * baseline / disparities, 12.0),
    )


def kinect_v1(width: int = 640, height: int = 480) -> StereoDepth:
    """Make a Microsoft Kinect of 2010: structured light, 75 mm, 580 px of focal length at 640x480, 0.5 to 5 m.

    Disparities are rounded to 1/8 px, of which half a step is the whole of the noise, as Khoshelham and Elberink
    ("Accuracy and Resolution of Kinect Depth Data", Sensors 12(2), 2012) found: 0.05 px of it are random. What is at
    edges is lost by the windows of 9 pixels that Handa's simulation ("A Benchmark for RGB-D Visual Odometry", ICRA
    2014) looks at. The projector lights more than the image, so that there is no band. The device measures at 640x480,
    and images of other sizes are taken to be that one's with fewer pixels: windows shrink with them, disparities do
    not.

    Args:
        width: Image width [px].
        height: Image height [px].
    """
    return _structured_light(_camera(width, height, _scaled(580.0, 640, width), 0.5, 5.0), 0.075, 580.0)


def structure(width: int = 640, height: int = 480) -> StereoDepth:
    """Make an Occipital Structure Sensor: structured light, 65 mm, 58 degrees wide, 0.4 to 3.5 m.

    Field of view and range: the maker's. The baseline is what is said of the device, and not confirmed; noise is taken
    to be a Kinect's, whose chip it has.

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
        least_support=0.6,
        least_signal=_MIN_SIGNAL,
        full_signal=_FULL_SIGNAL,
        native_camera=_camera(width, height, focal, focal * baseline / _D400_DISPARITIES, 10.0),
    )


def _structured_light(camera: Camera, baseline: float, focal_length: float) -> StereoDepth:
    """Make a device that measures at 640x480; images of other sizes are that one's with fewer or more pixels."""
    share = camera.width / 640
    return StereoDepth(
        baseline,
        focal_length=focal_length,
        sigma=0.05,
        noise_spacing=max(1, round(3 * share)),
        subpixel=8,
        band=False,
        edge_window=2 * round(4 * share) + 1,
        least_support=1 / 1.2,
        least_signal=_MIN_SIGNAL,
        full_signal=_FULL_SIGNAL,
        native_camera=camera,
    )


def _focal(width: int, hfov: float) -> float:
    """Return the focal length [px] of a field of view [deg]."""
    return check_size(width, "width") / (2 * math.tan(math.radians(hfov) / 2))


def _scaled(focal: float, of_width: int, width: int) -> float:
    """Return the focal length [px] of images of another width."""
    return focal * check_size(width, "width") / of_width


def _camera(width: int, height: int, focal: float, near: float, far: float) -> Camera:
    middle = check_size(width, "width") / 2, check_size(height, "height") / 2
    return Camera(width, height, focal, focal, *middle, near, far)
