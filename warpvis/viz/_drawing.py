# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shared drawing functions: shaded scenes, lines in space, and the views, states and colors of agents."""

from __future__ import annotations

import itertools
import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras import as_pinhole
from warpvis.cameras.image_cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import as_items, check_whole, is_whole, pluralize
from warpvis.core.labels import Label
from warpvis.core.poses import Convention, QuaternionOrder, poses_to_matrices, poses_to_opencv, to_xyzw
from warpvis.core.types import ObjectPoses, PoseLike
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering import Output, Renderer, Views, render
from warpvis.scene import Scene, require_scene
from warpvis.visibility import Agent, FieldOfView, Perspective, State, equirectangular

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patheffects import withStroke

_BACKGROUND = np.array([1.0, 1.0, 1.0])
# Direction of the light, along the floor's two axes and up.
_LIGHT = (-0.45, -0.35, 0.82)
_SUPERSAMPLING = 2
# Maximum number of characters in a line of an agent's name.
_NAME_WIDTH = 12

OUTSIDE_CAMERA = Camera.from_fov(640, 480, hfov=0.88)
"""Camera of pictures from outside."""

Colors = Callable[[NDArray[np.float32], NDArray[np.int32], NDArray[np.uint8]], NDArray[np.float64]]

STATE_COLORS: dict[State, tuple[int, int, int]] = {
    State.BOTH: (17, 119, 51),
    State.FIRST: (86, 180, 233),
    State.SECOND: (230, 159, 0),
    State.NEITHER: (120, 94, 240),
}
"""RGB colors of the four states, 0 to 255, distinguishable with any kind of color blindness: colors of Okabe and Ito
for one agent; dark green and violet, from the palettes of Tol and IBM, for both and neither."""

_OTHERS = ((153, 51, 119), (255, 85, 102), (102, 0, 153))
"""Colors of the second and further agents of three or more, distinguishable from each other, from `STATE_COLORS`, and
from white and dark pages, with any kind of color blindness."""

GRAYS = {
    Label.GROUND: 0.88,
    Label.OBSTACLE: 0.70,
    Label.OBJECT: 0.70,
    Label.HUMAN: 0.45,
    Label.ROBOT: 0.45,
}
"""Brightness of objects without a state, from 0 to 1."""

_PIXELS_PER_DEGREE = 3


_MAX_AGENTS = 1000


def agent_colors(count: int) -> list[tuple[int, int, int]]:
    """Return the RGB colors of agents in pictures and in the viewer, 0 to 255, in their order.

    Up to two agents have the colors of what only they see, `STATE_COLORS`. Of three or more, the others have colors
    that differ from `STATE_COLORS`, and repeat after three.

    Args:
        count: Number of agents, from 0 to 1000.
    """
    if check_whole(count, "count", minimum=0) > _MAX_AGENTS:
        raise ArrayError(f"count must be at most {_MAX_AGENTS} agents, got {count}")
    first, second = STATE_COLORS[State.FIRST], STATE_COLORS[State.SECOND]
    if count <= 2:
        return [first, second][:count]
    return [first, *(_OTHERS[number % len(_OTHERS)] for number in range(count - 1))]


def one_pose(
    poses: PoseLike, name: str, convention: Convention = "opencv", quaternion: QuaternionOrder = "xyzw"
) -> NDArray[np.float64]:
    """Return a single pose as a row ``x y z qx qy qz qw`` in OpenCV axes, shape ``(1, 7)``."""
    rows = poses_to_opencv(to_xyzw(poses, quaternion, name), convention, name=name)
    if len(rows) != 1:
        raise ArrayError(f"{name} must be one pose for one picture, got {len(rows)}")
    return rows


def light_on(normals: NDArray[np.floating], up: str) -> NDArray[np.float64]:
    """Return the brightness of surfaces with given normals, shape ``(..., 3)``: from 0.55 in the shade to 1."""
    first, second, height = _LIGHT
    light = np.array([first, second, height] if up == "z" else [second, height, first])
    return 0.55 + 0.45 * np.clip(normals @ (light / np.linalg.norm(light)), 0, 1)


def shaded_picture(
    scene: Scene, camera: Camera, camera_to_world: ArrayLike, colors: Colors, *, object_poses: ObjectPoses = None
) -> NDArray[np.float64]:
    """Render a shaded, antialiased picture of a scene, RGB from 0 to 1, shape ``(H, W, 3)``.

    `colors` returns RGB colors, ``(h, w, 3)``, of points ``(h, w, 3)``, objects and labels ``(h, w)``.
    """
    fine = Camera.from_K(
        camera.to_K() * [[_SUPERSAMPLING], [_SUPERSAMPLING], [1]],
        camera.width * _SUPERSAMPLING,
        camera.height * _SUPERSAMPLING,
    )
    outputs: list[Output] = ["points", "normals", "segmentation", "labels"]
    picture = render(scene, fine, camera_to_world, outputs=outputs, object_poses=object_poses)
    points, normals = picture.points.numpy()[0], picture.normals.numpy()[0]
    objects, labels = picture.segmentation.numpy()[0], picture.labels.numpy()[0]
    color = colors(points, objects, labels) * light_on(normals, scene.up)[..., None]
    color = np.where((objects >= 0)[..., None], color, _BACKGROUND)
    blocks = color.reshape(camera.height, _SUPERSAMPLING, camera.width, _SUPERSAMPLING, 3)
    return blocks.mean(axis=(1, 3))


