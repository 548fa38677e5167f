# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials, textures and texture coordinates of Webots' Shapes.

Texture coordinates of Box, Plane, Cylinder, Cone, Sphere and ElevationGrid follow Webots' src/wren/StaticMesh.cpp,
whose v is downward; here v is upward. Those of a Mesh are in its file, and so are its normals. Extrusion, Capsule, UV
spheres and IndexedFaceSets without texCoord have none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.core.user_warnings import warn_user
from warpvis.errors import FileFormatError, WarpvisError
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Filter, Material, Texture, Wrap, linear_color
from warpvis.scene.normals import have_direction, transform_normals
from warpvis.webots._nodes import Node
from warpvis.webots.protos._appearances import stand_in_appearance, untextured_appearance
from warpvis.webots.shapes._mesh_attributes import mesh_attributes
from warpvis.webots.shapes._polygons import Points, Triangles, split_polygons, triangulate, tuples

Find = Callable[[str, Node], Path | None]
"""Finds the file of a node's URL; returns None if the file is not available."""

_WRAPS: dict[bool, Wrap] = {True: "repeat", False: "clamp"}

Corners = NDArray[np.float64]
"""Positions of the corners of triangles in the node's frame, z up [m], shape ``(m, 3, 3)``."""

APPEARANCES = ("PBRAppearance", "Appearance")
MESH_FILES = ("Mesh", "CadShape")
_MAPS = ("roughnessMap", "metalnessMap", "normalMap", "occlusionMap", "emissiveColorMap")


class AppearanceFiles:
    """The files of a world's appearances, which are read on first use; missing ones cause one warning per world."""

    def __init__(self, world: Path, find: Find, expand: Callable[[Node], Node | None]) -> None:
        """Store the world's file, and functions that find a node's file and expand an appearance PROTO."""
        self.find = find
        self._world, self._expand, self._has_warned = world, expand, False

    def resolve(self, node: Node) -> Node | None:
        """Return the PBRAppearance or Appearance of a node: expanded, or a stand-in; None for an unknown PROTO.

        A PROTO without a file, or a node whose texture is missing, gets a plausible color.
        """
        found = self._expand(node)
        texture = None if found is None else _texture_node(found)
        url = "" if texture is None else texture.texts("url")[0]
        if found is not None and (texture is None or self.find(url, texture) is not None):
            return found
        substitute = None if node.type in APPEARANCES else stand_in_appearance(node)
        called, reason = node.type, "file" if found is None else "texture"
        if substitute is None and found is not None:
            try:
                substitute = untextured_appearance(found, url)
                called, reason = f"an ImageTexture {url[-60:].rsplit('/')[-1]!r}", "file"
            except WarpvisError:  # does not affect depth
                return found
        if substitute is not None:
            self._warn(f"used a stand-in color for {called}, whose {reason} was not found")
        elif found is None:
            self._warn(f"used white for {node.type}, whose file was not found")
        return substitute or found

    def _warn(self, message: str) -> None:
        if not self._has_warned:
            self._has_warned = True
            warn_user(f"{self._world}: {message}", UserWarning)


def shape_appearance(shape: Node) -> Node | None:
    """Return the appearance node of a Shape; None if it is missing or invalid."""
    try:
        return shape.node("appearance")
    except WarpvisError:  # does not affect depth
        return None


