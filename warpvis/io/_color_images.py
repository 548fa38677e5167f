# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Files of color images: PNG, JPEG and WebP, without an alpha channel."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.io._depth import encode_pngs

ColorFile = Literal["png", "jpeg", "webp"]
"""Kind of a color image file; PNG is lossless."""

COLOR_SUFFIXES: Mapping[str, str] = {"png": ".png", "jpeg": ".jpg", "webp": ".webp"}
"""File name suffix of each kind."""

# JPEG stores colors at full resolution: at half resolution, Pillow's default, files are 9 % smaller, but edges between
# objects are off by up to 47 instead of 20 of 255 (640x480 pixels of a humanoid on a textured floor, quality 95). WebP
# always halves it; its default method 4 takes four times as long as 0 for a fifth less.
_SETTINGS: Mapping[str, Mapping[str, Any]] = {"jpeg": {"subsampling": 0}, "webp": {"method": 0}}


def encode_colors(images: NDArray[np.uint8], kind: ColorFile = "png", quality: int = 95) -> Iterator[bytes]:
    """Encode color images as files, one after the other.

    Most of the time is spent without the GIL, so that several threads can encode in parallel. The bytes depend on the
    arguments and on the version of zlib or, for JPEG and WebP, of Pillow.

    Args:
        images: sRGB colors, shape ``(n, H, W, 3)``.
        kind: Kind of file.
        quality: Quality of JPEG and WebP, 1 to 100; ignored by PNG.
    """
    if kind == "png":
        yield from encode_pngs(images)
        return
    from PIL import Image

    for image in images:
        stream = io.BytesIO()
        Image.fromarray(image).save(stream, kind, quality=quality, **_SETTINGS[kind])
        yield stream.getvalue()
