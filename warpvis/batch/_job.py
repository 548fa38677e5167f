# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What is to be rendered and written: the plan of a dataset, cut into shards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from warpvis.core.labels import LabelNames

if TYPE_CHECKING:
    import numpy as np

    from warpvis.core.frames import Frames
    from warpvis.rendering import DepthSensor
    from warpvis.sensors import CalibratedCamera

Options = Mapping[str, str | float]
"""A format's options by name: texts, numbers or flags."""


FRAME_ARRAYS = ("camera_to_world", "timestamps", "object_poses", "world_index")
"""Names of the arrays of `Frames`, there and in files."""


@dataclass(frozen=True, eq=False)
class Plan:
    """All that decides the bytes of a dataset, but for the scene's geometry; it pickles.

    Shard i holds the frames from ``i * shard_frames`` on, the last one maybe fewer. It is rendered, written and
    recorded as a whole.
    """

    frames: Frames
    """The cameras' poses and times, and where the objects are; `Frames.object_poses` is there if anything moves."""
    camera: CalibratedCamera
    """The camera of all frames."""
    outputs: tuple[str, ...]
    """Names of the images, and ``"visibility"`` for what `warpvis.object_visibility` says."""
    shard_frames: int
    """Frames of a shard."""
    object_names: tuple[str, ...] = ()
    """Names of all objects of the scene: values of object images index them."""
    object_labels: tuple[int, ...] = ()
    """Their labels."""
    label_names: LabelNames = field(default_factory=LabelNames)
    """Names of the scene's classes."""
    object_columns: tuple[int, ...] = ()
    """For every object, the column of `Frames.object_poses` that places it; -1 if it stays where it is."""
    object_centers: tuple[tuple[float, float, float], ...] = ()
    """Middle of every object's axis-aligned box in the world [m], where it was added."""
    object_models: tuple[int, ...] = ()
    """For every object, the first object that moves and has the same mesh: itself, if it is the only one or stays."""
    chosen: tuple[int, ...] = ()
    """Indices of the objects that visibility is of, in the order of its columns."""
    exclude: tuple[int, ...] = ()
    """Indices of objects that no frame shows."""
    up: str = "z"
    """The world's vertical axis."""
    options: Options = field(default_factory=dict)
    """The format's options, as the user gave them."""
    sensor: DepthSensor | None = None
    """The model of a depth camera that makes depth; None for exact depth."""
    sensor_seed: int = 0
    """What its random numbers follow from, beside each frame's number."""

    @property
    def shard_count(self) -> int:
        """How many shards there are."""
        return -(-len(self.frames) // self.shard_frames)

    def shard_slice(self, shard: int) -> slice:
        """Return the range of a shard's frames."""
        first = shard * self.shard_frames
        return slice(first, min(first + self.shard_frames, len(self.frames)))


def frame_arrays(frames: Frames) -> dict[str, np.ndarray]:
    """Return the arrays that frames have, by name."""
    arrays = {name: getattr(frames, name) for name in FRAME_ARRAYS}
    return {name: array for name, array in arrays.items() if array is not None}


def shard_name(shard: int) -> str:
    """Name a shard in files and folders: its number, in six digits or more."""
    return f"{shard:06d}"
