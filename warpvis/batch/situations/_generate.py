# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Generation of datasets of situations: `generate_situations`."""

from __future__ import annotations

import importlib.util
import json
import os
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from typing import TYPE_CHECKING, Any, Literal

from warpvis.batch._dataset import INDEX_RECORD, JobFolder, Record, commit, read_whole, shard_record
from warpvis.batch._manifest import Manifest, versions
from warpvis.batch._render_batch import check_engine, start_engine
from warpvis.batch._verify import verify
from warpvis.batch.engines._local import parse_devices
from warpvis.batch.situations._base import SituationFormat
from warpvis.batch.situations._datasheet import write_datasheet
from warpvis.batch.situations._job import GeneratorFactory, SituationJob, SituationPlan
from warpvis.batch.situations._stored import StoredShards
from warpvis.core.checks import check_flag, check_number, check_text, check_whole
from warpvis.core.types import DeviceLike
from warpvis.errors import ArrayError, FileFormatError
from warpvis.situations import ShortcutReport

if TYPE_CHECKING:
    from tqdm import tqdm

THRESHOLD = 0.15
"""Default of the accuracy of a shortcut above chance that is accepted."""
_SHORTCUTS = "shortcuts.json"


@dataclass(frozen=True)
class SituationSummary:
    """The result of a call of `generate_situations`."""

    out: str
    """The dataset."""
    situations: int
    """Number of situations of the dataset."""
    questions: int
    """Number of questions of the dataset."""
    shards: int
    """Number of shards of the dataset."""
    bytes: int
    """Total size of the shards' files in bytes."""
    generated: int
    """Number of situations that this call generated; less than `situations` if it resumed a dataset."""
    seconds: float
    """Time spent on generating and writing them [s]."""
    shortcuts: ShortcutReport | None = None
    """Result of the shortcut test; None if the dataset was complete already."""

    @property
    def situations_per_second(self) -> float:
        """Situations generated and written per second by this call; 0 if there was nothing left to do."""
        return self.generated / self.seconds if self.generated else 0.0


