# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of Gazebo's SDFormat: worlds and models (https://sdformat.org/spec)."""

from __future__ import annotations

from warpvis.io.sdf._reader import read_sdf as read_sdf
from warpvis.io.sdf._sensors import SdfSensor as SdfSensor, read_sensors as read_sensors
