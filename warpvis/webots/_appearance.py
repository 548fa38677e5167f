# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials, textures and texture coordinates of Webots' Shapes; lights and background of its worlds.

Webots converts the colors of lights and materials to linear RGB (src/wren/LightNode.cpp) and sums light in that space.
Fields and their defaults are those of its reference: light.md, directionallight.md, pointlight.md, spotlight.md, and
background.md. Texture coordinates of Box, Plane, Cylinder, Cone, Sphere and ElevationGrid follow its
src/wren/StaticMesh.cpp, whose v is downward; here v is upward. Extrusion, Capsule, UV spheres, IndexedFaceSets without
texCoord, and mesh files have none.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from warpvis.errors import FileFormatError, WarpvisError
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import Background, Light, LightKind
from warpvis.scene.materials import Appearance, Filter, Material, Texture, Wrap, linear_color
from warpvis.webots._nodes import Node, Transform
from warpvis.webots.shapes._polygons import Points, Triangles, split_polygons, triangulate, tuples

Find = Callable[[str, Node], Path | None]
"""Finds the file of a node's URL; returns None if the file is not available."""

_WRAPS: dict[bool, Wrap] = {True: "repeat", False: "clamp"}

Corners = NDArray[np.float64]
"""Positions of the corners of triangles in the node's frame, z up [m], shape ``(m, 3, 3)``."""

LIGHTS: dict[str, LightKind] = {"DirectionalLight": "directional", "PointLight": "point", "SpotLight": "spot"}

_SKY_FACES = ("right", "left", "top", "bottom", "front", "back")
"""Faces of a background, in the order of OpenGL's cube maps (src/webots/nodes/WbBackground.cpp)."""

# The shader samples (x, y, -z), resources/wren/shaders/skybox.frag. For worlds with z up, WbBackground.cpp swaps and
# rotates the images (gCoordinateSystemSwap, gCoordinateSystemRotate), which is equivalent to rotating the world.
_WORLD_TO_CUBE = {
    "y": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0)),
    "z": ((0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)),
}

_NO_ATTENUATION = (1.0, 0.0, 0.0)
_LOCATIONS = {"SpotLight": (0.0, 0.0, 10.0)}


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

    def coordinates(self) -> NDArray[np.float32] | None:
        """Return texture coordinates of the triangles' corners; None without a texture or coordinates."""
        if self.appearance is None or _texture_node(self.appearance) is None:
            return None
        try:
            uv = texture_coordinates(self.geometry, *self.mesh, mirrored=self.placed[1] is not self.mesh[1])
            change = self.appearance.node("textureTransform")
            return uv if uv is None or change is None else _transformed(uv, change)
        except WarpvisError:  # does not affect depth
            return None


def join_appearances(surfaces: Sequence[Surface], find: Find) -> LazyAppearance | None:
    """Return the deferred appearance of an object of shapes, in the order of its triangles; None if it has none."""
    return LazyAppearance(partial(_joined, surfaces, find)) if any(item.appearance for item in surfaces) else None


def _joined(surfaces: Sequence[Surface], find: Find) -> Appearance | None:
    numbers: dict[int, int] = {}
    found: list[Material | None] = []
    rows: list[NDArray[np.int32]] = []
    for surface in surfaces:
        node = surface.appearance
        if id(node) not in numbers:
            numbers[id(node)] = len(found)
            found.append(None if node is None else _material(node, find))
        rows.append(np.full(len(surface.mesh[1]), numbers[id(node)], dtype=np.int32))
    if not any(found):
        return None
    parts = [surface.coordinates() for surface in surfaces]
    uv = None
    if any(part is not None for part in parts):
        sizes = [len(row) for row in rows]
        uv = np.concatenate(
            [np.zeros((size, 3, 2)) if part is None else part for part, size in zip(parts, sizes, strict=True)]
        )
    materials = tuple(item or Material() for item in found)
    return Appearance(materials, np.concatenate(rows) if len(found) > 1 else None, uv=uv)


def _material(appearance: Node, find: Find) -> Material | None:
    """Read the material of an appearance node; return None if it has none or cannot be read."""
    try:
        texture = _texture(_texture_node(appearance), find)
        if appearance.type == "PBRAppearance":
            return _pbr(appearance, texture)
        if appearance.type != "Appearance":
            return None
        node = appearance.node("material")
        return _classic(node, texture) if node is not None else None if texture is None else Material(texture=texture)
    except WarpvisError:  # does not affect depth
        return None


