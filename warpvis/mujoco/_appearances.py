# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Appearances of the geoms and sites of a MuJoCo model, with normals for shading."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco._model_fields import DEFAULT_COLOR, MATERIAL_FIELDS, shape_data, shape_value
from warpvis.mujoco._tessellation import Mesh
from warpvis.mujoco._texture_coordinates import box_cube_uv, plain_uv, stored_uv
from warpvis.mujoco._vertex_grids import grid_of
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.materials import Appearance, Material, Texture, linear_color
from warpvis.scene.solids import Solid
from warpvis.scene.vertex_grids import VertexGrid

Color = tuple[float, float, float, float]
Normals = Callable[[], NDArray[np.float32]]

SHININESS = 128.0
"""The exponent of a material whose shininess is 1 (`renderGeom` in render_gl3.c)."""

_SHARP = 0.8
"""Cosine below which a vertex normal deviates too much from a face's (`mjr_uploadMesh` in render_context.c)."""

_FIRST_ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
_CUBE = int(mujoco.mjtTexture.mjTEXTURE_2D) + 1
_SRGB = int(mujoco.mjtColorSpace.mjCOLORSPACE_SRGB)
_GEOM = mujoco.mjtGeom
_MESHES = (_GEOM.mjGEOM_MESH, _GEOM.mjGEOM_SDF)
# Shapes with smooth normals that differ from those of their triangles.
_SMOOTH = (*_MESHES, _GEOM.mjGEOM_SPHERE, _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_CAPSULE, _GEOM.mjGEOM_CYLINDER)

_OPAQUE = 0.995
"""Minimum opacity of geoms that are not blended (`mjr_render`)."""


class Style(NamedTuple):
    """Flags of a `mujoco.MjvOption` that change appearances."""

    textured: bool = True
    """Whether textures are shown (mjVIS_TEXTURE)."""
    transparent: bool = False
    """Whether geoms and sites of moving bodies are transparent (mjVIS_TRANSPARENT)."""


