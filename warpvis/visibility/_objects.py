# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fraction of each object in views, and what hides the rest."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import check_length, empty
from warpvis.core.checks import as_items, check_flag, check_whole, is_whole
from warpvis.core.kernel_cache import launch
from warpvis.core.labels import Visibility
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, SceneError
from warpvis.maps import OccupancyMap
from warpvis.rendering import CasterName, Output, Renderer, Views, seen_objects, warn_of_eyes_inside, warn_of_units
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds, part_of
from warpvis.visibility._measured_space import MeasuredSpace, as_space, hide_pixels, judge_unknown
from warpvis.visibility._silhouettes import SilhouetteCounter

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds

BOP_DELTA = 0.015
"""The `delta` of BOP's toolkit [m] (``scripts/calc_gt_info.py``); 0.005 for ITODD and for renderings to train with."""

# Counters, in the kernels' order, and results that are computed from them.
COUNTERS = ("visible_pixels", "image_pixels", "silhouette_pixels", "too_near_pixels", "too_far_pixels")
_RESULTS = {
    "fraction": wp.float32,
    "status": wp.uint8,
    "occluder": wp.int32,
    "visible_box": wp.vec4i,
    "silhouette_box": wp.vec4i,
}

# Maximum size of the images of a batch of views [bytes]; on the CPU, they stay in its caches until they are counted.
_CPU_BYTES, _CUDA_BYTES = 1 << 24, 1 << 30


@dataclass(frozen=True)
class ObjectVisibility:
    """Visibility of K objects in V views: `wp.array`s on the scene's device, indexed ``[view, object]``."""

    objects: tuple[int, ...]
    """Indices of the objects in the scene."""
    names: tuple[str, ...]
    """Their names."""
    visible_pixels: wp.array
    """Pixels of the image that show the object within the camera's range, ``(V, K)`` int32; with a `delta`, also
    pixels where it is up to `delta` behind the visible surface."""
    image_pixels: wp.array
    """Pixels of the image that the isolated object covers, at any depth, ``(V, K)`` int32."""
    silhouette_pixels: wp.array
    """Pixels of the canvas that the isolated object covers, at any depth, ``(V, K)`` int32."""
    too_near_pixels: wp.array
    """Pixels among `image_pixels` where the object is nearer than the camera's ``near``, ``(V, K)`` int32."""
    too_far_pixels: wp.array
    """Pixels among `image_pixels` where the object is farther than the camera's ``far``, ``(V, K)`` int32."""
    fraction: wp.array
    """`visible_pixels` / `silhouette_pixels`, BOP's ``visib_fract``, ``(V, K)`` float32; 0 without a silhouette."""
    status: wp.array
    """`Visibility.VISIBLE`, or the reason that applies to most pixels of the image, ``(V, K)`` uint8: OCCLUDED,
    TOO_NEAR, TOO_FAR (also for an unoccluded object with too few pixels), or OUT_OF_VIEW if it covers no pixel."""
    occluder: wp.array
    """Index of the object that hides most of its pixels in the image, -1 if no pixel is hidden, ``(V, K)`` int32."""
    visible_box: wp.array
    """Bounding box of the visible pixels: x, y, width and height [px], all -1 if there are none, ``(V, K)`` vec4i."""
    silhouette_box: wp.array
    """Bounding box of the silhouette on the canvas in the same format, relative to the image's first pixel: x and y may
    be negative."""
    unknown_pixels: wp.array | None = None
    """Pixels of the image that show the object in the scene, but through space that was never measured, ``(V, K)``
    int32; None without an occupancy map."""
    masks: wp.array | None = None
    """2 where the object is visible, 1 elsewhere in its silhouette, otherwise 0, ``(V, K, H, W)`` uint8; None if not
    requested."""


