# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare methods that decide whether a participant of a generated situation sees an object.

Rooms of three amounts of clutter are generated, with balanced questions of the kind ``sees``. Each method answers all
of them, with exact poses of the eyes and with noise; a small network is trained on the pictures of other rooms.
Prints tables of accuracies with 95 % binomial intervals, and draws a plot.

  python bench/situation_methods.py --count 500 --plot methods.png        about 3 minutes on two idle cores
"""

from __future__ import annotations

import argparse
import math
import time
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import partial
from multiprocessing import get_context

import numpy as np
import warp as wp
from numpy.typing import NDArray

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.planning import look_along
from warpvis.situations import Participant, Question, Situation, SituationGenerator, SituationOptions, StageOptions

CLUTTER = {"low": (0.0, 0.2), "middle": (0.4, 0.6), "high": (0.8, 1.0)}
POSE_NOISE = ((0, 0.0), (1, 0.02), (2, 0.05), (5, 0.1))
"""Standard deviations about and along each axis of the eyes [degrees, m]."""
LIMIT = 0.1
CELL = 0.05
TALL = (1.1, 1.3)
"""Heights between which obstacles are in the map of tall obstacles [m]."""
LATTICE = np.stack(np.meshgrid(*[[-0.4, 0.0, 0.4]] * 3), axis=-1).reshape(-1, 3)
"""Points of an object, as multiples of the sides of its box."""
MAP_VIEW = wv.Camera.from_fov(144, 108, hfov=math.radians(120), near=0.05, far=7.0)
VIEWS = 3
"""Views with which a map is made at each place."""
PICTURE = wv.Camera.from_fov(192, 144, hfov=math.radians(80), near=0.05, far=math.inf)
PATCH = 4
"""Pixels of the picture along the side of a pixel of the network's input."""
EXACT = "exact fractions"
METHODS = (
    "paper's rule", "paper's rule, Kinect", "floor plan, all obstacles", "floor plan, tall obstacles",
    "voxels, center", "voxels, 27 points", "center point", EXACT,
)  # fmt: skip
NETWORK = "network on pictures"
GROUPS = ("visible", "out of view or range", "hidden")
Answers = dict[str, NDArray[np.bool_]]


@dataclass(frozen=True, eq=False)
class Case:
    """A question with its answer, and those of the methods."""

    clutter: str
    room: str
    sees: bool
    group: str
    """One of `GROUPS`."""
    is_twin: bool
    picture: NDArray[np.uint8]
    """Color, mask of the agent, mask of the object; shape ``(36, 48, 5)``."""
    answers: dict[tuple[str, int], bool] = field(default_factory=dict)
    """By method and index of the noise."""


@dataclass(frozen=True, eq=False)
class Batch:
    """W questions of a room about participants with the same camera."""

    scene: wv.Scene
    camera: wv.Camera
    things: list[str]
    poses: NDArray[np.float32]
    """Poses of all movable objects, shape ``(W, M, 7)``."""
    eyes: NDArray[np.float64]
    """True camera to world, shape ``(W, 4, 4)``."""
    hidden: NDArray[np.bool_]
    """Objects of the participants' own bodies, shape ``(W, objects)``."""
    boxes: NDArray[np.float64]
    """Box to world of the objects that are asked about, without scale, shape ``(W, 4, 4)``."""
    sizes: NDArray[np.float64]
    """Sides of these boxes [m], shape ``(W, 3)``."""
    around: NDArray[np.float64]
    """Poses of cameras that look around from the eyes and from the picture's camera, shape ``(W, V, 4, 4)``."""

    @property
    def centers(self) -> NDArray[np.float64]:
        """Centers of the boxes [m], shape ``(W, 3)``."""
        return self.boxes[:, :3, 3]


def paper_rule(batch: Batch, believed: NDArray[np.float64], depth: wp.array) -> NDArray[np.bool_]:
    """Return whether a back-projected pixel is less than half of the object's longest side away from its center."""
    spheres = np.column_stack([batch.centers, batch.sizes.max(axis=1)])
    images, found = depth.numpy(), np.zeros(len(spheres), dtype=np.bool_)
    for row, sphere in enumerate(spheres):
        # A `below_label` turns off the check of poses, which refuses some of the noisy ones.
        one, pose = images[row : row + 1], believed[row : row + 1]
        labels = wv.classify(one, batch.camera, pose, spheres=sphere[None], below_label=wv.Label.OBSTACLE)
        found[row] = (labels.numpy() == wv.Label.OBJECT).any()
    return found


