# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Access to the models of environments, and extension of their observations."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
from gymnasium import spaces

from warpvis.errors import SceneError

STATE = "state"
"""The key of an observation that is not a dictionary, as in Gymnasium's `AddRenderObservation`."""

_PLACES = (("model", "data"), ("sim.model._model", "sim.data._data"), ("physics.model.ptr", "physics.data.ptr"))

_Value = TypeVar("_Value")


def find_simulation(env: gym.Env) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Find the current model and data of an environment.

    Environments of Gymnasium, gymnasium-robotics and Meta-World have ``model`` and ``data``, those of robosuite
    ``sim``,
    and those of dm_control ``physics``. A reset may replace them.

    Raises:
        SceneError: If the environment has none of them.
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
    """Return the space of observations with additional entries.

    Raises:
        SceneError: If it has an entry of the same name.
    """
    known = dict(space.spaces) if isinstance(space, spaces.Dict) else {STATE: space}
    taken = sorted(set(known) & set(added))
    if taken:
        raise SceneError(f"the environment's observations have {taken[0]!r} already")
    return spaces.Dict({**known, **added})


def add_entries(observation: Any, added: Mapping[str, _Value]) -> dict[str, Any]:
    """Return an observation with additional entries."""
    known = observation if isinstance(observation, Mapping) else {STATE: observation}
    return {**known, **added}
