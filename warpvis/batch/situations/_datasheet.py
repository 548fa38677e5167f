# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The datasheet of a dataset of situations: a dataset card of Hugging Face, with the questions of Gebru et al. 2021.

Source: Datasheets for Datasets, https://arxiv.org/abs/1803.09010
"""

from __future__ import annotations

import json
import statistics
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from warpvis.batch.situations._base import SituationFormat, with_margins
from warpvis.batch.situations._pictures import MEANING
from warpvis.batch.situations._stored import StoredShards
from warpvis.core.checks import format_percent, pluralize
from warpvis.core.types import Json
from warpvis.situations import Shortcut, ShortcutReport, Situation, find_shortcuts

if TYPE_CHECKING:
    from warpvis.batch._manifest import Manifest
    from warpvis.batch.situations._job import SituationJob
    from warpvis.batch.storage._output import ShardFiles

_SIZES = ((1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"))
_MAX_LISTED = 12


@dataclass
class Composition:
    """Counts of a dataset's contents."""

    situations: int = 0
    pairs: int = 0
    participants: Counter[str] = field(default_factory=Counter)
    rooms: dict[str, set[str]] = field(default_factory=lambda: defaultdict(set))
    states: Counter[str] = field(default_factory=Counter)
    answers: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    margins: dict[tuple[str, str], list[float]] = field(default_factory=lambda: defaultdict(list))
    shortcuts: ShortcutReport = field(default_factory=lambda: ShortcutReport(()))

    @property
    def questions(self) -> int:
        """Number of questions."""
        return sum(sum(counts.values()) for counts in self.answers.values())

    def add(self, record: Mapping[str, Any]) -> None:
        """Count a situation."""
        self.situations += 1
        self.pairs += record["twin"] is not None
        self.rooms[str(record["room"].get("kind", "room"))].add(record["name"].partition("-")[0])
        moment = record["moments"][0]
        self.participants.update(f"{item['kind']}, {item['posture']}" for item in moment["participants"])
        self.states.update(sight["state"] for sight in record["sights"])
        for question in record["questions"]:
            self.answers[question["kind"]][question["answer"]] += 1
            self.margins[question["kind"], question["unit"]].append(float(question["margin"]))


def write_datasheet(
    files: ShardFiles,
    shards: StoredShards,
    manifest: Manifest,
    layout: SituationFormat,
    job: SituationJob,
    command: str | None,
    threshold: float,
    *,
    columns: Sequence[Mapping[str, Json]],
    bytes: int,
) -> Composition:
    """Count a dataset's contents, test it for shortcuts, and write ``README.md``."""
    found = Composition()

    def counted() -> Iterator[Situation]:
        for record in shards.records():
            record = with_margins(record)
            found.add(record)
            yield Situation.from_dict(record)

    found.shortcuts = find_shortcuts(counted(), threshold=threshold)
    parts = [_card(found, manifest, layout, columns), _summary(found, bytes), _composition(found), _LABELS]
    parts += [_margins(found), f"## Files\n\n{layout.description}\n\n{MEANING}\n", _FIELDS, _USES]
    parts += [_shortcuts(found.shortcuts), _regenerate(manifest, job, command)]
    files.write_text("README.md", "\n".join(parts))
    return found


def _card(
    found: Composition, manifest: Manifest, layout: SituationFormat, columns: Sequence[Mapping[str, Json]]
) -> str:
    """Return the metadata of a dataset card, in YAML."""
    size = next((name for limit, name in _SIZES if found.situations < limit), "n>1M")
    lines = ["---"]
    if manifest["license"] is not None:
        lines.append(f"license: {json.dumps(manifest['license'])}")
    lines += ["task_categories:", "- visual-question-answering", "language:", "- en", "tags:", "- synthetic"]
    lines += ["- perspective-taking", "- visibility", "- warpvis", "size_categories:", f"- {json.dumps(size)}"]
    lines += ["configs:", "- config_name: default", "  data_files:"]
    lines += [f"  - split: {layout.card['split']}", f"    path: {json.dumps(layout.card['path'])}"]
    if layout.features:  # JSON is YAML
        lines.append(f"  features: {json.dumps(layout.features)}")
    if columns:
        lines += ["dataset_info:", "  features:", *(f"  - {json.dumps(column)}" for column in columns)]
    return "\n".join([*lines, "---"]) + "\n"


def _summary(found: Composition, size: int) -> str:
    rooms = sum(map(len, found.rooms.values()))
    return f"""# Situations: who sees what

{pluralize(found.situations, "situation")} in {pluralize(rooms, "room")}, {pluralize(found.questions, "question")}, \
{size / 1e6:,.1f} MB. Generated by warpvis: people and robots among
objects in furnished rooms, what each of them sees of each object, and questions about it with answers, reasons and
margins.

## Motivation

To train and test models on visual perspective taking: what another person sees, why not, and what would change it. The
answers are computed from the geometry, with graded visible fractions, so that they do not depend on annotators.
"""


