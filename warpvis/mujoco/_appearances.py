# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances of the geoms and sites of a MuJoCo model, with normals for shading; its lights and its sky."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import FARTHEST
from warpvis.mujoco._model_fields import DEFAULT_COLOR, MATERIAL_FIELDS, check_light_numbers, shape_data, shape_value
from warpvis.mujoco._tessellation import Mesh
from warpvis.mujoco._texture_coordinates import box_cube_uv, plain_uv, stored_uv
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import Background, Light, LightKind
from warpvis.scene.materials import Appearance, Material, Texture, linear_color
from warpvis.scene.solids import Solid

Color = tuple[float, float, float, float]
Stored = tuple[NDArray[np.float32], NDArray[np.int32]]
Normals = Callable[[], NDArray[np.float32]]

_SHININESS = 128.0
"""The exponent of a material whose shininess is 1 (`renderGeom` in render_gl3.c)."""

_FIRST_ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
_CUBE = int(mujoco.mjtTexture.mjTEXTURE_2D) + 1
_SRGB = int(mujoco.mjtColorSpace.mjCOLORSPACE_SRGB)
_GEOM = mujoco.mjtGeom
_MESHES = (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_SDF)
# Shapes with smooth normals that differ from those of their triangles.
_SMOOTH = (*_MESHES, _GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER)


_SPOT, _DIRECTIONAL = int(mujoco.mjtLightType.mjLIGHT_SPOT), int(mujoco.mjtLightType.mjLIGHT_DIRECTIONAL)
_KINDS: dict[int, LightKind] = {
    _SPOT: "spot",
    _DIRECTIONAL: "directional",
    int(mujoco.mjtLightType.mjLIGHT_POINT): "point",
}

_SKYBOX = int(mujoco.mjtTexture.mjTEXTURE_SKYBOX)

_WORLD_TO_CUBE = ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0))
"""Rotation of the sky's cube map (`settexture` in render_gl3.c)."""

_AMBIENT = (0.3, 0.3, 0.3)
"""Ambient light of a scene without other lights (`initLights` in render_gl3.c)."""


class GeomAppearances:
    """Appearances of a model's geoms, made on demand; geoms with equal appearances share one object."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Copy the model's materials: later appearances use their current values. Images of textures are read later."""
        self._model = model
        self._materials = SimpleNamespace(**{name: np.array(getattr(model, name)) for name in MATERIAL_FIELDS})
        self._known: dict[tuple[Any, ...], LazyAppearance] = {}
        self._texture = cache(partial(_texture, model))
        self._stored = cache(partial(_stored_normals, model))

    def of(self, geom: int, shape: Mesh | Solid) -> LazyAppearance:
        """Return the appearance of a geom or site with its current color, material, size and triangles."""
        model = self._model
        rgba, material = tuple(shape_value(model, "rgba", geom).tolist()), int(shape_value(model, "matid", geom))
        kind, size = int(shape_value(model, "type", geom)), shape_value(model, "size", geom).copy()
        laid: _Laid | None = _Laid(kind, shape_data(model, geom), size, shape)
        if kind not in _SMOOTH and (material < 0 or _texture_number(self._materials, material) < 0):
            laid = None
        key = rgba, material, None if laid is None else laid.key()
        if key not in self._known:
            make = partial(self._make, rgba, material, laid)
            if material < 0:  # an appearance of a single color must not keep the model alive
                make = partial(_of_one_color, rgba, None if laid is None else self._normals(laid))
            self._known[key] = LazyAppearance(make)
        return self._known[key]

    def _normals(self, laid: _Laid) -> Normals:
        """Return a function that computes a shape's normals without a reference to the model."""
        return partial(_normals_of, laid, self._stored(laid.data) if laid.kind in _MESHES else None)

    def _make(self, rgba: Color, material: int, laid: _Laid | None) -> Appearance:
        model, values = self._model, self._materials
        color = tuple(values.mat_rgba[material].tolist()) if rgba == DEFAULT_COLOR else rgba
        number = _texture_number(values, material)
        repeat, uniform = values.mat_texrepeat[material].astype(np.float64), bool(values.mat_texuniform[material])
        uv = None if laid is None or number < 0 else _coordinates(model, number, repeat, laid, uniform=uniform)
        normals = self._normals(laid)() if laid is not None and laid.kind in _SMOOTH else None
        result = Material(
            model.material(material).name,
            _unit(color),
            texture=self._texture(number) if number >= 0 else None,
            alpha_mode=_mode(color[3]),
            metallic=_known_or(values, "mat_metallic", material, 0.0),
            roughness=_known_or(values, "mat_roughness", material, 1.0),
            specular=(float(np.clip(values.mat_specular[material], 0, 1)),) * 3,
            shininess=_SHININESS * max(0.0, float(values.mat_shininess[material])),
            emission=tuple(max(0.0, float(values.mat_emission[material])) * part for part in _unit(color)[:3]),  # type: ignore[arg-type]
            projection="cube" if number >= 0 and uv is None else "uv",
            texture_uniform=uv is None and uniform,
        )
        return Appearance((result,), uv=uv, normals=normals)


