# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering of poses to a dataset: `render_batch`."""

from __future__ import annotations

import importlib.util
import os
import sys
import time
import warnings
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, Unpack, get_args

import numpy as np

from warpvis.batch._dataset import Dataset, Record
from warpvis.batch._emptiness import describe_empty
from warpvis.batch._frame_renderer import (
    VISIBILITY,
    SceneSource,
    check_batch_outputs,
    choose_excluded,
    make_scene,
)
from warpvis.batch._job import Options, Plan
from warpvis.batch._manifest import make_manifest, same_meshes
from warpvis.batch._shard_job import Run
from warpvis.batch._verify import verify
from warpvis.batch._writer import Job
from warpvis.batch.engines._local import parse_devices, run_local
from warpvis.batch.formats._base import Format, find_format
from warpvis.cameras import ImageCamera, require_image_camera
from warpvis.cameras.frames import Frames
from warpvis.core.checks import check_choice, check_flag, check_mapping, check_whole, pluralize
from warpvis.core.labels import LabelNames
from warpvis.core.threads import check_threads
from warpvis.core.types import DeviceLike, PoseLike
from warpvis.errors import ArrayError, FileFormatError, PoseError
from warpvis.rendering import (
    CasterName,
    ColorOptions,
    DepthSensor,
    check_colors,
    check_word,
    pixel_bytes,
    require_sensor,
)
from warpvis.scene.worlds import pose_columns
from warpvis.visibility import choose_objects

if TYPE_CHECKING:
    from tqdm import tqdm

    from warpvis.scene import Scene

Engine = Literal["local", "ray"]

# Shards of 64 MiB are written as fast as larger ones, and three of them need little memory.
_SHARD_BYTES = 1 << 26
_MAX_SHARD_FRAMES = 1000

# A job with at least this number of missing shards already warns after the first one if it sees nothing.
_LONG_JOB = 4


@dataclass(frozen=True)
class BatchSummary:
    """The result of a call of `render_batch`."""

    out: str
    """The dataset."""
    frames: int
    """Number of frames of the dataset."""
    shards: int
    """Number of shards of the dataset."""
    bytes: int
    """Total size of the shards' files in bytes."""
    rendered_frames: int
    """Number of frames rendered by this call; less than `frames` if it resumed a dataset."""
    seconds: float
    """Time spent on rendering and writing them [s]."""
    warnings: dict[str, int] = field(default_factory=dict)
    """Descriptions of data that was lost or omitted, with their counts over all shards."""
    empty_frames: int = 0
    """Number of frames of the dataset that see nothing within the camera's range."""

    @property
    def frames_per_second(self) -> float:
        """Frames rendered and written per second by this call; 0 if there was nothing left to do."""
        return self.rendered_frames / self.seconds if self.rendered_frames else 0.0