class Surface(NamedTuple):
    """A Shape's appearance and mesh."""

    appearance: Node | None
    geometry: Node
    mesh: Triangles  # in the geometry's frame
    placed: Triangles  # in the world
    level: bool  # whether it is a level surface near the ground
    linear: NDArray[np.float64]  # linear part of the transform from the geometry's frame to the world, ``(3, 3)``

    @property
    def is_mirrored(self) -> bool:
        """Whether the corners of triangles are reversed in the world."""
        return self.placed[1] is not self.mesh[1]

    def normals(self, find: Find) -> NDArray[np.float64] | None:
        """Return the normals of a mesh file at the triangles' corners in the world, ``(m, 3, 3)``; None without any.

        Invalid ones are replaced by those of the triangles.
        """
        if self.geometry.type not in MESH_FILES:
            return None
        try:
            found = mesh_attributes(self.geometry, find).normals
        except WarpvisError:  # does not affect depth
            return None
        if found is None or len(found) != len(self.mesh[1]):
            return None
        rows = transform_normals(found[:, ::-1] if self.is_mirrored else found, self.linear)
        is_bad = ~have_direction(rows)
        rows[is_bad] = np.repeat(self.flat_normals()[:, None], 3, axis=1)[is_bad]
        return rows

    def flat_normals(self) -> NDArray[np.float64]:
        """Return the normals of the triangles in the world, shape ``(m, 3)``; up for triangles without area."""
        vertices, faces = self.placed
        a, b, c = (vertices[faces[:, number]] for number in range(3))
        flat = np.cross(b - a, c - a)
        flat[~have_direction(flat)] = (0.0, 0.0, 1.0)
        return flat

    def coordinates(self, find: Find) -> NDArray[np.float32] | None:
        """Return texture coordinates of the triangles' corners; None without a texture or coordinates."""
        if self.appearance is None or not any(_texture_nodes(self.appearance)):
            return None
        try:
            if self.geometry.type in MESH_FILES:
                rows = mesh_attributes(self.geometry, find).uv
                if rows is None or len(rows) != len(self.mesh[1]):
                    return None
                uv: NDArray[np.float32] | None = (rows[:, ::-1] if self.is_mirrored else rows).astype(np.float32)
            else:
                uv = texture_coordinates(self.geometry, *self.mesh, mirrored=self.is_mirrored)
            change = self.appearance.node("textureTransform")
            return uv if uv is None or change is None else _transformed(uv, change)
        except WarpvisError:  # does not affect depth
            return None


def join_appearances(surfaces: Sequence[Surface], files: AppearanceFiles) -> LazyAppearance | None:
    """Return the deferred appearance of an object of shapes, in the order of its triangles; None if it has none."""
    shown = any(item.appearance or item.geometry.type in MESH_FILES for item in surfaces)
    return LazyAppearance(partial(_joined, surfaces, files)) if shown else None


def _joined(surfaces: Sequence[Surface], files: AppearanceFiles) -> Appearance | None:
    nodes = {id(item.appearance): item.appearance for item in surfaces}
    resolved = {key: None if node is None else files.resolve(node) for key, node in nodes.items()}
    surfaces = [surface._replace(appearance=resolved[id(surface.appearance)]) for surface in surfaces]
    numbers: dict[int, int] = {}
    found: list[Material | None] = []
    rows: list[NDArray[np.int32]] = []
    for surface in surfaces:
        node = surface.appearance
        if id(node) not in numbers:
            numbers[id(node)] = len(found)
            found.append(None if node is None else _material(node, files.find))
        rows.append(np.full(len(surface.mesh[1]), numbers[id(node)], dtype=np.int32))
    normal_parts = [surface.normals(files.find) for surface in surfaces]
    normals = None
    if any(part is not None for part in normal_parts):
        pairs = zip(surfaces, normal_parts, strict=True)
        normals = np.concatenate(
            [np.repeat(one.flat_normals()[:, None], 3, axis=1) if rows is None else rows for one, rows in pairs]
        )
    if not any(found) and normals is None:
        return None
    parts = [surface.coordinates(files.find) for surface in surfaces]
    uv = None
    if any(part is not None for part in parts):
        sizes = [len(row) for row in rows]
        uv = np.concatenate(
            [np.zeros((size, 3, 2)) if part is None else part for part, size in zip(parts, sizes, strict=True)]
        )
    materials = tuple(item or Material() for item in found)
    return Appearance(materials, np.concatenate(rows) if len(found) > 1 else None, uv=uv, normals=normals)


