# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A wrapper that adds images to the observations of one environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.core.arrays import get_device
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.mujoco._batch_views import CameraChoice
from warpvis.mujoco._renderer import Renderer
from warpvis.mujoco._scene import shown_by
from warpvis.mujoco.gymnasium._environments import Draws, add_entries, find_simulation, view_draws, with_entries
from warpvis.mujoco.gymnasium._outputs import (
    DEPTH,
    FRACTION,
    SEGMENTATION,
    Outputs,
    Segmentation,
    VisibleFractions,
    shapes_of_objects,
)
from warpvis.rendering import DepthSensor, Fill


class DepthObservation(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Adds depth, segmentation and visible fractions to the observations of a MuJoCo environment.

    Observations are dictionaries of the original observation, under ``"state"`` if it is not a dictionary (as in
    Gymnasium's `AddRenderObservation`), and new arrays owned by the caller:

    - ``"depth"``: planar depth [m], ``(height, width)`` float32.
    - ``"segmentation"``: numbers of geoms, bodies or classes, -1 for none, ``(height, width)`` int32.
    - ``"visible_fraction"``: visible pixels of each of `objects`, relative to those of the isolated object on a canvas
      three times as wide and high as the image, ``(objects,)`` float32.

    They show the environment's current `data`, like its `render`, and follow changes of its `model`. With several
    cameras, arrays have a leading axis for cameras, like channels in PyTorch.

    Example:
        >>> env = DepthObservation(gym.make("Ant-v5"), camera="track", objects=["torso"])
        >>> env.observation_space["depth"].shape
        (84, 84)
    """

    def __init__(
        self,
        env: gym.Env,
        *,
        camera: CameraChoice | Sequence[CameraChoice] = -1,
        width: int = 84,
        height: int = 84,
        outputs: Sequence[str] = ("depth",),
        objects: Sequence[str] = (),
        segmentation: Segmentation = "geom",
        fill: Fill = "far",
        sensor: DepthSensor | None = None,
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = 1,
    ) -> None:
        """Wrap an environment.

        Args:
            env: An environment whose `unwrapped` has a `mujoco.MjModel` as `model` and a `mujoco.MjData` as `data`, as
                in Gymnasium, gymnasium-robotics and Meta-World. robosuite's `sim` and dm_control's `physics` are found
                too.
            camera: A camera's name or id, -1 for the default free camera, a `mujoco.MjvCamera`; or several.
            width: Image width [px].
            height: Image height [px].
            outputs: ``"depth"``, ``"segmentation"``, or both; with a sensor, also ``"reasons"``
                (`warpvis.sensors.Reason`) and ``"true_depth"``, +inf for no hit.
            objects: Names or patterns of geoms or bodies for visible fractions.
            segmentation: ``"geom"`` or ``"body"`` for their ids; or numbers by name or pattern of geoms or bodies,
                ``{"object*": 1}``, where the last match applies.
            fill: Depth of empty pixels: ``"far"`` for the camera's far plane, a number [m], or ``"inf"``.
            sensor: A depth camera model, such as `warpvis.sensors.realsense_d435()`, which computes depth. Its noise
                depends on the last seed of `reset` (random without a seed), and on the numbers of resets and
                observations since. Lost pixels are filled like empty ones, for which `fill` must not be ``"inf"``.
            scene_option: A `mujoco.MjvOption` that selects visible elements, as for `warpvis.mujoco.Renderer`. By
                default no sites are visible, since they are markers that sensors do not see. Options cannot be pickled,
                so each worker must create them.
            device: Device for rendering. A forked worker cannot use a GPU that its parent has used: spawn workers, or
                render all environments in one process with `VectorDepthObservation`.
            threads: Number of CPU threads. The default of 1 is for parallel environments, one per worker, which would
                otherwise oversubscribe the cores; None uses all cores, for a single environment.

        Raises:
            WarpvisError: If the environment has no MuJoCo model, or an argument is invalid.
        """
        model, _ = find_simulation(env)
        chosen: dict[str, Any] = {"camera": camera, "width": width, "height": height, "outputs": outputs}
        chosen |= {"objects": objects, "segmentation": segmentation, "fill": fill, "sensor": sensor}
        self._outputs = Outputs(model, **chosen)
        shown_by(scene_option)
        threads = check_threads(threads)
        if device is not None and not isinstance(device, str):
            device = get_device(device).alias  # other types cannot be recorded
        chosen |= {"scene_option": scene_option, "device": device, "threads": threads}
        gym.utils.RecordConstructorArgs.__init__(self, **chosen)
        super().__init__(env)
        self._option, self._device, self._threads = scene_option, device, threads
        self._renderer: ImageRenderer | None = None
        self._draws = Draws()
        self.observation_space = with_entries(env.observation_space, self._outputs.spaces)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], Any]:
        """Reset the environment, and render images."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._draws.reset(seed)
        return self.observation(observation), info

    def observation(self, observation: Any) -> dict[str, Any]:
        """Add images of the current state."""
        model, data = find_simulation(self.env)
        if self._renderer is None or self._renderer.model is not model:
            # Created lazily, since a vector environment creates one environment only for its spaces.
            height, width = self._outputs.shape
            self._renderer = ImageRenderer(model, height, width, device=self._device, threads=self._threads)
        numbers = view_draws(self._draws.next()[None], len(self._outputs.cameras))
        rendered, option = [], self._option or _without_sites()
        for camera, draws in zip(self._outputs.cameras, numbers[:, 0], strict=True):
            self._renderer.update_scene(data, camera, option)
            rendered.append(self._renderer.images(self._outputs, draws))
        images = {name: np.stack([part[name] for part in rendered]) for name in rendered[0]}
        return add_entries(observation, self._outputs.entries(images))

    def close(self) -> None:
        """Close the environment, and release memory."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        super().close()

    def __getstate__(self) -> dict[str, Any]:
        """Return the picklable state without the renderer, since unpickled environments have other models."""
        return self.__dict__ | {"_renderer": None}


def _without_sites() -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    return option


class ImageRenderer(Renderer):
    """A `warpvis.mujoco.Renderer` that computes depth, segmentation and visible fractions at once."""

    _fractions: VisibleFractions | None = None

    def images(self, outputs: Outputs, draws: NDArray[np.uint32]) -> dict[str, np.ndarray]:
        """Render the scene of the last `update_scene`: images ``(H, W)`` and visible fractions ``(objects,)`` by name.

        In segmentation, pixels have the number of their geom or site, or -1. `draws` are the number and frame of the
        view, for a sensor's random numbers.
        """
        stage, camera = self._stage, self._camera
        assert camera is not None
        if not len(stage.scene):
            far = {"far": camera.far, "inf": np.inf}
            depth = far[outputs.fill] if isinstance(outputs.fill, str) else outputs.fill
            entries = self._nothing(outputs.images) | {FRACTION: np.zeros(len(outputs.members), dtype=np.float32)}
            return entries | {DEPTH: np.full(self._size, depth, dtype=np.float32)}
        places = stage.object_poses()
        view_index, frame = (None, None) if outputs.sensor is None else (draws[:1], draws[1:])
        options: dict[str, Any] = {"object_poses": places, "exclude": stage.hidden}
        renderer = self._renderer_of(outputs.images, camera, fill=outputs.fill, sensor=outputs.sensor)
        views = renderer.render(self._pose[None], view_index=view_index, frame=frame, **options)
        entries = {name: getattr(views, name).numpy()[0] for name in outputs.images}
        if SEGMENTATION in entries:
            segmentation, of_object = entries[SEGMENTATION], shapes_of_objects(stage.shapes, stage.scene)
            entries[SEGMENTATION] = of_object[segmentation]
        if len(outputs.members):
            hidden = np.zeros((1, len(stage.scene)), dtype=bool)
            hidden[:, stage.hidden] = True
            members, eye = outputs.members_of(of_object[:-1]), self._pose[None]
            if self._fractions is None or self._fractions.scene is not stage.scene:
                self._fractions = VisibleFractions(stage.scene, self._threads)
            entries[FRACTION] = self._fractions.count(camera, segmentation[None], members, eye, places, hidden)[0]
        return entries