def render_batch(
    scene: SceneSource,
    camera: ImageCamera | None,
    frames: Frames | PoseLike,
    out: str | os.PathLike[str],
    *,
    format: str = "npz",
    outputs: Sequence[str] | None = None,
    objects: Sequence[str | int] | None = None,
    exclude: Sequence[str | int] | None = None,
    shard_frames: int | None = None,
    options: Options | None = None,
    sensor: DepthSensor | None = None,
    seed: int = 0,
    device: DeviceLike = None,
    threads: int | None = None,
    caster: CasterName = "auto",
    engine: Engine = "local",
    workers: int | None = None,
    address: str | None = None,
    resume: bool = False,
    repair: bool = False,
    quiet: bool = True,
    source: str | None = None,
    **colors: Unpack[ColorOptions],
) -> BatchSummary:
    """Render frames to a dataset on disk, in shards; an interrupted call can be repeated with `resume`.

    A shard is written completely or not at all. The bytes of all files depend only on the arguments: a job that is
    killed and resumed any number of times writes the same files as an uninterrupted one. If frames see nothing, a
    warning gives their number and, if all frames see nothing, the likely reason. It is issued at the end, and also
    after the first shard of a long job.

    Args:
        scene: A scene, a file for `Scene.load`, or a function that returns a scene.
        camera: The camera of all frames, which may have a lens. None for the camera of the poses, `Frames.camera`; if
            both are given, they must be equal except for their range. With a sensor and no camera in the poses, None
            selects the camera of the sensor's device.
        frames: Poses of the camera and of objects, see `warpvis.read_frames` and `warpvis.pose_generators`; or camera
            poses alone, as for `Renderer.render`.
        out: New or empty folder, or an fsspec URL.
        format: ``"npz"``, ``"zarr"``, ``"png"``, ``"tum"``, ``"bop"``, ``"nerfstudio"``, ``"colmap"``, ``"ply"`` or
            ``"ros2"``.
        outputs: Images of `Renderer`, and ``"visibility"``; the format's default outputs by default. With a sensor,
            also ``"reasons"`` and ``"true_depth"``, if the format supports them.
        objects: Names or indices of the objects whose visibility is computed; all that are not excluded by default.
        exclude: Names or indices of objects that are hidden in all frames.
        shard_frames: Frames per shard; by default as many as fill 64 MiB with images, at most 1000.
        options: The format's options.
        sensor: A model of a depth camera, as for `Renderer`: depth and points are simulated, other outputs are exact.
        seed: Seed of the sensor's random numbers. They depend only on it, the frame's number and the pixel, and not on
            shards, workers or resumed calls.
        device: ``"cpu"``, ``"cuda:0"``, several separated by commas, or ``"cuda:all"``; the scene's device by default.
            For the engine ``"ray"``, ``"cpu"``, or ``"cuda"`` for one GPU per worker.
        threads: For the engine ``"local"``, the number of CPU threads that render and of those that encode; all cores
            of this process by default. With eight or more, compressed files are encoded in additional processes.
        caster: As for `Renderer`.
        engine: ``"local"`` for this machine; ``"ray"`` for a Ray cluster, which is started on this machine if none is
            running.
        workers: Workers of the engine ``"ray"``; by default one for each GPU, or for each core.
        address: Address of the Ray cluster; by default the one that Ray finds, or a new one on this machine.
        resume: Whether to resume a dataset that an earlier call began. A shard counts as complete if its record exists
            and its files have the recorded sizes; their contents are not read.
        repair: With `resume`, whether to first read all files, as `verify` does, and render damaged shards again.
        quiet: Whether to hide the progress bar; it is also hidden if standard error is not a terminal or
            tqdm is not installed.
        source: Origin of the scene for the manifest; the name of the scene's file by default.
        **colors: `shadows`, `reflections`, `ambient_occlusion` and `samples`, as for `Renderer`.

    Raises:
        WarpvisError: If an argument is invalid, the folder contains other files or a dataset with other arguments, or a
            file cannot be written. Complete shards are kept.
    """
    kind = find_format(format)
    if check_flag(repair, "repair") and not resume:
        raise ArrayError(
            "repair=True requires resume=True, because it renders damaged parts of an existing dataset again"
        )
    check_engine(engine, threads, workers, address)
    check_choice(caster, "caster", get_args(CasterName))
    check_colors(**colors)
    if source is not None and not isinstance(source, str):
        raise ArrayError(f"source must be a text, got {type(source).__name__}")
    if source is None and isinstance(scene, str | os.PathLike):
        source = os.path.basename(os.fspath(scene))
    scene = make_scene(scene, None)
    device_names = str(scene.device if device is None else device)
    devices = parse_devices(device_names) if engine == "local" else [device_names]
    plan = make_plan(
        scene,
        camera,
        frames,
        kind,
        outputs=outputs,
        objects=objects,
        exclude=exclude,
        shard_frames=shard_frames,
        options=options,
        sensor=sensor,
        seed=seed,
    )
    layout = kind(plan)
    backend = "cpu" if devices[0] == "cpu" else "cuda"
    choices: dict[str, Any] = {"caster": caster, "colors": check_colors(plan.camera, **colors)}
    manifest = make_manifest(plan, scene, layout, device=backend, source=source, **choices)
    dataset = Dataset(out, plan, layout, manifest)
    if dataset.check(resume=resume) and repair:
        verify(out, repair=True)
    # Other processes receive the scene on the CPU, and move it to their devices.
    scene = scene.to("cpu") if len(devices) > 1 or engine == "ray" else make_scene(scene, devices[0])
    job = Job(plan, scene, format, os.fspath(out), **choices)
    with start_engine(engine, devices, threads, workers, address) as run, dataset.opened(resume=resume) as missing:
        start = time.perf_counter()
        with _Progress(plan, dataset, missing, scene, quiet=quiet) as done:
            run(job, missing, done)
        dataset.finish(scene)
        seconds = time.perf_counter() - start
    rendered = sum(map(plan.shard_length, missing))
    empty = dataset.empty_frames
    if empty:
        warnings.warn(describe_empty(empty, len(plan.frames), plan, scene), stacklevel=2)
    counts = {"frames": len(plan.frames), "shards": plan.shard_count, "rendered_frames": rendered}
    return BatchSummary(
        dataset.name, bytes=dataset.bytes, seconds=seconds, warnings=dataset.warnings, empty_frames=empty, **counts
    )


