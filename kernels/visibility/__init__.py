# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the visibility of points and objects, and of distances to surfaces."""
