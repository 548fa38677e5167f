# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Single depth images: PNG, TIFF and PGM of 16 bits in millimeters or other units, float TIFF, and NumPy files."""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import as_path, check_number, describe_exception
from warpvis.core.file_content import reading, require_content, writing
from warpvis.core.numpy_files import read_array
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, FileFormatError

NO_DEPTH_UINT16 = 65_535
"""Value of 16-bit depth images from other programs for no depth, as is 0 (7-Scenes), or for saturation."""

# On a 16-bit depth image, filter Up and zlib level 1 take a third to half of the time of Pillow's level 1, which tries
# every filter on every row, and no more bytes: 0.5 to 1.7 ms and 0.05 to 0.24 of the pixels' bytes for 320x240 pixels
# of a room or of 60 balls. Level 6 takes four times as long for about a fifth less.
_UP = 2
_LEVEL = 1
# On color images, filter Sub makes textured surfaces a fifth smaller than Up: 168 instead of 211 kB for 640x480 pixels
# of a humanoid on a checkered floor; images of plain surfaces take 8 kB with both.
_SUB = 1
_GRAY, _RGB = 0, 2
"""Color types of PNG."""

_PGM_HEADER = re.compile(
    rb"P5(?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s", re.ASCII
)

DEPTH_SUFFIXES = (".png", ".npy")
"""File name suffixes that `read_depth` supports."""


def depth_to_units(depth: ArrayLike, scale: float) -> NDArray[np.uint16]:
    """Convert depth to whole units for 16-bit depth images, 0 where there is no depth.

    Depth out of the 16-bit range becomes 0 as well, not the maximum: readers treat 0 as no depth. 65535 is never
    written, since some readers treat it as no depth, others as a limit.

    Args:
        depth: Depth [m], any shape.
        scale: Units per meter: 1000 for millimeters, 5000 for TUM's datasets.

    Returns:
        Depth in units, the same shape.
    """
    depth = as_numpy(depth, name="depth")
    units = np.multiply(depth, scale, out=np.empty(depth.shape), dtype=np.float64)
    np.rint(units, out=units)
    np.fmax(units, 0, out=units)  # also replaces NaN by 0
    np.copyto(units, 0, where=units >= NO_DEPTH_UINT16)
    return units.astype(np.uint16)


def require_meters(image: NDArray[Any]) -> NDArray[Any]:
    """Return a depth image; raise an ArrayError if it is not a float array."""
    if image.dtype.kind != "f":
        raise ArrayError(f"depth must be in meters, a float array, got {image.dtype}; divide millimeters by 1000")
    return image


def count_lost(depth: NDArray[np.floating], units: NDArray[np.uint16]) -> int:
    """Count the depths [m] that become 0 in units: too far for 16 bits, or less than half a unit.

    Pixels without depth are not counted: infinities, NaN, 0 and negative values.
    """
    return int(np.count_nonzero((depth > 0) & (depth < np.inf)) - np.count_nonzero(units))


def describe_lost(scale: float) -> str:
    """Return the text of a warning about the pixels that `count_lost` counts, with `scale` units per meter."""
    return (
        f"pixels have a depth that 16 bits of {scale:g} units a meter cannot hold (they hold {0.5 / scale:g} to "
        f"{(NO_DEPTH_UINT16 - 0.5) / scale:g} m), and are 0, no depth"
    )


def warn_of_lost(depth: NDArray[np.floating], units: NDArray[np.uint16], scale: float) -> None:
    """Warn of depths [m] that `units`, with `scale` per meter, cannot represent, if there are any."""
    lost = count_lost(depth, units)
    if lost:
        warn_user(f"{describe_lost(scale)}: {lost} in all", UserWarning)


def units_to_depth(units: NDArray[np.integer], unit: float) -> NDArray[np.float32]:
    """Return depth [m] from whole units of a length [m]; NaN where they are 0, or 65535 in a 16-bit array."""
    depth = (units * float(unit)).astype(np.float32)
    depth[missing_units(units)] = np.nan
    return depth