def _composition(found: Composition) -> str:
    parts = ["## Composition\n"]
    rows = []
    for kind, counts in sorted(found.answers.items()):
        common = counts.most_common()
        ordered = sorted(common, key=lambda item: (-item[1], item[0]))
        listed = ", ".join(f"{answer}: {count:,}" for answer, count in ordered[:_MAX_LISTED])
        more = f", and {len(ordered) - _MAX_LISTED:,} other answers" if len(ordered) > _MAX_LISTED else ""
        rows.append((f"`{kind}`", f"{sum(counts.values()):,}", listed + more))
    parts.append(_table(("Questions", "Number", "Answers"), rows))
    parts.append(_table(("Room", "Number"), [(kind, f"{len(items):,}") for kind, items in sorted(found.rooms.items())]))
    for title, counts in (("Participant", found.participants), ("State of an object", found.states)):
        parts.append(_table((title, "Number"), [(name, f"{count:,}") for name, count in sorted(counts.items())]))
    parts.append(
        f"{pluralize(found.pairs, 'situation')} of matched pairs: `twin` is the other one, in which only one object is "
        "moved, and an answer is the opposite.\n"
    )
    return "\n".join(parts)


def _margins(found: Composition) -> str:
    rows = [
        (f"`{kind}`", unit, f"{min(values):.3g}", f"{statistics.median(values):.3g}")
        for (kind, unit), values in sorted(found.margins.items())
    ]
    return _table(("Questions", "Unit of the margin", "Least", "Median"), rows)


def _shortcuts(report: ShortcutReport) -> str:
    parts = [_SHORTCUTS]
    rows = [_shortcut_row(item, report) for item in report.results]
    parts.append(_table(("Questions", "Shortcut", "Number", "Accuracy", "At least", "Chance", ""), rows))
    for kind, count in sorted(report.untested.items()):
        parts.append(f"`{kind}` was not tested: {pluralize(count, 'question')} are too few, or of too few rooms.\n")
    return "\n".join(parts)


def _shortcut_row(item: Shortcut, report: ShortcutReport) -> tuple[str, ...]:
    note = "diagnostic" if item.is_diagnostic else "**above the threshold**" if item in report.found else ""
    shares = (format_percent(value, digits=1) for value in (item.accuracy, item.lower_bound, item.chance))
    return (f"`{item.kind}`", f"`{item.name}`", f"{item.questions:,}", *shares, note)


def _regenerate(manifest: Manifest, job: SituationJob, command: str | None) -> str:
    versions = ", ".join(f"{name} {version}" for name, version in dict(manifest["versions"]).items())  # type: ignore[arg-type]
    code = f"    {command}\n\nor in Python\n\n" if command else ""
    return f"""## Regenerate

{code}    generate_situations(
        "OUT",
        {job.options!r},
        {manifest["generator"]},
        count={job.plan.count},
        shard_situations={job.plan.shard_situations},
        format={manifest["format"]!r},
    )

writes the same bytes with {versions}, on {manifest["device"]}. `warpvis verify OUT` compares all files with their
checksums.
"""


def _table(header: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [header, ("---",) * len(header), *rows]
    return "\n".join(f"| {' | '.join(cell.replace('|', '/') for cell in line)} |" for line in lines) + "\n"


_LABELS = """## Labels

Each label is computed by casting rays against the triangles of the scene. The `fraction` of an object is the visible
share of its silhouette from the eyes of a participant, and `error` bounds its error. `state` is why it is not visible:
hidden by `blockers`, out of the field of view, too near or too far. `margin` is how far an answer is from changing, in
`unit`; situations whose answer hangs on less than the least margin below are not in the set.
"""

_FIELDS = """Every situation has the fields `name`, `twin`, `questions` (each with `kind`, `text`, `paraphrases`, \
`choices`, `answer`,
`reason`, `about`, `margin` and `unit`), `sights`, and `record`: everything as one JSON text, with the poses of objects,
eyes and the camera, which `warpvis.batch.situations.open_situations` reads.
"""

_USES = """## Uses and limits

For training and testing perspective taking, visibility and reasoning about occlusion. The pictures are rendered: a
model that is trained on them alone may not transfer to photographs. People are simple bodies without expressions, and
rooms follow rules of furnishing, so that statistics of objects and places are not those of homes. All rooms are in one
split: keep rooms, the part of a name before `-`, together when you divide it, and both situations of a pair.
"""

_SHORTCUTS = """## Shortcuts

Models without pictures were trained on four fifths of the rooms and tested on the others, five times, as the Test-set
Stress-Test does (Brown et al. 2025, https://arxiv.org/abs/2511.04655): `text` on the words of questions, a decision
tree on each simple measure, and a random forest on all of them. "At least" is the lower bound of the accuracy at 99 %
confidence. Measures marked `diagnostic` are taken from the eyes of a participant: the angle to the gaze decides which
objects are out of view, so that they are part of the task, and may be accurate.
"""
