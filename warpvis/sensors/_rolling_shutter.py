# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Cameras with a rolling shutter."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import DepthKind
from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.cameras.rays import RayCamera
from warpvis.core.checks import check_choice, check_number
from warpvis.errors import CameraError

Direction = Literal["top_to_bottom", "bottom_to_top", "left_to_right", "right_to_left"]
"""Direction of readout."""


@dataclass(frozen=True)
class RollingShutter(RayCamera):
    """A camera that reads its image line by line: with a `Motion`, each line is seen from the pose at its time.

    `Renderer` and `render` accept it like the camera. With poses other than a `Motion`, the image is that of the
    camera. The first line is read at the start of the frame, and each following line ``readout / lines`` later.
    """

    camera: ImageCamera
    """A `warpvis.Camera` or `LensCamera`."""
    readout: float
    """Time in which all lines are read [s]."""
    direction: Direction = "top_to_bottom"
    """Direction of readout: ``"top_to_bottom"`` or ``"bottom_to_top"`` for rows, ``"left_to_right"`` or
    ``"right_to_left"`` for columns."""

    def __post_init__(self) -> None:
        require_image_camera(self.camera)
        object.__setattr__(self, "readout", check_number(self.readout, "readout", minimum=0.0, error=CameraError))
        check_choice(self.direction, "direction", get_args(Direction), CameraError)

    @property
    def width(self) -> int:  # type: ignore[override]
        """Image width [px]."""
        return self.camera.width

    @property
    def height(self) -> int:  # type: ignore[override]
        """Image height [px]."""
        return self.camera.height

    @property
    def near(self) -> float:  # type: ignore[override]
        """Minimum measured depth [m]."""
        return self.camera.near

    @property
    def far(self) -> float:  # type: ignore[override]
        """Maximum measured depth [m]."""
        return self.camera.far

    @property
    def kind(self) -> DepthKind | None:  # type: ignore[override]
        """Definition of depth: ``"z"``, along the axis, or ``"range"``, along the ray."""
        return self.camera.kind

    @cached_property
    def rays(self) -> NDArray[np.float64]:
        """Rays of depth 1 through the pixel centers, shape ``(height, width, 3)``; NaN where a pixel has no ray."""
        return self.camera.rays

    @cached_property
    def times(self) -> NDArray[np.float64]:
        """Time at which each pixel is read, after the start of the frame [s], shape ``(height, width)``."""
        rows = self.direction in ("top_to_bottom", "bottom_to_top")
        lines = self.height if rows else self.width
        order = np.arange(lines) if self.direction in ("top_to_bottom", "left_to_right") else np.arange(lines)[::-1]
        moments = order * (self.readout / lines)
        return np.broadcast_to(moments[:, None] if rows else moments, (self.height, self.width))

    def rays_at(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Return rays of depth 1 through image points [px], shape ``(..., 2)``; NaN outside of the image."""
        return self.camera.rays_at(pixels)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields without cached values."""
        return {"camera": self.camera, "readout": self.readout, "direction": self.direction}
