# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options of the generator of situations."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import Literal, get_args

from warpvis.core.checks import as_items, as_path, check_choice, check_whole, is_number
from warpvis.errors import SceneError
from warpvis.situations._stage_items import StageOptions
from warpvis.situations._wording import WORDINGS
from warpvis.situations.rooms import ROOM_KINDS

QUESTION_KINDS = tuple(WORDINGS)
"""The kinds of questions."""
PROCEDURAL = "procedural"
"""Name of furnished rooms among scenes."""
ImageName = Literal["color", "depth", "segmentation", "amodal_masks", "seen_by"]
"""Names of images of a situation."""


@dataclass(frozen=True)
class SituationOptions:
    """What to generate; it can be pickled."""

    seed: int = 0
    """Seed of everything."""
    rooms: tuple[str, ...] = ROOM_KINDS
    """Kinds of procedural rooms, in turns."""
    scenes: tuple[str, ...] = (PROCEDURAL,)
    """Places of the situations, in turns by shard: paths of files, and ``"procedural"`` for furnished rooms."""
    per_shard: int = 100
    """Number of situations per shard."""
    questions: tuple[str, ...] = QUESTION_KINDS
    """Kinds of questions."""
    outputs: tuple[ImageName, ...] = ("color",)
    """Images of each view: ``"color"``, ``"depth"`` and ``"segmentation"`` as in `warpvis.Views`; ``"amodal_masks"``,
    2 where an object of interest or a participant is visible, 1 elsewhere in its silhouette, else 0, shape
    ``(K, H, W)`` uint8, in the order of `Moment.things` and `Moment.participants`; ``"seen_by"``, whose bit p is set
    where participant p sees the pixel's surface, ``(H, W)`` uint8. Own bodies are in no mask, and are not seen."""
    views: str = "camera"
    """``"camera"`` for the camera of the pictures only, ``"all"`` for the participants' views, too."""
    stage: StageOptions = field(default_factory=StageOptions)
    """Who and what is in a room."""
    clutter: tuple[float, float] = (0.2, 0.7)
    """Least and greatest clutter of procedural rooms, from 0 to 1, as in `generate_room`."""

    def __post_init__(self) -> None:
        check_whole(self.seed, "seed", minimum=0, error=SceneError)
        check_whole(self.per_shard, "per_shard", error=SceneError)
        check_choice(self.views, "views", ("camera", "all"), SceneError)
        if not isinstance(self.stage, StageOptions):
            raise SceneError(f"stage must be StageOptions, got {self.stage!r}")
        ends = as_items(self.clutter, "clutter", SceneError)
        if len(ends) != 2 or not all(map(is_number, ends)) or not 0 <= ends[0] <= ends[1] <= 1:
            raise SceneError(f"clutter must be two numbers from 0 to 1 in ascending order, got {self.clutter!r}")
        object.__setattr__(self, "clutter", tuple(map(float, ends)))
        for name, known in (("rooms", ROOM_KINDS), ("questions", QUESTION_KINDS), ("outputs", get_args(ImageName))):
            items = as_items(getattr(self, name), name, SceneError)
            for item in items:
                check_choice(item, name, known, SceneError)
            if not items and name != "outputs":
                raise SceneError(f"{name} must be one or more of {', '.join(known)}, got none")
            object.__setattr__(self, name, tuple(items))
        is_one = isinstance(self.scenes, str | os.PathLike)
        paths = [self.scenes] if is_one else as_items(self.scenes, "scenes", SceneError)
        if not paths:
            raise SceneError(f'scenes must be one or more of "{PROCEDURAL}" and paths of files, got none')
        object.__setattr__(self, "scenes", tuple(os.fspath(as_path(path, "scenes")) for path in paths))