class _Laid(NamedTuple):
    """The shape onto which a texture is mapped."""

    kind: int
    data: int
    size: NDArray[np.float64]
    shape: Mesh | Solid

    def key(self) -> tuple[Any, ...]:
        return self.kind, self.data, *self.size.tolist(), id(self.shape)

    def triangles(self) -> Mesh:
        return (self.shape.vertices, self.shape.faces) if isinstance(self.shape, Solid) else self.shape


def _normals_of(laid: _Laid, stored: Stored | None) -> NDArray[np.float32]:
    vertices, faces = laid.triangles()
    corners = vertices[faces].astype(np.float64)
    return _round_normals(laid.kind, laid.size, corners) if stored is None else _corner_normals(stored, corners)


def _of_one_color(rgba: Color, normals: Normals | None) -> Appearance:
    """Make the appearance of a geom without a material; its highlight is MuJoCo's.

    See `mjv_initGeom` in engine_vis_visualize.c.
    """
    shine = {"specular": (0.5, 0.5, 0.5), "shininess": 0.5 * _SHININESS}
    material = Material(base_color=_unit(rgba), alpha_mode=_mode(rgba[3]), **shine)  # type: ignore[arg-type]
    return Appearance((material,), normals=None if normals is None else normals())


def _unit(color: Color) -> Color:
    """Clip a color to 0 to 1, as OpenGL does."""
    return tuple(np.clip(color, 0.0, 1.0).tolist())


def _mode(alpha: float) -> Any:
    return "blend" if alpha < 1 else "opaque"


def _known_or(values: SimpleNamespace, name: str, material: int, otherwise: float) -> float:
    """Return a factor of a material, or `otherwise` if it is negative, which means that the file does not set it."""
    value = float(getattr(values, name)[material])
    return min(value, 1.0) if value >= 0 else otherwise


def _texture_number(values: SimpleNamespace, material: int) -> int:
    """Return the texture that colors a material; -1 if it has none."""
    roles = np.atleast_1d(values.mat_texid[material])
    return int(roles[_FIRST_ROLE if len(roles) > _FIRST_ROLE else 0])


def _texture(model: mujoco.MjModel, number: int) -> Texture:
    """Copy a texture's image as MuJoCo's renderer shows it; a cube map is six images, one below the other.

    Images in the sRGB color space are decoded unless they are cube maps, and the picture is not encoded again
    (`makeTexture` in render_context.c: GL_SRGB8_EXT, without GL_FRAMEBUFFER_SRGB).
    """
    image = _image(model, number)
    if int(model.tex_colorspace[number]) == _SRGB and int(model.tex_type[number]) < _CUBE:
        decoded = np.rint(255 * np.array(linear_color(np.arange(256) / 255))).astype(np.uint8)
        image = np.concatenate([decoded[image[:, :, :3]], image[:, :, 3:]], axis=2)
    return Texture(image[:, :, :4], model.texture(number).name)


def _image(model: mujoco.MjModel, number: int) -> NDArray[np.uint8]:
    """Return a texture's image in color, shape ``(height, width, 3 or 4)``: of a cube map, all six."""
    height, width = int(model.tex_height[number]), int(model.tex_width[number])
    channels, first = int(model.tex_nchannel[number]), int(model.tex_adr[number])
    image = np.asarray(model.tex_data[first : first + height * width * channels]).reshape(height, width, channels)
    if channels < 3:
        image = np.repeat(image[:, :, :1], 3, axis=2)
    is_single = int(model.tex_type[number]) >= _CUBE and height == width  # one image for all sides of the cube
    return np.concatenate([image] * 6) if is_single else image


def _coordinates(
    model: mujoco.MjModel, number: int, repeat: NDArray[np.float64], laid: _Laid, *, uniform: bool
) -> NDArray[np.float32] | None:
    """Return texture coordinates of a shape's triangle corners; None for a cube map looked up by direction."""
    vertices, faces = laid.triangles()
    if int(model.tex_type[number]) >= _CUBE:
        square = len(set(laid.size.tolist())) == 1
        if laid.kind != _GEOM.mjGEOM_BOX or (uniform and not square):
            return None
        return box_cube_uv(vertices[faces], laid.size, int(model.tex_width[number]))
    rows = _stored_coordinates(model, laid.data) if laid.kind in _MESHES else None
    if rows is not None:
        return stored_uv(rows, laid.size, repeat, uniform=uniform)
    return plain_uv(laid.kind, laid.size, vertices, faces, repeat, uniform=uniform)


def _stored_coordinates(model: mujoco.MjModel, mesh: int) -> NDArray[np.float32] | None:
    """Return the texture coordinates that a mesh stores for the corners of its faces; None if it has none."""
    if mesh < 0 or int(model.mesh_texcoordadr[mesh]) < 0:
        return None
    first, count = int(model.mesh_texcoordadr[mesh]), int(model.mesh_texcoordnum[mesh])
    start = int(model.mesh_faceadr[mesh])
    corners = model.mesh_facetexcoord[start : start + int(model.mesh_facenum[mesh])]
    return model.mesh_texcoord[first : first + count][corners]