def missing_units(units: NDArray[np.integer]) -> NDArray[np.bool_]:
    """Return where whole units are no depth: 0, and 65535 in a 16-bit array."""
    missing = units == 0
    return missing | (units == NO_DEPTH_UINT16) if units.dtype.itemsize == 2 else missing


def encode_png(image: NDArray[np.uint8] | NDArray[np.uint16]) -> bytes:
    """Encode an image of 8 or 16 bits, shape ``(H, W)``, as a grayscale PNG file.

    The bytes depend on the image and on the version of zlib. Most of the time is spent without the GIL, so that several
    threads can encode in parallel.
    """
    if image.ndim != 2 or image.dtype not in (np.uint8, np.uint16) or not image.size:
        raise ArrayError(f"a PNG image must be uint8 or uint16 of shape (H, W), got {image.dtype} of {image.shape}")
    return next(encode_pngs(image[None]))


def encode_pngs(images: NDArray[np.uint8] | NDArray[np.uint16]) -> Iterator[bytes]:
    """Encode images ``(n, H, W)`` as `encode_png` does, or colors ``(n, H, W, 3)`` of 8 bits, one after the other.

    Encoding several images in one call takes the GIL less often than one call per image.
    """
    count, height, width = images.shape[:3]
    depth = 8 * images.dtype.itemsize
    color = _RGB if images.ndim == 4 else _GRAY
    rows = np.ascontiguousarray(images, images.dtype.newbyteorder(">")).view(np.uint8).reshape(count, height, -1)
    lines = np.empty((count, height, 1 + rows.shape[2]), dtype=np.uint8)
    if color == _RGB:
        lines[:, :, 0] = _SUB
        lines[:, :, 1:4] = rows[:, :, :3]
        np.subtract(rows[:, :, 3:], rows[:, :, :-3], out=lines[:, :, 4:])
    else:
        lines[:, :, 0] = _UP
        lines[:, 0, 1:] = rows[:, 0]
        np.subtract(rows[:, 1:], rows[:, :-1], out=lines[:, 1:, 1:])
    header = struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, 0)
    head = b"\x89PNG\r\n\x1a\n" + b"".join(_chunk_parts(b"IHDR", header))
    for image in lines:
        yield b"".join((head, *_chunk_parts(b"IDAT", zlib.compress(image.data, _LEVEL)), _END))


def _chunk_parts(kind: bytes, data: bytes) -> tuple[bytes, ...]:
    return struct.pack(">I", len(data)), kind, data, struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))


_END = b"".join(_chunk_parts(b"IEND", b""))


def save_depth_png(depth: ArrayLike, path: str | os.PathLike[str]) -> None:
    """Write one depth image as 16-bit PNG in millimeters, 0 where there is no depth.

    A warning counts the pixels whose depth 16 bits cannot hold, which are 0 as well; see `depth_to_units`.

    Args:
        depth: Depth [m], float, shape ``(H, W)``.
        path: File to write.

    Raises:
        FileFormatError: If the file cannot be written.
    """
    image = require_meters(as_numpy(depth, name="depth"))
    if image.ndim != 2:
        raise ArrayError(f"depth must have shape (H, W), got {image.shape}")
    millimeters = depth_to_units(image, 1000)
    warn_of_lost(image, millimeters, 1000)
    with writing(path):
        as_path(path).write_bytes(encode_png(millimeters))


