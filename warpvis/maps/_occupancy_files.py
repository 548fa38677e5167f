# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Files of occupancy maps: NumPy's .npz, and OctoMap's .bt."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import reading, writing
from warpvis.core.numpy_files import MAX_UNPACKED, read_archive
from warpvis.errors import FileFormatError
from warpvis.maps._known_blocks import KnownBlocks
from warpvis.maps._octomap_files import read_octomap, write_octomap

Options = dict[str, Any]
"""Arguments of an `OccupancyMap`."""

_BLOCKS = ("blocks", "values", "mixed_blocks", "voxels")
_NUMBERS = ("cell_size", "hit", "miss", "minimum", "maximum")

# Indices of voxels are 32-bit.
_MAX_BLOCK = 2**27


def write_map(path: Path, options: Options, known: KnownBlocks) -> None:
    """Write a map in the format of the file's suffix.

    Raises:
        FileFormatError: If the suffix is unknown, or the file cannot be written.
    """
    if _is_octomap(path):
        write_octomap(path, options["cell_size"], known)
        return
    arrays: dict[str, Any] = {name: np.float64(options[name]) for name in _NUMBERS}
    arrays |= {"up": np.array(options["up"]), "blocks": known.first.astype(np.int32), "values": known.values}
    arrays |= {"mixed_blocks": known.mixed.astype(np.int32), "voxels": known.voxels}
    arrays["bounds"] = np.zeros((0, 3)) if options["bounds"] is None else options["bounds"]
    # Readers limit the size of compressed data.
    save = np.savez_compressed if known.voxels.nbytes < MAX_UNPACKED // 2 else np.savez
    with writing(path), path.open("wb") as file:  # by handle, since NumPy appends a suffix to names
        save(file, **arrays)


def read_map(path: Path) -> tuple[Options, KnownBlocks]:
    """Return the options and the blocks of a map.

    Raises:
        FileFormatError: If the file is not a map, or is damaged.
    """
    if _is_octomap(path):
        return read_octomap(path)
    arrays = read_archive(path, (*_NUMBERS, "up", "bounds", *_BLOCKS), "mixed_blocks")
    with reading(path, "an occupancy map"):
        options: Options = {name: arrays[name].item() for name in (*_NUMBERS, "up")}
        options["bounds"] = arrays["bounds"] if arrays["bounds"].size else None
        first = _check(arrays, "blocks", np.int32, (3,)).astype(np.int64)
        values = _check(arrays, "values", np.int16, ())
        mixed = _check(arrays, "mixed_blocks", np.int32, (3,)).astype(np.int64)
        voxels = _check(arrays, "voxels", np.int16, (8, 8, 8))
        if len(values) != len(first) or len(voxels) != len(mixed):
            raise ValueError("its arrays must have the same length")
        both = np.vstack([first, mixed])
        if len(np.unique(both, axis=0)) < len(both):
            raise ValueError("it has a block twice")
        if np.abs(both).max(initial=0) > _MAX_BLOCK:
            raise ValueError(f"its blocks must be at most {_MAX_BLOCK} from the origin, got {np.abs(both).max()}")
        return options, KnownBlocks(first, np.ones_like(first), values, mixed, voxels)


def _check(arrays: dict[str, NDArray[Any]], name: str, dtype: type, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return an array after checking the type and the shape of its rows."""
    array = arrays[name]
    if array.dtype != dtype or array.ndim == 0 or array.shape[1:] != shape:
        raise ValueError(f"its array {name} must be {np.dtype(dtype)} in rows of {shape}, got {array.shape}")
    return array


def _is_octomap(path: Path) -> bool:
    suffix = path.suffix.lower()
    if suffix not in (".npz", ".bt"):
        raise FileFormatError(f"{path}: the name of an occupancy map must end in .npz or .bt, got {suffix!r}")
    return suffix == ".bt"
