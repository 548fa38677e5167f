# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What participants and the camera of the pictures see of objects, in many arrangements of a room at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.core.labels import Visibility
from warpvis.core.poses import poses_to_matrices
from warpvis.scene import Scene
from warpvis.situations._situation import Sight
from warpvis.visibility import FractionMeter, MarginMeter

OCCLUDERS = 3
"""Number of blockers that are recorded for each object."""
_MIN_SAMPLES = 256
_MAX_VIEWS = 4096
"""Maximum number of views per call, which bounds memory."""


@dataclass(frozen=True, eq=False)
class Viewer:
    """A participant, or the camera of the pictures, in W arrangements."""

    name: str
    """Its name; ``"camera"`` for the camera of the pictures."""
    kind: str
    """``"person"``, ``"robot"`` or ``"camera"``."""
    camera: Camera
    """Its field of view, and its range."""
    eyes: NDArray[np.float64]
    """Camera to world, shape ``(W, 7)``."""
    words: str = ""
    """How questions refer to it."""
    body: tuple[str, ...] = ()
    """Objects of its body, which it does not see."""

    def at(self, worlds: NDArray[np.integer]) -> Viewer:
        """Return it in some of the arrangements."""
        return replace(self, eyes=self.eyes[worlds])


@dataclass(frozen=True, eq=False)
class Observations:
    """What A viewers see of K objects in W arrangements."""

    fraction: NDArray[np.float64]
    """Visible share of the silhouettes, shape ``(W, A, K)``."""
    error: NDArray[np.float64]
    """Bounds of the errors of `fraction`, shape ``(W, A, K)``."""
    status: NDArray[np.uint8]
    """Values of `Visibility`, shape ``(W, A, K)``."""
    occluders: NDArray[np.int32]
    """Indices of the objects that hide most, -1 for none, shape ``(W, A, K, 3)``."""
    shares: NDArray[np.float64]
    """Share of the silhouette that each of them hides, shape ``(W, A, K, 3)``."""
    centers: NDArray[np.float64]
    """Centers of the objects in the frames of the viewers [m], shape ``(W, A, K, 3)``."""

    def at(self, worlds: NDArray[np.integer]) -> Observations:
        """Return those of some of the arrangements."""
        return Observations(**{name: getattr(self, name)[worlds] for name in self.__dataclass_fields__})

    @property
    def distance(self) -> NDArray[np.float64]:
        """Distances of the objects from the viewers [m], shape ``(W, A, K)``."""
        return np.linalg.norm(self.centers, axis=-1)

    @property
    def azimuth(self) -> NDArray[np.float64]:
        """Angles of the objects to the right of the gaze, about the viewers' vertical axis [rad], ``(W, A, K)``."""
        return np.arctan2(self.centers[..., 0], self.centers[..., 2])


