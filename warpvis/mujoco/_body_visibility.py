# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of bodies in the views of a batch, and what hides the rest."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.core.arrays import empty
from warpvis.core.checks import as_items, check_flag, is_whole
from warpvis.core.kernel_cache import launch
from warpvis.errors import ArrayError, CameraError, SceneError
from warpvis.mujoco._batch_views import Workplace
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer
from warpvis.scene import Scene
from warpvis.scene.worlds import pose_columns

_MAX_RENDERERS = 64
# Maximum size of the images of a batch of views [bytes].
_CPU_BYTES, _CUDA_BYTES = 1 << 24, 1 << 30
_IMAGES: tuple[Any, ...] = ("depth", "segmentation")
_RESULTS = {
    "fraction": wp.float32,
    "reason": wp.uint8,
    "occluder": wp.int32,
    "visible_box": wp.vec4i,
    "silhouette_box": wp.vec4i,
}
_COUNTERS = ("visible_pixels", "image_pixels", "silhouette_pixels")


@dataclass(frozen=True)
class BodyVisibility:
    """Visibility of K bodies in C cameras of W worlds: `wp.array`s on the scene's device, ``[world, camera, body]``.

    A silhouette is the set of pixels that the body's geoms cover without all others: where several of them overlap, a
    pixel counts once.
    """

    bodies: tuple[int, ...]
    """Ids of the bodies."""
    names: tuple[str, ...]
    """Their names."""
    fraction: wp.array
    """`visible_pixels` / `silhouette_pixels`, ``(W, C, K)`` float32; 0 without a silhouette."""
    visible_pixels: wp.array
    """Pixels of the image that show the body, ``(W, C, K)`` int32."""
    image_pixels: wp.array
    """Pixels of the image that the isolated body covers, at any depth, ``(W, C, K)`` int32."""
    silhouette_pixels: wp.array
    """Pixels of the canvas that the isolated body covers, at any depth, ``(W, C, K)`` int32."""
    reason: wp.array
    """`warpvis.Visibility`, ``(W, C, K)`` uint8: VISIBLE, or the reason that applies to most of its pixels in the
    image: OCCLUDED, TOO_NEAR, TOO_FAR, or OUT_OF_VIEW if it covers none."""
    occluder: wp.array
    """Index of the scene's object that hides most of its pixels, -1 if no pixel is hidden, ``(W, C, K)`` int32;
    ``batch.scene.objects[index].name`` is that of the geom."""
    visible_box: wp.array
    """Bounding box of the visible pixels: x, y, width and height [px], all -1 if there are none, ``(W, C, K)``
    vec4i."""
    silhouette_box: wp.array
    """Bounding box of the silhouette on the canvas in the same format, relative to the image's first pixel."""
    shaped: wp.array | None = None
    """A value with a slope where the fraction is 0 or 1, ``(W, C, K)`` float32; None if not requested. With the image's
    diagonal d [px], it is 1 + m / d if the fraction is 1 and m is the distance from the silhouette's box to the image
    border [px]; the fraction if it is between 0 and 1; -r / (2 d) if the body is OCCLUDED and r is the smallest
    distance [px] from one of its pixels to one that shows nothing nearer, at most d; else -1/2 - a / (2 pi), where a is
    the angle [rad] between the center of the body's geoms and the image."""


def choose_bodies(model: mujoco.MjModel, bodies: Sequence[str | int]) -> list[int]:
    """Return the ids of distinct bodies given by name or id."""
    chosen = []
    for item in as_items(bodies, "bodies", SceneError):
        if isinstance(item, str):
            body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, item)
            if body < 0:
                known = ", ".join(repr(model.body(k).name) for k in range(min(model.nbody, 10)))
                raise SceneError(f"bodies must be names or ids of the model's bodies, such as {known}, got {item!r}")
            chosen.append(int(body))
        elif is_whole(item) and 0 <= item < model.nbody:
            chosen.append(int(item))
        else:
            raise SceneError(f"bodies must be names, or ids from 0 to {model.nbody - 1}, got {item!r}")
    if not chosen or len(set(chosen)) < len(chosen):
        raise SceneError(f"bodies must be one or more distinct bodies of the model, got {list(bodies)}")
    return chosen


