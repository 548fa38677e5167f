# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Device materials of a scene: the tables that `kernels.shading.base_colors` reads."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple, get_args

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.kernel_cache import launch
from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.scene._mesh import Mesh
from warpvis.scene._mip_levels import CUBE_SIDES, CUBE_WRAP, count_texels, mip_levels, pack_texels
from warpvis.scene._object import SceneObject
from warpvis.scene._reflectances import reflectances
from warpvis.scene.materials import (
    AlphaMode,
    Appearance,
    Filter,
    Material,
    MaterialMap,
    Projection,
    Shading,
    Texture,
    Wrap,
    linear_color,
)
from warpvis.scene.vertex_grids import device_grid

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceMaterials, PbrMaterial

_PLAIN = Appearance()
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_MAPS: tuple[MaterialMap, ...] = get_args(MaterialMap)
_TABLES = 5 + len(_MAPS)  # columns of `DeviceMaterials.object_rows`
_UNIFORM = (1.0, 1.0, 1.0)
_ROWS: dict[str, tuple[tuple[int, ...], type, type]] = {
    "planes": ((9,), np.float32, wp.float32),
    "uv": ((3, 2), np.float32, wp.vec2),
    "colors": ((3, 4), np.float32, wp.vec4),
    "normals": ((3, 3), np.float32, wp.vec3),
    "face_material": ((), np.int32, wp.int32),
    "texels": ((), np.uint32, wp.uint32),
}
"""Shapes and types of rows in tables, on the host and on the device."""


class _Column:
    """Rows of a table: their keys, and functions that make them."""

    def __init__(self) -> None:
        self.keys: list[Any] = []
        self._count = 0
        self._first: dict[Any, int] = {}
        self._makers: list[Callable[[], np.ndarray]] = []

    def add(self, key: Any, count: int, make: Callable[[], np.ndarray]) -> int:
        """Append rows unless the key is known, and return the index of the first one."""
        if key not in self._first:
            self._first[key] = self._count
            self.keys.append(key)
            self._makers.append(make)
            self._count += count
        return self._first[key]

    def rows(self, empty: np.ndarray) -> np.ndarray:
        """Make all rows; `empty` has their type."""
        return np.concatenate([empty, *(make() for make in self._makers)])


class _Deforming(NamedTuple):
    """A deforming object whose rows follow its vertices."""

    mesh: Mesh
    faces: wp.array
    frame: wp.transform
    """The frame of its normals and textures, in that of its vertices."""
    first_plane: int
    first_normal: int
    """-1 without normals that follow the vertices."""


