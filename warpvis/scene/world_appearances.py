# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors, materials, lights and backgrounds that differ between worlds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import warp as wp

from warpvis.core.arrays import FARTHEST, as_numpy, as_warp, check_shape, on_gpu, take_rows
from warpvis.core.checks import pluralize
from warpvis.core.kernel_cache import launch
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError, SceneError
from warpvis.scene._device_lights import pack_lights
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Material

if TYPE_CHECKING:
    from warpvis.kernels.shading.base_colors import DeviceMaterials
    from warpvis.kernels.shading.lighting import Lights
    from warpvis.scene._scene import Scene
    from warpvis.scene.device_sky import DeviceSkies

_LIGHT_FIELDS = {
    "light_positions": "position",
    "light_directions": "direction",
    "light_colors": "color",
    "light_ambients": "ambient",
    "light_speculars": "specular",
    "light_intensities": "intensity",
}
_WORLD_ARRAYS = ("world_entry", "world_color", "world_emission", "world_background")
_MAX_ENTRIES = 1 << 20
_LISTS = "materials", "skies"
_DTYPES = {
    "object_colors": wp.vec4,
    "object_materials": wp.int32,
    "world_skies": wp.int32,
    "light_intensities": wp.float32,
}


@dataclass(frozen=True, eq=False)
class WorldAppearances:
    """What differs between the appearances of W worlds; everything that is None is the same in all of them.

    Arrays have one row for each world, or one row for all worlds; N is the number of objects of the scene and L that of
    its lights. Arrays on a GPU are not copied to the host: only their shapes, dtypes and devices are checked.
    """

    object_colors: ArrayInput | None = field(default=None, repr=False)
    """Base colors of the objects in sRGB, from 0 to 1, shape ``(W, N, 3)`` or, with opacity, ``(W, N, 4)``, which
    replace those of their materials, and are multiplied by textures, vertex and face colors. Objects with NaN keep
    their own. On a GPU, shape ``(W, N, 4)``."""
    object_materials: ArrayInput | None = field(default=None, repr=False)
    """Material of each object, an index of `materials`, shape ``(W, N)`` int32; -1 for its own materials and colors."""
    materials: Sequence[Material] = ()
    """Materials that objects may have. Their textures use the texture coordinates of the object, or its frame if their
    `projection` is not ``"uv"``."""
    light_positions: ArrayInput | None = field(default=None, repr=False)
    """Positions of the scene's lights [m], shape ``(W, L, 3)``; only points and spots have one."""
    light_directions: ArrayInput | None = field(default=None, repr=False)
    """Their directions, of any length but 0, shape ``(W, L, 3)``."""
    light_colors: ArrayInput | None = field(default=None, repr=False)
    """Their diffuse colors, in the color space of the light, shape ``(W, L, 3)``; and those of the highlights of lights
    without `Light.specular`."""
    light_ambients: ArrayInput | None = field(default=None, repr=False)
    """Their ambient colors, shape ``(W, L, 3)``."""
    light_speculars: ArrayInput | None = field(default=None, repr=False)
    """The colors of their highlights, shape ``(W, L, 3)``."""
    light_intensities: ArrayInput | None = field(default=None, repr=False)
    """Factors of all their colors, shape ``(W, L)``; 0 for a light that is off."""
    backgrounds: ArrayInput | None = field(default=None, repr=False)
    """Colors of the background in sRGB, from 0 to 1, shape ``(W, 3)``, which replace the scene's sky, too."""
    skies: Sequence[Background] = field(default=(), repr=False)
    """Backgrounds that worlds may have: skies with their haze, or colors."""
    world_skies: ArrayInput | None = field(default=None, repr=False)
    """Background of each world, an index of `skies`, shape ``(W,)`` int32; -1 for the scene's own, or that of
    `backgrounds`. Skies do not change the lights."""

    def __post_init__(self) -> None:
        materials = self.materials
        if not isinstance(materials, list | tuple) or not all(isinstance(item, Material) for item in materials):
            raise SceneError(f"materials of WorldAppearances must be a list of Material, got {materials!r}")
        object.__setattr__(self, "materials", tuple(materials))
        skies = self.skies
        if not isinstance(skies, list | tuple) or not all(isinstance(item, Background) for item in skies):
            raise SceneError(f"skies of WorldAppearances must be a list of Background, got {skies!r}")
        object.__setattr__(self, "skies", tuple(skies))
        if self.world_skies is not None and not skies:
            raise SceneError("world_skies require skies=, the list that they are indices of")
        if self.object_materials is not None and not materials:
            raise SceneError("object_materials require materials=, the list that they are indices of")


