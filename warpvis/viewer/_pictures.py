# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small images of an agent's view: depth, or objects colored by the agents that see them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.rendering import DepthSensor, Output, Renderer
from warpvis.scene import Scene
from warpvis.sensors import kinect_v1
from warpvis.visibility import Agent, FieldOfView, equirectangular
from warpvis.viz import depth_colors

PictureKind = Literal["depth", "objects"]

_OUTPUTS: tuple[Output, ...] = ("depth", "points", "labels", "segmentation")
_WIDTH = 320
"""Maximum width of a picture [px]."""
_PIXELS_PER_DEGREE = 1.6
_FINEST_RANGE = 1e-3


@dataclass(frozen=True, eq=False)
class Seen:
    """Images of an agent's view, indexed ``[y, x]``."""

    depth: NDArray[np.float32]
    """Depth along the axis of the pixel's face [m]; not finite without a surface in range."""
    points: NDArray[np.float32]
    """Seen points in the world [m], ``(h, w, 3)``."""
    labels: NDArray[np.uint8]
    """Labels of the points."""
    objects: NDArray[np.int32]
    """Indices of the objects of the points, -1 for none."""

    def cloud(self) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Return the points with a finite depth, ``(N, 3)``, and their labels, ``(N,)``."""
        measured = np.isfinite(self.depth)
        return self.points[measured], self.labels[measured]


class AgentPicture:
    """Renders pictures of one agent's view; a `FieldOfView` is shown in an equirectangular projection."""

    def __init__(
        self, scene: Scene, camera: ImageCamera | FieldOfView, reach: float, sensor: DepthSensor | None = None
    ) -> None:
        """Set up the renderers; a sensor is ignored for a `FieldOfView`.

        `reach` is half of the scene's diagonal [m]: depth of the last color if the camera's range exceeds the diagonal.
        """
        self.scene, self.camera, self.reach = scene, camera, reach
        self._faces: list[tuple[Renderer, NDArray[np.float32], NDArray[np.bool_]]] = []
        self._renderer: Renderer | None = None
        if isinstance(camera, FieldOfView):
            scale = min(_PIXELS_PER_DEGREE, _WIDTH / math.degrees(camera.hfov))
            for face, (columns, rays) in zip(camera.faces(), equirectangular(camera, scale)[1], strict=True):
                pixels = face.camera.project(rays).astype(np.float32)
                self._faces.append((Renderer(scene, face.camera, outputs=_OUTPUTS), pixels, columns))
        else:
            self._renderer = Renderer(scene, camera, outputs=_OUTPUTS, sensor=sensor)

    @property
    def depth_range(self) -> tuple[float, float]:
        """Depths of the first and the last color [m]."""
        near, far = self.camera.near, self.camera.far
        far = far if far <= 2 * self.reach else max(self.reach, near + _FINEST_RANGE)
        return near, far

    def render(self, agent: Agent, object_poses: NDArray[np.float64]) -> Seen:
        """Render an agent's view from its current pose; large images are subsampled."""
        poses = object_poses if len(object_poses) else None
        exclude = agent.body or None
        if self._renderer is not None:
            views = self._renderer.render(agent.poses, object_poses=poses, exclude=exclude)
            step = math.ceil(views.depth.shape[2] / _WIDTH)
            return Seen(*(getattr(views, name).numpy()[0, ::step, ::step] for name in _OUTPUTS))
        height, width = self._faces[0][1].shape[0], len(self._faces[0][2])
        seen = Seen(
            np.empty((height, width), dtype=np.float32),
            np.empty((height, width, 3), dtype=np.float32),
            np.empty((height, width), dtype=np.uint8),
            np.empty((height, width), dtype=np.int32),
        )
        for face, (renderer, pixels, columns) in zip(agent.faces, self._faces, strict=True):
            face_pose = agent.face_poses(face)
            views = renderer.render_at(face_pose, pixels[None], object_poses=poses, exclude=exclude)
            for image, name in zip(vars(seen).values(), _OUTPUTS, strict=True):
                image[:, columns] = getattr(views, name).numpy()[0]
        return seen

    def draw(self, seen: Seen, kind: PictureKind, colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a color picture of a view, ``(h, w, 3)``.

        `colors` are those of every object and, last, of pixels without an object, ``(objects + 1, 3)``.
        """
        if kind == "objects":
            return colors[seen.objects]
        near, far = self.depth_range
        with np.errstate(invalid="ignore"):
            index = np.clip((seen.depth - near) * (255 / max(far - near, _FINEST_RANGE)), 0, 255)
        index = np.where(np.isfinite(seen.depth), index, np.where(seen.depth == -np.inf, 257, 256)).astype(np.int64)
        return _color_table()[index]


def with_view(camera: Camera, *, hfov: float | None = None, far: float | None = None) -> Camera:
    """Return a camera with another field of view or range and the same image size, center and pixel aspect ratio."""
    fields = {} if far is None else {"far": far}
    if hfov is not None:
        factor = math.tan(camera.hfov / 2) / math.tan(hfov / 2)
        fields |= {"fx": camera.fx * factor, "fy": camera.fy * factor}
    return replace(camera, **fields)


def kinect_noise(level: float) -> DepthSensor | None:
    """Return a Kinect model with its disparity noise multiplied by `level`; None, for exact depth, if `level` is 0."""
    if level <= 0:
        return None
    kinect = kinect_v1(_WIDTH, 240)
    return replace(kinect, sigma=kinect.sigma * level, subpixel=max(1, round(kinect.subpixel / level)))


@lru_cache(maxsize=1)
def _color_table() -> NDArray[np.uint8]:
    """Return the colors of 256 depths, of pixels without a surface, and of surfaces that are too near, ``(258, 3)``."""
    ramp = np.concatenate([np.linspace(0, 1, 256), [np.inf, -np.inf]])
    return depth_colors(ramp[None], (0.0, 1.0))[0]
