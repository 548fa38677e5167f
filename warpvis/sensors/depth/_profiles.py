# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Commercial depth cameras as `StereoDepth` and `TimeOfFlight`, with their native cameras, also by name.

Geometry (baseline, image size, field of view, disparities) and ranges are from the manufacturers. Noise has been
specified, measured or published for the device or for similar devices, without ambient light; see the docstrings. Use
`dataclasses.replace` to change parameters of a profile. The width and height of images are in pixels.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Callable, Sequence
from functools import partial

from warpvis.cameras.pinhole import Camera, check_size
from warpvis.core.checks import check_choice, check_text, truncate
from warpvis.errors import CameraError
from warpvis.rendering import DepthSensor
from warpvis.sensors.depth._stereo import StereoDepth
from warpvis.sensors.depth._time_of_flight import SPEED_OF_LIGHT, TimeOfFlight

# Intel's depth processor searches 126 disparities and rounds them to 1/32 px ("Best-Known-Methods for Tuning Intel
# RealSense D400 Depth Cameras for Best Performance"; 126 yields the minimum depths of the data sheet: 0.45 m for a D415
# at 1280x720, 0.17 m for a D435 at 848x480).
_D400_DISPARITIES, _D400_STEPS = 126.0, 32
# The RMS error of disparity is below 0.1 px on textured or illuminated surfaces, according to the same paper.
_D400_SIGMA, _D400_SPACING = 0.08, 4
# The R200, the predecessor, sums matching costs over 7x7 pixels (Keselman, Woodfill, Grunnet-Jepsen and Bhowmik, "Intel
# RealSense Stereoscopic Depth Cameras", 2017, arXiv 1705.05548); the window of the D400 is not published. Surfaces
# spread by half of it. Nodes 4 px apart give the random numbers of holes the correlation of sums over it: 0.5 at 3 px,
# and 0 from 7 px on.
_D400_FATTENING, _D400_HOLE_SPACING = 3, 4
# With this window, surfaces whose disparity changes by 1 px or more per pixel are lost: the limit of human stereopsis
# (Burt and Julesz, "A Disparity Gradient Limit for Binocular Fusion", Science 208, 1980) and of matchers (Pollard,
# Mayhew and Frisby, "PMF: A Stereo Correspondence Algorithm Using a Disparity Gradient Limit", Perception 14, 1985).
_EDGE_WINDOW, _MIN_SUPPORT = 5, 0.6
# The D400 matches local differences of brightness below 5 % (Sweetser and Grunnet-Jepsen, "Optical Filters for Intel
# RealSense Depth Cameras D400"). The pattern on a white surface has 5 % of its contrast at 87 degrees. In recordings,
# tables and floors lose 0.1 % of their pixels at 60 to 80 degrees (docs/sensors/depth_cameras.md).
_D400_FULL_SIGNAL = 0.05
# No source: all pixels are found up to an angle of incidence of 60 degrees, and none beyond 85 degrees.
_MIN_SIGNAL, _FULL_SIGNAL = math.cos(math.radians(85.0)), math.cos(math.radians(60.0))
# Width, height [px], horizontal and vertical field of view [deg], minimum and maximum depth [m].
_AZURE_MODES = {
    "nfov": (640, 576, 75.0, 65.0, 0.5, 3.86),
    "nfov_binned": (320, 288, 75.0, 65.0, 0.5, 5.46),
    "wfov": (1024, 1024, 120.0, 120.0, 0.25, 2.21),
    "wfov_binned": (512, 512, 120.0, 120.0, 0.25, 2.88),
}
_AZURE_SIGMA, _AZURE_DARKEST = 0.017, 0.15
_CONTRAST = 0.7
# No source: pixels with a coherence below this are treated as flying pixels.
_MIN_COHERENCE = 0.9


def realsense_d415(width: int = 1280, height: int = 720) -> StereoDepth:
    """Return an Intel RealSense D415: active stereo with a baseline of 55 mm, 65 degrees, 0.45 to 10 m at 1280x720.

    Baseline and field of view: Intel's data sheet of the D400 series. With fewer pixels, disparities are smaller: the
    minimum depth decreases and noise increases, as on the device.
    """
    return _realsense(width, height, hfov=65.0, baseline=0.055)


def realsense_d435(width: int = 848, height: int = 480) -> StereoDepth:
    """Return an Intel RealSense D435 or D435i: active stereo, baseline 50 mm, 90 degrees, 0.17 to 10 m at 848x480.

    Baseline: Intel's data sheet of the D400 series. The focal length at a width of 848 px is 424 px, that of 90
    degrees, as in rotors_simulator; SAPIEN's calibrated device has 430 px.
    """
    return _realsense(width, height, hfov=90.0, baseline=0.05)


