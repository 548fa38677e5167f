# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The image size of comparisons with `mujoco.Renderer`."""

HEIGHT, WIDTH = 60, 80
