# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``warpvis batch``, from poses to a dataset, ``warpvis verify`` and ``warpvis warmup``."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from warpvis.cli._inputs import parse_labels
from warpvis.errors import FileFormatError, SceneError

if TYPE_CHECKING:
    from warpvis.batch import BatchSummary
    from warpvis.core.frames import Frames
    from warpvis.scene import Scene


@dataclass(frozen=True)
class Batch:
    """Render frames to a dataset in a folder, in shards. --resume goes on after an interruption, to the same bytes."""

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """Mesh file: OBJ, STL, PLY, GLB, ...; or a Webots world, .wbt."""
    poses: str
    """Camera poses: a file (TUM text, .npy, .npz, .csv, .parquet, transforms.json, scene_camera.json, a ROS 2 bag),
    or what makes them: "orbit target=0,0,0.5 radius=2 height=1 count=360", "random count=1000 seed=1 clearance=0.3"."""
    out: str
    """Folder to write to, new or empty, or an fsspec URL."""
    format: str = "npz"
    """npz, zarr, png, tum, bop, nerfstudio, colmap, ply or ros2."""
    outputs: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME,...")] = ()
    """What to make: depth, points, normals, labels, objects, visibility; the format's usual ones by default."""
    camera: str = "kinect"
    """kinect, or a JSON file with width, height, hfov (radians) or K, near and far (metres)."""
    objects: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME,...")] = ()
    """Objects that visibility is of; all by default."""
    exclude: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME,...")] = ()
    """Objects that the camera does not see, such as the robot that carries it."""
    movable: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME,...")] = ()
    """Objects that --worlds places, in its order."""
    worlds: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Where the movable objects are: .npz with object_poses, rows x y z qx qy qz qw, (W, M, 7), which move what the
    mesh file holds; and, unless each frame has a world of its own, world, (frames,)."""
    shard_frames: int | None = None
    """Frames of a shard; by default as many as make 64 MiB of images, at most 1000."""
    option: Annotated[tuple[str, ...], tyro.conf.arg(metavar="KEY=VALUE ...")] = ()
    """The format's own options."""
    resume: bool = False
    """Go on with what an earlier call began."""
    engine: Literal["local", "ray"] = "local"
    """This machine, or a Ray cluster."""
    workers: int | None = None
    """Workers of a Ray cluster; by default one for each GPU, or for each core."""
    address: str | None = None
    """Of the Ray cluster; by default one that Ray finds, or a new one of this machine."""
    device: str = "cpu"
    """Where to compute: cpu, cuda:0, ..., several with commas, or cuda:all; by Ray cpu, or cuda for a GPU each."""
    threads: int | None = None
    """CPU threads that render; all cores by default. Ray's workers have their share of the cores."""
    convention: Literal["opencv", "opengl", "ros_body", "ros_optical"] | None = None
    """Axes of the camera frame of the poses; those of the pose file's format by default."""
    file_format: str | None = None
    """The pose file's format, where its name does not tell: tum, npy, npz, csv, parquet, nerfstudio, bop, ros."""
    topic: str | None = None
    """Of a ROS 2 bag: the topic of the poses."""
    labels: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=LABEL ...")] = ()
    """What objects are: "ball=object" "wall_*=obstacle" ..."""
    scale: float = 1.0
    """Metres in a unit of the mesh file (0.001 for millimetres)."""
    up: Literal["z", "y"] = "z"
    """The world's vertical axis."""
    file_up: Literal["z", "y"] | None = None
    """The mesh file's vertical axis; y for glTF and the world's for other formats by default."""
    quiet: bool = False
    """No progress bar and no summary."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.batch import check_outputs, find_format, render_batch
        from warpvis.io import load_camera

        find_format(self.format)
        outputs = check_outputs(_split(self.outputs)) if self.outputs else None
        options = _parse_options(self.option)
        camera = load_camera(self.camera)
        scene = self._load_scene()
        same = ("device", "format", "shard_frames", "resume", "engine", "workers", "address", "threads", "quiet")
        given: dict[str, Any] = {name: getattr(self, name) for name in same}
        given |= {"objects": _split(self.objects) or None, "exclude": _split(self.exclude) or None}
        try:
            summary = render_batch(
                scene,
                camera,
                self._load_frames(scene),
                self.out,
                outputs=outputs,
                options=options,
                source=self.file.name,
                **given,
            )
        except KeyboardInterrupt:
            print(f"warpvis: interrupted; the same command with --resume goes on with {self.out}", file=sys.stderr)
            raise
        _print_summary(summary, self.format, quiet=self.quiet)

    def _load_scene(self) -> Scene:
        from warpvis.scene import Scene

        form: dict[str, Any] = {"up": self.up, "file_up": self.file_up, "scale": self.scale}
        scene = Scene.load(self.file, labels=parse_labels(self.labels), **form)
        return _with_movable(scene, _split(self.movable)) if self.movable else scene

    def _load_frames(self, scene: Scene) -> Frames:
        from warpvis.io import read_frames
        from warpvis.pose_generators import frames_from_spec, looks_like_spec

        if looks_like_spec(self.poses):
            frames = frames_from_spec(self.poses, scene, up=scene.up)
        else:
            form: Any = {"file_format": self.file_format, "topic": self.topic}
            frames = read_frames(self.poses, convention=self.convention, **form)
        return frames if self.worlds is None else _with_worlds(frames, self.worlds)


@dataclass(frozen=True)
class Verify:
    """Read every file of a dataset and compare it with its record; exit 0 only if it is complete and sound."""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DIR")]
    """The dataset: a folder or an fsspec URL."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.batch import verify

        report = verify(self.dataset)
        for problem in report.problems:
            print(problem)
        print(
            f"{report.out}: {'complete and sound' if report.ok else f'{len(report.problems)} problems'}: "
            f"{report.whole_shards} of {report.shards} shards ({report.format}, {report.frames} frames), "
            f"{report.files} files, {report.bytes / 1e9:.3f} GB"
        )
        if report.damaged:
            print(f"to make again what is damaged: delete {', '.join(report.damaged)}, and resume the batch")
        if not report.ok:
            sys.exit(1)


