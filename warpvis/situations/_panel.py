# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Everything that questions are made from: who is in a room, what is in it, and what each of them sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.scene import Scene
from warpvis.situations._observations import Observations, Viewer, Watch

SEEN = 0.25
"""Minimum visible share of what is called visible."""
HIDDEN = 0.01
"""Maximum visible share of what is called not visible."""
LIMIT = 0.1
"""Visible share between the two, from which margins count; objects with shares near it are not asked about."""
Rows = Sequence[NDArray[np.integer]]
"""Columns of arrangements, agents, objects, and others."""
_IN_PICTURE = 0.5
_PERSON_IN_PICTURE = 0.3
"""Minimum visible shares of the objects and the participants of a question in the picture."""
MIN_PIXELS = 8.0
"""Minimum size of the objects of a question in the picture, the diagonal of the box [px]."""


def is_clear(shares: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return where visible shares are those of something visible, or of something that is not, but nothing between."""
    return (shares >= SEEN) | (shares <= HIDDEN)


def pixels_of(camera: Camera, sizes: NDArray[np.float64], distances: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return about how large objects of some sizes [m] are in an image at distances [m], in pixels."""
    return camera.fx * sizes / np.maximum(distances, 1e-9)


@dataclass(frozen=True, eq=False)
class Panel:
    """The viewers and the objects of W arrangements of a room, and what was observed."""

    watch: Watch
    """Measures what viewers see."""
    participants: Sequence[Viewer]
    """The P people and robots."""
    camera: Viewer
    """The camera of the pictures."""
    things: tuple[str, ...]
    """Names of the T objects of interest: the first targets of `watch`; the participants are the next ones."""
    words: dict[str, str]
    """How questions refer to the objects of the scene, by name: ``"the red mug"``. Structure of the room has none."""
    categories: dict[str, str]
    """Classes of the objects of interest."""
    sizes: NDArray[np.float64]
    """Diagonals of their boxes [m], shape ``(T,)``."""
    object_poses: NDArray[np.float32]
    """Poses of the scene's movable objects, shape ``(W, M, 7)``."""
    found: Observations
    """What the participants and then the camera see, ``(W, P + 1, T + P)``."""

    @property
    def scene(self) -> Scene:
        """The scene of the room."""
        return self.watch.scene

    @property
    def fraction(self) -> NDArray[np.float64]:
        """Visible shares of the objects for the participants, shape ``(W, P, T)``."""
        return self.found.fraction[:, :-1, : len(self.things)]

    @property
    def in_picture(self) -> NDArray[np.bool_]:
        """Whether an object is well visible in the picture, and not too small, shape ``(W, T)``."""
        count = len(self.things)
        pixels = pixels_of(self.camera.camera, self.sizes, self.found.distance[:, -1, :count])
        return (self.found.fraction[:, -1, :count] >= _IN_PICTURE) & (pixels >= MIN_PIXELS)

    @property
    def participant_in_picture(self) -> NDArray[np.bool_]:
        """Whether a participant is well visible in the picture, shape ``(W, P)``."""
        return self.found.fraction[:, -1, len(self.things) :] >= _PERSON_IN_PICTURE

    def viewers_at(self, worlds: NDArray[np.integer]) -> list[Viewer]:
        """Return the participants and then the camera in some of the arrangements."""
        return [viewer.at(worlds) for viewer in (*self.participants, self.camera)]

    def eyes(self, worlds: NDArray[np.integer], agents: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the poses of the eyes of agents, one in each of some arrangements, shape ``(n, 7)``."""
        return np.stack([viewer.eyes for viewer in self.participants], axis=1)[worlds, agents]

    def offsets(self, rows: Rows) -> NDArray[np.float64]:
        """Return the centers of the objects of rows, seen from the agents, in the room's axes [m], ``(n, 3)``."""
        world, agent, thing = rows[:3]
        rotations = poses_to_matrices(self.eyes(world, agent))[:, :3, :3]
        return np.einsum("nij,nj->ni", rotations, self.found.centers[world, agent, thing])

    def shares(
        self,
        rows: Rows,
        *,
        eyes: NDArray[np.float64] | None = None,
        object_poses: NDArray[np.float32] | None = None,
        removed: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.float64]:
        """Measure the visible share of an object for an agent in each row, after a change.

        Args:
            rows: Columns of arrangements, agents and objects, shape ``(n,)`` each; others are ignored.
            eyes: Other poses of the agents' eyes, shape ``(n, 7)``.
            object_poses: Other poses of the movable objects, shape ``(n, M, 7)``.
            removed: Objects that are left out, shape ``(n, objects)``.
        """
        world, agent, thing = rows[:3]
        eyes = self.eyes(world, agent) if eyes is None else eyes
        poses = self.object_poses[world] if object_poses is None else object_poses
        return self.watch.shares(self.participants, agent, thing, eyes, poses, removed)

    def picture_features(self, worlds: NDArray[np.integer], things: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return place and distance of objects in the picture, shape ``(n, 3)``."""
        centers = self.found.centers[worlds, -1, things]
        depth = np.maximum(centers[:, 2], 0.1)
        return np.stack([centers[:, 0] / depth, centers[:, 1] / depth, np.linalg.norm(centers, axis=1)], axis=1)

    def blocker(self, world: int, agent: int, thing: int) -> tuple[str, float]:
        """Return the object that hides most of another from an agent, and the share of the silhouette that it hides."""
        index = int(self.found.occluders[world, agent, thing, 0])
        return (self.scene.objects[index].name if index >= 0 else "", float(self.found.shares[world, agent, thing, 0]))

    def state(self, world: int, agent: int, thing: int) -> str:
        """Return the state of an object for an agent: ``"visible"``, ``"occluded"``, ..."""
        return Visibility(self.found.status[world, agent, thing]).name.lower()
