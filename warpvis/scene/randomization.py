# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Random appearances of worlds, for policies and detectors that must not depend on colors, textures and light."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import as_items, check_number, check_whole, is_whole
from warpvis.errors import SceneError
from warpvis.scene._device_materials import shading_bounds
from warpvis.scene._object import SceneObject
from warpvis.scene.lights import Background
from warpvis.scene.materials import Material, Texture
from warpvis.scene.world_appearances import WorldAppearances

if TYPE_CHECKING:
    from warpvis.scene._scene import Scene

_COLORS, _TEXTURES, _LIGHTS, _BACKGROUNDS, _SKIES = range(5)
"""Kinds of random numbers, each with its own stream."""

_PER_STEP = 4  # random numbers of one step of Philox's counter
_SIDES = 6  # of a cube map


def randomize_appearances(
    scene: Scene,
    worlds: int | ArrayLike,
    *,
    seed: int,
    objects: Iterable[str] = ("*",),
    colors: tuple[float, float] | None = (0.0, 1.0),
    textures: Sequence[Texture] = (),
    textured: float = 0.5,
    light_intensities: tuple[float, float] | None = (0.5, 1.5),
    light_colors: tuple[float, float] | None = (0.7, 1.0),
    light_angle: float = 0.5,
    light_distance: float = 0.3,
    backgrounds: tuple[float, float] | None = (0.0, 1.0),
    skies: Sequence[Background] = (),
) -> WorldAppearances:
    """Draw colors, textures, lights and backgrounds of worlds.

    The draw of a world depends on the seed, the number of the world, and the numbers of objects and lights of the
    scene: not on the other worlds, nor on the device. Numbers are those of the counter-based generator Philox 4x64-10
    (Salmon et al., "Parallel random numbers: as easy as 1, 2, 3", 2011), the same on all platforms.

    Args:
        scene: The scene, whose lights are varied.
        worlds: The number of worlds, W, or the W numbers of the worlds to draw, each at least 0.
        seed: Seed, from 0 to 2^64 - 1.
        objects: Names or patterns (``"table*"``) of the objects that change; others keep their colors and textures.
        colors: Range of red, green and blue in sRGB, drawn uniformly; None to keep colors.
        textures: Textures, of which an object has one, without a color, with the probability `textured`. Objects
            without texture coordinates, and round solids, have it on the sides of their bounding box; flat ones from
            above.
        textured: Probability that an object has a texture, from 0 to 1.
        light_intensities: Range of the factor of each light's intensity; None for 1.
        light_colors: Range of the factors of red, green and blue of each light's diffuse color; None for 1.
        light_angle: Largest angle between a light's direction and that of the scene [rad], up to pi.
        light_distance: Largest distance along x, y and z between a light's position and that of the scene [m].
        backgrounds: Range of red, green and blue of the background in sRGB; None to keep the background or the sky.
        skies: Backgrounds, of which each world has one instead of a color; all are equally probable.

    Returns:
        Appearances for `render(..., appearances=)` and `mujoco.BatchRenderer.render`, with W rows.

    Raises:
        SceneError: If an argument is invalid, or a pattern matches no object.
    """
    numbers = _world_numbers(worlds)
    seed = check_whole(seed, "seed", minimum=0, error=SceneError)
    if seed >= 1 << 64:
        raise SceneError(f"seed must be at most 2^64 - 1, got {seed}")
    textured = check_number(textured, "textured", minimum=0.0, maximum=1.0, error=SceneError)
    angle = check_number(light_angle, "light_angle", minimum=0.0, maximum=float(np.pi), error=SceneError)
    distance = check_number(light_distance, "light_distance", minimum=0.0, error=SceneError)
    chosen, found = _choose(scene, objects), dict[str, Any]()
    if colors is not None:
        draws = _draw(seed, _COLORS, numbers, (len(scene), 3), _range(colors, "colors", maximum=1.0))
        found["object_colors"] = np.where(chosen[:, None], draws, np.nan)
    textures = as_items(textures, "textures", SceneError)
    if not all(isinstance(texture, Texture) for texture in textures):
        raise SceneError(f"textures must be of Texture, got {textures!r}")
    if textures:
        draws = _draw(seed, _TEXTURES, numbers, (len(scene), 2), (0.0, 1.0))
        picked = np.minimum((draws[..., 1] * len(textures)).astype(np.int32), len(textures) - 1)
        found["materials"], table = _materials(scene, textures)
        shows = chosen & (draws[..., 0] < textured)
        found["object_materials"] = np.where(shows, table[np.arange(len(scene)), picked], -1).astype(np.int32)
        if "object_colors" in found:
            found["object_colors"][shows] = np.nan
    if scene.lights:
        factors = _range(light_intensities, "light_intensities"), _range(light_colors, "light_colors")
        found |= _lights(scene, seed, numbers, factors, angle, distance)
    skies = as_items(skies, "skies", SceneError)
    if not all(isinstance(sky, Background) for sky in skies):
        raise SceneError(f"skies must be of Background, got {skies!r}")
    if skies:
        draws = _draw(seed, _SKIES, numbers, (1,), (0.0, len(skies)))[:, 0]
        found["skies"], found["world_skies"] = skies, np.minimum(draws, len(skies) - 1).astype(np.int32)
    elif backgrounds is not None:
        limits = _range(backgrounds, "backgrounds", maximum=1.0)
        found["backgrounds"] = _draw(seed, _BACKGROUNDS, numbers, (3,), limits)
    for name, rows in found.items():
        if isinstance(rows, np.ndarray) and rows.dtype == np.float64:
            found[name] = rows.astype(np.float32)
    return WorldAppearances(**found)


