# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A furnished place with people, a robot and objects of interest, and random arrangements of them."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from warpvis.core.labels import Label
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import DeviceLike
from warpvis.planning import look_along
from warpvis.situations._numbers import Numbers
from warpvis.situations._observations import Observations, Viewer, Watch
from warpvis.situations._panel import MIN_PIXELS, Panel, pixels_of
from warpvis.situations._placing import ABSENT, Placing
from warpvis.situations._stage_items import (
    BLOCKERS,
    ROBOT,
    ROBOT_EYES,
    ROBOT_HEIGHT,
    ROBOT_RADIUS,
    SHIRTS,
    TALL,
    TALL_BLOCKERS,
    TARGETS,
    StageOptions,
    add_robot,
    choose_items,
    make_people,
    words_of,
)
from warpvis.situations._surroundings import Surroundings
from warpvis.situations.people import Person, looking_at, sitting, standing
from warpvis.situations.rooms import RoomItem
from warpvis.situations.rooms._boxes import boxes_of
from warpvis.situations.rooms.shapes import CATEGORIES

_MIN_PLACES = 4
"""Objects with fewer places in a room are not used."""
_PLACES = 48
_STANDING_PLACES = 256
_BODY_RADIUS, _BODY_HEIGHT = 0.3, 2.0
_SEATED = 0.3
"""Share of the arrangements in which a person sits, if there is a seat."""
_AWAY = 0.3
"""Share of the arrangements in which a person looks somewhere, and not at an object of interest."""
_SEAT_HEIGHTS = (0.38, 0.52)
"""Heights of seats that people of all sizes sit on [m]."""
_MAX_TURN = math.radians(50)
_CAMERAS = 5
_TRIED_PLACES = 24
_MAX_OVERHANG = 0.2
"""Maximum part of its size by which an object projects over its support."""
# Where a person looks who turns: a point this far ahead, at this height [m].
_AHEAD, _AHEAD_HEIGHT = 2.0, 0.9


@dataclass(frozen=True, eq=False)
class Arrangements:
    """W arrangements of a stage."""

    panel: Panel
    """Who is where, and what each of them sees."""
    postures: NDArray[np.bool_]
    """Whether a person sits, shape ``(W, people)``."""
    placing: Placing
    """The bodies, in the order of `Stage.bodies`."""
    kept: NDArray[np.int64]
    """Rows of `placing` of the arrangements, shape ``(W,)``."""


