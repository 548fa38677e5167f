# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of bodies as rewards and observations of one environment."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple, TypeAlias, cast, get_args

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from warpvis.cameras.pinhole import check_size
from warpvis.core.arrays import get_device
from warpvis.core.checks import as_items, check_choice, check_flag, check_number
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError
from warpvis.mujoco._batch import BatchRenderer
from warpvis.mujoco._batch_views import CameraChoice, choose_cameras
from warpvis.mujoco._body_visibility import BodyVisibility, choose_bodies, require_perspective
from warpvis.mujoco._scene import Movable, check_patterns, shown_by
from warpvis.mujoco.gymnasium._environments import add_entries, find_simulation, with_entries

FRACTIONS, REASONS, SHAPED = "visible_fraction", "visible_reason", "visible_shaped"

RewardMode: TypeAlias = Literal["fraction", "delta", "constraint"]
"""How a reward depends on the visible value: the value, its change since the last step, or its distance to a range."""


class Seen(NamedTuple):
    """Visibility of K bodies in W worlds, on the host."""

    fraction: NDArray[np.float32]
    """(W, K), from 0 to 1."""
    reason: NDArray[np.uint8]
    """(W, K), `warpvis.Visibility`."""
    shaped: NDArray[np.float32] | None
    """(W, K), `BodyVisibility.shaped`."""

    @classmethod
    def of(cls, found: BodyVisibility) -> Seen:
        """Copy the results of a single camera."""
        shaped = None if found.shaped is None else found.shaped.numpy()[:, 0].copy()
        return cls(found.fraction.numpy()[:, 0].copy(), found.status.numpy()[:, 0].copy(), shaped)

    def rows(self, rows: slice) -> Seen:
        """Copy some worlds."""
        shaped = None if self.shaped is None else self.shaped[rows].copy()
        return Seen(self.fraction[rows].copy(), self.reason[rows].copy(), shaped)

    def info(self) -> dict[str, np.ndarray]:
        """Return the entries of `info`, with a leading axis for worlds."""
        entries: dict[str, np.ndarray] = {FRACTIONS: self.fraction, REASONS: self.reason}
        return entries if self.shaped is None else entries | {SHAPED: self.shaped}

    def values(self) -> NDArray[np.float64]:
        """Return the mean of the bodies' shaped values or fractions, ``(W,)``."""
        chosen = self.fraction if self.shaped is None else self.shaped
        return chosen.mean(axis=1, dtype=np.float64)


