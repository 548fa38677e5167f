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
    """How many cameras."""
    worlds: int = 0
    """How many worlds."""

    def by_world(self) -> Views:
        """Show the same memory world by world: images of shape ``(W, C, height, width)``, of which nothing is copied.

        `numpy()` and DLPack of such an image have strides.
        """
        return Views(**{name: None if image is None else self._by_world(image) for name, image in _images(self)})

    def _by_world(self, image: wp.array) -> wp.array:
        return image.reshape((self.cameras, self.worlds, *image.shape[1:])).transpose((1, 0, 2, 3))


def batch_views(views: Views, cameras: int, worlds: int) -> BatchViews:
    """Say of which cameras and worlds views are: of `BatchViews`, in place.

    Raises:
        ArrayError: They are no views.
    """
    if not isinstance(views, Views):
        raise ArrayError(f"out must be warpvis.Views, got {type(views).__name__}")
    if not isinstance(views, BatchViews):
        return BatchViews(**dict(_images(views)), cameras=cameras, worlds=worlds)
    views.cameras, views.worlds = cameras, worlds
    return views


def _images(views: Views) -> list[tuple[str, wp.array]]:
    return [(field.name, getattr(views, field.name)) for field in fields(Views)]
