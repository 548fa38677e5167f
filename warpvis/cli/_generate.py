# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis generate``: datasets of situations."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from warpvis.cli._inputs import Names, split_names
from warpvis.cli._output import with_help
from warpvis.core.checks import format_percent, pluralize
from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch.situations import SituationSummary
    from warpvis.situations import SituationOptions

_PROCEDURAL = "procedural"
_NOT_IN_COMMAND = ("out", "resume", "repair", "allow_shortcuts", "threads", "engine", "workers", "address", "quiet")
"""Options that do not change the files."""


@with_help
@dataclass(frozen=True, kw_only=True)
class Generate:
    """Generate situations, people among objects in furnished rooms and questions about who sees what, to a dataset.

    After an interruption, --resume continues it with identical bytes.
    """

    out: Annotated[str, tyro.conf.arg(metavar="DIR|URL")]
    """Output folder, new or empty, or an fsspec URL."""
    count: int
    """Number of situations."""
    scenes: Annotated[tuple[str, ...], tyro.conf.arg(metavar="procedural|FILE,...")] = (_PROCEDURAL,)
    """procedural for furnished rooms, or scene files, which the shards use in turns."""
    seed: int = 0
    """Seed of the rooms and of everything in them."""
    format: str = "webdataset"
    """webdataset, parquet, jsonl or lerobot."""
    per_shard: int = 100
    """Number of situations per shard, which has one room, or several if one does not suffice."""
    rooms: Names = ()
    """Kinds of rooms, in turns; all by default."""
    questions: Names = ()
    """Kinds of questions; all by default."""
    outputs: Names = ("color",)
    """Images of each view: color, depth, segmentation, amodal_masks and seen_by; none for JSON only."""
    views: Literal["camera", "all"] = "camera"
    """camera for pictures of the camera only, all for those of the participants, too."""
    license: Annotated[str | None, tyro.conf.arg(metavar="NAME")] = None
    """License for the datasheet, such as cc-by-4.0; none by default."""
    shortcut_threshold: float = 0.15
    """Accuracy above chance that is accepted of models without pictures, from 0 to 1."""
    allow_shortcuts: bool = False
    """Complete a dataset whose questions can be answered by a shortcut."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..., several with commas, or cuda:all; with Ray cpu, or cuda for one GPU per
    worker."""
    threads: int | None = None
    """Number of CPU threads; all cores by default."""
    engine: Literal["local", "ray"] = "local"
    """local for this machine, or ray for a Ray cluster, whose workers share the cores."""
    workers: int | None = None
    """Number of processes; by default one per device, with Ray one per GPU or core."""
    address: str | None = None
    """Address of the Ray cluster; by default one that Ray finds, or a new one on this machine."""
    resume: bool = False
    """Continue an interrupted dataset. Only the records and the sizes of existing files are checked."""
    repair: bool = False
    """With --resume: first read all existing files, as verify does, and generate damaged ones again."""
    quiet: bool = False
    """Print no progress bar and no summary."""

    def run(self) -> None:
        from warpvis.batch.situations import find_situation_format
        from warpvis.cli._interrupts import run_in_subprocess

        find_situation_format(self.format)
        if self.engine == "ray":
            lost = (
                "the Ray cluster, or its node on this machine, was lost; complete shards are kept; --resume continues"
            )
            run_in_subprocess(self.generate, f"{self.out}: {lost}")
        else:
            self.generate()

    def generate(self) -> None:
        """Generate in this process."""
        from warpvis.batch.situations import generate_situations
        from warpvis.situations import SituationGenerator

        try:
            summary = generate_situations(
                self.out,
                self.options(),
                SituationGenerator,
                count=self.count,
                format=self.format,
                device=self.device,
                threads=self.threads,
                engine=self.engine,
                workers=self.workers,
                address=self.address,
                resume=self.resume,
                repair=self.repair,
                allow_shortcuts=self.allow_shortcuts,
                shortcut_threshold=self.shortcut_threshold,
                license=self.license,
                command=self.command(),
                quiet=self.quiet,
            )
        except KeyboardInterrupt:
            print(f"warpvis: interrupted; the same command with --resume continues {self.out}", file=sys.stderr)
            raise
        if not self.quiet:
            print_situations(summary, self.format)

    def options(self) -> SituationOptions:
        """Return the options of the generator."""
        from warpvis.situations import SituationOptions

        given = {name: tuple(split_names(getattr(self, name))) for name in ("rooms", "questions", "outputs")}
        chosen: dict[str, Any] = {name: names for name, names in given.items() if names}
        if given["outputs"] == ("none",):
            chosen["outputs"] = ()
        words = [[word] if Path(word).exists() else split_names([word]) for word in self.scenes]
        scenes = tuple(name for names in words for name in names)
        for name in scenes:
            if name != _PROCEDURAL and not Path(name).exists():
                raise FileFormatError(f"--scenes must be {_PROCEDURAL} or files of scenes, and {name} is no file")
        chosen |= {"seed": self.seed, "per_shard": self.per_shard, "views": self.views}
        return SituationOptions(scenes=scenes, **chosen)

    def command(self) -> str:
        """Return the command that generates the same files, for the datasheet."""
        words = ["warpvis", "generate"]
        for item in fields(self):
            value = getattr(self, item.name)
            if item.name not in _NOT_IN_COMMAND and value != item.default:
                values = value if isinstance(value, tuple) else (value,)
                words += [f"--{item.name.replace('_', '-')}", *(shlex.quote(str(part)) for part in values)]
        return " ".join([*words, "--out", "OUT"])


def print_situations(summary: SituationSummary, layout: str) -> None:
    """Print a summary of the dataset, and the best shortcut."""
    size = f"{summary.bytes / 1e6:,.1f} MB"
    counts = f"situations: {summary.situations}, questions: {summary.questions}, shards: {summary.shards}"
    print(f"{counts}, {size} ({layout}): {summary.out}")
    if summary.generated:
        rate = f"{summary.situations_per_second:.1f} situations/s"
        print(f"{summary.generated} of them generated in {summary.seconds:.1f} s, {rate}")
    else:
        print("nothing was left to do")
    report = summary.shortcuts
    tested = [] if report is None else [item for item in report.results if not item.is_diagnostic]
    if tested:
        best = max(tested, key=lambda item: item.accuracy - item.chance)
        print(
            f"shortcuts: the best is {best.name} with {format_percent(best.accuracy)} of {best.kind} "
            f"(chance {format_percent(best.chance)})"
        )
    if report is not None and report.untested:
        print(
            f"not tested for shortcuts: {pluralize(sum(report.untested.values()), 'question')}, too few of their kind"
        )
