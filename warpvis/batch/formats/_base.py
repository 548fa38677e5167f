# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The formats of datasets: what each must be able to do, and where it is found by its name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, ClassVar, Protocol, TypeAlias, TypeVar

import numpy as np

from warpvis.core.camera import Camera
from warpvis.errors import CameraError, FileFormatError
from warpvis.sensors.lenses import OpenCVPinhole

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.core.labels import Label
    from warpvis.core.threads import Crew
    from warpvis.scene import Scene
    from warpvis.sensors.lenses import Lens

Written = TypeVar("Written")

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
    "faces": "int32",
    "color": "uint8",
    "albedo": "uint8",
    "reasons": "uint8",
    "true_depth": "float32",
}
"""Dtypes of the images' numbers in a shard."""

VECTOR_IMAGES = ("points", "normals", "color", "albedo")
"""Images of three numbers a pixel."""

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


# Each call of NumPy takes and lets go of the interpreter's lock, for which all threads that encode compete: frames are
# handled by a few at once, as many as fit into a core's cache.
_PIXELS_AT_ONCE = 1 << 19

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
    encodes: bool = False
    """Whether making its files takes a processor longer than writing them."""
    encoders: Crew | None = None
    """Threads that encode, the same ones for all shards; without, the thread that writes a shard does."""

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

    def encode_each(self, count: int, pixels: int, work: Callable[[range], object]) -> None:
        """Call `work` for all frames of a shard, for a few neighbouring ones at a time, on the threads that encode.

        Args:
            count: Frames of the shard.
            pixels: Pixels of a frame.
            work: Encodes frames of those numbers in the shard.
        """
        threads = 1 if self.encoders is None else self.encoders.threads
        step = max(1, min(_PIXELS_AT_ONCE // pixels, -(-count // threads)))
        parts = [range(first, min(first + step, count)) for first in range(0, count, step)]
        if self.encoders is not None:
            self.encoders.each(work, parts)
        else:
            for part in parts:
                work(part)


def find_format(name: str) -> type[Format]:
    """Find the format of that name.

    Raises:
        FileFormatError: There is none.
    """
    if not isinstance(name, str) or name not in _HOME:
        raise FileFormatError(f"format must be one of {', '.join(FORMATS)}, got {name!r}")
    module, kind = _HOME[name]
    return getattr(import_module(f"warpvis.batch.formats._{module}"), kind)


def lens_as(plan: Plan, name: str, write: Callable[[Lens], Written]) -> Written:
    """Return the lens of a plan's camera as a format writes it, whose depth is along the axis; a pinhole has one, too.

    Args:
        plan: The plan.
        name: The format.
        write: Makes of a lens what the format says, or raises `CameraError`.

    Raises:
        FileFormatError: The format has no such lens, or the camera's depth is along the ray.
    """
    camera = plan.camera
    if isinstance(camera, Camera):
        return write(OpenCVPinhole(camera.fx, camera.fy, camera.cx, camera.cy))
    if camera.kind == "range":
        raise FileFormatError(
            f'format {name!r} holds depth along the axis, and the camera\'s is along the ray (kind="range"): {_ANY}'
        )
    try:
        return write(camera.lens)
    except CameraError as error:
        raise FileFormatError(f"format {name!r} cannot say the camera's lens: {error}; {_ANY}") from None


def refuse_lens(plan: Plan, name: str, why: str) -> None:
    """Refuse a camera with a lens.

    Raises:
        FileFormatError: The plan's has one.
    """
    if not isinstance(plan.camera, Camera):
        raise FileFormatError(
            f"format {name!r} is for pinholes, {why}: tum, nerfstudio, colmap and ros2 say some; {_ANY}"
        )


_ANY = "npz, zarr and png say any"


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
