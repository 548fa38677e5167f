# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""State of environments as entries of their observations: poses, colors and seeds of random numbers."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warpvis.errors import SceneError
from warpvis.mujoco._geoms import shown_geoms
from warpvis.mujoco._model_fields import DEFAULT_COLOR, Watched
from warpvis.mujoco._poses import INTEGER_FIELDS, WorldPoses, pose_shapes

STATE = "state"
"""The key of an observation that is not a dictionary, as in Gymnasium's `AddRenderObservation`."""

_PLACES = (("model", "data"), ("sim.model._model", "sim.data._data"), ("physics.model.ptr", "physics.data.ptr"))

_WORDS = 3
"""Number of 32-bit words of seeds: two of the episode, and the frame."""

POSES = "poses"
_ALL_GROUPS = range(6)

# Fields that determine the shapes of a scene, which all environments share.
_SHAPES = ("geom_type", "geom_dataid", "geom_size", "geom_bodyid", "hfield_size", "hfield_data", "mesh_vert")
_APPEARANCE_FIELDS = ("geom_rgba", "geom_matid", "mat_rgba")
_OTHER_SHAPES = (
    "shapes of an environment's model (sizes, meshes, height fields) must not change, since all environments of a "
    "VectorDepthObservation share them; wrap each in a DepthObservation instead"
)


def find_simulation(env: gym.Env) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Find the current model and data of an environment, which a reset may replace.

    Environments of Gymnasium, gymnasium-robotics and Meta-World have ``model`` and ``data``, those of robosuite
    ``sim``, and those of dm_control ``physics``.
    """
    if not isinstance(env, gym.Env):
        raise SceneError(f"env must be a gymnasium.Env, got {type(env).__name__}")
    base = env.unwrapped
    for owner in (base, getattr(base, "env", None), getattr(base, "_env", None)):
        for path_of_model, path_of_data in _PLACES:
            model, data = _get(owner, path_of_model), _get(owner, path_of_data)
            if isinstance(model, mujoco.MjModel) and isinstance(data, mujoco.MjData):
                return model, data
    raise SceneError(
        f"env must be an environment on MuJoCo, whose unwrapped has a mujoco.MjModel as model and a mujoco.MjData as "
        f"data, got {base}"
    )


def _get(owner: object, path: str) -> object:
    for name in path.split("."):
        owner = getattr(owner, name, None)
    return owner


def with_entries(space: spaces.Space, added: Mapping[str, spaces.Space]) -> spaces.Dict:
    """Return the space of observations with additional entries."""
    known = dict(space.spaces) if isinstance(space, spaces.Dict) else {STATE: space}
    taken = sorted(set(known) & set(added))
    if taken:
        raise SceneError(f"the environment's observations have {taken[0]!r} already")
    return spaces.Dict({**known, **added})


def add_entries(observation: Any, added: Mapping[str, Any]) -> dict[str, Any]:
    """Return an observation with additional entries."""
    known = observation if isinstance(observation, Mapping) else {STATE: observation}
    return {**known, **added}


class Draws:
    """The seeds of one environment, equal in single and vector environments.

    They depend on the last seed and the number of resets since, so that each episode has different noise and, for a
    sensor with randomized parameters, a different sensor. Without a seed they are random, like those of Gymnasium's
    environments.
    """

    def __init__(self) -> None:
        self._entropy, self._episode = np.random.SeedSequence().entropy, -1
        self.reset(None)

    def reset(self, seed: int | None) -> None:
        """Start the next episode, or the first episode of a seed."""
        self._episode += 1
        if seed is not None:
            self._entropy, self._episode = seed, 0
        self._frame = -1
        sequence = np.random.SeedSequence(self._entropy, spawn_key=(self._episode,))
        self._words = [int(word) for word in sequence.generate_state(_WORDS - 1)]

    def next(self) -> NDArray[np.uint32]:
        """Advance to the next observation, and return its words, ``(3,)``."""
        self._frame = (self._frame + 1) % 2**32
        return np.array([*self._words, self._frame], dtype=np.uint32)


def as_halves(words: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Split words into 16-bit halves, which float32 represents exactly."""
    return np.concatenate(np.divmod(words, 2**16)).astype(np.float32)