def realsense_d455(width: int = 848, height: int = 480) -> StereoDepth:
    """Return an Intel RealSense D455: active stereo with a baseline of 95 mm, 87 degrees, 0.34 to 10 m at 848x480.

    Baseline and field of view: Intel's data sheet of the D400 series.
    """
    return _realsense(width, height, hfov=87.0, baseline=0.095)


def realsense_d457(width: int = 848, height: int = 480) -> StereoDepth:
    """Return a RealSense D457: a D455 with a GMSL connector, with the same depth module, D450, and the same depth.

    Its page on realsenseai.com specifies 87 by 58 degrees, and 0.52 m as the minimum depth at 1280x720.
    """
    return realsense_d455(width, height)


def realsense_d405(width: int = 848, height: int = 480) -> StereoDepth:
    """Return a RealSense D405: stereo for short ranges, baseline 18 mm, 84 degrees, 0.07 to 10 m at 848x480.

    Baseline: ``_d405.urdf.xacro`` of realsense-ros at 1cbd81be. Field of view: Intel's comparison of cameras. The
    minimum depths of the data sheet, 0.1 m at 1280x720 and 0.07 m at 848x480, are those of 126 disparities to within
    5 %. The specified range ends at 0.5 m. The device has no projector: surfaces need texture, which is not modeled.
    """
    return _realsense(width, height, hfov=84.0, baseline=0.018)


def gemini_335(width: int = 1280, height: int = 800) -> StereoDepth:
    """Return an Orbbec Gemini 335: active stereo with a baseline of 50 mm, 90 degrees, 0.17 to 20 m at 1280x800.

    Baseline: ``gemini_335_336.urdf.xacro`` of OrbbecSDK_ROS2 at a7ccc5c4. Field of view (90 by 65 degrees) and range:
    data sheet, as in CostNav (``depth_sensors_specifications.md`` at 00c5f03b), specified for 0.25 to 6 m. Noise and
    edges are not published; those of a RealSense are used.
    """
    focal, baseline = _focal(width, 90.0), 0.05
    disparities = _focal(1280, 90.0) * baseline / 0.17
    sensor = _realsense(width, height, hfov=90.0, baseline=baseline)
    camera = _camera(width, height, focal, focal * baseline / disparities, 20.0)
    return dataclasses.replace(sensor, max_disparity=disparities, native_camera=camera)


def zed_2i(width: int = 1280, height: int = 720) -> StereoDepth:
    """Return a Stereolabs ZED 2i with lenses of 2.1 mm: stereo, baseline 120 mm, focal length 533 px, 0.3 to 20 m.

    Focal length: one calibrated device at 1280x720 (``zed2i`` of snail-radar/dataset_tools at 08ecfe1). Baseline:
    zed-ros2-description at feb4806. Range: Stereolabs' documentation of depth settings. The noise, 0.1 px with a
    correlation length of 4 px, has no source. The required signal is that of Intel's D400. The device has no projector:
    surfaces need texture, which is not modeled.
    """
    focal, baseline = _scaled(533.0, 1280, width), 0.12
    disparities = 533.0 * baseline / 0.3
    return StereoDepth(
        baseline,
        max_disparity=disparities,
        sigma=0.1,
        noise_spacing=4,
        edge_window=_EDGE_WINDOW,
        min_support=_MIN_SUPPORT,
        full_signal=_D400_FULL_SIGNAL,
        native_camera=_camera(width, height, focal, focal * baseline / disparities, 20.0),
    )


def oak_d(width: int = 1280, height: int = 800) -> StereoDepth:
    """Return a Luxonis OAK-D Pro: active stereo, baseline 75 mm, focal length 805 px at 1280x800, 0.64 to 12 m.

    Focal length, baseline, 95 disparities, range, and noise of 0.2 px with a correlation length of 2 px are from a
    user's profile for NVIDIA's simulator. Disparities have 3 fractional bits, Luxonis' default. The required signal is
    that of Intel's D400.
    """
    focal, baseline, disparities = _scaled(805.0, 1280, width), 0.075, 95.0
    return StereoDepth(
        baseline,
        max_disparity=disparities,
        sigma=0.2,
        noise_spacing=2,
        subpixel=8,
        edge_window=_EDGE_WINDOW,
        min_support=_MIN_SUPPORT,
        full_signal=_D400_FULL_SIGNAL,
        native_camera=_camera(width, height, focal, focal * baseline / disparities, 12.0),
    )