def members_of_bodies(
    model: mujoco.MjModel, chosen: Sequence[int], of_objects: NDArray[np.int32], *, subtree: bool
) -> NDArray[np.uint8]:
    """Return whether the scene's objects are part of each body, or of its descendants, ``(K, objects)``."""
    part_of = np.eye(model.nbody, dtype=bool)
    if subtree:
        for body in range(1, model.nbody):  # parents come first
            part_of[:, body] |= part_of[:, model.body_parentid[body]]
    part_of = np.append(part_of, np.zeros((model.nbody, 1), dtype=bool), axis=1)  # for objects without a body, -1
    members: NDArray[np.bool_] = part_of[chosen][:, of_objects]
    for body, mine in zip(chosen, members, strict=True):
        if not mine.any():
            hint = "" if subtree else "; subtree=True includes those of its descendants"
            raise SceneError(f"bodies must have rendered geoms, got {model.body(body).name!r} without any{hint}")
    return members.astype(np.uint8)


def check_canvas(canvas: Sequence[int] | None, width: int, height: int) -> tuple[int, int, int, int]:
    """Return how far the canvas extends beyond the image's left, top, right and bottom border [px]."""
    if canvas is None:
        return width, height, width, height
    sides = tuple(canvas) if isinstance(canvas, Sequence) else ()
    if len(sides) != 4 or not all(is_whole(side) and 0 <= side < 1 << 14 for side in sides):
        raise ArrayError(f"canvas must be four whole numbers of pixels: left, top, right, bottom, got {canvas!r}")
    left, top, right, bottom = map(int, sides)
    return left, top, right, bottom


