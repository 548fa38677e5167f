# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The interface of casters, the views of a call, and memory that is created, packed or checked once for many calls."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING, Any, Protocol, TypeVar, cast

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import empty
from warpvis.core.outputs import CAST
from warpvis.core.poses import Convention
from warpvis.core.types import PoseLike
from warpvis.kernels.constants import POSE_WORDS
from warpvis.scene.worlds import part_of

if TYPE_CHECKING:
    from warpvis.kernels.casting.images import Images
    from warpvis.scene.world_appearances import DeviceAppearances

_Item = TypeVar("_Item")

ImagesByName = Mapping[str, wp.array]
"""Images to write, by the names of `warpvis.core.outputs`: those that were requested, and those that others need."""

# Maximum number of kinds of calls with cached memory. A call uses up to two: a launch, and memory for images and poses.
_MAX_KINDS = 9


class Pool:
    """Cache of unused objects by kind of call: concurrent calls on several threads take distinct objects.

    Each kind has as many objects as there were concurrent calls; the least recently created kinds are dropped.
    """

    def __init__(self, max_kinds: int = _MAX_KINDS) -> None:
        """Create an empty cache of at most `max_kinds` kinds."""
        self._items: dict[Hashable, list[Any]] = {}
        self._max_kinds = max_kinds
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy or pickle as an empty cache."""
        return Pool, (self._max_kinds,)

    def take(self, kind: Hashable) -> Any | None:
        """Remove and return an object of a kind, or return None."""
        try:
            return self._items[kind].pop()
        except (KeyError, IndexError):
            return None

    def give_back(self, kind: Hashable, item: object) -> None:
        """Return an object to the cache for the next call."""
        try:
            self._items[kind].append(item)
        except KeyError:
            with self._lock:
                while len(self._items) >= self._max_kinds:
                    del self._items[next(iter(self._items))]
                self._items[kind] = [item]

    def use(self, kind: Hashable, make: Callable[[], _Item], work: Callable[[_Item], object]) -> None:
        """Take an object of a kind, call `work` with it, and give it back; after an exception it is dropped."""
        item = self.take(kind) or make()
        work(item)
        self.give_back(kind, item)


@dataclass(frozen=True)
class CastOptions:
    """Options of a caster."""

    cull_backfaces: bool = False
    """Whether triangles seen from behind are ignored."""
    clip_near: bool = False
    """Whether surfaces nearer than the camera's `near` are cut away."""
    threads: int = 1
    """CPU threads to use."""
    pool: Pool = field(default_factory=Pool, compare=False)
    """Memory that calls reuse; the casters of a renderer share it."""


class ViewBatch:
    """The checked views of one call."""

    __slots__ = ("_device_poses", "appearances", "count", "limits", "numbers", "pixels", "poses", "used", "worlds")

    def __init__(
        self,
        poses: Any,
        worlds: Any,
        *,
        pixels: wp.array | None = None,
        limits: wp.array | None = None,
        used: wp.array | None = None,
        numbers: NDArray[np.int64] | None = None,
        appearances: DeviceAppearances | None = None,
    ) -> None:
        """Store the views.

        Args:
            poses: Camera to world, in the format of the caster's `parse_poses`.
            worlds: The world of each view, a `warpvis.kernels.casting.worlds.Worlds`.
            pixels: Image points through which to cast instead of pixel centers [px], vec2 of shape ``(V, Y, X)``, which
                is also the shape of the images; Y is 1 for lists.
            limits: Inverse depths at `pixels` beyond which surfaces are not needed [1/m], ``(V, Y, X)``: a caster may
                write the limit's depth instead. None for no limits.
            used: Number of points of each view whose images are needed, the first ones, ``(V,)`` int32. None for all.
            numbers: Number and frame of each view, which seed the random numbers of a sensor, shape ``(V, 2)``.
            appearances: Appearances of worlds; None if all have the scene's.
        """
        self.poses, self.worlds, self.pixels, self.numbers = poses, worlds, pixels, numbers
        self.appearances, self.limits, self.used = appearances, limits, used
        self.count = len(poses)
        self._device_poses: wp.array | None = poses if isinstance(poses, wp.array) else None

    def part(self, part: slice) -> ViewBatch:
        """Return a slice of the views."""
        names = "pixels", "limits", "used", "numbers"
        arrays = {name: getattr(self, name) for name in names}
        parts = {name: None if array is None else array[part] for name, array in arrays.items()}
        appearances = self.appearances
        if appearances is not None and self.worlds.world is None:
            appearances = appearances.rows(part)
        worlds = part_of(self.worlds, part)
        return ViewBatch(self.poses[part], worlds, **parts, appearances=appearances)

    def poses_on(self, device: wp.Device) -> wp.array:
        """Return the poses on a device, transforms of shape ``(V,)``."""
        if self._device_poses is None:
            self._device_poses = wp.array(self.poses, dtype=wp.transform, device=device)
        return self._device_poses

    def upload(self, scratch: Scratch) -> None:
        """Copy poses in host memory to a GPU, into memory of the call."""
        if self._device_poses is None:
            self._device_poses = scratch.upload(self.poses)


