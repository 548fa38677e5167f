# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Construction of voxel maps from depth images: free, surface and hidden voxels.

As in occupancy mapping, each view clears the space in front of the visible surface and provides no information behind
it (Hornung et al., OctoMap, Autonomous Robots 2013). Views are assumed to be exact, so one observation suffices.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.depth_images import read_images, read_labels
from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.pose_meaning import refuse_inconsistent_views
from warpvis.core.arrays import as_box, check_length, empty
from warpvis.core.kernel_cache import launch
from warpvis.core.labels import Label, LabelNames
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    check_convention,
    check_up,
    parse_poses,
    poses_to_matrices,
    to_xyzw,
)
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput, DeviceLike, Excluded, KernelArguments, ObjectPoses, PoseLike
from warpvis.maps._floor_map import count_cells, ground_bits
from warpvis.maps._voxel_map import VoxelMap, check_same_grid, require_map
from warpvis.rendering import Renderer, rays_on_device
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds, part_of

if TYPE_CHECKING:
    from warpvis.kernels.maps.voxels import VoxelGrid
    from warpvis.kernels.pinhole import Window

# Depth and labels of 218 images of 320x240: 84 MB.
_PIXELS_AT_A_TIME = 2**24

# Number of points projected per batch; each needs 200 bytes of temporary memory.
_AT_ONCE = 1 << 19


def voxel_map(
    depth: ArrayInput,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    bounds: ArrayLike,
    cell_size: float = 0.05,
    labels: ArrayInput | None = None,
    label_names: Mapping[int, str] | None = None,
    ground_labels: Iterable[Label | int | str] | None = None,
    up: Literal["z", "y"] = "z",
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    device: DeviceLike = None,
    threads: int | None = None,
    out: VoxelMap | None = None,
) -> VoxelMap:
    """Compute which voxels of a box are free, contain a visible surface, or are hidden in depth images.

    The state of a voxel is the first of these that holds in any view:

    - `Voxel.SURFACE` if it contains the point of a pixel with depth (`back_project` in double precision), or if the ray
      through its center meets the visible surface in it: the center is in a pixel, and the point of that ray at the
      pixel's depth is in the voxel. The second rule closes surfaces whose pixels are more than a voxel apart. A voxel
      includes its lower faces for the first rule, and all faces for the second.
    - `Voxel.FREE` if its center is in the image, between the camera's `near` and `far`, and nearer than the depth of
      its pixel.
    - `Voxel.HIDDEN` if its center is in the image and in that range, behind the depth of its pixel.
    - `Voxel.UNKNOWN` otherwise.

    A surface on the boundary of two voxels, such as a floor at height 0 where the box begins, is in either one due to
    rounding: begin the box half a voxel lower.

    Args:
        depth: Depth of each view [m], measured or rendered, as for `warpvis.point_visibility_from_depth`.
        camera: The camera of the images: a pinhole, or a `warpvis.cameras.LensCamera`, for which voxels are projected
            on the host; its pixels without a ray are ignored.
        camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
        bounds: Lower and upper corner of the box [m], shape ``(2, 3)``. Voxels begin at the lower corner; the last
            voxel of an axis may extend beyond the upper one.
        cell_size: Side of a voxel [m].
        labels: Label of every pixel, from `classify` or `Renderer.render`, of the shape of `depth`, uint8; by default
            every surface is `Label.OBSTACLE`.
        label_names: Names of user-defined classes: a scene's `label_names`.
        ground_labels: Classes that are ground: a scene's `ground_labels`. By default those of `out`, or `Label.GROUND`.
        up: The world's vertical axis, used by `VoxelMap.floor_map`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        device: Device of the computation; by default that of `out`, or of `depth`.
        threads: Number of CPU threads; all cores by default.
        out: An earlier map of the same grid to which these views are added, for example to combine the maps of several
            cameras and agents.

    Returns:
        One map of all views; `out` if given.
    """
    if out is not None and device is None:
        device = require_map(out, "out").states.device
    images, poses = read_images(depth, camera, camera_to_world, convention, quaternion, device)
    if images.device.is_cpu:
        given = check_convention(convention)
        refuse_inconsistent_views(images.numpy(), camera, poses.numpy().reshape(-1, 7), given)
    pixel_labels = None if labels is None else read_labels(labels, images.shape, images.device)
    if out is not None and ground_labels is None:
        ground_labels = require_map(out, "out").ground_labels
    classes: Iterable[Label | int | str] = (Label.GROUND,) if ground_labels is None else ground_labels
    ground = frozenset(LabelNames(label_names).numbers(classes, "ground_labels"))
    result = _map_for(bounds, cell_size, up, images.device, out, label_names, ground)
    _add_views(result, images, pixel_labels, camera, poses, threads)
    return result