class MaterialTables:
    """The appearances of all objects, with decoded textures, in tables that grow entry by entry and share data.

    They have an entry for each object, and then one for each alternative appearance of an object.
    """

    def __init__(
        self,
        objects: Sequence[SceneObject],
        movable: Sequence[int],
        device: wp.Device,
        earlier: MaterialTables | None = None,
        *,
        has_all_planes: bool = False,
    ) -> None:
        """Collect the tables of objects; columns that equal those of `earlier` tables share their arrays.

        With `has_all_planes`, they include the triangles of all meshes, which light at vertices needs.
        """
        self._has_all_planes = has_all_planes
        self._device, self._objects = device, objects
        self._columns = {index: column for column, index in enumerate(movable)}
        self._materials: list[Any] = []
        self._pbr: list[Any] = []  # one for each of them
        self._textures: list[Any] = []
        self._known: dict[Any, int] = {}
        self._alive: list[Any] = []  # keeps objects alive whose ids are keys
        self._tables = {name: _Column() for name in _ROWS}
        self._made: dict[str, tuple[list[Any], wp.array]] = {} if earlier is None else dict(earlier._made)
        self._level_first: list[int] = []
        self._mip_shapes: dict[Any, list[tuple[int, int]]] = {}
        self._earlier = earlier
        self._deforming: list[_Deforming] = []
        self.stretches = False
        """Whether materials depend on vertices that deform, so that the tables have to be made again."""
        self._entries: list[tuple[int, int, Any, Sequence[int]]] = []
        self._grids: list[Any] = []
        self._struct: DeviceMaterials | None = None
        self._is_layered = False  # whether surfaces may show what is behind them
        for index, item in enumerate(objects):
            self._add(index, item, item.appearance or _PLAIN)

    def entry(self, index: int, alternative: Material | Appearance) -> int:
        """Return the entry of an object with another appearance, or with another material on its own mesh."""
        key = ("entry", index, id(alternative))
        if key not in self._known:
            item = self._objects[index]
            other = alternative
            if isinstance(other, Material):
                own = item.appearance or _PLAIN
                other = Appearance((other,), uv=own.uv, normals=own.normals, vertex_grid=own.vertex_grid)
            self._known[key] = len(self._entries)
            self._alive.append((alternative, other))
            self._add(index, item, other)
        return self._known[key]

    def struct(self) -> DeviceMaterials:
        """Return the tables on the device, with the current vertices and normals of deforming objects."""
        if self._struct is None:
            self._struct = self._make_struct()
        self._refresh(self._struct)
        return self._struct

    def _refresh(self, tables: DeviceMaterials) -> None:
        """Write the current vertices and normals of deforming objects."""
        from warpvis.kernels.shading.deforming import find_planes

        for item in self._deforming:
            inputs = [item.mesh.source, item.faces, item.frame, item.first_plane, tables.planes]
            launch(find_planes, len(item.faces), inputs, self._device)
            if item.first_normal >= 0:
                wp.copy(tables.normals, item.mesh.normals, dest_offset=3 * item.first_normal)

    def _make_struct(self) -> DeviceMaterials:
        from warpvis.kernels.shading.base_colors import DeviceMaterial, DeviceMaterials, DeviceVertexGrid, PbrMaterial
        from warpvis.kernels.shading.textures import DeviceTexture

        first, column, pose, rows = zip(*self._entries, strict=True) if self._entries else ((),) * 4
        columns = {
            "object_material": (np.array(first, dtype=np.int32), wp.int32),
            "object_column": (np.array(column, dtype=np.int32), wp.int32),
            "object_pose": (np.array(pose, dtype=np.float32).reshape(-1, 7), wp.transform),
            "object_rows": (np.array(rows, dtype=np.int32).reshape(-1, _TABLES), wp.int32),
            "vertex_grids": (self._grids, DeviceVertexGrid),
            "materials": (self._materials, DeviceMaterial),
            "textures": (self._textures, DeviceTexture),
            "level_first": (np.array(self._level_first, dtype=np.int32), wp.int32),
            "linear_of": (np.array(linear_color(np.arange(256) / 255), dtype=np.float32), wp.float32),
        }
        tables = DeviceMaterials()
        for name, (values, dtype) in columns.items():
            setattr(tables, name, wp.array(values, dtype=dtype, device=self._device))
        for name, (shape, kind, dtype) in _ROWS.items():
            table = self._tables[name]
            if name not in self._made or self._made[name][0] != table.keys:
                array = wp.array(table.rows(np.zeros((0, *shape), dtype=kind)), dtype=dtype, device=self._device)
                self._made[name] = list(table.keys), array
            setattr(tables, name, self._made[name][1])
        tables.is_layered = self._is_layered
        if any(record.shading or record.tone_mapped for record in self._pbr):
            tables.pbr = wp.array(self._pbr, dtype=PbrMaterial, device=self._device)
            tables.reflectances = wp.array(reflectances(), dtype=wp.vec2, device=self._device)
        self._earlier = None
        return tables

    def _add(self, index: int, item: SceneObject, appearance: Appearance) -> None:
        """Append the entry of an object with an appearance."""
        objects = self._objects
        column = self._columns.get(index if item.parent is None else item.parent, -1)
        is_mapped_solid = item.solid is not None and appearance.uv is not None
        numbers = [self._material(material, item, objects, is_mapped_solid) for material in appearance.materials]
        first, rows = numbers[0], [-1] * _TABLES
        frame = _pose_in_parent(item, objects) if _has_own_frame(item, appearance) else None
        pose: Any = item.place if item.shares_mesh else _IDENTITY if frame is None else frame
        if appearance.face_materials is not None and len(set(numbers)) > 1:
            materials = np.array(numbers, dtype=np.int32)[appearance.face_materials]
            key: Any = (id(appearance.face_materials), *numbers)
            rows[3] = self._share("face_material", key, len(materials), lambda: materials, appearance)
        elif appearance.face_materials is not None and len(appearance.face_materials):
            first = numbers[int(appearance.face_materials[0])]
        self._add_rows(rows, item, appearance, frame)
        self._entries.append((first, column, pose, rows))
        place = None if item.shares_mesh or frame is not None else _pose_in_parent(item, objects)
        self._grids.append(device_grid(appearance.vertex_grid, item.solid, _IDENTITY if place is None else place))
        self._struct = None

    def _add_rows(
        self, rows: list[int], item: SceneObject, appearance: Appearance, frame: NDArray[np.float64] | None
    ) -> None:
        """Append the triangles of an object in a frame, and what its appearance has for them; write the first rows."""
        mesh, faces, count = item.mesh, item.faces, len(item.faces)
        uv, normals = appearance.uv, None if mesh.deforms else appearance.normals  # those of a deformed mesh differ
        colors = appearance.face_colors if appearance.vertex_colors is None else appearance.vertex_colors
        maps = {name for material in appearance.materials for name in maps_of(material)}
        is_textured = any(material.texture for material in appearance.materials) or bool(maps)
        has_normals = normals is not None or mesh.normals is not None
        has_planes = colors is not None or is_textured or has_normals or self._has_all_planes
        if item.solid is not None or not has_planes:
            return
        source = mesh.source if mesh.deforms else mesh.rounded
        empty = partial(np.zeros, (count, 9), dtype=np.float32)
        planes = empty if mesh.deforms else lambda: _planes(_in_frame(mesh.rounded, frame)[faces])
        key: Any = (id(source), None if frame is None else frame.tobytes(), id(faces))
        rows[0] = self._share("planes", key, count, planes, (mesh, source, faces))
        if uv is not None:
            rows[1] = self._share("uv", (id(uv), id(faces)), count, lambda: appearance.corner_uv(faces), appearance)
        for number, name in enumerate(_MAPS, _TABLES - len(_MAPS)):
            map_uv = appearance.map_uv.get(name, uv)
            if name in maps and map_uv is not None:
                make = partial(appearance.corner_uv, faces, name)
                rows[number] = self._share("uv", (id(map_uv), id(faces)), count, make, appearance)
        if colors is not None:
            key = (id(colors), id(faces))
            rows[2] = self._share("colors", key, count, lambda: _corner_colors(appearance, faces), appearance)
        if mesh.normals is not None:
            rows[4] = self._share("normals", (id(mesh), "deforms"), count, lambda: empty().reshape(-1, 3, 3), mesh)
        elif normals is not None:
            key = (id(normals), id(faces))
            rows[4] = self._share("normals", key, count, lambda: appearance.corner_normals(faces), appearance)
        if mesh.deforms:
            place = wp.transform(*(_IDENTITY if frame is None else frame.tolist()))
            device_faces = wp.array(faces, dtype=wp.int32, device=self._device)
            first_normal = rows[4] if mesh.normals is not None else -1
            self._deforming.append(_Deforming(mesh, device_faces, place, rows[0], first_normal))

    def _share(self, name: str, key: Any, count: int, make: Callable[[], Any], made_of: object) -> int:
        """Append rows unless the key is known, and return the index of the first one."""
        self._alive.append(made_of)
        return self._tables[name].add(key, count, make)

    def _material(
        self, material: Material, item: SceneObject, objects: Sequence[SceneObject], is_mapped_solid: bool
    ) -> int:
        from warpvis.kernels.shading.base_colors import DeviceMaterial

        scale = _cube_scale(material, item, objects)
        self.stretches |= item.points is not None and scale != _UNIFORM
        texture = material.texture
        has_mean = is_mapped_solid and texture is not None and material.projection == "uv"
        key = (id(material), scale, has_mean)
        if key not in self._known:
            record = DeviceMaterial()
            if has_mean and texture is not None:
                texture = _mean_texture(material, texture)
            record.color = wp.vec4(*material.base_color)
            record.is_linear = material.color_space == "linear"
            record.projection = get_args(Projection).index("plane" if has_mean else material.projection)
            record.texture = -1
            if texture is not None:
                sides = CUBE_SIDES if material.projection == "cube" else 1
                record.texture = self._texture(texture, sides, is_encoded=_is_encoded(material, texture))
            record.specular, record.shininess = wp.vec3(*material.specular), material.shininess
            if material.emissive_texture is None or material.shading != "phong":
                record.emission = wp.vec3(*material.emission)
            record.reflectance = material.reflectance
            record.alpha_mode, record.alpha_cutoff = (
                get_args(AlphaMode).index(material.alpha_mode),
                material.alpha_cutoff,
            )
            record.is_unlit = material.shading == "unlit"
            record.is_double_sided, record.blends_twice = material.double_sided, material.blends_twice
            self._is_layered |= material.alpha_mode != "opaque"
            record.repeat, record.scale = wp.vec2(*material.texture_repeat), wp.vec3(*scale)
            self._known[key] = len(self._materials)
            self._alive.append(material)
            self._materials.append(record)
            self._pbr.append(self._pbr_material(material))
        return self._known[key]

    def _pbr_material(self, material: Material) -> PbrMaterial:
        from warpvis.kernels.shading.base_colors import PbrMaterial

        record, maps = PbrMaterial(), maps_of(material)
        if material.shading != "unlit":  # which `DeviceMaterial` has
            record.shading, record.tone_mapped = get_args(Shading).index(material.shading), material.tone_mapped
        for name in ("metallic", "roughness", "ambient_strength", "normal_scale", "occlusion_strength"):
            setattr(record, name, getattr(material, name))
        textures = []
        for name in _MAPS:
            is_encoded = name == "emissive_texture" and name in maps and _is_encoded(material, maps[name])
            textures.append(self._texture(maps[name], 1, is_encoded=is_encoded) if name in maps else -1)
        record.maps = wp.vec4i(*textures)
        return record

    def _texture(self, texture: Texture, sides: int, *, is_encoded: bool) -> int:
        """Append a texture unless it is known, and return its index; `is_encoded` as of `mip_levels`."""
        from warpvis.kernels.shading.textures import DeviceTexture

        key = ("texture", id(texture), sides, is_encoded)
        if key not in self._known:
            known = None if self._earlier is None else self._earlier._mip_shapes.get(key)

            def make_levels() -> list[NDArray[np.uint8]]:
                return mip_levels(texture.image, sides, is_encoded=is_encoded, is_single=not texture.mipmaps)

            made = [make_levels()] if known is None else []
            shapes = known or [level.shape[:2] for level in made[0]]
            self._mip_shapes[key] = shapes

            def texels() -> NDArray[np.uint32]:
                levels = made.pop() if made else make_levels()
                return pack_texels(levels, sides)

            record = DeviceTexture()
            sizes = count_texels(shapes, sides)
            first = self._share("texels", key, sum(sizes), texels, texture)
            record.first_level, record.levels = len(self._level_first), len(shapes)
            self._level_first += (first + np.cumsum([0, *sizes[:-1]])).tolist()
            record.height, record.width = shapes[0]
            wraps = (get_args(Wrap).index(mode) for mode in (texture.wrap_u, texture.wrap_v))
            record.wrap_u, record.wrap_v = wraps if sides == 1 else (CUBE_WRAP, CUBE_WRAP)
            record.filter = get_args(Filter).index(texture.filter)
            record.is_linear = texture.color_space == "linear"
            self._known[key] = len(self._textures)
            self._textures.append(record)
        return self._known[key]


