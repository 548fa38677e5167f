# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors, materials and lights of a model in many worlds: from poses, model fields, and later changes of the model."""

from __future__ import annotations

from typing import Any, get_args

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, as_warp, on_gpu
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError
from warpvis.mujoco._appearances import GeomAppearances, texture_numbers
from warpvis.mujoco._geoms import geom_shape, movable_bodies
from warpvis.mujoco._lights import light_ids, model_lights
from warpvis.mujoco._model_fields import AppearanceWatch
from warpvis.mujoco._poses import PoseSource
from warpvis.mujoco._scene import MujocoScene
from warpvis.mujoco._world_models import COLOR_FIELDS, TEXTURE_FIELDS, WorldModels
from warpvis.scene.lights import LightKind
from warpvis.scene.world_appearances import DeviceAppearances, WorldAppearances, parse_appearances

_FOLLOWED = (*COLOR_FIELDS, *TEXTURE_FIELDS)
_LIGHT_VECTORS = {"light_diffuse": "color", "light_ambient": "ambient", "light_specular": "specular"}
_LIGHT_SHAPES = {
    "light_type": wp.int32,
    "light_cutoff": wp.float32,
    "light_exponent": wp.float32,
    "light_attenuation": wp.vec3,
}
_LAST_TYPE = int(mujoco.mjtLightType.mjLIGHT_IMAGE)
_MAX_UPLOADED = 64
_FIXED = int(mujoco.mjtCamLight.mjCAMLIGHT_FIXED)


