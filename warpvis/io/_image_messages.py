# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pixels of ROS's Image and CompressedImage messages: depth, also compressed by compressedDepth, and color.

Source of the compression: https://github.com/ros-perception/image_transport_plugins,
compressed_depth_image_transport/src/codec.cpp and rvl_codec.cpp.
"""

from __future__ import annotations

import io
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception
from warpvis.core.messages import Message, field, whole_field
from warpvis.errors import FileFormatError, MessageError
from warpvis.io._depth import decode_units

# NumPy types of pixels of depth; some drivers call 16UC1 mono16.
_DEPTH = {"32FC1": "f4", "16UC1": "u2", "mono16": "u2"}
_CHANNELS = {"rgb8": 3, "bgr8": 3, "rgba8": 4, "bgra8": 4, "mono8": 1}

_CONFIG = struct.Struct("<iff")
"""Header of compressedDepth: a format, and two parameters of the quantization of 32FC1."""
_MAX_PIXELS = 1 << 28
_MAX_NIBBLES = 10
"""Maximum length of a number of RVL; each nibble has three of its bits."""


def is_depth(message: Message) -> bool:
    """Return whether an Image or CompressedImage has an encoding of depth."""
    if hasattr(message, "format"):
        return "compressedDepth" in str(message.format)
    return getattr(message, "encoding", None) in _DEPTH


def is_color(message: Message) -> bool:
    """Return whether an Image or CompressedImage has an encoding of color or gray that `color_pixels` reads."""
    if hasattr(message, "format"):
        return any(kind in str(message.format).lower() for kind in ("jpeg", "jpg", "png")) and not is_depth(message)
    return getattr(message, "encoding", None) in _CHANNELS


def depth_pixels(message: Message) -> NDArray[Any]:
    """Return the pixels of a depth image, uint16 [mm] or float32 [m], shape ``(H, W)``."""
    if hasattr(message, "format"):
        return _decompress(message)
    encoding = field(message, "encoding")
    if encoding not in _DEPTH:
        raise MessageError(f"an Image of depth must be of 32FC1 or 16UC1, got {encoding!r}")
    kind = np.dtype((">" if field(message, "is_bigendian") else "<") + _DEPTH[encoding])
    pixels = _rows(message, kind.itemsize, f"an Image of depth of {encoding}").view(kind)
    return pixels.astype(kind.newbyteorder("="))


def color_pixels(message: Message) -> NDArray[np.uint8]:
    """Return the pixels of a color or gray image, sRGB, shape ``(H, W, 3)``."""
    if hasattr(message, "format"):
        from PIL import Image

        try:
            with Image.open(
                io.BytesIO(_bytes_of(field(message, "data")).tobytes()), formats=("JPEG", "PNG")
            ) as picture:
                return np.asarray(picture.convert("RGB"))
        except Exception as error:  # each kind of damage raises its own exception
            raise MessageError(f"data of a CompressedImage is damaged: {describe_exception(error)}") from None
    encoding = field(message, "encoding")
    if encoding not in _CHANNELS:
        raise MessageError(f"an Image of color must be of {', '.join(_CHANNELS)}, got {encoding!r}")
    rows = _rows(message, _CHANNELS[encoding], f"an Image of {encoding}")
    pixels = rows.reshape(len(rows), -1, _CHANNELS[encoding])
    if encoding == "mono8":
        return np.repeat(pixels, 3, axis=2)
    return np.array(pixels[..., :3] if encoding.startswith("rgb") else pixels[..., 2::-1], order="C")


def _rows(message: Message, pixel_bytes: int, name: str) -> NDArray[np.uint8]:
    """Return the rows of an Image without their padding, shape ``(H, width in bytes)``."""
    height, width, step = (whole_field(message, name) for name in ("height", "width", "step"))
    if height < 1 or width < 1:
        raise MessageError(f"{name} must have pixels, got {width} x {height}")
    data = _bytes_of(field(message, "data"))
    if step < width * pixel_bytes or data.size != height * step:
        raise MessageError(
            f"{name} with {width} x {height} pixels in rows of {step} bytes must have at least {pixel_bytes} bytes a "
            f"pixel and {height * step} in all, got {data.size}"
        )
    return np.ascontiguousarray(data.reshape(height, step)[:, : width * pixel_bytes])


def _decompress(message: Message) -> NDArray[Any]:
    """Decode a CompressedImage of compressedDepth: 16 bits, or inverse depth in 16 bits for 32FC1."""
    encoding, _, kind = str(field(message, "format")).partition(";")
    data = _bytes_of(field(message, "data"))
    if encoding not in _DEPTH or not is_depth(message):
        raise MessageError(
            f"a CompressedImage of depth must have the format '16UC1; compressedDepth' or '32FC1; compressedDepth', "
            f"got {message.format!r}"
        )
    if data.size <= _CONFIG.size:
        raise MessageError(f"a CompressedImage of depth must have a header and an image, got {data.size} bytes")
    _, a, b = _CONFIG.unpack(data[: _CONFIG.size].tobytes())
    try:
        units = _decode_rvl(data[_CONFIG.size :]) if "rvl" in kind else _decode_png(data[_CONFIG.size :])
    except FileFormatError as error:
        raise MessageError(str(error)) from None
    if _DEPTH[encoding] == "u2":
        return units
    inverse = units.astype(np.float32) - np.float32(b)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.where(units > 0, np.float32(a) / inverse, np.float32(np.nan))


def _decode_png(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    return decode_units(io.BytesIO(data.tobytes()), "PNG", "data of a CompressedImage of depth")


def _decode_rvl(data: NDArray[np.uint8]) -> NDArray[np.uint16]:
    """Decode RVL: runs of zeros and of differences to the previous pixel, in nibbles of three bits and a flag.

    Source: A. Wilson, "Fast Lossless Depth Image Compression", ISS 2017. Width and height precede the runs in ROS.
    """
    if data.size < 12:
        raise MessageError(f"an image of RVL must have a size and pixels, got {data.size} bytes")
    width, height = (int(size) for size in data[:8].view("<u4"))
    count = width * height
    if not 0 < count <= _MAX_PIXELS:
        raise MessageError(f"an image of RVL must have 1 to {_MAX_PIXELS} pixels, got {width} x {height}")
    words = data[8 : 8 + (data.size - 8) // 4 * 4].view("<u4")
    nibbles = ((words[:, None] >> np.arange(28, -1, -4, dtype=np.uint32)) & 0xF).ravel()  # high nibbles first
    ends = np.flatnonzero(nibbles < 8)
    starts = np.concatenate([[0], ends[:-1] + 1])
    lengths = ends + 1 - starts
    if not len(ends) or lengths.max() > _MAX_NIBBLES:
        raise MessageError("an image of RVL is damaged: a number is too long")
    used = ends[-1] + 1
    places = np.arange(used) - np.repeat(starts, lengths)
    values = np.add.reduceat((nibbles[:used] & 7).astype(np.int64) << 3 * places, starts)
    is_difference, has_depth = np.zeros(len(values), dtype=bool), np.zeros(count, dtype=bool)
    index = pixel = 0
    while pixel < count:
        if index + 2 > len(values):
            raise MessageError(f"an image of RVL is damaged: it ends after {pixel} of {count} pixels")
        zeros, nonzeros = int(values[index]), int(values[index + 1])
        index, pixel = index + 2, pixel + zeros
        if pixel + nonzeros > count or index + nonzeros > len(values):
            raise MessageError(f"an image of RVL is damaged: a run of {nonzeros} pixels is too long")
        is_difference[index : index + nonzeros] = has_depth[pixel : pixel + nonzeros] = True
        index, pixel = index + nonzeros, pixel + nonzeros
    zigzag = values[is_difference]
    units = np.zeros(count, dtype=np.uint16)
    units[has_depth] = np.cumsum((zigzag >> 1) ^ -(zigzag & 1)).astype(np.uint16)
    return units.reshape(height, width)


def _bytes_of(data: Any) -> NDArray[np.uint8]:
    """Return the bytes of a message field: bytes, an `array.array`, a NumPy array, or a list of numbers."""
    try:
        if isinstance(data, (list, tuple)):
            data = bytes(data)
        return np.frombuffer(data, dtype=np.uint8)
    except (TypeError, ValueError) as error:
        raise MessageError(f"data of an Image must be bytes: {error}") from None
