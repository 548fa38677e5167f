# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images wider than a pinhole's, up to all around: cylindrical and spherical (fisheye) projections."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from warpvis.core.checks import check_choice, check_flag, is_number, is_whole
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.threads import check_threads, launch_images
from warpvis.core.types import ArrayInput, Excluded, ObjectPoses, PoseLike
from warpvis.errors import CameraError
from warpvis.rendering._renderer import Output
from warpvis.rendering._views import OUTPUTS, Views, check_outputs, views_for
from warpvis.rendering.casters import images_struct
from warpvis.scene import Scene, require_scene
from warpvis.scene.worlds import parse_worlds

if TYPE_CHECKING:
    from warpvis.kernels.panorama import WideCamera

Projection = Literal["cylindrical", "spherical"]

# Two pi as files write it with four decimals.
_WIDEST = 6.2832


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
) -> Views:
    """Render views that a pinhole is too narrow for: one ray through every pixel's centre, in equal steps of angle.

    With u to the right and v downwards from the image's middle, both from -1/2 to 1/2 from border to border:

    * ``"cylindrical"``: the ray's azimuth is ``u * hfov`` to the right, its elevation ``v * hfov * height / width``
      downwards. Columns are meridians and rows are parallels, all as far apart (equirectangular).
    * ``"spherical"``: an equidistant fisheye. The ray is ``hfov * sqrt(u^2 + v^2)`` away from the camera's axis,
      towards the pixel. The middles of all four borders are ``hfov / 2`` away from it, so that an image that is not
      square is stretched; its corners are beyond.

    Where a pixel is more than pi away from the axis, or more than pi / 2 above or below the horizon, the formulas hold
    all the same: its ray goes over the pole. These are the projections of Webots' cameras (its shader
    ``merge_spherical.frag``).

    Args:
        scene: What is seen.
        width: Image width [px].
        height: Image height [px].
        hfov: Horizontal field of view [rad], up to 2 pi.
        camera_to_world: Poses, as for `Renderer.render`.
        projection: ``"cylindrical"`` or ``"spherical"``.
        near: Least length of a ray that is measured [m].
        far: Greatest length of a ray that is measured [m].
        outputs: The images to make, as for `Renderer`.
        cull_backfaces: See through triangles from behind, as for `Renderer`.
        object_poses: As for `Renderer.render`.
        world_index: As for `Renderer.render`.
        exclude: As for `Renderer.render`.
        convention: Axes of the camera frame of the poses.
        quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        The images, indexed ``[view, y, x]``, on the scene's device. Depth is the ray's *length* from the camera to what
        it meets [m]: +inf where that is nothing or lies beyond `far`, -inf where it is nearer than `near` (REP 117).

    Raises:
        WarpvisError: An argument is not what it has to be.
    """
    from warpvis.kernels.panorama import cast_wide_rays

    camera_to_world = to_xyzw(camera_to_world, quaternion, "camera_to_world")
    object_poses = to_xyzw(object_poses, quaternion, "object_poses")
    require_scene(scene)
    camera = _wide_camera(width, height, hfov, projection, near, far)
    names = check_outputs(outputs)
    scene.require_objects()
    poses = parse_poses(camera_to_world, convention=convention, device=scene.device)
    worlds = parse_worlds(scene, len(poses), object_poses, world_index, exclude)
    threads, culling = check_threads(threads), check_flag(cull_backfaces, "cull_backfaces")
    shape = (len(poses), camera.height, camera.width)
    views = views_for(names, shape, scene.device)
    images = images_struct([getattr(views, name) for name in OUTPUTS])
    triangles = scene.triangles()
    launch_images(
        cast_wide_rays,
        shape,
        lambda window: [triangles.struct, camera, poses, window, worlds, culling, images],
        device=scene.device,
        threads=threads,
    )
    return views


def _wide_camera(width: int, height: int, hfov: float, projection: str, near: float, far: float) -> WideCamera:
    """Make a `warpvis.kernels.panorama.WideCamera` of checked arguments."""
    from warpvis.kernels.panorama import WideCamera

    check_choice(projection, "projection", ("cylindrical", "spherical"), CameraError)
    for name, value in (("width", width), ("height", height)):
        if not is_whole(value) or not 1 <= value < 2**31:
            raise CameraError(f"{name} must be a whole number of pixels from 1 up, got {value!r}")
    for name, number in (("hfov", hfov), ("near", near), ("far", far)):
        if not is_number(number):
            raise CameraError(f"{name} must be a number, got {number!r}")
    if not 0 < hfov <= _WIDEST:
        hint = "; fields of view are in radians" if hfov > _WIDEST else ""
        raise CameraError(f"hfov must be more than 0 and at most 2 pi radians, got {hfov}{hint}")
    if not 0 <= near < far:
        raise CameraError(f"the depth range needs 0 <= near < far, got near={near}, far={far}")
    camera = WideCamera()
    camera.width, camera.height, camera.hfov = int(width), int(height), float(hfov)
    camera.is_spherical = projection == "spherical"
    camera.near, camera.far = float(near), float(far)
    return camera
