# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Figures of glTF files: a skinned mesh with its joints, for custom people."""

from __future__ import annotations

import os
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, describe_exception
from warpvis.errors import FileFormatError, WarpvisError
from warpvis.io._gltf import attribute, is_skinned, morph_weights, triangles
from warpvis.io._gltf_data import GltfData
from warpvis.io._gltf_materials import GltfMaterials
from warpvis.io._gltf_placements import Rows, joint_places, morphed, nodes_in_order
from warpvis.io._meshes import file_finders
from warpvis.scene.materials import Appearance, Material
from warpvis.situations import Figure

_MAX_SETS = 16
"""Maximum number of sets of four joints each."""


def read_figure(
    path: str | os.PathLike[str],
    *,
    segments: Mapping[str, str] | None = None,
    height: float | None = None,
) -> Figure:
    """Read a person from a glTF or GLB file with a skin, to be posed as a `warpvis.situations.Person`.

    All skinned meshes are read, at rest: where the inverse bind matrices have the joints.

    Args:
        path: The file.
        segments: Names of joints by segment, where they are not common ones, as for `warpvis.situations.Figure`.
        height: Stature [m], to which the figure is scaled.

    Raises:
        FileFormatError: If the file is missing, does not parse, or has no skinned triangles.
        SceneError: If its joints are not those of a person.
    """
    file = as_path(path)
    if file.suffix.lower() not in (".glb", ".gltf"):
        raise FileFormatError(f"{file}: a figure must be a glTF file, .glb or .gltf")
    find, locate = file_finders(file)
    try:
        found = _read(file, file.read_bytes(), find, locate)
    except OSError as error:
        raise FileFormatError(f"{file}: cannot be read: {describe_exception(error)}") from None
    except WarpvisError:
        raise
    except Exception as error:  # malformed files may raise any exception
        raise FileFormatError(f"{file}: cannot be read as a figure: {describe_exception(error)}") from None
    try:
        return Figure(**found, segments=segments, height=height)
    except WarpvisError as error:
        raise type(error)(f"{file}: {error}") from None


def _read(file: Path, content: bytes, find: Any, locate: Any) -> dict[str, Any]:
    """Return the arguments of a `Figure`."""
    data = GltfData(content, find)
    materials = GltfMaterials(str(file), data, locate)
    primitives = [
        (node, primitive)
        for _, node, _ in nodes_in_order(data)
        if "mesh" in node
        for primitive in data.one("meshes", node["mesh"])["primitives"]
        if is_skinned(node, primitive)
    ]
    if not primitives:
        raise FileFormatError(f"{file}: has no skinned mesh, which a figure needs")
    # Meshes of one figure may have separate skins, with joints in common.
    placed: dict[int, NDArray[np.float64]] = {}
    for skin in dict.fromkeys(node["skin"] for node, _ in primitives):
        for joint, place in zip(data.one("skins", skin)["joints"], joint_places(data, skin), strict=True):
            placed.setdefault(int(joint), place)
    nodes, places = list(placed), np.stack(list(placed.values()))
    order, parents = _in_order(data, nodes)
    pieces = [_primitive(data, materials, node, primitive, nodes) for node, primitive in primitives]
    pieces = [piece for piece in pieces if len(piece[1])]
    if not pieces:
        raise FileFormatError(f"{file}: has no skinned triangles, which a figure needs")
    starts = np.cumsum([0, *(len(piece[0]) for piece in pieces)])
    return {
        "vertices": np.concatenate([piece[0] for piece in pieces]),
        "faces": np.concatenate([piece[1] + start for piece, start in zip(pieces, starts, strict=False)]),
        "joints": places[order],
        "parents": parents,
        "weights": np.concatenate([piece[2] for piece in pieces])[:, order],
        "names": [str(data.one("nodes", nodes[index]).get("name", f"joint_{index}")) for index in order],
        "appearance": _merged([(len(v), len(f), looks) for v, f, _, looks in pieces]),
    }


