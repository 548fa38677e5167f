# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering of batches of frames to NumPy arrays, for a process, a Ray actor, or a user's loop, and its warm-up."""

from __future__ import annotations

import inspect
import math
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias, TypeGuard, Unpack

import numpy as np
import warp as wp

from warpvis.batch.formats._base import VISIBILITY_ARRAYS
from warpvis.cameras import ImageCamera, require_image_camera
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import as_numpy, check_length, get_device
from warpvis.core.checks import as_items, check_flag, check_mapping
from warpvis.core.labels import Label
from warpvis.core.outputs import IMAGE_NAMES, OUTPUTS, VISIBILITY
from warpvis.core.poses import parse_poses
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering import (
    CasterName,
    ColorOptions,
    DepthSensor,
    Output,
    Renderer,
    Views,
    as_views,
    check_output_names,
    check_outputs,
    pixel_type,
)
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds
from warpvis.visibility import choose_objects, see_objects

if TYPE_CHECKING:
    from warpvis.cameras.frames import Frames

SceneSource: TypeAlias = Scene | str | os.PathLike[str] | Callable[[], Scene]
"""A scene, a file for `Scene.load`, or a function that returns a scene."""

Batch: TypeAlias = Mapping[str, np.ndarray]
"""Arrays of frames, by name."""

_EXACT_OUTPUTS = (*IMAGE_NAMES, VISIBILITY)

# A camera outside the scene, whose images are one packet of the largest size.
_CAMERA = Camera.from_fov(32, 32, hfov=1.0)
_POSE = np.array([[0.0, 0, -5, 0, 0, 0, 1]])


