# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of depth cameras and lidars: random numbers, noise, stereo, time of flight, echoes."""