def object_visibility(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    objects: Sequence[str | int] | None = None,
    delta: float = 0.0,
    canvas: tuple[int, int, int, int] | None = None,
    min_pixels: int = 1,
    skip_unseen: bool = False,
    masks: bool = False,
    occupancy: OccupancyMap | MeasuredSpace | None = None,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    caster: CasterName = "auto",
    threads: int | None = None,
) -> ObjectVisibility:
    """Measure objects in many views: visible pixels, silhouettes, fractions, boxes, masks and reasons of invisibility.

    An object's silhouette is the set of pixels that it covers without other objects, on a canvas larger than the image.
    This is BOP's definition (Hodan et al., "BOP: Benchmark for 6D Object Pose Estimation", ECCV 2018; code in
    ``bop_toolkit_lib/visibility.py``), with a canvas three times as wide and as high as the image.

    Args:
        scene: The scene.
        camera: Image size, intrinsics and depth range of all views; or a `warpvis.cameras.LensCamera`, for which only
            pixels of the canvas are counted that correspond to a direction.
        camera_to_world: Poses, as for `Renderer.render`.
        objects: Names or indices of the objects; all by default.
        delta: Maximum distance along a pixel's ray by which an object's surface may be behind the visible surface to
            count as visible [m]. 0 counts exactly the pixels that show it; BOP uses `BOP_DELTA`, 15 mm, for its
            measured depth images.
        canvas: Extension of the canvas beyond the image's left, top, right and bottom border [px]; by default the
            image's width and height on each side, as in BOP. Silhouettes are cut off at the canvas border.
        min_pixels: Minimum number of visible pixels for `Visibility.VISIBLE`.
        skip_unseen: Whether silhouettes of objects without a visible pixel may be cut off at the image border. Their
            fraction is 0 in any case; saves time if many views see few objects.
        masks: Whether to compute `ObjectVisibility.masks`.
        occupancy: A map of measured space that may hide the objects, too, or a `MeasuredSpace`, on the scene's device;
            the camera must be a pinhole. Objects are UNKNOWN if most of their hidden pixels are behind space that was
            never measured.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`. An object has no pixels in views that exclude it.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        caster: As for `Renderer`.
        threads: CPU threads to use; all cores of this process by default.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_scene(scene)
    require_image_camera(camera)
    scene.require_objects()
    chosen = choose_objects(scene, objects)
    poses = parse_poses(camera_to_world, convention=convention, device=scene.device)
    worlds = parse_worlds(scene, len(poses), object_poses, world_index, exclude)
    found = see_objects(
        scene,
        camera,
        poses,
        worlds,
        chosen,
        delta=delta,
        canvas=canvas,
        min_pixels=min_pixels,
        skip_unseen=check_flag(skip_unseen, "skip_unseen"),
        masks=check_flag(masks, "masks"),
        space=as_space(occupancy, scene.device),
        caster=caster,
        threads=threads,
    )
    if scene.device.is_cpu and len(poses):
        if quaternion == "xyzw":
            warn_of_order(camera_to_world, convention)
        warn_of_unseen(scene, camera, poses, worlds, found.status, moves=object_poses is not None)
    return found


def warn_of_unseen(
    scene: Scene, camera: ImageCamera, poses: wp.array, worlds: Worlds, status: wp.array, *, moves: bool
) -> None:
    """Warn if no object is visible: scenes may be in millimeters, and cameras inside closed objects.

    Args:
        scene: The scene, on a CPU.
        camera: The camera.
        poses: Poses of the views.
        worlds: Their worlds.
        status: Status of each object in each view, as `ObjectVisibility.status`.
        moves: Whether movable objects may be elsewhere than in the scene.
    """
    seen, states = seen_objects(scene, worlds.excluded), status.numpy()
    unseen = ~(states == Visibility.VISIBLE).any(axis=1)
    if unseen.all() and not (states == Visibility.OCCLUDED).any():
        warn_of_units(scene, camera.far, seen, poses.numpy())
    blind = unseen & (states == Visibility.TOO_NEAR).any(axis=1)
    if moves:
        seen &= ~np.array([item.movable for item in scene.objects])
    warn_of_eyes_inside(scene, camera.near, poses.numpy(), np.flatnonzero(blind), seen)


def see_objects(
    scene: Scene,
    camera: ImageCamera,
    poses: wp.array,
    worlds: Worlds,
    chosen: Sequence[int],
    *,
    delta: float = 0.0,
    canvas: tuple[int, int, int, int] | None = None,
    min_pixels: int = 1,
    skip_unseen: bool = False,
    masks: bool = False,
    space: MeasuredSpace | None = None,
    caster: CasterName = "auto",
    threads: int | None = None,
) -> ObjectVisibility:
    """Measure objects, by index, at parsed poses in parsed worlds; see `object_visibility`."""
    from warpvis.kernels.constants import SILHOUETTE_COUNTERS
    from warpvis.kernels.visibility.silhouettes import judge_silhouettes

    delta, min_pixels = check_length(delta, "delta"), check_whole(min_pixels, "min_pixels")
    canvas = check_canvas(canvas, camera)
    views, count, device = len(poses), len(chosen), scene.device

    # Surfaces outside the depth range occlude too.
    eye = dataclasses.replace(camera, near=0.0, far=math.inf)
    with_depth = delta > 0 or space is not None
    outputs: list[Output] = ["depth", "segmentation"] if with_depth else ["segmentation"]
    renderer = Renderer(scene, eye, outputs=outputs, caster=caster, threads=threads)
    counter = SilhouetteCounter(
        scene,
        camera,
        chosen,
        canvas=canvas,
        delta=delta,
        skip_unseen=skip_unseen,
        caster=renderer.caster,
        threads=renderer.threads,
    )
    counted, result = _allocate(scene, chosen, (views, count), camera if masks else None)
    unknown_pixels = empty((max(1, views), count), wp.int32, name="unknown_pixels", device=device)
    seen = None
    for part in _batches(views, camera, len(outputs), len(scene) * count, device):
        size, part_worlds = part.stop - part.start, part_of(worlds, part)
        seen = renderer.render_parsed(poses[part], part_worlds, out=_first(seen, size))
        counts = wp.zeros((SILHOUETTE_COUNTERS, size, count), dtype=wp.int32, device=device)
        hidden_by = wp.zeros((size, count, len(scene)), dtype=wp.int32, device=device)
        if space is not None:
            unknown = hide_pixels(space, camera, poses[part], chosen, len(scene), seen, renderer.threads)
            wp.copy(unknown_pixels[part], unknown)
        # Without a delta, pixels are compared by their objects alone.
        compared = dataclasses.replace(seen, depth=None) if space is not None and delta == 0 else seen
        counter.count(
            poses[part], part_worlds, compared, counts, hidden_by, None if result.masks is None else result.masks[part]
        )
        outs = [getattr(result, name)[part] for name in _RESULTS]
        launch(judge_silhouettes, (size, count), [counts, hidden_by, min_pixels, *outs], device)
        wp.copy(counted[:, part], counts[: len(COUNTERS)])
    if space is None:
        return result
    unknown_pixels = unknown_pixels[:views]
    judge_unknown(result.image_pixels, result.visible_pixels, unknown_pixels, result.status)
    return dataclasses.replace(result, unknown_pixels=unknown_pixels)


def choose_objects(scene: Scene, objects: Sequence[str | int] | None) -> list[int]:
    """Return the indices of distinct objects given by name or index; all for None."""
    if objects is None:
        return list(range(len(scene)))
    items = as_items(objects, "objects", SceneError)
    chosen = []
    for item in items:
        if isinstance(item, str):
            chosen.append(scene.index(item))
        elif is_whole(item) and 0 <= item < len(scene):
            chosen.append(int(item))
        else:
            raise SceneError(f"objects must be names, or indices from 0 to {len(scene) - 1}, got {item!r}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise SceneError(f"objects must be one or more distinct objects of the scene, got {items}")
    return chosen


def _allocate(
    scene: Scene, chosen: Sequence[int], shape: tuple[int, int], camera: ImageCamera | None
) -> tuple[wp.array, ObjectVisibility]:
    """Allocate the counters in one array, and the results, which include them; also masks if a camera is given."""
    names = tuple(scene.objects[index].name for index in chosen)
    views, count = shape
    # Warp cannot slice an array without rows.
    counted = empty((len(COUNTERS), max(1, views), count), wp.int32, name="counts", device=scene.device)
    arrays = {name: counted[row, :views] for row, name in enumerate(COUNTERS)}
    for name, dtype in _RESULTS.items():
        arrays[name] = empty(shape, dtype, name=name, device=scene.device)
    masks = None
    if camera is not None:
        masks = empty((*shape, camera.height, camera.width), wp.uint8, name="masks", device=scene.device)
        masks.zero_()
    return counted, ObjectVisibility(tuple(chosen), names, **arrays, masks=masks)


def _batches(views: int, camera: ImageCamera, images: int, hidden: int, device: wp.Device) -> list[slice]:
    """Split the views into batches that are rendered together."""
    max_bytes = _CPU_BYTES if device.is_cpu else _CUDA_BYTES
    step = max(1, max_bytes // (camera.width * camera.height * 4 * images + hidden * 4))
    return [slice(first, min(first + step, views)) for first in range(0, views, step)]


def _first(views: Views | None, size: int) -> Views | None:
    """Return the first `size` images of an earlier batch as output memory."""
    if views is None:
        return None
    images = {"depth": views.depth, "segmentation": views.segmentation}
    return Views(**{name: image if image is None else image[:size] for name, image in images.items()})


def check_canvas(canvas: Sequence[float] | None, camera: ImageCamera) -> tuple[int, int, int, int]:
    """Return the extension of a canvas beyond the image's left, top, right and bottom border [px]."""
    if canvas is None:
        return camera.width, camera.height, camera.width, camera.height
    sides = tuple(canvas) if isinstance(canvas, Sequence) else ()
    if len(sides) != 4 or not all(isinstance(side, int | np.integer) and 0 <= side < 1 << 20 for side in sides):
        raise ArrayError(f"canvas must be four whole numbers of pixels: left, top, right, bottom, got {canvas!r}")
    left, top, right, bottom = map(int, sides)
    return left, top, right, bottom
