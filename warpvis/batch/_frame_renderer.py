# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Batches of frames as NumPy arrays: what a process, a Ray actor, or a loop of one's own holds."""

from __future__ import annotations

import inspect
import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard

import numpy as np
import warp as wp

from warpvis.batch.formats._base import VISIBILITY_ARRAYS
from warpvis.core.arrays import as_numpy, check_metres, get_device
from warpvis.core.checks import as_items, check_flag, check_mapping
from warpvis.core.outputs import VISIBILITY
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering import (
    OUTPUTS,
    SENSOR_OUTPUTS,
    Caster,
    DepthSensor,
    Output,
    Renderer,
    Views,
    check_asked,
    check_outputs,
)
from warpvis.scene import Scene, require_scene
from warpvis.sensors import CalibratedCamera, require_calibrated
from warpvis.visibility import choose_objects, see_objects

if TYPE_CHECKING:
    from warpvis.core.frames import Frames

IMAGES = OUTPUTS | SENSOR_OUTPUTS
"""The outputs that are images, and the dtypes of their pixels."""

BATCH_OUTPUTS = (*IMAGES, VISIBILITY)
"""All outputs of a batch; those of `SENSOR_OUTPUTS` with a sensor."""

SceneSource: TypeAlias = Scene | str | os.PathLike[str] | Callable[[], Scene]
"""A scene, a file for `Scene.load`, or a function that makes a scene."""

Batch: TypeAlias = Mapping[str, np.ndarray]
"""Arrays of frames, by name."""