class GeomAppearances:
    """Appearances of a model's geoms, made on demand; geoms with equal appearances share one object."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        textured: bool = True,
        opacity: NDArray[np.float64] | None = None,
        earlier: GeomAppearances | None = None,
    ) -> None:
        """Copy the model's materials: later appearances use their current values. Images of textures are read later.

        Args:
            model: A `mujoco.MjModel`.
            textured: Whether textures are shown.
            opacity: Factors of the opacity of all geoms and sites; 1 by default.
            earlier: Appearances of the same model, whose textures are shared.
        """
        self._model, self._opacity = model, opacity
        self._materials = SimpleNamespace(**{name: np.array(getattr(model, name)) for name in MATERIAL_FIELDS})
        if not textured:
            self._materials.mat_texid[:] = -1
        self._known: dict[tuple[Any, ...], LazyAppearance] = {}
        self._texture: Callable[[int], Texture] = cache(partial(texture_of, model))
        self._stored: Callable[[int], _StoredNormals] = cache(partial(_stored_normals, model))
        if earlier is not None:
            self._texture, self._stored = earlier._texture, earlier._stored

    def of(self, geom: int, shape: Mesh | Solid) -> LazyAppearance:
        """Return the appearance of a geom or site with its current color, material, size and triangles."""
        model, (rgba, material) = self._model, self._color(geom)
        kind, size = int(shape_value(model, "type", geom)), shape_value(model, "size", geom).copy()
        laid: _Laid | None = _Laid(kind, shape_data(model, geom), size, shape)
        if kind not in _SMOOTH and (material < 0 or texture_number(self._materials, material) < 0):
            laid = None
        grid = grid_of(model, geom)
        key = rgba, material, None if laid is None else laid.key(), grid
        if key not in self._known:
            make = partial(self._make, rgba, material, laid, grid=grid)
            if material < 0:  # an appearance of a single color must not keep the model alive
                make = partial(_of_one_color, rgba, None if laid is None else self._normals(laid), grid)
            self._known[key] = LazyAppearance(make)
        return self._known[key]

    def recolored(self, geom: int, found: Appearance) -> Appearance:
        """Return an earlier appearance of a geom or site with its current color and material, and the same texture."""
        (rgba, material), old = self._color(geom), found.materials[0]
        if material < 0:
            return found.with_material(_material_of_one_color(rgba))
        mapping = {name: getattr(old, name) for name in ("projection", "texture_uniform", "texture_stretch")}
        mapping |= self._mirroring(int(shape_value(self._model, "type", geom)), material)
        return found.with_material(self._material(rgba, material, old.texture, mapping))

    def _color(self, geom: int) -> tuple[Color, int]:
        """Return the color of a geom or site, and its material; -1 without one."""
        model = self._model
        rgba, material = tuple(shape_value(model, "rgba", geom).tolist()), int(shape_value(model, "matid", geom))
        if material >= 0 and rgba == DEFAULT_COLOR:
            rgba = tuple(self._materials.mat_rgba[material].tolist())
        return rgba if self._opacity is None else (*rgba[:3], rgba[3] * float(self._opacity[geom])), material

    def _normals(self, laid: _Laid) -> Normals:
        """Return a function that computes a shape's normals without a reference to the model."""
        return partial(_normals_of, laid, self._stored(laid.data) if laid.kind in _MESHES else None)

    def alternative(self, geom: int, shape: Mesh | Solid, material: int, texture: int) -> Appearance:
        """Return the appearance of a geom with another material and texture, -1 for none, except its color."""
        kind, size = int(self._model.geom_type[geom]), self._model.geom_size[geom].copy()
        laid, grid = _Laid(kind, shape_data(self._model, geom), size, shape), grid_of(self._model, geom)
        if material < 0:
            return _of_one_color(DEFAULT_COLOR, self._normals(laid) if kind in _SMOOTH else None, grid)
        shown = laid if kind in _SMOOTH or texture >= 0 else None
        return self._make(DEFAULT_COLOR, material, shown, texture, grid=grid)

    def _make(
        self, rgba: Color, material: int, laid: _Laid | None, number: int | None = None, *, grid: VertexGrid | None
    ) -> Appearance:
        model, values = self._model, self._materials
        number = texture_number(values, material) if number is None else number
        if laid is not None and number >= 0 and not _shows_texture(model, number, laid):
            number = -1
        repeat, uniform = values.mat_texrepeat[material].astype(np.float64), bool(values.mat_texuniform[material])
        uv = None if laid is None or number < 0 else _coordinates(model, number, repeat, laid, uniform=uniform)
        normals = self._normals(laid)() if laid is not None and laid.kind in _SMOOTH else None
        texture = self._texture(number) if number >= 0 else None
        mapping = self._mirroring(None if laid is None else laid.kind, material)
        if number >= 0 and int(model.tex_type[number]) >= _CUBE:
            mapping |= {"projection": "cube", "texture_uniform": uniform}
            # The renderer scales built-in shapes, whose directions are those of a shape of unit size, but not meshes.
            if laid is not None and laid.kind in (*_MESHES, _GEOM.mjGEOM_HFIELD):
                stretch = tuple(laid.size.tolist()) if uniform else (1.0, 1.0, 1.0)
                mapping |= {"texture_uniform": True, "texture_stretch": stretch}
            elif laid is not None and laid.kind == _GEOM.mjGEOM_CAPSULE and not uniform:
                mapping["texture_stretch"] = (1.0, 1.0, 1 + laid.size[0] / laid.size[1])  # of its straight part
        result = self._material(rgba, material, texture, mapping)
        return Appearance((result,), uv=uv, normals=normals, vertex_grid=grid)

    def _mirroring(self, kind: int | None, material: int) -> dict[str, Any]:
        """Return the reflectance of a material on a shape; None is a shape that is flat or a height field."""
        if kind not in (None, _GEOM.mjGEOM_PLANE, _GEOM.mjGEOM_BOX):
            return {}
        return {"reflectance": float(np.clip(self._materials.mat_reflectance[material], 0, 1))}

    def _material(self, color: Color, material: int, texture: Texture | None, mapping: dict[str, Any]) -> Material:
        """Return a material of the model with another color, and a texture that is mapped as given."""
        values = self._materials
        return Material(
            self._model.material(material).name,
            unit_color(color),
            texture=texture,
            **blending(color[3]),
            metallic=_known_or(values, "mat_metallic", material, 0.0),
            roughness=_known_or(values, "mat_roughness", material, 1.0),
            specular=(float(np.clip(values.mat_specular[material], 0, 1)),) * 3,
            shininess=SHININESS * max(0.0, float(values.mat_shininess[material])),
            emission=tuple(max(0.0, float(values.mat_emission[material])) * part for part in unit_color(color)[:3]),  # type: ignore[arg-type]
            **mapping,
        )


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


class _StoredNormals(NamedTuple):
    """The normals of a mesh."""

    rows: NDArray[np.float32]
    corner_rows: NDArray[np.int32]
    """Their rows at the corners of the faces, ``(m, 3)``."""
    as_stored: bool
    """Whether MuJoCo uses them regardless of the angle to the face."""


def _normals_of(laid: _Laid, stored: _StoredNormals | None) -> NDArray[np.float32]:
    vertices, faces = laid.triangles()
    corners = vertices[faces].astype(np.float64)
    return _round_normals(laid.kind, laid.size, corners) if stored is None else _corner_normals(stored, corners)


def _of_one_color(rgba: Color, normals: Normals | None, grid: VertexGrid | None) -> Appearance:
    """Make the appearance of a geom without a material."""
    material = _material_of_one_color(rgba)
    return Appearance((material,), normals=None if normals is None else normals(), vertex_grid=grid)


