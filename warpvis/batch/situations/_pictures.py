# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of situations as files: PNG, or compressed arrays for what PNG cannot hold."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import describe_exception
from warpvis.errors import FileFormatError
from warpvis.io import depth_to_units, encode_pngs
from warpvis.situations import Situation

_SCALE = 1000.0
"""Units of depth in PNG files per meter."""
_MAX_DEPTH = 65.534
_MAX_INDEX = 65_534

MEANING = (
    "`color` is sRGB of 8 bits. `depth` is a PNG of 16 bits in millimeters, 0 without a surface. Images of indices "
    "(`segmentation`) are a PNG of 16 bits with the index + 1, 0 for none. In `seen_by`, a PNG of 8 bits, bit p is "
    "set where participant p sees the pixel's surface. Other arrays are `.npz` files with the array `image`: in "
    "`amodal_masks`, of shape `(K, H, W)`, a pixel is 2 where an object of interest or a participant is visible, 1 "
    "elsewhere in its silhouette, else 0. The K masks are in the order of `things` and then `participants` of `record`."
)
"""Values of the files, for datasheets."""


def picture_files(situation: Situation) -> dict[str, tuple[str, bytes]]:
    """Encode the pictures of a situation.

    Returns:
        For each key of `Situation.images`, sorted: the end of a file name and the contents. Views of participants are
        ``agent0``, ``agent1``, ... in the order of the participants, and the first moment has no number, so that names
        are equal in all situations: ``"agent0.color.png"``, and of a second moment ``"agent0.color.1.png"``.
    """
    views = {agent.name: f"agent{place}" for place, agent in enumerate(situation.moments[0].participants)}
    files = {}
    for key in sorted(situation.images):
        view, output, *moment = key.split("/")
        suffix, data = _encode(output, np.asarray(situation.images[key]))
        number = [] if moment == ["0"] else moment
        files[key] = ".".join((views.get(view, view), output, *number, suffix)), data
    return files


def decode_picture(key: str, file: str, data: bytes) -> NDArray[Any]:
    """Decode a picture; `key` is its name in `Situation.images`, and `file` that of its file."""
    try:
        if file.endswith(".npz"):
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                return arrays["image"]
        from PIL import Image

        with Image.open(io.BytesIO(data), formats=("PNG",)) as picture:
            image = np.asarray(picture)
    except Exception as error:  # each kind of damage raises its own exception
        raise FileFormatError(f"{file}: the picture {key} cannot be read: {describe_exception(error)}") from None
    if image.dtype == np.uint8:
        return image
    if key.split("/")[1] != "depth":
        return image.astype(np.int32) - 1
    depth = (image / _SCALE).astype(np.float32)
    depth[image == 0] = np.inf
    return depth


def _encode(output: str, image: NDArray[Any]) -> tuple[str, bytes]:
    """Return the suffix and the contents of a picture's file."""
    if image.dtype == np.uint8 and image.size and (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
        return "png", next(encode_pngs(image[None]))
    if image.ndim == 2 and image.size:
        if output == "depth" and image.dtype.kind == "f" and _fits(image):
            return "png", next(encode_pngs(depth_to_units(image, _SCALE)[None]))
        if image.dtype == np.int32 and image.min() >= -1 and image.max() < _MAX_INDEX:
            return "png", next(encode_pngs((image + 1).astype(np.uint16)[None]))
    stream = io.BytesIO()
    np.savez_compressed(stream, image=image)
    return "npz", stream.getvalue()


def _fits(depth: NDArray[Any]) -> bool:
    """Return whether all depths can be written in millimeters."""
    measured = depth[np.isfinite(depth) & (depth > 0)]
    return not measured.size or bool(measured.max() <= _MAX_DEPTH and measured.min() >= 0.5 / _SCALE)
