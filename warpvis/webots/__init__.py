# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots worlds, from V6.0 to R2025a: their geometry, and the depth images that Webots' range finders give."""