class BodyMeter:
    """Measures bodies in views of a scene: renders all objects, and each body by itself on a larger canvas."""

    def __init__(self, scene: Scene, coinciding: CoincidingGeoms, options: Mapping[str, Any]) -> None:
        """Use a scene with the options of a `BatchRenderer`."""
        self._scene, self._coinciding = scene, coinciding
        names = "near_plane", "cull_backfaces", "threads"
        self._options = {name: options[name] for name in names}
        self._renderers: dict[PlanarCamera, GeomRenderer] = {}
        self._centers: tuple[wp.array, wp.array] | None = None

    def _renderer(self, camera: PlanarCamera, outputs: Sequence[Any]) -> GeomRenderer:
        if camera not in self._renderers:
            while len(self._renderers) >= _MAX_RENDERERS:
                self._renderers.pop(next(iter(self._renderers)), None)
            self._renderers[camera] = GeomRenderer(
                self._scene, camera, self._coinciding, outputs=outputs, fill="inf", **self._options
            )
        return self._renderers[camera]

    def allocate(self, shape: tuple[int, int], *, shaped: bool) -> dict[str, wp.array]:
        """Allocate the results of V views and K bodies by name."""
        device = self._scene.device
        dtypes = dict.fromkeys(_COUNTERS, wp.int32) | _RESULTS | ({"shaped": wp.float32} if shaped else {})
        return {name: empty(shape, dtype, name=name, device=device) for name, dtype in dtypes.items()}

    def measure(
        self,
        camera: PlanarCamera,
        canvas: tuple[int, int, int, int],
        place: Workplace,
        views: NDArray[np.int64],
        members: wp.array,
        out: Mapping[str, wp.array],
    ) -> None:
        """Measure bodies in views through cameras with equal intrinsics, and write rows of the results.

        Args:
            camera: The intrinsics.
            canvas: Extension of the canvas [px].
            place: Poses of cameras and objects.
            views: The views to measure.
            members: Whether each of the scene's objects is part of a body, ``(K, objects)`` uint8.
            out: The results of `allocate`.
        """
        left, top, right, bottom = canvas
        pixels = (camera.width + left + right) * (camera.height + top + bottom) + 2 * camera.width * camera.height
        limit = _CPU_BYTES if self._scene.device.is_cpu else _CUDA_BYTES
        step = max(1, limit // (4 * pixels))
        for first in range(0, len(views), step):
            part = views[first : first + step]
            rows: slice | wp.array = slice(int(part[0]), int(part[-1]) + 1)
            if len(part) <= part[-1] - part[0]:
                rows = wp.array(part, dtype=wp.int32, device=self._scene.device)
            if len(part) == place.eyes.size:  # the usual case: all views at once
                self._measure(camera, canvas, place, rows, members, out)
                continue
            found = self.allocate((len(part), len(members)), shaped="shaped" in out)
            self._measure(camera, canvas, place, rows, members, found)
            for name, array in out.items():
                wp.copy(array[rows], found[name])

    def _measure(
        self,
        camera: PlanarCamera,
        canvas: tuple[int, int, int, int],
        place: Workplace,
        rows: slice | wp.array,
        members: wp.array,
        found: Mapping[str, wp.array],
    ) -> None:
        from warpvis.kernels.constants import IMAGE_PIXELS, SILHOUETTE_COUNTERS, SILHOUETTE_PIXELS, VISIBLE_PIXELS
        from warpvis.kernels.mujoco import body_visibility as kernels
        from warpvis.kernels.visibility.silhouettes import judge_silhouettes

        left, top, right, bottom = canvas
        device, (count, objects) = self._scene.device, members.shape
        eyes, world_of_view = _rows(place.eyes.flatten(), rows), _rows(place.world_of_view, rows)
        hidden = None if place.hidden is None else _rows(place.hidden, rows)
        size, shaped = len(eyes), "shaped" in found
        options: dict[str, Any] = {}
        if place.objects.size:
            options = {"object_poses": place.objects, "world_index": world_of_view, "object_sizes": place.sizes}

        # Surfaces beyond the depth range occlude too, except those that MuJoCo clips.
        near = camera.near if self._options["near_plane"] == "clip" else 0.0
        image = self._renderer(replace(camera, near=near, far=np.inf), _IMAGES)
        seen = image.render_sizes(eyes, exclude=hidden, **options)
        wide = {"width": camera.width + left + right, "height": camera.height + top + bottom}
        alone = self._renderer(
            replace(camera, cx=camera.cx + left, cy=camera.cy + top, near=0.0, far=np.inf, **wide), ("depth",)
        )
        counts = wp.zeros((SILHOUETTE_COUNTERS, size, count), dtype=wp.int32, device=device)
        hidden_by = wp.zeros((size, count, objects), dtype=wp.int32, device=device)
        squared = wp.full((size, count), camera.width**2 + camera.height**2, dtype=wp.int32, device=device)
        excluded = wp.empty((size, objects), dtype=wp.uint8, device=device)
        isolated = None
        for slot in range(count):
            launch(kernels.exclude_others, (size, objects), [members[slot], hidden, excluded], device)
            isolated = alone.render_sizes(eyes, exclude=excluded, out=isolated, **options)
            images = [seen.segmentation, seen.depth, isolated.depth, members[slot]]
            numbers = [left, top, camera.near, camera.far, slot]
            launch(kernels.measure_body, (size, wide["height"]), [*images, *numbers, counts, hidden_by], device)
            if shaped:
                inputs = [seen.depth, isolated.depth, left, top, slot, squared]
                launch(kernels.distance_to_free, (size, camera.height), inputs, device)

        launch(judge_silhouettes, (size, count), [counts, hidden_by, 1, *(found[name] for name in _RESULTS)], device)
        for name, row in zip(_COUNTERS, (VISIBLE_PIXELS, IMAGE_PIXELS, SILHOUETTE_PIXELS), strict=True):
            wp.copy(found[name], counts[row])
        if shaped:
            centers = wp.empty((size, count), dtype=wp.vec3, device=device)
            inputs = [*self._object_centers(), place.objects, world_of_view, members, centers]
            launch(kernels.body_centers, (size, count), inputs, device)
            judged = [found[name] for name in ("fraction", "reason", "silhouette_box")]
            inputs = [camera.device_struct(), eyes, centers, *judged, squared, found["shaped"]]
            launch(kernels.shape_values, (size, count), inputs, device)

    def _object_centers(self) -> tuple[wp.array, wp.array]:
        """Return the center of every object's box, and the column of the pose that it is relative to, -1 for none."""
        if self._centers is None or len(self._centers[0]) != len(self._scene):
            corners = [item.frame_vertices for item in self._scene.objects]
            centers = np.array([(part.min(axis=0) + part.max(axis=0)) / 2 for part in corners], dtype=np.float32)
            device, columns = self._scene.device, pose_columns(self._scene)
            self._centers = (
                wp.array(centers, dtype=wp.vec3, device=device),
                wp.array(columns, dtype=wp.int32, device=device),
            )
        return self._centers

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderers": {}, "_centers": None}


def _rows(array: wp.array, rows: slice | wp.array) -> wp.array:
    return array[rows] if isinstance(rows, slice) else array[rows].contiguous()


def check_shaped(camera: PlanarCamera, *, shaped: bool) -> bool:
    """Return the flag, and raise a `CameraError` if it is set and the camera has no angles."""
    if check_flag(shaped, "shaped") and camera.ray_model == "parallel":
        raise CameraError("cameras must be perspective with shaped=True, got an orthographic one")
    return shaped


def by_world(found: Mapping[str, wp.array], cameras: int, worlds: int) -> dict[str, wp.array]:
    """Return results ``(C * W, K)`` as ``(W, C, K)``."""
    return {
        name: array.reshape((cameras, worlds, array.shape[1])).transpose((1, 0, 2)).contiguous()
        for name, array in found.items()
    }