def _material(appearance: Node, find: Find) -> Material | None:
    """Read the material of an appearance node; return None if it has none or cannot be read."""
    try:
        texture = _texture(_texture_node(appearance), find)
        if appearance.type == "PBRAppearance":
            return _pbr(appearance, texture, find)
        if appearance.type != "Appearance":
            return None
        node = appearance.node("material")
        if node is not None:
            return _classic(node, texture)
        return None if texture is None else Material(texture=texture, tone_mapped=True)
    except WarpvisError:  # does not affect depth
        return None


def _texture_nodes(appearance: Node) -> Iterator[Node | None]:
    """Return the ImageTextures of an appearance node."""
    yield _texture_node(appearance)
    if appearance.type == "PBRAppearance":
        yield from (_texture_node(appearance, field) for field in _MAPS)


def _texture_node(appearance: Node, field: str | None = None) -> Node | None:
    """Return the ImageTexture of an appearance node, by default of its color; None if it is missing or invalid."""
    try:
        found = appearance.node(field or ("baseColorMap" if appearance.type == "PBRAppearance" else "texture"))
    except WarpvisError:  # does not affect depth
        return None
    return found if found is not None and found.type == "ImageTexture" and found.texts("url") else None


def _texture(node: Node | None, find: Find) -> Texture | None:
    """Read an ImageTexture (Webots' reference, imagetexture.md)."""
    if node is None:
        return None
    url = node.texts("url")[0]
    file = find(url, node)
    wrap_u, wrap_v = (_WRAPS[node.flag(field, True)] for field in ("repeatS", "repeatT"))
    smooth: Filter = "linear" if node.number("filtering", 4) > 0 else "nearest"
    return Texture(b"" if file is None else file, url if file is None else str(file), wrap_u, wrap_v, smooth)


def _transformed(uv: NDArray[np.float32], change: Node) -> NDArray[np.float32]:
    """Apply a TextureTransform: translate, then rotate and scale about the center (src/wren/TextureTransform.cpp)."""
    center, move = change.vector("center", (0.0, 0.0)), change.vector("translation", (0.0, 0.0))
    angle, scale = change.number("rotation", 0.0), change.vector("scale", (1.0, 1.0))
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (((uv + move + center) @ rotation.T) * scale - center).astype(np.float32)


def _map(node: Node, field: str, find: Find) -> Texture | None:
    """Read a map of a PBRAppearance, whose colors are linear; None if its file is not available."""
    found = _texture_node(node, field)
    if found is None or find(found.texts("url")[0], found) is None:
        return None
    return replace(_texture(found, find), color_space="linear")  # type: ignore[type-var]  # the node has a file


def _pack_maps(roughness: Texture | None, metalness: Texture | None) -> Texture | None:
    """Join maps of roughness and metalness, both red, to one as in glTF: green and blue, at the larger size."""
    from PIL import Image

    first = roughness or metalness
    if first is None:
        return None
    found = [None if item is None else item.image[..., 0] for item in (roughness, metalness)]
    height, width = (max(item.shape[axis] for item in found if item is not None) for axis in (0, 1))
    packed = np.full((height, width, 3), 255, dtype=np.uint8)
    for channel, image in enumerate(found, 1):
        if image is not None:
            packed[..., channel] = np.asarray(Image.fromarray(image).resize((width, height), Image.Resampling.BILINEAR))
    return replace(first, source=packed)