def frustum(camera: ImageCamera, camera_to_world: ArrayLike, reach: float) -> list[NDArray[np.float64]]:
    """Return lines in the world from the camera to the image's corners and around the image, at depth `reach`.

    For lenses, `reach` is a range, and the lines around the image follow its border.
    """
    matrix = poses_to_matrices(poses_to_opencv(camera_to_world))[0]
    w, h, pinhole = camera.width, camera.height, as_pinhole(camera)
    if pinhole is None:
        border = reach * border_rays(camera) @ matrix[:3, :3].T + matrix[:3, 3]
        border_corners = border[:: max(1, len(border) // 4)][:4]
        return [np.stack([matrix[:3, 3], place]) for place in border_corners] + [border]
    corners = pinhole.back_project([(0, 0), (w, 0), (w, h), (0, h)], np.full(4, reach))
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    return [np.stack([matrix[:3, 3], corner]) for corner in corners] + [corners[[0, 1, 2, 3, 0]]]


def border_rays(camera: ImageCamera) -> NDArray[np.float64]:
    """Return unit vectors along an image's border, ``(n, 3)``, from its first corner, skipping pixels without a ray."""
    w, h = camera.width, camera.height
    corners = np.array([(0, 0), (w, 0), (w, h), (0, h), (0, 0)], dtype=np.float64)
    steps = np.linspace(0, 1, 30)[:, None]
    pixels = np.concatenate([(1 - steps) * a + steps * b for a, b in itertools.pairwise(corners)])
    rays = camera.unproject(pixels)
    return rays[np.isfinite(rays[:, 0])]


def to_picture(camera: ImageCamera, camera_to_world: ArrayLike, points: ArrayLike) -> NDArray[np.float64]:
    """Project points in the world into a picture [px], shape ``(n, 2)``; NaN behind the camera."""
    to_camera = np.linalg.inv(poses_to_matrices(camera_to_world))
    return camera.project(np.asarray(points) @ to_camera[:3, :3].T + to_camera[:3, 3])


def draw_lines(
    axes: Axes,
    camera: Camera,
    camera_to_world: ArrayLike,
    lines: Sequence[NDArray[np.float64]],
    linestyle: str = "-",
    color: tuple[float, ...] | str = "#222222",
    linewidth: float = 0.8,
) -> None:
    """Draw lines in the world, shapes ``(n, 3)``, into a picture."""
    for line in lines:
        points = to_picture(camera, camera_to_world, line)
        axes.plot(*points.T, color=color, linewidth=linewidth, linestyle=linestyle)


def draw_arrow(axes: Axes, start: ArrayLike, end: ArrayLike, linestyle: str = "-") -> None:
    """Draw an arrow that is visible on any background."""
    style = {"arrowstyle": "-|>", "color": "black", "linewidth": 1.6, "shrinkA": 0, "shrinkB": 0}
    style |= {"linestyle": linestyle, "path_effects": white_edge()}
    axes.annotate("", _xy(end), _xy(start), arrowprops=style)


def draw_name(
    axes: Axes, name: str, place: ArrayLike, offset: tuple[float, float], side: str, height: str = "bottom"
) -> None:
    """Write an agent's name at an offset [pt] from a position."""
    box = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}
    axes.annotate(
        textwrap.fill(name, _NAME_WIDTH),
        _xy(place),
        offset,
        textcoords="offset points",
        ha=side,
        va=height,
        bbox=box,
        fontweight="bold",
    )


def neighbor(places: NDArray[np.float64], number: int, distance: float) -> NDArray[np.float64] | None:
    """Return the offset to the nearest other one of 2D places, ``(n, 2)``; None if it is farther than `distance`."""
    offsets = np.delete(places, number, axis=0) - places[number]
    lengths = np.linalg.norm(offsets, axis=1)
    nearest = int(np.argmin(np.nan_to_num(lengths, nan=np.inf)))
    return offsets[nearest] if lengths[nearest] <= distance else None


def white_edge() -> list[withStroke]:
    """Return a path effect that makes black lines visible on a dark background."""
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=3.2, foreground="white")]


def _xy(place: ArrayLike) -> tuple[float, float]:
    x, y = np.asarray(place, dtype=np.float64)
    return float(x), float(y)


def drawn_label(scene: Scene, label: int) -> Label:
    """Return the `Label` that a class is drawn as: ground for all ground labels, obstacle for custom classes."""
    if label in scene.ground_labels:
        return Label.GROUND
    return Label(label) if Label.OBJECT <= label <= Label.ROBOT else Label.OBSTACLE