class FrameRenderer:
    """Renders batches of frames; made once, it loads the scene and builds what the casters need.

    It is called with a mapping of arrays and gives one, as stages of data loaders such as Ray Data's
    ``map_batches`` want it.

    Example:
        >>> renderer = FrameRenderer("room.glb", Camera.kinect(), outputs=("depth", "labels"))
        >>> renderer({"camera_to_world": poses})["depth"].shape
        (16, 240, 320)
    """

    def __init__(
        self,
        scene: SceneSource,
        camera: CalibratedCamera,
        *,
        outputs: Sequence[str] = ("depth",),
        objects: Sequence[str | int] | None = None,
        exclude: Sequence[str | int] | None = None,
        delta: float = 0.0,
        masks: bool = False,
        any_depth: bool = False,
        sensor: DepthSensor | None = None,
        seed: int = 0,
        device: DeviceLike = None,
        threads: int | None = None,
        caster: Caster = "auto",
    ) -> None:
        """Prepare to render.

        Args:
            scene: What is seen: a scene, a file for `Scene.load`, or a function that makes one.
            camera: The camera of all frames.
            outputs: Images of `Renderer`, and ``"visibility"`` for what `object_visibility` says, of the exact scene
                with a sensor, too.
            objects: Names or indices of the objects that visibility is of; all by default.
            exclude: Names or indices of objects that no frame shows.
            delta: As for `object_visibility` [m].
            masks: Whether visibility comes with masks.
            any_depth: Whether visibility is of what lies at any depth, whatever the camera's range is.
            sensor: A model of a depth camera, as for `Renderer`; batches say each frame's number then.
            seed: What its random numbers follow from, as for `Renderer`.
            device: Where to render; where the scene is by default.
            threads: CPU threads to use; all cores of this process by default.
            caster: As for `Renderer`.

        Raises:
            WarpvisError: An argument is not what it has to be.
        """
        self.outputs = check_batch_outputs(outputs, sensor)
        self.scene = make_scene(scene, device)
        self.camera = require_calibrated(camera)
        self.images = tuple(name for name in self.outputs if _is_image(name))
        eye = camera
        if check_flag(any_depth, "any_depth"):
            eye = replace(camera, near=0.0, far=math.inf)
        self._exclude = choose_excluded(self.scene, exclude) or None
        self._object_visibility = partial(
            see_objects,
            self.scene,
            eye,
            objects=choose_objects(self.scene, objects) if VISIBILITY in self.outputs else None,
            delta=check_metres(delta, "delta"),
            masks=check_flag(masks, "masks"),
            exclude=self._exclude,
            caster=caster,
            threads=threads,
        )
        self._renderer = None
        if self.images:
            options: dict[str, Any] = {"caster": caster, "threads": threads, "sensor": sensor, "seed": seed}
            self._renderer = Renderer(self.scene, self.camera, outputs=self.images, **options)

    def __call__(self, batch: Batch) -> dict[str, np.ndarray]:
        """Render a batch of n frames.

        Args:
            batch: ``camera_to_world``, rows ``x y z qx qy qz qw`` of OpenCV cameras, shape ``(n, 7)``; optionally
                ``object_poses``, of every frame's own world ``(n, M, 7)``, of one world ``(1, M, 7)``, or of W worlds
                with every frame's ``world_index``, shape ``(n,)``; with a sensor ``frame``, the frames' numbers, from
                which its random numbers follow whatever batch a frame is in, shape ``(n,)``. What else it holds is
                handed on.

        Returns:
            The batch's own arrays; one of every image, ``(n, H, W)`` or ``(n, H, W, 3)``; for visibility
            `warpvis.batch.formats._base.VISIBILITY_ARRAYS`, and ``masks`` if wanted, ``(n, K, H, W)`` uint8.

        Raises:
            WarpvisError: The batch is malformed.
        """
        return {**check_mapping(batch, "a batch"), **self.render(batch)}

    def render(self, batch: Batch, *, out: ImageBuffers | None = None) -> dict[str, np.ndarray]:
        """Render a batch and give the new arrays alone; those in `out` are valid until it is written to again."""
        if "camera_to_world" not in check_mapping(batch, "a batch"):
            raise ArrayError(f"a batch must hold camera_to_world, got {', '.join(map(str, batch)) or 'nothing'}")
        poses = as_numpy(batch["camera_to_world"], name="camera_to_world")
        if poses.ndim < 2:
            raise ArrayError(f"camera_to_world must have shape (n, 7) or (n, 4, 4), got {poses.shape}")
        objects, worlds = batch.get("object_poses"), batch.get("world_index")
        found: dict[str, np.ndarray] = {}
        if self._renderer is not None:
            single = poses.astype(np.float32) if poses.dtype == np.float64 and poses.ndim == 2 else poses
            out = out or ImageBuffers(self.images, self.camera, len(poses))
            views, found = out.first(len(poses))
            options: dict[str, Any] = {"object_poses": objects, "world_index": worlds, "exclude": self._exclude}
            if self._renderer.sensor is not None:
                if "frame" not in batch:
                    raise ArrayError("a batch must hold frame, the frames' numbers, for a sensor's random numbers")
                options |= {"frame": batch["frame"], "view_index": np.zeros(len(poses), dtype=np.int64)}
            self._renderer.render(single, **options, out=views)
        if VISIBILITY in self.outputs:
            found |= self._see(poses, objects, worlds)
        return found

    def _see(self, poses: np.ndarray, objects: np.ndarray | None, worlds: np.ndarray | None) -> dict[str, np.ndarray]:
        """Measure visibility, and name its arrays as files do."""
        seen = self._object_visibility(poses, object_poses=objects, world_index=worlds)
        fields = {name: "fraction" if name == "visible_fraction" else name for name in VISIBILITY_ARRAYS}
        arrays = {name: getattr(seen, field) for name, field in fields.items()}
        if seen.masks is not None:
            arrays["masks"] = seen.masks
        return {name: array.numpy() for name, array in arrays.items()}


