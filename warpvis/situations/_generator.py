# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generation of situations: rooms, arrangements, questions, and pictures, one room per shard."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import check_whole
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike, Json
from warpvis.errors import SceneError
from warpvis.scene import Scene
from warpvis.situations._balance import Pool
from warpvis.situations._file_rooms import FileRoom
from warpvis.situations._file_scenes import FileScene
from warpvis.situations._hypotheticals import HYPOTHETICALS, Place, stand
from warpvis.situations._images import make_images
from warpvis.situations._kinds import KINDS, sees
from warpvis.situations._numbers import Numbers
from warpvis.situations._observations import Viewer, sights_of
from warpvis.situations._options import PROCEDURAL, SituationOptions
from warpvis.situations._pairs import find_pairs
from warpvis.situations._placing import ABSENT
from warpvis.situations._sequences import Sequence, find_sequences
from warpvis.situations._situation import Moment, Participant, Question, Situation, Thing
from warpvis.situations._stage import Arrangements, Stage
from warpvis.situations.rooms import generate_room

_WORLDS = 400
"""Arrangements of a room that are tried."""
_MAX_ROOMS = 8
"""Rooms that are tried for the situations of one shard."""
_PAIR_SHARE, _SEQUENCE_SHARE = 0.2, 0.1
"""Shares of the situations of a shard that are matched pairs, and over time."""
_MAX_PLACES = 6
_EYE_HEIGHT = 1.6
"""Height of eyes at places where a person could stand [m]."""


@dataclass(eq=False)
class _Draft:
    """A situation before its pictures are rendered."""

    viewers: list[list[Viewer]]
    """The participants and the camera at each moment, each with one pose."""
    poses: NDArray[np.float32]
    """Poses of all movable objects at each moment, shape ``(moments, M, 7)``."""
    sits: NDArray[np.bool_]
    questions: list[Question]
    pair: int = -1
    """Number of its pair; -1 if it has no twin."""
    changed: dict[str, Json] = field(default_factory=dict)


