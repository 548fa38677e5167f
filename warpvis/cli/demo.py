# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis demo``: the four experiments of the paper, and what the person sees in each."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import warp as wp

from warpvis.cli._output import make_folder, write_json
from warpvis.core.types import DeviceLike
from warpvis.maps import FloorMap, classify, floor_map, plan_visibility
from warpvis.planning import propose_view
from warpvis.rendering import Output, Renderer, Views
from warpvis.scene import Scene
from warpvis.scenes import EXPERIMENTS, Experiment
from warpvis.scenes.experiments import ROBOT_AT, ROBOT_RADIUS
from warpvis.visibility import Perspective, State, perspective
from warpvis.viz import save_overview, save_perspective

_TARGETS = ("ball", "person")
_EYE, _TARGET = (-4.3, -3.7, 3.4), (-0.3, -0.4, 0.1)
_VIEWS_TIMED = 32
_OUTPUTS: tuple[Output, ...] = ("depth", "points", "labels", "segmentation", "color")


@dataclass(frozen=True)
class Sighting:
    """Visibility of one object in one experiment."""

    experiment: int
    object: str
    visible: bool
    """Whether the depth image shows it."""
    pixels: int
    """Number of pixels that show it, from the exact object index."""
    pixels_by_sphere: int
    """Number of pixels inside of its spheres, by the paper's test on the depth image alone."""
    visible_on_plan: bool
    """Whether a 2D line of sight on the floor plan reaches it."""

    @property
    def plan_differs(self) -> bool:
        """Whether the floor plan gives the wrong answer."""
        return self.visible != self.visible_on_plan


@dataclass(frozen=True)
class SharedSighting:
    """Visibility of one object to the robot and the person in one experiment."""

    experiment: int
    object: str
    robot: bool
    """Whether the robot sees it."""
    human: bool
    """Whether the person sees it."""
    human_pixels: int
    """Number of pixels that show it in all of the person's images."""
    human_fraction: float
    """Fraction of its silhouette that the person sees."""
    state: str
    """Both, robot only, human only, or neither."""


@dataclass(frozen=True)
class ExperimentResult:
    """Images and results of one experiment."""

    experiment: Experiment
    scene: Scene
    views: Views
    floor_map: FloorMap
    sightings: tuple[Sighting, ...]
    seen: Perspective
    """What the robot and the person see."""
    shared: SharedSighting
    """Visibility of the ball to both."""


def run_experiment(number: int, *, device: DeviceLike = "cpu") -> ExperimentResult:
    """Render, classify and map one experiment, `number` 1 to 4."""
    experiment = EXPERIMENTS[number - 1]
    scene = experiment.build(device)
    poses = experiment.poses()
    views = Renderer(scene, experiment.camera, outputs=_OUTPUTS).render(poses)
    sphere = wp.empty(views.depth.shape, dtype=wp.int32, device=scene.device)
    classify(views.depth, experiment.camera, poses, spheres=experiment.spheres, spheres_out=sphere)
    seen_floor = floor_map(views.points, views.labels, bounds=scene.bounds, robots=[(*ROBOT_AT, ROBOT_RADIUS)])

    pixels = np.bincount(views.segmentation.numpy().ravel() + 1, minlength=len(scene) + 1)[1:]
    in_sphere = np.bincount(sphere.numpy().ravel() + 1, minlength=len(experiment.spheres) + 1)[1:]
    labels = [item.label for item in experiment.spheres]
    on_plan = plan_visibility(scene, experiment.camera, poses, exclude=("robot",)).visible[0]
    sightings = []
    for name in _TARGETS:
        index = scene.index(name)
        by_sphere = sum(in_sphere[i] for i, label in enumerate(labels) if label == scene[name].label)
        count = int(pixels[index])
        sightings.append(Sighting(number, name, count > 0, count, int(by_sphere), bool(on_plan[index])))
    seen = perspective(scene, experiment.agents())
    shared = _shared_sighting(number, seen)
    return ExperimentResult(experiment, scene, views, seen_floor, tuple(sightings), seen, shared)


def _shared_sighting(number: int, seen: Perspective) -> SharedSighting:
    (robot, human), ball = range(2), seen.objects.index("ball")
    words = {State.BOTH: "both", State.FIRST: "robot only", State.SECOND: "human only", State.NEITHER: "neither"}
    return SharedSighting(
        experiment=number,
        object="ball",
        robot=bool(seen.visible[robot, 0, ball]),
        human=bool(seen.visible[human, 0, ball]),
        human_pixels=int(seen.visible_pixels[human, 0, ball]),
        human_fraction=float(seen.fraction[human, 0, ball]),
        state=words[State(seen.states("robot", "human")[0, ball])],
    )


