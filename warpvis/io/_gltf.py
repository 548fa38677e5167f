# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""glTF 2.0: meshes at their nodes, with the names and the order of the file.

trimesh's reader generates random names where a mesh has several materials, and reads as zeros, or leaves out, what it
does not support (sparse, normalized and compressed accessors, triangle fans, children of cameras). Section numbers are
those of the glTF 2.0 specification.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.types import Json
from warpvis.io._gltf_data import DRACO, MESHOPT, Find, GltfData, decode_draco
from warpvis.io._gltf_lights import image_based_light, image_based_sky, node_light
from warpvis.io._gltf_materials import GltfMaterials, Locate
from warpvis.io._gltf_placements import (
    INSTANCES,
    Shape,
    Split,
    instance_matrices,
    joint_matrices,
    morphed,
    nodes_in_order,
    skin_transforms,
    skinned,
    split,
)
from warpvis.scene import Part
from warpvis.scene.appearances import FileNormals
from warpvis.scene.lights import Background, Light
from warpvis.scene.normals import transform_normals

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_READ = {DRACO, *MESHOPT, "KHR_mesh_quantization", "KHR_node_visibility", INSTANCES}

_MAX_CORNERS = 100_000_000
"""Maximum number of corners of all instances of a mesh that cannot share it."""

# Extensions that affect colors, lights, motion or metadata, but not triangles at rest.
_HARMLESS = re.compile(
    r"[A-Z0-9]+_(materials?|textures?|lights?|image|animation|audio|physics|interactivity|xmp)(_|$)"
    r"|KHR_(xmp\w*|techniques_webgl|node_selectability|node_hoverability)$"
    r"|EXT_(mesh_features|structural_metadata|instance_features|mesh_manifold)$"
)


@dataclass
class FileMeshes:
    """Contents of a mesh file."""

    parts: list[Part] = field(default_factory=list)
    """Meshes in the file's frame, or shared with others and their poses. A name is empty if the file has none; for
    glTF, it is that of the node, or else of the mesh, followed by the primitive's number if there are several."""
    empty: list[str] = field(default_factory=list)  # names of items without triangles
    notes: list[str] = field(default_factory=list)  # other items that were skipped, as parts of a sentence
    lights: list[Light] = field(default_factory=list)
    unlit: list[str] = field(default_factory=list)
    """Lights that cannot be read, and why, as parts of a sentence. Not an error even with ``strict``."""
    sky: Callable[[], Background | None] | None = None
    """Reads a sky that viewers of the format do not show by default."""
    up: str | None = None  # the file's vertical axis, if defined by its format or the file


def read_gltf(name: str, file: bytes, find: Find, locate: Locate) -> FileMeshes:
    """Read the meshes of a file's default scene, in depth-first order of its nodes.

    `name` is for warnings; `find` reads the buffers that the file references, `locate` finds the images. Malformed
    files may raise any exception.
    """
    data = GltfData(file, find)
    unread = [name for name in data.names("extensionsRequired") if name not in _READ and not _HARMLESS.match(name)]
    if unread:
        raise ValueError(f"it requires the extension {unread[0]}, which is not supported")
    materials = GltfMaterials(name, data, locate)
    found, shapes = FileMeshes(up="y"), _Shapes(data, materials, FileNormals(name))
    found.sky = partial(image_based_sky, name, data, materials.image)
    found.lights += image_based_light(data, found.unlit)
    places = []
    for index, node, placement in nodes_in_order(data):
        found.lights += node_light(data, index, node, placement, found.unlit)
        places += [(index, node, placement)] if "mesh" in node else []
    shared = np.array([placement for _, node, placement in places if shapes.is_shared(node)]).reshape(-1, 4, 4)
    parts = iter(split(shared).one_by_one())
    for index, node, placement in places:
        _add_mesh(shapes, index, node, placement, next(parts) if shapes.is_shared(node) else None, found)
    return found


class _Shapes:
    """The meshes of a file; meshes shared by several nodes are read once."""

    def __init__(self, data: GltfData, materials: GltfMaterials, normals: FileNormals) -> None:
        self.data, self._materials, self._normals = data, materials, normals
        nodes = [node for node in data.all("nodes") if isinstance(node, dict) and isinstance(node.get("mesh"), int)]
        self._uses = Counter(node["mesh"] for node in nodes)
        self._known: dict[tuple[int, int], Shape | None] = {}

    def is_shared(self, node: dict[str, Any]) -> bool:
        """Return whether other nodes use the same mesh with the same shape."""
        return self._uses[node["mesh"]] > 1 and node.get("skin") is None and "weights" not in node

    def of_primitive(self, node: dict[str, Any], number: int) -> Shape | None:
        """Return a primitive of a node's mesh; None if it consists of points or lines."""
        key = node["mesh"], number
        if self.is_shared(node):
            if key not in self._known:
                self._known[key] = self._read(node, number)
            return self._known[key]
        return self._read(node, number)

    def _read(self, node: dict[str, Any], number: int) -> Shape | None:
        data = self.data
        mesh = data.one("meshes", node["mesh"])
        primitive = mesh["primitives"][number]
        vertices, faces = _rest_shape(data, node, primitive)
        if not len(faces):
            return None
        rows, name = partial(attribute, data, primitive), f"mesh {node['mesh']}"
        appearance = self._materials.appearance(primitive, rows, len(vertices), name)
        if "NORMAL" in primitive["attributes"]:
            appearance = self._normals.add(
                appearance,
                name,
                partial(_rest_normals, data, node, primitive),
                partial(_rest_shape, data, node, primitive),
            )
        return Shape(vertices, faces, appearance)