def check_engine(engine: str, threads: int | None, workers: int | None, address: str | None) -> None:
    check_choice(engine, "engine", ("local", "ray"))
    check_threads(threads)
    if engine == "local" and (workers is not None or address is not None):
        raise ArrayError('workers= and address= require engine="ray", got engine="local"')
    if workers is not None:
        check_whole(workers, "workers")
    if engine == "ray" and threads is not None:
        raise ArrayError('threads must be None with engine="ray": each Ray worker uses its share of the cores')


def start_engine(
    engine: Engine, devices: Sequence[str], threads: int | None, workers: int | None, address: str | None
) -> AbstractContextManager[Run]:
    """Return the engine as a context manager, which shuts down a Ray cluster that was started for it."""
    if engine == "local":
        return nullcontext(partial(run_local, devices=devices, threads=threads))
    from warpvis.batch.engines._ray import ray_engine

    return ray_engine(gpu=devices[0] != "cpu", workers=workers, address=address)


def make_plan(
    scene: Scene,
    camera: ImageCamera | None,
    frames: Frames | PoseLike,
    kind: type[Format],
    *,
    outputs: Sequence[str] | None = None,
    objects: Sequence[str | int] | None = None,
    exclude: Sequence[str | int] | None = None,
    shard_frames: int | None = None,
    options: Options | None = None,
    sensor: DepthSensor | None = None,
    seed: int = 0,
) -> Plan:
    """Make the plan of a job; see `render_batch` for the arguments."""
    scene.require_objects()
    if not isinstance(frames, Frames):
        frames = Frames.from_poses(frames)
    if not len(frames):
        raise PoseError("there must be at least one frame to render, got none")
    if sensor is not None and camera is None and frames.camera is None:
        camera = require_sensor(sensor).camera()
    eye = require_image_camera(frames.choose_camera(camera))
    if sensor is not None:
        require_sensor(sensor).check(scene, eye)
    names = check_batch_outputs(kind.default_outputs if outputs is None else outputs, sensor)
    unsupported = [name for name in names if name not in kind.outputs]
    if unsupported:
        raise ArrayError(
            f"outputs must be from {', '.join(sorted(kind.outputs))} for format {kind.name!r}, got {unsupported[0]!r}"
        )
    excluded = choose_excluded(scene, exclude)
    chosen = _choose_seen(scene, kind, objects, excluded) if VISIBILITY in names or objects is not None else ()
    return Plan(
        frames=_place_objects(scene, frames),
        camera=eye,
        outputs=names,
        shard_frames=_shard_frames(shard_frames, names, eye, masks=len(chosen) if kind.masks else 0),
        object_names=tuple(item.name for item in scene.objects),
        object_labels=tuple(int(item.label) for item in scene.objects),
        label_names=LabelNames(scene.label_names),
        object_columns=tuple(pose_columns(scene).tolist()),
        object_centers=tuple(tuple(item.bounds.astype(np.float64).mean(axis=0).tolist()) for item in scene.objects),
        object_models=same_meshes(scene),
        chosen=chosen,
        exclude=tuple(excluded),
        up=scene.up,
        options={} if options is None else dict(check_mapping(options, "options", FileFormatError)),
        sensor=sensor,
        sensor_seed=check_word(seed, "seed"),
    )


