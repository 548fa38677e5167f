# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Placements of glTF meshes, at nodes and as instances, which of them share their triangles, and their rest shape.

The rest shape, without animation, has morph targets by their weights, and skins by their joints' nodes. Section numbers
are those of the glTF 2.0 specification.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.core.types import Json
from warpvis.io._gltf_data import GltfData
from warpvis.scene import Part, keep_winding
from warpvis.scene.appearances import LazyAppearance

INSTANCES = "EXT_mesh_gpu_instancing"

# Nodes with several parents, which the specification forbids but files contain, can expand to any number, and so can
# instances: their accessors may be zeros without data.
_MAX_NODES = 1_000_000
_MAX_INSTANCES = 100_000

# Tolerance of the dot product of two unit axes: rounding error of matrices in single precision.
_MAX_SKEW = 1e-6

Rows = Callable[[str], NDArray[np.generic]]
"""Reads an attribute of a primitive."""

_Triangles = tuple[NDArray[np.float64], NDArray[np.integer]]
"""Vertices and faces."""

_MAX_SETS = 16
"""Maximum number of sets of four joints each."""


def nodes_in_order(data: GltfData) -> Iterator[tuple[int, dict[str, Any], NDArray[np.float64]]]:
    """Yield the visible nodes of the default scene (3.5): index, node, and its matrix to the file's frame."""
    open_nodes = [(index, np.eye(4), 1) for index in reversed(_roots(data))]
    for count in itertools.count():
        if not open_nodes:
            return
        index, above, depth = open_nodes.pop()
        node = data.one("nodes", index)
        if depth > len(data.all("nodes")):
            raise ValueError(f"node {index} is below itself")
        if count >= _MAX_NODES:
            raise ValueError(f"its nodes have more than {_MAX_NODES} placements")
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
    """Return the matrix from a node to its parent (3.5.2)."""
    if "matrix" in node:
        matrix = np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    else:
        rotation = np.array(node.get("rotation", (0, 0, 0, 1)), dtype=np.float64).reshape(4)
        translation = np.array(node.get("translation", (0, 0, 0)), dtype=np.float64).reshape(3)
        if not np.linalg.norm(rotation) > 0:
            raise ValueError("a node's rotation has length 0")
        matrix = poses_to_matrices(np.concatenate([translation, rotation]))
        matrix[:3, :3] *= np.array(node.get("scale", (1, 1, 1)), dtype=np.float64).reshape(3)
    if not np.isfinite(matrix).all():
        raise ValueError("a node's placement is not finite")
    return matrix


def instance_matrices(data: GltfData, packed: dict[str, Any]) -> NDArray[np.float64]:
    """Return the matrices from a node's instances to the node (EXT_mesh_gpu_instancing), shape ``(n, 4, 4)``."""
    attributes = packed["attributes"]
    counts = sorted({data.one("accessors", index)["count"] for index in attributes.values()})
    if len(counts) != 1 or not 0 <= counts[0] <= _MAX_INSTANCES:
        raise ValueError(
            f"{INSTANCES}: all attributes must have one number of rows up to {_MAX_INSTANCES}, got {counts}"
        )
    defaults = {"TRANSLATION": np.zeros(3), "ROTATION": np.array([0.0, 0, 0, 1]), "SCALE": np.ones(3)}
    translation, rotation, scale = (
        data.accessor(attributes[key]).astype(np.float64) if key in attributes else np.tile(row, (counts[0], 1))
        for key, row in defaults.items()
    )
    for rows, row in zip((translation, rotation, scale), defaults.values(), strict=True):
        if rows.shape[1] != len(row):
            raise ValueError(f"{INSTANCES}: translation and scale must have 3 numbers, rotation 4, got {rows.shape[1]}")
    if not (np.linalg.norm(rotation, axis=1) > 0).all():
        raise ValueError("an instance's rotation has length 0")
    matrices = poses_to_matrices(np.concatenate([translation, rotation], axis=1))
    matrices[:, :3, :3] *= scale[:, None]
    if not np.isfinite(matrices).all():
        raise ValueError("an instance's placement is not finite")
    return matrices


