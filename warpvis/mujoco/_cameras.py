# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's cameras: poses, and the intrinsics of its renderer."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera, check_size
from warpvis.errors import CameraError
from warpvis.mujoco._model_fields import check_camera_numbers
from warpvis.rendering import Fill

_FREE = int(mujoco.mjtCamera.mjCAMERA_FREE)
_TRACKING = int(mujoco.mjtCamera.mjCAMERA_TRACKING)
_FIXED = int(mujoco.mjtCamera.mjCAMERA_FIXED)


class Frustum(NamedTuple):
    """A camera's view frustum: the image's sides on the near plane, and the clipping planes [m]."""

    up: float
    """From the optical axis to the image's upper side."""
    down: float
    left: float
    right: float
    near: float
    far: float
    orthographic: bool = False
    """Whether all rays are parallel: the sides then do not depend on the distance."""


def camera_from_mujoco(
    model: mujoco.MjModel,
    camera: int | str | mujoco.MjvCamera = -1,
    width: int | None = None,
    height: int | None = None,
) -> PlanarCamera:
    """Return MuJoCo's rendering camera, with the frustum that MuJoCo computes.

    `mjv_cameraFrustum` (src/engine/engine_vis_visualize.c) computes the frustum from a field of view or from a focal
    length, principal point and sensor size, and `setView` (src/render/classic/render_gl3.c) maps it to an image: a
    camera defined by its field of view has square pixels; for one defined by its sensor, the sensor is stretched over
    the image. A principal point (x, y) [m] puts the optical axis left of the image's middle by x and above it by y, on
    the sensor.

    Args:
        model: A `mujoco.MjModel`.
        camera: A camera's name or id, -1 for the free camera, or a `mujoco.MjvCamera`.
        width: Image width [px]; the camera's ``resolution`` by default.
        height: Image height [px].

    Returns:
        The camera, with MuJoCo's clipping planes as `near` and `far`; a `warpvis.cameras.OrthographicCamera` if
        MuJoCo's camera is orthographic.

    Raises:
        CameraError: If there is no such camera, or it has no resolution and none is given.
    """
    viewer = viewer_camera(model, camera)
    return camera_of_frustum(viewer_frustum(model, viewer), *_image_size(model, viewer, width, height))


def viewer_frustum(model: mujoco.MjModel, viewer: mujoco.MjvCamera) -> Frustum:
    """Compute the frustum of one of MuJoCo's cameras, in MuJoCo's single precision."""
    vertical_horizontal_clip = np.zeros((3, 2), dtype=np.float32)
    mujoco.mjv_cameraFrustum(*vertical_horizontal_clip, model, viewer)
    up, down, left, right, near, far = numbers = vertical_horizontal_clip.ravel().tolist()
    if viewer.type == _FIXED and not math.isfinite(sum(numbers)):
        check_camera_numbers(model, viewer.fixedcamid)
    orthographic = bool(viewer.orthographic)
    if viewer.type == _FIXED:
        orthographic = model.cam_projection[viewer.fixedcamid] == mujoco.mjtProjection.mjPROJ_ORTHOGRAPHIC
    return Frustum(up, down, left, right, near, far, bool(orthographic))


def camera_with_fovy(model: mujoco.MjModel, camera: int, fovy: float, like: PlanarCamera) -> PlanarCamera:
    """Make the camera that `camera_from_mujoco` would return if a model's camera had another field of view.

    The camera must have no sensor size. `fovy` is in degrees, or in meters for an orthographic camera.
    """
    frustum = viewer_frustum(model, viewer_camera(model, camera))
    half = fovy / 2 if frustum.orthographic else frustum.near * math.tan(fovy * math.pi / 360)
    half = float(np.float32(half))
    return camera_of_frustum(frustum._replace(up=half, down=half), like.width, like.height)


@functools.lru_cache(maxsize=256)
def camera_of_frustum(frustum: Frustum, width: int, height: int) -> PlanarCamera:
    """Make the camera of a frustum; a frustum without a width gives square pixels."""
    up, down, left, right, near, far, orthographic = frustum
    if left + right == 0:  # the width follows from the viewport's aspect ratio
        left = right = (up + down) / 2 * width / height
    if not all(length > 0 for length in (near, up + down, left + right)):
        raise CameraError("the camera must have a near plane, a field of view and a sensor size above 0")
    reach = 1.0 if orthographic else near
    kind = OrthographicCamera if orthographic else Camera
    return kind(
        width,
        height,
        fx=reach * width / (left + right),
        fy=reach * height / (up + down),
        cx=left / (left + right) * width,
        cy=up / (up + down) * height,
        near=near,
        far=far,
    )