def _is_encoded(material: Material, texture: Texture) -> bool:
    """Return whether texels are converted to linear light."""
    return material.color_space == "linear" and texture.color_space == "srgb"


def _mean_texture(material: Material, texture: Texture) -> Texture:
    """Return one texel with the mean color of a texture, for solids, which have no triangles and no coordinates."""
    return replace(texture, source=mip_levels(texture.image, is_encoded=_is_encoded(material, texture))[-1])


def maps_of(material: Material) -> dict[MaterialMap, Texture]:
    """Return the textures that shading uses apart from that of the base color."""
    if material.shading in ("phong", "unlit"):
        return {}
    return {name: texture for name in _MAPS if (texture := getattr(material, name)) is not None}


def _has_own_frame(item: SceneObject, appearance: Appearance) -> bool:
    """Return whether shading uses the frame that an object was added in, and its vertices are in another frame."""
    by_frame = appearance.normals is not None or any(material.projection != "uv" for material in appearance.materials)
    return item.origin is not None and not item.shares_mesh and by_frame


def _pose_in_parent(item: SceneObject, objects: Sequence[SceneObject]) -> NDArray[np.float64] | None:
    """Return the pose an object was added with, in the world or in its parent's frame; None for the identity."""
    if item.shares_mesh:
        return None
    if item.origin is None or item.parent is None:
        return item.origin
    parent = objects[item.parent].pose
    assert parent is not None  # it is movable
    inner = np.linalg.inv(poses_to_matrices(parent.astype(np.float64))) @ poses_to_matrices(item.origin)
    return poses_to_opencv(inner[None])[0]


