# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transfer of environment states to the rendering process, as an entry of their observations."""

from __future__ import annotations

import hashlib
from typing import Any

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warpvis.errors import SceneError
from warpvis.mujoco._geoms import shown_geoms
from warpvis.mujoco._model_fields import Watched
from warpvis.mujoco._poses import WorldPoses, pose_shapes
from warpvis.mujoco.gymnasium._environments import WORDS, Draws, add_entries, as_halves, find_simulation, with_entries

POSES = "poses"
_ALL_GROUPS = range(6)

# Fields that determine the shapes of a scene, which all environments share.
_SHAPES = ("geom_type", "geom_dataid", "geom_size", "geom_bodyid", "hfield_size", "hfield_data", "mesh_vert")
_APPEARANCE_FIELDS = ("geom_rgba", "geom_matid", "mat_rgba")
_OTHER_SHAPES = (
    "shapes of an environment's model (sizes, meshes, height fields) must not change, since all environments of a "
    "VectorDepthObservation share them; wrap each in a DepthObservation instead"
)


class PoseLayout:
    """The layout of a row of poses, for one model."""

    def __init__(self, model: mujoco.MjModel) -> None:
        """Compute the layout."""
        self.of_data, self.size = dict[str, tuple[slice, tuple[int, int]]](), 0
        for name, shape in pose_shapes(model).items():
            self.of_data[name] = self._take(shape[0] * shape[1]), shape
        self.shown, self.fovy = self._take(model.ngeom), self._take(model.ncam)
        self.draws = self._take(2 * WORDS)

    def _take(self, count: int) -> slice:
        self.size += count
        return slice(self.size - count, self.size)

    def read(self, rows: NDArray[np.float32]) -> WorldPoses:
        """Read rows of W environments, shape ``(W, size)``."""
        count = len(rows)
        parts = {name: rows[:, part].reshape(count, *shape) for name, (part, shape) in self.of_data.items()}
        return WorldPoses(**parts)


class PoseObservation(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Adds the state for `VectorDepthObservation`: poses, visibility, fields of view, and random seeds.

    The state is an entry ``"poses"`` of a few kilobytes. As a part of observations, it is transferred with all of them,
    including final observations before a reset, without another call to the workers.
    """

    def __init__(self, env: gym.Env) -> None:
        """Wrap a MuJoCo environment, as for `DepthObservation`.

        Raises:
            SceneError: If it is not a MuJoCo environment, or already has an entry of this name.
        """
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
        row[self._layout.shown] = self._seen.shown()
        row[self._layout.fovy] = model.cam_fovy
        row[self._layout.draws] = as_halves(self._draws.next())
        return add_entries(observation, {POSES: row})

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state."""
        return self.__dict__ | {"_seen": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore the state."""
        self.__dict__.update(state)


class _Seen:
    """The last seen values of a model."""

    def __init__(self, model: mujoco.MjModel, digest: bytes | None) -> None:
        """Read the model, and compare its shapes with the previous ones."""
        self.model, self.digest = model, shape_digest(model)
        if digest not in (None, self.digest):
            raise SceneError(_OTHER_SHAPES)
        self._shapes = [Watched(getattr(model, name)) for name in _SHAPES]
        self._watched_appearance = [Watched(getattr(model, name)) for name in _APPEARANCE_FIELDS]
        self._shown = self._read_shown()

    def shown(self) -> NDArray[np.float32]:
        """Return 1 for every currently visible geom, else 0, shape ``(ngeom,)``."""
        if any(watched.changed() for watched in self._shapes):
            raise SceneError(_OTHER_SHAPES)
        if any(watched.changed() for watched in self._watched_appearance):
            for watched in self._watched_appearance:
                watched.accept()
            self._shown = self._read_shown()
        return self._shown

    def _read_shown(self) -> NDArray[np.float32]:
        shown = np.zeros(self.model.ngeom, dtype=np.float32)
        shown[shown_geoms(self.model, _ALL_GROUPS)] = 1
        return shown


def shape_digest(model: mujoco.MjModel) -> bytes:
    """Return a digest of the fields that determine the shapes of a scene."""
    digest = hashlib.blake2b(digest_size=16)
    for name in _SHAPES:
        array = np.ascontiguousarray(getattr(model, name))
        digest.update(f"{name}{array.shape}".encode())
        digest.update(array.tobytes())
    return digest.digest()
