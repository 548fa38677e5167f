# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""glTF files with nodes, skins and instances."""

import numpy as np
from gltf_files import GltfWriter

from warpvis.core.poses import poses_to_matrices

ROWS = np.float32([[0, 0, 0], [1, 0, 0], [0, 2, 0]])
QUARTER = [0, 0, 0.5**0.5, 0.5**0.5]
"""A quarter turn about z."""


def matrix(turn=(0, 0, 0, 1), move=(0, 0, 0)):
    return poses_to_matrices(np.array([*move, *turn], dtype=np.float64))


def skinned(joints, weights, *, inverse=True, kind=np.uint8, **more):
    """Return a triangle with two joints: one at the origin, one at (0, 2, 0) rotated by 90 degrees."""
    writer = GltfWriter()
    at = {"POSITION": writer.accessor(ROWS)}
    at["JOINTS_0"] = writer.accessor(kind(joints))
    at["WEIGHTS_0"] = writer.accessor(weights, normalized=weights.dtype != np.float32)
    for name, rows in more.items():
        at[name] = writer.accessor(rows)
    lower = writer.node(name="lower", translation=[0, 0, 5], children=[1])
    upper = writer.node(name="upper", translation=[0, 2, 0], rotation=QUARTER)
    skin = {"joints": [lower, upper]}
    if inverse:
        bind = np.stack([np.linalg.inv(matrix()), np.linalg.inv(matrix(move=(0, 2, 0)))])
        skin["inverseBindMatrices"] = len(writer.content["accessors"])
        view = writer.view(np.float32(bind.swapaxes(1, 2)).tobytes())
        item = {"bufferView": view, "componentType": 5126, "count": len(bind), "type": "MAT4"}
        writer.content["accessors"].append(item)
    writer.content["skins"] = [skin]
    # The node transform of a skinned mesh is ignored (3.7.3.3).
    writer.node({"attributes": at}, name="arm", skin=0, translation=[100, 0, 0])
    return writer


WHOLE = np.float32([[1, 0, 0, 0], [1, 0, 0, 0], [1, 0, 0, 0]])
FIRST, SECOND = np.zeros((3, 4)), np.array([[1, 0, 0, 0]] * 3)
