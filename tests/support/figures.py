# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of one's own: a skin of warpvis in the shape of SMPL and Mixamo, as arrays and as a GLB file."""

import numpy as np
from gltf_files import GltfWriter

from warpvis.situations import Body
from warpvis.situations.people._skeleton import PARENTS, SEGMENTS
from warpvis.situations.people._skin import make_skin

_TRUNK = {"pelvis": "Hips", "abdomen": "Spine", "chest": "Spine1", "neck": "Neck", "head": "Head"}
_LIMBS = {"upper_arm": "Arm", "forearm": "ForeArm", "hand": "Hand", "thigh": "UpLeg", "shank": "Leg", "foot": "Foot"}


def _mixamo(segment):
    if segment in _TRUNK:
        return f"mixamorig:{_TRUNK[segment]}"
    part, side = segment.rsplit("_", 1)
    return f"mixamorig:{side.title()}{_LIMBS[part]}"


def mixamo_arrays(body=None):
    """Return arguments of `Figure`: y up, facing z, with the names of Mixamo."""
    skin = make_skin(body or Body(1.75, "male"))
    places = np.stack([skin.frames.origins[name][0] for name in SEGMENTS])
    parents = [-1 if PARENTS[name] is None else SEGMENTS.index(PARENTS[name]) for name in SEGMENTS]
    return {
        "vertices": skin.vertices[:, [1, 2, 0]],
        "faces": skin.faces,
        "joints": places[:, [1, 2, 0]],
        "parents": parents,
        "weights": skin.weights,
        "names": [_mixamo(name) for name in SEGMENTS],
    }


def write_glb(path, arrays):
    """Write a figure with a skin, of the four greatest weights of each vertex; return the weights that it has."""
    joints, parents = arrays["joints"], arrays["parents"]
    order = np.argsort(-arrays["weights"], axis=1, kind="stable")[:, :4]
    weights = np.take_along_axis(arrays["weights"], order, axis=1)
    weights = np.float32(weights / weights.sum(axis=1, keepdims=True))
    writer = GltfWriter(materials=[{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.4, 0.3, 1]}}])
    primitive = writer.primitive(arrays["vertices"], arrays["faces"], material=0)
    primitive["attributes"] |= {"JOINTS_0": writer.accessor(np.uint8(order)), "WEIGHTS_0": writer.accessor(weights)}
    first = 1
    children = [[first + k for k, parent in enumerate(parents) if parent == joint] for joint in range(len(joints))]
    inverse = np.tile(np.eye(4), (len(joints), 1, 1))
    inverse[:, :3, 3] = -joints
    writer.node(primitive, skin=0, name="body")
    for k, (name, parent) in enumerate(zip(arrays["names"], parents, strict=True)):
        offset = joints[k] - (joints[parent] if parent >= 0 else 0)
        more = {"children": children[k]} if children[k] else {}
        writer.node(name=name, translation=offset.tolist(), **more)
    view = writer.view(np.float32(inverse.swapaxes(1, 2)).tobytes())
    writer.content["accessors"].append(
        {"bufferView": view, "componentType": 5126, "count": len(joints), "type": "MAT4"}
    )
    writer.content["skins"] = [
        {"joints": list(range(first, first + len(joints))), "inverseBindMatrices": len(writer.content["accessors"]) - 1}
    ]
    path.write_bytes(writer.bytes(roots=[0, first]))
    full = np.zeros((len(weights), len(joints)))
    np.put_along_axis(full, order, weights.astype(np.float64), axis=1)
    return full
