# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A wrapper that adds images to the observations of one environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Unpack

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import get_device
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.mujoco._batch_views import CameraChoice
from warpvis.mujoco._body_visibility import require_perspective
from warpvis.mujoco._renderer import Renderer as MujocoRenderer
from warpvis.mujoco._scene import shown_by
from warpvis.mujoco.gymnasium._environments import Draws, add_entries, find_simulation, view_draws, with_entries
from warpvis.mujoco.gymnasium._outputs import COLOR, DEPTH, FRACTION, SEGMENTATION, Channels, Outputs, Segmentation
from warpvis.rendering import ColorOptions, DepthSensor, Fill, check_colors
from warpvis.scene import Scene
from warpvis.visibility import FractionMeter

_MAX_CAMERAS = 64


class DepthObservation(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Adds color, depth, segmentation and visible fractions to the observations of a MuJoCo environment.

    Observations are dictionaries of the original observation, under ``"state"`` if it is not a dictionary (as in
    Gymnasium's `AddRenderObservation`), and new arrays owned by the caller:

    - ``"rgb"``: colors, ``(height, width, 3)`` uint8, or ``(3, height, width)`` with ``channels="first"``.
    - ``"depth"``: planar depth [m], ``(height, width)`` float32.
    - ``"rgbd"``: colors and depth as four channels of uint8, where 0 to 255 are the ends of `depth_range`.
    - ``"segmentation"``: numbers of geoms, bodies or classes, -1 for none, ``(height, width)`` int32.
    - ``"visible_fraction"``: visible share of the silhouette of each of `objects`, as `warpvis.visible_fractions`,
      ``(objects,)`` float32.

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
        channels: Channels = "last",
        depth_range: Sequence[float] | None = None,
        objects: Sequence[str] = (),
        segmentation: Segmentation = "geom",
        fill: Fill = "far",
        sensor: DepthSensor | None = None,
        scene_option: mujoco.MjvOption | None = None,
        device: DeviceLike = "cpu",
        threads: int | None = 1,
        **colors: Unpack[ColorOptions],
    ) -> None:
        """Wrap an environment.

        Args:
            env: An environment whose `unwrapped` has a `mujoco.MjModel` as `model` and a `mujoco.MjData` as `data`, as
                in Gymnasium, gymnasium-robotics and Meta-World. robosuite's `sim` and dm_control's `physics` are found
                too.
            camera: A camera's name or id, -1 for the default free camera, a `mujoco.MjvCamera`; or several.
            width: Image width [px].
            height: Image height [px].
            outputs: Some of ``"rgb"``, ``"depth"``, ``"rgbd"`` and ``"segmentation"``; with a sensor, also
                ``"reasons"`` (`warpvis.sensors.Reason`) and ``"true_depth"``, +inf for no hit.
            channels: Position of the axis of channels in ``"rgb"`` and ``"rgbd"``: ``"last"`` or ``"first"``.
                Stable-Baselines3 accepts both.
            depth_range: Depths of the values 0 and 255 of ``"rgbd"`` [m]; by default 0 and twice the model's extent.
            objects: Names or patterns of geoms or bodies for visible fractions; cameras must be perspective then.
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
            **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `warpvis.Renderer`.
        """
        model, _ = find_simulation(env)
        chosen: dict[str, Any] = {"camera": camera, "width": width, "height": height, "outputs": outputs}
        chosen |= {"channels": channels, "depth_range": depth_range, "objects": objects, "segmentation": segmentation}
        chosen |= {"fill": fill, "sensor": sensor}
        self._outputs = Outputs(model, **chosen)
        self._colors = check_colors(**colors)
        shown_by(scene_option)
        threads = check_threads(threads)
        if device is not None and not isinstance(device, str):
            device = get_device(device).alias  # other types cannot be recorded
        chosen |= {"scene_option": scene_option, "device": device, "threads": threads}
        gym.utils.RecordConstructorArgs.__init__(self, **chosen, **self._colors)
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
            # Light is that of batches, as of vector environments.
            options: dict[str, Any] = {"lighting": "pixel", "device": self._device, "threads": self._threads}
            self._renderer = ImageRenderer(model, height, width, **options, **self._colors)
            if COLOR not in self._outputs.images:
                self._renderer.enable_depth_rendering()
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


class ImageRenderer(MujocoRenderer):
    """A `warpvis.mujoco.Renderer` that computes depth, segmentation and visible fractions at once."""

    _fractions: FractionCounter | None = None

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
        of_object = shapes_of_objects(stage.shapes, stage.scene)
        if SEGMENTATION in entries:
            entries[SEGMENTATION] = of_object[entries[SEGMENTATION]]
        if len(outputs.members):
            if self._fractions is None or self._fractions.scene is not stage.scene:
                self._fractions = FractionCounter(stage.scene, self._threads)
            members = outputs.members_of(of_object[:-1])
            entries[FRACTION] = self._fractions.count(camera, members, self._pose[None], **options)
        return entries


def shapes_of_objects(shapes: ArrayLike, scene: Scene) -> NDArray[np.int32]:
    """Return the geom or site of every object, given for the first ones; -1 for others, and a last -1 for no object."""
    known = np.asarray(shapes, dtype=np.int32)
    return np.pad(known, (0, len(scene) + 1 - len(known)), constant_values=-1)


class FractionCounter:
    """Computes visible fractions of named objects, which may be of several geoms."""

    def __init__(self, scene: Scene, threads: int | None) -> None:
        self.scene, self._threads = scene, threads
        self._meters: dict[Any, FractionMeter] = {}

    def count(
        self,
        camera: PlanarCamera,
        members: NDArray[np.bool_],
        eye: NDArray[np.float32],
        **options: Any,
    ) -> NDArray[np.float32]:
        """Compute visible fractions of K objects in a view, 0 for invisible objects, shape ``(K,)``.

        Args:
            camera: The camera of the images.
            members: Whether each of the scene's objects is part of a named object, shape ``(K, objects)``.
            eye: Camera to world, ``x y z qx qy qz qw``, shape ``(1, 7)``.
            **options: Poses and excluded objects, as for `FractionMeter.measure`.
        """
        fractions = np.zeros(len(members), dtype=np.float32)
        shown = np.flatnonzero(members.any(axis=1))
        if len(shown):
            groups = tuple(tuple(np.flatnonzero(mine).tolist()) for mine in members[shown])
            meter = self._meter(require_perspective(camera), groups)
            fractions[shown] = meter.measure(eye, **options).fraction.numpy()[0]
        return fractions

    def _meter(self, camera: Camera, groups: tuple[tuple[int, ...], ...]) -> FractionMeter:
        key = camera, groups
        if key not in self._meters:
            if len(self._meters) >= _MAX_CAMERAS:  # bounds the memory if the field of view keeps changing
                self._meters.clear()
            options: dict[str, Any] = {"near_plane": "clip", "cull_backfaces": True, "threads": self._threads}
            self._meters[key] = FractionMeter(self.scene, camera, objects=groups, occluders=0, **options)
        return self._meters[key]