def _world_numbers(worlds: int | ArrayLike) -> NDArray[np.int64]:
    """Return the numbers of the worlds."""
    if is_whole(worlds):
        return np.arange(check_whole(worlds, "worlds", minimum=1, error=SceneError), dtype=np.int64)
    try:
        numbers = np.asarray(worlds)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu" or not len(numbers) or numbers.min() < 0:
        raise SceneError(f"worlds must be a number of worlds, or numbers of worlds from 0, got {worlds!r}")
    if numbers.max() >= 1 << 40:
        raise SceneError(f"worlds must be below 2^40, got {numbers.max()}")
    return numbers.astype(np.int64)


def _range(limits: tuple[float, float] | None, name: str, *, maximum: float = np.inf) -> tuple[float, float]:
    """Check a range of factors or colors; None stands for 1."""
    if limits is None:
        return 1.0, 1.0
    items = as_items(limits, name, SceneError)
    if len(items) != 2:
        raise SceneError(f"{name} must be a minimum and a maximum, got {limits!r}")
    low, high = (check_number(item, name, minimum=0.0, maximum=maximum, error=SceneError) for item in items)
    if low > high:
        raise SceneError(f"{name} must be a minimum and a maximum, got {low:g} and {high:g}")
    return low, high


def _choose(scene: Scene, patterns: Iterable[str]) -> NDArray[np.bool_]:
    """Return which objects match a pattern, shape ``(N,)``."""
    patterns = [patterns] if isinstance(patterns, str) else as_items(patterns, "objects", SceneError)
    chosen = np.zeros(len(scene), dtype=bool)
    for pattern in patterns:
        matches = [isinstance(pattern, str) and fnmatchcase(item.name, pattern) for item in scene.objects]
        if not any(matches):
            raise SceneError(f"objects must be names or patterns of the scene's objects, got {pattern!r}")
        chosen |= matches
    return chosen


def _draw(
    seed: int, kind: int, worlds: NDArray[np.int64], shape: tuple[int, ...], limits: tuple[float, float]
) -> NDArray[np.float64]:
    """Draw uniform numbers of one kind, shape ``(W, *shape)``: each world has its own part of the kind's stream."""
    steps = -(-int(np.prod(shape)) // _PER_STEP)
    rows = np.empty((len(worlds), steps * _PER_STEP))
    starts = np.flatnonzero(np.r_[True, np.diff(worlds) != 1])
    for first, end in zip(starts.tolist(), [*starts[1:].tolist(), len(worlds)], strict=True):
        bits = np.random.Philox(key=np.array([seed, kind], dtype=np.uint64))
        bits.advance(int(worlds[first]) * steps)
        rows[first:end] = np.random.Generator(bits).random((end - first, rows.shape[1]))
    low, high = limits
    return low + (high - low) * rows[:, : int(np.prod(shape))].reshape(len(worlds), *shape)


def _materials(scene: Scene, textures: Sequence[Texture]) -> tuple[list[Material], NDArray[np.int32]]:
    """Return materials with textures, and the index of that of each object and texture, shape ``(N, textures)``."""
    known: dict[Any, int] = {}
    materials: list[Material] = []
    table = np.zeros((len(scene), len(textures)), dtype=np.int32)
    cubes: dict[int, Texture] = {}
    for row, item in zip(table, scene.objects, strict=True):
        options = _projection(scene, item)
        for k, texture in enumerate(textures):
            key = k, *options.values()
            if key not in known:
                shown = texture
                if options["projection"] == "cube":
                    shown = cubes.setdefault(k, Texture(np.concatenate([texture.image] * _SIDES), texture.name))
                known[key] = len(materials)
                materials.append(Material(f"texture_{k}", texture=shown, **options))
            row[k] = known[key]
    return materials, table


def _projection(scene: Scene, item: SceneObject) -> dict[str, Any]:
    """Return how a texture is laid on an object: by its coordinates, on the sides of its box, or from above if flat."""
    appearance = item.appearance
    if item.solid is None and appearance is not None and appearance.uv is not None:
        return {"projection": "uv"}
    low, high = shading_bounds(item, scene.objects)
    size = high - low
    if size[2] > 1e-6 * size.max():
        return {"projection": "cube"}
    repeat = 1.0 / max(float(size[:2].max()), 1e-6)
    return {"projection": "plane", "texture_repeat": (repeat, repeat)}


def _lights(
    scene: Scene,
    seed: int,
    worlds: NDArray[np.int64],
    factors: tuple[tuple[float, float], tuple[float, float]],
    angle: float,
    distance: float,
) -> dict[str, NDArray[np.float64]]:
    """Draw the lights of worlds."""
    lights = scene.lights
    draws = _draw(seed, _LIGHTS, worlds, (len(lights), 9), (0.0, 1.0))
    (low, high), (low_color, high_color) = factors
    own = {name: np.array([getattr(light, name) for light in lights]) for name in ("color", "direction", "position")}
    found = {
        "light_intensities": np.array([light.intensity for light in lights]) * (low + (high - low) * draws[..., 0])
    }
    found["light_colors"] = own["color"] * (low_color + (high_color - low_color) * draws[..., 1:4])
    found["light_positions"] = own["position"] + distance * (2 * draws[..., 4:7] - 1)
    # Uniform on the spherical cap around the direction.
    cosine = 1 - draws[..., 7] * (1 - np.cos(angle))
    sine, turn = np.sqrt(np.maximum(1 - cosine**2, 0)), 2 * np.pi * draws[..., 8]
    helper = np.where(np.abs(own["direction"][:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    right = np.cross(own["direction"], helper)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    across = np.cos(turn)[..., None] * right + np.sin(turn)[..., None] * np.cross(own["direction"], right)
    found["light_directions"] = cosine[..., None] * own["direction"] + sine[..., None] * across
    return found