class SituationGenerator:
    """Generates situations shard by shard; a shard depends on the options and its number only."""

    def __init__(
        self, options: SituationOptions | None = None, *, device: DeviceLike = "cpu", threads: int | None = None
    ) -> None:
        """Set up the generator.

        Args:
            options: What to generate.
            device: Device that renders and measures.
            threads: CPU threads to use; all cores of this process by default.
        """
        self.options = SituationOptions() if options is None else options
        if not isinstance(self.options, SituationOptions):
            raise SceneError(f"options must be SituationOptions, got {type(options).__name__}")
        self._device, self._threads = device, check_threads(threads)
        self._files: dict[str, FileScene] = {}

    def shard(self, number: int) -> list[Situation]:
        """Generate the situations of a shard: `SituationOptions.per_shard`, or fewer, often by one.

        Raises:
            FileFormatError: If the file of the scene is missing or cannot be read.
            SceneError: If none of the rooms has a situation with the kinds of questions, or the scene has no floor or
                too few supports.
        """
        number = check_whole(number, "number", minimum=0, error=SceneError)
        situations: list[Situation] = []
        for attempt in range(_MAX_ROOMS):
            missing = self.options.per_shard - len(situations)
            if missing > 1 or not situations:  # questions are chosen in twos at least, since their answers are balanced
                found = self._of_room(number, attempt, missing)
                start = len(situations)
                situations += [_named(one, number, start) for one in found]
        if not situations:
            raise SceneError(
                f"questions must occur in at least one room of a shard, got {', '.join(self.options.questions)}, which "
                f"{_MAX_ROOMS} rooms of shard {number} do not have. Ask more kinds of questions."
            )
        return situations

    def scene(self, situation: Situation, moment: int = 0) -> Scene:
        """Build the scene of a situation again, with all movable objects at their places.

        Args:
            situation: A situation of a generator with the same options.
            moment: Index of the moment.
        """
        if not isinstance(situation, Situation):
            raise SceneError(f"situation must be a Situation, got {type(situation).__name__}")
        moment = check_whole(moment, "moment", minimum=0, error=SceneError)
        if moment >= len(situation.moments):
            raise SceneError(
                f"moment must be below {len(situation.moments)}, the moments of the situation, got {moment}"
            )
        numbers = [situation.room.get(name) for name in ("shard", "attempt")]
        stage, _, described = self._stage(*(check_whole(n, "shard", minimum=0, error=SceneError) for n in numbers))
        if described != situation.room:
            raise SceneError(f"situation must be of a generator with the same options, got {situation.room}")
        poses = situation.moments[moment].poses
        scene = stage.scene
        scene.replace_objects(
            [replace(o, pose=np.array(poses[o.name], np.float32)) if o.name in poses else o for o in scene.objects]
        )
        return scene

    def _stage(self, number: int, attempt: int) -> tuple[Stage, Numbers, dict[str, Json]]:
        """Set up a room, or a part of a file's scene; return it, its random numbers, and its description."""
        options, numbers = self.options, Numbers(self.options.seed, number, attempt)
        shard: dict[str, Json] = {"shard": number, "attempt": attempt}
        path = options.scenes[number % len(options.scenes)]
        if path != PROCEDURAL:
            if path not in self._files:
                self._files[path] = FileScene(path)
            part = FileRoom(self._files[path], numbers)
            stage = Stage(part, numbers, options.stage, self._device, self._threads)
            return stage, numbers, {"kind": Path(path).name, "origin": part.origin.tolist(), **shard}
        kind = options.rooms[(number + attempt) % len(options.rooms)]
        seed = int(numbers.below(1 << 31, 1)[0])
        clutter = round(float(numbers.uniform(*options.clutter, 1)[0]), 2)
        room = generate_room(seed, kind=kind, clutter=clutter)
        described: dict[str, Json] = {"seed": seed, "kind": kind, "clutter": clutter}
        stage = Stage(room, numbers, options.stage, self._device, self._threads)
        return stage, numbers, described | shard

    def _of_room(self, number: int, attempt: int, count: int) -> list[Situation]:
        """Generate at most `count` situations in a room, named by their number in it."""
        stage, numbers, described = self._stage(number, attempt)
        if not len(stage.standing_spots()) or not stage.things:
            return []
        arranged = stage.arrange(_WORLDS)
        if not len(arranged.kept):
            return []
        drafts = self._pairs(stage, arranged, round(count * _PAIR_SHARE / 2), numbers)
        drafts += self._sequences(stage, arranged, round(count * _SEQUENCE_SHARE), numbers)
        drafts += self._single(stage, arranged, count - len(drafts), numbers)
        return self._finish(stage, drafts[:count], described)

    def _single(self, stage: Stage, arranged: Arrangements, count: int, numbers: Numbers) -> list[_Draft]:
        """Return situations of one moment with balanced questions of all kinds."""
        panel, kinds = arranged.panel, self.options.questions
        pools = [make(panel) for kind, make in KINDS.items() if kind in kinds]
        pools += [make(panel, numbers) for kind, make in HYPOTHETICALS.items() if kind in kinds]
        if "stand" in kinds:
            pools.append(stand(panel, numbers, _places_of(stage), _EYE_HEIGHT))
        asked: dict[int, list[Question]] = defaultdict(list)
        remaining = [(pool, _in_lots(pool, count, numbers)) for pool in pools]
        while remaining and len(asked) < count:
            for entry in list(remaining):
                pool, lots = entry
                lot = next(lots, None)
                if lot is None:
                    remaining.remove(entry)
                elif len(asked.keys() | set(pool.world[lot].tolist())) <= count:
                    for row in lot:
                        asked[int(pool.world[row])].append(pool.write(row))
        drafts = []
        for world, questions in sorted(asked.items()):
            rows = np.array([world])
            drafts.append(
                _Draft([panel.viewers_at(rows)], panel.object_poses[rows], arranged.postures[world], questions)
            )
        return drafts

    def _pairs(self, stage: Stage, arranged: Arrangements, count: int, numbers: Numbers) -> list[_Draft]:
        """Return `count` matched pairs, or fewer."""
        panel, drafts = arranged.panel, list[_Draft]()
        if "sees" not in self.options.questions:
            return drafts
        for number, pair in enumerate(find_pairs(stage, arranged, numbers)):
            if len(drafts) >= 2 * count:
                break
            rows = np.array([pair.world])
            viewers, twins, placed = panel.viewers_at(rows), [], []
            for end in (pair.hidden, pair.visible):
                poses = panel.object_poses[rows].copy()
                poses[:, stage.column(pair.blocker)] = end
                found = panel.watch.observe(viewers, poses)
                changed = replace(panel, participants=viewers[:-1], camera=viewers[-1], object_poses=poses, found=found)
                pool = sees(changed)
                asked = panel.participants[pair.agent].name, panel.things[pair.thing]
                written = [pool.write(row) for row in range(len(pool.world))]
                twins.append([question for question in written if question.about == asked])
                placed.append(poses)
            if not all(twins) or twins[0][0].answer == twins[1][0].answer:
                continue  # the blocker hides a participant or the object from the camera
            what: dict[str, Json] = {"object": pair.blocker, "meters": round(pair.distance, 4)}
            for questions, poses in zip(twins, placed, strict=True):
                drafts.append(_Draft([viewers], poses, arranged.postures[pair.world], questions, number, what))
        return drafts

    def _sequences(self, stage: Stage, arranged: Arrangements, count: int, numbers: Numbers) -> list[_Draft]:
        """Return `count` situations over time, or fewer."""
        kinds = [kind for kind in ("when", "belief") if kind in self.options.questions]
        if not kinds or not stage.people:
            return []
        panel, drafts = arranged.panel, list[_Draft]()
        for pool, sequences in find_sequences(stage, arranged, numbers):
            if pool.kind not in kinds:
                continue
            for row in pool.choose(max(2, count // len(kinds)), numbers):
                sequence: Sequence = sequences[row]
                start = panel.viewers_at(np.array([sequence.world]))
                viewers = []
                for eyes in sequence.eyes:
                    now = list(start)
                    now[sequence.agent] = replace(start[sequence.agent], eyes=eyes[None])
                    viewers.append(now)
                sits = arranged.postures[sequence.world]
                drafts.append(_Draft(viewers, sequence.poses, sits, [pool.write(row)]))
        return drafts[:count]

    def _finish(self, stage: Stage, drafts: list[_Draft], room: dict[str, Json]) -> list[Situation]:
        """Observe and render all moments of situations."""
        moments = [(draft, index) for draft, one in enumerate(drafts) for index in range(len(one.poses))]
        if not moments:
            return []
        poses = np.stack([drafts[draft].poses[index] for draft, index in moments])
        every = [drafts[draft].viewers[index] for draft, index in moments]
        viewers = [
            replace(every[0][number], eyes=np.concatenate([one[number].eyes for one in every]))
            for number in range(len(every[0]))
        ]
        found = stage.watch.observe(viewers, poses)
        views = viewers if self.options.views == "all" else viewers[-1:]
        things = [item.name for item in stage.things]
        present = np.ones((len(poses), len(stage.watch.targets)), dtype=np.bool_)
        present[:, : len(things)] = poses[:, [stage.column(name) for name in things], 2] > ABSENT[2]
        images = make_images(stage.watch, viewers[:-1], views, poses, present, self.options.outputs)
        movable = [stage.scene.objects[index].name for index in stage.scene.movable]
        situations, row = [], 0
        for number, draft in enumerate(drafts):
            count = len(draft.poses)
            rows = range(row, row + count)
            row += count
            sights = [
                sight
                for time, index in enumerate(rows)
                for sight in sights_of(found, index, viewers, things, stage.scene, time)
                if present[index, things.index(sight.thing)]
            ]
            names = {f"{view}/{name}" + (f"/{time}" if count > 1 else ""): arrays[index]
                     for (view, name), arrays in images.items() for time, index in enumerate(rows)}  # fmt: skip
            described = tuple(
                Moment(
                    _things(stage, poses[index]),
                    _participants(viewers, index, draft.sits),
                    float(time),
                    {name: _row(pose) for name, pose in zip(movable, poses[index], strict=True)},
                )
                for time, index in enumerate(rows)
            )
            twin = None
            if draft.pair >= 0:
                twin = next(str(i) for i, one in enumerate(drafts) if one.pair == draft.pair and one is not draft)
            camera: dict[str, Json] = {
                "intrinsics": _intrinsics(viewers[-1]),
                "pose": viewers[-1].eyes[rows[0]].round(6).tolist(),
                "views": {viewer.name: _intrinsics(viewer) for viewer in viewers[:-1]},
            }
            situations.append(
                Situation(
                    str(number),
                    room,
                    camera,
                    described,
                    tuple(sights),
                    tuple(draft.questions),
                    twin,
                    draft.changed,
                    names,
                )
            )
        return situations


def _in_lots(pool: Pool, count: int, numbers: Numbers) -> Iterator[list[int]]:
    """Yield rows that are asked together, so that answers stay balanced."""
    rows = pool.choose(count, numbers)
    lots: list[list[int]] = []
    answers: set[tuple[int, int]] = set()
    for row in rows:
        key = int(pool.answer[row]), int(pool.stratum[row])
        if not lots or pool.words[lots[-1][0]] != pool.words[row] or key in answers:
            lots.append([])
            answers = set()
        lots[-1].append(row)
        answers.add(key)
    yield from lots


def _places_of(stage: Stage) -> list[Place]:
    """Return places next to pieces of furniture that are unique in the room."""
    places = []
    for item in stage.room.items:
        if item.name in stage.words and item.support == "floor":
            center = np.array(item.pose[:2])
            spots = stage.standing_spots()
            if len(spots):
                apart = np.linalg.norm(spots[:, :2] - center, axis=1)
                if apart.min() < 0.5 * max(item.size[:2]) + 0.5:
                    x, y = spots[int(apart.argmin()), :2].tolist()
                    places.append(Place(stage.words[item.name], (x, y)))
    far = [
        p for i, p in enumerate(places) if all(np.hypot(*np.subtract(p.position, q.position)) > 1 for q in places[:i])
    ]
    return far[:_MAX_PLACES]


def _things(stage: Stage, poses: NDArray[np.float32]) -> tuple[Thing, ...]:
    rows = {item.name: poses[stage.column(item.name)] for item in stage.things}
    return tuple(
        Thing(item.name, item.category, item.color, _row(rows[item.name]), _rounded(item.size))
        for item in stage.things
        if rows[item.name][2] > ABSENT[2]
    )


def _participants(viewers: list[Viewer], index: int, sits: NDArray[np.bool_]) -> tuple[Participant, ...]:
    found = []
    for number, viewer in enumerate(viewers[:-1]):
        posture = "fixed" if viewer.kind == "robot" else "sitting" if sits[number] else "standing"
        found.append(Participant(viewer.name, viewer.kind, _row(viewer.eyes[index]), posture, viewer.words))
    return tuple(found)


def _intrinsics(viewer: Viewer) -> dict[str, Json]:
    camera = viewer.camera
    far = float(camera.far) if np.isfinite(camera.far) else None
    sizes: dict[str, Json] = {"width": camera.width, "height": camera.height}
    return {
        **sizes,
        "fx": camera.fx,
        "fy": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "near": camera.near,
        "far": far,
    }


def _row(pose: NDArray[np.floating]) -> tuple[float, ...]:
    return tuple(round(float(value), 6) for value in pose)


def _rounded(size: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = (round(float(value), 4) for value in size)
    return x, y, z


def _named(situation: Situation, shard: int, start: int) -> Situation:
    """Return a situation with names that are unique in all shards."""
    own = f"{shard:05}-{start + int(situation.name):04}"
    twin = None if situation.twin is None else f"{shard:05}-{start + int(situation.twin):04}"
    return replace(situation, name=own, twin=twin)
