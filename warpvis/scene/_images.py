# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Image files of textures, decoded by Pillow."""

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

WHITE = np.full((1, 1, 3), 255, dtype=np.uint8)
"""What stands in for an image that cannot be read: it leaves the material's own colour as it is."""


def decoded_or_white(source: Path | bytes, name: str) -> NDArray[np.uint8]:
    """Decode an image file, shape ``(H, W, 3)`` or ``(H, W, 4)``; `WHITE`, and a warning, if it cannot be read."""
    from PIL import Image

    if isinstance(source, bytes) and not source:
        source = Path()  # nothing was found: no file is called so
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's are of sizes that it still reads
            with Image.open(io.BytesIO(source) if isinstance(source, bytes) else source) as image:
                return pixels(image)
    except Exception as error:  # decoders raise what they like
        return _white(error, name)


def pixels_or_white(image: Image, name: str) -> NDArray[np.uint8]:
    """Return the pixels of an image of Pillow, which may decode only now; `WHITE`, and a warning, if it does not."""
    try:
        return pixels(image)
    except Exception as error:  # decoders raise what they like
        return _white(error, name)


def _white(error: Exception, name: str) -> NDArray[np.uint8]:
    """Warn of an image that does not read."""
    why = "no such file" if isinstance(error, FileNotFoundError | IsADirectoryError) else _reason(error)
    warn_user(
        f"{name}: cannot be read as an image ({why}): white stands in, so the material's own colour shows",
        UserWarning,
    )
    return WHITE.copy()


def pixels(image: Image) -> NDArray[np.uint8]:
    """Return the pixels of an image of Pillow, shape ``(H, W, 3)`` or ``(H, W, 4)``; of 16 bits, the upper eight."""
    if image.mode.startswith("I;16"):
        gray = (np.asarray(image, dtype=np.uint16) >> 8).astype(np.uint8)
        return np.repeat(gray[:, :, None], 3, axis=2)
    transparent = "A" in image.mode or "a" in image.mode or "transparency" in image.info
    return np.asarray(image.convert("RGBA" if transparent else "RGB"), dtype=np.uint8)


def _reason(error: Exception) -> str:
    from PIL import UnidentifiedImageError

    return "no known format" if isinstance(error, UnidentifiedImageError) else describe_exception(error)
