# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Frames to play: validation against the scene, and the object poses of a frame."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.frames import Frames
from warpvis.errors import ArrayError


def check_frames(frames: Frames | None, movable_names: Sequence[str]) -> Frames | None:
    """Return frames if they match a scene with these movable objects."""
    if frames is None:
        return None
    if not isinstance(frames, Frames) or not len(frames):
        raise ArrayError(f"frames must be a non-empty warpvis.Frames, got {type(frames).__name__}")
    num_objects = 0 if frames.object_poses is None else frames.object_poses.shape[1]
    if num_objects and num_objects != len(movable_names):
        raise ArrayError(
            f"frames must have poses of the scene's {len(movable_names)} movable objects, got {num_objects}"
        )
    return frames


def objects_in_frame(frames: Frames, number: int) -> NDArray[np.float32]:
    """Return the poses of the movable objects in a frame, ``(M, 7)``; ``(0, 7)`` if they keep their initial poses."""
    if frames.object_poses is None:
        return np.zeros((0, 7), dtype=np.float32)
    world = number if len(frames.object_poses) > 1 else 0
    world = world if frames.world_index is None else int(frames.world_index[number])
    return frames.object_poses[world]
