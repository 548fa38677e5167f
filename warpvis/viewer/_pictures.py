# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What agents see: images of their views, a cloud of surface points, lines of sight, and the page's table."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Visibility
from warpvis.core.poses import look_at, poses_to_matrices
from warpvis.planning import surface_samples
from warpvis.rendering import DepthSensor, Output, Renderer
from warpvis.scene import Scene
from warpvis.sensors import kinect_v1
from warpvis.viewer._stage import Stage
from warpvis.visibility import Agent, FieldOfView, Perspective, State, equirectangular, point_visibility
from warpvis.viz import depth_colors

PictureKind = Literal["depth", "objects", "color", "both"]
"""Depth, whether agents see each object, color, or color next to depth."""

_OUTPUTS: tuple[Output, ...] = ("depth", "points", "labels", "segmentation")
_WIDTH = 320
"""Maximum width of a picture [px]."""
_PIXELS_PER_DEGREE = 1.6
_GAP = 4
"""Width of the border between two pictures [px]."""
_FINEST_RANGE = 1e-3

_POINTS = 20_000
"""Approximate number of points."""
_MIN_SPACING = 0.005
_SPARSER = 1.4
"""Spacing of points on the ground, relative to other surfaces."""

_PIXEL = Camera(1, 1, 1000.0, 1000.0, 0.5, 0.5)
"""A camera with one pixel, whose ray is the camera's axis."""


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
    color: NDArray[np.uint8] | None = None
    """Colors in sRGB, ``(h, w, 3)``; None if they are not shown."""

    def cloud(self) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Return the points with a finite depth, ``(N, 3)``, and their labels, ``(N,)``."""
        measured = np.isfinite(self.depth)
        return self.points[measured], self.labels[measured]


class AgentPicture:
    """Renders pictures of one agent's view; a `FieldOfView` is shown in an equirectangular projection."""

    def __init__(
        self,
        scene: Scene,
        camera: ImageCamera | FieldOfView,
        reach: float,
        sensor: DepthSensor | None = None,
        colored: Scene | None = None,
    ) -> None:
        """Set up the renderers; a sensor is ignored for a `FieldOfView`.

        `reach` is half of the scene's diagonal [m]: depth of the last color if the camera's range exceeds the diagonal.
        `colored` is the scene for colors, with the same movable objects, by default `scene`.
        """
        self.scene, self.camera, self.reach = scene, camera, reach
        self._colored = scene if colored is None else colored
        self._faces: list[tuple[Renderer, NDArray[np.float32], NDArray[np.bool_]]] = []
        self._renderer: Renderer | None = None
        self._color_renderers: list[Renderer] = []
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

    def render(
        self,
        agent: Agent,
        object_poses: NDArray[np.float64],
        *,
        with_color: bool = False,
        hidden: Sequence[str] | None = None,
    ) -> Seen:
        """Render an agent's view from its current pose; large images are subsampled.

        `hidden` are the objects of the scene for colors that the agent does not see, by default those of the agent.
        """
        poses = object_poses if len(object_poses) else None
        exclude = agent.excluded or None
        places: dict[str, Any] = {"object_poses": poses, "exclude": (exclude if hidden is None else hidden) or None}
        if self._renderer is not None:
            views = self._renderer.render(agent.poses, object_poses=poses, exclude=exclude)
            step = math.ceil(views.depth.shape[2] / _WIDTH)
            seen = Seen(*(getattr(views, name).numpy()[0, ::step, ::step] for name in _OUTPUTS))
            if not with_color:
                return seen
            (painter,) = self._painters()
            return replace(seen, color=painter.render(agent.poses, **places).color.numpy()[0, ::step, ::step])
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
            for image, name in zip(vars(seen).values(), _OUTPUTS, strict=False):
                image[:, columns] = getattr(views, name).numpy()[0]
        if not with_color:
            return seen
        color = np.empty((height, width, 3), dtype=np.uint8)
        for face, painter, (_, pixels, columns) in zip(agent.faces, self._painters(), self._faces, strict=True):
            color[:, columns] = painter.render_at(agent.face_poses(face), pixels[None], **places).color.numpy()[0]
        return replace(seen, color=color)

    def _painters(self) -> list[Renderer]:
        """Return the renderers of colors, one for each face."""
        if not self._color_renderers:
            cameras = [r.camera for r, _, _ in self._faces] if self._renderer is None else [self._renderer.camera]
            self._color_renderers = [Renderer(self._colored, camera, outputs=("color",)) for camera in cameras]
        return self._color_renderers

    def draw(self, seen: Seen, kind: PictureKind, colors: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return a color picture of a view, ``(h, w, 3)``.

        `colors` are those of every object and, last, of pixels without an object, ``(objects + 1, 3)``.
        """
        if kind == "objects":
            return colors[seen.objects]
        if kind == "color" and seen.color is not None:
            return seen.color
        near, far = self.depth_range
        with np.errstate(invalid="ignore"):
            index = np.clip((seen.depth - near) * (255 / max(far - near, _FINEST_RANGE)), 0, 255)
        index = np.where(np.isfinite(seen.depth), index, np.where(seen.depth == -np.inf, 257, 256)).astype(np.int64)
        depth = _color_table()[index]
        if kind == "both" and seen.color is not None:
            gap = np.full((len(depth), _GAP, 3), 255, dtype=np.uint8)
            return np.concatenate([seen.color, gap, depth], axis=1)
        return depth


def with_view(camera: Camera, *, hfov: float | None = None, far: float | None = None) -> Camera:
    """Return a camera with another field of view or range and the same image size, center and pixel aspect ratio."""
    fields: dict[str, Any] = {} if far is None else {"far": far}
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


class SurfaceCloud:
    """Points distributed evenly over a stage's surfaces; they move with their objects."""

    def __init__(self, stage: Stage, points: int = _POINTS) -> None:
        """Sample about `points` points on the surfaces."""
        self.stage = stage
        objects = stage.scene.objects
        ground = [index for index, item in enumerate(objects) if item.label in stage.scene.ground_labels]
        obstacles = [index for index in range(len(objects)) if index not in set(ground)]
        area = _area(stage, obstacles) + _area(stage, ground) / _SPARSER**2
        self.spacing = max(_MIN_SPACING, math.sqrt(area / points))
        samples = [
            surface_samples(stage.scene, spacing=spacing, objects=chosen)
            for spacing, chosen in ((self.spacing, obstacles), (_SPARSER * self.spacing, ground))
            if chosen
        ]
        self.objects: NDArray[np.int32] = np.concatenate([sample.objects for sample in samples])
        self._columns = stage.columns[self.objects]
        self._moving = self._columns >= 0
        self.points = np.concatenate([sample.points for sample in samples]).astype(np.float64)
        self.normals = np.nan_to_num(np.concatenate([sample.normals for sample in samples]).astype(np.float64))
        if self._moving.any():  # points of movable objects are in the frames of their meshes
            frames = poses_to_matrices(stage.object_poses)[self._columns[self._moving]]
            offsets = self.points[self._moving] - frames[:, :3, 3]
            self.points[self._moving] = np.einsum("nji,nj->ni", frames[:, :3, :3], offsets)
            self.normals[self._moving] = np.einsum("nji,nj->ni", frames[:, :3, :3], self.normals[self._moving])

    def __len__(self) -> int:
        return len(self.points)

    def positions(self, object_poses: NDArray[np.float64], lift: float = 0.0) -> NDArray[np.float32]:
        """Return the points in the world [m], ``(N, 3)``, offset along their normals by `lift` [m]."""
        lifted = self.points + lift * self.normals
        points = lifted.astype(np.float32)
        if self._moving.any():
            frames = poses_to_matrices(object_poses)[self._columns[self._moving]]
            local = lifted[self._moving]
            points[self._moving] = np.einsum("nij,nj->ni", frames[:, :3, :3], local) + frames[:, :3, 3]
        return points

    def seen_by(
        self, agent: Agent, object_poses: NDArray[np.float64], points: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Return which points an agent sees, ``(N,)``; excluded objects are not seen."""
        seen = np.zeros(len(points), dtype=bool)
        for face in agent.faces:
            found = point_visibility(
                self.stage.scene,
                face.camera,
                agent.face_poses(face),
                points,
                object_poses=object_poses if len(object_poses) else None,
                exclude=agent.excluded or None,
            )
            seen |= found.numpy()[0] == Visibility.VISIBLE  # type: ignore[union-attr]  # occluders are not requested
        return seen & ~np.isin(self.objects, [self.stage.scene.index(name) for name in agent.excluded])

    def states(
        self, agents: Sequence[Agent], object_poses: NDArray[np.float64], points: NDArray[np.float32]
    ) -> NDArray[np.uint8]:
        """Return a `State` for each point, ``(N,)``: whether the first agent and any other see it."""
        states = np.zeros(len(points), dtype=np.uint8)
        for number, agent in enumerate(agents):
            states |= np.uint8(State.SECOND if number else State.FIRST) * self.seen_by(agent, object_poses, points)
        return states


def _area(stage: Stage, indices: Sequence[int]) -> float:
    """Return the total surface area of objects [m^2]."""
    total = 0.0
    for item in (stage.scene.objects[index] for index in indices):
        vertices, faces = item.vertices.astype(np.float64), item.faces
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        total += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()) / 2
    return total


@dataclass(frozen=True, eq=False)
class SightLine:
    """A line of sight to the center of a hidden object."""

    agent: str
    object: str
    occluder: str
    """Name of the object that hides it."""
    eye: NDArray[np.float64]
    stop: NDArray[np.float64]
    """Intersection of the line with the occluder [m]."""
    target: NDArray[np.float64]
    """Center of the object's box [m]."""


class SightLines:
    """Finds lines of sight with one ray each."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        self._renderer = Renderer(stage.scene, _PIXEL, outputs=("depth", "segmentation"))

    def find(
        self, agents: Sequence[Agent], seen: Perspective, object_poses: NDArray[np.float64]
    ) -> tuple[SightLine, ...]:
        """Return the lines from each agent to the objects that are fully hidden from it.

        Objects are skipped if the ray to their center hits the object itself before another one.
        """
        lines = []
        for number, agent in enumerate(agents):
            hidden = np.flatnonzero((seen.status[number, 0] == Visibility.OCCLUDED) & ~seen.body[number])
            if len(hidden):
                lines += self._find_for_agent(agent, [seen.objects[k] for k in hidden], object_poses)
        return tuple(lines)

    def _find_for_agent(self, agent: Agent, names: Sequence[str], object_poses: NDArray[np.float64]) -> list[SightLine]:
        eye = agent.poses[0, :3]
        targets = [self._center(name, object_poses) for name in names]
        ups = [np.eye(3)[np.abs(target - eye).argmin()] for target in targets]  # any that is not along the ray
        poses = np.array([look_at(eye, target, up=up) for target, up in zip(targets, ups, strict=True)])
        views = self._renderer.render(
            poses, object_poses=object_poses if len(object_poses) else None, exclude=agent.excluded or None
        )
        depths, objects = views.depth.numpy()[:, 0, 0], views.segmentation.numpy()[:, 0, 0]
        lines = []
        for name, target, depth, index in zip(names, targets, depths, objects, strict=True):
            direction = target - eye
            length = float(np.linalg.norm(direction))
            occluder = self._stage.scene.objects[index].name if index >= 0 else name
            if occluder != name and depth < length:
                lines.append(
                    SightLine(agent.name, name, occluder, eye, eye + direction * (float(depth) / length), target)
                )
        return lines

    def _center(self, name: str, object_poses: NDArray[np.float64]) -> NDArray[np.float64]:
        vertices, _ = self._stage.mesh(name)
        center = (vertices.min(axis=0).astype(np.float64) + vertices.max(axis=0)) / 2
        column = self._stage.column(name)
        if column < 0:
            return center
        frame = poses_to_matrices(object_poses[column][None])[0]
        return frame[:3, :3] @ center + frame[:3, 3]