@dataclass(frozen=True)
class DeviceAppearances:
    """Appearances of worlds on a device, for the views of one call."""

    materials: DeviceMaterials
    lights: Lights | None
    """The scene's lights, or those of the worlds; None if the scene has none."""
    worlds: int
    """Number of worlds; 1 if all are alike."""
    skies: DeviceSkies | None = None
    """The scene's sky, and those that worlds may have; None without any."""
    world_sky: wp.array | None = None
    """(1 or world): index of each world's sky, -1 for that of the scene; None if all have that of the scene."""

    def rows(self, views: slice) -> DeviceAppearances:
        """Return the appearances of a slice of views, each of which shows the world of its number."""
        if self.worlds == 1:
            return self
        arrays = {name: getattr(self.materials, name) for name in _WORLD_ARRAYS}
        parts = {
            name: take_rows(array, views) for name, array in arrays.items() if array is not None and len(array) > 1
        }
        lights = self.lights
        if lights is not None and lights.all.shape[0] > 1:
            lights = with_lights(lights, take_rows(lights.all, views))
        world_sky = self.world_sky
        if world_sky is not None and len(world_sky) > 1:
            world_sky = take_rows(world_sky, views)
        return replace(self, materials=with_arrays(self.materials, parts), lights=lights, world_sky=world_sky)


def with_arrays(materials: DeviceMaterials, arrays: Mapping[str, wp.array]) -> DeviceMaterials:
    """Return device materials with other arrays of the given names, which share all others."""
    from warpvis.kernels.shading.base_colors import DeviceMaterials

    found, kind = DeviceMaterials(), cast("Any", DeviceMaterials)
    for name in kind.vars:
        setattr(found, name, arrays[name] if name in arrays else getattr(materials, name))
    return found


def with_lights(lights: Lights, rows: wp.array) -> Lights:
    """Return lights with other rows."""
    from warpvis.kernels.shading.lighting import Lights

    found = Lights()
    found.all, found.is_linear, found.shadow_count = rows, lights.is_linear, lights.shadow_count
    found.samples = lights.samples
    return found


def parse_appearances(
    scene: Scene,
    appearances: WorldAppearances,
    others: Mapping[str, wp.array] = MappingProxyType({}),
    lights_of_worlds: Mapping[str, wp.array] = MappingProxyType({}),
    *,
    known_worlds: int | None = None,
) -> DeviceAppearances:
    """Convert the argument `appearances` of `Renderer.render`; arrays on the host are checked.

    Args:
        scene: The scene.
        appearances: The argument.
        others: Arrays of `DeviceMaterials` that it does not replace, by name.
        lights_of_worlds: Fields of lights that it does not replace, by the names of `LightFields`.
        known_worlds: Number of worlds, if it is known.
    """
    if not isinstance(appearances, WorldAppearances):
        raise ArrayError(f"appearances must be a WorldAppearances, got {type(appearances).__name__}")
    given = {item.name: getattr(appearances, item.name) for item in fields(appearances) if item.name not in _LISTS}
    arrays = {name: _parse(scene, appearances, name, value) for name, value in given.items() if value is not None}
    counts = {name: len(array) for name, array in arrays.items()}
    worlds = max(counts.values(), default=1) if known_worlds is None else known_worlds
    for name, count in counts.items():
        if count not in (1, worlds):
            source = max(counts, key=counts.__getitem__) if known_worlds is None else "the worlds to render"
            raise ArrayError(f"{name} must have 1 or {pluralize(worlds, 'row')}, like {source}, got {count}")
    of_worlds = dict(others)
    if "object_materials" in arrays:
        materials, of_worlds["world_entry"] = _entries(scene, appearances, arrays["object_materials"])
    else:
        materials = scene.device_materials(scene.background)
    for name, target in (("object_colors", "world_color"), ("backgrounds", "world_background")):
        if name in arrays:
            of_worlds[target] = arrays[name]
    lights = scene.device_lights(scene.lights) if scene.lights else None
    given = {field: arrays[name] for name, field in _LIGHT_FIELDS.items() if name in arrays}
    changed = {**lights_of_worlds, **given}
    if lights is not None and changed:
        lights = _lights_of_worlds(scene, lights, changed)
    background = scene.background
    own = background if background is not None and background.has_sky and "backgrounds" not in arrays else None
    skies, world_sky = None, arrays.get("world_skies")
    if own is not None or world_sky is not None:
        skies = scene.device_skies(own, () if world_sky is None else tuple(appearances.skies))
    return DeviceAppearances(with_arrays(materials, of_worlds), lights, worlds, skies, world_sky)


def _entries(scene: Scene, appearances: WorldAppearances, chosen: wp.array) -> tuple[DeviceMaterials, wp.array]:
    """Return device materials with all alternatives that are chosen, and the entry of each object in each world."""
    from warpvis.kernels.shading.world_appearances import write_entries

    count, materials = len(scene), appearances.materials
    used = np.ones((count, len(materials)), dtype=bool)
    if not on_gpu(appearances.object_materials):
        rows, marks = chosen.numpy(), np.zeros((count, len(materials) + 1), dtype=bool)
        marks[np.broadcast_to(np.arange(count), rows.shape), rows + 1] = True
        used = marks[:, 1:]
    if np.count_nonzero(used) > _MAX_ENTRIES:
        raise ArrayError(
            f"object_materials must have at most {_MAX_ENTRIES} pairs of an object and a material, got "
            f"{np.count_nonzero(used)}; fewer materials are enough, or give object_materials in host memory"
        )
    numbers = np.tile(np.arange(count, dtype=np.int32)[:, None], len(materials) + 1)
    alternatives = [(index, materials[number]) for index, number in np.argwhere(used).tolist()]
    found, entries = scene.device_alternatives(scene.background, alternatives)
    numbers[:, 1:][used] = entries
    out = wp.empty(chosen.shape, dtype=wp.int32, device=scene.device)
    launch(
        write_entries, out.shape, [chosen, wp.array(numbers, dtype=wp.int32, device=scene.device), out], scene.device
    )
    return found, out


