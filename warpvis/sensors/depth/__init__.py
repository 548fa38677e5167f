# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Models of depth cameras: they convert exact images to the measurements of such a device."""

from __future__ import annotations

from warpvis.sensors.depth._base import Reason as Reason
from warpvis.sensors.depth._corruptions import Corruptions as Corruptions
from warpvis.sensors.depth._fields import sensor_from_fields as sensor_from_fields, sensor_to_fields as sensor_to_fields
from warpvis.sensors.depth._fit import StereoFit as StereoFit, WallReport as WallReport, fit as fit
from warpvis.sensors.depth._kinect_models import (
    KhoshelhamNoise as KhoshelhamNoise,
    NguyenNoise as NguyenNoise,
    RedwoodNoise as RedwoodNoise,
    SimKinect as SimKinect,
)
from warpvis.sensors.depth._latency import Latency as Latency
from warpvis.sensors.depth._learned import LearnedDepth as LearnedDepth
from warpvis.sensors.depth._matched_stereo import MatchedStereo as MatchedStereo
from warpvis.sensors.depth._profiles import (
    SENSOR_NAMES as SENSOR_NAMES,
    azure_kinect as azure_kinect,
    femto_bolt as femto_bolt,
    gemini_335 as gemini_335,
    kinect_v1 as kinect_v1,
    kinect_v2 as kinect_v2,
    oak_d as oak_d,
    pmd_flexx2 as pmd_flexx2,
    realsense_d405 as realsense_d405,
    realsense_d415 as realsense_d415,
    realsense_d435 as realsense_d435,
    realsense_d455 as realsense_d455,
    realsense_d457 as realsense_d457,
    realsense_l515 as realsense_l515,
    sensor_by_name as sensor_by_name,
    structure as structure,
    zed_2i as zed_2i,
)
from warpvis.sensors.depth._randomized import Randomized as Randomized, randomized as randomized
from warpvis.sensors.depth._stereo import StereoDepth as StereoDepth
from warpvis.sensors.depth._time_of_flight import TimeOfFlight as TimeOfFlight
