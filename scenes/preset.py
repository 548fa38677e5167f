# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The type of presets."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.pinhole import Camera
from warpvis.scene import Scene


@dataclass(frozen=True)
class ScenePreset:
    """A named scene with a camera and camera poses."""

    name: str
    """Identifier, used in file names and test names."""
    title: str
    """Short description."""
    add_objects: Callable[[Scene], None]
    """Adds the objects to an empty scene."""
    camera: Camera
    """The camera."""
    pose_rows: Callable[[int], NDArray[np.float64]]
    """Returns n camera-to-world poses, rows ``x y z qx qy qz qw``, shape ``(n, 7)``, deterministically."""

    def build(self, device: Any = "cpu") -> Scene:
        """Build the scene on a device."""
        scene = Scene(device=device)
        self.add_objects(scene)
        return scene

    def poses(self, count: int = 1) -> NDArray[np.float32]:
        """Return camera-to-world poses, shape ``(count, 7)`` float32."""
        return self.pose_rows(count).astype(np.float32)
