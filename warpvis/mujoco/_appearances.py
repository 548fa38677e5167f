# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What geoms and sites of a MuJoCo model look like: their colours, materials and textures."""

from __future__ import annotations

from functools import cache, partial
from typing import Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco._shapes import shape_data, shape_value
from warpvis.scene.looks import Look
from warpvis.scene.materials import Appearance, Material, Projection, Texture

Color = tuple[float, float, float, float]

_DEFAULT_COLOR = (0.5, 0.5, 0.5, 1.0)
"""A geom that has a material and this colour has its material's (`setMaterial` in engine_vis_visualize.c)."""

_SHININESS = 128.0
"""The exponent of a material whose shininess is 1 (`renderGeom` in render_gl3.c)."""

_FIRST_ROLE = int(mujoco.mjtTextureRole.mjTEXROLE_RGB)
_CUBE = int(mujoco.mjtTexture.mjTEXTURE_2D) + 1
_MESHES = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_SDF)


class GeomLooks:
    """What geoms of a model look like, made when it is asked for; those that look the same share it."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Remember the model."""
        self._model = model
        self._known: dict[tuple[Color, int, int], Look] = {}
        self._texture = cache(partial(_texture, model))

    def of(self, geom: int) -> Look:
        """Return what a geom, or a site, looks like with the colour and the material that it has now."""
        model = self._model
        rgba, material = tuple(shape_value(model, "rgba", geom).tolist()), int(shape_value(model, "matid", geom))
        mesh = -1
        if material >= 0 and int(shape_value(model, "type", geom)) in _MESHES:
            mesh = shape_data(model, geom)
        key = rgba, material, mesh
        if key not in self._known:
            # What is of one colour must not keep the model.
            self._known[key] = Look(partial(_of_one_colour, rgba) if material < 0 else partial(self._make, *key))
        return self._known[key]

    def _make(self, rgba: Color, material: int, mesh: int) -> Appearance:
        model = self._model
        color = tuple(model.mat_rgba[material].tolist()) if rgba == _DEFAULT_COLOR else rgba
        number = _texture_number(model, material)
        uv = _coordinates(model, mesh) if number >= 0 else None
        made = Material(
            model.material(material).name,
            _unit(color),
            texture=self._texture(number) if number >= 0 else None,
            alpha_mode=_mode(color[3]),
            metallic=_known_or(model, "mat_metallic", material, 0.0),
            roughness=_known_or(model, "mat_roughness", material, 1.0),
            specular=(float(np.clip(model.mat_specular[material], 0, 1)),) * 3,
            shininess=_SHININESS * max(0.0, float(model.mat_shininess[material])),
            emission=tuple(max(0.0, float(model.mat_emission[material])) * part for part in _unit(color)[:3]),  # type: ignore[arg-type]
            projection=_projection(model, number, uv),
            texture_repeat=tuple(np.abs(model.mat_texrepeat[material]).tolist()),
            texture_uniform=bool(model.mat_texuniform[material]),
        )
        return Appearance((made,), uv=uv)


def _of_one_colour(rgba: Color) -> Appearance:
    """Make what has no material: its highlight is MuJoCo's (`mjv_initGeom` in engine_vis_visualize.c)."""
    shine = {"specular": (0.5, 0.5, 0.5), "shininess": 0.5 * _SHININESS}
    return Appearance((Material(base_color=_unit(rgba), alpha_mode=_mode(rgba[3]), **shine),))  # type: ignore[arg-type]


def _unit(color: Color) -> Color:
    """Return a colour within 0 and 1, as OpenGL takes it."""
    return tuple(np.clip(color, 0.0, 1.0).tolist())


def _mode(alpha: float) -> Any:
    return "blend" if alpha < 1 else "opaque"


def _known_or(model: mujoco.MjModel, name: str, material: int, otherwise: float) -> float:
    """Return a factor of a material; where it is negative, the file says none."""
    value = float(getattr(model, name)[material])
    return min(value, 1.0) if value >= 0 else otherwise


def _texture_number(model: mujoco.MjModel, material: int) -> int:
    """Return the texture that colours a material; -1 without."""
    roles = np.atleast_1d(model.mat_texid[material])
    return int(roles[_FIRST_ROLE if len(roles) > _FIRST_ROLE else 0])


def _projection(model: mujoco.MjModel, number: int, uv: NDArray[np.float32] | None) -> Projection:
    if number >= 0 and int(model.tex_type[number]) >= _CUBE:
        return "cube"
    return "plane" if uv is None and number >= 0 else "uv"


def _texture(model: mujoco.MjModel, number: int) -> Texture:
    """Copy a texture's image; of a cube, six images one below the other."""
    height, width = int(model.tex_height[number]), int(model.tex_width[number])
    channels, first = int(model.tex_nchannel[number]), int(model.tex_adr[number])
    image = np.asarray(model.tex_data[first : first + height * width * channels]).reshape(height, width, channels)
    if channels < 3:
        image = np.repeat(image[:, :, :1], 3, axis=2)
    if int(model.tex_type[number]) >= _CUBE and height == width:  # it is all sides of the cube
        image = np.concatenate([image] * 6)
    return Texture(image[:, :, :4], model.texture(number).name)


def _coordinates(model: mujoco.MjModel, mesh: int) -> NDArray[np.float32] | None:
    """Return texture coordinates of the corners of a mesh's faces; v is turned upwards. None if it has none."""
    if mesh < 0 or int(model.mesh_texcoordadr[mesh]) < 0:
        return None
    first, count = int(model.mesh_texcoordadr[mesh]), int(model.mesh_texcoordnum[mesh])
    start = int(model.mesh_faceadr[mesh])
    corners = model.mesh_facetexcoord[start : start + int(model.mesh_facenum[mesh])]
    uv = np.array(model.mesh_texcoord[first : first + count][corners], dtype=np.float32)
    uv[..., 1] = 1 - uv[..., 1]
    return uv
