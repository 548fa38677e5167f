# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's cameras: poses, the intrinsics of its renderer, and a scene with the cameras of `mujoco.Renderer.scene`."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, NoReturn

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera, check_size
from warpvis.core.poses import poses_to_opencv
from warpvis.core.types import DeviceLike
from warpvis.errors import CameraError, SceneError
from warpvis.mujoco._model_fields import CAMERA_FIELDS, check_numbers
from warpvis.rendering import Fill
from warpvis.scene import Scene

_FREE = int(mujoco.mjtCamera.mjCAMERA_FREE)
_TRACKING = int(mujoco.mjtCamera.mjCAMERA_TRACKING)
_FIXED = int(mujoco.mjtCamera.mjCAMERA_FIXED)
_CULL_FACE = int(mujoco.mjtRndFlag.mjRND_CULL_FACE)
_REFLECTION = int(mujoco.mjtRndFlag.mjRND_REFLECTION)
_IGNORED = {
    f"mjRND_{name}": int(getattr(mujoco.mjtRndFlag, f"mjRND_{name}"))
    for name in ("WIREFRAME", "ADDITIVE", "FOG", "SEGMENT", "IDCOLOR")
}
"""Flags that are off by default, and have no effect on images."""


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
    frustum = viewer_frustum(model, viewer)
    if (width is None) != (height is None):
        raise CameraError("width and height must both be given, or neither for the camera's resolution")
    if width is None or height is None:
        width, height = model.cam_resolution[viewer.fixedcamid].tolist() if viewer.type == _FIXED else (1, 1)
        if width == height == 1:  # MuJoCo's default
            raise CameraError("width and height must be given for a camera without a resolution")
    return camera_of_frustum(frustum, check_size(width, "width"), check_size(height, "height"))


def viewer_frustum(model: mujoco.MjModel, viewer: mujoco.MjvCamera) -> Frustum:
    """Compute the frustum of one of MuJoCo's cameras, in MuJoCo's single precision."""
    vertical_horizontal_clip = np.zeros((3, 2), dtype=np.float32)
    mujoco.mjv_cameraFrustum(*vertical_horizontal_clip, model, viewer)
    up, down, left, right, near, far = numbers = vertical_horizontal_clip.ravel().tolist()
    if viewer.type == _FIXED and not math.isfinite(sum(numbers)):
        check_numbers(model, CAMERA_FIELDS, CameraError, [viewer.fixedcamid])
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
    if camera.ray_model == "parallel":
        return z_far
    c = np.float32(-0.5) * (-(z_far + z_near) / (z_far - z_near)) - np.float32(0.5)
    d = np.float32(-0.5) * (-(np.float32(2) * z_far * z_near) / (z_far - z_near))
    return np.float32(np.float64(d) / np.float64(c))


class NotInSceneError(SceneError, AttributeError):
    """An attribute of `mujoco.MjvScene` that `Renderer.scene` lacks."""