def _choose_seen(
    scene: Scene, kind: type[Format], objects: Sequence[str | int] | None, excluded: Sequence[int]
) -> tuple[int, ...]:
    """Return the objects whose visibility is computed: the named ones, or all with the format's label not excluded."""
    if objects is not None:
        return tuple(choose_objects(scene, objects))
    required = kind.object_label
    labels = [item.label for item in scene.objects]
    return tuple(i for i in range(len(scene)) if i not in excluded and required in (None, labels[i]))


def _place_objects(scene: Scene, frames: Frames) -> Frames:
    """Return the frames with poses of the movable objects, which are taken from the scene if the frames have none."""
    movable = len(scene.movable)
    if frames.object_poses is None:
        if not movable:
            return frames
        rows = np.array([scene.objects[index].pose for index in scene.movable], dtype=np.float32)
        return replace(frames, object_poses=rows[None])
    if frames.object_poses.shape[1] != movable:
        raise PoseError(
            f"frames must have poses of the {pluralize(movable, 'movable object')} of the scene, got "
            f"{frames.object_poses.shape[1]}"
        )
    return frames


def _shard_frames(shard_frames: int | None, outputs: Sequence[str], camera: ImageCamera, *, masks: int) -> int:
    """Return the given number of frames per shard, or as many as fit with `masks` masks into the default size."""
    if shard_frames is None:
        pixel = masks + pixel_bytes([name for name in outputs if name != VISIBILITY])
        return max(1, min(_MAX_SHARD_FRAMES, _SHARD_BYTES // max(1, pixel * camera.width * camera.height)))
    return check_whole(shard_frames, "shard_frames")


class _Progress:
    """Counts complete shards, and shows a progress bar with frames per second and the remaining time."""

    def __init__(self, plan: Plan, dataset: Dataset, missing: Sequence[int], scene: Scene, *, quiet: bool) -> None:
        self._plan, self._dataset, self._missing, self._scene = plan, dataset, missing, scene
        self._warning_shard = missing[0] if len(missing) >= _LONG_JOB else None
        self._hidden = quiet or not sys.stderr.isatty() or importlib.util.find_spec("tqdm") is None
        self._bar: tqdm | None = None

    def __enter__(self) -> _Progress:
        frames = sum(map(self._plan.shard_length, self._missing))
        complete = len(self._plan.frames) - frames
        if not self._hidden:
            from tqdm import tqdm

            self._bar = tqdm(total=complete + frames, initial=complete, unit=" frames", unit_scale=True)
        return self

    def __call__(self, shard: int, record: Record) -> None:
        self._dataset.add(shard, record)
        if self._bar is not None:
            self._bar.update(self._plan.shard_length(shard))
        seen, empty = self._dataset.frames, self._dataset.empty_frames
        if shard == self._warning_shard and empty == seen:
            if self._bar is not None:
                self._bar.clear()
            warnings.warn(f"so far {describe_empty(empty, seen, self._plan, self._scene)}", stacklevel=2)

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
