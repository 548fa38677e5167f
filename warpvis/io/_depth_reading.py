# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Readers of single depth images from other programs: 16-bit PNG and NumPy files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, check_number, describe_exception
from warpvis.core.file_content import require_content
from warpvis.errors import ArrayError, FileFormatError
from warpvis.io._depth import units_to_depth
from warpvis.io._files import read_array

DEPTH_SUFFIXES = (".png", ".npy")
"""File name suffixes that `read_depth` supports."""


def read_depth(path: str | os.PathLike[str], *, unit: float = 0.001) -> NDArray[np.float32]:
    """Read one depth image.

    Args:
        path: A grayscale 16-bit PNG, or a NumPy array, shape ``(H, W)``: integers are units, floats meters.
        unit: Length of one unit [m].

    Returns:
        Depth [m], ``(H, W)`` float32; NaN where the file has 0, or 65535 in 16 bits, which is no depth in 7-Scenes and
        a limit elsewhere.

    Raises:
        ArrayError: If `unit` is not a positive number.
        FileFormatError: If the file is missing, or not such an image.
    """
    path = as_path(path)
    if check_number(unit, "unit", minimum=0.0) == 0.0:
        raise ArrayError("unit must be above 0 m")
    image = _read(path)
    if image.ndim != 2 or image.dtype.kind not in "fiu":
        raise FileFormatError(f"{path}: expected a depth image of shape (H, W), got {image.dtype} of {image.shape}")
    if image.dtype.kind != "f":
        return units_to_depth(image, unit)
    depth = image.astype(np.float32)
    return np.where(depth == 0, np.float32(np.nan), depth)


def _read(path: Path) -> NDArray:
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    require_content(path, "a depth image", images=False)
    if path.suffix.lower() == ".npy":
        return read_array(path)
    from PIL import Image

    try:
        with Image.open(path, formats=("PNG",)) as picture:
            mode, image = picture.mode, np.asarray(picture)
    except Exception as error:  # each kind of damage raises its own exception
        raise FileFormatError(f"{path}: not a PNG image: {describe_exception(error)}") from None
    if mode not in ("I;16", "I;16B", "I"):
        raise FileFormatError(
            f"{path}: expected a gray PNG of 16 bits, as depth cameras' programs write, got mode {mode}"
        )
    return image.astype(np.uint16)  # Pillow returns 32 bits for some of these files


def find_depth_images(folder: str | os.PathLike[str]) -> list[Path]:
    """Return the depth images in a folder, sorted by name."""
    folder = as_path(folder)
    if not folder.is_dir():
        raise FileFormatError(f"{folder}: no such folder")
    found = sorted(path for path in folder.iterdir() if path.suffix.lower() in DEPTH_SUFFIXES)
    if not found:
        raise FileFormatError(f"{folder}: has no depth images, {' or '.join(DEPTH_SUFFIXES)}")
    return found
