# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The shape of glTF's meshes while nothing is animated: morph targets by their weights, skins by their joints' nodes.

Sections are those of the glTF 2.0 specification. What is wrong is a `ValueError` of one sentence.
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
"""Of four joints each."""


def morphed(data: GltfData, vertices: NDArray[np.float64], targets: Json, weights: Json) -> NDArray[np.float64]:
    """Move vertices by morph targets (3.7.2.2), of which those count that have a weight.

    Args:
        data: The file.
        vertices: Shape ``(n, 3)``.
        targets: The primitive's.
        weights: The node's, or else the mesh's; none if neither has any.
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
    """Move vertices with the joints of their skin (3.7.3.3), to the frame of the file.

    Where all of a vertex's weights are 0, it stays.

    Args:
        vertices: Shape ``(n, 3)``.
        attributes: The primitive's: ``JOINTS_0``, ``WEIGHTS_0``, ``JOINTS_1``, ...
        rows: Reads one of them.
        joints: Of `joint_matrices`.
    """
    turn, total = np.zeros((len(vertices), 4, 4)), np.zeros(len(vertices))
    for number in range(_MAX_SETS):
        if f"JOINTS_{number}" not in attributes:
            break
        chosen, weights = rows(f"JOINTS_{number}").astype(np.int64), rows(f"WEIGHTS_{number}").astype(np.float64)
        if not chosen.shape == weights.shape == (len(vertices), 4):
            raise ValueError(f"a skin needs 4 joints and weights of {len(vertices)} vertices each, got {weights.shape}")
        if chosen.size and not 0 <= chosen.min() <= chosen.max() < len(joints):
            raise ValueError(f"a vertex moves with joint {chosen.max()} of {len(joints)}")
        for column in range(4):
            turn += weights[:, column, None, None] * joints[chosen[:, column]]
        total += weights.sum(axis=1)
    still = ~(np.abs(total) > 0)
    turn[still], total[still] = np.eye(4), 1.0
    with np.errstate(invalid="ignore", over="ignore"):  # the scene says what is not finite
        turn /= total[:, None, None]
        return np.einsum("vij,vj->vi", turn[:, :3, :3], vertices) + turn[:, :3, 3]


def joint_matrices(
    data: GltfData, skin: Json, transform: Callable[[dict[str, Any]], NDArray[np.float64]]
) -> NDArray[np.float64]:
    """Make the matrices from a skin's mesh to the file's frame, one a joint, shape ``(joints, 4, 4)``.

    Args:
        data: The file.
        skin: Its number.
        transform: Makes the matrix from a node to its parent.
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
                own = transform(data.one("nodes", index))
                places[index] = places[above[index]] @ own if index in above else own
    found = np.stack([places[joint] for joint in joints]) if joints else np.zeros((0, 4, 4))
    if "inverseBindMatrices" not in item:
        return found
    inverse = data.accessor(item["inverseBindMatrices"])
    if inverse.shape[1] != 16 or len(inverse) < len(joints):
        raise ValueError(f"a skin of {len(joints)} joints needs as many matrices, got {inverse.shape}")
    return found @ inverse[: len(joints)].astype(np.float64).reshape(-1, 4, 4).swapaxes(1, 2)
