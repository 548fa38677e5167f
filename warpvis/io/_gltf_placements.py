# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where the meshes of a glTF file are: at nodes, and as instances; and which of them share their triangles.

Sections are those of the glTF 2.0 specification.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.io._file_meshes import FileMesh
from warpvis.io._gltf_data import GltfData
from warpvis.scene import keep_winding
from warpvis.scene.looks import Look

INSTANCES = "EXT_mesh_gpu_instancing"

# Nodes that are children of several others, which the specification forbids and files have, can stand for any number,
# and so can instances: their accessors may be of zeros that no bytes of the file stand for.
_MAX_NODES = 1_000_000
_MAX_INSTANCES = 100_000

# Of two axes of length 1: matrices that are written in single precision are off by as much.
_MAX_SKEW = 1e-6


def nodes_in_order(data: GltfData) -> Iterator[tuple[int, dict[str, Any], NDArray[np.float64]]]:
    """Go through the visible nodes of the default scene (3.5): index, node, and its matrix to the file's frame."""
    open_nodes = [(index, np.eye(4), 1) for index in reversed(_roots(data))]
    for count in itertools.count():
        if not open_nodes:
            return
        index, above, depth = open_nodes.pop()
        node = data.one("nodes", index)
        if depth > len(data.all("nodes")):
            raise ValueError(f"node {index} is below itself")
        if count >= _MAX_NODES:
            raise ValueError(f"its nodes stand in more than {_MAX_NODES} places")
        hides = (node.get("extensions") or {}).get("KHR_node_visibility") or {}
        if hides.get("visible", True) is False:
            continue
        placement = above @ node_matrix(node)
        yield index, node, placement
        open_nodes += [(child, placement, depth + 1) for child in reversed(node.get("children", []))]


def _roots(data: GltfData) -> list[int]:
    if data.all("scenes"):
        return list(data.one("scenes", data.get("scene", 0)).get("nodes", []))
    below = {child for node in data.all("nodes") for child in node.get("children", [])}
    return [index for index in range(len(data.all("nodes"))) if index not in below]


def node_matrix(node: dict[str, Any]) -> NDArray[np.float64]:
    """Make the matrix from a node to its parent (3.5.2)."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    else:
        turn = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64).reshape(4)
        move = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
        if not np.linalg.norm(turn) > 0:
            raise ValueError("a node's rotation is of length 0")
        matrix = poses_to_matrices(np.concatenate([move, turn]))
        matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
    if not np.isfinite(matrix).all():
        raise ValueError("a node's placement is not finite")
    return matrix


def instance_matrices(data: GltfData, packed: dict[str, Any]) -> NDArray[np.float64]:
    """Make the matrices from a node's instances to the node (EXT_mesh_gpu_instancing), shape ``(n, 4, 4)``."""
    attributes = packed["attributes"]
    counts = sorted({data.one("accessors", index)["count"] for index in attributes.values()})
    if len(counts) != 1 or not 0 <= counts[0] <= _MAX_INSTANCES:
        raise ValueError(
            f"{INSTANCES}: all attributes must have one number of rows up to {_MAX_INSTANCES}, got {counts}"
        )
    rest = {"TRANSLATION": np.zeros(3), "ROTATION": np.array([0.0, 0, 0, 1]), "SCALE": np.ones(3)}
    move, turn, scale = (
        data.accessor(attributes[key]).astype(np.float64) if key in attributes else np.tile(row, (counts[0], 1))
        for key, row in rest.items()
    )
    for rows, row in zip((move, turn, scale), rest.values(), strict=True):
        if rows.shape[1] != len(row):
            raise ValueError(f"{INSTANCES}: a place and a size are of 3 numbers, a turn is of 4, got {rows.shape[1]}")
    if not (np.linalg.norm(turn, axis=1) > 0).all():
        raise ValueError("an instance's rotation is of length 0")
    matrices = poses_to_matrices(np.concatenate([move, turn], axis=1))
    matrices[:, :3, :3] *= scale[:, None]
    if not np.isfinite(matrices).all():
        raise ValueError("an instance's placement is not finite")
    return matrices


