# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reader of URDF robots, without a simulator: links, meshes, materials and joints; xacro through its package."""

from __future__ import annotations

from warpvis.io.urdf._reader import read_urdf as read_urdf
