# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors, lights and the sky of a stage, which follow a MuJoCo model, its data and the flags of its renderer."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.mujoco._appearances import GeomAppearances, Style
from warpvis.mujoco._geoms import geom_shape, movable_bodies
from warpvis.mujoco._lights import LightPlaces, model_background, model_lights
from warpvis.mujoco._model_fields import (
    DEFAULT_COLOR,
    HEADLIGHT_FIELDS,
    LIGHT_FIELDS,
    MATERIAL_FIELDS,
    Watched,
    check_shape_numbers,
    shape_bodies,
)
from warpvis.scene import Scene
from warpvis.scene.appearances import LazyAppearance
from warpvis.scene.lights import Background, Light

_FLAG = mujoco.mjtRndFlag
_SHADOW, _SKYBOX, _HAZE = (int(getattr(_FLAG, f"mjRND_{name}")) for name in ("SHADOW", "SKYBOX", "HAZE"))
_COLOR_FIELDS = ("geom_rgba", "geom_matid", "site_rgba", "site_matid", *MATERIAL_FIELDS)
_SHADING = ("mat_emission", "mat_specular", "mat_shininess", "mat_reflectance", "mat_metallic", "mat_roughness")


def style_of(option: mujoco.MjvOption) -> Style:
    """Return the style of visualization options."""
    flags = (option.flags[int(getattr(mujoco.mjtVisFlag, f"mjVIS_{name}"))] for name in ("TEXTURE", "TRANSPARENT"))
    return Style(*map(bool, flags))


