# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render wide-angle images by a single call."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Unpack

from warpvis.cameras.rays import OnceCache, Projection, WideCamera
from warpvis.core.poses import Convention, QuaternionOrder
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.rendering._choices import Output
from warpvis.rendering._color_options import ColorOptions
from warpvis.rendering._render import render
from warpvis.rendering._views import Views
from warpvis.scene import Scene, require_scene

# A scene caches the prepared rays of this many images of `render_wide`, with at most this many rays each: 30 MB.
_MAX_CACHED, _MAX_CACHED_RAYS = 2, 2**20


def render_wide(
    scene: Scene,
    width: int,
    height: int,
    hfov: float,
    camera_to_world: PoseLike,
    *,
    projection: Projection = "cylindrical",
    near: float = 0.0,
    far: float = math.inf,
    outputs: Sequence[Output] = ("depth",),
    cull_backfaces: bool = False,
    object_poses: ObjectPoses = None,
    world_index: ArrayInput | None = None,
    exclude: Excluded = None,
    convention: Convention = "opencv",
    quaternion: QuaternionOrder = "xyzw",
    threads: int | None = None,
    **colors: Unpack[ColorOptions],
) -> Views:
    """Render wide-angle views with the projections of `WideCamera`.

    The first call sorts the rays for packets on CPU cores; the scene caches the sorted rays of the two images rendered
    last, if they have at most 2^20 pixels. Larger images are cast ray by ray: to render them repeatedly, create a
    `WideCamera` and use `render` or `Renderer`.

    Args:
        scene: The scene to render.
        width: Image width [px].
        height: Image height [px].
        hfov: Horizontal field of view [rad], up to 2 pi.
        camera_to_world: Poses, as for `Renderer.render`.
        projection: ``"cylindrical"`` or ``"spherical"``.
        near: Minimum length of a ray [m].
        far: Maximum length of a ray [m].
        outputs: The images to render, as for `Renderer`.
        cull_backfaces: Whether to ignore triangles seen from behind, as for `Renderer`.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: CPU threads to use; all cores of this process by default.
        **colors: `shadows`, `reflections` and `ambient_occlusion`, as for `Renderer`.

    Returns:
        The images, indexed ``[view, y, x]``, on the scene's device. Depth is the *length* of the ray from the camera to
        the surface [m]: +inf without a surface within `far`, -inf where it is nearer than `near` (REP 117).

    Raises:
        WarpvisError: If an argument is invalid.
    """
    require_scene(scene)
    camera = WideCamera(width, height, hfov, projection, near, far)
    is_small = camera.width * camera.height <= _MAX_CACHED_RAYS
    if is_small:
        _share(scene, camera)
    return render(
        scene,
        camera,
        camera_to_world,
        outputs=outputs,
        caster="auto" if is_small else "rays",
        cull_backfaces=cull_backfaces,
        object_poses=object_poses,
        world_index=world_index,
        exclude=exclude,
        convention=convention,
        quaternion=quaternion,
        threads=threads,
        **colors,
    )


def _share(scene: Scene, camera: WideCamera) -> None:
    """Share prepared rays between cameras with the same image and any range."""
    image = (camera.width, camera.height, camera.hfov, camera.projection)
    camera.prepare_in(scene.cached_rays.setdefault(image, OnceCache()))
    for old in list(scene.cached_rays)[:-_MAX_CACHED]:
        scene.cached_rays.pop(old, None)
