# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The size of images that are compared with those of `mujoco.Renderer`."""

HEIGHT, WIDTH = 60, 80
