# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``warpvis batch``, ``verify`` and ``warmup``, and the options of images that ``render`` shares."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from warpvis.cli._inputs import (
    FrameOptions,
    MaybePoses,
    Names,
    SceneFile,
    refuse_options,
    split_names,
    split_pairs,
)
from warpvis.cli._output import with_help
from warpvis.core.checks import pluralize
from warpvis.core.outputs import IMAGE_NAMES, SENSOR_NAMES, VISIBILITY
from warpvis.errors import ArrayError, FileFormatError

if TYPE_CHECKING:
    from warpvis.batch import BatchSummary
    from warpvis.cameras.pinhole import Camera
    from warpvis.rendering import DepthSensor


_OUTPUTS = (
    f"Outputs to render: {', '.join((*IMAGE_NAMES, VISIBILITY))}, with --sensor also {' and '.join(SENSOR_NAMES)}; by "
    "default the usual ones of the format."
)

_NOTHING_SEEN = 3
"""Exit code if no image sees anything."""


@with_help
@dataclass(frozen=True, kw_only=True)
class ColorOptions:
    """Options of color images."""

    shadows: bool = True
    """Whether lights with shadows cast them in color images."""
    reflections: bool = True
    """Whether flat surfaces with a reflectance show a mirror image in color images."""
    ambient_occlusion: Annotated[float | None, tyro.conf.arg(metavar="METERS")] = None
    """Distance up to which surfaces block ambient light of each other in color images; by default they do not."""
    samples: int = 1
    """Rays through each pixel at an edge of a surface whose colors are averaged in color images: 1, 2, 4, 8 or 16."""

    def colors(self) -> dict[str, Any]:
        """Return these options as those of `warpvis.Renderer`."""
        from warpvis.scene.lights import AmbientOcclusion

        options = {name: getattr(self, name) for name in color_options}
        if self.ambient_occlusion is not None:
            options["ambient_occlusion"] = AmbientOcclusion(self.ambient_occlusion)
        return options


color_options = tuple(field.name for field in fields(ColorOptions))
"""Names of the options of color images."""


@with_help
@dataclass(frozen=True, kw_only=True)
class ImageOptions(ColorOptions, FrameOptions):
    """Options that select the images to render."""

    outputs: Annotated[Names, tyro.conf.arg(help=_OUTPUTS)] = ()
    objects: Names = ()
    """Objects to compute visibility for; all by default."""
    exclude: Names = ()
    """Objects that are invisible to the camera, such as the robot it is mounted on."""
    sensor: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """Simulated depth camera: d405, d415, d435, d455, d457, gemini-335, zed-2i, oak-d, kinect-v1, structure, optionally
    with a size (d435@424x240); azure-kinect and femto-bolt, also with -binned, -wide and -wide-binned; l515, kinect-v2,
    flexx2. Uses the device's intrinsics, unless --camera or the pose file defines a camera."""
    sensor_seed: int = 0
    """Seed of the sensor's random numbers, combined with each frame's number."""
    sensor_vary: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=MIN:MAX,...")] = ()
    """Sensor parameters to randomize per frame, with their ranges: sigma=0.05:0.15,dropout=0:0.05."""
    option: Annotated[tuple[str, ...], tyro.conf.arg(metavar="KEY=VALUE,...")] = ()
    """Options of the format; with several formats, each gets those that it has."""
    threads: int | None = None
    """Number of CPU threads that render, and of those that encode; all cores by default."""
    quiet: bool = False
    """Print no progress bar and no summary."""
    fail_empty: bool = False
    """Exit with code 3 if no image sees anything; by default this is a warning."""

    def end(self, *, empty: bool) -> None:
        """Exit with a separate exit code if no image sees anything and `fail_empty` is set."""
        if empty and self.fail_empty:
            sys.exit(_NOTHING_SEEN)

    def make_sensor(self) -> DepthSensor | None:
        """Create the sensor, if one is given."""
        if self.sensor is None:
            refuse_options(self, ("sensor_seed", "sensor_vary"), "without --sensor, give")
            return None
        from warpvis.sensors import Randomized, sensor_by_name

        sensor = sensor_by_name(self.sensor)
        return Randomized(sensor, _parse_ranges(self.sensor_vary), per="image") if self.sensor_vary else sensor

    def device_camera(self) -> Camera | None:
        """Return the sensor's camera."""
        sensor = self.make_sensor()
        return None if sensor is None else sensor.camera()

    def chosen(self) -> dict[str, Any]:
        """Return the arguments of `render_batch` that these options set."""
        from warpvis.batch import check_batch_outputs

        sensor = self.make_sensor()
        return {
            "outputs": check_batch_outputs(split_names(self.outputs), sensor) if self.outputs else None,
            "sensor": sensor,
            "seed": self.sensor_seed,
            "options": _parse_options(self.option),
            "objects": split_names(self.objects) or None,
            "exclude": split_names(self.exclude) or None,
        }


