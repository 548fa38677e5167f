# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Comparison of measured depth images with those that a scene predicts, pixel by pixel."""

from __future__ import annotations

import enum
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.depth_images import read_images
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import require_camera
from warpvis.cameras.pose_meaning import refuse_other_meaning
from warpvis.core.arrays import check_length, empty_images
from warpvis.core.checks import check_flag, check_number, check_whole, format_percent
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    check_convention,
    poses_to_matrices,
    poses_to_opencv,
    to_xyzw,
)
from warpvis.core.threads import WHOLE_ROW, check_threads, launch_images
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError
from warpvis.kernels import constants
from warpvis.maps._depth_sigma import KNOT_STEP, KNOTS, Sigma, tabulate_sigma
from warpvis.maps._occupancy_lookup import render_surface
from warpvis.maps._occupancy_map import OccupancyMap
from warpvis.maps._scene_changes import Evidence, SceneChange, choose_candidates, find_changes
from warpvis.rendering import DepthSensor, Renderer
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds, part_of

# Views whose poses are checked, and difference of depths of the same surface: constant [m], and by depth.
_CHECKED_VIEWS, _CONSTANT, _BY_DEPTH = 3, 0.05, 0.03

# Fraction of agreeing pixels below which the input is probably wrong.
_LOW_AGREEMENT = 0.2

# Largest half side of the window of expected depths [px].
_MAX_EDGE = 32


class Agreement(enum.IntEnum):
    """Whether measured depth agrees with expected depth."""

    NO_MEASUREMENT = constants.DEPTH_NO_MEASUREMENT
    """The pixel has no depth: NaN, infinite, 0, or out of the camera's range."""
    AGREES = constants.DEPTH_AGREES
    """The expected surface was measured."""
    NEARER = constants.DEPTH_NEARER
    """A surface in front of the expected one was measured: something new."""
    FARTHER = constants.DEPTH_FARTHER
    """A surface behind the expected one was measured: something is gone."""
    NO_SURFACE = constants.DEPTH_NO_SURFACE
    """A surface was measured where the scene has none, or where the map is unknown: something new, or a part of the
    world that the scene or the map lacks."""


@dataclass(frozen=True)
class Expected:
    """Expected images, ``(V, H, W)``."""

    depth: wp.array
    """Depth [m]."""
    objects: wp.array
    """Indices of objects, -1 for none."""
    interval: tuple[wp.array | None, wp.array | None] = (None, None)
    """Depths between which the surfaces of a map are [m]."""


_Expect: TypeAlias = Callable[[wp.array, slice | NDArray[np.integer], Sequence[int]], Expected]
"""Returns the images expected at poses, for some of the views, without some objects."""


@dataclass(frozen=True, eq=False)
class DepthComparison:
    """Measured against expected depth of V views: `wp.array`s on the scene's device, shape ``(V, H, W)``."""

    labels: wp.array
    """`Agreement` of every pixel, uint8."""
    expected: wp.array
    """Depth of the scene's first surface [m], float32; +inf without one, NaN if a map does not know it."""
    segmentation: wp.array
    """Index of the object of that surface, -1 without one, int32."""
    residual: wp.array
    """Measured minus expected depth of the pixel itself, in standard deviations, float32; NaN without either. Beside an
    edge of the scene, a large residual may agree with the other side of the edge."""
    _evidence: Callable[[Sequence[int]], Evidence]

    @cached_property
    def fractions(self) -> NDArray[np.float64]:
        """Fraction of the pixels of each view with each `Agreement`, shape ``(V, 5)``; waits for a GPU."""
        labels = self.labels.numpy().reshape(len(self.labels), -1)
        counts = [np.bincount(row, minlength=len(Agreement)) for row in labels]
        return np.array(counts, dtype=np.float64).reshape(-1, len(Agreement)) / max(labels.shape[1], 1)

    def changes(
        self,
        *,
        objects: Sequence[str | int] | None = None,
        min_pixels: int = 50,
        gap: float = 0.05,
        min_displacement: float = 0.02,
        max_displacement: float = 1.0,
    ) -> list[SceneChange]:
        """Return which objects are present, moved, vanished or unknown, and what appeared; views add up.

        An object is a suspect if 2 % or more of its measured pixels are farther than expected, or if it is not seen at
        its place at all. The views are rendered again without the suspects, and surfaces nearer than these
        images are joined to clusters in the world. A cluster near a suspect, and of a similar size, is the moved
        object; another cluster is a new thing. Pixels beyond a surface of something else than a suspect are clusters
        that vanished.

        It copies images to host memory, and waits for a GPU.

        Args:
            objects: Names or indices of the objects that may have moved or vanished, each of which has one row in the
                result; by default those that are neither ground nor `warpvis.Label.OBSTACLE`.
            min_pixels: Minimum number of pixels of a cluster in at least one view, and of an object in all views
                together, that is judged.
            gap: Maximum distance of the points of one cluster to the nearest others [m]. Points up to 3.5 times as far
                apart may be joined.
            min_displacement: Displacement up to which an object is present [m], or 2 pixels if that is more.
            max_displacement: Maximum distance between an object and the cluster that is this object [m].

        Returns:
            One row for each of `objects`, in the scene's order; then things that appeared, and those that vanished, the
            largest first.
        """
        evidence = self._evidence(())
        candidates = choose_candidates(evidence.scene, objects)
        limits = check_length(min_displacement, "min_displacement"), check_length(max_displacement, "max_displacement")
        return find_changes(
            evidence,
            self._evidence,
            candidates,
            min_pixels=check_whole(min_pixels, "min_pixels"),
            gap=check_number(gap, "gap", minimum=1e-3, maximum=10.0),
            displacements=limits,
        )


