# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Decoding of images to arrays; a texture that cannot be read is white, with a warning."""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception
from warpvis.core.user_warnings import warn_user

if TYPE_CHECKING:
    from PIL.Image import Image

_KTX2 = b"\xabKTX 20\xbb\r\n\x1a\n"

WHITE = np.full((1, 1, 3), 255, dtype=np.uint8)
"""Replaces an image that cannot be read: the material's base color is unchanged."""


def pixels_or_white(source: Image | Path | bytes, name: str) -> NDArray[np.uint8]:
    """Decode an image, shape ``(H, W, 3)`` or ``(H, W, 4)``; warn and return `WHITE` if it cannot be read."""
    from PIL import Image, UnidentifiedImageError

    if source == b"":
        source = Path()  # the image was not found: opening this fails
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow warns of large images that it still reads
            if not isinstance(source, bytes | Path):
                return pixels(source)
            with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
                if file.read(len(_KTX2)) == _KTX2:
                    return _ktx2_pixels(_KTX2 + file.read())
                file.seek(0)
                with Image.open(file) as image:
                    return pixels(image)
    except Exception as error:  # decoders may raise any exception
        reason = "no known format" if isinstance(error, UnidentifiedImageError) else describe_exception(error)
        reason = "no such file" if isinstance(error, FileNotFoundError | IsADirectoryError) else reason
        warn_user(
            f"{name}: cannot be read as an image ({reason}); using white, so that the material's base color shows",
            UserWarning,
        )
        return WHITE.copy()


def _ktx2_pixels(source: bytes) -> NDArray[np.uint8]:
    """Decode the first level of a Basis Universal texture, shape ``(H, W, 3)`` or ``(H, W, 4)``."""
    try:
        import opengl_basisu
    except ImportError:
        raise ValueError("it is KTX2, and reading that needs opengl-basisu: pip install 'warpvis[gltf]'") from None
    texture = opengl_basisu.open(source)
    texels = texture.transcode(opengl_basisu.Target.RGBA8).data.astype(np.uint8, copy=False)
    return texels if texture.has_alpha else texels[..., :3].copy()


def pixels(image: Image) -> NDArray[np.uint8]:
    """Return the pixels of a Pillow image, shape ``(H, W, 3)`` or ``(H, W, 4)``: the upper 8 bits of 16."""
    if image.mode.startswith("I;16"):
        gray = (np.asarray(image, dtype=np.uint16) >> 8).astype(np.uint8)
        return np.repeat(gray[:, :, None], 3, axis=2)
    transparent = "A" in image.mode or "a" in image.mode or "transparency" in image.info
    return np.asarray(image.convert("RGBA" if transparent else "RGB"), dtype=np.uint8)
