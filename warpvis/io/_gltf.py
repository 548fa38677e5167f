# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""glTF 2.0: meshes at their nodes, named as the file names them, in the file's order.

trimesh's reader draws names by lot where a mesh has several materials, and takes for zeros, or leaves out, what it
cannot read (sparse, normalized and compressed accessors, triangle fans, what hangs below a camera). Sections are those
of the glTF 2.0 specification.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import Json
from warpvis.io._file_meshes import FileMesh, FileMeshes
from warpvis.io._gltf_data import DRACO, MESHOPT, Find, GltfData, decode_draco
from warpvis.io._gltf_rest import joint_matrices, morphed, skinned
from warpvis.scene import keep_winding

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_INSTANCES = "EXT_mesh_gpu_instancing"
_READ = {DRACO, *MESHOPT, "KHR_mesh_quantization", "KHR_node_visibility", _INSTANCES}

# Nodes that are children of several others, which the specification forbids and files have, can stand for any number,
# and so can instances: their accessors may be of zeros that no bytes of the file stand for.
_MOST_NODES = 1_000_000
_MOST_INSTANCES = 100_000
_MOST_CORNERS = 100_000_000
"""Of all instances of a mesh."""

# Extensions that change colours, lights, motion or notes, and no triangle at rest.
_HARMLESS = re.compile(
    r"[A-Z0-9]+_(materials?|textures?|lights?|image|animation|audio|physics|interactivity|xmp)(_|$)"
    r"|KHR_(xmp\w*|techniques_webgl|node_selectability|node_hoverability)$"
    r"|EXT_(mesh_features|structural_metadata|instance_features|mesh_manifold)$"
)


def read_gltf(file: bytes, find: Find) -> FileMeshes:
    """Read the meshes of a file's default scene, in the order of its nodes: parents first, each with its children.

    Args:
        file: Its bytes, ``.gltf`` or ``.glb``.
        find: Finds the buffers that it names.

    Raises:
        ValueError: It does not parse, or needs an extension that is not read; any other exception that what is no
            glTF leads to.
    """
    data = GltfData(file, find)
    unread = [name for name in data.names("extensionsRequired") if name not in _READ and not _HARMLESS.match(name)]
    if unread:
        raise ValueError(f"it requires the extension {unread[0]}, which is not read")
    found = FileMeshes(up="y")
    for index, node, placement in _nodes(data):
        if "mesh" in node:
            _add_mesh(data, index, node, placement, found)
    return found


def _nodes(data: GltfData) -> Iterator[tuple[int, dict[str, Any], NDArray[np.float64]]]:
    """Go through the visible nodes of the default scene (3.5): index, node, and its matrix to the file's frame."""
    open_nodes = [(index, np.eye(4), 1) for index in reversed(_roots(data))]
    for count in itertools.count():
        if not open_nodes:
            return
        index, above, depth = open_nodes.pop()
        node = data.one("nodes", index)
        if depth > len(data.all("nodes")):
            raise ValueError(f"node {index} is below itself")
        if count >= _MOST_NODES:
            raise ValueError(f"its nodes stand in more than {_MOST_NODES} places")
        hides = (node.get("extensions") or {}).get("KHR_node_visibility") or {}
        if hides.get("visible", True) is False:
            continue
        placement = above @ _transform(node)
        yield index, node, placement
        open_nodes += [(child, placement, depth + 1) for child in reversed(node.get("children", []))]


def _roots(data: GltfData) -> list[int]:
    if data.all("scenes"):
        return list(data.one("scenes", data.get("scene", 0)).get("nodes", []))
    below = {child for node in data.all("nodes") for child in node.get("children", [])}
    return [index for index in range(len(data.all("nodes"))) if index not in below]


def _transform(node: dict[str, Any]) -> NDArray[np.float64]:
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


def _add_mesh(
    data: GltfData, index: int, node: dict[str, Any], placement: NDArray[np.float64], found: FileMeshes
) -> None:
    """Add the primitives of a node's mesh."""
    mesh = data.one("meshes", node["mesh"])
    name = str(node.get("name") or mesh.get("name") or "")
    extras = {**_said(mesh), **_said(node)}
    packed = (node.get("extensions") or {}).get(_INSTANCES)
    copies = None if packed is None else _instances(data, packed)
    joints = None if node.get("skin") is None else joint_matrices(data, node["skin"], _transform)
    weights = node.get("weights", mesh.get("weights"))
    for number, primitive in enumerate(mesh["primitives"]):
        own = name if len(mesh["primitives"]) == 1 else f"{name or f'node_{index}'}_{number}"
        vertices, faces = _triangles(data, primitive)
        if not len(faces):
            found.empty.append(own or f"node_{index}")
            continue
        vertices = morphed(data, vertices, primitive.get("targets"), weights)
        if joints is not None and "JOINTS_0" in primitive["attributes"]:
            rows = partial(_attribute, data, primitive)
            vertices = skinned(vertices, primitive["attributes"], rows, joints)
            placement = np.eye(4)  # the node's own does not count
        if copies is None:
            found.meshes.append(_placed(own, vertices, faces, placement, extras))
            continue
        if len(copies) * len(vertices) > _MOST_CORNERS:
            raise ValueError(f"the {len(copies)} instances of node {index} have more than {_MOST_CORNERS} corners")
        for copy, matrix in enumerate(copies):
            each = f"{own or f'node_{index}'}_{copy}"
            found.meshes.append(_placed(each, vertices, faces, placement @ matrix, extras))


