# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The formats of datasets: what each must be able to do, and where it is found by its name."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeAlias

import numpy as np

from warpvis.errors import FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.core.labels import Label
    from warpvis.scene import Scene

_HOME = {
    "npz": ("npz", "Npz"),
    "zarr": ("zarr", "Zarr"),
    "png": ("png", "Png"),
    "tum": ("tum", "Tum"),
    "bop": ("bop", "Bop"),
    "nerfstudio": ("nerfstudio", "Nerfstudio"),
    "colmap": ("colmap", "Colmap"),
    "ply": ("ply", "Ply"),
    "ros2": ("ros2", "Ros2"),
}
"""Module and class of every format; imported when asked for."""

FORMATS = tuple(_HOME)
"""Names of the formats."""

IMAGE_DTYPES = {
    "depth": "float32",
    "points": "float32",
    "normals": "float32",
    "labels": "uint8",
    "segmentation": "int32",
}
"""Dtypes of the images' numbers in a shard."""

VISIBILITY_ARRAYS = {
    "visible_fraction": ("float32", ()),
    "visible_pixels": ("int32", ()),
    "image_pixels": ("int32", ()),
    "silhouette_pixels": ("int32", ()),
    "too_near_pixels": ("int32", ()),
    "too_far_pixels": ("int32", ()),
    "status": ("uint8", ()),
    "occluder": ("int32", ()),
    "visible_box": ("int32", (4,)),
    "silhouette_box": ("int32", (4,)),
}
"""What the output ``"visibility"`` adds to a shard: arrays ``(n, K, ...)``, their dtype and last axes. They are what
`warpvis.ObjectVisibility` has, whose `fraction` is called ``visible_fraction``."""


Images: TypeAlias = Mapping[str, np.ndarray]
"""Arrays of a shard's frames, by name; see `Format.write_shard`."""


class Format(Protocol):
    """A layout of files. Its bytes must follow from the plan and the images alone: no clock, no random names."""

    name: ClassVar[str]
    """As on the command line."""
    outputs: ClassVar[frozenset[str]]
    """Outputs that it can hold."""
    default_outputs: ClassVar[tuple[str, ...]]
    """Outputs that it holds unless told otherwise."""
    library: ClassVar[str | None] = None
    """Distributions that decide the bytes besides ours, with spaces between; the manifest names their versions."""
    masks: bool = False
    """Whether a shard's images must have ``"masks"``, of `warpvis.ObjectVisibility`, ``(n, K, H, W)`` uint8."""
    delta: float = 0.0
    """`delta` of `warpvis.object_visibility` [m]; the format may take it from the plan's options."""
    any_depth: ClassVar[bool] = False
    """Whether visibility is asked for from 0 to infinity, whatever the camera's range is."""
    object_label: ClassVar[Label | None] = None
    """Which objects visibility is of unless the job names some; None for all."""
    threads: int | None = None
    """CPU threads that encode one shard, if the format uses several; all cores of the process by default."""

    def __init__(self, plan: Plan) -> None:
        """Prepare to write a dataset.

        Raises:
            WarpvisError: The format cannot hold what the plan wants, an option is unknown, or a package is missing.
        """

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write the files of one shard.

        It is called by several threads at once, for different shards.

        Args:
            shard: Its number.
            images: Arrays of its n frames by name: ``depth (n, H, W)`` float32, ``points`` and ``normals``
                ``(n, H, W, 3)`` float32, ``labels`` uint8, ``objects`` int32; and `VISIBILITY_ARRAYS`. They are
                written over after the call.
            files: Where to write.

        Returns:
            Its units, relative paths: files, or folders that hold nothing of another shard. Each is then moved to its
            place in the dataset by one rename.
        """
        ...

    def begin(self, files: ShardFiles) -> list[str]:
        """Write what covers the whole dataset and can be said before there are shards; return the units as there."""
        return []

    def index(self, files: ShardFiles) -> list[str]:
        """Write what covers the whole dataset, after all shards, and return the units as `write_shard` does."""
        ...

    def write_models(self, files: ShardFiles, scene: Scene) -> list[str]:
        """Write the scene's objects, if there is a place for them, together with `index`; return the units as there."""
        return []


def find_format(name: str) -> type[Format]:
    """Find the format of that name.

    Raises:
        FileFormatError: There is none.
    """
    if not isinstance(name, str) or name not in _HOME:
        raise FileFormatError(f"format must be one of {', '.join(FORMATS)}, got {name!r}")
    module, kind = _HOME[name]
    return getattr(import_module(f"warpvis.batch.formats._{module}"), kind)


def check_options(plan: Plan, name: str, known: Mapping[str, str]) -> None:
    """Refuse options that a format does not have.

    Args:
        plan: The plan.
        name: The format.
        known: What it has: names and, for the message, their values.

    Raises:
        FileFormatError: There is another one.
    """
    unknown = sorted(plan.options.keys() - known.keys())
    if unknown:
        has = ", ".join(f"{option}={values}" for option, values in known.items()) or "none"
        raise FileFormatError(f"format {name!r} has no option {unknown[0]!r}; its options: {has}")