def _material_of_one_color(rgba: Color) -> Material:
    """Return the material of a geom without one, with MuJoCo's highlight (`mjv_initGeom`)."""
    shine = {"specular": (0.5, 0.5, 0.5), "shininess": 0.5 * SHININESS}
    return Material(base_color=unit_color(rgba), **blending(rgba[3]), **shine)  # type: ignore[arg-type]


def unit_color(color: Color) -> Color:
    """Clip a color to 0 to 1, as OpenGL does."""
    return tuple(np.clip(color, 0.0, 1.0).tolist())


def blending(alpha: float) -> dict[str, Any]:
    """Return how a color is blended: twice, since `mjr_render` draws transparent geoms twice, without back faces."""
    mode = "blend" if alpha < _OPAQUE else "opaque"
    return {"alpha_mode": mode, "blends_twice": True, "double_sided": False}


def _known_or(values: SimpleNamespace, name: str, material: int, otherwise: float) -> float:
    """Return a factor of a material, or `otherwise` if it is negative, which means that the file does not set it."""
    value = float(getattr(values, name)[material])
    return min(value, 1.0) if value >= 0 else otherwise


def texture_number(values: SimpleNamespace | mujoco.MjModel, material: int) -> int:
    """Return the texture that colors a material; -1 if it has none."""
    return int(texture_numbers(np.atleast_1d(values.mat_texid[material])))


def texture_numbers(texid: NDArray[np.int32]) -> NDArray[np.int32]:
    """Return the textures that color materials, given their rows of `mat_texid`; -1 for those that have none."""
    return texid[..., _FIRST_ROLE if texid.shape[-1] > _FIRST_ROLE else 0]


def texture_of(model: mujoco.MjModel, number: int) -> Texture:
    """Copy a texture's image as MuJoCo's renderer shows it; a cube map is six images, one below the other.

    Images in the sRGB color space are decoded unless they are cube maps, and the picture is not encoded again
    (`makeTexture` in render_context.c: GL_SRGB8_EXT, without GL_FRAMEBUFFER_SRGB).
    """
    image = texture_image(model, number)
    if int(model.tex_colorspace[number]) == _SRGB and int(model.tex_type[number]) < _CUBE:
        decoded = np.rint(255 * np.array(linear_color(np.arange(256) / 255))).astype(np.uint8)
        image = np.concatenate([decoded[image[:, :, :3]], image[:, :, 3:]], axis=2)
    wrap: Any = {"wrap_u": "clamp", "wrap_v": "clamp"} if int(model.tex_type[number]) >= _CUBE else {}
    return Texture(image[:, :, :4], model.texture(number).name, **wrap)


def _shows_texture(model: mujoco.MjModel, number: int, laid: _Laid) -> bool:
    """Return whether MuJoCo shows a texture on a shape.

    It uses the texture coordinates of a mesh as those of a 2D texture: OpenGL refuses cube maps (`settexture` in
    render_gl3.c).
    """
    is_cube = int(model.tex_type[number]) >= _CUBE
    return not (is_cube and laid.kind in _MESHES and _stored_coordinates(model, laid.data) is not None)


def texture_image(model: mujoco.MjModel, number: int) -> NDArray[np.uint8]:
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
    """Return texture coordinates of a shape's corners; of a cube map, those of a box for the viewer, or None."""
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


def _stored_normals(model: mujoco.MjModel, mesh: int) -> _StoredNormals:
    """Copy a mesh's normals."""
    first, start = int(model.mesh_normaladr[mesh]), int(model.mesh_faceadr[mesh])
    rows = model.mesh_normal[first : first + int(model.mesh_normalnum[mesh])]
    index = model.mesh_facenormal[start : start + int(model.mesh_facenum[mesh])]
    return _StoredNormals(rows.copy(), index.copy(), int(model.mesh_texcoordadr[mesh]) >= 0)


def _corner_normals(stored: _StoredNormals, corners: NDArray[np.float64]) -> NDArray[np.float32]:
    """Return normals of the corners of a mesh's faces, shape ``(m, 3, 3)``, as MuJoCo's renderer chooses them.

    On meshes without texture coordinates, corners have the normal of the face where it deviates more than about 37
    degrees from the vertex normal: sharp edges stay sharp.
    """
    normals = stored.rows[stored.corner_rows].astype(np.float64)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(flat, axis=-1, keepdims=True)
    flat = np.where(length > 0, flat / np.where(length > 0, length, 1), (0, 0, 1))[:, None]
    cosine = (normals * flat).sum(axis=-1, keepdims=True)
    is_unused = ~(np.linalg.norm(normals, axis=-1, keepdims=True) > 0) if stored.as_stored else ~(cosine >= _SHARP)
    return np.where(is_unused, flat, normals).astype(np.float32)


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
