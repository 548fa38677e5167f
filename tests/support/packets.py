# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs written by packet casters."""

ALL = ("depth", "points", "normals", "labels", "segmentation")