class FrameRenderer:
    """Renders batches of frames; construction loads the scene and builds the acceleration structures once.

    It is called with a mapping of arrays and returns one, which is the interface of stages of data loaders such as
    Ray Data's ``map_batches``.

    Example:
        >>> renderer = FrameRenderer("room.glb", Camera.kinect(), outputs=("depth", "labels"))
        >>> renderer({"camera_to_world": poses})["depth"].shape
        (16, 240, 320)
    """

    def __init__(
        self,
        scene: SceneSource,
        camera: ImageCamera,
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
        caster: CasterName = "auto",
        **colors: Unpack[ColorOptions],
    ) -> None:
        """Prepare to render.

        Args:
            scene: A scene, a file for `Scene.load`, or a function that returns a scene.
            camera: The camera of all frames.
            outputs: Images of `Renderer`, and ``"visibility"`` for the results of `object_visibility`; visibility is
                computed from the exact scene, also with a sensor.
            objects: Names or indices of the objects whose visibility is computed; all by default.
            exclude: Names or indices of objects that are hidden in all frames.
            delta: As for `object_visibility` [m].
            masks: Whether visibility includes masks.
            any_depth: Whether visibility ignores the camera's range and includes objects at any depth.
            sensor: A model of a depth camera, as for `Renderer`; batches must then contain ``frame``.
            seed: Seed of the sensor's random numbers, as for `Renderer`.
            device: Device to render on; the scene's device by default.
            threads: CPU threads to use; all cores of this process by default.
            caster: As for `Renderer`.
            **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `Renderer`.
        """
        self.outputs = check_batch_outputs(outputs, sensor)
        self.scene = make_scene(scene, device)
        self.camera = require_image_camera(camera)
        self.images = tuple(name for name in self.outputs if _is_image(name))
        eye = camera
        if check_flag(any_depth, "any_depth"):
            eye = replace(camera, near=0.0, far=math.inf)
        self._exclude = choose_excluded(self.scene, exclude) or None
        self._object_visibility = partial(
            see_objects,
            self.scene,
            eye,
            chosen=choose_objects(self.scene, objects) if VISIBILITY in self.outputs else (),
            delta=check_length(delta, "delta"),
            masks=check_flag(masks, "masks"),
            caster=caster,
            threads=threads,
        )
        self._renderer = None
        if self.images:
            options: dict[str, Any] = {"caster": caster, "threads": threads, "sensor": sensor, "seed": seed}
            self._renderer = Renderer(self.scene, self.camera, outputs=self.images, **options, **colors)

    def __call__(self, batch: Batch) -> dict[str, np.ndarray]:
        """Render a batch of n frames.

        Args:
            batch: ``camera_to_world``, rows ``x y z qx qy qz qw`` of OpenCV cameras, shape ``(n, 7)``. Optional
                ``object_poses``: one world for each frame, shape ``(n, M, 7)``; one world for all frames, shape
                ``(1, M, 7)``; or W worlds, with the ``world_index`` of each frame, shape ``(n,)``. With a sensor
                ``frame``, the frames' numbers, shape ``(n,)``: its random numbers depend on them and not on the batch
                that a frame is in. Other entries are returned unchanged.

        Returns:
            The arrays of the batch; one array for each image, ``(n, H, W)`` or ``(n, H, W, 3)``; for visibility
            `warpvis.batch.formats._base.VISIBILITY_ARRAYS`, and ``masks`` if requested, ``(n, K, H, W)`` uint8.
        """
        return {**check_mapping(batch, "batch"), **self.render(batch)}

    def render(self, batch: Batch, *, out: ImageBuffers | None = None) -> dict[str, np.ndarray]:
        """Render a batch and return only the new arrays; arrays in `out` are valid until `out` is reused."""
        if "camera_to_world" not in check_mapping(batch, "batch"):
            raise ArrayError(f"batch must contain camera_to_world, got {', '.join(map(str, batch)) or 'nothing'}")
        poses = as_numpy(batch["camera_to_world"], name="camera_to_world")
        if poses.ndim < 2:
            raise ArrayError(f"camera_to_world must have shape (n, 7) or (n, 4, 4), got {poses.shape}")
        objects, worlds = batch.get("object_poses"), batch.get("world_index")
        arrays: dict[str, np.ndarray] = {}
        if self._renderer is not None:
            single = poses.astype(np.float32) if poses.dtype == np.float64 and poses.ndim == 2 else poses
            out = out or ImageBuffers(self.images, self.camera, len(poses))
            views, arrays = out.first(len(poses))
            options: dict[str, Any] = {"object_poses": objects, "world_index": worlds, "exclude": self._exclude}
            if self._renderer.sensor is not None:
                if "frame" not in batch:
                    raise ArrayError(
                        "batch must contain frame, the numbers of the frames, for the random numbers of a sensor"
                    )
                options |= {"frame": batch["frame"], "view_index": np.zeros(len(poses), dtype=np.int64)}
            self._renderer.render(single, **options, out=views)
        if VISIBILITY in self.outputs:
            arrays |= self._see(poses, objects, worlds)
        return arrays

    def _see(self, poses: np.ndarray, objects: np.ndarray | None, worlds: np.ndarray | None) -> dict[str, np.ndarray]:
        """Compute visibility, and return its arrays under the names used in files."""
        rows = parse_poses(poses, device=self.scene.device)
        seen = self._object_visibility(rows, parse_worlds(self.scene, len(rows), objects, worlds, self._exclude))
        fields = {name: "fraction" if name == "visible_fraction" else name for name in VISIBILITY_ARRAYS}
        arrays = {name: getattr(seen, field) for name, field in fields.items()}
        if seen.masks is not None:
            arrays["masks"] = seen.masks
        return {name: array.numpy() for name, array in arrays.items()}


class ImageBuffers:
    """Reusable host memory for the images of a batch of frames.

    Each image begins at a page boundary, so that it can be written to a file without passing through the kernel's page
    cache. For a GPU the pages are locked (pinned), which makes copies from the device several times as fast.
    """

    def __init__(self, images: Sequence[str], camera: ImageCamera, frames: int, *, pinned: bool = False) -> None:
        """Allocate memory for the images of `frames` frames."""
        shape = (frames, camera.height, camera.width)
        self._arrays = {name: _page_aligned(shape, pixel_type(name), pinned) for name in images}

    def first(self, frames: int) -> tuple[Views, dict[str, np.ndarray]]:
        """Return the first `frames` images twice: as Warp arrays for the renderer, and as NumPy arrays for formats."""
        views = {name: array if frames == len(array) else array[:frames] for name, array in self._arrays.items()}
        return as_views(views), {name: array.numpy() for name, array in views.items()}


def frames_batch(frames: Frames, part: slice) -> Batch:
    """Return the frames of a slice as a batch for `FrameRenderer`, with only the worlds that they use."""
    chosen = frames[part]
    batch: dict[str, np.ndarray] = {"camera_to_world": chosen.camera_to_world}
    batch["frame"] = np.arange(len(frames))[part]
    if chosen.object_poses is not None:
        batch["object_poses"] = chosen.object_poses
        if chosen.world_index is not None:
            worlds, batch["world_index"] = np.unique(chosen.world_index, return_inverse=True)
            batch["object_poses"] = chosen.object_poses[worlds]
            batch["world_index"] = batch["world_index"].astype(np.int32)
    return batch