@dataclass(frozen=True)
class Warmup:
    """Compile ahead what rendering needs, into the cache that all processes share (WARP_CACHE_PATH)."""

    device: str = "cpu"
    """What to compile for: cpu, cuda:0, ..., or cuda:all."""

    def run(self) -> None:
        """Run the command."""
        import warp as wp

        from warpvis.batch import parse_devices, warmup

        for device in parse_devices(self.device):
            print(f"{device}: {warmup(device):.1f} s", flush=True)
        print(f"cache: {wp.config.kernel_cache_dir}")


def _split(words: Sequence[str]) -> list[str]:
    """Names that are separated by commas or spaces."""
    return [name for word in words for name in word.split(",") if name]


def _parse_options(words: Sequence[str]) -> dict[str, str]:
    options = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not (key and equals):
            raise FileFormatError(f"--option must be given as KEY=VALUE, such as compression=zstd, got {word!r}")
        options[key] = value
    return options


def _with_movable(scene: Scene, names: Sequence[str]) -> Scene:
    """The same scene, of which some objects can be moved; where they are now is their identity."""
    from warpvis.scene import Scene

    if scene.movable:
        raise SceneError("--movable is for mesh files, where nothing is; this scene has movable objects of its own")
    moving = Scene(device=scene.device, up=scene.up)
    order = [item for item in scene if item.name not in names] + [scene[name] for name in names]
    for item in order:
        moving.add((item.vertices, item.faces), name=item.name, label=item.label, movable=item.name in names)
    return moving


def _with_worlds(frames: Frames, path: Path) -> Frames:
    """The frames, with the objects' poses from a file.

    Raises:
        FileFormatError: It cannot be read, or does not hold such poses.
    """
    import numpy as np

    from warpvis.core.frames import Frames
    from warpvis.errors import WarpvisError

    try:
        with np.load(path) as arrays:
            found = {name: arrays[name] for name in ("object_poses", "world_index") if name in arrays}
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception:  # whatever NumPy and zipfile raise for what is no such file
        raise FileFormatError(f"{path}: is not an .npz file") from None
    if "object_poses" not in found:
        raise FileFormatError(f"{path}: holds no array object_poses")
    try:
        moved = Frames.from_poses(frames.camera_to_world, **found)
    except WarpvisError as error:
        raise FileFormatError(f"{path}: {error}") from None
    source = {**frames.source, "worlds": path.name}
    return replace(frames, object_poses=moved.object_poses, world_index=moved.world_index, source=source)


def _print_summary(summary: BatchSummary, layout: str, *, quiet: bool) -> None:
    for message, count in summary.warnings.items():
        print(f"warning: {count} {message}", file=sys.stderr)
    if quiet:
        return
    size = f"{summary.bytes / 1e6:,.1f} MB"
    print(f"frames: {summary.frames}, shards: {summary.shards}, {size} ({layout}): {summary.out}")
    if summary.rendered_frames:
        rate = f"{summary.frames_per_second:.0f} frames/s"
        print(f"{summary.rendered_frames} of them rendered in {summary.seconds:.1f} s, {rate}")
    else:
        print("nothing was left to do")
