# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a preset is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.scene import Scene


@dataclass(frozen=True)
class ScenePreset:
    """A scene by name: its geometry, a camera and the camera's poses."""

    name: str
    """Identifier, as file names and test names show it."""
    title: str
    """What it shows, in a few words."""
    add_objects: Callable[[Scene], None]
    """Adds the objects to an empty scene."""
    camera: Camera
    """The camera the scene is seen through."""
    pose_rows: Callable[[int], NDArray[np.float64]]
    """Makes n camera-to-world poses, rows ``x y z qx qy qz qw``, shape ``(n, 7)``; the same ones every time."""

    def build(self, device: Any = "cpu") -> Scene:
        """The scene on a device."""
        scene = Scene(device=device)
        self.add_objects(scene)
        return scene

    def poses(self, count: int = 1) -> NDArray[np.float32]:
        """Camera-to-world poses, shape ``(count, 7)`` float32."""
        return self.pose_rows(count).astype(np.float32)
