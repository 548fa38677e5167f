# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Transforms of ROS's tf: chains of frames, interpolated at the times of images."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import truncate
from warpvis.core.messages import Message, stamp_nanoseconds
from warpvis.core.motion import rotate
from warpvis.core.poses import poses_to_opencv, quaternion_product
from warpvis.errors import FileFormatError, PoseError
from warpvis.io.recordings._poses import poses_at, unknown_poses

_MAX_GAP = 1.0
"""Maximum time from an image to the transforms before and after it that are interpolated [s]."""

# Frames that are fixed in the world. Source: REP 105, https://www.ros.org/reps/rep-0105.html
_WORLD_FRAMES = ("world", "map", "odom", "earth")


@dataclass
class _Edge:
    """Transforms from a frame to its parent."""

    parent: str
    is_static: bool
    times: list[float] = field(default_factory=list)  # [s]
    rows: list[list[float]] = field(default_factory=list)


class TransformTree:
    """Transforms of ``tf2_msgs/TFMessage`` messages."""

    def __init__(self) -> None:
        self._edges: dict[tuple[str, str], _Edge] = {}  # by child and parent

    def add(self, message: Message, *, is_static: bool) -> None:
        """Add the transforms of a message, of a topic ``tf_static`` or ``tf``."""
        for item in message.transforms:
            child, parent = frame_name(item.child_frame_id), frame_name(item.header.frame_id)
            edge = self._edges.setdefault((child, parent), _Edge(parent, is_static))
            place, turn = item.transform.translation, item.transform.rotation
            edge.times.append(1e-9 * stamp_nanoseconds(item.header.stamp))
            edge.rows.append([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])

    def poses_of(
        self, frame: str, times: NDArray[np.float64], world_frame: str | None
    ) -> tuple[NDArray[np.float64], str | None]:
        """Return the poses of a frame at times [s], shape ``(N, 7)``, and the name of the world frame.

        The world frame is by default the root of the tree. Poses are NaN, without a world frame, if the tree does not
        have the frame, or if all transforms to the root are static and it is not a frame that is fixed in the world,
        as for a camera that is carried by hand. They are NaN at times without transforms, too.
        """
        chain = self._chain(frame, world_frame)
        root = chain[-1].parent if chain else frame
        if world_frame is None and (not chain or (root not in _WORLD_FRAMES and all(edge.is_static for edge in chain))):
            return unknown_poses(len(times)), None
        poses = np.tile(np.array([0.0, 0, 0, 0, 0, 0, 1]), (len(times), 1))
        for edge in chain:
            poses = _compose(self._at(edge, times), poses)
        return poses, root

    def _chain(self, frame: str, world_frame: str | None) -> list[_Edge]:
        """Return the edges from a frame to the world frame, or to the root of the tree."""
        chain: list[_Edge] = []
        names = [frame]
        while names[-1] != world_frame:
            found = [edge for (child, _), edge in self._edges.items() if child == names[-1]]
            if len(found) > 1:
                parents = truncate(", ".join(sorted(edge.parent for edge in found)))
                raise FileFormatError(f"tf frame {names[-1]!r} has the parents {parents}; a frame has only one")
            if not found:
                break
            if found[0].parent in names:
                raise FileFormatError(f"tf frame {names[-1]!r} is in a cycle: {truncate(', '.join(names))}")
            chain += found
            names.append(found[0].parent)
        if world_frame is not None and names[-1] != world_frame:
            known = truncate(", ".join(names), 200)
            raise FileFormatError(
                f"tf has no frame {world_frame!r} above that of the images; world_frame= may be {known}"
            )
        return chain

    def _at(self, edge: _Edge, times: NDArray[np.float64]) -> NDArray[np.float64]:
        try:
            rows = poses_to_opencv(np.array(edge.rows, dtype=np.float64), name="transform")
        except PoseError as error:
            raise FileFormatError(f"tf to frame {truncate(edge.parent)!r}: {error}") from None
        if edge.is_static:
            return np.broadcast_to(rows[-1], (len(times), 7))
        return poses_at(times, np.array(edge.times), rows, max_gap=_MAX_GAP)


def frame_name(name: str) -> str:
    """Return the name of a frame without the slash that tf of ROS 1 allows."""
    return name.removeprefix("/")


def _compose(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the rows of ``T_a T_b``."""
    return np.concatenate(
        [a[:, :3] + rotate(a[:, 3:], b[:, :3]), quaternion_product(a[:, 3:], b[:, 3:])],
        axis=1,
    )