def run_demo(out: Path, *, device: DeviceLike = "cpu") -> dict[str, object]:
    """Run the four experiments, write two pictures of each and ``summary.json``, and print two tables.

    If viser is installed, also write a page of each, which a browser opens from disk. Return the summary's content.
    """
    make_folder(out)
    results = [run_experiment(number, device=device) for number in range(1, len(EXPERIMENTS) + 1)]
    for result in results:
        experiment = result.experiment
        save_overview(
            result.scene,
            experiment.camera,
            experiment.poses()[0],
            result.views,
            result.floor_map,
            out / f"{experiment.name}.png",
            title=f"Experiment {experiment.name[-1]}. {experiment.title}: {experiment.shows}",
            eye=_EYE,
            target=_TARGET,
        )
        _save_perspective(result, out)
    pages = _save_pages(results, out)
    sightings = [sighting for result in results for sighting in result.sightings]
    shared = [result.shared for result in results]
    device, speed = results[0].scene.device, measure_fps(results[0])
    summary = {
        "device": str(device),
        "frames_per_second": round(speed, 1),
        "sightings": [asdict(sighting) | {"plan_differs": sighting.plan_differs} for sighting in sightings],
        "perspectives": [asdict(item) for item in shared],
    }
    write_json(out / "summary.json", summary)
    print(f"{format_table(sightings)}\n\n{format_states(shared)}")
    print(f"\n{speed:.0f} frames per second (320x240, depth, points, labels, segmentation) on {device}")
    print(f"pictures{' with pages' if pages else ''} and summary.json: {out}")
    return summary


def format_table(sightings: list[Sighting]) -> str:
    """Format the results as text, one line each; a star marks where the floor plan is wrong."""
    lines = ["experiment  object  visible  pixels  2D answer"]
    for item in sightings:
        plan = ("visible" if item.visible_on_plan else "hidden") + ("  *" if item.plan_differs else "")
        visible = "yes" if item.visible else "no"
        lines.append(f"{item.experiment:<12}{item.object:<8}{visible:<9}{item.pixels:>6}  {plan}")
    return "\n".join([*lines, "* the 2D line of sight on the floor plan differs from the depth image"])


def format_states(shared: list[SharedSighting]) -> str:
    """Format the visibility of the ball as text, one line per experiment."""
    lines = ["experiment  object  robot  human  seen by"]
    for item in shared:
        robot, human = ("yes" if sees else "no" for sees in (item.robot, item.human))
        lines.append(f"{item.experiment:<12}{item.object:<8}{robot:<7}{human:<7}{item.state}")
    return "\n".join(lines)


def _save_perspective(result: ExperimentResult, out: Path) -> None:
    experiment, agents = result.experiment, result.experiment.agents()
    proposal = propose_view(result.scene, agents[0], result.seen.candidates("human", "robot"))
    save_perspective(
        result.scene,
        agents,
        result.seen,
        out / f"{experiment.name}_perspective.png",
        title=f"Experiment {experiment.name[-1]}. The person looks {experiment.gaze}",
        proposed=None if proposal is None else proposal.pose,
    )


def _save_pages(results: Sequence[ExperimentResult], out: Path) -> bool:
    """Write a page of each experiment that opens from disk, if viser is installed."""
    if importlib.util.find_spec("viser") is None:
        return False
    from warpvis.viewer import Viewer, ViewerState

    for result in results:
        experiment = result.experiment
        with Viewer(ViewerState(result.scene, experiment.agents())) as viewer:
            viewer.save_html(
                out / f"{experiment.name}.html", title=f"Experiment {experiment.name[-1]}: {experiment.title}"
            )
    return True


def measure_fps(result: ExperimentResult) -> float:
    """Return frames per second with all default outputs: the median of five runs after a warm-up."""
    renderer = Renderer(result.scene, result.experiment.camera)
    poses = result.experiment.poses(_VIEWS_TIMED)
    views = renderer.render(poses)
    seconds = []
    for _ in range(5):
        wp.synchronize_device(result.scene.device)
        start = time.perf_counter()
        renderer.render(poses, out=views)
        wp.synchronize_device(result.scene.device)
        seconds.append(time.perf_counter() - start)
    return _VIEWS_TIMED / float(np.median(seconds))