def _texture_node(appearance: Node) -> Node | None:
    """Return the ImageTexture of an appearance node; None if it is missing or invalid."""
    try:
        found = appearance.node("baseColorMap" if appearance.type == "PBRAppearance" else "texture")
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


def _pbr(node: Node, texture: Texture | None) -> Material:
    strength = max(0.0, node.number("emissiveIntensity", 1.0))
    alpha = 1 - _unit(node.number("transparency", 0.0))
    return Material(
        node.text("name", "") or node.name or "",
        (*_color(node, "baseColor", (1.0, 1.0, 1.0)), alpha),
        "linear",
        texture,
        "blend" if alpha < 1 else "opaque",
        metallic=_unit(node.number("metalness", 1.0)),
        roughness=_unit(node.number("roughness", 0.0)),
        emission=tuple((strength * np.clip(node.vector("emissiveColor", (0.0, 0.0, 0.0)), 0.0, 1.0)).tolist()),
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


def read_lights(node: Node, transform: Transform) -> list[Light]:
    """Read a light and its ambient light; return an empty list if it is off or cannot be read.

    Directional lights are in the world frame, regardless of parent nodes; others in the frame of their node.
    """
    try:
        return _lights(node, transform) if node.flag("on", True) else []
    except WarpvisError:  # does not affect depth
        return []


def _lights(node: Node, transform: Transform) -> list[Light]:
    kind, name = LIGHTS[node.type], node.name or ""
    color = linear_color(np.clip(node.vector("color", (1.0, 1.0, 1.0)), 0, 1))
    attenuation = tuple(np.maximum(node.vector("attenuation", _NO_ATTENUATION), 0).tolist())
    ambient = max(0.0, node.number("ambientIntensity", 0.0))
    found = []
    if kind == "directional":
        attenuation = _NO_ATTENUATION
    elif attenuation != _NO_ATTENUATION:
        ambient = 0.0  # the reference allows only one of the two
    if ambient:
        added = tuple(ambient * part for part in color)
        found.append(Light("ambient", name, color=(0.0, 0.0, 0.0), ambient=added, color_space="linear"))  # type: ignore[arg-type]
    direction = node.vector("direction", (0.0, 0.0, -1.0))
    outer = float(np.clip(node.number("cutOffAngle", np.pi / 4), 0, np.pi / 2))
    place = transform.offset + transform.linear @ node.vector("location", _LOCATIONS.get(node.type, (0.0, 0.0, 0.0)))
    turned = transform.rotation @ direction if kind == "spot" else direction
    found.append(
        Light(
            kind,
            name,
            tuple(place.tolist()),
            tuple(turned.tolist()) if turned.any() else (0.0, 0.0, -1.0),
            color=color,  # type: ignore[arg-type]
            intensity=max(0.0, node.number("intensity", 1.0)),
            color_space="linear",
            falloff="webots",
            attenuation=attenuation if any(attenuation) else _NO_ATTENUATION,
            reach=np.inf if kind == "directional" else max(0.0, node.number("radius", 100.0)),
            inner_angle=float(np.clip(node.number("beamWidth", np.pi / 2), 0, outer)),
            outer_angle=outer,
            cast_shadow=node.flag("castShadows", False),
        )
    )
    return found


def read_background(node: Node, up: Literal["z", "y"], find: Callable[[str, Node], Path | None]) -> Background | None:
    """Read a Background; return None if it cannot be read. The sky is skipped unless all six images are available."""
    try:
        colors = node.numbers("skyColor")
        color = np.clip(colors[:3], 0, 1) if len(colors) >= 3 else np.zeros(3)
        luminosity = max(0.0, node.number("luminosity", 1.0))
        urls = [next(iter(node.texts(f"{face}Url")), "") for face in _SKY_FACES]
        files = [find(url, node) if url else None for url in urls]
    except WarpvisError:  # does not affect depth
        return None
    sky = tuple(Texture(file) for file in files if file is not None)
    return Background(
        tuple(color.tolist()),
        sky=sky if len(sky) == len(_SKY_FACES) else (),
        world_to_cube=_WORLD_TO_CUBE[up],
        luminosity=luminosity,
    )
