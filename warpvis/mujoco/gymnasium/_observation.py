# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A wrapper that adds images to the observations of one environment, and the entries of all wrappers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Literal, TypeAlias, Unpack, get_args

import gymnasium as gym
import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from gymnasium import spaces
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.pinhole import check_size
from warpvis.core.arrays import get_device
from warpvis.core.checks import as_items, check_choice, check_number
from warpvis.core.outputs import SENSOR_NAMES
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.mujoco._batch_views import CameraChoice
from warpvis.mujoco._cameras import camera_from_mujoco
from warpvis.mujoco._model_fields import shape_bodies, shape_count
from warpvis.mujoco._renderer import Renderer as MujocoRenderer
from warpvis.mujoco._scene import check_patterns, class_of_geoms, shown_by
from warpvis.mujoco.gymnasium._environments import Draws, add_entries, find_simulation, view_draws, with_entries
from warpvis.rendering import (
    ColorOptions,
    DepthSensor,
    Fill,
    Output,
    Renderer,
    check_colors,
    check_fill,
    require_sensor,
)
from warpvis.scene import Scene
from warpvis.sensors import Reason

_MAX_CAMERAS = 64
_COUNTS = {"rgb": 3, "rgbd": 4}  # channels of images
_PART_BYTES = 1 << 26  # size of images rendered per batch


Segmentation: TypeAlias = Literal["geom", "body"] | Mapping[str, int]
"""Number of a pixel in segmentation: id of its geom or body, or the class of the last pattern that matches either."""

DEPTH, SEGMENTATION, FRACTION, REASONS = "depth", "segmentation", "visible_fraction", "reasons"
TRUE_DEPTH, RGB, RGBD, COLOR = "true_depth", "rgb", "rgbd", "color"
_NAMES = (RGB, DEPTH, RGBD, SEGMENTATION)

Channels: TypeAlias = Literal["last", "first"]
"""Position of the axis of red, green and blue: ``"last"``, as in Gymnasium, or ``"first"``, as in PyTorch."""


