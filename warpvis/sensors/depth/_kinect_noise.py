# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Noise of a Kinect as two papers measured it, for comparison with published work."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Literal

import warp as wp

from warpvis.core.checks import check_angle, check_flag, check_number
from warpvis.core.threads import WHOLE_ROW, launch_images
from warpvis.errors import ArrayError
from warpvis.rendering import DepthSensor, Exposure, TakesLens

_STEEPEST = math.radians(89.9)


@dataclass(frozen=True)
class NguyenNoise(DepthSensor):
    """Axial and lateral noise of a Kinect by distance and angle, as Nguyen, Izadi and Lovell measured it.

    C. V. Nguyen, S. Izadi and D. Lovell, "Modeling Kinect Sensor Noise for Improved 3D Reconstruction and Tracking",
    3DIMPVT 2012. With a the angle between the surface's normal and the optical axis and z its depth, in metres, depth
    has a normal error of deviation 0.0012 + 0.0019 (z - 0.4)^2, plus 0.0001 / sqrt(z) (a / (pi / 2 - a))^2 from 60
    degrees on (equations 3 and 4). The lateral deviation is 0.8 + 0.035 a / (pi / 2 - a) px (equation 2): the pixel's
    centre is moved by so much along both axes, and the pixel shows the surface of the pixel where it comes to be, in
    that one's plane. So edges move, and a plane stays one, of which the paper's axial deviation is. At the image's
    edge it is the last pixel.

    The paper measured from 0.4 to 3 m. A surface at more than `most_angle` is lost (GRAZING).
    """

    least_axial: float = 0.0012
    """Least axial deviation [m]."""
    axial_growth: float = 0.0019
    """How it grows with the square of depth [1/m]."""
    best_depth: float = 0.4
    """Where it is least [m]."""
    grazing_axial: float = 0.0001
    """What is added from `grazing_angle` on, at 45 degrees and 1 m [m]."""
    grazing_angle: float = math.radians(60.0)
    """From which angle on [rad]."""
    lateral: float = 0.8
    """Lateral deviation of what is seen face on [px]."""
    lateral_growth: float = 0.035
    """How it grows with the angle: what is added at 45 degrees [px]."""
    most_angle: float = math.radians(85.0)
    """Greatest angle at which a surface is measured [rad]: where the formulas grow without bound; not of the paper."""

    def __post_init__(self) -> None:
        for name in ("least_axial", "axial_growth", "best_depth", "grazing_axial", "lateral", "lateral_growth"):
            check_number(getattr(self, name), name, least=0.0)
        check_angle(self.grazing_angle, "grazing_angle", least=0.0, most=math.pi / 2)
        check_angle(self.most_angle, "most_angle", least=0.0, most=_STEEPEST)

    @property
    def needs(self) -> tuple[Literal["normals", "segmentation"], ...]:
        """Which images of the first surface are read."""
        return ("normals",)

    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons."""
        from warpvis.kernels.kinect_noise import NguyenModel

        model = NguyenModel()
        for name in self.__dataclass_fields__:
            setattr(model, name, getattr(self, name))
        model.seed = exposure.seed
        camera = exposure.camera.device_struct()
        given = [model, exposure.true_depth, exposure.normals, exposure.draws]
        kernel, span = _nguyen_kernel(exposure.scene.device)
        launch_images(
            kernel,
            exposure.depth_out.shape,
            lambda window: [camera, exposure.poses, window, *given, exposure.depth_out, exposure.reasons_out],
            device=exposure.scene.device,
            threads=exposure.threads,
            span=span,
        )


@dataclass(frozen=True)
class KhoshelhamNoise(DepthSensor):
    """Random error and steps of a Kinect's depth, as Khoshelham and Elberink measured them.

    K. Khoshelham and S. O. Elberink, "Accuracy and Resolution of Kinect Depth Data for Indoor Mapping Applications",
    Sensors 12(2), 2012. Depth z follows from whole numbers of disparity d as 1 / z = `step` d: between two of them are
    2.85e-3 z^2 m. Measured disparities were found to have a deviation of half a step: 1.425e-3 z^2 m. A step's own
    rounding has sqrt(1/12) of a step of this; `sigma` is the rest. A point errs along its pixel's ray, so that its x
    and y err in proportion, as in the paper.
    """

    step: float = 2.85e-3
    """A step of disparity, as 1 / z [1/m]: m / (f b) of the paper, which has it in centimetres."""
    sigma: float = math.sqrt(0.25 - 1 / 12)
    """Deviation of disparities before they are rounded [steps]."""
    rounds: bool = True
    """Whether disparities are whole numbers."""

    takes_lens: ClassVar[TakesLens] = "z"

    def __post_init__(self) -> None:
        if check_number(self.step, "step", least=0.0) == 0.0:
            raise ArrayError("step must be above 0 per metre")
        check_number(self.sigma, "sigma", least=0.0)
        check_flag(self.rounds, "rounds")

    def measure(self, exposure: Exposure) -> None:
        """Write the sensor's depth and reasons."""
        from warpvis.kernels.kinect_noise import KhoshelhamModel

        model = KhoshelhamModel()
        model.step, model.sigma, model.rounds, model.seed = self.step, self.sigma, int(self.rounds), exposure.seed
        camera = exposure.image_range
        given = [model, exposure.true_depth, exposure.draws, exposure.depth_out, exposure.reasons_out]
        kernel, span = _khoshelham_kernel(exposure.scene.device)
        launch_images(
            kernel,
            exposure.depth_out.shape,
            lambda window: [camera, window, *given],
            device=exposure.scene.device,
            threads=exposure.threads,
            span=span,
        )


def _nguyen_kernel(device: wp.Device) -> tuple[wp.Kernel, int]:
    """Return the model's kernel on a device, and how many pixels a thread takes."""
    if device.is_cpu:
        from warpvis.kernels.noise_rows import measure_nguyen_rows

        return measure_nguyen_rows, WHOLE_ROW
    from warpvis.kernels.kinect_noise import measure_nguyen

    return measure_nguyen, 1


def _khoshelham_kernel(device: wp.Device) -> tuple[wp.Kernel, int]:
    """Return the model's kernel on a device, and how many pixels a thread takes."""
    if device.is_cpu:
        from warpvis.kernels.noise_rows import measure_khoshelham_rows

        return measure_khoshelham_rows, WHOLE_ROW
    from warpvis.kernels.kinect_noise import measure_khoshelham

    return measure_khoshelham, 1
