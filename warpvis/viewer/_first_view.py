# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The first view of a page, which shows everything on canvases of any shape, and the folded panel of phones."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from viser import CameraHandle, ClientHandle, GuiApi, ViserServer

    from warpvis.scene import Scene

Floats = NDArray[np.float64]

# Space around the scene, as a fraction of the free part of the canvas; aspect ratio of the initial camera.
_MARGIN, _USUAL_ASPECT = 0.05, 1.5

# Below this aspect ratio, the canvas is that of a phone, which is high enough for a view from higher up. The panel of
# pages narrower than 36em is a sheet at the bottom, and otherwise at the right. Only the aspect ratio of a canvas is
# known, not its size: assume the width of a phone [px].
_PHONE_ASPECT, _SHEET_HEIGHT, _PHONE_WIDTH, _RAISE = 0.7, 56, 360, 0.5
_EXPORT_ASPECT = 0.45

# Size of the panel at the right with its margins, and assumed height of windows and of phones in landscape [px].
_PANEL_WIDTH, _WINDOW_HEIGHT, _LANDSCAPE_HEIGHT, _LANDSCAPE_ASPECT = 340, 700, 390, 2.1
_MAX_COVERED = 0.6

# Largest distance at which a camera is at a pose, and changes of the aspect ratio and of the fit to growing points that
# are ignored, as fractions.
_AT_POSE, _SAME_ASPECT, _GROWN = 1e-4, 0.01, 0.1

# Space around agents' eyes for frusta and handles [m]; ground shown around other objects, relative to their extent.
_AGENT_REACH, _GROUND_REACH = 0.3, 0.5

# Percentiles of the coordinates of measured points that are shown.
_CENTRAL = (0.1, 99.9)

# Click on the head of the bottom sheet once. viser opens the sheet at start and has no option for that; desktops have
# no sheet. If another version of viser has another structure, no head is found, and the sheet stays open.
_FOLD = """
for (let node = this; node && matchMedia("(max-width: 36em)").matches; node = node.parentElement) {
  const head = node.previousElementSibling;
  if (head?.style?.cursor === "pointer") {
    if (!node.dataset.folded) head.click();
    node.dataset.folded = "once";
    break;
  }
}
"""


def fold_on_phones(gui: GuiApi) -> None:
    """Add an invisible element, outside folders, that folds the panel of narrow pages when they open."""
    script = " ".join(_FOLD.split()).replace('"', "&quot;")
    gui.add_html(f'<img alt="" style="display:none" src="data:," onerror="{script}">')


def scene_corners(scene: Scene, eyes: Floats) -> Floats:
    """Return the corners of the boxes of a scene's objects, and points around agents' eyes [m], ``(n, 3)``.

    Large ground is clipped to the surroundings of the other objects.
    """
    ground = [item.bounds for item in scene.objects if item.label in scene.ground_labels]
    others = [item.bounds for item in scene.objects if item.label not in scene.ground_labels]
    found = np.concatenate([spread(eyes), *(corners(*box) for box in others or ground)])
    low, high = found.min(axis=0), found.max(axis=0)
    reach = _GROUND_REACH * float(np.linalg.norm(high - low))
    return np.concatenate([found, *(corners(*np.clip(box, low - reach, high + reach)) for box in ground)])


def corners(low: NDArray[np.floating], high: NDArray[np.floating]) -> Floats:
    """Return the corners of a box, ``(8, 3)``."""
    return np.stack(np.meshgrid(*np.stack([low, high], axis=1), indexing="ij"), axis=-1).reshape(-1, 3).astype(float)


def spread(eyes: Floats) -> Floats:
    """Return the corners of boxes around the eyes of agents, ``(8 n, 3)``."""
    return np.concatenate([corners(eye - _AGENT_REACH, eye + _AGENT_REACH) for eye in eyes])