def check_batch_outputs(outputs: object, sensor: object) -> tuple[str, ...]:
    """Check names of outputs of a batch, and return them; `sensor` is None for exact depth."""
    names = check_outputs(outputs, VISIBILITY)
    images = [name for name in names if _is_image(name)]
    if images:
        check_output_names(images, sensor)
    return names


def choose_excluded(scene: Scene, exclude: Sequence[str | int] | None) -> list[int]:
    """Return the indices of the hidden objects; an empty list for None or an empty sequence."""
    items = [] if exclude is None else as_items(exclude, "exclude", SceneError)
    return choose_objects(scene, items) if items else []


def make_scene(scene: SceneSource, device: DeviceLike) -> Scene:
    """Load or make the scene, and move it to a device; without a device it is not moved."""
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
    """Return whether an output is one of the renderer's images."""
    return output in OUTPUTS


def _page_aligned(shape: tuple[int, ...], dtype: type, pinned: bool) -> wp.array:
    """Allocate a host array that begins at a page boundary."""
    if pinned:
        return wp.empty(shape, dtype=dtype, device="cpu", pinned=True)
    import mmap

    scalar = np.dtype(wp.dtype_to_numpy(getattr(dtype, "_wp_scalar_type_", dtype)))
    full_shape = (*shape, *getattr(dtype, "_shape_", ()))
    size = max(1, math.prod(full_shape) * scalar.itemsize)
    try:
        memory = mmap.mmap(-1, size)
    except (OSError, OverflowError):
        raise ArrayError(
            f"images of shape {shape} need {size / 1e9:.1f} GB, which cannot be allocated. Use fewer frames per shard."
        ) from None
    if hasattr(memory, "madvise") and hasattr(mmap, "MADV_HUGEPAGE"):
        memory.madvise(mmap.MADV_HUGEPAGE)
    host = np.frombuffer(memory, dtype=scalar, count=math.prod(full_shape)).reshape(full_shape)
    return wp.array(host, dtype=dtype, shape=shape, device="cpu", copy=False)


def warmup(
    device: DeviceLike = "cpu",
    *,
    outputs: Sequence[str] = _EXACT_OUTPUTS,
    casters: Sequence[CasterName] = ("packets", "rays"),
) -> float:
    """Compile and load the kernels that rendering on a device needs.

    Compiled kernels stay in Warp's cache (``WARP_CACHE_PATH``), which other processes share. Several processes may call
    this at the same time.

    Args:
        device: Device to render on.
        outputs: Images of `Renderer`, and ``"visibility"``; all by default.
        casters: Casters of `Renderer`; both by default.

    Returns:
        Elapsed time [s], which is short if all kernels were already compiled.
    """
    start = time.perf_counter()
    device = get_device(device)
    names = check_outputs(outputs, VISIBILITY)
    images = [name for name in names if name != VISIBILITY]
    caster_names = as_items(casters, "casters")
    for scene in _scenes(device):
        for caster in caster_names:
            # On a GPU, depth alone and depth with other images are rendered by two different kernels.
            for group in [part for part in (images[:1], images, [VISIBILITY]) if set(part) <= set(names) and part]:
                renderer = FrameRenderer(scene, _CAMERA, outputs=group, caster=caster)
                for views in _view_counts(device) if caster == "packets" else [1]:
                    renderer.render({"camera_to_world": np.repeat(_POSE, views, axis=0)})
    wp.synchronize_device(device)
    return time.perf_counter() - start


def _scenes(device: wp.Device) -> Iterator[Scene]:
    """Yield a static scene, one with a movable mesh, and one with a movable round solid."""
    from warpvis.scene.solids import sphere

    corners, faces = np.eye(3), np.array([[0, 1, 2]])
    for moving in (None, (corners, faces), sphere(1.0)):
        scene = Scene(device=device)
        scene.add((corners, faces), name="stays", label=Label.OBSTACLE)
        if moving is not None:
            scene.add(moving, name="moves", movable=True)
        yield scene


def _view_counts(device: wp.Device) -> list[int]:
    """Return numbers of 32x32 images for which the packets caster selects each of its packet sizes on a GPU."""
    if device.is_cpu:
        return [1]
    processors = device.sm_count
    return [1, 6 * processors + 1, 64 * processors]