@dataclass(frozen=True)
class PanelData:
    """Data shared by all panels."""

    scene: Scene
    agents: tuple[Agent, ...]
    view: int
    states: dict[int, State]
    """State of each colored object, by its index in the scene."""
    colors: NDArray[np.float64]
    """RGB color of each object from 0 to 1, and white for -1, shape ``(objects + 1, 3)``."""
    object_poses: ObjectPoses
    seen: tuple[tuple[str, ...], ...]
    """Names of the colored objects that each agent sees."""

    @classmethod
    def from_perspective(
        cls,
        scene: Scene,
        agents: Sequence[Agent],
        seen: Perspective,
        view: int,
        labels: Sequence[Label | int | str] | None,
        object_poses: ObjectPoses,
    ) -> PanelData:
        """Collect the data; see `warpvis.viz.save_perspective` for the arguments and errors."""
        require_scene(scene)
        if not isinstance(seen, Perspective):
            raise SceneError(f"seen must be a result of perspective, got {type(seen).__name__}")
        items = as_items(agents, "agents", SceneError)
        names = [getattr(agent, "name", None) for agent in items if isinstance(agent, Agent)]
        if not len(items) == len({*names} & {*seen.agents}) >= 2:
            listed = ", ".join(repr(getattr(agent, "name", agent)) for agent in items)
            raise SceneError(f"agents must be two or more different agents of seen, got {listed or 'none'}")
        included = set(seen.labels) - scene.ground_labels if labels is None else scene.label_names.numbers(labels)
        found = seen.states(items[0].name, [agent.name for agent in items[1:]])
        if not is_whole(view) or view not in range(len(found)):
            raise ArrayError(f"view must be an index from 0 into {pluralize(len(found), 'situation')}, got {view!r}")
        bodies = {name for agent in items for name in agent.body}
        states = {
            scene.index(name): State(state)
            for name, label, state in zip(seen.objects, seen.labels, found[view], strict=True)
            if label in included and name not in bodies
        }
        colors = np.array([[GRAYS[drawn_label(scene, item.label)]] * 3 for item in scene.objects] + [[1.0] * 3])
        for name in bodies:
            colors[scene.index(name)] = GRAYS[Label.HUMAN]
        for index, state in states.items():
            colors[index] = np.array(STATE_COLORS[state]) / 255
        poses = seen.objects_at(view) if object_poses is None else object_poses
        visible = seen.visible[[seen.agents.index(agent.name) for agent in items], view]
        seen_by = tuple(
            tuple(
                name for name, is_seen in zip(seen.objects, row, strict=True) if is_seen and scene.index(name) in states
            )
            for row in visible
        )
        return cls(scene, tuple(items), view, states, colors, poses, seen_by)

    @property
    def bodies(self) -> set[int]:
        """Indices of the objects that are the agents' bodies."""
        return {self.scene.index(name) for agent in self.agents for name in agent.body}

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Minimum and maximum corner of the scene and the agents' eyes [m], shape ``(2, 3)``."""
        corners = np.concatenate([self.scene.bounds.astype(np.float64), self.poses[:, :3]])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])

    @property
    def poses(self) -> NDArray[np.float64]:
        """Poses of the agents, rows ``x y z qx qy qz qw``, shape ``(A, 7)``."""
        return np.stack([pose_of(agent, self.view) for agent in self.agents])


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
    options: dict[str, Any] = {"object_poses": object_poses, "exclude": agent.excluded or None}
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
    options: dict[str, Any] = {"object_poses": object_poses, "exclude": agent.excluded or None}
    found = []
    faces = agent.faces
    for k, face in enumerate(faces):
        # Add a column at the border to the next face to avoid gaps.
        left, right = int(k > 0), int(k < len(faces) - 1)
        lens = face.camera
        if lens.ray_model == "pinhole":
            lens = replace(lens, width=lens.width + left + right, cx=lens.cx + left)
        poses = agent.face_poses(face)
        pose = poses[view if len(poses) > 1 else 0]
        found.append(render(scene, lens, pose, outputs=("points", "labels", "segmentation"), **options))
    return found


def _panorama(scene: Scene, agent: Agent, view: int, options: dict[str, Any]) -> AgentView:
    field, faces = agent.camera, agent.faces
    assert isinstance(field, FieldOfView)
    (height, width), parts = equirectangular(field, _PIXELS_PER_DEGREE)
    distance = np.full((height, width), np.inf)
    normals = np.full((height, width, 3), np.nan, dtype=np.float32)
    objects = np.full((height, width), -1, dtype=np.int32)
    for face, (columns, rays) in zip(faces, parts, strict=True):
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
    sides, up, down = (math.degrees(angle) for angle in (field.hfov / 2, field.up, field.down))
    return AgentView(distance, normals, objects, (-sides, sides, -down, up), border)