@with_help
@dataclass(frozen=True, kw_only=True)
class Batch(ImageOptions):
    """Render frames to a dataset in shards. After an interruption, --resume continues it with identical bytes."""

    file: SceneFile
    poses: MaybePoses = None
    out: Annotated[str, tyro.conf.arg(metavar="DIR|URL")]
    """Output folder, new or empty, or an fsspec URL."""
    format: str = "npz"
    """npz, zarr, png, tum, bop, nerfstudio, colmap, ply or ros2."""
    shard_frames: int | None = None
    """Frames per shard; by default as many as make 64 MiB of images, at most 1000."""
    resume: bool = False
    """Continue an interrupted batch. Only the records and the sizes of existing files are checked."""
    repair: bool = False
    """With --resume: first read all existing files, as verify does, and render damaged ones again."""
    engine: Literal["local", "ray"] = "local"
    """local for this machine, or ray for a Ray cluster, whose workers share the cores."""
    workers: int | None = None
    """Number of workers of a Ray cluster; by default one per GPU, or per core."""
    address: str | None = None
    """Address of the Ray cluster; by default one that Ray finds, or a new one on this machine."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..., several with commas, or cuda:all; with Ray cpu, or cuda for one GPU per
    worker."""

    def run(self) -> None:
        from warpvis.batch import find_format
        from warpvis.cli._interrupts import run_in_subprocess

        find_format(self.format)
        if self.engine == "ray":
            lost = (
                "the Ray cluster, or its node on this machine, was lost; complete shards are kept; --resume continues"
            )
            run_in_subprocess(self.render, f"{self.out}: {lost}")
        else:
            self.render()

    def render(self) -> None:
        """Render in this process."""
        from warpvis.batch import render_batch

        chosen = self.chosen()
        scene, camera, frames = self.load(self.file, self.poses)
        try:
            summary = render_batch(
                scene,
                camera,
                frames,
                self.out,
                format=self.format,
                shard_frames=self.shard_frames,
                device=self.device,
                threads=self.threads,
                engine=self.engine,
                workers=self.workers,
                address=self.address,
                resume=self.resume,
                repair=self.repair,
                quiet=self.quiet,
                source=self.file.name,
                **chosen,
                **self.colors(),
            )
        except KeyboardInterrupt:
            print(f"warpvis: interrupted; the same command with --resume continues {self.out}", file=sys.stderr)
            raise
        print_summary(summary, self.format, quiet=self.quiet)
        existing = summary.frames - summary.rendered_frames
        if self.resume and existing and not self.quiet:
            trusted = "their checksums are correct" if self.repair else "their sizes are correct; --repair reads them"
            print(f"{existing} of them existed: {trusted}")
        self.end(empty=summary.empty_frames == summary.frames)


@with_help
@dataclass(frozen=True)
class Verify:
    """Read every file of a dataset and compare it with its record; exit with 0 only if it is complete and intact."""

    dataset: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="DIR")]
    """The dataset: a folder or an fsspec URL."""
    repair: bool = False
    """Remove the records of damaged shards, so that the batch command with --resume renders them again."""

    def run(self) -> None:
        from warpvis.batch import verify

        report = verify(self.dataset, repair=self.repair)
        for problem in report.problems:
            print(problem)
        print(
            f"{report.out}: {'complete and intact' if report.ok else pluralize(len(report.problems), 'problem')}: "
            f"{report.whole_shards} of {pluralize(report.shards, 'shard')} ({report.format}, "
            f"{pluralize(report.frames, 'situation' if report.has_situations else 'frame')}), "
            f"{pluralize(report.files, 'file')}, {report.bytes / 1e9:.3f} GB"
        )
        records = ", ".join(report.damaged)
        if report.damaged and report.repaired:
            print(f"removed {records}: the batch command with --resume renders the damaged shards again")
        elif report.damaged:
            print(f"damaged shards: {records}; the batch command with --resume --repair renders them again")
        if not report.ok:
            sys.exit(1)


@with_help
@dataclass(frozen=True)
class Warmup:
    """Compile the kernels for rendering into the cache that all processes share (WARP_CACHE_PATH)."""

    device: str = "cpu"
    """Device to compile for: cpu, cuda:0, ..., or cuda:all."""

    def run(self) -> None:
        import warp as wp

        from warpvis.batch import parse_devices, warmup

        for device in parse_devices(self.device):
            print(f"{device}: {warmup(device):.1f} s", flush=True)
        print(f"cache: {wp.config.kernel_cache_dir}")


def _parse_ranges(words: Sequence[str]) -> dict[str, tuple[float, float]]:
    """Parse ranges of a sensor's parameters; integers stay integers."""
    ranges: dict[str, tuple[float, float]] = {}
    for word in split_pairs(words):
        name, _, limits = word.partition("=")
        try:
            numbers = [int(part) if part.strip("+-").isdecimal() else float(part) for part in limits.split(":")]
        except ValueError:
            numbers = []
        if not name or len(numbers) != 2 or name in ranges:
            raise ArrayError(f"--sensor-vary takes each NAME=MIN:MAX once, as in sigma=0.05:0.15, got {word!r}")
        ranges[name] = numbers[0], numbers[1]
    return ranges


def _parse_options(words: Sequence[str]) -> dict[str, str]:
    options = {}
    for word in split_pairs(words):
        key, equals, value = word.partition("=")
        if not (key and equals):
            raise FileFormatError(f"--option must be given as KEY=VALUE, such as compression=zstd, got {word!r}")
        options[key] = value
    return options


def print_summary(summary: BatchSummary, layout: str, *, quiet: bool) -> None:
    """Print a summary of the batch, and warnings about lost values."""
    for message, count in summary.warnings.items():
        print(f"warning: {message}: {count} in all", file=sys.stderr)
    if quiet:
        return
    size = f"{summary.bytes / 1e6:,.1f} MB"
    print(f"frames: {summary.frames}, shards: {summary.shards}, {size} ({layout}): {summary.out}")
    if summary.rendered_frames:
        rate = f"{summary.frames_per_second:.0f} frames/s"
        print(f"{summary.rendered_frames} of them rendered in {summary.seconds:.1f} s, {rate}")
    else:
        print("nothing was left to do")
