# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Search of the floor in the points of several depth images."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.image_cameras import ImageCamera
from warpvis.core.arrays import check_length
from warpvis.core.checks import check_number, check_whole
from warpvis.core.types import ArrayInput, PoseLike
from warpvis.errors import ArrayError
from warpvis.maps import FloorFit, back_project, fit_floor

# Points of an image, at most, and images whose points are kept.
_MAX_POINTS, _MAX_IMAGES = 5_000, 60


class FloorSearch:
    """Collects points of depth images until they show a floor with sufficient confidence.

    One image of a robot at a desk may show no floor, only the desk. The points of all images are judged together.
    """

    def __init__(
        self,
        camera: ImageCamera,
        *,
        up: ArrayLike | None = None,
        camera_height: float | None = None,
        min_confidence: float = 0.5,
        interval: int = 4,
    ) -> None:
        """Start without points.

        Args:
            camera: The camera of the images.
            up: Approximate direction up in the world of the poses, as for `fit_floor`.
            camera_height: Approximate height of the camera above the floor [m], if known, as for `fit_floor`.
            min_confidence: Minimum `FloorFit.confidence`, from 0 to 1.
            interval: Number of images between two attempts; the first image is one.
        """
        self._camera, self._up = camera, up
        self._height = None if camera_height is None else check_length(camera_height, "camera_height", zero=False)
        self._min_confidence = check_number(min_confidence, "min_confidence", minimum=0.0, maximum=1.0)
        self._interval = check_whole(interval, "interval")
        self._points: list[NDArray[np.float32]] = []
        self._count, self._stride = 0, 1
        self._failure = "there is no image"
        self.found: FloorFit | None = None
        """The floor, once its confidence is sufficient."""
        self.best: FloorFit | None = None
        """The floor of the last attempt, whatever its confidence."""

    def add(self, depth: ArrayInput, camera_to_world: PoseLike) -> FloorFit | None:
        """Add a depth image, shape ``(H, W)`` [m], and its pose; return the floor if it was found."""
        if self.found is not None:
            return self.found
        if self._count % self._stride == 0:
            self._keep(back_project(depth, self._camera, camera_to_world).numpy()[0])
        self._count += 1
        if (self._count - 1) % self._interval == 0:
            self._attempt(camera_to_world)
        return self.found

    def explain(self) -> str:
        """Return why no floor was found, and the remedy."""
        remedy = "pass the height of the camera, the direction up, or the floor"
        if self.best is None:
            return f"no floor was found in {self._count} images: {self._failure}; {remedy}"
        problems = "; ".join(self.best.problems) or "no problem was found"
        return (
            f"no floor was found in {self._count} images: the best one is {self.best.camera_height:.2f} m below the "
            f"camera, with a confidence of {self.best.confidence:.2f}, below {self._min_confidence:g} ({problems}); "
            f"{remedy}"
        )

    def _keep(self, points: NDArray[np.float32]) -> None:
        """Keep points on a regular grid of an image; of too many images, every second one."""
        step = int(np.ceil(np.sqrt(points.shape[0] * points.shape[1] / _MAX_POINTS)))
        self._points.append(points[step // 2 :: step, step // 2 :: step].reshape(-1, 3))
        if len(self._points) > _MAX_IMAGES:
            self._points, self._stride = self._points[::2], 2 * self._stride

    def _attempt(self, camera_to_world: PoseLike) -> None:
        points = np.concatenate(self._points)
        try:
            fit = fit_floor(points, None, camera_to_world, up=self._up, camera_height=self._height)
        except ArrayError as error:  # too few points, or no plane
            self._failure = str(error)
            return
        if self.best is None or fit.confidence >= self.best.confidence:
            self.best = fit
        if fit.confidence >= self._min_confidence:
            self.found = fit


def search_floor(search: FloorSearch, images: Iterable[tuple[ArrayInput, PoseLike]]) -> FloorFit:
    """Return the floor that images and their poses show.

    Raises:
        ArrayError: If they show no floor with sufficient confidence; the message names the best one and its problems.
    """
    for depth, pose in images:
        if search.add(depth, pose) is not None:
            break
    if search.found is None:
        raise ArrayError(search.explain())
    return search.found