def _stored_normals(model: mujoco.MjModel, mesh: int) -> tuple[NDArray[np.float32], NDArray[np.int32]]:
    """Copy a mesh's normals, shape ``(n, 3)``, and their indices at the corners of its faces, ``(m, 3)``."""
    first, start = int(model.mesh_normaladr[mesh]), int(model.mesh_faceadr[mesh])
    rows = model.mesh_normal[first : first + int(model.mesh_normalnum[mesh])]
    return rows.copy(), model.mesh_facenormal[start : start + int(model.mesh_facenum[mesh])].copy()


def _corner_normals(stored: Stored, corners: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return normals of the corners of a mesh's faces, shape ``(m, 3, 3)``; the face normal where one is 0."""
    rows, index = stored
    normals = rows[index].astype(np.float64)
    none = ~(np.linalg.norm(normals, axis=-1) > 0)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flat[~(np.linalg.norm(flat, axis=-1) > 0)] = 0, 0, 1  # faces without an area, which are not visible
    normals[none] = np.repeat(flat[:, None], 3, axis=1)[none]
    return normals.astype(np.float32)


def _round_normals(kind: int, size: NDArray[np.float64], corners: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return normals at the triangle corners of a round shape in its frame, shape ``(m, 3, 3)``."""
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return (corners / size**2).astype(np.float32)
    if kind == _GEOM.mjGEOM_CAPSULE:
        return (corners - [0, 0, 1] * np.clip(corners[..., 2:], -size[1], size[1])).astype(np.float32)
    if kind == _GEOM.mjGEOM_CYLINDER:
        aside = corners * [1, 1, 0]
        is_end = np.ptp(corners[..., 2], axis=1) == 0
        aside[is_end] = np.sign(corners[is_end][..., 2:]) * [0, 0, 1]
        return aside.astype(np.float32)
    return corners.astype(np.float32)


def model_lights(model: mujoco.MjModel) -> tuple[Light, ...]:
    """Return a model's active lights at its initial state; the headlight comes first.

    Image lights are omitted. MuJoCo's renderer does not draw point lights, either.
    """
    active = [number for number in range(model.nlight) if model.light_active[number]]
    check_light_numbers(model, active)
    found = [_headlight(model)] if model.vis.headlight.active else []
    if active:
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        kinds = [(number, _KINDS.get(int(model.light_type[number]))) for number in active]
        found += [_light(model, data, number, kind) for number, kind in kinds if kind is not None]
    if not any(light.kind != "point" for light in found):
        found.append(Light("ambient", color=(0.0, 0.0, 0.0), ambient=_AMBIENT))
    return tuple(found)


def model_background(model: mujoco.MjModel) -> Background:
    """Return a model's sky, the first if it has several; black if it has none."""
    number = next((index for index in range(model.ntex) if int(model.tex_type[index]) == _SKYBOX), None)
    if number is None:
        return Background()
    width = int(model.tex_width[number])
    images = _image(model, number).reshape(6, width, width, -1)
    name = model.texture(number).name
    return Background(sky=tuple(Texture(image, name) for image in images), world_to_cube=_WORLD_TO_CUBE)


def _headlight(model: mujoco.MjModel) -> Light:
    headlight = model.vis.headlight
    return Light(
        "headlight",
        "headlight",
        color=_color(headlight.diffuse),
        ambient=_color(headlight.ambient),
        specular=_color(headlight.specular),
        cast_shadow=False,
    )


def _light(model: mujoco.MjModel, data: mujoco.MjData, number: int, kind: LightKind) -> Light:
    """Return one light; only spotlights have an attenuation and a cone (`initLights` in render_gl3.c)."""
    spot = kind == "spot"
    attenuation = np.maximum(model.light_attenuation[number], 0)
    direction = data.light_xdir[number]
    return Light(
        kind,
        model.light(number).name,
        tuple(np.clip(data.light_xpos[number], -FARTHEST, FARTHEST).tolist()),
        tuple(direction.tolist()) if np.any(direction) else (0.0, 0.0, -1.0),
        color=_color(model.light_diffuse[number]),
        ambient=_color(model.light_ambient[number]),
        specular=_color(model.light_specular[number]),
        attenuation=tuple(attenuation.tolist()) if spot and attenuation.any() else (1.0, 0.0, 0.0),
        outer_angle=min(max(math.radians(float(model.light_cutoff[number])), 0.0), math.pi) if spot else math.pi,
        exponent=max(0.0, float(model.light_exponent[number])) if spot else 0.0,
        cast_shadow=bool(model.light_castshadow[number]),
    )


def _color(values: NDArray[np.floating]) -> tuple[float, float, float]:
    return tuple(np.maximum(values, 0).tolist())