def _in_order(data: GltfData, nodes: list[int]) -> tuple[list[int], list[int]]:
    """Return the order of joints from the root on, and the parents of the ordered joints."""
    above = {child: index for index, node in enumerate(data.all("nodes")) for child in node.get("children", [])}
    known = {node: number for number, node in enumerate(nodes)}

    def parent(node: int) -> int | None:
        steps = 0
        while node in above and steps <= len(data.all("nodes")):
            node, steps = above[node], steps + 1
            if node in known:
                return node
        return None

    order: list[int] = []
    waiting = list(range(len(nodes)))
    while waiting:
        ready = [k for k in waiting if parent(nodes[k]) is None or known[parent(nodes[k])] in order]  # type: ignore[index]
        if not ready:
            raise ValueError("a joint is below itself")
        order += ready
        waiting = [k for k in waiting if k not in ready]
    roots = [k for k in order if parent(nodes[k]) is None]
    place = {k: number for number, k in enumerate(order)}
    parents = []
    for k in order:
        found = parent(nodes[k])
        # Joints without a common ancestor move with the first root.
        parents.append((-1 if k == roots[0] else place[roots[0]]) if found is None else place[known[found]])
    return order, parents


def _primitive(
    data: GltfData, materials: GltfMaterials, node: dict[str, Any], primitive: dict[str, Any], nodes: list[int]
) -> tuple[NDArray[np.float64], NDArray[np.integer], NDArray[np.float64], Appearance]:
    """Return vertices, faces, weights and appearance of a skinned primitive."""
    vertices, faces = triangles(data, primitive)
    if not len(faces):
        return vertices, faces, np.zeros((0, 0)), Appearance()
    vertices = morphed(data, vertices, "POSITION", primitive.get("targets"), morph_weights(data, node))
    rows = partial(attribute, data, primitive)
    joints = [int(joint) for joint in data.one("skins", node["skin"])["joints"]]
    own = _weights(len(vertices), primitive["attributes"], rows, len(joints))
    weights = np.zeros((len(vertices), len(nodes)))
    np.add.at(weights.T, [nodes.index(joint) for joint in joints], own.T)
    looks = materials.appearance(primitive, rows, len(vertices), f"mesh {node['mesh']}")
    return vertices, faces, weights, (None if looks is None else looks.get()) or Appearance()


def _weights(count: int, attributes: dict[str, Any], rows: Rows, joints: int) -> NDArray[np.float64]:
    total = np.zeros((count, joints))
    for number in range(_MAX_SETS):
        if f"JOINTS_{number}" not in attributes:
            break
        chosen, weights = rows(f"JOINTS_{number}").astype(np.int64), rows(f"WEIGHTS_{number}").astype(np.float64)
        if not chosen.shape == weights.shape == (count, 4):
            raise ValueError(f"a skin needs 4 joints and weights of {count} vertices each, got {weights.shape}")
        if chosen.size and not 0 <= chosen.min() <= chosen.max() < joints:
            raise ValueError(f"a vertex moves with joint {chosen.max()} of {joints}")
        for column in range(4):
            np.add.at(total, (np.arange(count), chosen[:, column]), weights[:, column])
    return total


def _merged(pieces: list[tuple[int, int, Appearance]]) -> Appearance:
    """Return one appearance of several meshes, one after the other; pieces are numbers of vertices and faces."""
    if len(pieces) == 1:
        return pieces[0][2]
    materials: list[Material] = []
    numbers, corners, colors = [], [], []
    for vertices, faces, looks in pieces:
        own = np.zeros(faces, np.int32) if looks.face_materials is None else looks.face_materials
        numbers.append(own + len(materials))
        materials += looks.materials
        # Texture coordinates of glTF are those of vertices.
        corners.append(np.zeros((vertices, 2), np.float32) if looks.uv is None else looks.uv)
        shades = looks.vertex_colors
        if shades is None:
            shades = np.ones((vertices, 4), np.float32)
        colors.append(shades / np.float32(255) if shades.dtype == np.uint8 else shades)
    has_colors = any(looks.vertex_colors is not None for _, _, looks in pieces)
    return Appearance(
        materials=tuple(materials),
        face_materials=np.concatenate(numbers),
        uv=np.concatenate(corners),
        vertex_colors=np.concatenate(colors).astype(np.float32) if has_colors else None,
    )
