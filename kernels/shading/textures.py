# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Textures on the device; ``native/shared/textures.h`` samples them."""

import warp as wp


@wp.struct
class DeviceTexture:
    """The layout of a texture in the array of all texels: from the finest level to the coarsest, rows from the top."""

    first_level: int  # its first row in `DeviceMaterials.level_first`
    width: int
    height: int  # for a cube, of its six sides together
    levels: int
    wrap_u: int
    wrap_v: int
    filter: int
    is_linear: bool  # whether its texels are in linear color space
