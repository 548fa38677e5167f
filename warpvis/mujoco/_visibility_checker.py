# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of whether cameras see bodies, with the methods of MolmoSpaces' environments."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera, check_size
from warpvis.core.checks import check_number, is_number, truncate
from warpvis.core.poses import look_at
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, CameraError
from warpvis.mujoco._body_visibility import choose_bodies, members_of_bodies
from warpvis.mujoco._cameras import camera_from_mujoco, camera_id
from warpvis.mujoco._poses import camera_poses, geom_poses
from warpvis.mujoco._scene import scene_from_mujoco
from warpvis.rendering import Renderer
from warpvis.visibility import FractionMeter

_MAX_RENDERERS = 64


class LookingCamera(Protocol):
    """A camera of a simulation that is not in the model, such as those of MolmoSpaces' registry."""

    pos: Any
    """Position in the world [m]."""
    forward: Any
    """Direction of its axis."""
    up: Any
    """Direction that is up in the image."""
    fov: float
    """Vertical field of view, in degrees."""


class VisibilityChecker:
    """Checks how much cameras see of bodies, without OpenGL.

    The methods have the names, arguments and results of MolmoSpaces' ``CPUMujocoEnv`` (``molmo_spaces/env/env.py``).
    There, the visibility of a body is the share of the image that shows it; `visible_fractions` returns the share of
    the body that is visible. A body includes its descendants. As in MuJoCo, surfaces nearer than the near plane are cut
    away, so that cameras see through their housings.

    Geoms are those of `scene_from_mujoco`; build another checker after changing the model.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, *, width: int, height: int, device: DeviceLike = "cpu"
    ) -> None:
        """Set up the checker.

        Args:
            model: A `mujoco.MjModel`.
            data: Its state, after `mj_forward`; each check reads its current poses.
            width: Width of the images [px].
            height: Height of the images [px].
            device: Device on which images are rendered.
        """
        self.width, self.height = check_size(width, "width"), check_size(height, "height")
        self._made = scene_from_mujoco(model, device=device)
        self._model, self._data = model, data
        geoms = self._made.geoms_of_objects()
        self._bodies = np.where(geoms >= 0, model.geom_bodyid[geoms], -1).astype(np.int32)
        self._renderers: dict[object, Any] = {}

    def check_visibility(
        self, camera_name: str | int | LookingCamera, *target_objects: str | int
    ) -> float | dict[str | int, float]:
        """Return the share of the image that shows each body: a number for one body, a dict for several.

        Args:
            camera_name: Name or id of a camera of the model, or a camera with `pos`, `forward`, `up` and `fov`.
            *target_objects: Names or ids of bodies.
        """
        shares = self._shares(camera_name, self._members(target_objects)).tolist()
        return shares[0] if len(shares) == 1 else dict(zip(target_objects, shares, strict=True))

    def visible_fractions(
        self, camera_name: str | int | LookingCamera, *target_objects: str | int
    ) -> dict[str | int, float]:
        """Return the visible share of each body's silhouette, as `warpvis.visible_fractions`.

        Arguments are those of `check_visibility`.
        """
        groups = tuple(tuple(np.flatnonzero(mine).tolist()) for mine in self._members(target_objects))
        camera, pose = self._camera(camera_name)
        meter = self._cached(
            (camera, groups),
            lambda: FractionMeter(self._made.scene, camera, objects=groups, occluders=0, near_plane="clip"),
        )
        fractions = meter.measure(pose, object_poses=self._object_poses()).fraction.numpy()[0]
        return dict(zip(target_objects, fractions.tolist(), strict=True))

    def get_visible_objects(self, camera_name: str | int | LookingCamera) -> list[str]:
        """Return the names of the bodies below the world that a camera sees, the largest in the image first.

        Bodies without a name are left out.
        """
        model = self._model
        shown = self._bodies[self._bodies > 0]
        rooted = np.unique(model.body_rootid[shown]).tolist()
        if not rooted:
            return []
        shares = self._shares(camera_name, self._members(rooted))
        order = np.argsort(-shares, kind="stable")
        return [name for k in order if shares[k] > 0 and (name := model.body(rooted[k]).name)]

    def check_camera_visibility_constraints(
        self, constraints: Mapping[str, Mapping[str, float]]
    ) -> tuple[bool, dict[str, dict[str, float]]]:
        """Check the least share of the image of bodies in cameras.

        Args:
            constraints: For each camera, the least share of the image for each body.

        Returns:
            Whether all constraints are met, and the shares by camera and body.
        """
        if not isinstance(constraints, Mapping) or not all(map(_are_shares, constraints.values())):
            raise ArrayError(
                "constraints must be a dict of cameras with dicts of bodies and shares from 0 to 1, got "
                f"{truncate(repr(constraints))}"
            )
        found: dict[str, dict[str, float]] = {}
        met = True
        for camera, least in constraints.items():
            shares = self._shares(camera, self._members(tuple(least))).tolist()
            found[camera] = dict(zip(least, shares, strict=True))
            met &= all(share >= least[body] for body, share in found[camera].items())
        return met, found

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"_renderers": {}}

    def _members(self, bodies: Sequence[str | int]) -> NDArray[np.bool_]:
        """Return whether each of the scene's objects is part of each body, ``(K, objects)``."""
        chosen = choose_bodies(self._model, list(bodies))
        return members_of_bodies(self._model, chosen, self._bodies, subtree=True)

    def _shares(self, camera_name: Any, members: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the shares of the image that show bodies, ``(K,)``."""
        camera, pose = self._camera(camera_name)
        renderer = self._cached(
            camera, lambda: Renderer(self._made.scene, camera, outputs=("segmentation",), near_plane="clip")
        )
        shown = renderer.render(pose, object_poses=self._object_poses()).segmentation.numpy()
        pixels: NDArray[np.int64] = members @ np.bincount(shown[shown >= 0], minlength=members.shape[1])
        return pixels / (self.width * self.height)

    def _object_poses(self) -> NDArray[np.float32] | None:
        return geom_poses(self._data, self._made) if self._made.scene.movable else None

    def _cached(self, key: object, make: Callable[[], Any]) -> Any:
        """Return the renderer or meter of a key."""
        if key not in self._renderers:
            while len(self._renderers) >= _MAX_RENDERERS:
                self._renderers.pop(next(iter(self._renderers)))
            self._renderers[key] = make()
        return self._renderers[key]

    def _camera(self, camera: Any) -> tuple[Camera, NDArray[np.floating]]:
        """Return a camera's intrinsics, and its pose, camera to world."""
        if isinstance(camera, str | int | np.integer):
            number = camera_id(self._model, camera if isinstance(camera, str) else int(camera))
            lens = camera_from_mujoco(self._model, number, self.width, self.height)
            if not isinstance(lens, Camera):
                raise CameraError(f"camera must be perspective, got {camera!r}, which is orthographic")
            return lens, camera_poses(self._data, self._model, [number])[0]
        if not all(hasattr(camera, name) for name in ("pos", "forward", "up", "fov")):
            raise CameraError(
                "camera_name must be a name or id of a camera of the model, or have pos, forward, up and fov, got "
                f"{type(camera).__name__}"
            )
        fov = math.radians(check_number(camera.fov, "fov", minimum=0.1, maximum=179.0, error=CameraError))
        extent, limits = self._model.stat.extent, self._model.vis.map
        lens = Camera.from_fov(
            self.width, self.height, vfov=fov, near=float(limits.znear * extent), far=float(limits.zfar * extent)
        )
        position = np.asarray(camera.pos, dtype=np.float64)
        return lens, look_at(position, position + np.asarray(camera.forward, dtype=np.float64), up=tuple(camera.up))


def _are_shares(least: object) -> bool:
    return isinstance(least, Mapping) and all(is_number(share) and 0 <= share <= 1 for share in least.values())