def compare_depth(
    scene: Scene | OccupancyMap,
    camera: ImageCamera,
    camera_to_world: PoseLike,
    depth: ArrayInput,
    *,
    sigma: Sigma,
    threshold: float = 4.0,
    tolerance: float | None = None,
    edge: int | None = None,
    complete: bool = False,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
) -> DepthComparison:
    """Compare measured depth images with those that a scene or a map predicts.

    A pixel agrees if its depth differs by at most ``tolerance + threshold * sigma`` from the expected one, or from a
    depth between the nearest and the farthest expected one in a window around it. The window makes edges insensitive to
    errors of the pose, of the calibration and of the sensor of up to `edge` pixels. With normal errors, no window and
    no tolerance, a fraction of ``erfc(threshold / sqrt(2))`` of the pixels of an unchanged scene is labeled wrongly:
    0.00006 for 4.

    Args:
        scene: The expected scene. Or an `OccupancyMap`, with a pinhole camera that has a finite `far`: then depth in
            space that the map knows to be free is `Agreement.NEARER`, depth behind unknown space is
            `Agreement.NO_SURFACE`, and there are no objects.
        camera: The camera of the images: a pinhole, or a `warpvis.cameras.LensCamera`.
        camera_to_world: Poses of the camera, shape ``(V, 7)`` or ``(V, 4, 4)``.
        depth: Measured depth as defined by the camera [m], shape ``(V, H, W)`` float32, or ``(H, W)`` for one view.
            Pixels that are not finite, not positive or out of the camera's range have no measurement: +inf does not
            mean free space here, because many programs use it for lost pixels.
        sigma: Standard deviation of measured depth: a number [m], a model of `warpvis.sensors` with
            `DepthSensor.depth_sigma`, or a function that takes depths [m], an array, and returns standard deviations
            [m] of its shape.
        threshold: Number of standard deviations up to which depths agree.
        tolerance: Difference up to which depths agree in addition [m], for errors of the scene; by default 0 for a
            scene, and the size of a voxel for a map.
        edge: Half the side of the window of expected depths, without its center [px], from 0 to 32. The default is 1,
            or more if `sigma` is a sensor that displaces edges by more (`DepthSensor.edge_shift`).
        complete: Whether space is known to be free where the scene has no surface: then depth there is
            `Agreement.NEARER` instead of `Agreement.NO_SURFACE`.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: Number of CPU threads; all cores by default.

    Returns:
        The comparison; `DepthComparison.changes` returns its objects.
    """
    is_map = isinstance(scene, OccupancyMap)
    if not isinstance(scene, OccupancyMap):
        require_scene(scene).require_objects()
    elif any(value is not None for value in (object_poses, world_index, exclude)):
        raise ArrayError("object_poses, world_index and exclude must be None for a map, which has no objects")
    device, threads = scene.device, check_threads(threads)
    images, poses = read_images(depth, camera, camera_to_world, convention, quaternion, device)
    count = len(images)
    if tolerance is None:
        tolerance = scene.cell_size if isinstance(scene, OccupancyMap) else 0.0
    if edge is None:
        edge = max(1, sigma.edge_shift if isinstance(sigma, DepthSensor) else 0)
    criteria = _criteria(camera, threshold, tolerance, edge, is_map or check_flag(complete, "complete"))
    sigmas = wp.array(tabulate_sigma(sigma, camera), dtype=wp.float32, device=device)
    if isinstance(scene, OccupancyMap):
        expect = _map_images(scene, camera, threads)
    else:
        object_poses = to_xyzw(object_poses, quaternion, "object_poses")
        expect = _scene_images(scene, camera, count, object_poses, world_index, exclude, threads)
    if device.is_cpu and quaternion == "xyzw":
        warn_of_order(camera_to_world, convention)

    def compare(without: Sequence[int]) -> dict[str, wp.array]:
        """Compare the images with what is expected without some objects."""
        expected = expect(poses, slice(None), without)
        labels = _compare_images(expected, images, criteria, sigmas, threads)
        return {"expected": expected.depth, "segmentation": expected.objects} | labels

    result = compare(())
    if device.is_cpu and count:
        chosen = np.unique(np.linspace(0, count - 1, min(count, _CHECKED_VIEWS)).astype(int))

        def agreement(matrices: NDArray[np.float64]) -> float:
            rows = poses_to_opencv(matrices).astype(np.float32)
            expected = expect(wp.array(rows, dtype=wp.transform, device=device), chosen, ()).depth.numpy()
            measured = result["labels"].numpy()[chosen] != Agreement.NO_MEASUREMENT
            found = images.numpy()[chosen][measured]
            error = np.abs(found - expected[measured])
            return float((error < _CONSTANT + _BY_DEPTH * found).mean()) if measured.any() else 1.0

        matrices = poses_to_matrices(poses.numpy().reshape(-1, 7)[chosen])
        agreed = refuse_other_meaning(matrices, agreement, check_convention(convention), "the scene", world=True)
        if agreed < _LOW_AGREEMENT and not is_map:  # a map may not contain what the camera sees
            warn_user(
                f"only {format_percent(agreed)} of the pixels agree with the scene: check its units, the poses and the "
                "camera, that no camera is inside of an object, and that depth is not disparity",
                UserWarning,
            )

    def evidence(without: Sequence[int]) -> Evidence:
        """Return the images in host memory."""
        arrays = compare(without) if without else result
        host = {name: arrays[name].numpy() for name in ("labels", "expected", "segmentation")}
        matrices = poses_to_matrices(poses.numpy().reshape(-1, 7))
        objects = Scene(device="cpu") if isinstance(scene, OccupancyMap) else scene
        return Evidence(objects, camera, matrices, images.numpy(), **host)

    return DepthComparison(**result, _evidence=evidence)


