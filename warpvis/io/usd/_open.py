# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Opening of USD stages, with errors of one sentence and without text on stderr."""

from __future__ import annotations

import contextlib
import math
import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from pxr import Ar, Gf, Tf, Usd, UsdGeom, UsdSkel, UsdUtils

from warpvis.core.checks import truncate
from warpvis.errors import FileFormatError

_TEXT, _BINARY, _ARCHIVE = b"#usda", b"PXR-USDC", b"PK"
_SUFFIXES = {".usda": _TEXT, ".usdc": _BINARY, ".usdz": _ARCHIVE}
_KINDS = {_TEXT: ("a text file", ".usda"), _BINARY: ("a binary file", ".usdc"), _ARCHIVE: ("an archive", ".usdz")}
_NAMESPACE = re.compile(r"\bpxrInternal_\w+::")
_LINE = re.compile(r"^(?P<file>.+?):(?P<line>\d+):\d+: (?P<text>.*)", re.DOTALL)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Collect the warnings that USD would print on stderr."""
    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        delegate.TakeUncoalescedDiagnostics()
        del delegate


def open_stage(path: Path, search_path: Sequence[Path]) -> Any:
    """Open a stage with all payloads; raise a `FileFormatError` with the first error of USD."""
    _require_suffix(path)
    context = Ar.DefaultResolverContext([str(folder.absolute()) for folder in search_path])
    try:
        return Usd.Stage.Open(str(path), context)
    except Tf.ErrorException as error:
        raise FileFormatError(_sentence(path, error)) from None


def composition_errors(stage: Any) -> list[str]:
    """Return what a stage references and does not contain, one sentence each."""
    texts = [str(error).strip().rstrip(".") for error in stage.GetCompositionErrors()]
    return list(dict.fromkeys(" ".join(text.split()) for text in texts))


def stage_time(stage: Any) -> Any:
    """Return the time at which a stage is read: that of its first frame, or else of the first sample."""
    if stage.HasAuthoredTimeCodeRange():
        return Usd.TimeCode(stage.GetStartTimeCode())
    return Usd.TimeCode.EarliestTime()


def bake_skins(stage: Any) -> list[str]:
    """Pose skinned meshes by their skeletons, in the stage's session layer, and return what could not be posed."""
    roots = [prim for prim in stage.Traverse() if prim.IsA(UsdSkel.Root)]
    if not roots:
        return []
    start = stage.GetStartTimeCode()
    interval = Gf.Interval(start, start) if stage.HasAuthoredTimeCodeRange() else Gf.Interval.GetFullInterval()
    target = stage.GetEditTarget()
    stage.SetEditTarget(stage.GetSessionLayer())
    notes = []
    for root in roots:
        try:
            is_baked = UsdSkel.BakeSkinning(UsdSkel.Root(root), interval)
        except Tf.ErrorException:
            is_baked = False
        notes += [] if is_baked else [f"the skeleton of <{root.GetPath()}>, whose meshes are in the bind pose"]
    stage.SetEditTarget(target)
    return notes


def stage_meters(stage: Any) -> float:
    """Return the stage's unit [m], 0.01 by default."""
    try:
        meters = float(UsdGeom.GetStageMetersPerUnit(stage))
    except Tf.ErrorException:  # it has another type
        meters = float(stage.GetRootLayer().pseudoRoot.GetInfo("metersPerUnit"))
    if not 0 < meters < math.inf:
        raise ValueError(f"metersPerUnit must be greater than 0, got {meters:g}")
    return meters


def _require_suffix(path: Path) -> None:
    """Reject a file whose content belongs to another suffix of USD."""
    try:
        with path.open("rb") as file:
            head = file.read(8)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be read: {error.strerror}") from None
    if not head:
        raise FileFormatError(f"{path}: is empty")
    expected = _SUFFIXES.get(path.suffix.lower())
    found = next((magic for magic in _KINDS if head.startswith(magic)), None)
    if expected is not None and found is not None and found != expected:
        kind, suffix = _KINDS[found]
        raise FileFormatError(f"{path}: is {kind} of USD, whose name must end in {suffix} or .usd; rename it")
    if expected == _ARCHIVE and found is None:
        raise FileFormatError(f"{path}: cannot be read as USD: it is not a zip archive")


def first_error(error: Exception) -> str:
    """Return the first error of an exception of USD, in one line."""
    texts = [str(getattr(item, "commentary", item)).strip() for item in error.args]
    return _NAMESPACE.sub("", " ".join((texts[0] if texts else str(error)).split()))


def _sentence(path: Path, error: Exception) -> str:
    """Return USD's first error as a sentence that begins with the file and the line."""
    text = first_error(error)
    match = _LINE.match(text)
    where = f"{match['file']}:{match['line']}" if match else str(path)
    return f"{where}: cannot be read as USD: {truncate(match['text'] if match else text, 300)}"
