# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noise models of the Kinect from two papers, for comparison with published work."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

from warpvis.core.checks import check_angle, check_flag, check_number
from warpvis.rendering import DepthSensor, Exposure, TakesLens
from warpvis.sensors.depth._base import check_positive

_STEEPEST = math.radians(89.9)


@dataclass(frozen=True)
class NguyenNoise(DepthSensor):
    """Axial and lateral noise of a Kinect as functions of distance and angle, by Nguyen, Izadi and Lovell.

    C. V. Nguyen, S. Izadi and D. Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking",
    3DIMPVT 2012. Let a be the angle between the surface normal and the optical axis, and z the depth [m]. The error of
    depth is normal with standard deviation 0.0012 + 0.0019 (z - 0.4)^2, plus 0.0001 / sqrt(z) (a / (pi / 2 - a))^2 for
    a of 60 degrees or more (equations 3 and 4). The lateral standard deviation is 0.8 + 0.035 a / (pi / 2 - a) px
    (equation 2): the center of each pixel is shifted along both axes, and the pixel measures the plane of the surface
    at the shifted position. Edges become ragged, but a plane stays a plane, with the axial deviation of the paper.
    Positions outside of the image are clamped to the nearest pixel.

    The measurements of the paper range from 0.4 to 3 m. Surfaces at more than `max_angle` are lost (GRAZING).
    """

    min_axial: float = 0.0012
    """Minimum axial standard deviation [m]."""
    axial_growth: float = 0.0019
    """Quadratic coefficient of the axial standard deviation [1/m]."""
    best_depth: float = 0.4
    """Depth of the minimum axial standard deviation [m]."""
    grazing_axial: float = 0.0001
    """Coefficient of the term added from `grazing_angle` on: its value at 45 degrees and 1 m [m]."""
    grazing_angle: float = math.radians(60.0)
    """Angle from which that term is added [rad]."""
    lateral: float = 0.8
    """Lateral standard deviation at normal incidence [px]."""
    lateral_growth: float = 0.035
    """Coefficient of the growth with the angle: the added deviation at 45 degrees [px]."""
    max_angle: float = math.radians(85.0)
    """Maximum angle at which a surface is measured [rad]; the formulas diverge at 90 degrees. Not from the paper."""

    def __post_init__(self) -> None:
        for name in ("min_axial", "axial_growth", "best_depth", "grazing_axial", "lateral", "lateral_growth"):
            check_number(getattr(self, name), name, minimum=0.0)
        check_angle(self.grazing_angle, "grazing_angle", minimum=0.0, maximum=math.pi / 2)
        check_angle(self.max_angle, "max_angle", minimum=0.0, maximum=_STEEPEST)

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Exact images that are read."""
        return ("normals",)

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.kinect_noise import NguyenModel, measure_nguyen

        model = NguyenModel()
        for name in self.__dataclass_fields__:
            setattr(model, name, getattr(self, name))
        model.seed = exposure.seed
        inputs = model, exposure.true_depth, exposure.normals, exposure.draws
        cameras = exposure.camera.device_struct(), exposure.poses
        exposure.launch(measure_nguyen, *inputs, exposure.depth_out, exposure.reasons_out, cameras=cameras, rows=True)


@dataclass(frozen=True)
class KhoshelhamNoise(DepthSensor):
    """Random error and quantization of a Kinect's depth, by Khoshelham and Elberink.

    K. Khoshelham and S. O. Elberink, "Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications",
    Sensors 12(2), 2012. Depth z follows from integer disparities d as 1 / z = `step` d; consecutive depths differ by
    2.85e-3 z^2 m. The measured standard deviation of disparities is half a step, 1.425e-3 z^2 m. Rounding contributes
    sqrt(1/12) of a step to it; `sigma` is the rest. Errors are along the ray of the pixel: x and y of the point have
    proportional errors, as in the paper.
    """

    step: float = 2.85e-3
    """Step of disparity, as 1 / z [1/m]: m / (f b) in the paper, there in centimeters."""
    sigma: float = math.sqrt(0.25 - 1 / 12)
    """Standard deviation of disparities before rounding [steps]."""
    rounds: bool = True
    """Whether disparities are rounded to integers."""

    takes_lens: ClassVar[TakesLens] = "z"

    def __post_init__(self) -> None:
        check_positive(self.step, "step", "per meter")
        check_number(self.sigma, "sigma", minimum=0.0)
        check_flag(self.rounds, "rounds")

    def measure(self, exposure: Exposure) -> None:
        """Write the depth and reasons of the sensor."""
        from warpvis.kernels.sensors.kinect_noise import KhoshelhamModel, measure_khoshelham

        model = KhoshelhamModel()
        model.step, model.sigma, model.rounds, model.seed = self.step, self.sigma, int(self.rounds), exposure.seed
        inputs = model, exposure.true_depth, exposure.draws, exposure.depth_out, exposure.reasons_out
        exposure.launch(measure_khoshelham, *inputs, cameras=[exposure.image_range], rows=True)