def _in_frame(vertices: NDArray[np.float32], origin: NDArray[np.float64] | None) -> NDArray[np.float32]:
    """Transform vertices from the world to the frame of a pose."""
    if origin is None:
        return vertices
    matrix = poses_to_matrices(origin)
    return ((vertices - matrix[:3, 3]) @ matrix[:3, :3]).astype(np.float32)


def _planes(corners: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return corner a of triangles, and the gradients of the barycentric weights of corners b and c, shape ``(m, 9)``.

    With the normal ``n = ab x ac``, the weight of b is ``(p - a) . (ac x n) / n^2``, and that of c is
    ``(p - a) . (n x ab) / n^2``; the gradients are 0 for triangles without an area.
    """
    a, b, c = corners.astype(np.float64).transpose(1, 0, 2)
    normal = np.cross(b - a, c - a)
    square = (normal**2).sum(axis=1, keepdims=True)
    square[square == 0] = np.inf
    return np.concatenate(
        [a, np.cross(c - a, normal) / square, np.cross(normal, b - a) / square],
        axis=1,
        dtype=np.float32,
        casting="same_kind",
    )


def shading_bounds(item: SceneObject, objects: Sequence[SceneObject]) -> NDArray[np.float32]:
    """Return the bounds of an object in the frame of textures without coordinates, ``(2, 3)`` [m]."""
    vertices = item.mesh.rounded if item.shares_mesh else _in_frame(item.mesh.rounded, _pose_in_parent(item, objects))
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def _corner_colors(appearance: Appearance, faces: NDArray[np.int32]) -> NDArray[np.float32]:
    """Return the colors of each corner of each face, from 0 to 1, shape ``(m, 3, 4)``."""
    if appearance.vertex_colors is not None:
        rows = appearance.vertex_colors[faces]
    else:
        assert appearance.face_colors is not None  # called only if there are colors
        rows = np.repeat(appearance.face_colors[:, None], 3, axis=1)
    return (rows.astype(np.float32) / np.float32(255 if rows.dtype == np.uint8 else 1)).astype(np.float32)


def _cube_scale(material: Material, item: SceneObject, objects: Sequence[SceneObject]) -> tuple[float, ...]:
    """Return the factors that turn coordinates into directions of a cube map.

    Unless `texture_uniform` is set, each axis is normalized by the object's half size, as MuJoCo does.
    """
    if material.texture is None or material.projection != "cube":
        return _UNIFORM
    if material.texture_uniform:
        return material.texture_stretch
    origin = _pose_in_parent(item, objects)
    half = np.abs(_in_frame(item.mesh.rounded, origin)).max(axis=0).astype(np.float64)
    return tuple((np.array(material.texture_stretch) / np.where(half > 0, half, 1.0)).tolist())
