# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The base class of formats of datasets, and their registry."""

from __future__ import annotations

from collections import ChainMap
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias, TypeVar

import numpy as np

from warpvis.cameras import as_pinhole
from warpvis.cameras.pinhole import Camera
from warpvis.core.outputs import OUTPUTS, VISIBILITY
from warpvis.core.plugins import DATASET_FORMATS, load_plugin, plugin_names
from warpvis.errors import CameraError, FileFormatError

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.cameras.lenses import Lens
    from warpvis.core.labels import Label
    from warpvis.core.threads import Crew
    from warpvis.scene import Scene

Written = TypeVar("Written")

FORMATS = ("npz", "zarr", "png", "tum", "bop", "nerfstudio", "colmap", "ply", "ros2")
"""Names of the formats: the modules of this package, imported on demand, and their classes."""

ANY_OUTPUT: ChainMap[str, Any] = ChainMap(OUTPUTS, {VISIBILITY: None})
"""All outputs, for formats that support them all, including images that users register later."""

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
"""Arrays ``(n, K, ...)`` of the output ``"visibility"`` in a shard, with their dtypes and last axes. They are
attributes of `warpvis.visibility.ObjectVisibility`, whose `fraction` is called ``visible_fraction``."""

# Each call of NumPy acquires and releases the GIL, for which all encoding threads compete. Frames are therefore handled
# in groups, as large as fit into the cache of a core.
_PIXELS_AT_ONCE = 1 << 19

Images: TypeAlias = Mapping[str, np.ndarray]
"""Arrays of a shard's frames, by name; see `Format.write_shard`."""


class Format:
    """A layout of files. Its bytes must depend only on the plan and the images, not on the time or on random names."""

    name: ClassVar[str]
    """Name of the format, as on the command line."""
    outputs: ClassVar[Collection[str]]
    """Supported outputs."""
    default_outputs: ClassVar[tuple[str, ...]]
    """Outputs that are written by default."""
    options: ClassVar[Mapping[str, str]] = {}
    """Names of the options, with descriptions of their values for messages."""
    library: str | None = None
    """Other distributions that affect the bytes, separated by spaces; the manifest contains their versions."""
    masks: bool = False
    """Whether images of a shard must include ``"masks"`` of `visibility.ObjectVisibility`, ``(n, K, H, W)`` uint8."""
    delta: float = 0.0
    """`delta` of `warpvis.object_visibility` [m]; may be an option of the format."""
    any_depth: ClassVar[bool] = False
    """Whether visibility ignores the camera's range and includes objects at any depth."""
    object_label: ClassVar[Label | None] = None
    """Label of the objects whose visibility is computed by default; None for all objects."""
    encodes: bool = False
    """Whether encoding takes longer than writing the files."""
    encoders: Crew | None = None
    """Encoding threads, shared by all shards; if None, a shard is encoded on the thread that writes it."""

    def __init__(self, plan: Plan) -> None:
        """Prepare to write a dataset: check the outputs and the names of options of its plan."""
        unknown = sorted(plan.options.keys() - self.options.keys())
        if unknown:
            has = ", ".join(f"{option}={values}" for option, values in self.options.items()) or "none"
            raise FileFormatError(f"format {self.name!r} has no option {unknown[0]!r}; its options: {has}")
        unsupported = [output for output in plan.outputs if output not in self.outputs]
        if unsupported or not plan.outputs:
            supported, wrong = ", ".join(sorted(self.outputs)), unsupported[0] if unsupported else "none"
            raise FileFormatError(f"outputs must be from {supported} for format {self.name!r}, got {wrong}")
        self.plan = plan

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        """Write the files of one shard.

        Several threads may call this concurrently for different shards.

        Args:
            shard: Number of the shard.
            images: Arrays of its n frames by name: images ``(n, H, W)`` or ``(n, H, W, 3)`` with the dtypes of
                `warpvis.rendering.OUTPUTS`, and `VISIBILITY_ARRAYS`. They are overwritten after the call.
            files: Destination of the files.

        Returns:
            The units of the shard, relative paths of files, or of folders with files of this shard only. Each unit is
            then moved to the dataset by one rename.
        """
        raise NotImplementedError

    def begin(self, files: ShardFiles) -> list[str]:
        """Write files for the whole dataset before any shard, and return their units."""
        return []

    def index(self, files: ShardFiles) -> list[str]:
        """Write files for the whole dataset after all shards, and return their units."""
        return []

    def write_models(self, files: ShardFiles, scene: Scene) -> list[str]:
        """Write the meshes of objects, if the format includes them, and return their units; called with `index`."""
        return []

    def encode_each(self, count: int, pixels: int, work: Callable[[range], object]) -> None:
        """Call `work` for ranges of consecutive frames of a shard, on the encoding threads.

        Args:
            count: Number of frames of the shard.
            pixels: Number of pixels per frame.
            work: Function that encodes a range of frames, given by their indices in the shard.
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
    """Return the class of a format."""
    if isinstance(name, str) and name in FORMATS:
        return getattr(import_module(f"warpvis.batch.formats._{name}"), name.capitalize())
    plugin = load_plugin(DATASET_FORMATS, name) if isinstance(name, str) else None
    if plugin is None:
        names = ", ".join((*FORMATS, *plugin_names(DATASET_FORMATS)))
        raise FileFormatError(f"format must be one of {names}, got {name!r}")
    return plugin


def lens_as(plan: Plan, name: str, write: Callable[[Lens], Written]) -> Written:
    """Convert the lens of a plan's camera for a format that supports only planar depth; pinhole cameras are included.

    `write` converts a lens, or raises `CameraError`.
    """
    camera = plan.camera
    if camera.kind == "range":
        raise FileFormatError(
            f'kind of the camera must be "z" for format {name!r}, got "range", depth along the ray. {_ANY}'
        )
    try:
        return write(camera.lens)
    except CameraError as error:
        raise FileFormatError(f"format {name!r} does not support the lens: {error}. {_ANY}") from None


def require_pinhole(plan: Plan, name: str, reason: str) -> Camera:
    """Return the camera of the plan, or raise `FileFormatError` if its lens has distortion."""
    camera = as_pinhole(plan.camera)
    if camera is None:
        raise FileFormatError(
            f"camera must be a pinhole camera for format {name!r}, {reason}. The formats tum, nerfstudio, colmap and "
            f"ros2 support some lenses. {_ANY}"
        )
    return camera


_ANY = "The formats npz, zarr and png support all lenses."