@dataclass(frozen=True)
class RewardRule:
    """A reward for visible values."""

    mode: RewardMode
    weight: float
    discount: float
    target: tuple[float, float] | None
    replaces: bool

    @classmethod
    def checked(cls, mode: str, weight: float, discount: float, target: Sequence[float] | None, replaces: bool) -> Any:
        """Check the arguments of a wrapper."""
        chosen = cast("RewardMode", check_choice(mode, "mode", get_args(RewardMode)))
        weight, discount = check_number(weight, "weight"), check_number(discount, "discount")
        if not 0 <= discount <= 1:
            raise ArrayError(f"discount must be between 0 and 1, got {discount}")
        ends = None
        if target is not None:
            low_high = [check_number(end, "target") for end in as_items(target, "target")]
            if len(low_high) != 2 or low_high[0] > low_high[1]:
                raise ArrayError(f"target must be the lower and the upper end of a range, got {target!r}")
            ends = low_high[0], low_high[1]
        if (mode == "constraint") != (ends is not None):
            raise ArrayError(f'target must be a range with mode="constraint" and only then, got {target!r}')
        return cls(chosen, weight, discount, ends, check_flag(replaces, "replace"))

    def reward(self, values: NDArray[np.float64], previous: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the rewards of W worlds."""
        if self.mode == "delta":
            return self.weight * (self.discount * values - previous)
        if self.target is None:
            return self.weight * values
        low, high = self.target
        return -self.weight * np.maximum(np.maximum(low - values, values - high), 0)


def check_arguments(
    model: mujoco.MjModel,
    bodies: Sequence[str | int],
    *,
    camera: CameraChoice,
    width: int,
    height: int,
    shaped: bool,
    subtree: bool,
) -> dict[str, Any]:
    """Check the arguments of `BatchRenderer.visibility` that all wrappers have, and return them."""
    check_size(width, "width")
    check_size(height, "height")
    for chosen in choose_cameras(model, [camera], width, height):
        require_perspective(chosen.intrinsics)
    choose_bodies(model, bodies)
    check_flag(shaped, "shaped")
    return {"bodies": list(bodies), "cameras": [camera], "shaped": shaped, "subtree": check_flag(subtree, "subtree")}


class _Watcher(gym.Wrapper, gym.utils.RecordConstructorArgs):
    """Measures bodies in a camera of one environment."""

    def __init__(
        self,
        env: gym.Env,
        bodies: Sequence[str | int],
        *,
        camera: CameraChoice,
        shaped: bool,
        subtree: bool,
        width: int,
        height: int,
        movable: Movable,
        scene_option: mujoco.MjvOption | None,
        device: DeviceLike,
        threads: int | None,
        **recorded: Any,
    ) -> None:
        model, _ = find_simulation(env)
        given: dict[str, Any] = {"camera": camera, "width": width, "height": height, "subtree": subtree}
        self._query = check_arguments(model, bodies, shaped=shaped, **given)
        shown_by(scene_option)
        if device is not None and not isinstance(device, str):
            device = get_device(device).alias  # other types cannot be recorded
        movable = movable if isinstance(movable, str) else check_patterns(movable, "movable")
        self._options: dict[str, Any] = {"width": width, "height": height, "movable": movable, "device": device}
        self._options |= {"scene_option": scene_option, "threads": check_threads(threads)}
        recorded |= given | self._options | {"bodies": self._query["bodies"], "shaped": shaped}
        gym.utils.RecordConstructorArgs.__init__(self, **recorded)
        gym.Wrapper.__init__(self, env)
        self._batch: BatchRenderer | None = None
        self._shown = np.zeros(0, dtype=bool)
        self._look()  # checks that the bodies have rendered geoms

    def _look(self) -> Seen:
        """Measure the environment's current data."""
        model, data = find_simulation(self.env)
        shown = (model.geom_rgba[:, 3] != 0) & (np.append(model.mat_rgba[:, 3], 1)[model.geom_matid] != 0)
        if self._batch is None or self._batch.model is not model or not np.array_equal(shown, self._shown):
            self._batch, self._shown = BatchRenderer(model, outputs=("segmentation",), **self._options), shown
        if not data.geom_xmat.any():  # before the first reset
            data = mujoco.MjData(model)
            mujoco.mj_forward(model, data)
        return Seen.of(self._batch.visibility(data, model={"cam_fovy": model.cam_fovy[None]}, **self._query))

    def close(self) -> None:
        """Close the environment, and release memory."""
        self._batch = None
        super().close()

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state without the renderer, since unpickled environments have other models."""
        return self.__dict__ | {"_batch": None}


class VisibilityReward(_Watcher):
    """Rewards a policy for seeing bodies in a camera of a MuJoCo environment.

    ``info`` has the entries ``"visible_fraction"``, ``(bodies,)`` float32, ``"visible_reason"``, ``(bodies,)`` uint8
    (`warpvis.Visibility`) and, with `shaped`, ``"visible_shaped"``, ``(bodies,)`` float32.

    Example:
        >>> env = VisibilityReward(gym.make("Pusher-v5"), ["object"], camera=-1, weight=0.5)
        >>> _, info = env.reset(seed=0)
        >>> info["visible_fraction"].shape
        (1,)
    """

    def __init__(
        self,
        env: gym.Env,
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
        movable: Movable = "bodies",
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = 1,
    ) -> None:
        """Wrap an environment.

        Args:
            env: A MuJoCo environment, as for `DepthObservation`.
            bodies: Names or ids of bodies. The reward depends on the mean of their values.
            camera: A camera's name or id, -1 for the default free camera, or a `mujoco.MjvCamera`.
            weight: Factor of the reward.
            mode: ``"fraction"`` rewards the visible value v of the bodies, ``weight * v``; ``"delta"`` its change since
                the last step, ``weight * (discount * v - v_last)``; and ``"constraint"`` punishes values outside
                `target`, ``-weight * max(low - v, v - high, 0)``.
            target: The range ``(low, high)`` of ``"constraint"``.
            shaped: Whether the value is `BodyVisibility.shaped`, which has a slope where nothing or everything is
                visible; by default it is the visible fraction.
            discount: That of the policy's returns, in ``"delta"``: the best policy is then that of the reward without
                this term (Ng, Harada and Russell 1999).
            replace: Whether to replace the environment's reward; by default it is added to it.
            subtree: Whether bodies include their descendants.
            width: Width of the image [px].
            height: Its height [px].
            movable: Static bodies and geoms that the environment moves in its model, as for `BatchRenderer`.
            scene_option: A `mujoco.MjvOption` that selects visible elements, as for `BatchRenderer`.
            device: Device for rendering.
            threads: Number of CPU threads; None for all cores.
        """
        self._rule = RewardRule.checked(mode, weight, discount, target, replace)
        seen: dict[str, Any] = {"camera": camera, "shaped": shaped, "subtree": subtree, "width": width}
        seen |= {"height": height, "movable": movable, "scene_option": scene_option, "device": device}
        rule: dict[str, Any] = {"weight": weight, "mode": mode, "target": target, "discount": discount}
        super().__init__(env, bodies, **seen, threads=threads, **rule, replace=replace)
        self._previous = np.zeros(1)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and measure the bodies."""
        observation, info = self.env.reset(seed=seed, options=options)
        seen = self._look()
        self._previous = seen.values()
        return observation, info | {name: part[0] for name, part in seen.info().items()}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step the environment, and add the reward."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        seen = self._look()
        values = seen.values()
        own = 0.0 if self._rule.replaces else float(reward)
        total = own + float(self._rule.reward(values, self._previous)[0])
        self._previous = values
        info = info | {name: part[0] for name, part in seen.info().items()}
        return observation, total, terminated, truncated, info


class VisibleFractions(_Watcher):
    """Adds visible fractions of bodies in a camera to the observations of a MuJoCo environment.

    The entry ``"visible_fraction"``, ``(bodies,)`` float32 from 0 to 1, is added to a dictionary; any other observation
    becomes its entry ``"state"``. ``info`` has ``"visible_fraction"`` and ``"visible_reason"``.

    Example:
        >>> env = VisibleFractions(gym.make("Pusher-v5"), ["object"])
        >>> env.observation_space["visible_fraction"].shape
        (1,)
    """

    def __init__(
        self,
        env: gym.Env,
        bodies: Sequence[str | int],
        *,
        camera: CameraChoice = -1,
        subtree: bool = False,
        width: int = 64,
        height: int = 64,
        movable: Movable = "bodies",
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = 1,
    ) -> None:
        """Wrap an environment; arguments as for `VisibilityReward`."""
        seen: dict[str, Any] = {"camera": camera, "subtree": subtree, "width": width, "height": height}
        seen |= {"movable": movable, "scene_option": scene_option, "device": device, "threads": threads}
        super().__init__(env, bodies, shaped=False, **seen)
        self._saved_kwargs.pop("shaped")
        self.observation_space = with_entries(env.observation_space, fraction_space(bodies))

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Reset the environment, and add fractions."""
        return self._added(*self.env.reset(seed=seed, options=options))

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment, and add fractions."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        observation, info = self._added(observation, info)
        return observation, reward, terminated, truncated, info

    def _added(self, observation: Any, info: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        seen = self._look()
        entries = {name: part[0] for name, part in seen.info().items()}
        return add_entries(observation, {FRACTIONS: seen.fraction[0].copy()}), info | entries


def fraction_space(bodies: Sequence[str | int]) -> dict[str, spaces.Space]:
    """Return the space of the entry of some bodies."""
    return {FRACTIONS: spaces.Box(0.0, 1.0, (len(as_items(bodies, "bodies", SceneError)),), np.float32)}
