# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of an agent's view: of its camera, or an equirectangular image of a wide field of view."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TypedDict

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.types import Excluded, ObjectPoses
from warpvis.rendering import Renderer, Views, render
from warpvis.scene import Scene
from warpvis.visibility import Agent, FieldOfView
from warpvis.viz._drawing import border_rays

_PIXELS_PER_DEGREE = 3


class _World(TypedDict):
    """Arguments of `Renderer.render` that define the situation."""

    object_poses: ObjectPoses
    exclude: Excluded


@dataclass(frozen=True)
class AgentView:
    """Images of an agent's view in one situation."""

    distance: NDArray[np.float64]
    """Planar depth for a camera, distance for a field of view [m], ``(h, w)``; not finite without a surface."""
    normals: NDArray[np.float32]
    """Unit normals in the world, ``(h, w, 3)``."""
    objects: NDArray[np.int32]
    """Indices of the scene's objects, ``(h, w)``; -1 for none."""
    extent: tuple[float, float, float, float]
    """Left, right, bottom and top, in pixels for a camera, in degrees for a field of view: matplotlib's ``extent``."""
    attention: NDArray[np.float64]
    """Border of the field of attention in the coordinates of `extent`, ``(n, 2)``; ``(0, 2)`` without one."""


def agent_view(scene: Scene, agent: Agent, view: int = 0, *, object_poses: ObjectPoses = None) -> AgentView:
    """Render an agent's view in one situation.

    The axes of the image of a `FieldOfView` are azimuth and elevation (equirectangular). It covers the field's images.
    """
    options: _World = {"object_poses": object_poses, "exclude": agent.body or None}
    if isinstance(agent.camera, FieldOfView):
        return _panorama(scene, agent, view, options)
    camera = agent.camera
    seen = render(scene, camera, pose_of(agent, view), outputs=("depth", "normals", "segmentation"), **options)
    border = np.empty((0, 2))
    if agent.attention is not None:
        border = camera.project(border_rays(agent.attention))
    depth, normals, objects = (image.numpy()[0] for image in (seen.depth, seen.normals, seen.segmentation))
    return AgentView(depth, normals, objects, (0, camera.width, camera.height, 0), border)


def pose_of(agent: Agent, view: int) -> NDArray[np.float64]:
    """Return an agent's pose in a situation, a row ``x y z qx qy qz qw``."""
    return agent.poses[view if len(agent.poses) > 1 else 0]


def views_of_faces(scene: Scene, agent: Agent, view: int = 0, *, object_poses: ObjectPoses = None) -> list[Views]:
    """Render points, labels and objects of all faces of an agent in one situation."""
    options: _World = {"object_poses": object_poses, "exclude": agent.body or None}
    found = []
    faces = agent.faces
    for k, face in enumerate(faces):
        # Add a column at the border to the next face to avoid gaps.
        left, right = int(k > 0), int(k < len(faces) - 1)
        lens = face.camera
        if isinstance(lens, Camera):
            lens = replace(lens, width=lens.width + left + right, cx=lens.cx + left)
        poses = agent.face_poses(face)
        pose = poses[view if len(poses) > 1 else 0]
        found.append(render(scene, lens, pose, outputs=("points", "labels", "segmentation"), **options))
    return found


def _panorama(scene: Scene, agent: Agent, view: int, options: _World) -> AgentView:
    field, faces = agent.camera, agent.faces
    assert isinstance(field, FieldOfView)
    sides, up, down = (math.degrees(angle) for angle in (field.hfov / 2, field.up, field.down))
    width, height = math.ceil(2 * sides * _PIXELS_PER_DEGREE), math.ceil((up + down) * _PIXELS_PER_DEGREE)
    azimuths = np.radians((np.arange(width) + 0.5) / width * 2 * sides - sides)
    elevations = np.radians(up - (np.arange(height) + 0.5) / height * (up + down))[:, None]
    face_of = np.minimum((azimuths + field.hfov / 2) * len(faces) // field.hfov, len(faces) - 1).astype(int)

    distance = np.full((height, width), np.inf)
    normals = np.full((height, width, 3), np.nan, dtype=np.float32)
    objects = np.full((height, width), -1, dtype=np.int32)
    for k, face in enumerate(faces):
        columns = face_of == k
        offset = azimuths[columns] - ((k + 0.5) * field.hfov / len(faces) - field.hfov / 2)
        rays = np.stack(np.broadcast_arrays(np.tan(offset), -np.tan(elevations) / np.cos(offset), 1.0), axis=-1)
        pixels = face.camera.project(rays).astype(np.float32)
        poses = agent.face_poses(face)
        renderer = Renderer(scene, face.camera, outputs=("depth", "normals", "segmentation"))
        seen = renderer.render_at(poses[view if len(poses) > 1 else 0], pixels.reshape(1, -1, 2), **options)
        shape = rays.shape[:2]
        distance[:, columns] = seen.depth.numpy().reshape(shape) * np.linalg.norm(rays, axis=-1)
        normals[:, columns] = seen.normals.numpy().reshape(*shape, 3)
        objects[:, columns] = seen.segmentation.numpy().reshape(shape)
    border = np.empty((0, 2))
    if agent.attention is not None:
        x, y, z = border_rays(agent.attention).T
        border = np.degrees(np.stack([np.arctan2(x, z), np.arctan2(-y, np.hypot(x, z))], axis=1))
    return AgentView(distance, normals, objects, (-sides, sides, -down, up), border)
