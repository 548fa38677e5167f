# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""OctoMap's binary files (.bt): octrees whose leaves are occupied or free.

Source: https://github.com/OctoMap/octomap, octomap/src/AbstractOccupancyOcTree.cpp (`readBinary`, `writeBinaryConst`),
octomap/include/octomap/OccupancyOcTreeBase.hxx (`readBinaryNode`, `writeBinaryNode`) and OcTreeBaseImpl.hxx (keys).
A header in text precedes the inner nodes of the octree, parents before their children. A node is 16 bits, two for each
child: 0 for an unknown child, 1 for a free leaf, 2 for an occupied leaf, 3 for an inner node. Bit 0 of a child's number
is its half in x, bit 1 in y, bit 2 in z. The tree has 16 levels, and the world's origin is in its middle.
"""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.file_content import reading, require_content, writing
from warpvis.errors import FileFormatError
from warpvis.maps._known_blocks import KnownBlocks, stored_log_odds

_FIRST_LINE = b"# Octomap OcTree binary file"
_FREE, _OCCUPIED, _INNER = 1, 2, 3
_ALL_FREE, _ALL_OCCUPIED = 0x5555, 0xAAAA
_DEPTH = 16
"""Level of the voxels; the root's is 0."""
_BLOCK_DEPTH = 13
"""Level of nodes of 8 x 8 x 8 voxels."""
_SIDE = 1 << (_DEPTH - _BLOCK_DEPTH)
_BLOCK_ORIGIN = 1 << (_BLOCK_DEPTH - 1)
"""Block of the octree that begins at the world's origin."""
_SHIFTS = np.array([(0, 8), (4, 12), (2, 10), (6, 14)], dtype=np.uint16).reshape(2, 2, 2)
"""Where the bits of a child are in a node, ``[x, y, z]``."""
_CHILDREN = np.array([(child & 1, child >> 1 & 1, child >> 2) for child in range(8)])

_MINIMUM, _MAXIMUM = 0.1192, 0.971
"""OctoMap's limits of probabilities (AbstractOccupancyOcTree.cpp), which leaves of binary trees have."""


def write_octomap(path: Path, cell_size: float, known: KnownBlocks) -> None:
    """Write the measured voxels of blocks of one value or of voxels (no boxes of several) as an octree.

    Raises:
        FileFormatError: If the file cannot be written, or the map is larger than an octree can be.
    """
    both = np.vstack([known.first, known.mixed]) + _BLOCK_ORIGIN
    if len(both) and (both.min() < 0 or both.max() >= 2 * _BLOCK_ORIGIN):
        raise FileFormatError(
            f"{path}: an OctoMap must end {_BLOCK_ORIGIN * _SIDE * cell_size:g} m from the origin along each axis, and "
            "this map extends farther"
        )
    words, node_count = _build_tree(known)
    header = (
        f"{_FIRST_LINE.decode()}\n# (feel free to add / change comments, but leave the first line as it is!)\n#\n"
        f"id OcTree\nsize {node_count}\nres {cell_size!r}\ndata\n"
    )
    with writing(path):
        path.write_bytes(header.encode() + words.astype("<u2").tobytes())


def _build_tree(known: KnownBlocks) -> tuple[NDArray[np.uint16], int]:
    """Return the inner nodes, parents before children, and the number of all nodes."""
    nodes: list[tuple[int, NDArray[np.int64], NDArray[np.uint16]]] = []  # level, Morton codes, words
    codes = _codes_of(known.voxels)
    for depth in range(_DEPTH - 1, _BLOCK_DEPTH - 1, -1):
        count, side = len(codes), codes.shape[1] // 2
        children = codes.reshape(count, side, 2, side, 2, side, 2)
        words = (children << _SHIFTS[:, None, :, None, :]).sum(axis=(2, 4, 6), dtype=np.uint16)
        codes = _merge(words)
        block, *place = np.nonzero(codes == _INNER)
        keys = side * (known.mixed[block] + _BLOCK_ORIGIN) + np.stack(place, axis=1)
        nodes.append((depth, _morton(keys), words[codes == _INNER]))

    blocks = _morton(np.vstack([known.mixed, known.first]) + _BLOCK_ORIGIN)
    codes = np.concatenate([codes.ravel(), _codes_of(known.values)])
    order = np.argsort(blocks)
    order = order[codes[order] > 0]
    places, codes = blocks[order], codes[order].astype(np.uint16)
    if not len(places):
        return np.zeros(0, dtype=np.uint16), 0
    for depth in range(_BLOCK_DEPTH - 1, -1, -1):
        parents, starts = np.unique(places >> 3, return_index=True)
        words = np.bitwise_or.reduceat(codes << (2 * (places & 7)).astype(np.uint16), starts)
        codes = _merge(words) if depth else np.full(1, _INNER, dtype=np.uint16)
        places = parents
        nodes.append((depth, places[codes == _INNER], words[codes == _INNER]))

    depths = np.concatenate([np.full(len(morton), depth) for depth, morton, _ in nodes])
    starts = np.concatenate([morton << 3 * (_DEPTH - depth) for depth, morton, _ in nodes])
    words = np.concatenate([words for *_, words in nodes])[np.lexsort((depths, starts))]
    return words, 1 + _count_children(words)