def voxel_map_from_scene(
    scene: Scene,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    *,
    bounds: ArrayLike | None = None,
    cell_size: float = 0.05,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
    out: VoxelMap | None = None,
) -> VoxelMap:
    """Compute `voxel_map` of views of a scene, whose depth and labels are rendered in batches.

    Args:
        scene: The scene, whose vertical axis is the map's.
        camera: Intrinsics, image size and depth range of all views; or a `warpvis.cameras.LensCamera`.
        camera_to_world: Poses, as for `Renderer.render`.
        bounds: Lower and upper corner of the box [m], shape ``(2, 3)``. By default those of `out`, or else the scene's,
            with movable objects at their initial poses, extended by one and a half voxels on every side, so that a
            floor or wall at the scene's boundary is in the middle of voxels instead of on their faces.
        cell_size: Side of a voxel [m].
        object_poses: As for `Renderer.render`. The map combines the views of all worlds.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; all cores by default.
        out: An earlier map of the same grid to which these views are added.

    Returns:
        One map of all views, on the scene's device; `out` if given.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    renderer = Renderer(scene, require_image_camera(camera), outputs=("depth", "labels"), threads=threads)
    scene.require_objects()
    poses = parse_poses(camera_to_world, convention=convention, device=scene.device)
    worlds = parse_worlds(scene, len(poses), object_poses, world_index, exclude)
    box: ArrayLike | None = bounds
    if box is None and out is not None:
        box = require_map(out, "out").bounds
    elif box is None:
        margin = 1.5 * check_length(cell_size, "cell_size", zero=False)
        box = scene.bounds.astype(np.float64) + [[-margin], [margin]]
    classes = (scene.label_names, scene.ground_labels)
    result = _map_for(box, cell_size, scene.up, scene.device, out, *classes)
    step = max(1, _PIXELS_AT_A_TIME // (camera.width * camera.height))
    for first in range(0, len(poses), step):
        part = slice(first, min(first + step, len(poses)))
        batch_worlds, batch = part_of(worlds, part), poses[part]
        placed = batch_worlds.object_poses if scene.movable else None
        index, excluded = batch_worlds.world, batch_worlds.excluded
        views = renderer.render(batch, object_poses=placed, world_index=index, exclude=excluded)
        _add_views(result, views.depth, views.labels, camera, batch, threads)
    return result


def _map_for(
    bounds: ArrayLike,
    cell_size: float,
    up: Literal["z", "y"],
    device: wp.Device,
    out: VoxelMap | None,
    label_names: Mapping[int, str] | None,
    ground: frozenset[int],
) -> VoxelMap:
    """Return `out` after checking its grid and ground labels, or an empty map if `out` is None."""
    check_up(up)
    origin, size, side = _check_grid(bounds, cell_size)
    if out is None:
        states, labels = _zeros(size, wp.uint8, device), _zeros(size, wp.uint8, device)
        return VoxelMap(states, labels, origin, side, up, LabelNames(label_names), ground)
    check_same_grid(out, "out", origin, size, side, up, device, ground)
    out.label_names.update({} if label_names is None else label_names)
    return out


def _add_views(
    target: VoxelMap,
    depth: wp.array,
    labels: wp.array | None,
    camera: ImageCamera,
    poses: wp.array,
    threads: int | None,
) -> None:
    """Add views to a map on the same device."""
    from warpvis.kernels.maps import voxels as kernels
    from warpvis.kernels.visibility.points import camera_frames

    device, size = target.states.device, target.states.shape
    frames = [wp.empty(len(poses), dtype=dtype, device=device) for dtype in (wp.vec3d, wp.mat33d)]
    launch(camera_frames, len(poses), [poses, *frames], device)
    grid = kernels.VoxelGrid()
    grid.origin, grid.cell, grid.size = wp.vec3d(*target.origin), target.cell_size, wp.vec3i(*size)
    grid.ground = ground_bits(target.ground_labels)
    # Flat, since Warp's strides are 32-bit.
    marks = _zeros((math.prod(size),), wp.int32, device)
    if camera.ray_model == "table":
        add_lens_views(target, grid, depth, labels, camera, poses, frames, marks, threads)
        return
    lens = camera.device_struct()
    launch_images(
        kernels.mark_surface_points,
        depth.shape,
        lambda window: [lens, *frames, window, grid, depth, labels, marks],
        device=device,
        threads=1,  # Warp's atomics are not atomic on the CPU: only one thread may write to the marks
    )
    launch_images(
        kernels.judge_voxels,
        size,
        lambda window: [lens, *frames, window, grid, depth, labels, marks, target.states, target.labels],
        device=device,
        threads=threads,
    )


def _zeros(shape: tuple[int, ...], dtype: type, device: wp.Device) -> wp.array:
    array = empty(shape, dtype, name="the map", device=device)
    array.zero_()
    return array


def _check_grid(bounds: ArrayLike, cell_size: float) -> tuple[tuple[float, float, float], tuple[int, int, int], float]:
    """Check the box of a grid; return the grid's origin, size and voxel side."""
    side = check_length(cell_size, "cell_size", zero=False)
    corners = as_box(bounds, "bounds")
    x, y, z = count_cells(corners[1] - corners[0], side, "a grid", "voxels")
    first, second, third = corners[0].tolist()
    return (first, second, third), (x, y, z), side


