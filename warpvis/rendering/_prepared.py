# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Caches of objects that are created, packed or checked once and reused by later calls of the same kind."""

from __future__ import annotations

import weakref
from collections.abc import Hashable
from threading import Lock
from typing import Any, Generic, TypeVar

import warp as wp

from warpvis.rendering._views import ALL_OUTPUTS, CAST_OUTPUTS, Views

_Item = TypeVar("_Item")


class FreeList(Generic[_Item]):
    """Cache of unused objects by kind of call: concurrent calls on several threads take distinct objects. Each kind has
    as many objects as there were concurrent calls; the least recently used kinds are dropped.
    """

    def __init__(self, max_kinds: int) -> None:
        """Create an empty cache of at most `max_kinds` kinds."""
        self._items: dict[Hashable, list[_Item]] = {}
        self._max_kinds = max_kinds
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy or pickle as an empty cache."""
        return FreeList, (self._max_kinds,)

    def take(self, kind: Hashable) -> _Item | None:
        """Remove and return an object of a kind; None if there is none."""
        try:
            return self._items[kind].pop()
        except (KeyError, IndexError):
            return None

    def give_back(self, kind: Hashable, item: _Item) -> None:
        """Return an object to the cache for the next call."""
        try:
            self._items[kind].append(item)
        except KeyError:
            with self._lock:
                while len(self._items) >= self._max_kinds:
                    del self._items[next(iter(self._items))]
                self._items[kind] = [item]


def memory_of(struct: Any) -> Any:
    """Return the ctypes memory of a Warp struct, which a packed launch reads when it is launched."""
    return struct.__ctype__()


class ImageSlots:
    """The image struct of a packed launch: a call writes the addresses of images without keeping them alive."""

    def __init__(self) -> None:
        """Create the struct without images."""
        from warpvis.kernels.casting.images import Images

        self.struct = Images()
        self._slots = [getattr(memory_of(self.struct), name) for name in CAST_OUTPUTS]
        self._filled = [False] * len(CAST_OUTPUTS)

    def fill(self, images: list[wp.array | None]) -> None:
        """Write the addresses of a call's images; None is left out."""
        for index, image in enumerate(images[: len(CAST_OUTPUTS)]):
            if image is not None:
                self._slots[index].data = image.ptr
                self._filled[index] = True
            elif self._filled[index]:
                self._slots[index].data = 0
                self._filled[index] = False


class CheckedImages:
    """The images of the last `out` argument, which need not be checked again."""

    def __init__(self) -> None:
        """Create without images."""
        self._last: tuple[tuple[int, ...], tuple[str, ...], list[Any]] = ((), (), [])

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy or pickle without images."""
        return CheckedImages, ()

    def find(self, out: Views, shape: tuple[int, ...], outputs: tuple[str, ...]) -> list[wp.array | None] | None:
        """Return the checked images in the casters' order if they are those of the last call, else None."""
        last_shape, last_outputs, last_images = self._last
        if shape != last_shape or outputs is not last_outputs or not isinstance(out, Views):
            return None
        images: list[wp.array | None] = []
        for name, last in zip(ALL_OUTPUTS, last_images, strict=False):
            image = None if last is None else getattr(out, name)
            if last is not None and (image is None or image is not last()):
                return None
            images.append(image)
        return images

    def record(self, images: list[wp.array | None], shape: tuple[int, ...], outputs: tuple[str, ...]) -> None:
        """Record checked images without keeping them alive."""
        self._last = shape, outputs, [None if image is None else weakref.ref(image) for image in images]