def without_outliers(points: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return the points that are inside the central part of all coordinates' distributions."""
    if not len(points):
        return points
    low, high = np.percentile(points, _CENTRAL, axis=0)
    return points[((points >= low) & (points <= high)).all(axis=1)]


class FirstView:
    """The view of every browser until its user moves the camera.

    A browser starts at the server's initial camera, to which "Reset View" returns. From there, its camera is moved to
    where its own canvas shows all points, and again if the canvas changes its shape or the points grow out of the view.
    """

    def __init__(self, server: ViserServer, up: Floats, fov: float) -> None:
        """Store the direction up and the vertical field of view [rad]."""
        self._server, self._up = server, up
        self._points: Floats | None = None
        self._last: dict[int, tuple[Floats, float]] = {}
        """Last fitted position and aspect ratio of each browser."""
        server.initial_camera.fov = fov
        server.on_client_connect(self._connect)

    def show(self, points: Floats, direction: Floats) -> None:
        """Set the points to show, ``(n, 3)``, and the direction from them to the camera."""
        self._points, self._direction = np.asarray(points, dtype=np.float64), np.asarray(direction, dtype=np.float64)
        initial = self._server.initial_camera
        initial.position, initial.look_at = self._fit(_USUAL_ASPECT)

    def extend(self, points: Floats) -> None:
        """Replace the points, ``(n, 3)``, whose number or extent grows."""
        self._points = np.asarray(points, dtype=np.float64)
        for client in self._server.get_clients().values():
            self._follow(client.camera, min_change=_GROWN)

    def phone_script(self) -> str:
        """Return JavaScript that shows all points on phones without a server. It must run before viser's."""
        position, look_at = (",".join(f"{value:.6g}" for value in place) for place in self._fit(_EXPORT_ASPECT))
        query = f"?initialCameraPosition={position}&initialCameraLookAt={look_at}"
        return (
            f"if(!location.search&&innerWidth<{_PHONE_ASPECT}*innerHeight)"
            f'try{{history.replaceState(null,"",location.pathname+"{query}"+location.hash)}}catch{{}}'
        )

    def _fit(self, aspect: float) -> tuple[Floats, Floats]:
        assert self._points is not None  # set by `show`
        direction = self._direction / np.linalg.norm(self._direction) + _RAISE * (aspect < _PHONE_ASPECT) * self._up
        return fit_view(self._points, direction, self._up, self._server.initial_camera.fov, aspect)

    def _connect(self, client: ClientHandle) -> None:
        client.camera.on_update(self._follow)
        self._follow(client.camera)

    def _follow(self, camera: CameraHandle, min_change: float = math.inf) -> None:
        """Fit a camera that its user has not moved, if its canvas or, by more than a fraction, the fit changed."""
        if self._points is None or not camera.image_height or not camera.image_width:
            return
        aspect, initial = camera.aspect, self._server.initial_camera.position
        last, last_aspect = self._last.get(camera.client.client_id, (initial, aspect))
        is_new = _is_at(camera, initial)
        if not is_new and not _is_at(camera, last):
            return
        is_changed = is_new or abs(aspect / last_aspect - 1) > _SAME_ASPECT
        if not is_changed and math.isinf(min_change):
            return
        position, look_at = self._fit(aspect)
        if is_changed or np.linalg.norm(position - last) > min_change * np.linalg.norm(position - look_at):
            self._last[camera.client.client_id] = (position, aspect)
            with camera.client.atomic():
                camera.position = position
                camera.look_at = look_at


def _is_at(camera: CameraHandle, position: Floats) -> bool:
    distance = float(np.linalg.norm(camera.look_at - camera.position))
    return float(np.linalg.norm(camera.position - position)) <= _AT_POSE * distance


def fit_view(points: Floats, direction: Floats, up: Floats, fov: float, aspect: float) -> tuple[Floats, Floats]:
    """Place a camera at the smallest distance at which all points are in the part of its canvas that no panel covers.

    A point at (x, y, z) from the world's origin, in the camera's axes, is inside the left and right borders of a camera
    at (x0, y0, z0) if ``left (z - z0) <= x - x0 <= right (z - z0)``, with the tangents of the borders' angles. All
    points are if ``max(x - right z) + right z0 <= x0 <= min(x - left z) + left z0``, which bounds z0; so do the other
    two borders.

    Args:
        points: Points [m], ``(n, 3)``.
        direction: Direction from the points to the camera.
        up: Direction up, not parallel to `direction`.
        fov: Vertical field of view [rad].
        aspect: Width of the canvas divided by its height.

    Returns:
        The position [m], and a point on the optical axis in the middle of the points [m], each ``(3,)``.
    """
    forward = -direction / np.linalg.norm(direction)
    right = np.cross(forward, up) / np.linalg.norm(np.cross(forward, up))
    axes = np.stack([right, np.cross(forward, right), forward])
    along = points @ axes.T
    depth = along[:, 2]
    near = depth.min() - 1e-3 * max(float(np.ptp(along, axis=0).max()), 1e-3)
    slack = []
    for values, (low, high) in zip(along.T[:2], _borders(fov, aspect), strict=True):
        first, last = float((values - high * depth).max()), float((values - low * depth).min())
        slack.append((first, last, low, high))
        near = min(near, (last - first) / (high - low))
    middle = [(first + high * near + last + low * near) / 2 for first, last, low, high in slack]
    position = np.array([*middle, near]) @ axes
    return position, position + forward * ((depth.min() + depth.max()) / 2 - near)


def _borders(fov: float, aspect: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the tangents of the left and right, and of the upper and lower border of the free part of a canvas."""
    across = below = 0.0
    if aspect < _PHONE_ASPECT:
        below = _SHEET_HEIGHT * aspect / _PHONE_WIDTH
    else:
        height = _WINDOW_HEIGHT if aspect < _LANDSCAPE_ASPECT else _LANDSCAPE_HEIGHT
        across = min(_PANEL_WIDTH / (height * aspect), _MAX_COVERED)
    half = math.tan(fov / 2)
    found = []
    for size, covered in ((2 * half * aspect, across), (2 * half, below)):
        margin = _MARGIN * size * (1 - covered)
        found.append((-size / 2 + margin, size / 2 - covered * size - margin))
    return found[0], found[1]
