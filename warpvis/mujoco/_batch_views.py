# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of several cameras in several worlds."""

from __future__ import annotations

from dataclasses import dataclass, fields

import warp as wp

from warpvis.errors import ArrayError
from warpvis.rendering import Views


@dataclass
class BatchViews(Views):
    """Images of C cameras in W worlds, all worlds of the first camera first: ``(C * W, height, width)``."""

    cameras: int = 0
    """Number of cameras."""
    worlds: int = 0
    """Number of worlds."""

    def by_world(self) -> Views:
        """Return views of the same memory, world by world: images of shape ``(W, C, height, width)``, without a copy.

        `numpy()` and DLPack of such an image are strided.
        """
        return Views(**{name: None if image is None else self._by_world(image) for name, image in _images(self)})

    def _by_world(self, image: wp.array) -> wp.array:
        return image.reshape((self.cameras, self.worlds, *image.shape[1:])).transpose((1, 0, 2, 3))


def batch_views(views: Views, cameras: int, worlds: int) -> BatchViews:
    """Set the numbers of cameras and worlds of views; `BatchViews` are changed in place.

    Raises:
        ArrayError: If `views` is not a `Views`.
    """
    if not isinstance(views, Views):
        raise ArrayError(f"out must be warpvis.Views, got {type(views).__name__}")
    if not isinstance(views, BatchViews):
        return BatchViews(**dict(_images(views)), cameras=cameras, worlds=worlds)
    views.cameras, views.worlds = cameras, worlds
    return views


def _images(views: Views) -> list[tuple[str, wp.array]]:
    return [(field.name, getattr(views, field.name)) for field in fields(Views)]