class Caster(Protocol):
    """Casts the rays of a camera into a scene."""

    def parse_poses(self, poses: PoseLike, convention: Convention) -> Any:
        """Check poses, and return them in the format that the caster reads, with a length and slices."""

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        """Write images of all views: any of depth, points, normals, labels, segmentation and faces."""


class Scratch:
    """Memory of one call on a device: for images that were not requested but are needed, and for poses.

    It is cached, since allocating arrays takes longer than copying poses to a GPU.
    """

    def __init__(self, device: wp.Device) -> None:
        """Create without memory."""
        self._device = device
        self._arrays: dict[str, wp.array] = {}
        self._items: dict[str, Any] = {}
        self._rows = np.empty((0, POSE_WORDS), dtype=np.float32)
        self._poses: tuple[wp.array, wp.array] | None = None

    def upload(self, poses: NDArray[np.float32]) -> wp.array:
        """Queue the copy of rows of poses to the GPU, and return them there.

        CUDA has read all of the source when this returns, because the memory is not pinned.
        """
        if self._poses is None or len(self._rows) != len(poses):
            self._rows = np.empty((len(poses), POSE_WORDS), dtype=np.float32)
            source = wp.array(self._rows, dtype=wp.transform, device="cpu", copy=False)
            self._poses = source, wp.empty(len(poses), dtype=wp.transform, device=self._device)
        source, target = self._poses
        self._rows[:] = poses
        wp.copy(target, source)
        return target

    def item(self, name: str, make: Callable[[], _Item]) -> _Item:
        """Return an object of an earlier call of the same kind, or make it."""
        if name not in self._items:
            self._items[name] = make()
        return cast("_Item", self._items[name])

    def array(self, name: str, shape: tuple[int, ...], dtype: type) -> wp.array:
        """Return memory of an earlier call of the same kind, or allocate it."""
        array = self._arrays.get(name)
        if array is None or array.shape != shape:
            array = self._arrays[name] = empty(shape, dtype, name=name, device=self._device)
        return array


class ImageSlots:
    """The image struct of a packed launch: a call writes the addresses of images without keeping them alive."""

    def __init__(self) -> None:
        """Create the struct without images."""
        from warpvis.kernels.casting.images import Images

        images: Any = Images()
        self.struct = images
        memory, self._slots = images.__ctype__(), []
        for name in CAST:
            self._slots.append((name, getattr(memory, name)))
        self._filled: set[str] = set()

    def fill(self, images: ImagesByName) -> None:
        """Write the addresses of a call's images."""
        for name, slot in self._slots:
            if name in images:
                slot.data = images[name].ptr
                self._filled.add(name)
            elif name in self._filled:
                slot.data = 0
                self._filled.remove(name)


def images_struct(images: ImagesByName) -> Images:
    """Make a `warpvis.kernels.casting.images.Images`; results of ray lists become images of one row."""
    from warpvis.kernels.casting.images import Images

    struct = Images()
    for name in CAST:
        if name in images:
            setattr(struct, name, as_image(images[name]))
    return struct


def as_image(array: wp.array) -> wp.array:
    """View results of ray lists, ``(V, N)``, as images of one row, ``(V, 1, N)``; others stay as they are."""
    return array if array.ndim == 3 else array.reshape((array.shape[0], 1, array.shape[1]))


def needs_ids(images: ImagesByName) -> bool:
    """Return whether any image needs object ids: all images of casters except depth and points do."""
    return any(name in images for name in CAST[2:])