def _scene_images(
    scene: Scene,
    camera: ImageCamera,
    views: int,
    object_poses: ObjectPoses,
    world_index: ArrayInput | None,
    exclude: Excluded,
    threads: int,
) -> _Expect:
    """Return the function that renders the depth and the objects of a scene."""
    worlds = parse_worlds(scene, views, object_poses, world_index, exclude)
    eye = replace(camera, near=0.0, far=math.inf)
    renderer = Renderer(scene, eye, outputs=("depth", "segmentation"), threads=threads)

    def expect(poses: wp.array, chosen: slice | NDArray[np.integer], without: Sequence[int]) -> Expected:
        shown = worlds
        if without:
            flags = np.zeros((views, len(scene)), dtype=np.uint8)
            if worlds.excluded is not None and worlds.excluded.size:
                flags |= worlds.excluded.numpy()
            flags[:, list(without)] = 1
            shown = parse_worlds(scene, views, object_poses, world_index, flags)
        images = renderer.render_parsed(poses, shown if isinstance(chosen, slice) else part_of(shown, chosen))
        assert images.depth is not None and images.segmentation is not None  # for type checkers: they were requested
        return Expected(images.depth, images.segmentation)

    return expect


def _map_images(space: OccupancyMap, camera: ImageCamera, threads: int) -> _Expect:
    """Return the function that renders the depth of a map, which has no objects."""
    pinhole = require_camera(camera)

    def expect(poses: wp.array, chosen: slice | NDArray[np.integer], without: Sequence[int]) -> Expected:
        depth, nearest, farthest = render_surface(space.device_struct(), pinhole, poses, 3, threads)
        objects = wp.full(depth.shape, -1, dtype=wp.int32, device=depth.device)
        return Expected(depth, objects, (nearest, farthest))

    return expect


def _compare_images(
    expected: Expected, depth: wp.array, criteria: Any, sigmas: wp.array, threads: int
) -> dict[str, wp.array]:
    """Return labels and residuals of measured depth, given expected depth in the convention of REP 117."""
    from warpvis.kernels.maps.compare_depth import compare_depth as kernel

    results = empty_images(depth.shape, {"labels": wp.uint8, "residual": wp.float32}, depth.device)
    criteria.span = WHOLE_ROW if depth.device.is_cpu else 1
    inputs = [criteria, sigmas, expected.depth, *expected.interval, depth, *results.values()]
    launch_images(
        kernel,
        depth.shape,
        lambda window: [window, *inputs],
        device=depth.device,
        threads=threads,
        span=criteria.span,
    )
    return results


def _criteria(camera: ImageCamera, threshold: object, tolerance: object, edge: object, complete: bool) -> Any:
    """Return checked criteria as a struct for the kernel."""
    from warpvis.kernels.maps.compare_depth import Criteria

    criteria = Criteria()
    criteria.near, criteria.far = camera.near, camera.far
    criteria.threshold = check_number(threshold, "threshold", minimum=0.0)
    criteria.tolerance = check_length(tolerance, "tolerance")
    criteria.edge = check_whole(edge, "edge", minimum=0)
    if criteria.edge > _MAX_EDGE:
        raise ArrayError(f"edge must be from 0 to {_MAX_EDGE} px, got {edge!r}")
    empty = Agreement.NEARER if complete else Agreement.NO_SURFACE
    criteria.empty = int(empty)
    criteria.first_bits, criteria.step_bits = int(KNOTS[:1].astype(np.float32).view(np.int32)[0]), KNOT_STEP
    return criteria