def generate_situations(
    out: str | os.PathLike[str],
    options: Any,
    generator: GeneratorFactory,
    *,
    count: int,
    format: str = "webdataset",
    shard_situations: int | None = None,
    device: DeviceLike = "cpu",
    threads: int | None = None,
    engine: Literal["local", "ray"] = "local",
    workers: int | None = None,
    address: str | None = None,
    resume: bool = False,
    repair: bool = False,
    allow_shortcuts: bool = False,
    shortcut_threshold: float = THRESHOLD,
    license: str | None = None,
    command: str | None = None,
    quiet: bool = True,
) -> SituationSummary:
    """Generate situations to a dataset on disk, in shards; an interrupted call can be repeated with `resume`.

    A shard is written completely or not at all, and the bytes of all files depend only on the arguments. At the end,
    the questions are tested for shortcuts, and a datasheet is written.

    Args:
        out: New or empty folder, or an fsspec URL.
        options: Options of the generator, a dataclass with the seed.
        generator: Class of the generator, which is called as ``generator(options, device=device, threads=n)``.
        count: Number of situations. A room that holds fewer than `shard_situations` makes the dataset smaller.
        format: ``"webdataset"``, ``"parquet"``, ``"jsonl"`` or ``"lerobot"``.
        shard_situations: Maximum number of situations of a shard; `per_shard` of the options by default.
        device: ``"cpu"``, ``"cuda:0"``, several separated by commas, or ``"cuda:all"``; with Ray ``"cpu"``, or
            ``"cuda"`` for one GPU per worker.
        threads: With the engine ``"local"``, number of CPU threads that all processes share; all cores by default.
        engine: ``"local"`` for this machine, ``"ray"`` for a Ray cluster.
        workers: Number of processes; by default one for each device, with Ray one for each GPU or core.
        address: Address of the Ray cluster; by default the one that Ray finds, or a new one on this machine.
        resume: Whether to resume a dataset that an earlier call began.
        repair: With `resume`, whether to first read all files, as `verify` does, and generate damaged shards again.
        allow_shortcuts: Whether to complete a dataset whose questions can be answered by a shortcut.
        shortcut_threshold: Accuracy of a shortcut above chance that is accepted, from 0 to 1.
        license: Identifier of a license for the datasheet, as Hugging Face lists them; none by default.
        command: Command that made the dataset, for the datasheet.
        quiet: Whether to hide the progress bar.

    Raises:
        ShortcutError: If a shortcut answers questions of a kind. The shards are kept; with `resume` and
            `allow_shortcuts`, a second call completes the dataset.
        WarpvisError: If an argument is invalid, the folder contains other files or a dataset with other arguments, or
            a file cannot be written. Complete shards are kept.
    """
    check_whole(count, "count")
    if shard_situations is None:
        shard_situations = getattr(options, "per_shard", 100)
    check_whole(shard_situations, "shard_situations")
    check_flag(allow_shortcuts, "allow_shortcuts")
    check_number(shortcut_threshold, "shortcut_threshold", minimum=0, maximum=1)
    for text, name in ((license, "license"), (command, "command")):
        if text is not None:
            check_text(text, name)
    if check_flag(repair, "repair") and not resume:
        raise ArrayError(
            "repair=True requires resume=True, because it generates damaged parts of an existing dataset again"
        )
    if not is_dataclass(options) or isinstance(options, type):
        raise ArrayError(f"options must be a dataclass with the options of the generator, got {type(options).__name__}")
    check_engine(engine, threads, None if engine == "local" else workers, address)
    if workers is not None:
        check_whole(workers, "workers")
    devices = parse_devices(device) if engine == "local" else [str(device)]
    plan = SituationPlan(count, shard_situations)
    job = SituationJob(plan, generator, options, format, os.fspath(out))
    layout = job.layout()
    manifest = _make_manifest(job, layout, "cpu" if devices[0] == "cpu" else "cuda", license, shortcut_threshold)
    folder = SituationFolder(out, job, layout, manifest)
    if folder.check(resume=resume) and repair:
        verify(out, repair=True)
    if engine == "local" and workers is not None:
        devices *= max(1, workers // len(devices))
    run = start_engine(engine, devices, threads, workers, address)
    with run as start, folder.opened(resume=resume) as missing:
        began = time.perf_counter()
        with _Progress(folder, missing, plan, quiet=quiet) as done:
            start(job, missing, done)
        seconds = time.perf_counter() - began
        report = folder.finish(shortcut_threshold, command, allow_shortcuts=allow_shortcuts)
    return SituationSummary(
        folder.name,
        situations=folder.frames,
        questions=folder.questions,
        shards=plan.shard_count,
        bytes=folder.bytes,
        generated=done.situations,
        seconds=seconds,
        shortcuts=report,
    )


def _make_manifest(
    job: SituationJob, layout: SituationFormat, device: str, license: str | None, threshold: float
) -> Manifest:
    """Make the manifest of a job, which depends only on the job's arguments."""
    described = json.loads(json.dumps(asdict(job.options), default=str), parse_constant=str)
    return {
        "warpvis_dataset": 1,
        "contents": "situations",
        "format": layout.name,
        "situations": job.plan.count,
        "shard_situations": job.plan.shard_situations,
        "generator": getattr(job.generator, "__qualname__", type(job.generator).__qualname__),
        "options": described,
        "license": license,
        "shortcut_threshold": threshold,
        "device": device,
        "versions": versions("warp-lang", "numpy", "scikit-learn", *layout.library.split()),
    }


class SituationFolder(JobFolder):
    """The folder of a job that generates situations."""

    def __init__(
        self, out: str | os.PathLike[str], job: SituationJob, layout: SituationFormat, manifest: Manifest
    ) -> None:
        """Open the store at `out`; nothing is written yet."""
        super().__init__(out, job.plan, manifest)
        self._job, self._layout = job, layout
        self.questions = 0

    def finish(self, threshold: float, command: str | None, *, allow_shortcuts: bool) -> ShortcutReport | None:
        """Test for shortcuts and write the datasheet, which completes the dataset; None if it was complete."""
        self._layout.finish(self._store, list(self._records()))
        records = list(self._records())
        total = sum(record.frames for record in records)
        shards = StoredShards(self._store, self._layout, [record.frames for record in records])
        if read_whole(self._store, INDEX_RECORD, total) is not None:
            self.questions = sum(len(situation["questions"]) for situation in shards.records())
            return None
        with self._store.new_files() as files:
            report = write_datasheet(
                files,
                shards,
                self._manifest,
                self._layout,
                self._job,
                command,
                threshold,
                columns=self._layout.columns(self._store),
                bytes=self.bytes,
            )
            if not allow_shortcuts:
                report.shortcuts.require_none()
            units = ["README.md", *self._layout.index(files, self._store)]
            commit(self._store, INDEX_RECORD, total, files, units)
        self.questions = report.questions
        return report.shortcuts

    def _records(self) -> Iterator[Record]:
        for shard in range(self._job.plan.shard_count):
            record = read_whole(self._store, shard_record(shard), None)
            if record is None:
                raise FileFormatError(f"{self.name}: shard {shard} was removed while the dataset was written")
            yield record


class _Progress:
    """Counts complete shards, and shows a progress bar."""

    def __init__(self, folder: SituationFolder, missing: Sequence[int], plan: SituationPlan, *, quiet: bool) -> None:
        self._folder, self.situations = folder, 0
        self._total = sum(map(plan.shard_limit, missing))
        self._hidden = quiet or not sys.stderr.isatty() or importlib.util.find_spec("tqdm") is None
        self._bar: tqdm | None = None

    def __enter__(self) -> _Progress:
        if not self._hidden:
            from tqdm import tqdm

            complete = self._folder.frames
            self._bar = tqdm(total=complete + self._total, initial=complete, unit=" situations", unit_scale=True)
        return self

    def __call__(self, shard: int, record: Record) -> None:
        self._folder.add(shard, record)
        self.situations += record.frames
        if self._bar is not None:
            self._bar.update(record.frames)

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()