class ModelAppearances:
    """Follows the colors and lights of a model for color outputs."""

    def __init__(self, model: mujoco.MjModel, mujoco_scene: MujocoScene, mesh_tolerance: float, *, moved: bool) -> None:
        """Store them; `moved` states whether bodies without joints may have other poses in some worlds."""
        self._model, self._mujoco_scene, self._mesh_tolerance = model, mujoco_scene, mesh_tolerance
        self._watch = AppearanceWatch(model)
        bodies = model.light_bodyid
        moving = (movable_bodies(model)[bodies] | moved) & (bodies != 0)
        self._moving: NDArray[np.bool_] = moving | (np.asarray(model.light_mode) != _FIXED)
        self._looks = GeomAppearances(model)
        self._alternatives: dict[tuple[int, int, int], Any] = {}
        self._uploaded: dict[tuple[bytes, type], wp.array] = {}
        self._with_inactive = self._was_changed = False
        self._lights = mujoco_scene.scene.lights

    @property
    def colors_changed(self) -> bool:
        """Whether colors or materials of the model have changed since construction."""
        return self._was_changed or any(name in _FOLLOWED for name in self._watch.changed())

    def follow(self) -> None:
        """Follow changes of the model: its lights, and the properties of its materials except colors and textures."""
        changed = [name for name in self._watch.changed() if name not in _FOLLOWED]
        if not changed:
            return
        self._watch.accept(changed)
        if any(name.startswith(("light_", "vis.headlight")) for name in changed):
            self._set_lights()
        if any(name.startswith(("mat_", "site_")) for name in changed):
            self._was_changed = self.colors_changed
            self._watch.accept(_FOLLOWED)  # the appearances below have the current colors
            self._looks, self._alternatives = GeomAppearances(self._model), {}
            objects = self._mujoco_scene.scene.objects
            for shape, item in zip(self._mujoco_scene.shapes().tolist(), objects, strict=False):
                self._mujoco_scene.scene.set_appearance(item.name, self._looks.of(shape, self._shape(shape)))

    def _set_lights(self) -> None:
        """Set the lights of the scene, unless the user has replaced those of the model."""
        scene = self._mujoco_scene.scene
        if scene.lights is self._lights:
            scene.lights = model_lights(self._model, inactive=self._with_inactive)
            self._lights = scene.lights

    def of_worlds(
        self,
        appearances: WorldAppearances | None,
        source: PoseSource,
        models: WorldModels | None,
        worlds: tuple[NDArray[np.int32], NDArray[np.int32]],
    ) -> DeviceAppearances | None:
        """Return the appearances of worlds; None if all have those of the scene.

        Args:
            appearances: What the caller gives, which takes precedence.
            source: Poses, with those of the lights.
            models: Model fields that differ between worlds.
            worlds: Indices of the worlds in `source`, and in `models`.
        """
        arrays: dict[str, wp.array] = {}
        device = self._mujoco_scene.scene.device
        if models is not None:
            models.check_shared_looks()
        if models is not None and (self.colors_changed or models.has(*_FOLLOWED, "mat_emission")):
            arrays = self._colors(models, worlds[1])
            entries = self._entries(models, worlds[1])
            if entries is not None:
                arrays["world_entry"] = wp.array(entries, dtype=wp.int32, device=device)
        lights = self._light_fields(source, models, worlds)
        if appearances is None and not arrays and not lights:
            return None
        if appearances is not None and appearances.object_materials is not None and arrays:
            raise ArrayError(
                "object_materials of appearances must be None if colors or materials of the model differ between "
                "worlds or have changed; pass object_colors, or geom_matid in model"
            )
        looks = WorldAppearances() if appearances is None else appearances
        return parse_appearances(self._mujoco_scene.scene, looks, arrays, lights, known_worlds=len(worlds[1]))

    def _colors(self, models: WorldModels, rows: NDArray[np.int32]) -> dict[str, wp.array]:
        """Return colors and emission of all objects."""
        from warpvis.kernels.mujoco.appearances import object_colors

        device, shape = self._mujoco_scene.scene.device, (len(rows), len(self._mujoco_scene.scene))
        found = {
            "world_color": wp.empty(shape, dtype=wp.vec4, device=device),
            "world_emission": wp.empty(shape, dtype=wp.vec3, device=device),
        }
        emission = as_warp(
            models.value("mat_emission"), wp.float32, ("W", self._model.nmat), name="mat_emission", device=device
        )
        ids = [wp.array(part, dtype=wp.int32, device=device) for part in (rows, self._mujoco_scene.geoms_of_objects())]
        inputs = [*models.color_arrays(device), emission, *ids]
        launch(object_colors, shape, [*inputs, *found.values()], device)
        return found

    def _entries(self, models: WorldModels, rows: NDArray[np.int32]) -> NDArray[np.int32] | None:
        """Return the entry of each object in each world; None if all have their own materials and textures."""
        model, scene = self._model, self._mujoco_scene.scene
        matid, texid = models.materials()
        if matid is None or texid is None:
            return None
        geoms = self._mujoco_scene.geom_ids
        # Column 0 of the textures is that of geoms without a material.
        textures, own_textures = (
            np.insert(texture_numbers(rows), 0, -1, axis=1) for rows in (texid, self._watch.before("mat_texid")[None])
        )
        materials, own = matid[rows % len(matid)][:, geoms], self._watch.before("geom_matid")[geoms]
        chosen = np.take_along_axis(textures[rows % len(textures)], materials + 1, axis=1)
        own_textures = own_textures[0, own + 1]
        if (materials == own).all() and (chosen == own_textures).all():
            return None
        codes = (materials + 1) * (model.ntex + 1) + chosen + 1
        own_codes = (own + 1) * (model.ntex + 1) + own_textures + 1
        entries = np.tile(np.arange(len(scene), dtype=np.int32), (len(rows), 1))
        keys, alternatives = [], []
        for column, geom in enumerate(geoms.tolist()):
            for code in np.unique(codes[:, column]).tolist():
                if code != own_codes[column]:
                    keys.append((column, code))
                    alternatives.append((column, self._alternative(geom, *divmod(code, model.ntex + 1))))
        _, numbers = scene.device_alternatives(scene.background, alternatives)
        for (column, code), number in zip(keys, numbers, strict=True):
            entries[codes[:, column] == code, column] = number
        return entries

    def _alternative(self, geom: int, material: int, texture: int) -> Any:
        """Return the appearance of a geom with another material and texture, both numbered from 1 with 0 for none."""
        key = geom, material, texture
        if key not in self._alternatives:
            self._alternatives[key] = self._looks.alternative(geom, self._shape(geom), material - 1, texture - 1)
        return self._alternatives[key]

    def _shape(self, geom: int) -> Any:
        """Make the shape of a geom or site of the scene."""
        shape = geom_shape(self._model, geom, self._mesh_tolerance)
        assert shape is not None  # others are not in a scene
        return shape

    def _light_fields(
        self, source: PoseSource, models: WorldModels | None, worlds: tuple[NDArray[np.int32], NDArray[np.int32]]
    ) -> dict[str, wp.array]:
        """Return the fields of lights that differ between worlds, by the names of `LightFields`."""
        from warpvis.kernels.mujoco.appearances import LAST_RESORT, light_shapes, light_switches

        scene, model = self._mujoco_scene.scene, self._model
        if models is not None and models.has("light_active", "light_type") and not self._with_inactive:
            self._with_inactive = True
            self._set_lights()
        if scene.lights is not self._lights or not model.nlight:
            return {}
        ids = light_ids(model, inactive=self._with_inactive)
        ids += [int(LAST_RESORT)] * (len(scene.lights) - len(ids))
        fields, numbers = dict[str, wp.array](), np.array(ids, dtype=np.int32)
        shown = numbers[numbers >= 0]
        if not len(shown):
            return {}
        if self._moving[shown].any() or (models is not None and models.has("light_pos", "light_dir")):
            for name, field in (("light_xpos", "position"), ("light_xdir", "direction")):
                fields[field] = self._vectors(_light_poses(source, name, model), name, field, numbers, worlds[0])
        if models is None:
            return fields
        for name, field in _LIGHT_VECTORS.items():
            if models.has(name):
                fields[field] = self._vectors(models.value(name), name, field, numbers, worlds[1])
        rows = [self._upload(part, wp.int32) for part in (worlds[1], numbers)]
        shape, device = (len(worlds[1]), len(ids)), scene.device
        if models.has("light_active", "light_type"):
            fields["intensity"] = wp.empty(shape, dtype=wp.float32, device=device)
            inputs = [self._field(models, "light_active", wp.bool), self._field(models, "light_type", wp.int32)]
            launch(light_switches, shape[0], [*inputs, *rows, fields["intensity"]], device)
        if models.has(*_LIGHT_SHAPES):
            inputs = [self._field(models, name, dtype) for name, dtype in _LIGHT_SHAPES.items()]
            kinds = np.array([get_args(LightKind).index(light.kind) for light in scene.lights], dtype=np.int32)
            outputs = {"kind": wp.int32, "cone": wp.vec2, "attenuation": wp.vec3}
            fields |= {name: wp.empty(shape, dtype=dtype, device=device) for name, dtype in outputs.items()}
            inputs += [*rows, self._upload(kinds, wp.int32), *(fields[name] for name in outputs)]
            launch(light_shapes, shape, inputs, device)
        return fields

    def _field(self, models: WorldModels, name: str, dtype: type) -> wp.array:
        """Return a field of the model's lights in one world or all."""
        value, device = models.value(name), self._mujoco_scene.scene.device
        if on_gpu(value):
            return as_warp(value, dtype, ("W", self._model.nlight), name=name, device=device)
        if name == "light_type" and value.size and not (value.min() >= 0 and value.max() <= _LAST_TYPE):
            raise ArrayError(
                f"light_type must be from 0 to {_LAST_TYPE}, of mujoco.mjtLightType, got {value.min()} to {value.max()}"
            )
        rows = np.ascontiguousarray(value, dtype=wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype)))
        return wp.array(rows, dtype=dtype, device=device) if models.has(name) else self._upload(rows, dtype)

    def _vectors(
        self, values: Any, name: str, field: str, lights: NDArray[np.int32], worlds: NDArray[np.int32]
    ) -> wp.array:
        """Return a field of the scene's lights in some worlds, ``(worlds, lights)`` vec3."""
        from warpvis.kernels.mujoco.appearances import light_vectors

        scene, device = self._mujoco_scene.scene, self._mujoco_scene.scene.device
        own = [
            light.color if field == "specular" and light.specular is None else getattr(light, field)
            for light in scene.lights
        ]
        array = as_warp(values, wp.vec3, ("W", self._model.nlight), name=name, device=device)
        out = wp.empty((len(worlds), len(lights)), dtype=wp.vec3, device=device)
        ids = [self._upload(part.astype(np.int32), wp.int32) for part in (worlds, lights)]
        lowest = -1e30 if field in ("position", "direction") else 0.0
        inputs = [array, self._upload(np.array(own, dtype=np.float32), wp.vec3), *ids, lowest, out]
        launch(light_vectors, out.shape, inputs, device)
        return out

    def _upload(self, rows: NDArray[Any], dtype: type) -> wp.array:
        """Return an array on the device; it is cached, so that a call that is recorded into a CUDA graph has it."""
        key = rows.tobytes(), dtype
        if key not in self._uploaded:
            while len(self._uploaded) >= _MAX_UPLOADED:
                self._uploaded.pop(next(iter(self._uploaded)), None)
            self._uploaded[key] = wp.array(rows, dtype=dtype, device=self._mujoco_scene.scene.device)
        return self._uploaded[key]

    def __getstate__(self) -> dict[str, Any]:
        has_own = self._mujoco_scene.scene.lights is self._lights
        return self.__dict__ | {"_looks": None, "_alternatives": {}, "_uploaded": {}, "_lights": has_own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Read the materials of the unpickled model."""
        self.__dict__.update(state)
        self._looks = GeomAppearances(self._model)
        self._lights = self._mujoco_scene.scene.lights if state["_lights"] else ()


def _light_poses(source: PoseSource, name: str, model: mujoco.MjModel) -> Any:
    """Return positions or directions of all lights in the worlds of a source, on the host or on a GPU."""
    value = getattr(source, name, None)
    if value is None:
        raise ArrayError(
            f"poses must have {name} for the output color, since lights of the model move with bodies; pass a "
            "mujoco.MjData, joint positions or a WorldPoses with light_xpos and light_xdir, or set the lights of "
            "BatchRenderer.scene"
        )
    if on_gpu(value):
        return value
    rows = as_numpy(value, name=name)
    rows = rows[None] if isinstance(source, mujoco.MjData) else rows
    if rows.shape[1:] == (model.nlight, 3) and not np.isfinite(rows).all():
        world, light = np.argwhere(~np.isfinite(rows))[0, :2].tolist()
        raise ArrayError(f"{name} must be finite, got {rows[world, light].tolist()} at index {light} in world {world}")
    return rows
