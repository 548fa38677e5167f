# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The visibility map in 3D: which parts of space depth images show to be free, which hold a surface, which are hidden.

The grid is that of occupancy mapping: each view clears what lies before the surface that it shows, and says nothing of
what lies behind it (Hornung et al., OctoMap, Autonomous Robots 2013). Views are taken as exact, so one is enough.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Literal

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from warpvis.core.arrays import as_numpy, check_metres, empty
from warpvis.core.camera import Camera
from warpvis.core.checks import pluralize
from warpvis.core.depth_images import read_depth, read_labels
from warpvis.core.image_cameras import ImageCamera, require_image_camera
from warpvis.core.kernel_cache import launch
from warpvis.core.labels import Label, LabelNames
from warpvis.core.poses import Convention, QuaternionOrder, check_up, parse_poses, to_xyzw
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput, DeviceLike, Excluded, ObjectPoses, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps._lens_voxels import add_lens_views
from warpvis.maps._map_labels import ground_bits, read_classes
from warpvis.maps._voxel_map import VoxelMap, check_same_grid, check_same_ground, require_map
from warpvis.rendering import Renderer
from warpvis.scene import Scene
from warpvis.scene.worlds import parse_worlds, part_of

_MAX_VOXELS = 2**31 - 1

# Depth and labels of 218 images of 320x240: 84 MB.
_PIXELS_AT_A_TIME = 2**24


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
    """Tell which voxels of a box depth images show to be free, which hold a seen surface, and which are hidden.

    A voxel is, by the first of these that is true in any view:

    - `Voxel.SURFACE` if the point of a pixel with depth lies in it, as `back_project` gives it, unrounded; or if the
      ray through its middle meets the seen surface in it: the middle lies in some pixel, and the point of that ray at
      the pixel's depth is in the voxel. The second is what closes surfaces whose pixels lie voxels apart. A
      voxel holds its least faces by the first rule, and all of them by the second.
    - `Voxel.FREE` if its middle is in the image, from the camera's `near` to its `far`, and nearer than what its pixel
      shows.
    - `Voxel.HIDDEN` if its middle is in the image and in that range, behind what its pixel shows.
    - `Voxel.OUTSIDE` else.

    A surface that lies on the border of two voxels, as a floor at a height of 0 does where the box begins there, falls
    into either by rounding: begin the box half a voxel lower.

    Args:
        depth: Depth of the camera's kind [m], planar of a pinhole, measured or rendered, shape ``(V, H, W)`` float32,
            or ``(H, W)`` for one view. +inf is nothing up to `far`, and so is a finite depth beyond it; -inf is
            something nearer than `near`, which hides all behind it, and so is a depth between 0 and `near` (REP 117).
            0, negative and NaN is not measured, and says nothing. Millimeters are refused where arrays on the host
            plainly hold them; arrays on a GPU are not examined.
        camera: The camera that took the images: a pinhole, or a `warpvis.sensors.LensCamera`, through which voxels are
            projected on the host; a pixel without a ray says nothing.
        camera_to_world: Its poses, shape ``(V, 7)`` or ``(V, 4, 4)``.
        bounds: Least and greatest corner of the box [m], shape ``(2, 3)``. Voxels begin at the least one; the last of
            an axis may reach beyond the greatest.
        cell_size: Side of a voxel [m].
        labels: Label of every pixel, as `classify` or `Renderer.render` gives them, of the shape of `depth`, uint8;
            by default every surface is `Label.OBSTACLE`.
        label_names: Names of classes of your own: a scene's `label_names`.
        ground_labels: Classes that are ground: a scene's `ground_labels`. By default those of `out`, or else
            `Label.GROUND`.
        up: The world's vertical axis, which `VoxelMap.floor_map` looks along.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        device: Where to compute; by default where `out` is, or else the images.
        threads: CPU threads, all cores by default.
        out: An earlier map of the same grid, which these views are added to: so maps of several cameras and agents
            become one.

    Returns:
        One map of all views; `out` if it was given.

    Raises:
        WarpvisError: A shape, dtype, device or value is not what it has to be.
    """
    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    if out is not None and device is None:
        device = require_map(out, "out").states.device
    images = read_depth(depth, camera, device)
    device = images.device
    poses = parse_poses(camera_to_world, convention=convention, device=device)
    if len(poses) != len(images):
        raise ArrayError(
            f"depth has {pluralize(len(images), 'view')} and camera_to_world has {len(poses)}; give one pose a view"
        )
    pixel_labels = None if labels is None else read_labels(labels, images.shape, device)
    given: Iterable[Label | int | str] = (Label.GROUND,) if ground_labels is None else ground_labels
    _, ground = read_classes(label_names, given)
    if out is not None and ground_labels is None:
        ground = require_map(out, "out").ground_labels
    result = _map_for(bounds, cell_size, up, device, out, label_names, ground)
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
    """Map what views of a scene show: `voxel_map` of their depth and labels, which are rendered in parts.

    Args:
        scene: What is seen; its vertical axis is the map's.
        camera: Intrinsics, image size and depth range of all views; or a `warpvis.sensors.LensCamera`.
        camera_to_world: Poses, as for `Renderer.render`.
        bounds: Least and greatest corner of the box [m], shape ``(2, 3)``. By default those of `out`, or else the
            scene's, with movable objects where they were added, and one and a half voxels more on every side: a floor
            or a wall that ends the scene then lies in the middle of voxels, not on their border.
        cell_size: Side of a voxel [m].
        object_poses: As for `Renderer.render`. One map shows all worlds that the views are of.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: CPU threads, all cores by default.
        out: An earlier map of the same grid, which these views are added to.

    Returns:
        One map of all views, on the scene's device; `out` if it was given.

    Raises:
        WarpvisError: An argument is not what it has to be.
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
        box = scene.bounds.astype(np.float64) + [
            [-1.5 * check_metres(cell_size, "cell_size", zero=False)],
            [1.5 * cell_size],
        ]
    classes = (scene.label_names, scene.ground_labels)
    result = _map_for(box, cell_size, scene.up, scene.device, out, *classes)
    step = max(1, _PIXELS_AT_A_TIME // (camera.width * camera.height))
    for first in range(0, len(poses), step):
        part = slice(first, min(first + step, len(poses)))
        seen, some = part_of(worlds, part), poses[part]
        places = seen.object_poses if scene.movable else None
        views = renderer.render(some, object_poses=places, world_index=seen.world, exclude=seen.excluded)
        _add_views(result, views.depth, views.labels, camera, some, threads)
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
    """Make a map of which nothing is known yet, or `out` if that is there and of this grid and ground."""
    check_up(up)
    origin, size, side = _check_grid(bounds, cell_size)
    if out is None:
        states, labels = _zeros(size, wp.uint8, device), _zeros(size, wp.uint8, device)
        return VoxelMap(states, labels, origin, side, up, LabelNames(label_names), ground)
    check_same_grid(out, "out", origin, size, side, up, device)
    check_same_ground(out, "out", ground)
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
    """Raise a map by what views show, on the device of all of them."""
    from warpvis.kernels import voxels as kernels
    from warpvis.kernels.points import camera_frames

    device, size = target.states.device, target.states.shape
    frames = [wp.empty(len(poses), dtype=dtype, device=device) for dtype in (wp.vec3d, wp.mat33d)]
    launch(camera_frames, len(poses), [poses, *frames], device)
    grid = kernels.VoxelGrid()
    grid.origin, grid.cell, grid.size = wp.vec3d(*target.origin), target.cell_size, wp.vec3i(*size)
    grid.ground = ground_bits(target.ground_labels)
    # Flat: Warp counts the bytes from one index of a first axis to the next in 32 bits.
    marks = _zeros((math.prod(size),), wp.int32, device)
    if not isinstance(camera, Camera):
        add_lens_views(target, grid, depth, labels, camera, poses, frames, marks, threads)
        return
    lens = camera.device_struct()
    launch_images(
        kernels.mark_surface_points,
        depth.shape,
        lambda window: [lens, *frames, window, grid, depth, labels, marks],
        device=device,
        threads=1,  # on the CPU, Warp's atomics are not: only one thread may write to the marks
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
    """Check a grid's box, and return origin, size and side of a grid's voxels."""
    side = check_metres(cell_size, "cell_size", zero=False)
    corners = as_numpy(bounds, name="bounds").astype(np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all() or (corners[1] <= corners[0]).any():
        raise ArrayError(
            f"bounds must be the least and the greatest corner of a box, shape (2, 3), got {corners.tolist()}"
        )
    # A box of 4 m in voxels of 2 cm has 200 of them, whatever the quotient's last digit says.
    x, y, z = np.ceil((corners[1] - corners[0]) / side - 1e-6).clip(min=1)
    if x * y * z > _MAX_VOXELS:
        raise ArrayError(
            f"a grid of {x:.0f} x {y:.0f} x {z:.0f} voxels is too large, {_MAX_VOXELS} are the most; "
            f"give a larger cell_size than {side} m"
        )
    first, second, third = corners[0].tolist()
    return (first, second, third), (int(x), int(y), int(z)), side