def read_depth(path: str | os.PathLike[str], *, unit: float = 0.001) -> NDArray[np.float32]:
    """Read one depth image.

    Args:
        path: A grayscale PNG, TIFF or PGM of 16 bits, a float TIFF, or a NumPy array, shape ``(H, W)``: integers are
            units, floats meters.
        unit: Length of one unit [m].

    Returns:
        Depth [m], ``(H, W)`` float32; NaN where the file has 0, or 65535 in 16 bits, which is no depth in 7-Scenes and
        a limit elsewhere.

    Raises:
        FileFormatError: If the file is missing, or not such an image.
    """
    if check_number(unit, "unit", minimum=0.0) == 0.0:
        raise ArrayError("unit must be above 0 m")
    return pixels_to_depth(read_pixels(as_path(path)), unit)


def pixels_to_depth(
    pixels: NDArray[Any], integer_unit: float = 0.001, float_unit: float | None = None
) -> NDArray[np.float32]:
    """Convert the pixels of a depth image to meters, NaN where they are 0, or 65535 in 16 bits.

    Args:
        pixels: Integers or floats.
        integer_unit: Length of one unit of integers [m].
        float_unit: Length of one unit of floats [m]; 1 by default.
    """
    if pixels.dtype.kind != "f":
        return units_to_depth(pixels, integer_unit)
    depth = pixels.astype(np.float32) * np.float32(1.0 if float_unit is None else float_unit)
    return np.where(depth == 0, np.float32(np.nan), depth)


def read_pixels(path: Path) -> NDArray[Any]:
    """Read the pixels of a depth image, integers or floats, shape ``(H, W)``."""
    image = _read(path)
    if image.ndim != 2 or image.dtype.kind not in "fiu":
        raise FileFormatError(f"{path}: expected a depth image of shape (H, W), got {image.dtype} of {image.shape}")
    return image


def _read(path: Path) -> NDArray:
    if not path.is_file():
        raise FileFormatError(f"{path}: no such file")
    require_content(path, "a depth image", images=False)
    if path.suffix.lower() == ".npy":
        return read_array(path)
    if path.suffix.lower() == ".pgm":
        return _read_pgm(path)
    return decode_units(path, "TIFF" if path.suffix.lower() in (".tif", ".tiff") else "PNG", path)


def _read_pgm(path: Path) -> NDArray[np.uint16]:
    """Read a binary PGM of 16 bits, which Pillow scales to 65535 if its maximum is lower.

    Source: https://netpbm.sourceforge.net/doc/pgm.html
    """
    with reading(path, "a PGM image"):
        data = path.read_bytes()
    header = _PGM_HEADER.match(data)
    if header is None:
        raise FileFormatError(f"{path}: not a binary PGM image (P5)")
    width, height, maximum = map(int, header.groups())
    if not 255 < maximum < 65536:
        raise FileFormatError(f"{path}: expected a gray PGM of 16 bits, got a maximum of {maximum}")
    stored = len(data) - header.end()
    if not width * height or stored < 2 * width * height:
        raise FileFormatError(f"{path}: a PGM image of {width} x {height} pixels has {stored} bytes")
    pixels = np.frombuffer(data, ">u2", width * height, header.end())
    return pixels.astype(np.uint16).reshape(height, width)


def decode_units(source: Path | BinaryIO, kind: str, place: object) -> NDArray[Any]:
    """Decode a gray image of 16 bits of a kind of Pillow's, or a float TIFF; `place` begins the message of an error."""
    from PIL import Image

    try:
        with Image.open(source, formats=(kind,)) as picture:
            mode, image = picture.mode, np.asarray(picture)
    except Exception as error:  # each kind of damage raises its own exception
        raise FileFormatError(f"{place}: not a {kind} image: {describe_exception(error)}") from None
    if kind == "TIFF" and mode == "F":
        return image
    if mode not in ("I;16", "I;16B", "I"):
        remedy = "pass the depth images, not color images" if mode.startswith(("RGB", "P", "CMYK")) else ""
        remedy = remedy or "pass the depth images, not pictures of them"
        raise FileFormatError(
            f"{place}: expected a gray {kind} of 16 bits, as depth cameras' programs write, got mode {mode}; {remedy}"
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
