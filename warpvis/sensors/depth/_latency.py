# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Latency of depth cameras."""

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
from warpvis.rendering import Views, pixel_type, view_numbers, views_for
from warpvis.sensors._echoes import require_image

_DELAYED = ("depth", "points", "reasons")
_MAX_FRAMES = 1024


class Latency:
    """Delay of depth by a number of frames.

    Call it with the `Views` of each frame. The returned views have the `depth`, `points` and `reasons` of an earlier
    frame, including its noise. The other images are those of the current frame.

    Frames are numbered as in ``Renderer.render(frame=)``: one number for all views or one per view; by default calls
    are counted. Consecutive frames of a view have the numbers n, n + 1, and so on. Any other number restarts the view,
    as after the reset of a world: its first `frames` frames then show the first of them.

    It stores the last ``frames + 1`` images of each view on their device. Use one object for the views of one renderer.
    """

    def __init__(self, frames: int | ArrayInput) -> None:
        """Create a delay.

        Args:
            frames: Number of frames by which depth is delayed, from 0 to 1024, for all views or for each, ``(V,)``.
        """
        self._frames = _check_delays(frames)
        self._max_delay = int(self._frames.max(initial=0))
        self._history: dict[str, wp.array] = {}
        # The last frame of each view, and the number of consecutive frames up to it.
        self._last = self._count = np.zeros(0, dtype=np.int64)

    @property
    def frames(self) -> int | NDArray[np.int64]:
        """Number of frames by which depth is delayed."""
        return int(self._frames) if self._frames.ndim == 0 else self._frames.copy()

    def __call__(self, views: Views, *, frame: int | ArrayInput | None = None, out: Views | None = None) -> Views:
        """Store the images of a frame, and return the views with delayed images.

        Args:
            views: Images of the current frame, with depth; their shape must be the same in all calls.
            frame: Number of the frame, for all views or for each, ``(V,)``. By default, calls are counted.
            out: The result of an earlier call, to be overwritten.

        Returns:
            The views with delayed `depth`, `points` and `reasons`. These are copies: later calls do not change them
            unless they are passed as `out`.
        """
        from warpvis.kernels.sensors.latency import SensorImages, delay_images

        depth = require_image(views, "depth")
        names = tuple(name for name in _DELAYED if getattr(views, name) is not None)
        numbers = self._number(len(depth), frame)
        history = self._allocate(views, names)
        written = views_for(names, depth.shape, depth.device, out)
        rows = (len(depth), depth.shape[1] if depth.ndim == 3 else 1, depth.shape[-1])
        current = SensorImages()
        for name in names:
            setattr(current, name, getattr(views, name).reshape(rows))
        self._count = np.where(numbers == self._last + 1, self._count, 0) + 1
        self._last = numbers.astype(np.int64)
        # Slots of the ring buffer: of the current and of the delayed image of each view.
        slots = np.stack([self._count - 1, np.maximum(self._count - 1 - self._frames, 0)], axis=-1).astype(np.int32)
        inputs: list[Any] = [current, wp.array(slots % (self._max_delay + 1), dtype=wp.vec2i, device=depth.device)]
        inputs += [history[name].reshape((self._max_delay + 1, *rows)) if name in names else None for name in _DELAYED]
        inputs += [getattr(written, name).reshape(rows) if name in names else None for name in _DELAYED]
        launch_images(delay_images, rows, lambda window: [window, *inputs], device=depth.device)
        return type(views)(**(vars(views) | {name: getattr(written, name) for name in names}))

    def reset(self, views: ArrayInput | None = None) -> None:
        """Discard the stored images of views: the next frame is their first.

        Args:
            views: Indices of the views, ``(N,)``, or a mask, ``(V,)`` bool; all by default.
        """
        if views is None:
            self._count[:] = 0
            return
        chosen = as_numpy(views, name="views")
        is_mask = chosen.dtype.kind == "b" and chosen.shape == self._count.shape
        is_indices = chosen.ndim == 1 and chosen.dtype.kind in "iu"
        if not is_mask and not (is_indices and ((chosen >= 0) & (chosen < len(self._count))).all()):
            raise ArrayError(f"views must be indices of the {len(self._count)} views or a mask of them, got {views!r}")
        self._count[chosen] = 0

    def _number(self, views: int, frame: int | ArrayInput | None) -> NDArray[np.int64]:
        """Return the frame number of each view."""
        if self._frames.shape not in ((), (views,)):
            raise ArrayError(f"frames must be one for each of the {views} views, got {len(self._frames)}")
        if not self._history:
            self._last, self._count = np.full(views, -1, dtype=np.int64), np.zeros(views, dtype=np.int64)
        if frame is None:
            return np.resize(self._last + 1, views)
        return view_numbers(views, frame, None)[:, 1]

    def _allocate(self, views: Views, names: tuple[str, ...]) -> dict[str, wp.array]:
        """Return the ring buffers of images; allocate them in the first call."""
        shape, device = (self._max_delay + 1, *views.depth.shape), views.depth.device
        if not self._history:
            self._history = {name: empty(shape, pixel_type(name), name=name, device=device) for name in names}
        stored = self._history["depth"]
        if stored.shape != shape or stored.device != device or set(names) != set(self._history):
            raise ArrayError(
                f"views must be as in earlier calls, {', '.join(self._history)} of shape {stored.shape[1:]} on "
                f"{stored.device}, got {', '.join(names)} of shape {shape[1:]} on {device}"
            )
        return self._history


def _check_delays(frames: object) -> NDArray[np.int64]:
    """Check delays, a single one or one per view, and return them."""
    if is_number(frames):
        delays = np.asarray(check_whole(frames, "frames", minimum=0))
    else:
        delays = as_numpy(frames, name="frames")
        if delays.ndim != 1 or delays.dtype.kind not in "iu" or (delays < 0).any():
            raise ArrayError(f"frames must be whole numbers from 0 up, one or one per view, got {frames!r}")
    if (delays > _MAX_FRAMES).any():
        raise ArrayError(f"frames must be at most {_MAX_FRAMES}, got {delays.max()}")
    return delays.astype(np.int64)