def _rest_shape(
    data: GltfData, node: dict[str, Any], primitive: dict[str, Any]
) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Return vertices and faces of a primitive, morphed and skinned; no faces if it consists of points or lines."""
    vertices, faces = triangles(data, primitive)
    if not len(faces):
        return vertices, faces
    vertices = morphed(data, vertices, "POSITION", primitive.get("targets"), morph_weights(data, node))
    if is_skinned(node, primitive):
        vertices = skinned(vertices, _skin(data, node, primitive, len(vertices)))
    return vertices, faces


def _rest_normals(data: GltfData, node: dict[str, Any], primitive: dict[str, Any]) -> NDArray[np.float64]:
    """Return the normals of a primitive's vertices, morphed and skinned (3.7.2.1)."""
    normals = attribute(data, primitive, "NORMAL").astype(np.float64)
    normals = morphed(data, normals, "NORMAL", primitive.get("targets"), morph_weights(data, node))
    if not is_skinned(node, primitive):
        return normals
    return transform_normals(normals, _skin(data, node, primitive, len(normals))[:, :3, :3])


def _skin(data: GltfData, node: dict[str, Any], primitive: dict[str, Any], count: int) -> NDArray[np.float64]:
    rows = partial(attribute, data, primitive)
    return skin_transforms(count, primitive["attributes"], rows, joint_matrices(data, node["skin"]))


def morph_weights(data: GltfData, node: dict[str, Any]) -> Json:
    """Return the weights of a node's morph targets, its own or its mesh's; None if not given."""
    return node.get("weights", data.one("meshes", node["mesh"]).get("weights"))


def is_skinned(node: dict[str, Any], primitive: dict[str, Any]) -> bool:
    """Return whether a primitive of a node follows joints."""
    return node.get("skin") is not None and "JOINTS_0" in primitive["attributes"]


def _add_mesh(
    shapes: _Shapes,
    index: int,
    node: dict[str, Any],
    placement: NDArray[np.float64],
    shared: Split | None,
    found: FileMeshes,
) -> None:
    """Add the primitives of a node's mesh, which is shared with others if its placement is split."""
    mesh = shapes.data.one("meshes", node["mesh"])
    name = str(node.get("name") or mesh.get("name") or "")
    extras = {**_extras_of(mesh), **_extras_of(node)}
    packed = (node.get("extensions") or {}).get(INSTANCES)
    copies = None if packed is None else instance_matrices(shapes.data, packed)
    for number, primitive in enumerate(mesh["primitives"]):
        part_name = name if len(mesh["primitives"]) == 1 else f"{name or f'node_{index}'}_{number}"
        shape = shapes.of_primitive(node, number)
        if shape is None:
            found.empty.append(part_name or f"node_{index}")
            continue
        above = np.eye(4) if is_skinned(node, primitive) else placement  # transforms of skinned nodes are ignored
        if copies is not None:
            matrices = above @ copies
            parts = split(matrices)
            if parts.copies * len(shape.vertices) > _MAX_CORNERS:
                raise ValueError(f"the {len(copies)} instances of node {index} have more than {_MAX_CORNERS} corners")
            names = [f"{part_name or f'node_{index}'}_{copy}" for copy in range(len(copies))]
            found.parts += shape.shared(names, matrices, parts, extras, movable=True)
        elif shared is not None:
            found.parts += shape.shared([part_name], above[None], shared, extras, movable=False)
        else:
            found.parts.append(shape.placed(part_name, above, extras))


def _extras_of(item: dict[str, Any]) -> dict[str, Any]:
    extras = item.get("extras")
    return extras if isinstance(extras, dict) else {}


def triangles(data: GltfData, primitive: dict[str, Any]) -> tuple[NDArray[np.float64], NDArray[np.integer]]:
    """Read vertices and faces of a primitive (3.7.2); no faces if it consists of points or lines."""
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
        raise ValueError(f"{DRACO}: the triangles are missing")
    return _points(data.scaled(positions, place)), np.asarray(faces, dtype=np.int64).reshape(-1, 3)


def _draco_rows(mesh: Any, packed: dict[str, Any], name: str) -> NDArray[np.generic]:
    found = [item["data"] for item in mesh.attributes if item["unique_id"] == packed["attributes"].get(name)]
    if not found:
        raise ValueError(f"{DRACO}: {name} is missing")
    return np.asarray(found[0])


def attribute(data: GltfData, primitive: dict[str, Any], name: str) -> NDArray[np.generic]:
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
    """Convert a list of corners to triangles: three by three, a strip, or a fan (3.7.2.1)."""
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