class DepthObservation(gym.ObservationWrapper, gym.utils.RecordConstructorArgs):
    """Adds color, depth, segmentation and visible fractions to the observations of a MuJoCo environment.

    Observations are dictionaries of the original observation, under ``"state"`` if it is not a dictionary (as in
    Gymnasium's `AddRenderObservation`), and new arrays owned by the caller:

    - ``"rgb"``: colors, ``(height, width, 3)`` uint8, or ``(3, height, width)`` with ``channels="first"``.
    - ``"depth"``: planar depth [m], ``(height, width)`` float32.
    - ``"rgbd"``: colors and depth as four channels of uint8, where 0 to 255 are the ends of `depth_range`.
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
        if SEGMENTATION in entries:
            segmentation, of_object = entries[SEGMENTATION], shapes_of_objects(stage.shapes, stage.scene)
            entries[SEGMENTATION] = of_object[segmentation]
        if len(outputs.members):
            hidden = np.zeros((1, len(stage.scene)), dtype=bool)
            hidden[:, stage.hidden] = True
            members, eye = outputs.members_of(of_object[:-1]), self._pose[None]
            if self._fractions is None or self._fractions.scene is not stage.scene:
                self._fractions = FractionCounter(stage.scene, self._threads)
            entries[FRACTION] = self._fractions.count(camera, segmentation[None], members, eye, places, hidden)[0]
        return entries


def shapes_of_objects(shapes: ArrayLike, scene: Scene) -> NDArray[np.int32]:
    """Return the geom or site of every object, given for the first ones; -1 for others, and a last -1 for no object."""
    known = np.asarray(shapes, dtype=np.int32)
    return np.pad(known, (0, len(scene) + 1 - len(known)), constant_values=-1)


class Outputs:
    """The entries that a wrapper adds, for one model."""

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        camera: CameraChoice | Sequence[CameraChoice],
        width: int,
        height: int,
        outputs: Sequence[str],
        channels: Channels,
        depth_range: Sequence[float] | None,
        objects: Sequence[str],
        segmentation: Segmentation,
        fill: Fill,
        sensor: DepthSensor | None,
    ) -> None:
        """Check the arguments of a wrapper."""
        single = isinstance(camera, str | int | np.integer | mujoco.MjvCamera)
        self.cameras: list[CameraChoice] = [camera] if single else as_items(camera, "camera", CameraError)
        if not self.cameras:
            raise CameraError("camera must be one or more cameras, got none")
        self.shape = (check_size(height, "height"), check_size(width, "width"))
        self.sensor = None if sensor is None else require_sensor(sensor)
        known = _NAMES if sensor is None else (*_NAMES, *SENSOR_NAMES)
        self.names = [check_choice(name, "outputs", known) for name in as_items(outputs, "outputs")]
        if not self.names or len(set(self.names)) < len(self.names):
            raise ArrayError(f"outputs must be one or more of {', '.join(known)}, each once, got {outputs!r}")
        patterns = check_patterns(objects, "objects")
        self.members = np.array([class_of_geoms(model, {name: 1}, "objects") == 1 for name in patterns], dtype=bool)
        """Whether each geom and site is part of each of `objects`, ``(objects, shapes)``."""
        self.members = self.members.reshape(len(patterns), shape_count(model))
        self.numbers, highest = _numbers(model, segmentation)
        """The number of every geom and site in segmentation, with a last one for no shape (index -1)."""
        self._axes = () if single else (len(self.cameras),)
        self._channels = check_choice(channels, "channels", get_args(Channels))
        self._range = _check_range(model, depth_range)
        seen = [camera_from_mujoco(model, choice, width, height) for choice in self.cameras]
        self.fill, size = fill, (*self._axes, *self.shape)
        bounds: dict[str, tuple[Any, Any, type]] = {
            RGB: (0, 255, np.uint8),
            RGBD: (0, 255, np.uint8),
            DEPTH: (*_depth_bounds(fill, seen, sensed=sensor is not None), np.float32),
            SEGMENTATION: (-1, highest, np.int32),
            REASONS: (0, max(Reason), np.uint8),
            TRUE_DEPTH: (0.0, np.inf, np.float32),
        }
        self.spaces: dict[str, spaces.Space] = {
            name: spaces.Box(low, high, self._size(name, size), dtype)
            for name, (low, high, dtype) in bounds.items()
            if name in self.names
        }
        """The spaces of the entries."""
        if len(self.members):
            self.spaces[FRACTION] = spaces.Box(0.0, 1.0, (*self._axes, len(self.members)), np.float32)

    @property
    def images(self) -> tuple[Output, ...]:
        """The outputs to render."""
        requested = {*self.names, SEGMENTATION} if len(self.members) else set(self.names)
        requested |= {COLOR} if {RGB, RGBD} & requested else set()
        requested |= {DEPTH} if RGBD in requested else set()
        known: tuple[Output, ...] = ("depth", "color", "segmentation", "reasons", "true_depth")
        return tuple(name for name in known if name in requested)

    def members_of(self, shapes: NDArray[np.int32]) -> NDArray[np.bool_]:
        """Return whether geoms and sites (-1 for none) are part of each of `objects`, shape ``(objects, shapes)``."""
        return np.append(self.members, np.zeros((len(self.members), 1), dtype=bool), axis=1)[:, shapes]

    def entries(self, images: Mapping[str, np.ndarray], *, axis: int = 0) -> dict[str, np.ndarray]:
        """Return an observation's entries, owned by the caller, from the images ``(C, ..., H, W)`` of all cameras.

        In segmentation, pixels have the number of their geom or site, or -1. Other images than entries are ignored.
        `axis` is the position of the axis for cameras, if there is one.
        """
        chosen = {name: self._image(name, images) for name in self.spaces}
        if SEGMENTATION in chosen:
            chosen[SEGMENTATION] = self.numbers[chosen[SEGMENTATION]]
        return {name: (np.moveaxis(part, 0, axis) if self._axes else part[0]).copy() for name, part in chosen.items()}

    def _size(self, name: str, size: tuple[int, ...]) -> tuple[int, ...]:
        """Return the shape of an image of ``(..., H, W)`` pixels with its channels."""
        if name not in _COUNTS:
            return size
        return (*size, _COUNTS[name]) if self._channels == "last" else (*size[:-2], _COUNTS[name], *size[-2:])

    def _image(self, name: str, images: Mapping[str, np.ndarray]) -> np.ndarray:
        """Return an entry's image."""
        if name not in _COUNTS:
            return images[name]
        image = images[COLOR]
        if name == RGBD:
            near, far = self._range
            scaled = np.clip((images[DEPTH] - near) * (255 / (far - near)), 0, 255)
            image = np.concatenate([image, np.rint(scaled).astype(np.uint8)[..., None]], axis=-1)
        return image if self._channels == "last" else np.moveaxis(image, -1, -3)


def _check_range(model: mujoco.MjModel, given: Sequence[float] | None) -> tuple[float, float]:
    """Return the depths of the values 0 and 255 [m]."""
    if given is None:
        return 0.0, 2.0 * float(model.stat.extent)
    ends = [check_number(end, "depth_range") for end in as_items(given, "depth_range")]
    if len(ends) != 2 or not 0 <= ends[0] < ends[1]:
        raise ArrayError(f"depth_range must be two increasing depths of at least 0 m, got {given!r}")
    return ends[0], ends[1]