class ViewerScene:
    """The flags and cameras of one renderer, created lazily."""

    def __init__(self, model: mujoco.MjModel, flags: list[int] | None = None) -> None:
        self._model = model
        self._mjv_scene: mujoco.MjvScene | None = None
        self._frustum: Frustum | None = None
        self._pose: NDArray[np.float32] = np.zeros(7, dtype=np.float32)
        self._before: list[tuple[Any, ...]] = []
        self._warned = False
        if flags is not None:
            self.mujoco_scene().flags[:] = flags

    def update(self, frustum: Frustum, pose: NDArray[np.float32]) -> None:
        """Set the frustum and pose of both cameras of the stereo pair."""
        self._frustum, self._pose = frustum, pose
        if self._mjv_scene is not None:
            self._fill(self._mjv_scene)

    def mujoco_scene(self) -> mujoco.MjvScene:
        """Return MuJoCo's scene, used for its flags and cameras only."""
        if self._mjv_scene is None:
            self._mjv_scene = mujoco.MjvScene(self._model, maxgeom=1)
            self._fill(self._mjv_scene)
        return self._mjv_scene

    def flags(self) -> list[int] | None:
        """Return the flags; None if they were never accessed."""
        return None if self._mjv_scene is None else self._mjv_scene.flags.tolist()

    def seen(self, camera: PlanarCamera, pose: NDArray[np.float32]) -> tuple[PlanarCamera, NDArray[np.float32]]:
        """Return the camera and its pose, with the user's changes since the update."""
        if (
            self._mjv_scene is None
            or self._frustum is None
            or [_values(eye) for eye in self._mjv_scene.camera] == self._before
        ):
            return camera, pose
        middle = mujoco.mjv_averageCamera(*self._mjv_scene.camera)
        half = middle.frustum_width or (middle.frustum_top - middle.frustum_bottom) / 2 * camera.width / camera.height
        sides = (middle.frustum_top, -middle.frustum_bottom, half - middle.frustum_center, half + middle.frustum_center)
        frustum = Frustum(*sides, middle.frustum_near, middle.frustum_far, bool(middle.orthographic))
        forward, up = np.array(middle.forward, dtype=np.float64), np.array(middle.up, dtype=np.float64)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.stack([np.cross(forward, up), -up, forward], axis=1), middle.pos
        row = poses_to_opencv(matrix, name="scene.camera")[0].astype(np.float32)
        return camera_of_frustum(frustum, camera.width, camera.height), row

    def culls(self) -> bool:
        """Return whether the flag for culling back faces is set; warn once of flags that are set without an effect."""
        if self._mjv_scene is None:
            return True
        ignored = [name for name, flag in _IGNORED.items() if self._mjv_scene.flags[flag]]
        if ignored and not self._warned:
            self._warned = True
            verb = "has" if len(ignored) == 1 else "have"
            warnings.warn(f"{', '.join(ignored)} {verb} no effect: surfaces are rendered", stacklevel=5)
        return bool(self._mjv_scene.flags[_CULL_FACE])

    def reflects(self) -> bool:
        """Return whether the flag for reflections is set."""
        return self._mjv_scene is None or bool(self._mjv_scene.flags[_REFLECTION])

    def _fill(self, scene: mujoco.MjvScene) -> None:
        if self._frustum is None:
            return
        up, down, left, right, near, far, orthographic = self._frustum
        x, y, z, w = self._pose[3:].astype(np.float64)
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, np.array([w, x, y, z]))
        axes = rotation.reshape(3, 3)
        for camera in scene.camera:
            camera.pos[:], camera.forward[:], camera.up[:] = self._pose[:3], axes[:, 2], -axes[:, 1]
            camera.frustum_top, camera.frustum_bottom = up, -down
            camera.frustum_center, camera.frustum_width = (right - left) / 2, (right + left) / 2
            camera.frustum_near, camera.frustum_far, camera.orthographic = near, far, orthographic
        self._before = [_values(camera) for camera in scene.camera]


def _missing(name: str) -> property:
    def get(_: Scene) -> NoReturn:
        raise NotInSceneError(
            f"renderer.scene is a warpvis.Scene and has no {name}; "
            "add shapes to it with renderer.scene.add(mesh, pose=...)"
        )

    return property(get)


class RendererScene(Scene):
    """The scene of a `Renderer`; see `Renderer.scene`."""

    def __init__(self, viewer: ViewerScene, *, device: DeviceLike = "cpu") -> None:
        super().__init__(device=device)
        self._viewer = viewer

    @property
    def flags(self) -> NDArray[np.uint8]:
        """Rendering flags, indexed by `mujoco.mjtRndFlag`."""
        return self._viewer.mujoco_scene().flags

    @property
    def camera(self) -> Sequence[mujoco.MjvGLCamera]:
        """The cameras of a stereo pair; their average is rendered."""
        return self._viewer.mujoco_scene().camera

    geoms, ngeom, maxgeom = (_missing(name) for name in ("geoms", "ngeom", "maxgeom"))

    def __reduce__(self) -> tuple[Callable[..., Scene], tuple[dict[str, Any]]]:
        """Pickle as a `warpvis.Scene` of the same objects, since flags and cameras belong to the renderer."""
        return _plain_scene, (self.__getstate__(),)


def _plain_scene(state: dict[str, Any]) -> Scene:
    scene = Scene.__new__(Scene)
    scene.__setstate__(state)
    return scene


def _values(camera: mujoco.MjvGLCamera) -> tuple[Any, ...]:
    places = (*camera.pos.tolist(), *camera.forward.tolist(), *camera.up.tolist())
    sides = (camera.frustum_top, camera.frustum_bottom, camera.frustum_center, camera.frustum_width)
    return (*places, *sides, camera.frustum_near, camera.frustum_far, camera.orthographic)
