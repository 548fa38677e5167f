# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A `warpvis.Scene` with the flags and cameras of `mujoco.Renderer.scene`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import PlanarCamera
from warpvis.core.poses import poses_to_opencv
from warpvis.core.types import DeviceLike
from warpvis.errors import SceneError
from warpvis.mujoco._cameras import Frustum, camera_of_frustum
from warpvis.scene import Scene

_CULL_FACE = int(mujoco.mjtRndFlag.mjRND_CULL_FACE)
_WIREFRAME = int(mujoco.mjtRndFlag.mjRND_WIREFRAME)


class NotInSceneError(SceneError, AttributeError):
    """An attribute of `mujoco.MjvScene` that `Renderer.scene` lacks."""


class ViewerScene:
    """The flags and cameras of one renderer, created lazily."""

    def __init__(self, model: mujoco.MjModel) -> None:
        self._model = model
        self._mjv_scene: mujoco.MjvScene | None = None
        self._frustum: Frustum | None = None
        self._pose: NDArray[np.float32] = np.zeros(7, dtype=np.float32)
        self._before: list[tuple[Any, ...]] = []
        self._warned = False

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

    def set_flags(self, flags: list[int] | None) -> None:
        """Set the flags."""
        if flags is not None:
            self.mujoco_scene().flags[:] = flags

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
        frustum = Frustum(
            up=middle.frustum_top,
            down=-middle.frustum_bottom,
            left=half - middle.frustum_center,
            right=half + middle.frustum_center,
            near=middle.frustum_near,
            far=middle.frustum_far,
            orthographic=bool(middle.orthographic),
        )
        forward, up = np.array(middle.forward, dtype=np.float64), np.array(middle.up, dtype=np.float64)
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = np.stack([np.cross(forward, up), -up, forward], axis=1), middle.pos
        row = poses_to_opencv(matrix, name="scene.camera")[0].astype(np.float32)
        return camera_of_frustum(frustum, camera.width, camera.height), row

    def culls(self) -> bool:
        """Return whether the flag for culling back faces is set; warn if the flag for wireframes is."""
        if self._mjv_scene is None:
            return True
        if self._mjv_scene.flags[_WIREFRAME] and not self._warned:
            self._warned = True
            warnings.warn("mjRND_WIREFRAME has no effect: surfaces are rendered", stacklevel=5)
        return bool(self._mjv_scene.flags[_CULL_FACE])

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
        """Create an empty scene with the flags and cameras of `viewer`."""
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
