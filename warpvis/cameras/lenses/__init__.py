# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lens models: vectorized maps from directions to image points and back, in double precision."""

from __future__ import annotations

from warpvis.cameras.lenses._closed import EUCM, FOV, Division, DoubleSphere
from warpvis.cameras.lenses._dicts import lens_from_dict as lens_from_dict, lens_to_dict as lens_to_dict
from warpvis.cameras.lenses._fisheyes import FTheta, KannalaBrandt, RadTanThinPrismFisheye, ThinPrismFisheye
from warpvis.cameras.lenses._formats import (
    COLMAP_NUMBERS as COLMAP_NUMBERS,
    COLMAP_PINHOLES as COLMAP_PINHOLES,
    NERF_PINHOLES as NERF_PINHOLES,
    colmap_count as colmap_count,
    lens_from_colmap as lens_from_colmap,
    lens_from_kalibr as lens_from_kalibr,
    lens_from_nerfstudio as lens_from_nerfstudio,
    lens_from_opencv as lens_from_opencv,
    lens_from_ros as lens_from_ros,
    lens_to_colmap as lens_to_colmap,
    lens_to_nerfstudio as lens_to_nerfstudio,
    lens_to_ros as lens_to_ros,
    lens_to_tum as lens_to_tum,
    nerfstudio_model as nerfstudio_model,
)
from warpvis.cameras.lenses._lens import Lens, check_coefficients as check_coefficients
from warpvis.cameras.lenses._omnidirectional import Mei, Scaramuzza
from warpvis.cameras.lenses._panoramas import (
    Cylindrical,
    Equirectangular,
    directions_on_sphere as directions_on_sphere,
    jacobian_on_sphere as jacobian_on_sphere,
)
from warpvis.cameras.lenses._parameters import (
    lens_jacobian as lens_jacobian,
    lens_parameters as lens_parameters,
    lens_with_parameters as lens_with_parameters,
)
from warpvis.cameras.lenses._pinhole import OpenCVPinhole

__all__ = [
    "EUCM",
    "FOV",
    "Cylindrical",
    "Division",
    "DoubleSphere",
    "Equirectangular",
    "FTheta",
    "KannalaBrandt",
    "Lens",
    "Mei",
    "OpenCVPinhole",
    "RadTanThinPrismFisheye",
    "Scaramuzza",
    "ThinPrismFisheye",
]
