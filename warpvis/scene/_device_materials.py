# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Device materials of a scene: the tables that `kernels.shading.base_colors` reads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.poses import poses_to_matrices, poses_to_opencv
from warpvis.scene._object import SceneObject
from warpvis.scene.lights import Background, Falloff, Light
from warpvis.scene.materials import Appearance, Filter, Material, Projection, Texture, Wrap, linear_color, screen_color

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceMaterials
    from warpvis.kernels.shading.lighting import Lights

_PLAIN = Appearance()
_IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
_SIDES = 6  # faces of a cube map
_ENDLESS = 3e38  # about the largest single-precision number [m]
_LIGHT_KINDS = ("ambient", "directional", "point", "spot", "headlight")
"""In the order of `kernels.shading.lighting`."""


class MaterialTables:
    """The appearances of all objects, with decoded textures, in tables that grow object by object and share data."""

    def __init__(self, objects: Sequence[SceneObject], movable: Sequence[int], device: wp.Device) -> None:
        self._device = device
        self.deforms = False
        """Whether the tables depend on vertices that deform."""
        self._columns = {index: column for column, index in enumerate(movable)}
        self._materials: list[Any] = []
        self._textures: list[Any] = []
        self._texels: list[NDArray[np.uint32]] = []
        self._texel_count = 0
        self._known: dict[Any, Any] = {}
        self._alive: list[Any] = []  # keeps objects alive whose ids are keys of `_known`
        self._rows: dict[str, list[np.ndarray]] = {
            name: [] for name in ("corners", "uv", "colors", "normals", "face_material")
        }
        self._row_counts = dict.fromkeys(self._rows, 0)
        count = len(objects)
        self._first = np.zeros(count, dtype=np.int32)
        self._column = np.full(count, -1, dtype=np.int32)
        self._pose = np.tile(np.array(_IDENTITY, dtype=np.float32), (count, 1))
        self._object_rows = np.full((count, 5), -1, dtype=np.int32)
        for index, item in enumerate(objects):
            self._add(index, item, objects)

    def struct(self) -> DeviceMaterials:
        """Return the tables on the device."""
        from warpvis.kernels.shading.base_colors import DeviceMaterial, DeviceMaterials
        from warpvis.kernels.shading.textures import DeviceTexture

        texels = np.concatenate([np.zeros(0, dtype=np.uint32), *self._texels])
        columns = {
            "object_material": (self._first, wp.int32),
            "object_column": (self._column, wp.int32),
            "object_pose": (self._pose, wp.transform),
            "object_rows": (self._object_rows, wp.int32),
            "corners": (self._joined("corners", (3, 3)), wp.vec3),
            "uv": (self._joined("uv", (3, 2)), wp.vec2),
            "colors": (self._joined("colors", (3, 4)), wp.vec4),
            "normals": (self._joined("normals", (3, 3)), wp.vec3),
            "face_material": (self._joined("face_material", (), np.int32), wp.int32),
            "materials": (self._materials, DeviceMaterial),
            "textures": (self._textures, DeviceTexture),
            "texels": (texels, wp.uint32),
        }
        scene_materials = DeviceMaterials()
        for name, (rows, dtype) in columns.items():
            setattr(scene_materials, name, wp.array(rows, dtype=dtype, device=self._device))
        return scene_materials

    def _joined(self, name: str, shape: tuple[int, ...], dtype: Any = np.float32) -> np.ndarray:
        return np.concatenate([np.zeros((0, *shape), dtype=dtype), *self._rows[name]])

    def _add(self, index: int, item: SceneObject, objects: Sequence[SceneObject]) -> None:
        appearance = item.appearance or _PLAIN
        parent = index if item.parent is None else item.parent
        self._column[index] = self._columns.get(parent, -1)
        numbers = [self._material(material, item, objects) for material in appearance.materials]
        self._first[index] = numbers[0]
        if item.shares_mesh:
            self._pose[index] = item.place
        elif _has_own_frame(item, appearance):
            self._pose[index] = _pose_in_parent(item, objects)
        if appearance.face_materials is not None and len(set(numbers)) > 1:
            rows = np.array(numbers, dtype=np.int32)[appearance.face_materials]
            self._object_rows[index, 3] = self._share(
                "face_material", rows, (appearance.face_materials, tuple(numbers))
            )
        elif appearance.face_materials is not None and len(appearance.face_materials):
            self._first[index] = numbers[int(appearance.face_materials[0])]
        is_colored = appearance.vertex_colors is not None or appearance.face_colors is not None
        is_textured = any(material.texture for material in appearance.materials)
        if item.solid is not None or not (is_colored or is_textured or appearance.normals is not None):
            return
        self.deforms |= item.points is not None
        vertices, faces = item.mesh.rounded, item.faces
        if _has_own_frame(item, appearance):
            vertices = _in_frame(vertices, _pose_in_parent(item, objects))
        made_of = (item.mesh if item.shares_mesh else vertices), faces
        self._object_rows[index, 0] = self._share("corners", vertices[faces], made_of)
        uv = appearance.corner_uv(faces)
        if uv is not None:
            self._object_rows[index, 1] = self._share("uv", uv, (appearance.uv, faces))
        normals = appearance.corner_normals(faces)
        if normals is not None:
            self._object_rows[index, 4] = self._share("normals", normals, (appearance.normals, faces))
        if is_colored:
            self._object_rows[index, 2] = self._share("colors", _corner_colors(appearance, faces), (appearance, faces))

    def _share(self, name: str, rows: np.ndarray, made_of: tuple[Any, ...]) -> int:
        """Append rows unless `_known` has them already, and return the index of the first."""
        key = (name, *(part if isinstance(part, tuple) else id(part) for part in made_of))
        if key not in self._known:
            self._known[key] = self._row_counts[name]
            self._alive.append(made_of)
            self._rows[name].append(rows)
            self._row_counts[name] += len(rows)
        return self._known[key]

    def _material(self, material: Material, item: SceneObject, objects: Sequence[SceneObject]) -> int:
        from warpvis.kernels.shading.base_colors import DeviceMaterial

        scale = _cube_scale(material, item, objects)
        key = (id(material), scale)
        if key not in self._known:
            record = DeviceMaterial()
            record.color = wp.vec4(*material.base_color)
            record.is_linear = material.color_space == "linear"
            record.projection = get_args(Projection).index(material.projection)
            record.texture = -1 if material.texture is None else self._texture(material.texture, record.projection == 2)
            record.specular, record.shininess = wp.vec3(*material.specular), material.shininess
            record.emission = wp.vec3(*material.emission)
            record.repeat, record.scale = wp.vec2(*material.texture_repeat), wp.vec3(*scale)
            self._known[key] = len(self._materials)
            self._alive.append(material)
            self._materials.append(record)
        return self._known[key]

    def _texture(self, texture: Texture, is_cube: bool) -> int:
        from warpvis.kernels.shading.textures import DeviceTexture

        key = ("texture", id(texture), is_cube)
        if key not in self._known:
            levels = mip_levels(texture.image, _SIDES if is_cube else 1)
            record = DeviceTexture()
            record.first, record.levels = self._texel_count, len(levels)
            record.height, record.width = levels[0].shape[:2]
            record.wrap_u, record.wrap_v = (get_args(Wrap).index(mode) for mode in (texture.wrap_u, texture.wrap_v))
            record.filter = get_args(Filter).index(texture.filter)
            record.is_linear = texture.color_space == "linear"
            self._known[key] = len(self._textures)
            self._alive.append(texture)
            self._textures.append(record)
            self._texels += [level.reshape(-1, 4).copy().view("<u4").ravel() for level in levels]
            self._texel_count += sum(level.shape[0] * level.shape[1] for level in levels)
        return self._known[key]