def in_plan_view(batch: Batch, believed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether the objects are in the horizontal field of view, and in range."""
    offset = (batch.centers - believed[:, :3, 3])[:, :2]
    gaze = believed[:, :2, 2]
    cross, dot = gaze[:, 0] * offset[:, 1] - gaze[:, 1] * offset[:, 0], (gaze * offset).sum(axis=1)
    half = math.atan(batch.camera.width / 2 / batch.camera.fx)
    return (np.abs(np.arctan2(cross, dot)) <= half) & (np.linalg.norm(offset, axis=1) <= batch.camera.far)


def is_plan_clear(
    room: wv.OccupancyMap, heights: tuple[float, float], eye: NDArray[np.float64], center: NDArray[np.float64], r: float
) -> bool:
    """Return whether no cell with an obstacle is on a line in the plan, up to a distance `r` from its end [m]."""
    start, along = eye[:2], (center - eye)[:2]
    ends = np.stack([np.minimum(start, center[:2]) - CELL, np.maximum(start, center[:2]) + CELL])
    grid = room.occupancy_grid(ends, min_height=heights[0], max_height=heights[1])
    length = max(float(np.linalg.norm(along)), 1e-9)
    steps = np.arange(0.1, max(0.1, length - r), CELL / 4) / length
    columns, rows = ((start + steps[:, None] * along - grid.origin) / grid.cell_size).astype(int).T
    return not (grid.cells[rows, columns] == 100).any()


def by_maps(batch: Batch, noises: Sequence[NDArray[np.float64]]) -> list[Answers]:
    """Return the answers of the methods with maps for each noise; a map of each situation is built once."""
    count = len(batch.things)
    names = METHODS[2:6]
    results = [{name: np.zeros(count, dtype=np.bool_) for name in names} for _ in noises]
    seen = [in_plan_view(batch, believed) for believed in noises]
    for row in range(count):
        views, size = batch.around[row], batch.sizes[row]
        poses = np.repeat(batch.poses[row : row + 1], len(views), axis=0)
        hidden = np.repeat(batch.hidden[row : row + 1], len(views), axis=0)
        depth = wv.render(batch.scene, MAP_VIEW, views, outputs=("depth",), object_poses=poses, exclude=hidden).depth
        room = wv.OccupancyMap(CELL, device=batch.scene.device)
        room.integrate(depth, MAP_VIEW, views, max_range=MAP_VIEW.far)
        center, reach = batch.centers[row], float(size.max())
        points = (LATTICE * size) @ batch.boxes[row, :3, :3].T + center
        for index, (answers, believed) in enumerate(zip(results, noises, strict=True)):
            eye = believed[row]
            for name, heights in zip(names[:2], ((0.1, 1.8), TALL), strict=True):
                clear = seen[index][row] and is_plan_clear(room, heights, eye[:3, 3], center, reach / 2 + 2 * CELL)
                answers[name][row] = clear
            for name, targets, tolerance in ((names[2], center[None], reach / 2), (names[3], points, reach)):
                status = wv.point_visibility(room, batch.camera, eye[None], targets, tolerance=tolerance + 1.5 * CELL)
                answers[name][row] = (status.numpy() == wv.Visibility.VISIBLE).mean() >= LIMIT
    return results


def by_center(batch: Batch, believed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether the first surface on the ray to the center is at most half of the longest side before it."""
    found = np.zeros(len(batch.things), dtype=np.bool_)
    for name in set(batch.things):
        rows = np.flatnonzero([thing == name for thing in batch.things])
        radius = float(batch.sizes[rows].max() / 2)
        status = wv.point_visibility(
            batch.scene, batch.camera, believed[rows], batch.centers[rows], tolerance=radius,
            object_poses=batch.poses[rows], world_index=np.arange(len(rows)), exclude=batch.hidden[rows],
        )  # fmt: skip
        found[rows] = status.numpy().diagonal() == wv.Visibility.VISIBLE
    return found


def by_fractions(batch: Batch, believed: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return whether the visible fraction of the silhouette is at least the limit."""
    names = sorted(set(batch.things))
    found = wv.visible_fractions(
        batch.scene, batch.camera, believed, objects=names, object_poses=batch.poses,
        world_index=np.arange(len(believed)), exclude=batch.hidden,
    )  # fmt: skip
    return found.fraction.numpy()[np.arange(len(believed)), [names.index(thing) for thing in batch.things]] >= LIMIT


def answer(batch: Batch, rng: np.random.Generator) -> list[Answers]:
    """Return the answers of all methods without a network, for each noise of `POSE_NOISE`."""
    draws = rng.normal(size=(2, len(batch.things), 3))
    spreads = [(math.radians(degrees), meters) for degrees, meters in POSE_NOISE]
    noises = [disturb(batch.eyes, angle * draws[0], meters * draws[1]) for angle, meters in spreads]
    sensors = {METHODS[0]: None, METHODS[1]: wv.sensors.kinect_v1(batch.camera.width, batch.camera.height)}
    results = by_maps(batch, noises)
    for name, sensor in sensors.items():
        depth = wv.render(
            batch.scene, batch.camera, batch.eyes, outputs=("depth",), object_poses=batch.poses,
            world_index=np.arange(len(batch.eyes)), exclude=batch.hidden, sensor=sensor, frame=sensor and 0,
        ).depth  # fmt: skip
        for found, believed in zip(results, noises, strict=True):
            found[name] = paper_rule(batch, believed, depth)
    for found, believed in zip(results, noises, strict=True):
        found[METHODS[6]] = by_center(batch, believed)
        found[EXACT] = by_fractions(batch, believed)
    return results


def disturb(
    eyes: NDArray[np.float64], rotation: NDArray[np.float64], offset: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Rotate poses ``(W, 4, 4)`` by rotation vectors [rad] in their own frames, and move them by offsets [m]."""
    angle = np.linalg.norm(rotation, axis=1, keepdims=True)
    half = np.column_stack([np.sinc(angle / (2 * math.pi)) / 2 * rotation, np.cos(angle / 2)])
    turned = eyes @ poses_to_matrices(np.column_stack([np.zeros((len(eyes), 3)), half]))
    turned[:, :3, 3] += offset
    return turned


def look_around(place: Sequence[float]) -> NDArray[np.float64]:
    """Return poses of cameras at a place that look around and slightly down, shape ``(VIEWS, 4, 4)``."""
    angles = np.arange(VIEWS) * 2 * math.pi / VIEWS
    forward = np.column_stack([np.cos(angles), np.sin(angles), np.full(VIEWS, -0.25)])
    return poses_to_matrices(look_along(np.repeat(np.array(place)[None, :3], VIEWS, axis=0), forward, 2))


def bodies(scene: wv.Scene, name: str) -> NDArray[np.bool_]:
    """Return which objects are those of a participant."""
    return np.array([item.name == name or item.name.startswith(f"{name}/") for item in scene])


def make_batch(
    options: SituationOptions, scene: wv.Scene, asked: Sequence[tuple[Situation, Participant, str]]
) -> Batch:
    """Collect questions about participants of one kind."""
    names = [scene.objects[index].name for index in scene.movable]
    around, boxes, sizes = [], [], []
    for situation, who, thing in asked:
        now = situation.moments[0]
        around.append(np.concatenate([look_around(place) for place in (who.eyes, situation.camera["pose"])]))
        corners = scene[thing].mesh_vertices.astype(np.float64)
        box = poses_to_matrices(np.array([now.poses[thing]]))[0]
        box[:3, 3] += box[:3, :3] @ (corners.min(axis=0) + corners.max(axis=0)) / 2
        boxes.append(box)
        sizes.append(np.ptp(corners, axis=0))
    return Batch(
        scene,
        options.stage.person_view if asked[0][1].kind == "person" else options.stage.robot_view,
        [thing for *_, thing in asked],
        np.array([[one.moments[0].poses[name] for name in names] for one, *_ in asked], dtype=np.float32),
        poses_to_matrices(np.array([who.eyes for _, who, _ in asked])),
        np.array([bodies(scene, who.name) for _, who, _ in asked]),
        np.array(boxes), np.array(sizes), np.array(around),
    )  # fmt: skip


def picture_of(situation: Situation, scene: wv.Scene, agent: str, thing: str) -> NDArray[np.uint8]:
    """Return the input of the network, shape ``(36, 48, 5)``."""
    found = situation.images["camera/segmentation"]
    masks = [np.isin(found, np.flatnonzero(own)) * 255.0 for own in (bodies(scene, agent), bodies(scene, thing))]
    layers = np.concatenate([situation.images["camera/color"], np.stack(masks, axis=-1)], axis=-1)
    height, width, depth = layers.shape
    return layers.reshape(height // PATCH, PATCH, width // PATCH, PATCH, depth).mean(axis=(1, 3)).astype(np.uint8)


def run_room(count: int, seed: int, with_answers: bool, job: tuple[str, int]) -> list[Case]:
    """Generate at most `count` questions of a room, and let the methods answer them."""
    clutter, shard = job
    options = SituationOptions(
        seed=seed, per_shard=min(count, 100), questions=("sees",), outputs=("color", "segmentation"),
        stage=StageOptions(picture=PICTURE), clutter=CLUTTER[clutter],
    )  # fmt: skip
    generator = SituationGenerator(options)
    groups: dict[tuple[int, bool], list[tuple[Situation, Participant, Question]]] = defaultdict(list)
    taken = 0
    for one in generator.shard(shard):
        for question in one.questions[: max(0, count - taken)]:
            who = next(each for each in one.moments[0].participants if each.name == question.about[0])
            groups[one.room["attempt"], who.kind == "person"].append((one, who, question))
            taken += 1
    cases, rng = [], np.random.default_rng((seed, shard))
    for asked in groups.values():
        scene = generator.scene(asked[0][0])
        rows = [(one, who, question.about[1]) for one, who, question in asked]
        results = answer(make_batch(options, scene, rows), rng) if with_answers else []
        for row, (one, who, question) in enumerate(asked):
            thing, sees = question.about[1], question.answer == "yes"
            state = next(s.state for s in one.sights if (s.agent, s.thing) == (who.name, thing))
            group = GROUPS[0] if sees else GROUPS[1] if state in ("out_of_view", "too_far", "too_near") else GROUPS[2]
            found = {(name, noise): bool(a[name][row]) for noise, a in enumerate(results) for name in METHODS}
            picture, room = picture_of(one, scene, who.name, thing), f"{clutter} {shard}/{one.room['attempt']}"
            cases.append(Case(clutter, room, sees, group, one.twin is not None, picture, found))
    return cases


def train_network(cases: Sequence[Case], seed: int) -> Callable[[Sequence[Case]], NDArray[np.bool_]]:
    """Train a perceptron with one hidden layer on pictures and their mirror images; return what predicts answers."""
    from sklearn.neural_network import MLPClassifier

    def inputs(chosen: Sequence[Case], step: int = 1) -> NDArray[np.float32]:
        return np.stack([case.picture[:, ::step].ravel() for case in chosen]).astype(np.float32) / 255 - 0.5

    network = MLPClassifier((64,), alpha=1e-2, max_iter=60, random_state=seed)
    truth = [case.sees for case in cases]
    network.fit(np.concatenate([inputs(cases), inputs(cases, -1)]), [*truth, *truth])
    return lambda chosen: network.predict(inputs(chosen)).astype(np.bool_)


def interval(right: int, count: int) -> tuple[float, float]:
    """Return Wilson's 95 % interval of a binomial share."""
    z, share = 1.96, right / count
    middle, spread = share + z * z / (2 * count), z * math.sqrt(share * (1 - share) / count + (z / (2 * count)) ** 2)
    return (middle - spread) / (1 + z * z / count), (middle + spread) / (1 + z * z / count)


def accuracy(cases: Iterable[Case], method: str, noise: int = 0) -> tuple[float, float, float, int]:
    """Return the share of correct answers, its interval, and the number of questions."""
    right = [case.answers[method, noise] == case.sees for case in cases]
    return (sum(right) / len(right), *interval(sum(right), len(right)), len(right)) if right else (math.nan,) * 3 + (0,)


def columns_of(cases: Sequence[Case]) -> dict[str, tuple[list[Case], int]]:
    """Return the questions and the noise of each column of the table."""
    columns = {f"{degrees}°, {100 * meters:.0f} cm": (list(cases), i) for i, (degrees, meters) in enumerate(POSE_NOISE)}
    columns |= {f"clutter {name}": ([c for c in cases if c.clutter == name], 0) for name in CLUTTER}
    columns |= {name: ([c for c in cases if c.group == name], 0) for name in GROUPS}
    twins = [c for c in cases if c.is_twin]
    return columns | ({"twins": (twins, 0)} if twins else {})


def print_table(cases: Sequence[Case], methods: Sequence[str]) -> None:
    """Print accuracies [%] with half the width of their intervals, in Markdown."""
    columns = columns_of(cases)
    print("| Method |", " | ".join(f"{name} ({len(chosen)})" for name, (chosen, _) in columns.items()), "|")
    print("|---|" + "---:|" * len(columns))
    for method in methods:
        cells = []
        for chosen, noise in columns.values():
            used = 0 if method == NETWORK else noise
            share, low, high, _ = accuracy(chosen, method, used)
            cells.append("" if used != noise or math.isnan(share) else f"{100 * share:.0f} ± {50 * (high - low):.0f}")
        print(f"| {method} |", " | ".join(cells), "|")


def draw(cases: Sequence[Case], methods: Sequence[str], path: str) -> None:
    """Draw accuracies by the noise of the eyes' pose, and by group."""
    from matplotlib import colormaps
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
    columns = list(columns_of(cases).items())
    groups = columns[len(POSE_NOISE) + len(CLUTTER) :]
    for number, method in enumerate(methods):
        color = colormaps["tab10"](number)
        shown = [0] if method == NETWORK else range(len(POSE_NOISE))
        found = np.array([accuracy(cases, method, noise)[:3] for noise in shown])
        place = np.array(shown) + (number - len(methods) / 2) * 0.03
        error = np.abs(found[:, 1:] - found[:, :1]).T
        left.errorbar(place, found[:, 0], error, color=color, marker="o", markersize=3, linewidth=1.2, label=method)
        found = np.array([accuracy(chosen, method)[:3] for _, (chosen, _) in groups])
        place = np.arange(len(groups)) + (number - len(methods) / 2 + 0.5) * 0.09
        error = np.abs(found[:, 1:] - found[:, :1]).T
        right.bar(place, found[:, 0], 0.085, yerr=error, color=color, error_kw={"linewidth": 0.8})
    left.set_xticks(range(len(POSE_NOISE)), [name for name, _ in columns[: len(POSE_NOISE)]])
    left.set(xlabel="Noise of the pose of the eyes", ylabel="Share of correct answers", ylim=(0.4, 1.02))
    right.set_xticks(range(len(groups)), [f"{name}\n({len(chosen)})" for name, (chosen, _) in groups])
    right.set(ylim=(0, 1.02), title="Exact poses, by what is asked")
    for axes in (left, right):
        axes.grid(axis="y", alpha=0.3)
        axes.axhline(0.5, color="gray", linewidth=0.8, linestyle="--")
    figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=5, fontsize=8)
    figure.savefig(path, dpi=80)


def main() -> None:
    """Generate, answer, train, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=500, help="questions to answer")
    parser.add_argument("--rooms", type=int, default=2, help="rooms of each amount of clutter, to test and to train")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--plot", help="picture to write")
    options = parser.parse_args()
    start, cases = time.perf_counter(), list[Case]()
    jobs = [(clutter, shard) for shard in range(options.rooms) for clutter in CLUTTER]
    training: list[Case] = []
    with get_context("spawn").Pool(options.processes, initializer=quiet) as pool:
        per_room = -(-options.count // len(jobs))
        for found in pool.imap(partial(run_room, per_room, options.seed, True), jobs):
            cases += found
            print(f"[{time.perf_counter() - start:.0f} s] {len(cases)} questions", flush=True)
        cases = cases[: options.count]
        for found in pool.imap(partial(run_room, 120, options.seed + 1, False), jobs):
            training += found
            print(f"[{time.perf_counter() - start:.0f} s] {len(training)} questions to train with", flush=True)
    predicted = train_network(training, options.seed)(cases)
    for case, sees in zip(cases, predicted.tolist(), strict=True):
        case.answers[NETWORK, 0] = sees
    rooms = len({case.room for case in cases})
    print(f"{len(cases)} questions in {rooms} rooms, {sum(case.sees for case in cases)} with the answer yes; "
          f"trained with {len(training)} questions; {time.perf_counter() - start:.0f} s")  # fmt: skip
    print_table(cases, (*METHODS, NETWORK))
    if options.plot:
        draw(cases, (*METHODS, NETWORK), options.plot)


def quiet() -> None:
    """Suppress messages in a process, such as that the field of view is not that of a Kinect."""
    wp.config.log_level = wp.LOG_WARNING
    warnings.filterwarnings("ignore", category=UserWarning)


if __name__ == "__main__":
    main()