def from_halves(halves: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return the words of rows from `as_halves`, ``(W, 3)``."""
    high, low = np.split(halves.astype(np.uint32), 2, axis=1)
    return high * np.uint32(2**16) + low


def view_draws(words: NDArray[np.uint32], cameras: int) -> NDArray[np.uint32]:
    """Return number and frame of C cameras in W environments, ``(C, W, 2)``, from words ``(W, 3)``."""
    numbers = np.array([_numbers(first, second, cameras) for first, second, _ in words.tolist()], dtype=np.uint32)
    return np.stack([numbers.T, np.broadcast_to(words[:, 2], numbers.T.shape)], axis=-1)


@lru_cache(maxsize=2**16)
def _numbers(first: int, second: int, cameras: int) -> tuple[int, ...]:
    """Generate a number for each camera of an episode."""
    return tuple(int(word) for word in np.random.SeedSequence([first, second]).generate_state(cameras))


class PoseLayout:
    """The layout of a row of poses, for one model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self.of_data, self.size = dict[str, tuple[slice, tuple[int, ...]]](), 0
        for name, shape in pose_shapes(model).items():
            self.of_data[name] = self._take(math.prod(shape)), shape
        self.colors, self.fovy = self._take(4 * model.ngeom), self._take(model.ncam)
        self.draws = self._take(2 * _WORDS)

    def _take(self, count: int) -> slice:
        self.size += count
        return slice(self.size - count, self.size)

    def read(self, rows: NDArray[np.float32]) -> WorldPoses:
        """Read rows of W environments, shape ``(W, size)``."""
        count = len(rows)
        parts = {name: rows[:, part].reshape(count, *shape) for name, (part, shape) in self.of_data.items()}
        return WorldPoses(**parts | {name: parts[name].astype(np.int32) for name in INTEGER_FIELDS if name in parts})


class PoseObservation(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Adds the state for `VectorDepthObservation`: poses, colors, visibility, fields of view, and random seeds.

    The state is an entry ``"poses"`` of a few kilobytes. As a part of observations, it is transferred with all of them,
    including final observations before a reset, without another call to the workers.
    """

    def __init__(self, env: gym.Env) -> None:
        """Wrap a MuJoCo environment, as for `DepthObservation`."""
        model, _ = find_simulation(env)
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        self.pose_index = -1
        self._layout = PoseLayout(model)
        self._seen: _Seen | None = None
        self._draws = Draws()
        box = spaces.Box(-np.inf, np.inf, (self._layout.size,), np.float32)
        self.observation_space = with_entries(env.observation_space, {POSES: box})

    def pose_model(self) -> tuple[bytes, mujoco.MjModel | None]:
        """Return a digest of the model's shapes and, in the first environment, the model."""
        model, _ = find_simulation(self.env)
        return shape_digest(model), model if self.pose_index == 0 else None

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], Any]:
        """Reset the environment, and start an episode of random numbers."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._draws.reset(seed)
        return self.observation(observation), info

    def observation(self, observation: Any) -> dict[str, Any]:
        """Add the current poses."""
        model, data = find_simulation(self.env)
        if self._seen is None or self._seen.model is not model:
            self._seen = _Seen(model, None if self._seen is None else self._seen.digest)
        row = np.empty(self._layout.size, dtype=np.float32)
        for name, (part, _) in self._layout.of_data.items():
            row[part] = getattr(data, name).reshape(-1)
        row[self._layout.colors] = self._seen.colors().reshape(-1)
        row[self._layout.fovy] = model.cam_fovy
        row[self._layout.draws] = as_halves(self._draws.next())
        return add_entries(observation, {POSES: row})

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_seen": None}


class _Seen:
    """The last seen values of a model."""

    def __init__(self, model: mujoco.MjModel, digest: bytes | None) -> None:
        """Read the model, and compare its shapes with the previous ones."""
        self.model, self.digest = model, shape_digest(model)
        if digest not in (None, self.digest):
            raise SceneError(_OTHER_SHAPES)
        self._watched = {name: Watched(getattr(model, name)) for name in (*_SHAPES, *_APPEARANCE_FIELDS)}
        self._colors: NDArray[np.float32] | None = None

    def colors(self) -> NDArray[np.float32]:
        """Return the current `shown_colors`."""
        changed = [name for name, watched in self._watched.items() if watched.changed()]
        if not set(_SHAPES).isdisjoint(changed):
            raise SceneError(_OTHER_SHAPES)
        if changed or self._colors is None:
            for name in changed:
                self._watched[name].accept()
            self._colors = shown_colors(self.model)
        return self._colors


def shown_colors(model: mujoco.MjModel) -> NDArray[np.float32]:
    """Return the colors of all geoms, which may be those of their materials, ``(ngeom, 4)``; 0 for hidden geoms."""
    colors = model.geom_rgba.copy()
    takes_color = (model.geom_matid >= 0) & (colors == np.array(DEFAULT_COLOR, dtype=np.float32)).all(axis=1)
    colors[takes_color] = model.mat_rgba[model.geom_matid[takes_color]]
    is_shown = np.zeros(model.ngeom, dtype=bool)
    is_shown[shown_geoms(model, _ALL_GROUPS)] = True
    colors[~is_shown] = 0
    return colors


def model_changes(
    rows: NDArray[np.float32], layout: PoseLayout, model: mujoco.MjModel, colors: NDArray[np.float32]
) -> dict[str, np.ndarray]:
    """Return the differences of W rows of poses from a model and its `shown_colors`, for `BatchRenderer.render`."""
    changes = dict[str, np.ndarray]()
    fovy = rows[:, layout.fovy]
    if (fovy != model.cam_fovy.astype(np.float32)).any():
        changes["cam_fovy"] = fovy
    found = rows[:, layout.colors].reshape(len(rows), model.ngeom, 4)
    if (found != colors).any():
        new = np.argwhere((found[..., 3] > 0) & ~(colors[:, 3] > 0))
        if len(new):
            world, geom = new[0].tolist()
            raise SceneError(
                f"geom {geom} ({model.geom(geom).name!r}) must be visible when the vector wrapper is created, got one "
                f"that becomes visible later in environment {world}; wrap each environment by itself instead"
            )
        changes["geom_rgba"] = found
    return changes


def shape_digest(model: mujoco.MjModel) -> bytes:
    """Return a digest of the fields that determine the shapes of a scene."""
    digest = hashlib.blake2b(digest_size=16)
    for name in _SHAPES:
        array = np.ascontiguousarray(getattr(model, name))
        digest.update(f"{name}{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.digest()
