# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""One environment, and images of it in its observations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np

from warpvis.core.arrays import get_device
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.mujoco._batch_cameras import CameraChoice
from warpvis.mujoco._options import shown_by
from warpvis.mujoco.gymnasium._draws import Draws, view_draws
from warpvis.mujoco.gymnasium._environments import add_entries, find_simulation, with_entries
from warpvis.mujoco.gymnasium._image_renderer import ImageRenderer
from warpvis.mujoco.gymnasium._outputs import Outputs, Segmentation
from warpvis.rendering import DepthSensor, Fill


class DepthObservation(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Adds depth, segmentation and visible fractions to the observations of an environment on MuJoCo.

    Observations are dictionaries: what they were, under ``"state"`` if it was no dictionary (as Gymnasium's
    `AddRenderObservation` has it), and new arrays that belong to the caller:

    - ``"depth"``: planar depth [m], ``(height, width)`` float32.
    - ``"segmentation"``: numbers of geoms, bodies or classes, -1 for nothing, ``(height, width)`` int32.
    - ``"visible_fraction"``: how much of each of `objects` shows, of what would if it were alone in the world, on a
      canvas three times as wide and as high as the image, ``(objects,)`` float32.

    They show the environment's `data` as it is, as its own `render` does, and follow what is changed in its `model`.
    For several cameras they have a leading axis for them, as channels have in PyTorch.

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
            env: Whose `unwrapped` has a `mujoco.MjModel` as `model` and a `mujoco.MjData` as `data`: Gymnasium's,
                gymnasium-robotics', Meta-World's; robosuite's `sim` and dm_control's `physics` are found, too.
            camera: A camera's name or id, -1 for the default free camera, a `mujoco.MjvCamera`; or several.
            width: Image width [px].
            height: Image height [px].
            outputs: ``"depth"``, ``"segmentation"``, or both; with a sensor, also ``"reasons"``
                (`warpvis.sensors.Reason`) and ``"true_depth"``, +inf where nothing is.
            objects: Names or patterns of geoms or bodies to give visible fractions of.
            segmentation: ``"geom"`` or ``"body"`` for their ids; or numbers by name or pattern of geoms or bodies,
                ``{"object*": 1}``, of which the last that fits counts.
            fill: Depth of empty pixels: ``"far"`` for the camera's far plane, a number [m], or ``"inf"``.
            sensor: A model of a depth camera, such as `warpvis.sensors.realsense_d435()`: depth is what it would say.
                Noise follows from the last seed that `reset` was given, or without one from chance, and from the number
                of resets since and of observations since the last. Pixels that were lost are filled as empty ones are,
                for which `fill` must not be ``"inf"``.
            scene_option: A `mujoco.MjvOption`: what shows, as for `warpvis.mujoco.Renderer`. Without it no sites do:
                they are marks, which no sensor sees. It cannot be pickled, so workers make their own.
            device: Where to render. A worker that was forked cannot use a GPU that its parent has used: spawn workers,
                or render all of them in one process by `VectorDepthObservation`.
            threads: CPU threads to use. One by default, because environments run side by side, one in each worker, and
                more threads than cores take turns; None for all cores of a single environment.

        Raises:
            WarpvisError: The environment has no MuJoCo model, or an argument is not what it has to be.
        """
        model, _ = find_simulation(env)
        self._outputs = Outputs(
            model,
            camera=camera,
            width=width,
            height=height,
            outputs=outputs,
            objects=objects,
            segmentation=segmentation,
            fill=fill,
            sensor=sensor,
        )
        shown_by(scene_option)
        threads = check_threads(threads)
        if device is not None and not isinstance(device, str):
            device = get_device(device).alias  # others cannot be recorded
        gym.utils.RecordConstructorArgs.__init__(
            self,
            camera=camera,
            width=width,
            height=height,
            outputs=outputs,
            objects=objects,
            segmentation=segmentation,
            fill=fill,
            sensor=sensor,
            scene_option=scene_option,
            device=device,
            threads=threads,
        )
        super().__init__(env)
        self._option, self._device, self._threads = scene_option, device, threads
        self._renderer: ImageRenderer | None = None
        self._draws = Draws()
        self.observation_space = with_entries(env.observation_space, self._outputs.spaces())

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[dict[str, Any], Any]:
        """Reset the environment, and render it."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._draws.reset(seed)
        return self.observation(observation), info

    def observation(self, observation: Any) -> dict[str, Any]:
        """Add the images of how everything is now."""
        model, data = find_simulation(self.env)
        if self._renderer is None or self._renderer.model is not model:
            # Made when first needed: a vector environment makes one of its environments for its spaces alone.
            height, width = self._outputs.shape
            self._renderer = ImageRenderer(model, height, width, device=self._device, threads=self._threads)
        numbers = view_draws(self._draws.next()[None], len(self._outputs.cameras))
        made, option = [], self._option or _without_sites()
        for camera, draws in zip(self._outputs.cameras, numbers[:, 0], strict=True):
            self._renderer.update_scene(data, camera, option)
            made.append(self._renderer.images(self._outputs, draws))
        images = {name: np.stack([part[name] for part in made]) for name in made[0]}
        return add_entries(observation, self._outputs.entries(images))

    def close(self) -> None:
        """Close the environment, and let go of the memory."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
        super().close()

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process makes the same of: environments make models of their own there."""
        return self.__dict__ | {"_renderer": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take it over."""
        self.__dict__.update(state)


def _without_sites() -> mujoco.MjvOption:
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    return option
