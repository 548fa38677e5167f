# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rest shape of glTF meshes without animation: morph targets by their weights, skins by their joints' nodes.

Section numbers are those of the glTF 2.0 specification. Errors are `ValueError` with a message of one sentence.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.types import Json
from warpvis.io._gltf_data import GltfData

Rows = Callable[[str], NDArray[np.generic]]
"""Reads an attribute of a primitive."""

_MAX_SETS = 16
"""Maximum number of sets of four joints each."""


def morphed(data: GltfData, vertices: NDArray[np.float64], targets: Json, weights: Json) -> NDArray[np.float64]:
    """Apply the morph targets (3.7.2.2) that have a nonzero weight.

    Args:
        data: The file.
        vertices: Shape ``(n, 3)``.
        targets: Targets of the primitive.
        weights: Weights of the node, or else of the mesh; None if neither has any.
    """
    if not (isinstance(targets, list) and isinstance(weights, list)):
        return vertices
    for target, weight in zip(targets, weights, strict=False):
        place = target.get("POSITION")
        if not weight or place is None or not data.has_data(place):
            continue
        moved = data.accessor(place)
        if moved.shape != vertices.shape:
            raise ValueError(f"a morph target must move {len(vertices)} vertices, got {moved.shape}")
        vertices = vertices + float(weight) * moved.astype(np.float64)
    return vertices


def skinned(
    vertices: NDArray[np.float64], attributes: dict[str, Any], rows: Rows, joints: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Apply the skin (3.7.3.3) to vertices; the result is in the file's frame.

    Vertices whose weights are all 0 do not move.

    Args:
        vertices: Shape ``(n, 3)``.
        attributes: Attributes of the primitive: ``JOINTS_0``, ``WEIGHTS_0``, ``JOINTS_1``, ...
        rows: Reads one of them.
        joints: Result of `joint_matrices`.
    """
    transforms, total = np.zeros((len(vertices), 4, 4)), np.zeros(len(vertices))
    for number in range(_MAX_SETS):
        if f"JOINTS_{number}" not in attributes:
            break
        chosen, weights = rows(f"JOINTS_{number}").astype(np.int64), rows(f"WEIGHTS_{number}").astype(np.float64)
        if not chosen.shape == weights.shape == (len(vertices), 4):
            raise ValueError(f"a skin needs 4 joints and weights of {len(vertices)} vertices each, got {weights.shape}")
        if chosen.size and not 0 <= chosen.min() <= chosen.max() < len(joints):
            raise ValueError(f"a vertex moves with joint {chosen.max()} of {len(joints)}")
        for column in range(4):
            transforms += weights[:, column, None, None] * joints[chosen[:, column]]
        total += weights.sum(axis=1)
    unweighted = ~(np.abs(total) > 0)
    transforms[unweighted], total[unweighted] = np.eye(4), 1.0
    with np.errstate(invalid="ignore", over="ignore"):  # the scene checks that vertices are finite
        transforms /= total[:, None, None]
        return np.einsum("vij,vj->vi", transforms[:, :3, :3], vertices) + transforms[:, :3, 3]


def joint_matrices(
    data: GltfData, skin: Json, transform: Callable[[dict[str, Any]], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Return the matrices from a skin's mesh to the file's frame, one per joint, shape ``(joints, 4, 4)``.

    Args:
        data: The file.
        skin: Index of the skin.
        transform: Returns the matrix from a node to its parent.
    """
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
                local = transform(data.one("nodes", index))
                places[index] = places[above[index]] @ local if index in above else local
    found = np.stack([places[joint] for joint in joints]) if joints else np.zeros((0, 4, 4))
    if "inverseBindMatrices" not in item:
        return found
    inverse = data.accessor(item["inverseBindMatrices"])
    if inverse.shape[1] != 16 or len(inverse) < len(joints):
        raise ValueError(f"a skin of {len(joints)} joints needs as many matrices, got {inverse.shape}")
    return found @ inverse[: len(joints)].astype(np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