class Watch:
    """Measures what viewers see of the same objects of a scene in repeated calls."""

    def __init__(self, scene: Scene, targets: dict[str, list[str]], threads: int | None = None) -> None:
        """Set up for targets, each one the union of some objects, with a number of CPU threads."""
        self.scene, self.targets, self.threads = scene, targets, threads
        self._meters: dict[tuple[Camera, str], FractionMeter] = {}
        self._margins: dict[Camera, MarginMeter] = {}
        first = [scene[names[0]] for names in targets.values()]
        columns = {index: column for column, index in enumerate(scene.movable)}
        self._columns = [columns.get(scene.index(item.name), -1) for item in first]
        boxes = [item.mesh.rounded if item.pose is not None else item.vertices for item in first]
        self._local = np.array([(box.min(axis=0) + box.max(axis=0)) / 2 for box in boxes], dtype=np.float64)

    def observe(
        self,
        viewers: Sequence[Viewer],
        object_poses: NDArray[np.float32],
        removed: NDArray[np.bool_] | None = None,
    ) -> Observations:
        """Measure all targets.

        Args:
            viewers: A viewers, each with W poses.
            object_poses: Poses of the scene's movable objects, shape ``(W, M, 7)``.
            removed: Objects that are left out for all viewers, shape ``(W, objects)``.
        """
        worlds, count = len(object_poses), len(self.targets)
        shape = (worlds, len(viewers), count)
        found: dict[str, NDArray[Any]] = {
            "fraction": np.zeros(shape),
            "error": np.zeros(shape),
            "status": np.zeros(shape, dtype=np.uint8),
            "occluders": np.full((*shape, OCCLUDERS), -1, dtype=np.int32),
            "shares": np.zeros((*shape, OCCLUDERS)),
        }
        names = {"shares": "occluder_shares"}
        for camera in dict.fromkeys(viewer.camera for viewer in viewers):
            rows = [index for index, viewer in enumerate(viewers) if viewer.camera == camera]
            eyes = np.stack([viewers[index].eyes for index in rows], axis=1).astype(np.float32)
            hidden = np.stack([self._hidden(viewers[index].body, worlds, removed) for index in rows], axis=1)
            meter = self._fraction_meter(camera)
            step = max(1, _MAX_VIEWS // len(rows))
            for start in range(0, worlds, step):
                part = slice(start, start + step)
                result = meter.measure(eyes[part], object_poses=object_poses[part], exclude=hidden[part])
                for name, array in found.items():
                    array[part, rows] = getattr(result, names.get(name, name)).numpy()
        return Observations(**found, centers=self._centers(viewers, object_poses))

    def shares(
        self,
        viewers: Sequence[Viewer],
        agents: NDArray[np.integer],
        targets: NDArray[np.integer],
        eyes: NDArray[np.float64],
        object_poses: NDArray[np.float32],
        removed: NDArray[np.bool_] | None = None,
    ) -> NDArray[np.float64]:
        """Measure the visible share of one target for one viewer in each of n arrangements, shape ``(n,)``.

        Args:
            viewers: The viewers; their eyes are ignored.
            agents: Index of the viewer, shape ``(n,)``.
            targets: Index of the target, shape ``(n,)``.
            eyes: Poses of the viewers' eyes, shape ``(n, 7)``.
            object_poses: Poses of the movable objects, shape ``(n, M, 7)``.
            removed: Objects that are left out, shape ``(n, objects)``.
        """
        found, names = np.zeros(len(agents)), list(self.targets)
        hidden = np.zeros((len(agents), len(self.scene)), dtype=np.bool_) if removed is None else removed.copy()
        for number, viewer in enumerate(viewers):
            hidden[np.ix_(agents == number, [self.scene.index(name) for name in viewer.body])] = True
        for camera in dict.fromkeys(viewer.camera for viewer in viewers):
            uses = np.array([viewer.camera == camera for viewer in viewers])[agents]
            for target in np.unique(targets[uses]):
                meter, rows = self._fraction_meter(camera, names[target]), np.flatnonzero(uses & (targets == target))
                for part in np.split(rows, range(_MAX_VIEWS, len(rows), _MAX_VIEWS)):
                    views = eyes[part].astype(np.float32)
                    result = meter.measure(views, object_poses=object_poses[part], exclude=hidden[part])
                    found[part] = result.fraction.numpy()[:, 0]
        return found

    def margins(
        self, viewers: Sequence[Viewer], object_poses: NDArray[np.float32]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return angles [degrees] and sideways movements of the blocker [m] to the nearest change, ``(W, A, K)``."""
        shape = (len(object_poses), len(viewers), len(self.targets))
        degrees, meters = np.full(shape, np.nan), np.full(shape, np.nan)
        for index, viewer in enumerate(viewers):
            if viewer.camera not in self._margins:
                objects = dict(self.targets)
                self._margins[viewer.camera] = MarginMeter(
                    self.scene, viewer.camera, objects=objects, threads=self.threads
                )
            hidden = self._hidden(viewer.body, len(object_poses), None)
            result = self._margins[viewer.camera].measure(
                viewer.eyes.astype(np.float32), object_poses=object_poses, exclude=hidden
            )
            degrees[:, index], meters[:, index] = result.degrees.numpy(), result.meters.numpy()
        return degrees, meters

    def _fraction_meter(self, camera: Camera, target: str = "") -> FractionMeter:
        """Return the meter of a target, or of all."""
        if (camera, target) not in self._meters:
            objects = {target: self.targets[target]} if target else dict(self.targets)
            options: dict[str, Any] = {"min_samples": _MIN_SAMPLES, "occluders": 0 if target else OCCLUDERS}
            options["threads"] = self.threads
            self._meters[camera, target] = FractionMeter(self.scene, camera, objects=objects, **options)
        return self._meters[camera, target]

    def _hidden(self, body: Sequence[str], worlds: int, removed: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        """Return which objects a viewer does not see, shape ``(W, objects)``."""
        hidden = np.zeros((worlds, len(self.scene)), dtype=np.bool_) if removed is None else removed.copy()
        hidden[:, [self.scene.index(name) for name in body]] = True
        return hidden

    def _centers(self, viewers: Sequence[Viewer], object_poses: NDArray[np.float32]) -> NDArray[np.float64]:
        """Return the centers of the targets' boxes in the viewers' frames [m], shape ``(W, A, K, 3)``."""
        matrices = poses_to_matrices(object_poses.astype(np.float64))
        world = np.repeat(self._local[None], len(object_poses), axis=0)
        for target, column in enumerate(self._columns):
            if column >= 0:
                pose = matrices[:, column]
                world[:, target] = pose[:, :3, :3] @ self._local[target] + pose[:, :3, 3]
        eyes = np.stack([poses_to_matrices(viewer.eyes) for viewer in viewers], axis=1)
        offsets = world[:, None] - eyes[:, :, None, :3, 3]
        return np.einsum("waij,waki->wakj", eyes[..., :3, :3], offsets)


def sights_of(
    found: Observations, world: int, viewers: Sequence[Viewer], things: Sequence[str], scene: Scene, time: int = 0
) -> list[Sight]:
    """Return what viewers see of the first objects, ``things``, in an arrangement."""
    sights = []
    for agent, viewer in enumerate(viewers):
        for thing, name in enumerate(things):
            place = world, agent, thing
            blockers = tuple(
                (scene.objects[index].name, round(float(share), 4))
                for index, share in zip(found.occluders[place], found.shares[place], strict=True)
                if index >= 0 and share > 0
            )
            state = Visibility(found.status[place]).name.lower()
            fraction, error = round(float(found.fraction[place]), 4), round(float(found.error[place]), 4)
            sights.append(Sight(viewer.name, name, time, fraction, error, state, blockers))
    return sights