def add_lens_views(
    target: VoxelMap,
    grid: VoxelGrid,
    depth: wp.array,
    labels: wp.array | None,
    camera: LensCamera,
    poses: wp.array,
    frames: list[wp.array],
    marks: wp.array,
    threads: int | None,
) -> None:
    """Add views of a lens; `frames` are the poses by `camera_frames`, and `marks` zeros, one per voxel."""
    from warpvis.kernels.maps import lens_voxels as kernels

    device, lens = target.states.device, camera.device_struct()
    table = rays_on_device(camera, device)
    launch_images(
        kernels.mark_surface_rays,
        depth.shape,
        lambda window: [lens, *frames, window, table, grid, depth, labels, marks],
        device=device,
        threads=1,  # Warp's atomics are not atomic on the CPU: only one thread may write to the marks
    )
    size = target.states.shape
    step = max(1, _AT_ONCE // math.prod(size[1:]))
    for view, row in enumerate(poses.numpy().astype(np.float64)):
        pose = wp.transformd(*row[:3], *(row[3:] / np.linalg.norm(row[3:])))
        for layer in range(0, size[0], step):
            layers = range(layer, min(layer + step, size[0]))
            shown = wp.array(_pixels_of(target, camera, row, layers), dtype=wp.int32, device=device)
            inputs = [wp.vec2i(view, layer), grid, shown, depth, labels, marks, target.states, target.labels]

            def arguments(
                window: Window, pose: wp.transformd = pose, inputs: KernelArguments = inputs
            ) -> KernelArguments:
                return [lens, pose, window, *inputs]

            launch_images(kernels.judge_voxels_at, shown.shape, arguments, device=device, threads=threads)


def _pixels_of(target: VoxelMap, camera: LensCamera, pose: NDArray[np.float64], layers: range) -> NDArray[np.int32]:
    """Find the pixels that contain the voxels' centers, as flat indices; -1 outside of the image or without a ray."""
    counts = layers, *map(range, target.states.shape[1:])
    axes = [low + target.cell_size * (np.array(count) + 0.5) for low, count in zip(target.origin, counts, strict=True)]
    centers = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    matrix = poses_to_matrices(pose)
    seen = (centers - matrix[:3, 3]) @ matrix[:3, :3]
    pixels = camera.project(seen)
    inside: NDArray[np.bool_] = np.all((pixels >= 0) & (pixels < (camera.width, camera.height)), axis=-1)
    if camera.kind == "z":
        inside &= seen[..., 2] > 0
    columns, rows = np.moveaxis(np.where(inside[..., None], pixels, 0).astype(np.int32), -1, 0)
    inside &= np.isfinite(camera.rays[rows, columns, 2])
    return np.where(inside, rows * camera.width + columns, -1).astype(np.int32)