class StageColors:
    """Appearances of the first objects of a scene, which are geoms and sites of a model."""

    def __init__(self, model: mujoco.MjModel, scene: Scene, mesh_tolerance: float) -> None:
        self._model, self._scene, self._mesh_tolerance = model, scene, mesh_tolerance
        self._moves = movable_bodies(model)[shape_bodies(model)]
        self._watched = [Watched(getattr(model, name)) for name in _COLOR_FIELDS]
        self._appearances = GeomAppearances(model)
        self._style, self._is_stale = Style(), False
        self._colors, self._textures = self._read(Style())

    def made(self, shapes: Iterable[int]) -> None:
        """Note that the appearances of geoms and sites were just made, in the default style."""
        rows = list(shapes)
        if rows:
            colors, textures = self._read(Style())
            self._colors[rows], self._textures[rows] = colors[rows], textures[rows]
            self._is_stale = True

    def follow(self, shapes: Sequence[int], style: Style) -> None:
        """Update the appearances of geoms and sites whose color, material or texture has changed."""
        changed = [watched for watched in self._watched if watched.changed()]
        if not (changed or self._is_stale) and style == self._style:
            return
        check_shape_numbers(self._model)
        colors, textures = self._read(style)
        is_other = (textures != self._textures).any(axis=1)
        is_recolored = (colors != self._colors).any(axis=1) & ~is_other
        opacity = self._opacity(style)
        made = GeomAppearances(self._model, textured=style.textured, opacity=opacity, earlier=self._appearances)
        for item, shape in zip(self._scene.objects, shapes, strict=False):
            if is_recolored[shape]:
                found = item.appearance
                assert found is not None  # geoms have appearances
                self._scene.set_appearance(item.name, LazyAppearance(None, made.recolored(shape, found)))
            elif is_other[shape]:
                mesh = geom_shape(self._model, shape, self._mesh_tolerance)
                self._scene.set_appearance(item.name, None if mesh is None else made.of(shape, mesh))
        self._colors, self._textures = colors, textures
        self._style, self._is_stale = style, False
        for watched in changed:
            watched.accept()

    def _opacity(self, style: Style) -> NDArray[np.float64] | None:
        """Return factors of the opacity of all geoms and sites (`setMaterial` in engine_vis_visualize.c)."""
        return np.where(self._moves, float(self._model.vis.map.alpha), 1.0) if style.transparent else None

    def _read(self, style: Style) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the values that determine colors, and those that determine textures, one row per geom and site."""
        model, opacity = self._model, self._opacity(style)
        rgba = np.concatenate([model.geom_rgba, model.site_rgba])
        material = np.concatenate([model.geom_matid, model.site_matid])
        has_material, colors = material >= 0, np.full((len(rgba), 5 + len(_SHADING)), -1.0)
        colors[:, :4], colors[:, 4] = rgba, has_material
        roles = np.asarray(model.mat_texid).reshape(model.nmat, mujoco.mjtTextureRole.mjNTEXROLE)
        textures = np.full((len(rgba), roles.shape[1] + 3), -1.0)
        if model.nmat:
            rows = material[has_material]
            takes_color = has_material & (rgba == np.array(DEFAULT_COLOR, dtype=np.float32)).all(axis=1)
            colors[takes_color, :4] = model.mat_rgba[material[takes_color]]
            colors[has_material, 5:] = np.stack([getattr(model, name)[rows] for name in _SHADING], axis=1)
            if style.textured:
                parts = [roles, model.mat_texrepeat, model.mat_texuniform.reshape(-1, 1)]
                textures[has_material] = np.concatenate(parts, axis=1)[rows]
        if opacity is not None:
            colors[:, 3] *= opacity
        return colors, textures


_BLACK = Background()


class StageLights:
    """The lights and the background of a model, at the places of the last data."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model, headlight = model, model.vis.headlight
        self._places = LightPlaces(model.light_pos.copy(), model.light_dir.copy())
        fields = [getattr(headlight, name) for name in HEADLIGHT_FIELDS]
        fields += [getattr(model, name) for name in ("light_active", "light_type", "light_castshadow", *LIGHT_FIELDS)]
        self._watched = [Watched(array) for array in (*self._places, *fields)]
        self._headlight = -1
        self._lights: tuple[Light, ...] = ()
        self._background: Background | None = None
        self._dimmed: tuple[tuple[Light, ...], tuple[Light, ...]] = ((), ())

    def read(self, data: mujoco.MjData) -> None:
        """Copy the places of the lights."""
        np.copyto(self._places.light_xpos, data.light_xpos)
        np.copyto(self._places.light_xdir, data.light_xdir)

    def light(self, scene: Scene) -> None:
        """Set the lights and the background of a scene."""
        changed = [watched for watched in self._watched if watched.changed()]
        headlight = int(self._model.vis.headlight.active)
        if changed or headlight != self._headlight:
            self._lights, self._headlight = model_lights(self._model, self._places), headlight
            for watched in changed:
                watched.accept()
        if self._background is None:
            self._background = model_background(self._model)
        scene.lights, scene.background = self._lights, self._background

    @contextmanager
    def with_flags(self, scene: Scene, flags: Sequence[int] | None) -> Iterator[None]:
        """Apply rendering flags (`mujoco.mjtRndFlag`; None for the default) to the lights and the background."""
        if flags is None or all(flags[flag] for flag in (_SHADOW, _SKYBOX, _HAZE)):
            yield
            return
        lights, background = scene.lights, scene.background
        try:
            if not flags[_SHADOW]:
                if self._dimmed[0] != lights:
                    self._dimmed = lights, tuple(replace(light, cast_shadow=False) for light in lights)
                scene.lights = self._dimmed[1]
            if background is not None and not flags[_SKYBOX]:
                scene.background = _BLACK
            elif background is not None and not flags[_HAZE]:
                scene.background = replace(background, haze=None)
            yield
        finally:
            scene.lights, scene.background = lights, background

    def __getstate__(self) -> dict[str, object]:
        return {"model": self._model, "places": self._places}

    def __setstate__(self, state: dict[str, object]) -> None:
        self.__init__(state["model"])  # type: ignore[misc]
        for own, place in zip(self._places, state["places"], strict=True):  # type: ignore[call-overload]
            np.copyto(own, place)