class Stage:
    """A furnished place with movable people, a robot, objects of interest, and things that hide them."""

    def __init__(
        self,
        room: Surroundings,
        numbers: Numbers,
        options: StageOptions,
        device: DeviceLike = "cpu",
        threads: int | None = None,
    ) -> None:
        """Choose the objects and the people, and build the scene."""
        self.room, self.options, self._numbers = room, options, numbers
        self.scene = room.build(device, movable=False)
        # Sharp shadows: soft ones take 25 times as long.
        self.scene.lights = [replace(light, radius=0.0) for light in self.scene.lights]
        taken = Counter(item.category for item in room.items)
        self.things = choose_items(TARGETS, taken, numbers, "thing", (2, 2, 1, 1, 1))
        self.blockers = choose_items(BLOCKERS, taken, numbers, "blocker", (1, 1, 1, 1))
        self.blockers += choose_items(TALL_BLOCKERS, taken, numbers, TALL, (2, 2))
        self._places, self._supports = self._find_places()
        self.things, self.blockers = (
            [item for item in items if len(self._places[item.name]) >= _MIN_PLACES]
            for items in (self.things, self.blockers)
        )
        self.words = {item.name: f"the {item.words}" for item in (*self.things, *self.blockers)}
        self.words |= words_of(room)
        for item in (*self.things, *self.blockers):
            self.scene.add(
                item.mesh,
                name=item.name,
                label=Label.OBJECT,
                pose=item.pose,
                movable=True,
                category=item.category,
                appearance=item.appearance,
            )
        self.people = make_people(options.people, numbers)
        self.agents = {name: person.add_to(self.scene, name) for name, person in self.people.items()}
        shirts = dict(zip(self.people, SHIRTS, strict=False))
        self.agent_words = {name: f"the person in the {shirts[name]} shirt" for name in self.people}
        for name, agent in self.agents.items():
            self.words |= dict.fromkeys(agent.body, self.agent_words[name])
        if options.robot:
            add_robot(self.scene)
            self.agent_words[ROBOT] = self.words[ROBOT] = "the robot"
        targets = {item.name: [item.name] for item in self.things}
        targets |= {name: list(agent.body) for name, agent in self.agents.items()}
        targets |= {ROBOT: [ROBOT]} if options.robot else {}
        self.watch = Watch(self.scene, targets, threads)
        self._columns = {self.scene.objects[index].name: column for column, index in enumerate(self.scene.movable)}
        low, high = _SEAT_HEIGHTS
        self._seats = [seat for seat in room.seats if low <= seat.height <= high]

    @property
    def participants(self) -> tuple[str, ...]:
        """Names of the people and the robot."""
        return tuple(self.agent_words)

    def item(self, name: str) -> RoomItem:
        """Return an object of interest or a blocker."""
        return next(item for item in (*self.things, *self.blockers) if item.name == name)

    def bodies(self) -> list[str]:
        """Return the names of everything that is placed, in the order of `Arrangements.placing`."""
        things, blockers = ([item.name for item in items] for items in (self.things, self.blockers))
        return [*things, *self.people, *([ROBOT] if self.options.robot else []), *blockers]

    def standing_spots(self) -> NDArray[np.float64]:
        """Return positions where a person can stand [m], shape ``(n, 3)``."""
        return self._places[""]

    def places(self, name: str) -> NDArray[np.float64]:
        """Return poses of an object of interest or a blocker that are free of furniture, shape ``(n, 7)``."""
        return self._places[name]

    def floor_centers(self, item: RoomItem, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the centers of an item's base at poses ``(n, 7)`` [m], shape ``(n, 3)``."""
        low, high = item.shape.bounds
        middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.0])
        centers: NDArray[np.float64] = poses[:, :3] + poses_to_matrices(poses)[:, :3, :3] @ middle
        return centers

    def column(self, name: str) -> int:
        """Return the column of a movable object in poses."""
        return self._columns[name]

    def fits(self, arranged: Arrangements, world: int, name: str, pose: NDArray[np.float64]) -> bool:
        """Return whether an object has space at a pose ``(7,)``: it is on a support, and overlaps nothing."""
        item, number = self.item(name), self.bodies().index(name)
        yaw = math.degrees(2 * math.atan2(pose[5], pose[6]))
        x, y, z = pose[:3].tolist()
        boxes = boxes_of(item.shape, x, y, z, yaw)
        if not self.room.free_space.holds(boxes, _MAX_OVERHANG * min(item.size[:2])):
            return False
        center = self.floor_centers(item, pose[None])
        return bool(arranged.placing.is_free(arranged.kept[world : world + 1], center, number)[0])

    def _find_places(self) -> tuple[dict[str, NDArray[np.float64]], dict[str, list[str]]]:
        """Return rows ``x y z qx qy qz qw`` of places of each object's frame, by name, shape ``(n, 7)``.

        Also return the names of the items that these places are on, by the object's name; and under the empty name,
        positions where a body can stand, shape ``(n, 3)``.
        """
        rng = np.random.default_rng(int(self._numbers.below(1 << 31, 1)[0]))
        standing_rows = self.room.standing_places(rng, _STANDING_PLACES).reshape(-1, 3)
        places, supports = {"": standing_rows}, dict[str, list[str]]()
        for item in (*self.things, *self.blockers):
            low, high = item.shape.bounds
            if CATEGORIES[item.category].mount == "floor" and item.name.startswith(TALL):
                radius = max(0.05, 0.5 * math.hypot(item.size[0], item.size[1]))
                rows = self.room.standing_places(rng, _PLACES, radius).reshape(-1, 3)
                yaw = rng.uniform(0, 2 * math.pi, len(rows))
                rows = np.column_stack([rows, np.zeros((len(rows), 2)), np.sin(yaw / 2), np.cos(yaw / 2)])
            else:
                found = self.room.support_places(rng, item.size, _PLACES)
                supports[item.name] = [place.support for place in found]
                rows = np.array([place.pose for place in found], dtype=np.float64).reshape(-1, 7)
            middle = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, 0.0])
            if len(rows):
                rows[:, :3] -= poses_to_matrices(rows)[:, :3, :3] @ middle
            places[item.name] = rows
        return places, supports

    def arrange(self, worlds: int) -> Arrangements:
        """Return at most `worlds` random arrangements; those in which a body finds no place are left out."""
        numbers, scene = self._numbers, self.scene
        placing = Placing(worlds, numbers)
        initial = np.array([scene.objects[index].pose for index in scene.movable], dtype=np.float32)
        poses = np.repeat(initial[None], worlds, axis=0)
        centers = {item.name: self._put(item, placing, poses) for item in self.things}
        standing_rows = self._places[""]
        stood = {}
        for name in self.people:
            stood[name] = self._places_of_people(placing, standing_rows)
        eyes: dict[str, NDArray[np.float64]] = {}
        sits = np.zeros((worlds, len(self.people)), dtype=np.bool_)
        for number, (name, person) in enumerate(self.people.items()):
            place, seat = stood[name]
            sits[:, number] = seat >= 0
            eyes[name] = self._pose_person(name, person, place, seat, centers, poses)
        if self.options.robot:
            eyes[ROBOT] = self._pose_robot(placing, standing_rows, centers, poses)
        for item in self.blockers:
            self._put(item, placing, poses, between=(list(eyes.values()), list(centers.values())))
        kept = np.flatnonzero(placing.valid)
        viewers = [self._viewer(name, eyes[name][kept]) for name in self.participants]
        panel = self._watch_from_best_camera(viewers, poses[kept])
        return Arrangements(panel, sits[kept], placing, kept)

    def _put(
        self,
        item: RoomItem,
        placing: Placing,
        poses: NDArray[np.float32],
        between: tuple[list[NDArray[np.float64]], list[NDArray[np.float64]]] | None = None,
    ) -> NDArray[np.float64]:
        """Place an object in the arrangements with room for it, and return the center of its box, shape ``(W, 3)``."""
        rows = self._places[item.name]
        floor = self.floor_centers(item, rows)
        radius = 0.5 * math.hypot(item.size[0], item.size[1])
        middle_height = [0, 0, min(item.size[2] / 2, 1.0)]
        wished = None if between is None else self._hiding_places(floor + middle_height, *between)
        chosen = placing.place(floor, radius, item.size[2], wished, optional=True)
        absent = (chosen < 0)[:, None]
        poses[:, self._columns[item.name]] = np.where(absent, [*ABSENT, 0, 0, 0, 1], rows[chosen])
        return np.where(absent, ABSENT, floor[chosen] + [0, 0, item.size[2] / 2])

    def _hiding_places(
        self, places: NDArray[np.float64], eyes: list[NDArray[np.float64]], centers: list[NDArray[np.float64]]
    ) -> NDArray[np.int64]:
        """Return for each arrangement the place that is nearest to a random line of sight, shape ``(W,)``."""
        worlds, numbers = len(eyes[0]), self._numbers
        who, what = numbers.below(len(eyes), worlds), numbers.below(len(centers), worlds)
        rows = np.arange(worlds)
        start, end = np.stack(eyes, axis=1)[rows, who, :3], np.stack(centers, axis=1)[rows, what]
        along = end - start
        length = np.maximum((along * along).sum(axis=1, keepdims=True), 1e-9)
        offsets = places[None] - start[:, None]
        share = np.clip(np.einsum("wnk,wk->wn", offsets, along) / length, 0.3, 0.9)
        apart = np.linalg.norm(offsets - share[..., None] * along[:, None], axis=-1)
        return apart.argmin(axis=1)

    def _places_of_people(
        self, placing: Placing, standing_rows: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return where a person is on the floor [m], ``(W, 3)``, and the seats that they sit on, -1 for none."""
        seats = self._seats
        seat_rows = np.array([[*seat.position[:2], 0.0] for seat in seats]).reshape(-1, 3)
        rows = np.concatenate([standing_rows, seat_rows])
        worlds = len(placing.valid)
        wished = self._numbers.below(len(standing_rows), worlds)
        if len(seats):
            sits = self._numbers.unit(worlds) < _SEATED
            wished = np.where(sits, len(standing_rows) + self._numbers.below(len(seats), worlds), wished)
        chosen = placing.place(rows, _BODY_RADIUS, _BODY_HEIGHT, wished)
        seat = np.where(chosen >= len(standing_rows), chosen - len(standing_rows), -1)
        return rows[chosen], seat

    def _gaze(self, place: NDArray[np.float64], centers: dict[str, NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return a point to look at in each arrangement: mostly an object of interest, else anywhere, ``(W, 3)``."""
        numbers, worlds = self._numbers, len(place)
        what = numbers.below(len(centers), worlds)
        point = np.stack(list(centers.values()), axis=1)[np.arange(worlds), what].copy()
        angle, reach = numbers.uniform(0, 2 * math.pi, worlds), numbers.uniform(1.0, 3.0, worlds)
        away = place + np.column_stack(
            [np.cos(angle) * reach, np.sin(angle) * reach, numbers.uniform(0.4, 1.6, worlds)]
        )
        near = np.hypot(*(point - place)[:, :2].T) < 0.4  # people do not look straight down
        near |= point[:, 2] < 0  # it is absent
        elsewhere = near | (numbers.unit(worlds) < _AWAY)
        point[elsewhere] = away[elsewhere]
        return point

    def _pose_person(
        self,
        name: str,
        person: Person,
        place: NDArray[np.float64],
        seat: NDArray[np.int64],
        centers: dict[str, NDArray[np.float64]],
        poses: NDArray[np.float32],
    ) -> NDArray[np.float64]:
        """Write the poses of a person's body, and return the poses of the eyes, shape ``(W, 7)``."""
        point = self._gaze(place, centers)
        toward = np.arctan2(point[:, 1] - place[:, 1], point[:, 0] - place[:, 0])
        turn = self._numbers.uniform(-_MAX_TURN, _MAX_TURN, len(place))
        heading = np.where(seat < 0, toward - turn, 0.0)
        eyes = np.zeros((len(place), 7))
        columns = [self._columns[body] for body in self.agents[name].body]
        for sits in (False, True):
            rows = np.flatnonzero((seat >= 0) == sits)
            if not len(rows):
                continue
            base = standing()
            if sits:
                seats = [self._seats[index] for index in seat[rows]]
                heading[rows] = [one.heading for one in seats]
                base = sitting(np.array([one.height for one in seats]))
                limit = np.clip(_wrapped(toward[rows] - heading[rows]), -_MAX_TURN, _MAX_TURN)
                reach = np.hypot(*(point[rows] - place[rows])[:, :2].T)
                angle = heading[rows] + limit
                point[rows, :2] = place[rows, :2] + np.column_stack([np.cos(angle), np.sin(angle)]) * reach[:, None]
            where = np.column_stack([place[rows, :2], heading[rows]])
            posed = replace(person, pose=where, posture=looking_at(point[rows], base))
            poses[rows[:, None], columns] = posed.object_poses()
            eyes[rows] = posed.eye_poses
        return eyes

    def _pose_robot(
        self,
        placing: Placing,
        standing_rows: NDArray[np.float64],
        centers: dict[str, NDArray[np.float64]],
        poses: NDArray[np.float32],
    ) -> NDArray[np.float64]:
        """Write the poses of the robot, and return those of its camera, shape ``(W, 7)``."""
        chosen = placing.place(standing_rows, ROBOT_RADIUS, ROBOT_HEIGHT)
        worlds = len(chosen)
        place = standing_rows[chosen]
        point = self._gaze(place, centers)
        heading = np.arctan2(point[:, 1] - place[:, 1], point[:, 0] - place[:, 0])
        zeros = np.zeros((worlds, 2))
        poses[:, self._columns[ROBOT]] = np.column_stack([place, zeros, np.sin(heading / 2), np.cos(heading / 2)])
        start = place + [0, 0, ROBOT_EYES]
        down = np.clip((point - start)[:, 2], -0.7, 0.3)
        return look_along(start, np.column_stack([np.cos(heading), np.sin(heading), down]), 2)

    def turn_person(
        self, arranged: Arrangements, worlds: NDArray[np.integer], name: str, headings: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Let a person stand at the same place with other headings [rad], looking straight ahead and slightly down.

        Returns:
            Poses of the eyes, shape ``(n, 7)``, and of all movable objects, shape ``(n, M, 7)``.
        """
        number = self.bodies().index(name)
        place = np.array([arranged.placing.center(world, number) for world in arranged.kept[worlds]])
        ahead = np.column_stack([np.cos(headings), np.sin(headings)]) * _AHEAD
        point = np.column_stack([place[:, :2] + ahead, np.full(len(place), _AHEAD_HEIGHT)])
        where = np.column_stack([place[:, :2], headings])
        posed = replace(self.people[name], pose=where, posture=looking_at(point, standing()))
        poses = arranged.panel.object_poses[worlds].copy()
        poses[:, [self._columns[body] for body in self.agents[name].body]] = posed.object_poses()
        return posed.eye_poses, poses

    def other_places(
        self, arranged: Arrangements, world: int, name: str, numbers: Numbers
    ) -> tuple[NDArray[np.float32], str] | None:
        """Return a free place of an object on another support than now: its pose and the support; None if none."""
        number = self.bodies().index(name)
        now = self._support_of(arranged, world, name)
        rows, item = self._places[name], self.item(name)
        for index in numbers.order(len(rows))[:_TRIED_PLACES]:
            support = self._supports[name][index]
            if support in (now, "") or support not in self.words:
                continue
            center = self.floor_centers(item, rows[index : index + 1])
            if arranged.placing.is_free(arranged.kept[world : world + 1], center, number)[0]:
                return rows[index].astype(np.float32), support
        return None

    def _support_of(self, arranged: Arrangements, world: int, name: str) -> str:
        """Return the name of the item that an object of interest stands on; empty if it is not known."""
        pose = arranged.panel.object_poses[world, self._columns[name]]
        rows = self._places[name]
        if not len(rows):
            return ""
        return self._supports[name][int(np.abs(rows - pose).sum(axis=1).argmin())]

    def support(self, arranged: Arrangements, world: int, name: str) -> str:
        """Return words for the item that an object of interest stands on; empty if it has none."""
        return self.words.get(self._support_of(arranged, world, name), "")

    def _viewer(self, name: str, eyes: NDArray[np.float64]) -> Viewer:
        words = self.agent_words[name]
        if name == ROBOT:
            return Viewer(name, "robot", self.options.robot_view, eyes, words, (ROBOT,))
        return Viewer(name, "person", self.options.person_view, eyes, words, self.agents[name].body)

    def _watch_from_best_camera(self, viewers: Sequence[Viewer], poses: NDArray[np.float32]) -> Panel:
        """Observe with several cameras of the pictures, and choose in each arrangement the one that sees the most."""
        numbers, worlds = self._numbers, len(poses)
        rows = self._places[""]
        eyes = np.zeros((_CAMERAS, 7))
        for number in range(_CAMERAS):
            spot = rows[int(numbers.below(len(rows), 1)[0])] + [0, 0, numbers.uniform(1.5, 2.1, 1)[0]]
            goal = numbers.uniform(-0.3, 0.3, 3) + [0, 0, 0.8]
            eyes[number] = look_along(spot[None], (goal - spot)[None], 2)[0]
        cameras = [
            Viewer("camera", "camera", self.options.picture, np.repeat(row[None], worlds, axis=0)) for row in eyes
        ]
        found = self.watch.observe([*viewers, *cameras], poses)
        people, count = len(viewers), len(self.things)
        sizes = np.linalg.norm(np.array([item.size for item in self.things]).reshape(-1, 3), axis=1)
        shares = np.minimum(found.fraction[:, people:], 0.6)
        distances = found.distance[:, people:, :count]
        shares[..., :count][pixels_of(self.options.picture, sizes, distances) < MIN_PIXELS] = 0
        score = shares.sum(axis=2)
        best = people + score.argmax(axis=1)
        columns = np.column_stack([np.tile(np.arange(people), (worlds, 1)), best])
        taken = {name: getattr(found, name)[np.arange(worlds)[:, None], columns] for name in found.__dataclass_fields__}
        camera = Viewer("camera", "camera", self.options.picture, eyes[best - people])
        categories = {item.name: item.category for item in self.things}
        names = tuple(item.name for item in self.things)
        return Panel(self.watch, viewers, camera, names, self.words, categories, sizes, poses, Observations(**taken))


def _wrapped(angle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return angles from -pi to pi."""
    return (angle + math.pi) % (2 * math.pi) - math.pi