class Split(NamedTuple):
    """Placements decomposed into a scale and a subsequent pose."""

    factors: NDArray[np.float64]
    """Scale factors along the mesh's axes, all negative for mirrored meshes, shape ``(n, 3)``."""
    rows: NDArray[np.float64]  # ``x y z qx qy qz qw``, shape ``(n, 7)``
    fits: NDArray[np.bool_]  # whether the decomposition is exact; it is not for placements that shear or flatten

    @property
    def copies(self) -> int:
        """Number of copies of the mesh in memory: one per size, and one per placement that cannot be decomposed."""
        return len(np.unique(_sizes(self.factors[self.fits]), axis=0)) + int((~self.fits).sum())

    def one_by_one(self) -> Iterator[Split]:
        """Yield the placements one by one; splitting matrices in a batch is much faster than one by one."""
        for number in range(len(self.rows)):
            one = slice(number, number + 1)
            yield Split(self.factors[one], self.rows[one], self.fits[one])


def split(matrices: NDArray[np.float64]) -> Split:
    """Decompose placements into scale factors and poses, which requires orthogonal axes."""
    linear = matrices[:, :3, :3]
    with np.errstate(all="ignore"):  # NaN does not fit
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
    """A mesh of a file, stored once per size."""

    def __init__(
        self, vertices: NDArray[np.float64], faces: NDArray[np.integer], appearance: LazyAppearance | None = None
    ) -> None:
        self.vertices, self.faces, self.appearance = vertices, faces, appearance
        self._scaled: dict[bytes, tuple[_Triangles, LazyAppearance | None]] = {}

    def placed(self, name: str, placement: NDArray[np.float64], extras: dict[str, Any]) -> Part:
        """Return the mesh in the file's frame."""
        with np.errstate(invalid="ignore", over="ignore"):  # the scene checks that vertices are finite
            corners = self.vertices @ placement[:3, :3].T + placement[:3, 3]
        mesh = corners, keep_winding(self.faces, placement[:3, :3])
        appearance = None if self.appearance is None else self.appearance.transformed(placement[:3, :3])
        return Part(name, mesh, _label(extras), appearance=appearance, extras=extras)

    def shared(
        self, names: list[str], placements: NDArray[np.float64], parts: Split, extras: dict[str, Any], *, movable: bool
    ) -> Iterator[Part]:
        """Yield the mesh at placements: with poses that share it, or in the file's frame where it cannot be decomposed.

        `parts` are the placements, decomposed; if `movable`, movable objects share the mesh, too.
        """
        sizes = _sizes(parts.factors)
        for name, matrix, size, factors, row, fits in zip(names, placements, sizes, *parts, strict=True):
            if not fits:
                yield self.placed(name, matrix, extras)
                continue
            mesh, appearance = self._of_size(size, factors)
            yield Part(name, mesh, _label(extras), row, has_frame=movable, appearance=appearance, extras=extras)

    def _of_size(
        self, size: NDArray[np.float32], factors: NDArray[np.float64]
    ) -> tuple[_Triangles, LazyAppearance | None]:
        """Return the scaled mesh and its appearance; `size` are the factors in single precision."""
        key = size.tobytes()
        if key not in self._scaled:
            with np.errstate(invalid="ignore", over="ignore"):
                mesh = self.vertices * factors, keep_winding(self.faces, np.diag(factors))
            is_similar = bool((size == size[0]).all() and size[0] > 0)
            appearance = self.appearance
            if appearance is not None and not is_similar:
                appearance = appearance.transformed(np.diag(factors))
            self._scaled[key] = mesh, appearance
        return self._scaled[key]


def _label(extras: dict[str, Any]) -> Any:
    """Return the label that `Scene.export` writes; `Scene.add` checks it."""
    return extras.get("label", Label.OBSTACLE)


