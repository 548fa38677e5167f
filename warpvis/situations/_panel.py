# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Everything that questions are made from: who is in a room, what is in it, and what each of them sees."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Visibility
from warpvis.scene import Scene
from warpvis.situations._observations import Observations, Viewer, Watch

SEEN = 0.25
"""Minimum visible share of what is called visible."""
HIDDEN = 0.01
"""Maximum visible share of what is called not visible."""
LIMIT = 0.1
"""Visible share between the two, from which margins count; objects with shares near it are not asked about."""
_IN_PICTURE = 0.5
_PERSON_IN_PICTURE = 0.3
"""Minimum visible shares of the objects and the participants of a question in the picture."""


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
        """Whether an object is well visible in the picture, shape ``(W, T)``."""
        return self.found.fraction[:, -1, : len(self.things)] >= _IN_PICTURE

    @property
    def participant_in_picture(self) -> NDArray[np.bool_]:
        """Whether a participant is well visible in the picture, shape ``(W, P)``."""
        return self.found.fraction[:, -1, len(self.things) :] >= _PERSON_IN_PICTURE

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