def mip_levels(image: NDArray[np.uint8], sides: int = 1) -> list[NDArray[np.uint8]]:
    """Return the mip levels of an image, ``(h, w, 4)`` each: down to one texel, or one per cube side below each other.

    A texel is the rounded mean of the four texels it covers. The last row or column of an odd size is dropped, as
    OpenGL drivers do.
    """
    if image.shape[2] == 3:
        image = np.concatenate([image, np.full((*image.shape[:2], 1), 255, dtype=np.uint8)], axis=2)
    height = image.shape[0] // sides
    levels = [image[: height * sides]]
    while height > 1 or levels[-1].shape[1] > 1:
        parts = levels[-1].reshape(sides, height, -1, 4).astype(np.uint16)
        for axis in (1, 2):
            half = parts.shape[axis] // 2
            if half:
                parts = parts.take(range(0, 2 * half, 2), axis) + parts.take(range(1, 2 * half, 2), axis)
            else:
                parts = parts * 2
        height = parts.shape[1]
        levels.append(((parts + 2) >> 2).astype(np.uint8).reshape(sides * height, -1, 4))
    return levels


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
    if material.texture is None or material.projection != "cube" or material.texture_uniform:
        return 1.0, 1.0, 1.0
    origin = _pose_in_parent(item, objects)
    half = np.abs(_in_frame(item.mesh.rounded, origin)).max(axis=0).astype(np.float64)
    return tuple((1 / np.where(half > 0, half, 1.0)).tolist())


def pack_lights(lights: Sequence[Light], device: wp.Device) -> Lights:
    """Copy lights to a device. If one of them has linear colors, all are summed in linear space."""
    from warpvis.kernels.shading.lighting import DeviceLight, Lights

    packed, is_linear = Lights(), any(light.color_space == "linear" for light in lights)
    rows = []
    for light in lights:
        record = DeviceLight()
        record.kind, record.falloff = _LIGHT_KINDS.index(light.kind), get_args(Falloff).index(light.falloff)
        for name in ("position", "direction", "attenuation"):
            setattr(record, name, wp.vec3(*getattr(light, name)))
        specular = light.color if light.specular is None else light.specular
        for name, color in (("color", light.color), ("ambient", light.ambient), ("specular", specular)):
            values = linear_color(color) if is_linear and light.color_space == "srgb" else color
            setattr(record, name, wp.vec3(*(light.intensity * value for value in values)))
        record.reach = min(light.reach, _ENDLESS)
        record.inner_angle, record.outer_angle, record.exponent = light.inner_angle, light.outer_angle, light.exponent
        rows.append(record)
    packed.all = wp.array(rows, dtype=DeviceLight, device=device)
    packed.is_linear = is_linear
    return packed


def set_background(scene_materials: DeviceMaterials, background: Background | None) -> None:
    """Set the color of pixels that see no object; a sky is black."""
    color: tuple[float, ...] = (0.0, 0.0, 0.0)
    if background is not None and not background.sky:
        color = background.color if background.color_space == "srgb" else screen_color(background.color)
    scene_materials.background = wp.vec3(*color)