def kinect_v1(width: int = 640, height: int = 480) -> StereoDepth:
    """Return a Microsoft Kinect of 2010: structured light, 75 mm, focal length 580 px at 640x480, 0.5 to 5 m.

    Disparities are rounded to 1/8 px. The standard deviation is half a step, including rounding (Khoshelham and
    Elberink, "Accuracy and Resolution of Kinect Depth Data", Sensors 12(2), 2012); the random part is 0.05 px.
    Pixels at edges are lost according to windows of 9 pixels, as in Handa's simulation ("A Benchmark for RGB-D
    Visual Odometry", ICRA 2014), and holes are correlated like such windows. There is no invalid band, because the
    projector illuminates more than the image. The device measures at 640x480. Images of other sizes are treated as
    resampled: windows scale with the width, disparities do not.
    """
    return _structured_light(_camera(width, height, _scaled(580.0, 640, width), 0.5, 5.0), 0.075, 580.0)


def structure(width: int = 640, height: int = 480) -> StereoDepth:
    """Return an Occipital Structure Sensor: structured light, baseline 65 mm, 58 degrees, 0.4 to 3.5 m.

    Field of view and range are from the manufacturer. The baseline is unconfirmed. Noise is that of a Kinect, which has
    the same chip.
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
        fattening=_D400_FATTENING,
        edge_window=_EDGE_WINDOW,
        min_support=_MIN_SUPPORT,
        full_signal=_D400_FULL_SIGNAL,
        hole_spacing=_D400_HOLE_SPACING,
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
        hole_spacing=max(1, round(5 * scale)),
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


def azure_kinect(mode: str = "nfov") -> TimeOfFlight:
    """Return a Microsoft Azure Kinect, in a mode of its data sheet: ``"nfov"`` has 640x576 pixels and 0.5 to 3.86 m.

    At the maximum range of a mode, the standard deviation is the specified 17 mm for a surface with a reflectivity of
    15 %, the minimum of the specification, at normal incidence; it is 6.6 mm for a white surface. Tolgyessy, Dekan,
    Chovanec and Hubinsky ("Evaluation of the Azure Kinect and Its Comparison to Kinect V1 and Kinect V2", Sensors
    21(2):413, 2021) confirm the specification: at most 17 mm of random error, less than 11 mm + 0.1 % of systematic
    error. The model of the systematic error is a wiggle of 5.5 mm, because its composition is not published. The
    frequencies are not published either; the two used here are unambiguous up to 7.5 m. The native camera is a pinhole
    camera with the fields of view of the data sheet, without lens distortion; a calibrated camera may be used instead.

    Args:
        mode: ``"nfov"`` or ``"wfov"``, narrow and wide fields of view; ``"nfov_binned"`` and ``"wfov_binned"`` have
            half the width and height, and a longer range.
    """
    width, height, hfov, vfov, near, far = _AZURE_MODES[check_choice(mode, "mode", tuple(_AZURE_MODES))]
    white = _AZURE_SIGMA * math.sqrt(_AZURE_DARKEST) / far  # standard deviation at 1 m [m]
    return _profile(
        (200e6, 180e6),
        white,
        (width, height, hfov, vfov, near, far),
        min_signal=_AZURE_DARKEST / far**2 * math.cos(math.radians(80.0)),
        wiggle=0.0055,
    )


def femto_bolt(mode: str = "nfov") -> TimeOfFlight:
    """Return an Orbbec Femto Bolt: an `azure_kinect` with its modes, fields of view and ranges.

    Orbbec specifies them, the random error of 17 mm and the systematic error of 11 mm + 0.1 % as Microsoft does
    (orbbec.com, "Comparison with Azure Kinect DK").
    """
    return azure_kinect(mode)


def realsense_l515() -> TimeOfFlight:
    """Return an Intel RealSense L515: a scanning laser, 1024x768 pixels, 70 by 55 degrees, 0.25 to 9 m.

    Intel's comparison of cameras specifies pixels, field of view, range, and an error of 5 mm to 14 mm from 1 to 9 m:
    here a standard deviation of 14 mm at 9 m for a white surface at normal incidence, and a wiggle of 5 mm. The device
    measures with a coded beam. The two frequencies, unambiguous up to 15 m, and the mixing at edges stand for it, and
    have no source.
    """
    camera = (1024, 768, 70.0, 55.0, 0.25, 9.0)
    dimmest = math.cos(math.radians(80.0)) / 9.0**2
    return _profile((100e6, 90e6), 0.014 / 9.0, camera, min_signal=dimmest, wiggle=0.005)


def kinect_v2() -> TimeOfFlight:
    """Return a Microsoft Kinect of 2013, for Xbox One: 512x424 pixels, 70.6 by 60 degrees, 0.5 to 4.5 m.

    The frequencies are from libfreenect2: 120, 80 and 16 MHz, unambiguous up to 18.7 m. The noise, 1.5 mm for a white
    surface at 1 m at normal incidence, has no source.
    """
    camera = (512, 424, 70.6, 60.0, 0.5, 4.5)
    return _profile((120e6, 80e6, 16e6), 0.0015, camera, min_signal=0.0015, wiggle=0.005)


def pmd_flexx2() -> TimeOfFlight:
    """Return a PMD flexx2: 224x172 pixels, 56 by 44 degrees, 0.1 to 7 m.

    Noise and frequencies have no source: 0.5 % of the range for a white surface at normal incidence, and 80 and 60 MHz,
    unambiguous up to 7.5 m.
    """
    return _profile((80e6, 60e6), 0.005, (224, 172, 56.0, 44.0, 0.1, 7.0), min_signal=0.002, wiggle=0.003)


def _profile(
    frequencies: Sequence[float],
    sigma: float,
    camera: tuple[int, int, float, float, float, float],
    *,
    min_signal: float,
    wiggle: float,
) -> TimeOfFlight:
    """Return a sensor whose standard deviation for a white surface at 1 m at normal incidence is `sigma` [m]."""
    width, height, hfov, vfov, near, far = camera
    fx, fy = (size / (2 * math.tan(math.radians(fov) / 2)) for size, fov in ((width, hfov), (height, vfov)))
    electrons = (SPEED_OF_LIGHT / (4 * math.sqrt(2) * math.pi * frequencies[0] * _CONTRAST * sigma)) ** 2
    return TimeOfFlight(
        frequencies,
        signal=electrons,
        contrast=_CONTRAST,
        wiggle=wiggle,
        min_coherence=_MIN_COHERENCE,
        min_signal=min_signal,
        native_camera=Camera(width, height, fx, fy, width / 2, height / 2, near, far),
    )


_VARIABLE_SIZE: dict[str, Callable[[int, int], DepthSensor]] = {
    "d405": realsense_d405,
    "d415": realsense_d415,
    "d435": realsense_d435,
    "d455": realsense_d455,
    "d457": realsense_d457,
    "gemini-335": gemini_335,
    "zed-2i": zed_2i,
    "oak-d": oak_d,
    "kinect-v1": kinect_v1,
    "structure": structure,
}
_AZURE_NAMES = {"": "nfov", "-binned": "nfov_binned", "-wide": "wfov", "-wide-binned": "wfov_binned"}
_FIXED_SIZE: dict[str, Callable[[], DepthSensor]] = {
    **{f"azure-kinect{suffix}": partial(azure_kinect, mode) for suffix, mode in _AZURE_NAMES.items()},
    **{f"femto-bolt{suffix}": partial(femto_bolt, mode) for suffix, mode in _AZURE_NAMES.items()},
    "l515": realsense_l515,
    "kinect-v2": kinect_v2,
    "flexx2": pmd_flexx2,
}
SENSOR_NAMES = (*_VARIABLE_SIZE, *_FIXED_SIZE)
"""Names of all depth cameras."""


def sensor_by_name(text: str) -> DepthSensor:
    """Create the model of a commercial depth camera from its name.

    Args:
        text: d405, d415, d435, d455, d457, gemini-335, zed-2i, oak-d, kinect-v1 or structure, optionally with a size,
            ``"d435@424x240"``; azure-kinect or femto-bolt, also with -binned, -wide or -wide-binned; l515, kinect-v2 or
            flexx2. Names of functions such as ``"realsense_d435"`` are accepted as well.

    Raises:
        CameraError: If the name is unknown, or if the camera does not have this size. The message suggests similar
            names.
    """
    name, separator, size = check_text(text, "sensor", CameraError).partition("@")
    key = name.strip().lower().replace("_", "-").removeprefix("realsense-").removeprefix("pmd-")
    if key not in SENSOR_NAMES:
        words = dict.fromkeys([key, key.rsplit("-", 1)[-1]])  # also without the manufacturer's name
        matches = [match for word in words for match in difflib.get_close_matches(word, SENSOR_NAMES, n=3, cutoff=0.5)]
        similar = list(dict.fromkeys(matches))
        hint = f"did you mean {' or '.join(similar)}?" if similar else f"there are {', '.join(SENSOR_NAMES)}"
        raise CameraError(f"there is no sensor {truncate(repr(name))}; {hint}")
    if not separator:
        return _VARIABLE_SIZE[key]() if key in _VARIABLE_SIZE else _FIXED_SIZE[key]()  # type: ignore[call-arg]
    pixels = re.fullmatch(r"([1-9][0-9]{0,4})x([1-9][0-9]{0,4})", size, re.ASCII)
    if key not in _VARIABLE_SIZE or pixels is None:
        hint = "a size must be given as in d435@424x240" if key in _VARIABLE_SIZE else f"{key} has a fixed size"
        raise CameraError(f"there is no sensor {truncate(repr(text))}: {hint}")
    return _VARIABLE_SIZE[key](int(pixels[1]), int(pixels[2]))
