# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What is made, packed and checked once for calls of a kind, and waits for the next one."""

from __future__ import annotations

import weakref
from collections.abc import Hashable
from threading import Lock
from typing import Any, Generic, TypeVar

import warp as wp

from warpvis.rendering._views import ALL_OUTPUTS, CAST_OUTPUTS, Views

_Thing = TypeVar("_Thing")


class Idle(Generic[_Thing]):
    """Things that no call uses at the moment, by the kind of call that may: callers on several threads take their own.

    Of each kind there are as many as calls were made at the same time; kinds that have not come last are forgotten.
    """

    def __init__(self, most_kinds: int) -> None:
        """Have nothing yet; keep at most so many kinds."""
        self._things: dict[Hashable, list[_Thing]] = {}
        self._most_kinds = most_kinds
        self._lock = Lock()

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy, also to another process, as one that has nothing yet."""
        return Idle, (self._most_kinds,)

    def take(self, kind: Hashable) -> _Thing | None:
        """Take a thing of a kind, if there is one."""
        try:
            return self._things[kind].pop()
        except (KeyError, IndexError):
            return None

    def give_back(self, kind: Hashable, thing: _Thing) -> None:
        """Have it wait for the next call."""
        try:
            self._things[kind].append(thing)
        except KeyError:
            with self._lock:
                while len(self._things) >= self._most_kinds:
                    del self._things[next(iter(self._things))]
                self._things[kind] = [thing]


def memory_of(struct: Any) -> Any:
    """Return the memory of a struct of Warp's, as ctypes has it: a launch that is packed reads it when it is made."""
    return struct.__ctype__()


class ImageSlots:
    """Images as a packed launch reads them: a call writes their addresses, and keeps none of them alive."""

    def __init__(self) -> None:
        """Have no images."""
        from warpvis.kernels.images import Images

        self.struct = Images()
        self._slots = [getattr(memory_of(self.struct), name) for name in CAST_OUTPUTS]
        self._filled = [False] * len(CAST_OUTPUTS)

    def fill(self, images: list[wp.array | None]) -> None:
        """Write where the images of a call are; None is not made."""
        for index, image in enumerate(images[: len(CAST_OUTPUTS)]):
            if image is not None:
                self._slots[index].data = image.ptr
                self._filled[index] = True
            elif self._filled[index]:
                self._slots[index].data = 0
                self._filled[index] = False


class CheckedImages:
    """The images of `out` of the last call that gave some: the same ones need not be checked again."""

    def __init__(self) -> None:
        """Know none."""
        self._last: tuple[tuple[int, ...], tuple[str, ...], list[Any]] = ((), (), [])

    def __reduce__(self) -> tuple[Any, ...]:
        """Copy as one that knows none."""
        return CheckedImages, ()

    def find(self, out: Views, shape: tuple[int, ...], outputs: tuple[str, ...]) -> list[wp.array | None] | None:
        """Return the images, in the casters' order, if they are those of the last call; None is not asked for."""
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

    def keep(self, images: list[wp.array | None], shape: tuple[int, ...], outputs: tuple[str, ...]) -> None:
        """Take note of images that were checked, without keeping them alive."""
        self._last = shape, outputs, [None if image is None else weakref.ref(image) for image in images]
