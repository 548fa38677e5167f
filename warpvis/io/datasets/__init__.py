# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of scene datasets: Habitat's JSON, scans with segments, BOP's scenes, and elevation rasters."""