def viewer_camera(model: mujoco.MjModel, camera: int | str | mujoco.MjvCamera) -> mujoco.MjvCamera:
    """Make a `mujoco.MjvCamera` from a camera's name or id, -1 for the default free camera, or a `mujoco.MjvCamera`."""
    if not isinstance(model, mujoco.MjModel):
        raise CameraError(f"model must be a mujoco.MjModel, got {type(model).__name__}")
    if isinstance(camera, mujoco.MjvCamera):
        if camera.type not in (_FREE, _TRACKING, _FIXED):
            raise CameraError(f"camera must be of type FREE, TRACKING or FIXED, got type {camera.type}")
        if camera.type == _FIXED:
            camera_id(model, camera.fixedcamid)
        if camera.type == _TRACKING and not 0 <= camera.trackbodyid < model.nbody:
            raise CameraError(f"trackbodyid must be from 0 to {model.nbody - 1}, got {camera.trackbodyid}")
        return camera
    viewer = mujoco.MjvCamera()
    if isinstance(camera, int | np.integer) and camera == -1:
        viewer.type = _FREE
        mujoco.mjv_defaultFreeCamera(model, viewer)
    else:
        viewer.type, viewer.fixedcamid = _FIXED, camera_id(model, camera)
    return viewer


def camera_id(model: mujoco.MjModel, camera: int | str) -> int:
    """Find the id of one of the model's cameras, given by name or id."""
    if isinstance(camera, str):
        found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, camera)
        if found >= 0:
            return int(found)
    elif isinstance(camera, int | np.integer) and not isinstance(camera, bool) and 0 <= camera < model.ncam:
        return int(camera)
    names = ", ".join(repr(model.camera(k).name) for k in range(model.ncam)) or "no cameras"
    raise CameraError(f"camera {camera!r} is not in the model, which has {names}")


def viewer_pose(data: mujoco.MjData, viewer: mujoco.MjvCamera) -> NDArray[np.float32]:
    """Compute the pose of the OpenCV camera of a `mujoco.MjvCamera`: ``x y z qx qy qz qw``, camera to world, ``(7,)``.

    `mjv_cameraFrame` (src/engine/engine_vis_visualize.c) computes its position and its forward, up and right axes.
    """
    right, up, forward, position = frame = np.zeros((4, 3))
    mujoco.mjv_cameraFrame(position, forward, up, right, data, viewer)
    up *= -1  # OpenCV's y is down
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, frame[:3].T.ravel())
    w, x, y, z = quaternion.tolist()
    return np.array([*position.tolist(), x, y, z, w], dtype=np.float32)


def _image_size(
    model: mujoco.MjModel, viewer: mujoco.MjvCamera, width: int | None, height: int | None
) -> tuple[int, int]:
    if (width is None) != (height is None):
        raise CameraError("width and height must both be given, or neither for the camera's resolution")
    if width is not None and height is not None:
        return check_size(width, "width"), check_size(height, "height")
    resolution = model.cam_resolution[viewer.fixedcamid].tolist() if viewer.type == _FIXED else [1, 1]
    if resolution == [1, 1]:  # MuJoCo's default
        raise CameraError("width and height must be given for a camera without a resolution")
    return resolution[0], resolution[1]


def filled_depth(image: NDArray[np.float32], camera: PlanarCamera, fill: Fill) -> NDArray[np.float32]:
    """Return a depth image whose empty pixels are filled as `fill` specifies."""
    if fill == "inf":
        return image
    if not isinstance(fill, str):
        return np.where(np.isfinite(image), image, np.float32(fill))
    image = np.fmin(image, _background(camera))  # also replaces NaN
    return np.fmax(image, np.float32(camera.near), out=image, where=image == -np.inf)


def _background(camera: PlanarCamera) -> np.float32:
    """Compute the depth of `mujoco.Renderer` for empty pixels: its far plane, with the same rounding errors.

    Follows `render` in mujoco/rendering/classic/renderer.py for a depth-buffer value of 0.
    """
    z_near, z_far = np.float32(camera.near), np.float32(camera.far)
    if isinstance(camera, OrthographicCamera):
        return z_far
    c = np.float32(-0.5) * (-(z_far + z_near) / (z_far - z_near)) - np.float32(0.5)
    d = np.float32(-0.5) * (-(np.float32(2) * z_far * z_near) / (z_far - z_near))
    return np.float32(np.float64(d) / np.float64(c))
