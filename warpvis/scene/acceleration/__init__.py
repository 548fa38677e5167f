# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Acceleration structures: the trees of a scene's meshes, for packets and for single rays."""