def _sizes(factors: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return factors in single precision, the precision of vertices, so that equal sizes compare equal."""
    with np.errstate(over="ignore"):
        return factors.astype(np.float32)


def morphed(
    data: GltfData, vertices: NDArray[np.float64], attribute: str, targets: Json, weights: Json
) -> NDArray[np.float64]:
    """Apply the morph targets (3.7.2.2) of an attribute that have a nonzero weight; `weights` may be None."""
    if not (isinstance(targets, list) and isinstance(weights, list)):
        return vertices
    for target, weight in zip(targets, weights, strict=False):
        place = target.get(attribute)
        if not weight or place is None or not data.has_data(place):
            continue
        moved = data.accessor(place)
        if moved.shape != vertices.shape:
            raise ValueError(f"a morph target must move {len(vertices)} vertices, got {moved.shape}")
        vertices = vertices + float(weight) * moved.astype(np.float64)
    return vertices


def skinned(vertices: NDArray[np.float64], transforms: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return vertices in the file's frame (3.7.3.3), from the result of `skin_transforms`."""
    with np.errstate(invalid="ignore", over="ignore"):  # the scene checks that vertices are finite
        return np.einsum("vij,vj->vi", transforms[:, :3, :3], vertices) + transforms[:, :3, 3]


def skin_transforms(
    count: int, attributes: dict[str, Any], rows: Rows, joints: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the matrices of `count` vertices of a skin to the file's frame, shape ``(count, 4, 4)``.

    Vertices whose weights are all 0 do not move. `rows` reads an attribute: ``JOINTS_0``, ``WEIGHTS_0``, ...; `joints`
    is the result of `joint_matrices`.
    """
    transforms, total = np.zeros((count, 4, 4)), np.zeros(count)
    for number in range(_MAX_SETS):
        if f"JOINTS_{number}" not in attributes:
            break
        chosen, weights = rows(f"JOINTS_{number}").astype(np.int64), rows(f"WEIGHTS_{number}").astype(np.float64)
        if not chosen.shape == weights.shape == (count, 4):
            raise ValueError(f"a skin needs 4 joints and weights of {count} vertices each, got {weights.shape}")
        if chosen.size and not 0 <= chosen.min() <= chosen.max() < len(joints):
            raise ValueError(f"a vertex moves with joint {chosen.max()} of {len(joints)}")
        for column in range(4):
            transforms += weights[:, column, None, None] * joints[chosen[:, column]]
        total += weights.sum(axis=1)
    unweighted = ~(np.abs(total) > 0)
    transforms[unweighted], total[unweighted] = np.eye(4), 1.0
    with np.errstate(invalid="ignore", over="ignore"):  # the scene checks that vertices are finite
        transforms /= total[:, None, None]
    return transforms


def joint_places(data: GltfData, skin: Json) -> NDArray[np.float64]:
    """Return the positions of a skin's joints where its mesh is not deformed, in the mesh's frame, ``(joints, 3)``."""
    item = data.one("skins", skin)
    if "inverseBindMatrices" not in item:
        return joint_matrices(data, skin)[:, :3, 3]
    inverse = data.accessor(item["inverseBindMatrices"])
    if inverse.shape[1] != 16 or len(inverse) < len(item["joints"]):
        raise ValueError(f"a skin of {len(item['joints'])} joints needs as many matrices, got {inverse.shape}")
    matrices = inverse[: len(item["joints"])].astype(np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
    return np.linalg.inv(matrices)[:, :3, 3].astype(np.float64)


def joint_matrices(data: GltfData, skin: Json) -> NDArray[np.float64]:
    """Return the matrices from a skin's mesh to the file's frame, one per joint, shape ``(joints, 4, 4)``."""
    item = data.one("skins", skin)
    joints = list(item["joints"])
    above = {child: index for index, node in enumerate(data.all("nodes")) for child in node.get("children", [])}
    places: dict[int, NDArray[np.float64]] = {}
    for joint in joints:
        chain = [joint]
        while chain[-1] in above and chain[-1] not in places:
            if len(chain) > len(data.all("nodes")):
                raise ValueError(f"node {joint} is below itself")
            chain.append(above[chain[-1]])
        for index in reversed(chain):
            if index not in places:
                local = node_matrix(data.one("nodes", index))
                places[index] = places[above[index]] @ local if index in above else local
    found = np.stack([places[joint] for joint in joints]) if joints else np.zeros((0, 4, 4))
    if "inverseBindMatrices" not in item:
        return found
    inverse = data.accessor(item["inverseBindMatrices"])
    if inverse.shape[1] != 16 or len(inverse) < len(joints):
        raise ValueError(f"a skin of {len(joints)} joints needs as many matrices, got {inverse.shape}")
    return found @ inverse[: len(joints)].astype(np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
