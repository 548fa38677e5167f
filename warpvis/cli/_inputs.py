# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What the commands read from the words of the command line, and how they write: nothing heavy until it is called."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpvis.errors import FileFormatError, PoseError, SceneError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.core.poses import Convention


def parse_labels(words: Sequence[str]) -> dict[str, str]:
    """Labels by name or pattern, from words ``name=label``.

    Raises:
        SceneError: A word is not of that form.
    """
    labels = {}
    for word in words:
        name, equals, label = word.rpartition("=")
        if not (equals and name and label):
            raise SceneError(f"labels must be given as NAME=LABEL, such as ball=object, got {word!r}")
        labels[name] = label
    return labels


def parse_viewpoint(text: str, option: str, up: str, convention: Convention) -> NDArray[np.float64]:
    """A pose from six numbers, eye and target, or from seven, a row.

    Args:
        text: ``x y z tx ty tz``, or ``x y z qx qy qz qw`` for the axes of `convention`.
        option: What messages call it.
        up: The world's vertical axis, which points up in the images of the first form.
        convention: Axes of the camera frame of the second form.

    Returns:
        Row ``x y z qx qy qz qw`` of the OpenCV frame, shape ``(7,)``.

    Raises:
        PoseError: It is neither.
    """
    from warpvis.core.poses import look_at, poses_to_opencv

    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) not in (6, 7):
        raise PoseError(
            f"{option} must be 6 numbers, where the eyes are and what they look at, 'x y z tx ty tz' (metres), "
            f"or a pose of 7, 'x y z qx qy qz qw', got {text!r}"
        )
    if len(numbers) == 7:
        return poses_to_opencv(numbers, convention, name=option)[0]
    try:
        return look_at(numbers[:3], numbers[3:], up=up)
    except PoseError as error:
        raise PoseError(f"{option}: {error}") from None


def make_folder(path: Path) -> None:
    """Make a folder and those above it.

    Raises:
        FileFormatError: It cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be made a folder: {error.strerror}") from None


def require_place(path: Path, suffixes: Sequence[str]) -> None:
    """Refuse, before anything is computed, a file that could not be written.

    Raises:
        FileFormatError: Its name has another ending, it is a folder, or the folder for it is missing.
    """
    if path.suffix.lower() not in suffixes:
        raise FileFormatError(f"{path}: the name must end in {' or '.join(suffixes)}")
    if path.is_dir():
        raise FileFormatError(f"{path}: cannot be written: it is a folder")
    if not path.parent.is_dir():
        raise FileFormatError(f"{path}: cannot be written: there is no folder {path.parent}")


def write_json(path: Path, content: Any) -> None:
    """Write plain Python values as JSON.

    Raises:
        FileFormatError: The file cannot be written.
    """
    try:
        path.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    except OSError as error:
        raise FileFormatError(f"{path}: cannot be written: {error.strerror}") from None


def format_rows(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of fixed width as text."""
    widths = [max(map(len, column)) for column in zip(header, *rows, strict=True)]
    lines = [header, ["-" * width for width in widths], *rows]
    return "\n".join("  ".join(map(str.ljust, line, widths)).rstrip() for line in lines)
