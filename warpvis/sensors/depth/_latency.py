# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth of some frames ago: what a camera says is old when it is read."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.core.arrays import as_numpy, empty
from warpvis.core.checks import check_whole, is_number
from warpvis.core.threads import launch_images
from warpvis.core.types import ArrayInput
from warpvis.errors import ArrayError
from warpvis.rendering import OUTPUTS as EXACT_OUTPUTS, SENSOR_OUTPUTS, Views, view_numbers, views_for

_DELAYED = ("depth", "points", "reasons")
_MAX_FRAMES = 1024


class Latency:
    """Gives the depth of `frames` frames ago in place of that of now.

    Call it with the `Views` of each frame. Those that come back have `depth`, `points` and `reasons` as they were so
    many frames before, noise and all: what a device had measured then. The other images are those of now, as labels,
    normals and `true_depth` of a renderer with a sensor are exact.

    Frames are those of ``Renderer.render(frame=)``: a number for all views or one for each, which counts calls if it is
    left out. A view's frames follow one another, n, n + 1, and so on. Where its number is another than the next, the
    view begins anew, as after a world was reset: for its first `frames` frames it shows the first of them, since there
    was none before.

    It keeps `frames` + 1 images of every view, on their device: memory of that size, and one more reading and writing
    of each pixel. One object is for the views of one renderer.
    """

    def __init__(self, frames: int | ArrayInput) -> None:
        """Say how old depth is.

        Args:
            frames: A whole number from 0 up, for all views or one for each, ``(V,)``.

        Raises:
            ArrayError: `frames` is none of these, or above 1024.
        """
        self._frames = _check_delays(frames)
        self._most = int(self._frames.max(initial=0))
        self._kept: dict[str, wp.array] = {}
        # Of each view, its last frame, and how many follow one another up to it.
        self._last = self._count = np.zeros(0, dtype=np.int64)

    @property
    def frames(self) -> int | NDArray[np.int64]:
        """How many frames ago."""
        return int(self._frames) if self._frames.ndim == 0 else self._frames.copy()

    def __call__(self, views: Views, *, frame: int | ArrayInput | None = None, out: Views | None = None) -> Views:
        """Keep the images of a frame, and return those of earlier.

        Args:
            views: The images of now, with depth, of as many views and pixels in every call.
            frame: Their number, from 0 up: of all views, or of each, ``(V,)``. By default it counts calls.
            out: Views that were returned before, to write into.

        Returns:
            The same with older `depth`, `points` and `reasons`. They are images of its own, which no later call
            changes without `out`.

        Raises:
            ArrayError: There is no depth, or views are of another shape or device than before, or `frame` is no number.
        """
        from warpvis.kernels.latency import SensorImages, delay_images

        if not isinstance(views, Views):
            raise ArrayError(f"views must be warpvis.Views, got {type(views).__name__}")
        names = tuple(name for name in _DELAYED if getattr(views, name) is not None)
        if "depth" not in names:
            raise ArrayError("views must have depth, which is what is delayed")
        depth = views.depth
        numbers = self._number(len(depth), frame)
        kept = self._keep(views, names)
        written = views_for(names, depth.shape, depth.device, out)
        rows = (len(depth), depth.shape[1] if depth.ndim == 3 else 1, depth.shape[-1])
        now = SensorImages()
        for name in names:
            setattr(now, name, getattr(views, name).reshape(rows))
        given: list[Any] = [now, wp.array(self._advance(numbers), dtype=wp.vec2i, device=depth.device)]
        given += [kept[name].reshape((self._most + 1, *rows)) if name in names else None for name in _DELAYED]
        given += [getattr(written, name).reshape(rows) if name in names else None for name in _DELAYED]
        launch_images(delay_images, rows, lambda window: [window, *given], device=depth.device)
        return type(views)(**(vars(views) | {name: getattr(written, name) for name in names}))

    def reset(self, views: ArrayInput | None = None) -> None:
        """Have views begin anew with their next frame, as if they had had none.

        Args:
            views: Which, by their numbers, ``(N,)``, or a mask, ``(V,)`` bool; all by default.

        Raises:
            ArrayError: There are no such views.
        """
        if views is None:
            self._count[:] = 0
            return
        chosen = as_numpy(views.numpy() if isinstance(views, wp.array) else views, name="views")
        of_mask = chosen.dtype.kind == "b" and chosen.shape == self._count.shape
        of_numbers = chosen.ndim == 1 and chosen.dtype.kind in "iu"
        if not of_mask and not (of_numbers and ((chosen >= 0) & (chosen < len(self._count))).all()):
            raise ArrayError(f"views must be numbers of {len(self._count)} views, or a mask of them, got {views!r}")
        self._count[chosen] = 0

    def _number(self, views: int, frame: int | ArrayInput | None) -> NDArray[np.int64]:
        """Return the frame of each view."""
        if self._frames.shape not in ((), (views,)):
            raise ArrayError(f"there are {views} views, and frames of {len(self._frames)}")
        if not self._kept:
            self._last, self._count = np.full(views, -1, dtype=np.int64), np.zeros(views, dtype=np.int64)
        if frame is None:
            return np.resize(self._last + 1, views)
        return view_numbers(views, frame, None)[:, 1]

    def _keep(self, views: Views, names: tuple[str, ...]) -> dict[str, wp.array]:
        """Return memory for images, which is new in the first call."""
        shape, device = (self._most + 1, *views.depth.shape), views.depth.device
        if not self._kept:
            dtypes = EXACT_OUTPUTS | SENSOR_OUTPUTS
            self._kept = {name: empty(shape, dtypes[name], name=name, device=device) for name in names}
        known = self._kept["depth"]
        if known.shape != shape or known.device != device or set(names) != set(self._kept):
            raise ArrayError(
                f"views must be as those before, {', '.join(self._kept)} of shape {known.shape[1:]} on {known.device}, "
                f"got {', '.join(names)} of shape {shape[1:]} on {device}"
            )
        return self._kept

    def _advance(self, numbers: NDArray[np.int64]) -> NDArray[np.int32]:
        """Return where each view's image goes, and where the one is that is asked for, ``(V, 2)``."""
        self._count = np.where(numbers == self._last + 1, self._count, 0) + 1
        self._last = numbers.astype(np.int64)
        places = self._count - 1
        return np.stack([places, np.maximum(places - self._frames, 0)], axis=-1).astype(np.int32) % (self._most + 1)


def _check_delays(frames: object) -> NDArray[np.int64]:
    """Return them, one or as many as views."""
    if is_number(frames):
        delays = np.asarray(check_whole(frames, "frames", least=0))
    else:
        delays = as_numpy(frames.numpy() if isinstance(frames, wp.array) else frames, name="frames")
        if delays.ndim != 1 or delays.dtype.kind not in "iu" or (delays < 0).any():
            raise ArrayError(f"frames must be whole numbers from 0 up, one or one a view, got {frames!r}")
    if (delays > _MAX_FRAMES).any():
        raise ArrayError(f"frames must be at most {_MAX_FRAMES}, got {delays.max()}")
    return delays.astype(np.int64)