def _placed(
    name: str,
    vertices: NDArray[np.float64],
    faces: NDArray[np.integer],
    placement: NDArray[np.float64],
    extras: dict[str, Any],
) -> FileMesh:
    with np.errstate(invalid="ignore", over="ignore"):  # the scene says what is not finite
        corners = vertices @ placement[:3, :3].T + placement[:3, 3]
    return FileMesh(name, corners, keep_winding(faces, placement[:3, :3]), extras)


def _instances(data: GltfData, packed: dict[str, Any]) -> NDArray[np.float64]:
    """Make the matrices from a node's instances to the node (EXT_mesh_gpu_instancing), shape ``(n, 4, 4)``."""
    attributes = packed["attributes"]
    counts = sorted({data.one("accessors", index)["count"] for index in attributes.values()})
    if len(counts) != 1 or not 0 <= counts[0] <= _MOST_INSTANCES:
        raise ValueError(
            f"{_INSTANCES}: all attributes must have one number of rows up to {_MOST_INSTANCES}, got {counts}"
        )
    rest = {"TRANSLATION": np.zeros(3), "ROTATION": np.array([0.0, 0, 0, 1]), "SCALE": np.ones(3)}
    move, turn, scale = (
        data.accessor(attributes[key]).astype(np.float64) if key in attributes else np.tile(row, (counts[0], 1))
        for key, row in rest.items()
    )
    for rows, row in zip((move, turn, scale), rest.values(), strict=True):
        if rows.shape[1] != len(row):
            raise ValueError(f"{_INSTANCES}: a place and a size are of 3 numbers, a turn is of 4, got {rows.shape[1]}")
    if not (np.linalg.norm(turn, axis=1) > 0).all():
        raise ValueError("an instance's rotation is of length 0")
    matrices = poses_to_matrices(np.concatenate([move, turn], axis=1))
    matrices[:, :3, :3] *= scale[:, None]
    if not np.isfinite(matrices).all():
        raise ValueError("an instance's placement is not finite")
    return matrices


def _said(item: dict[str, Any]) -> dict[str, Any]:
    extras = item.get("extras")
    return extras if isinstance(extras, dict) else {}


def _triangles(data: GltfData, primitive: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Read vertices and faces of a primitive (3.7.2); no faces if it is of points or lines."""
    attributes, mode = primitive.get("attributes", {}), primitive.get("mode", _TRIANGLES)
    nothing = np.zeros((0, 3)), np.zeros((0, 3), np.int32)
    if mode not in (_TRIANGLES, _STRIP, _FAN) or "POSITION" not in attributes:
        return nothing
    place, order = attributes["POSITION"], primitive.get("indices")
    packed = (primitive.get("extensions") or {}).get(DRACO)
    if packed is not None and not data.has_data(place):
        return _draco_triangles(data, packed, place)
    vertices = _points(data.accessor(place))
    corners: NDArray[np.integer] = np.arange(len(vertices), dtype=np.int64)
    if order is not None:
        numbers = data.accessor(order)
        if numbers.dtype.kind != "u" or numbers.shape[1] != 1:
            raise ValueError(f"indices must be whole numbers, got accessor {order}")
        corners = numbers[:, 0].astype(np.int64)
    return vertices, _faces(corners, mode)


def _draco_triangles(
    data: GltfData, packed: dict[str, Any], place: Json
) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    mesh = decode_draco(data.view(packed["bufferView"]).tobytes())
    positions = _draco_rows(mesh, packed, "POSITION")
    faces = getattr(mesh, "faces", None)
    if faces is None:
        raise ValueError(f"{DRACO}: the triangles are not there")
    return _points(data.scaled(positions, place)), np.asarray(faces, dtype=np.int64).reshape(-1, 3)


def _draco_rows(mesh: Any, packed: dict[str, Any], name: str) -> NDArray[np.generic]:
    found = [item["data"] for item in mesh.attributes if item["unique_id"] == packed["attributes"].get(name)]
    if not found:
        raise ValueError(f"{DRACO}: {name} is not there")
    return np.asarray(found[0])


def _attribute(data: GltfData, primitive: dict[str, Any], name: str) -> NDArray[np.generic]:
    """Read an attribute of a primitive's vertices."""
    place = primitive["attributes"][name]
    packed = (primitive.get("extensions") or {}).get(DRACO)
    if packed is None or data.has_data(place):
        return data.accessor(place)
    return data.scaled(_draco_rows(decode_draco(data.view(packed["bufferView"]).tobytes()), packed, name), place)


def _points(rows: NDArray[np.generic]) -> NDArray[np.float64]:
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise ValueError(f"positions must be of three numbers each, got {rows.shape[-1]}")
    return rows.astype(np.float64)


def _faces(corners: NDArray[np.integer], mode: int) -> NDArray[np.integer]:
    """Make triangles of a list of corners: three by three, a strip, or a fan (3.7.2.1)."""
    if mode == _TRIANGLES:
        if len(corners) % 3:
            raise ValueError(f"triangles must have three corners each, got {len(corners)} corners")
        return corners.reshape(-1, 3)
    count = max(0, len(corners) - 2)
    if mode == _FAN:
        return np.stack([corners[1 : count + 1], corners[2:], np.broadcast_to(corners[:1], (count,))], axis=1)
    odd = np.arange(count) % 2
    first = np.arange(count)
    return np.stack([corners[first], corners[first + 1 + odd], corners[first + 2 - odd]], axis=1)