class Split(NamedTuple):
    """Placements as what changes a mesh's shape, and a pose after it."""

    factors: NDArray[np.float64]
    """Along the mesh's axes, all negative where it is mirrored, shape ``(n, 3)``."""
    rows: NDArray[np.float64]
    """``x y z qx qy qz qw``, shape ``(n, 7)``."""
    fits: NDArray[np.bool_]
    """Whether a placement is these two; one that shears or flattens is not."""

    @property
    def copies(self) -> int:
        """How often a mesh is kept for all of them: in every size, and wherever it is no pose."""
        return len(np.unique(_sizes(self.factors[self.fits]), axis=0)) + int((~self.fits).sum())

    def one_by_one(self) -> Iterator[Split]:
        """Go through them; to split them one by one takes long."""
        for number in range(len(self.rows)):
            one = slice(number, number + 1)
            yield Split(self.factors[one], self.rows[one], self.fits[one])


def split(matrices: NDArray[np.float64]) -> Split:
    """Split placements into factors and poses: the axes that are left have to be at right angles."""
    linear = matrices[:, :3, :3]
    with np.errstate(all="ignore"):  # what is no number does not fit
        factors = np.linalg.norm(linear, axis=1)
        factors[np.linalg.det(linear / factors[:, None]) < 0] *= -1
        axes = linear / factors[:, None]
        fits = np.abs(axes.swapaxes(1, 2) @ axes - np.eye(3)).max(axis=(1, 2)) <= _MAX_SKEW
    rows = np.zeros((len(matrices), 7))
    if fits.any():
        rigid = matrices[fits]
        rigid[:, :3, :3] = axes[fits]
        rows[fits] = poses_to_opencv(rigid)
    return Split(factors, rows, fits)


class Shape:
    """A mesh as a file has it, which is kept once for each size that it comes in."""

    def __init__(self, vertices: NDArray[np.float64], faces: NDArray[np.integer], look: Look | None = None) -> None:
        self.vertices, self.faces, self.look = vertices, faces, look
        self._scaled: dict[bytes, tuple[NDArray[np.float64], NDArray[np.integer]]] = {}

    def placed(self, name: str, placement: NDArray[np.float64], extras: dict[str, Any]) -> FileMesh:
        """Return the mesh in the file's frame."""
        with np.errstate(invalid="ignore", over="ignore"):  # the scene says what is not finite
            corners = self.vertices @ placement[:3, :3].T + placement[:3, 3]
        return FileMesh(name, corners, keep_winding(self.faces, placement[:3, :3]), extras, look=self.look)

    def shared(
        self, names: list[str], placements: NDArray[np.float64], parts: Split, extras: dict[str, Any], *, movable: bool
    ) -> Iterator[FileMesh]:
        """Give the mesh at placements: at poses that share it, or in the file's frame where a placement is no pose.

        Args:
            names: One for each.
            placements: From the mesh to the file's frame, shape ``(n, 4, 4)``.
            parts: These, split.
            extras: What the file says of all of them.
            movable: Whether they share it where they may move, too.
        """
        sizes = _sizes(parts.factors)
        for name, matrix, size, factors, row, fits in zip(names, placements, sizes, *parts, strict=True):
            if not fits:
                yield self.placed(name, matrix, extras)
                continue
            vertices, faces = self._of_size(size.tobytes(), factors)
            yield FileMesh(name, vertices, faces, extras, row, movable, self.look)

    def _of_size(self, key: bytes, factors: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
        """Return the mesh scaled."""
        if key not in self._scaled:
            with np.errstate(invalid="ignore", over="ignore"):
                self._scaled[key] = self.vertices * factors, keep_winding(self.faces, np.diag(factors))
        return self._scaled[key]


def _sizes(factors: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return factors in single precision, in which vertices end: what is the same there is one size."""
    with np.errstate(over="ignore"):
        return factors.astype(np.float32)
