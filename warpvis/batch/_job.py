# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The plan of a dataset: what to render and write, divided into shards."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from warpvis.core.labels import LabelNames
from warpvis.errors import WarpvisError

if TYPE_CHECKING:
    import numpy as np

    from warpvis.cameras import ImageCamera
    from warpvis.cameras.frames import Frames
    from warpvis.rendering import DepthSensor

Options = Mapping[str, str | float]
"""A format's options by name: strings, numbers or flags."""

FRAME_ARRAYS = ("camera_to_world", "timestamps", "object_poses", "world_index")
"""Names of the arrays of `Frames`, as attributes and in files."""


class WorkerLostError(WarpvisError):
    """A process that rendered or encoded ended before its work was finished."""


@dataclass(frozen=True, eq=False)
class Plan:
    """Everything that determines the bytes of a dataset, except the scene's geometry; it can be pickled.

    Shard i contains `shard_frames` frames from ``i * shard_frames`` on; the last shard may contain fewer. Each shard is
    rendered, written and recorded as a whole.
    """

    frames: Frames
    """Poses and times of the cameras, and poses of objects; `Frames.object_poses` is set if an object is movable."""
    camera: ImageCamera
    """The camera of all frames."""
    outputs: tuple[str, ...]
    """Names of the images, and ``"visibility"`` for the results of `warpvis.object_visibility`."""
    shard_frames: int
    """Frames per shard."""
    object_names: tuple[str, ...] = ()
    """Names of all objects of the scene; values of object images are indices into them."""
    object_labels: tuple[int, ...] = ()
    """Labels of all objects of the scene."""
    label_names: LabelNames = field(default_factory=LabelNames)
    """Names of the scene's classes."""
    object_columns: tuple[int, ...] = ()
    """For every object, its column in `Frames.object_poses`; -1 for static objects."""
    object_centers: tuple[tuple[float, float, float], ...] = ()
    """Center of every object's axis-aligned bounding box in the world [m], at the pose with which it was added."""
    object_models: tuple[int, ...] = ()
    """For every object, the first movable object with the same mesh: itself, if it is the only one or static."""
    chosen: tuple[int, ...] = ()
    """Indices of the objects whose visibility is computed, in the order of its columns."""
    exclude: tuple[int, ...] = ()
    """Indices of objects that are hidden in all frames."""
    up: str = "z"
    """The world's vertical axis."""
    options: Options = field(default_factory=dict)
    """The format's options, as passed by the user."""
    sensor: DepthSensor | None = None
    """The model of a depth camera that computes depth; None for exact depth."""
    sensor_seed: int = 0
    """Seed of the sensor's random numbers, which is combined with each frame's number."""

    @property
    def has_colors(self) -> bool:
        """Whether an output depends on appearances."""
        return not {"color", "albedo"}.isdisjoint(self.outputs)

    @property
    def shard_count(self) -> int:
        """Number of shards."""
        return -(-len(self.frames) // self.shard_frames)

    def shard_slice(self, shard: int) -> slice:
        """Return the range of a shard's frames."""
        first = shard * self.shard_frames
        return slice(first, min(first + self.shard_frames, len(self.frames)))

    def shard_length(self, shard: int) -> int:
        """Return the number of frames of a shard."""
        return min(self.shard_frames, len(self.frames) - shard * self.shard_frames)


def frame_arrays(frames: Frames) -> dict[str, np.ndarray]:
    """Return the arrays of frames that are not None, by name."""
    arrays = {name: getattr(frames, name) for name in FRAME_ARRAYS}
    return {name: array for name, array in arrays.items() if array is not None}


def shard_name(shard: int) -> str:
    """Return the name of a shard in files and folders: its number, in six digits or more."""
    return f"{shard:06d}"