def _lights_of_worlds(scene: Scene, lights: Lights, arrays: Mapping[str, wp.array]) -> Lights:
    """Return the scene's lights with fields that differ between worlds."""
    from warpvis.kernels.shading.lighting import DeviceLight
    from warpvis.kernels.shading.world_appearances import LightFields, write_lights

    struct, device = LightFields(), scene.device
    for name, array in arrays.items():
        setattr(struct, name, array)
    out = wp.empty((max(map(len, arrays.values())), len(scene.lights)), dtype=DeviceLight, device=device)
    launch(write_lights, out.shape, [*_unit_lights(scene.lights, str(device)), struct, out], device)
    return with_lights(lights, out)


@lru_cache(maxsize=32)
def _unit_lights(lights: tuple[Light, ...], device: str) -> tuple[wp.array, wp.array, wp.array]:
    """Return lights of intensity 1, their intensities, and flags of their colors; CUDA graphs may keep them."""
    from warpvis.kernels.shading.world_appearances import CONVERTS, FOLLOWS

    unit = pack_lights([replace(light, intensity=1.0) for light in lights], wp.get_device(device))
    flags = []
    for light in lights:
        converts = unit.is_linear and light.color_space == "srgb"
        flags.append(int(CONVERTS) * converts + int(FOLLOWS) * (light.specular is None))
    intensities = wp.array([light.intensity for light in lights], dtype=wp.float32, device=device)
    return unit.all, intensities, wp.array(flags, dtype=wp.int32, device=device)


def _parse(scene: Scene, appearances: WorldAppearances, name: str, value: ArrayInput) -> wp.array:
    """Return one array on the scene's device; if it is on the host, its numbers are checked."""
    if name in _LIGHT_FIELDS:
        columns: tuple[int, ...] = (len(scene.lights),)
        if not scene.lights:
            raise ArrayError(f"{name} require lights of the scene, which they differ from; set scene.lights first")
    else:
        columns = () if name in ("backgrounds", "world_skies") else (len(scene),)
    dtype = _DTYPES.get(name, wp.vec3)
    if on_gpu(value):
        return as_warp(value, dtype, ("W", *columns), name=name, device=scene.device)
    rows = as_numpy(value, name=name)
    components: tuple[int | str, ...] = () if dtype in (wp.int32, wp.float32) else (3,)
    if name == "object_colors":
        components = ("3 or 4",)
    check_shape(rows.shape, ("W", *columns, *components), name=name)
    if name == "object_colors" and rows.shape[-1] not in (3, 4):
        raise ArrayError(f"object_colors must have 3 or 4 numbers for each object, got shape {rows.shape}")
    if not len(rows):
        raise ArrayError(f"{name} must be of at least one world, got shape {rows.shape}")
    _check_values(name, rows, len(appearances.skies if name == "world_skies" else appearances.materials))
    if name == "object_colors" and rows.shape[-1] == 3:
        rows = np.concatenate([rows, np.ones((*rows.shape[:2], 1), dtype=rows.dtype)], axis=2)
    return as_warp(rows, dtype, ("W", *columns), name=name, device=scene.device)


def _check_values(name: str, rows: np.ndarray, choices: int) -> None:
    """Raise an `ArrayError` that names the first invalid element and the valid range."""
    whole, low, high = False, -FARTHEST, FARTHEST
    if name in ("object_materials", "world_skies"):
        whole, low, high = True, -1, choices - 1
    elif name in ("object_colors", "backgrounds"):
        low, high = 0, 1
    elif name not in ("light_positions", "light_directions"):
        low = 0
    bad = ~((rows >= low) & (rows <= high))
    if name == "object_colors":
        bad &= ~np.isnan(rows[..., :1])
    if name == "light_directions":
        bad |= ~rows.any(axis=-1, keepdims=True)
    if whole and rows.dtype.kind not in "iu":
        raise ArrayError(f"{name} must be int32, got {rows.dtype}")
    if bad.any():
        at = tuple(np.argwhere(bad)[0].tolist())[: rows.ndim if whole or name == "light_intensities" else rows.ndim - 1]
        expected = {
            "object_materials": f"from -1 to {high}, indices of materials",
            "world_skies": f"from -1 to {high}, indices of skies",
            "object_colors": "from 0 to 1, or NaN to keep an object's color",
            "backgrounds": "from 0 to 1",
            "light_positions": f"at most {FARTHEST:g} m from the origin",
            "light_directions": "finite and not 0",
        }.get(name, "finite and at least 0")
        place = f"world {at[0]}" if len(at) == 1 else f"{name.partition('_')[0]} {at[1]} in world {at[0]}"
        raise ArrayError(f"{name} must be {expected}, got {rows[at].tolist()} for {place}")
