# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A wrapper that renders images of all environments of a vector environment in one call."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.mujoco._batch import BatchRenderer
from warpvis.mujoco._batch_views import CameraChoice, choose_cameras
from warpvis.mujoco._poses import WorldPoses
from warpvis.mujoco._scene import Movable
from warpvis.mujoco.gymnasium._environments import (
    POSES,
    PoseLayout,
    from_halves,
    model_changes,
    shown_colors,
    view_draws,
    with_entries,
)
from warpvis.mujoco.gymnasium._observation import shapes_of_objects
from warpvis.mujoco.gymnasium._outputs import FRACTION, SEGMENTATION, Channels, Outputs, Segmentation
from warpvis.rendering import ColorOptions, DepthSensor, Fill

FINAL = "final_obs"


class VectorDepthObservation(gym.vector.VectorWrapper):
    """Adds the entries of `DepthObservation` to all environments of a vector environment, with one `BatchRenderer`.

    Environments are simulated in this process or in workers; all images are rendered in this process, on all cores or
    on a GPU. Each environment must be wrapped in `PoseObservation`, whose entry is replaced by images. Final
    observations before an automatic reset (``infos["final_obs"]``, with AutoresetMode.SAME_STEP) include images.

    Example:
        >>> envs = gym.make_vec("Ant-v5", num_envs=8, vectorization_mode="async", wrappers=[PoseObservation])
        >>> envs = VectorDepthObservation(envs, camera="track")
        >>> observations, infos = envs.reset(seed=0)
        >>> observations["depth"].shape
        (8, 84, 84)
    """

    def __init__(
        self,
        env: gym.vector.VectorEnv,
        *,
        camera: CameraChoice | Sequence[CameraChoice] = -1,
        width: int = 84,
        height: int = 84,
        outputs: Sequence[str] = ("depth",),
        channels: Channels = "last",
        depth_range: Sequence[float] | None = None,
        objects: Sequence[str] = (),
        segmentation: Segmentation = "geom",
        fill: Fill = "far",
        sensor: DepthSensor | None = None,
        scene_option: mujoco.MjvOption | None = None,
        movable: Movable = "bodies",
        device: DeviceLike = "cpu",
        threads: int | None = None,
        **colors: Unpack[ColorOptions],
    ) -> None:
        """Wrap a vector environment: a SyncVectorEnv or an AsyncVectorEnv of environments of one model.

        Arguments are as for `DepthObservation`, with these differences: `scene_option` is as for `BatchRenderer`, which
        draws geoms, sites, tendons, skins and flexes; `movable`, also as for `BatchRenderer`, are static bodies and
        geoms that environments move in their models, by name or pattern, or ``"all"``; and `threads` are by default all
        cores available to the process, since workers are idle during rendering. A sensor has the same noise for each
        environment.
        """
        single = require_poses(env)
        super().__init__(env)
        model = shared_model(env)
        self._layout = PoseLayout(model)
        shared: dict[str, Any] = {"width": width, "height": height, "fill": fill, "sensor": sensor}
        chosen: dict[str, Any] = {"camera": camera, "outputs": outputs, "channels": channels}
        chosen |= {"depth_range": depth_range, "objects": objects, "segmentation": segmentation}
        self._outputs = Outputs(model, **chosen, **shared)
        shared |= {"scene_option": scene_option, "movable": movable, "device": device, "threads": threads}
        self._batch = BatchRenderer(model, outputs=self._outputs.images, **shared, **colors)
        self._chosen = choose_cameras(model, self._outputs.cameras, width, height)
        self._colors = shown_colors(model)
        remaining = spaces.Dict({name: space for name, space in single.spaces.items() if name != POSES})
        self.single_observation_space = with_entries(remaining, self._outputs.spaces)
        self.observation_space = batch_space(self.single_observation_space, env.num_envs)

    def reset(
        self, *, seed: Any = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Reset the environments, and render images."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return self._with_images(observations, infos)

    def step(self, actions: Any) -> tuple[dict[str, Any], Any, Any, Any, dict[str, Any]]:
        """Step the environments, and render images."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        observations, infos = self._with_images(observations, infos)
        return observations, rewards, terminations, truncations, infos

    def _with_images(self, observations: Any, infos: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
        """Replace the poses of observations and final observations by images."""
        final: Sequence[Any] = infos.get(FINAL, ())
        ended = [index for index, one in enumerate(final) if one is not None]
        entries = self._render(np.concatenate([observations[POSES], *(final[index][POSES][None] for index in ended)]))
        images = {name: part[: self.num_envs] for name, part in entries.items()}
        if not ended:
            return _replace_poses(observations, images), infos
        last = np.full(len(final), None)
        for place, index in enumerate(ended, self.num_envs):
            last[index] = _replace_poses(final[index], {name: part[place].copy() for name, part in entries.items()})
        return _replace_poses(observations, images), infos | {FINAL: last}

    def _render(self, rows: NDArray[np.float32]) -> dict[str, np.ndarray]:
        """Render the entries of W rows of poses, with a leading axis of length W."""
        outputs, count = self._outputs, len(rows)
        poses, changes = self._layout.read(rows), model_changes(rows, self._layout, self._batch.model, self._colors)
        options: dict[str, Any] = {"cameras": outputs.cameras, "model": changes or None}
        if outputs.sensor is not None:
            draws = view_draws(from_halves(rows[:, self._layout.draws]), len(self._chosen))
            options["view_index"], options["frame"] = draws.reshape(-1, 2).T
        views = self._batch.render(poses, **options)
        shape = (len(self._chosen), count, *outputs.shape)
        images: dict[str, np.ndarray] = {name: getattr(views, name).numpy() for name in outputs.images}
        of_object = shapes_of_objects(self._batch.mujoco_scene.shapes(), self._batch.scene)
        if SEGMENTATION in images:
            images[SEGMENTATION] = of_object[images[SEGMENTATION]]
        entries: dict[str, np.ndarray] = {
            name: image.reshape(*shape, *image.shape[3:]) for name, image in images.items()
        }
        if len(outputs.members):
            entries[FRACTION] = self._measure(poses, outputs.members_of(of_object[:-1]), changes)
        return outputs.entries(entries, axis=1)

    def _measure(
        self, poses: WorldPoses, members: NDArray[np.bool_], changes: dict[str, np.ndarray]
    ) -> NDArray[np.float32]:
        """Compute visible fractions, 0 for invisible objects, shape ``(C, W, objects)``."""
        fractions = np.zeros((len(self._chosen), len(poses.geom_xpos), len(members)), dtype=np.float32)
        shown = np.flatnonzero(members.any(axis=1))
        if len(shown):
            groups = [np.flatnonzero(mine).tolist() for mine in members[shown]]
            found = self._batch._measure_groups(poses, groups, self._chosen, None, changes or None)
            fractions[:, :, shown] = found["fraction"].numpy().transpose(1, 0, 2)
        return fractions


def _replace_poses(observation: dict[str, Any], images: dict[str, np.ndarray]) -> dict[str, Any]:
    return {name: value for name, value in observation.items() if name != POSES} | images


def require_poses(env: gym.vector.VectorEnv) -> spaces.Dict:
    """Return the space of an environment's observations, or raise a `SceneError` if these have no poses."""
    if not isinstance(env, gym.vector.VectorEnv):
        raise SceneError(f"env must be a gymnasium.vector.VectorEnv, got {type(env).__name__}")
    single = env.single_observation_space
    if not isinstance(single, spaces.Dict) or POSES not in single.spaces:
        raise SceneError(
            "every environment must be wrapped in warpvis.mujoco.gymnasium.PoseObservation, the last of those that "
            "change observations"
        )
    return single


def shared_model(env: gym.vector.VectorEnv) -> mujoco.MjModel:
    """Return the model that the environments share."""
    base = env.unwrapped
    if not hasattr(base, "call") or not hasattr(base, "set_attr"):
        raise SceneError(f"env must be a SyncVectorEnv or an AsyncVectorEnv, got {base}")
    base.set_attr("pose_index", list(range(env.num_envs)))
    found = base.call("pose_model")
    different = [index for index, (digest, _) in enumerate(found) if digest != found[0][0]]
    if different:
        raise SceneError(
            f"environments must have equal models and shapes, got a difference between {different[0]} and 0; "
            "wrap each in a DepthObservation instead"
        )
    model = found[0][1]
    assert isinstance(model, mujoco.MjModel)
    return model
