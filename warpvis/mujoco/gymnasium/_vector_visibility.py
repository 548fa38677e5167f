# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of bodies as rewards and observations of all environments of a vector environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from warpvis.core.checks import check_flag
from warpvis.core.types import DeviceLike
from warpvis.mujoco._batch import BatchRenderer
from warpvis.mujoco._batch_views import CameraChoice
from warpvis.mujoco._scene import Movable
from warpvis.mujoco.gymnasium._environments import POSES, PoseLayout, model_changes, shown_colors, with_entries
from warpvis.mujoco.gymnasium._vector import FINAL, require_poses, shared_model
from warpvis.mujoco.gymnasium._visibility import (
    FRACTIONS,
    RewardMode,
    RewardRule,
    Seen,
    check_arguments,
    fraction_space,
)

_FINAL_INFO = "final_info"


class _VectorWatcher(gym.vector.VectorWrapper):
    """Measures bodies in a camera of all environments in one call."""

    def __init__(
        self,
        env: gym.vector.VectorEnv,
        bodies: Sequence[str | int],
        *,
        camera: CameraChoice,
        shaped: bool,
        subtree: bool,
        width: int,
        height: int,
        keep_poses: bool,
        added: dict[str, spaces.Space],
        **options: Any,
    ) -> None:
        single = require_poses(env)
        super().__init__(env)
        model = shared_model(env)
        self._query = check_arguments(
            model, bodies, camera=camera, width=width, height=height, shaped=shaped, subtree=subtree
        )
        self._layout, self._colors = PoseLayout(model), shown_colors(model)
        self._batch = BatchRenderer(model, width=width, height=height, outputs=("segmentation",), **options)
        # Checks that the bodies have rendered geoms.
        self._batch.visibility(model.qpos0, **self._query)
        self._keep = check_flag(keep_poses, "keep_poses")
        remaining = {name: space for name, space in single.spaces.items() if self._keep or name != POSES}
        self.single_observation_space = with_entries(spaces.Dict(remaining), added)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def _look(self, observations: Any, infos: dict[str, Any]) -> tuple[Seen, Seen, dict[str, Any]]:
        """Measure the environments: now, and before an automatic reset; return these, and infos with both."""
        final: Sequence[Any] = infos.get(FINAL, ())
        ended = [index for index, one in enumerate(final) if one is not None]
        rows = np.concatenate([observations[POSES], *(final[index][POSES][None] for index in ended)])
        changes = model_changes(rows, self._layout, self._batch.model, self._colors)
        found = Seen.of(self._batch.visibility(self._layout.read(rows), model=changes or None, **self._query))
        count = self.num_envs
        now, before = found.rows(slice(count)), found.rows(slice(count))
        for place, index in enumerate(ended, count):
            for part, source in zip(before, found, strict=True):
                if part is not None and source is not None:
                    part[index] = source[place]
        infos = infos | _masked(now, np.ones(count, dtype=bool))
        if ended:
            infos[_FINAL_INFO] = infos.get(_FINAL_INFO, {}) | _masked(before, np.isin(np.arange(count), ended))
        return now, before, infos

    def _observation(self, observation: Any, fraction: NDArray[np.float32]) -> dict[str, Any]:
        """Return an observation of this wrapper."""
        return {name: value for name, value in observation.items() if self._keep or name != POSES}

    def _observations(
        self, observations: Any, infos: dict[str, Any], now: Seen, before: Seen
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return the observations of this wrapper, and infos with its final observations."""
        if FINAL in infos:
            final = np.full(len(infos[FINAL]), None)
            for index, one in enumerate(infos[FINAL]):
                if one is not None:
                    final[index] = self._observation(one, before.fraction[index].copy())
            infos = infos | {FINAL: final}
        return self._observation(observations, now.fraction.copy()), infos


def _masked(seen: Seen, mask: NDArray[np.bool_]) -> dict[str, np.ndarray]:
    """Return entries of a vector environment's infos, with the masks of the environments that have them."""
    entries = seen.info()
    return entries | {f"_{name}": mask.copy() for name in entries}


class VectorVisibilityReward(_VectorWatcher):
    """Adds the reward of `VisibilityReward` to all environments of a vector environment, in one call.

    Each environment must be wrapped in `PoseObservation`, whose entry is removed unless `keep_poses` is set, for
    another wrapper such as `VectorDepthObservation`. Rewards of last steps are those of the state before an automatic
    reset, and steps that only reset an environment keep their reward of 0.

    Example:
        >>> envs = gym.make_vec("Pusher-v5", num_envs=8, vectorization_mode="async", wrappers=[PoseObservation])
        >>> envs = VectorVisibilityReward(envs, ["object"], shaped=True)
        >>> observations, infos = envs.reset(seed=0)
        >>> infos["visible_fraction"].shape
        (8, 1)
    """

    def __init__(
        self,
        env: gym.vector.VectorEnv,
        bodies: Sequence[str | int],
        *,
        camera: CameraChoice = -1,
        weight: float = 1.0,
        mode: RewardMode = "fraction",
        target: Sequence[float] | None = None,
        shaped: bool = False,
        discount: float = 1.0,
        replace: bool = False,
        subtree: bool = False,
        width: int = 64,
        height: int = 64,
        keep_poses: bool = False,
        movable: Movable = "bodies",
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = None,
    ) -> None:
        """Wrap a vector environment: a SyncVectorEnv or an AsyncVectorEnv of environments of one model.

        Arguments are as for `VisibilityReward`, with all cores available to the process as the default of `threads`.
        """
        self._rule = RewardRule.checked(mode, weight, discount, target, replace)
        seen: dict[str, Any] = {"camera": camera, "shaped": shaped, "subtree": subtree, "width": width}
        seen |= {"height": height, "keep_poses": keep_poses, "movable": movable, "scene_option": scene_option}
        super().__init__(env, bodies, **seen, device=device, threads=threads, added={})
        self._previous, self._ended = np.zeros(env.num_envs), np.zeros(env.num_envs, dtype=bool)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environments, and measure the bodies."""
        observations, infos = self.env.reset(seed=seed, options=options)
        now, before, infos = self._look(observations, infos)
        self._previous, self._ended[:] = now.values(), False
        return self._observations(observations, infos, now, before)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environments, and add the rewards."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        now, before, infos = self._look(observations, infos)
        own = np.zeros(self.num_envs) if self._rule.replaces else np.asarray(rewards, dtype=np.float64)
        own = own + np.where(self._ended, 0.0, self._rule.reward(before.values(), self._previous))
        self._previous = now.values()
        if self.env.metadata.get("autoreset_mode") == AutoresetMode.NEXT_STEP:
            self._ended = np.asarray(terminations) | np.asarray(truncations)
        observations, infos = self._observations(observations, infos, now, before)
        return observations, own, terminations, truncations, infos


class VectorVisibleFractions(_VectorWatcher):
    """Adds the entry of `VisibleFractions` to the observations of all environments, in one call.

    Environments are wrapped as for `VectorVisibilityReward`. Final observations have the entry, too.
    """

    def __init__(
        self,
        env: gym.vector.VectorEnv,
        bodies: Sequence[str | int],
        *,
        camera: CameraChoice = -1,
        subtree: bool = False,
        width: int = 64,
        height: int = 64,
        keep_poses: bool = False,
        movable: Movable = "bodies",
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = None,
    ) -> None:
        """Wrap a vector environment; arguments as for `VectorVisibilityReward`."""
        seen: dict[str, Any] = {"camera": camera, "subtree": subtree, "width": width, "height": height}
        seen |= {"keep_poses": keep_poses, "movable": movable, "scene_option": scene_option, "device": device}
        super().__init__(env, bodies, shaped=False, **seen, threads=threads, added=fraction_space(bodies))

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environments, and add fractions."""
        observations, infos = self.env.reset(seed=seed, options=options)
        now, before, infos = self._look(observations, infos)
        return self._observations(observations, infos, now, before)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Step the environments, and add fractions."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        now, before, infos = self._look(observations, infos)
        observations, infos = self._observations(observations, infos, now, before)
        return observations, rewards, terminations, truncations, infos

    def _observation(self, observation: Any, fraction: NDArray[np.float32]) -> dict[str, Any]:
        return super()._observation(observation, fraction) | {FRACTIONS: fraction}