def _numbers(model: mujoco.MjModel, segmentation: Segmentation) -> tuple[NDArray[np.int32], int]:
    if isinstance(segmentation, Mapping):
        numbers = class_of_geoms(model, segmentation, "segmentation")
        highest = int(numbers.max(initial=-1))
    else:
        kind = check_choice(segmentation, "segmentation", ("geom", "body"), SceneError)
        geoms = np.r_[np.arange(model.ngeom), np.full(model.nsite, -1)]
        numbers = geoms if kind == "geom" else shape_bodies(model)
        highest = (model.ngeom if kind == "geom" else model.nbody) - 1
    return np.append(numbers, -1).astype(np.int32), max(highest, 0)


def _depth_bounds(fill: Fill, cameras: Sequence[PlanarCamera], *, sensed: bool) -> tuple[float, float]:
    """Return the bounds of depth."""
    far = max(camera.far for camera in cameras)
    fill = check_fill(fill)
    if fill == "inf" and sensed:
        raise ArrayError('fill must be "far" or a number with a sensor, got "inf", which leaves NaN for lost depth')
    if isinstance(fill, str):
        return (0.0, np.inf) if fill == "inf" else (0.0, far)
    return min(fill, 0.0), max(fill, far)


class FractionCounter:
    """Computes visible fractions of objects of several geoms with overlapping silhouettes.

    `warpvis.object_visibility` does so for single objects. As there, the canvas of silhouettes is three times as wide
    and high as the image.
    """

    def __init__(self, scene: Scene, threads: int | None) -> None:
        self.scene, self._threads = scene, threads
        self._renderers: dict[PlanarCamera, Renderer] = {}

    def _renderer(self, camera: PlanarCamera) -> Renderer:
        """Return the renderer of silhouettes for the camera of the images."""
        if camera not in self._renderers:
            if len(self._renderers) >= _MAX_CAMERAS:  # bounds the memory if the field of view keeps changing
                self._renderers.clear()
            width, height = camera.width, camera.height
            canvas = replace(camera, width=3 * width, height=3 * height, cx=camera.cx + width, cy=camera.cy + height)
            options: dict[str, Any] = {"near_plane": "clip", "cull_backfaces": True, "threads": self._threads}
            self._renderers[camera] = Renderer(self.scene, canvas, outputs=("segmentation",), **options)
        return self._renderers[camera]

    def count(
        self,
        camera: PlanarCamera,
        segmentation: NDArray[np.int32],
        members: NDArray[np.bool_],
        eyes: NDArray[np.float32],
        object_poses: NDArray[np.float32] | None,
        hidden: NDArray[np.bool_],
    ) -> NDArray[np.float32]:
        """Compute visible fractions of K objects in V views, 0 for invisible objects, shape ``(V, K)``.

        Args:
            camera: The camera of the images.
            segmentation: Indices of the scene's objects, or -1, shape ``(V, H, W)``.
            members: Whether each of the scene's objects is part of a named object, shape ``(K, objects)``.
            eyes: Camera to world, rows ``x y z qx qy qz qw``, shape ``(V, 7)``.
            object_poses: Poses of movable objects, shape ``(V, M, 7)``; None without any.
            hidden: Whether each of the scene's objects is hidden, shape ``(V, objects)``.
        """
        is_member = np.append(members, np.zeros((len(members), 1), dtype=bool), axis=1)
        visible = np.stack([mine[segmentation].sum(axis=(1, 2)) for mine in is_member], axis=1)
        isolated = np.zeros_like(visible)
        views, names = np.nonzero(visible)
        renderer = self._renderer(camera)
        step = max(1, _PART_BYTES // (4 * renderer.camera.width * renderer.camera.height))
        for first in range(0, len(views), step):
            batch, mine = views[first : first + step], names[first : first + step]
            seen = renderer.render(
                eyes[batch],
                object_poses=None if object_poses is None else object_poses[batch],
                exclude=(hidden[batch] | ~members[mine]).astype(np.uint8),
            )
            assert seen.segmentation is not None
            isolated[batch, mine] = (seen.segmentation.numpy() >= 0).sum(axis=(1, 2))
        # Pixel coordinates of the canvas differ, so that rounding may lose a pixel at an edge.
        total = np.maximum(isolated, visible)
        return np.divide(visible, total, out=np.zeros(visible.shape, dtype=np.float32), where=total > 0)