def _codes_of(values: NDArray[np.int16]) -> NDArray[np.uint16]:
    """Return the codes of leaves with these log-odds."""
    from warpvis.kernels.maps.occupancy_blocks import NOT_MEASURED

    measured = np.where(values >= 0, _OCCUPIED, _FREE)
    return np.where(values > int(NOT_MEASURED), measured, 0).astype(np.uint16)


def _merge(words: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Return the codes of nodes: leaves if all their children are equal leaves, 0 if they have no children."""
    leaves = np.where(words == _ALL_FREE, _FREE, np.where(words == _ALL_OCCUPIED, _OCCUPIED, _INNER))
    return np.where(words == 0, 0, leaves).astype(np.uint16)


def _morton(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Interleave the bits of x, y and z, x lowest."""
    result = np.zeros(len(keys), dtype=np.int64)
    for bit in range(_DEPTH):
        for axis in range(3):
            result |= (keys[:, axis] >> bit & 1) << (3 * bit + axis)
    return result


def _count_children(words: NDArray[np.uint16]) -> int:
    return int(np.bitwise_count((words | words >> 1) & _ALL_FREE).sum())


def read_octomap(path: Path) -> tuple[dict[str, float], KnownBlocks]:
    """Return the options of an `OccupancyMap` and the blocks of an octree.

    Raises:
        FileFormatError: If the file is not an OctoMap in binary form, or is damaged.
    """
    require_content(path, "an OctoMap")
    with reading(path, "an OctoMap"):
        data = path.read_bytes()
        if not data.startswith(_FIRST_LINE):
            raise ValueError(
                f"it does not begin with '{_FIRST_LINE.decode()}'; convert .ot files by OctoMap's convert_octree"
            )
        node_count, cell_size, start = _read_header(data)
        words = np.frombuffer(data, "<u2", count=(len(data) - start) // 2, offset=start)
        leaves = _read_leaves(words, node_count) if node_count else []
        return {"cell_size": cell_size, "minimum": _MINIMUM, "maximum": _MAXIMUM}, _blocks_of(leaves)


def _read_header(data: bytes) -> tuple[int, float, int]:
    """Return the number of nodes, the side of a voxel [m], and where the nodes begin."""
    start = data.find(b"\ndata\n") + len(b"\ndata\n")
    if start < len(b"\ndata\n"):
        raise ValueError("its header has no line 'data'")
    lines = data[:start].decode("utf-8", "replace").splitlines()
    fields = dict(line.split(maxsplit=1) for line in lines if not line.startswith("#") and len(line.split()) > 1)
    try:
        node_count, cell_size = int(fields["size"]), float(fields["res"])
    except (KeyError, ValueError):
        raise ValueError("its header must have lines 'size' and 'res' with numbers") from None
    if node_count < 0 or not 0 < cell_size < math.inf:
        raise ValueError(f"size and res of its header must be positive, got {node_count} and {cell_size}")
    return node_count, cell_size, start


Leaves = tuple[int, NDArray[np.int64], NDArray[np.uint8]]
"""Level of leaves, their keys on that level, shape ``(N, 3)``, and their codes."""


def _read_leaves(words: NDArray[np.uint16], node_count: int) -> list[Leaves]:
    """Return the leaves of an octree, by level."""
    words, following = _find_subtrees(words)
    found = 1 + _count_children(words)
    if found != node_count:
        raise ValueError(f"its octree must have {node_count} nodes, as in its header, got {found}")
    leaves: list[Leaves] = []
    nodes, keys = np.zeros(1, dtype=np.int64), np.zeros((1, 3), dtype=np.int64)
    for depth in range(1, _DEPTH + 1):
        cursor, inner_nodes, inner_keys = nodes + 1, [], []
        for child, half in enumerate(_CHILDREN):
            codes = (words[nodes] >> (2 * child) & 3).astype(np.uint8)
            is_leaf, is_inner = (codes == _FREE) | (codes == _OCCUPIED), codes == _INNER
            leaves.append((depth, 2 * keys[is_leaf] + half, codes[is_leaf]))
            inner_nodes.append(cursor[is_inner])
            inner_keys.append(2 * keys[is_inner] + half)
            cursor[is_inner] = following[cursor[is_inner]]
        nodes, keys = np.concatenate(inner_nodes), np.concatenate(inner_keys)
    if len(nodes):
        raise ValueError(f"its octree has more than {_DEPTH} levels")
    return leaves


def _find_subtrees(words: NDArray[np.uint16]) -> tuple[NDArray[np.uint16], NDArray[np.int64]]:
    """Return the nodes of the octree, and for each the node that follows its subtree."""
    inner = np.bitwise_count(words & words >> 1 & _ALL_FREE).astype(np.int64)
    # Nodes that are announced but have not begun yet. A subtree ends where there are as many as before it, less one.
    pending = np.concatenate([[1], 1 + np.cumsum(inner - 1)])
    ends = np.flatnonzero(pending == 0)
    if not len(ends):
        raise ValueError("its octree is incomplete")
    count = int(ends[0])
    order = np.argsort(pending[1 : count + 1], kind="stable")
    ranks = pending[1 : count + 1][order] * count + order
    wanted = (pending[:count] - 1) * count + np.arange(count)
    return words[:count], order[np.searchsorted(ranks, wanted)] + 1


def _blocks_of(leaves: list[Leaves]) -> KnownBlocks:
    """Return leaves as blocks."""
    from warpvis.kernels.maps.occupancy_blocks import NEVER_SEEN

    free, occupied = stored_log_odds(_MINIMUM), stored_log_odds(_MAXIMUM)
    boxes = [(depth, keys, codes) for depth, keys, codes in leaves if depth <= _BLOCK_DEPTH and len(keys)]
    small = [(depth, keys, codes) for depth, keys, codes in leaves if depth > _BLOCK_DEPTH and len(keys)]
    sides = [np.full(keys.shape, 1 << (_BLOCK_DEPTH - depth)) for depth, keys, _ in boxes]
    size = np.vstack([np.zeros((0, 3), dtype=np.int64), *sides])
    first = np.vstack([np.zeros((0, 3), dtype=np.int64), *(keys for _, keys, _ in boxes)]) * size - _BLOCK_ORIGIN
    codes = np.concatenate([np.zeros(0, dtype=np.uint8), *(codes for *_, codes in boxes)])

    owners = [_morton(keys >> (depth - _BLOCK_DEPTH)) for depth, keys, _ in small]
    places = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *owners]))
    mixed = np.zeros((len(places), 3), dtype=np.int64)
    voxels = np.full((len(places), _SIDE, _SIDE, _SIDE), int(NEVER_SEEN), dtype=np.int16)
    for (depth, keys, leaf_codes), owner in zip(small, owners, strict=True):
        rows, side = np.searchsorted(places, owner), 1 << (_DEPTH - depth)
        mixed[rows] = (keys >> (depth - _BLOCK_DEPTH)) - _BLOCK_ORIGIN
        inside = keys * side % _SIDE
        for step in itertools.product(range(side), repeat=3):
            x, y, z = (inside + step).T
            voxels[rows, x, y, z] = np.where(leaf_codes == _FREE, free, occupied)
    return KnownBlocks(first, size, np.where(codes == _FREE, free, occupied).astype(np.int16), mixed, voxels)