class ImageBuffers:
    """Memory of the host for the images of some frames, to be written to again and again.

    Each image begins at a page of memory, so that it can be written to a file without passing through the kernel's
    page cache; for a GPU the pages are locked, which copying from there is several times as fast to.
    """

    def __init__(self, images: Sequence[str], camera: CalibratedCamera, frames: int, *, pinned: bool = False) -> None:
        """Allocate room for images of so many frames."""
        shape = (frames, camera.height, camera.width)
        self._arrays = {name: _page_aligned(shape, IMAGES[name], pinned) for name in images}

    def first(self, frames: int) -> tuple[Views, dict[str, np.ndarray]]:
        """Return the first images twice: as the renderer writes them, and as formats read them."""
        views = {name: array if frames == len(array) else array[:frames] for name, array in self._arrays.items()}
        return Views(**views), {name: array.numpy() for name, array in views.items()}


def frames_batch(frames: Frames, part: slice) -> Batch:
    """Cut out some frames as a batch for `FrameRenderer`, with only the worlds that they are in."""
    some = frames[part]
    batch: dict[str, np.ndarray] = {"camera_to_world": some.camera_to_world}
    batch["frame"] = np.arange(len(frames))[part]
    if some.object_poses is not None:
        batch["object_poses"] = some.object_poses
        if some.world_index is not None:
            worlds, batch["world_index"] = np.unique(some.world_index, return_inverse=True)
            batch["object_poses"] = some.object_poses[worlds]
            batch["world_index"] = batch["world_index"].astype(np.int32)
    return batch


def check_batch_outputs(outputs: object, sensor: object) -> tuple[str, ...]:
    """Take names of outputs of a batch, with a sensor or None.

    Raises:
        ArrayError: There is none, an unknown one, or one of a sensor where there is none.
    """
    names = check_outputs(outputs, BATCH_OUTPUTS)
    images = [name for name in names if _is_image(name)]
    if images:
        check_asked(images, sensor)
    return names


def choose_excluded(scene: Scene, exclude: Sequence[str | int] | None) -> list[int]:
    """Return the indices of objects that no frame shows; none for None or an empty list."""
    given = [] if exclude is None else as_items(exclude, "exclude", SceneError)
    return choose_objects(scene, given) if given else []


def make_scene(scene: SceneSource, device: DeviceLike) -> Scene:
    """Load or make the scene, and take it to a device; by default it stays where it is.

    Raises:
        WarpvisError: It is none, or there is no such device.
    """
    if isinstance(scene, str | os.PathLike):
        scene = Scene.load(scene, device="cpu" if device is None else device)
    elif callable(scene) and not isinstance(scene, type):
        try:
            inspect.signature(scene).bind()
        except (TypeError, ValueError):
            raise SceneError(f"scene must be a scene, a file, or a function without arguments, got {scene!r}") from None
        scene = scene()
    scene = require_scene(scene)
    return scene if device is None or scene.device == get_device(device) else scene.to(device)


def _is_image(output: str) -> TypeGuard[Output]:
    """Tell whether an output is one of the renderer's images."""
    return output in IMAGES


def _page_aligned(shape: tuple[int, ...], dtype: type, pinned: bool) -> wp.array:
    """Allocate an array of the host that begins at a page of memory."""
    if pinned:
        return wp.empty(shape, dtype=dtype, device="cpu", pinned=True)
    import mmap

    scalar = np.dtype(wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype)))
    whole = (*shape, *getattr(dtype, "_shape_", ()))
    size = max(1, math.prod(whole) * scalar.itemsize)
    try:
        memory = mmap.mmap(-1, size)
    except (OSError, OverflowError):
        raise ArrayError(
            f"images of shape {shape} need {size / 1e9:.1f} GB, which could not be had; take fewer frames a shard"
        ) from None
    if hasattr(memory, "madvise") and hasattr(mmap, "MADV_HUGEPAGE"):
        memory.madvise(mmap.MADV_HUGEPAGE)
    host = np.frombuffer(memory, dtype=scalar, count=math.prod(whole)).reshape(whole)
    return wp.array(host, dtype=dtype, shape=shape, device="cpu", copy=False)