def _pbr(node: Node, texture: Texture | None, find: Find) -> Material:
    """Read a PBRAppearance; maps replace numbers, as in Webots (resources/wren/shaders/pbr.frag)."""
    strength = max(0.0, node.number("emissiveIntensity", 1.0))
    alpha = 1 - _unit(node.number("transparency", 0.0))
    roughness, metalness, normal, occlusion, glow = (_map(node, field, find) for field in _MAPS)
    emission = np.clip(node.vector("emissiveColor", (0.0, 0.0, 0.0)), 0.0, 1.0) if glow is None else np.ones(3)
    return Material(
        node.text("name", "") or node.name or "",
        (*_color(node, "baseColor", (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        metallic=_unit(node.number("metalness", 1.0)) if metalness is None else 1.0,
        roughness=_unit(node.number("roughness", 0.0)) if roughness is None else 1.0,
        emission=tuple((strength * emission).tolist()),
        metallic_roughness_texture=_pack_maps(roughness, metalness),
        normal_texture=normal,
        normal_scale=node.number("normalMapFactor", 1.0),
        occlusion_texture=occlusion,
        occlusion_strength=_unit(node.number("occlusionMapStrength", 1.0)),
        emissive_texture=glow,
        shading="webots",
        ambient_strength=max(0.0, node.number("IBLStrength", 1.0)),
        tone_mapped=True,
    )


def _classic(node: Node, texture: Texture | None) -> Material:
    """Read a Material; a texture replaces its colors (src/webots/nodes/WbMaterial.cpp)."""
    alpha = 1 - _unit(node.number("transparency", 0.0))
    plain = texture is None
    return Material(
        node.name or "",
        (*(_color(node, "diffuseColor", (0.8, 0.8, 0.8)) if plain else (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        specular=_color(node, "specularColor", (0.0, 0.0, 0.0)) if plain else (0.0, 0.0, 0.0),
        shininess=128 * _unit(node.number("shininess", 0.2)) if plain else 0.0,  # the exponent of OpenGL
        emission=_color(node, "emissiveColor", (0.0, 0.0, 0.0)),
        tone_mapped=True,
    )


def _color(node: Node, field: str, default: tuple[float, float, float]) -> tuple[float, float, float]:
    """Read a color as linear RGB, as Webots converts it (src/wren/PhongMaterial.cpp, PbrMaterial.cpp)."""
    return linear_color(np.clip(node.vector(field, default), 0.0, 1.0))  # type: ignore[return-value]


def _unit(value: float) -> float:
    return float(np.clip(value, 0.0, 1.0))


def texture_coordinates(
    node: Node, vertices: Points, faces: NDArray[np.integer], *, mirrored: bool = False
) -> NDArray[np.float32] | None:
    """Compute texture coordinates of the corners of a node's triangles, shape ``(m, 3, 2)``; None if it has none.

    `mirrored` reverses the corners of every triangle, for a mirroring transform.
    """
    found: NDArray[np.float64] | None = None
    if node.type == "IndexedFaceSet":
        found = _indexed(node)
    elif node.type in _SHAPES:
        corners = vertices[faces]
        if not node.version.z_up:
            x, y, z = np.moveaxis(corners, -1, 0)
            corners = np.stack([x, -z, y], axis=-1)
        found = _SHAPES[node.type](node, corners)
    if found is None or len(found) != len(faces):
        return None
    return (found[:, ::-1] if mirrored else found).astype(np.float32)


def _scaled(corners: Corners) -> Corners:
    """Scale positions around the origin to the range -1 to 1 along all axes."""
    sizes = np.abs(corners).max(axis=(0, 1))
    return corners / np.where(sizes > 0, sizes, 1.0)


def _box(node: Node, corners: Corners) -> NDArray[np.float64]:
    flat = np.ptp(corners, axis=1) == 0
    side, rows = flat.argmax(axis=1), np.arange(len(corners))
    ahead = np.sign(corners[rows, 0, side])[:, None]
    x, y, z = np.moveaxis(_scaled(corners), -1, 0)
    u = np.choose(side[:, None], [ahead * y, -ahead * x, x])
    v = np.choose(side[:, None], [z, z, ahead * y])
    return np.stack([u, v], axis=-1) / 2 + 0.5


def _plane(node: Node, corners: Corners) -> NDArray[np.float64]:
    return _scaled(corners)[..., :2] / 2 + 0.5


def _around(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Compute the angle from y toward -x in revolutions.

    Triangles across the seam get values above 1, and corners at poles the mean of the other corners.
    """
    share = np.arctan2(-x, y) / (2 * np.pi) % 1.0
    share[share > 1 - 1e-9] = 0.0
    pole = np.maximum(np.abs(x), np.abs(y)) < 1e-9
    low, high = np.where(pole, 1.0, share).min(axis=1), np.where(pole, 0.0, share).max(axis=1)
    share = np.where((high - low > 0.5)[:, None] & (share < 0.5), share + 1, share)
    mean = np.where(pole, 0.0, share).sum(axis=1) / np.maximum((~pole).sum(axis=1), 1)
    return np.where(pole, mean[:, None], share)


def _cylinder(node: Node, corners: Corners) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(_scaled(corners), -1, 0)
    side = np.stack([_around(x, y), z / 2 + 0.5], axis=-1)
    cap = np.stack([x, np.sign(z) * y], axis=-1) / 2 + 0.5
    return np.where((np.ptp(z, axis=1) == 0)[:, None, None], cap, side)


def _cone(node: Node, corners: Corners) -> NDArray[np.float64]:
    x, y, z = np.moveaxis(_scaled(corners), -1, 0)
    count = node.integer("subdivision", 12)
    around, apex = _around(x, y), z > 0
    # The lower corners are offset by one segment, unlike the apex.
    side = np.stack([np.where(apex, around, around - 1 / count), z / 2 + 0.5], axis=-1)
    cap = np.stack([x, -y], axis=-1) / 2 + 0.5
    return np.where((np.ptp(z, axis=1) == 0)[:, None, None], cap, side)


def _sphere(node: Node, corners: Corners) -> NDArray[np.float64] | None:
    if not node.flag("ico", True):
        return None
    x, y, z = np.moveaxis(corners / np.linalg.norm(corners, axis=-1, keepdims=True), -1, 0)
    return np.stack([_around(x, y), 0.5 + np.arcsin(np.clip(z, -1, 1)) / np.pi], axis=-1)


def _elevation_grid(node: Node, corners: Corners) -> NDArray[np.float64]:
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    return (corners[..., :2] - low) / (high - low)


def _indexed(node: Node) -> NDArray[np.float64] | None:
    """Return the coordinates of an IndexedFaceSet's triangles, in the order of `indexed_face_set`."""
    coordinates, coordinate = node.node("texCoord"), node.node("coord")
    if coordinates is None or coordinate is None:
        return None
    rows, points = tuples(coordinates, "point", 2, ()), tuples(coordinate, "point", 3, ())
    index = node.numbers("coordIndex").astype(np.int64)
    numbers = node.numbers("texCoordIndex").astype(np.int64) if len(node.numbers("texCoordIndex")) else index
    index, numbers = (row if len(row) and row[-1] == -1 else np.append(row, -1) for row in (index, numbers))
    inside = index >= 0
    if len(numbers) != len(index) or not ((numbers >= 0) == inside).all():
        raise FileFormatError(f"{node.place}: texCoordIndex must have the same polygons as coordIndex")
    if inside.any() and numbers.max() >= len(rows):
        raise FileFormatError(f"{node.place}: texCoordIndex must index the points of texCoord")
    # Corners instead of points, since each corner has its own coordinates.
    corners = np.where(inside, np.cumsum(inside) - 1, -1)
    faces = triangulate(node, points[index[inside]], split_polygons(corners), index[inside])
    if not node.flag("ccw", True):
        faces = faces[:, ::-1]
    return rows[numbers[inside]][faces]


_SHAPES: dict[str, Callable[[Node, Corners], NDArray[np.float64] | None]] = {
    "Box": _box,
    "Cone": _cone,
    "Cylinder": _cylinder,
    "ElevationGrid": _elevation_grid,
    "Plane": _plane,
    "Sphere": _sphere,
}
