# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Access to the models of environments, and extension of their observations."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, TypeVar

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warpvis.errors import SceneError

STATE = "state"
"""The key of an observation that is not a dictionary, as in Gymnasium's `AddRenderObservation`."""

_PLACES = (("model", "data"), ("sim.model._model", "sim.data._data"), ("physics.model.ptr", "physics.data.ptr"))

_Value = TypeVar("_Value")


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


def add_entries(observation: Any, added: Mapping[str, _Value]) -> dict[str, Any]:
    """Return an observation with additional entries."""
    known = observation if isinstance(observation, Mapping) else {STATE: observation}
    return {**known, **added}


WORDS = 3
"""Number of 32-bit words: two of the episode, and the frame."""

_LOW = 2**16


class Draws:
    """The seeds of one environment, equal in single and vector environments.

    They depend on the last seed and the number of resets since, so that each episode has different noise and, for a
    sensor with randomized parameters, a different sensor. Without a seed they are random, like those of Gymnasium's
    environments.
    """

    def __init__(self) -> None:
        """Initialize with random entropy."""
        self._entropy = np.random.SeedSequence().entropy
        self._episode, self._frame = 0, -1
        self._words = self._draw()

    def reset(self, seed: int | None) -> None:
        """Start the next episode, or the first episode of a seed."""
        self._episode += 1
        if seed is not None:
            self._entropy, self._episode = seed, 0
        self._frame = -1
        self._words = self._draw()

    def _draw(self) -> list[int]:
        sequence = np.random.SeedSequence(self._entropy, spawn_key=(self._episode,))
        return [int(word) for word in sequence.generate_state(WORDS - 1)]

    def next(self) -> NDArray[np.uint32]:
        """Advance to the next observation, and return its words, ``(3,)``."""
        self._frame = (self._frame + 1) % 2**32
        return np.array([*self._words, self._frame], dtype=np.uint32)


def as_halves(words: NDArray[np.uint32]) -> NDArray[np.float32]:
    """Split words into 16-bit halves, which float32 represents exactly."""
    return np.concatenate(np.divmod(words, _LOW)).astype(np.float32)


def from_halves(halves: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Return the words of rows from `as_halves`, ``(W, 3)``."""
    high, low = np.split(halves.astype(np.uint32), 2, axis=1)
    return high * np.uint32(_LOW) + low


def view_draws(words: NDArray[np.uint32], cameras: int) -> NDArray[np.uint32]:
    """Return number and frame of C cameras in W environments, ``(C, W, 2)``, from words ``(W, 3)``."""
    numbers = np.array([_numbers(first, second, cameras) for first, second, _ in words.tolist()], dtype=np.uint32)
    return np.stack([numbers.T, np.broadcast_to(words[:, 2], numbers.T.shape)], axis=-1)


@lru_cache(maxsize=2**16)
def _numbers(first: int, second: int, cameras: int) -> tuple[int, ...]:
    """Generate a number for each camera of an episode."""
    return tuple(int(word) for word in np.random.SeedSequence([first, second]).generate_state(cameras))
