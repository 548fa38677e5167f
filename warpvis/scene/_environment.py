# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The lights and the background of a scene."""

from __future__ import annotations

from collections.abc import Sequence

from warpvis.core.checks import as_items
from warpvis.errors import SceneError
from warpvis.scene.lights import Background, Light


class SceneEnvironment:
    """The lights and the background of a scene."""

    def __init__(self) -> None:
        """Create it without lights or background."""
        self._lights: tuple[Light, ...] = ()
        self._background: Background | None = None

    @property
    def lights(self) -> tuple[Light, ...]:
        """Lights in the world's frame, as loaded from a file or set; none by default.

        They shade the output ``color``. Lights that a file attaches to moving bodies stay at their initial positions.
        """
        return self._lights

    @lights.setter
    def lights(self, lights: Sequence[Light]) -> None:
        items = [lights] if isinstance(lights, Light) else as_items(lights, "lights", SceneError)
        invalid = [item for item in items if not isinstance(item, Light)]
        if invalid:
            raise SceneError(f"lights must be Lights, got {type(invalid[0]).__name__}")
        self._lights = tuple(items)

    @property
    def background(self) -> Background | None:
        """Background of rays that hit no object, as loaded from a file or set; None if not given."""
        return self._background

    @background.setter
    def background(self, background: Background | None) -> None:
        if background is not None and not isinstance(background, Background):
            raise SceneError(f"background must be a Background or None, got {type(background).__name__}")
        self._background = background

    def _take_environment(self, other: SceneEnvironment) -> None:
        self._lights, self._background = other._lights, other._background
