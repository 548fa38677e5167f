# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Poses from bags of ROS 1, and of ROS 2 with sqlite3 or MCAP storage, read without ROS."""

from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from warpvis.cameras import ImageCamera
from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import truncate
from warpvis.core.file_content import reading
from warpvis.core.messages import field
from warpvis.core.user_warnings import warn_user
from warpvis.errors import CameraError, FileFormatError, IntrinsicsWarning, MessageError
from warpvis.io._bag_files import CAMERA_INFO, TRANSFORMS, BagFile
from warpvis.io.cameras._making import one_camera
from warpvis.io.poses._file_poses import FilePoses

_OPTICAL = "_optical_frame"
_LONGEST_LIST = 500
"""Maximum length of a list of names in a message [characters]."""


class _Stamped(NamedTuple):
    """One pose of a message."""

    time: float
    parent: str
    child: str
    row: list[float]


def read_bag(path: Path, *, topic: str | None = None, distortion: bool) -> FilePoses:
    """Read the poses of one topic of a bag, in the order of the bag's messages.

    The topic is one of geometry_msgs/PoseStamped, PoseWithCovarianceStamped, TransformStamped or PoseArray,
    nav_msgs/Odometry or Path, or tf2_msgs/TFMessage. A pose is that of the camera in ``header.frame_id``; transforms
    and odometry are poses of ``child_frame_id``. Both frames must be the same in all messages, since transforms are not
    chained. For a TFMessage topic with several child frames, append the camera's frame to the topic's name after a
    colon: ``/tf:camera_optical_frame``. Only the last message of a Path topic is read, and all of a
    PoseArray topic.

    Timestamps are the headers' [s]; if all are 0, they are omitted. Poses are of the OpenCV camera frame if the child
    frame's name ends in ``_optical_frame``, else of a ROS body frame.

    Args:
        path: A folder with ``metadata.yaml``, or one ``.mcap``, ``.db3`` or ``.bag`` file.
        topic: The topic; not needed if only one topic has poses.
        distortion: Whether the camera is that of the raw images, with its lens, or of the rectified ones.
    """
    name, _, child = (topic or "").partition(":")
    with reading(path, "a ROS bag"), contextlib.closing(BagFile(path)) as bag:
        types = bag.topics
        name = _choose_topic(path, types, name)
        kind = types[name]
        messages: Iterable[Any] = (message for _, _, message in bag.messages([name]))
        if kind == _PATH:
            messages = deque(messages, maxlen=1)
        poses = [pose for message in messages for pose in _POSES[kind](message)]
        infos = [bag.first(info) for info, its_kind in types.items() if its_kind == CAMERA_INFO]
        found = [info for info in infos if info is not None]
    frames, frame = _as_poses(path, name, child, poses)
    return replace(frames, camera=_choose_camera(path, found, frame, distortion))


def _choose_topic(path: Path, types: dict[str, str], topic: str) -> str:
    readable = sorted(name for name, kind in types.items() if kind in _POSES)
    known = truncate(", ".join(f"{name} ({types[name]})" for name in readable), _LONGEST_LIST) or "none"
    if not topic:
        if len(readable) != 1:
            problem = "several topics with poses; choose one as topic=" if readable else "no topic with poses"
            raise FileFormatError(f"{path}: the bag has {problem}: it has {known if readable else _all(types)}")
        return readable[0]
    if topic not in types:
        raise FileFormatError(f"{path}: the bag has no topic {topic!r}; topics with poses are: {known}")
    if topic not in readable:
        kind = truncate(types[topic])
        raise FileFormatError(
            f"{path}: topic {topic} has type {kind}, which has no poses; topics with poses are: {known}"
        )
    return topic


def _all(types: dict[str, str]) -> str:
    listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items()))
    return truncate(listed, _LONGEST_LIST) or "no topics"


def _as_poses(path: Path, topic: str, child: str, poses: list[_Stamped]) -> tuple[FilePoses, str]:
    """Select the poses of one child frame, returned too, and check that they have the same parent frame."""
    place = f"{path}: topic {truncate(topic)}"
    if not poses:
        raise FileFormatError(f"{place} holds no poses")
    children = sorted({pose.child for pose in poses})
    if child:
        if child not in children:
            known = truncate(", ".join(filter(None, children)), _LONGEST_LIST) or "none"
            raise FileFormatError(f"{place} has no child frame {child!r}; it has {known}")
        poses, children = [pose for pose in poses if pose.child == child], [child]
    if len(children) > 1:
        raise FileFormatError(
            f"{place} has the child frames {truncate(', '.join(children), _LONGEST_LIST)}; choose one as "
            f"topic='{truncate(topic)}:{truncate(children[0])}'"
        )
    parents = sorted({pose.parent for pose in poses})
    if len(parents) > 1:
        known = truncate(", ".join(parents), _LONGEST_LIST)
        raise FileFormatError(f"{place} has poses in the frames {known}, and transforms are not chained")
    times = np.array([pose.time for pose in poses])
    frames = FilePoses(
        np.array([pose.row for pose in poses], dtype=np.float64),
        lambda index: f"{place}: pose {index}",
        "opencv" if children[0].endswith(_OPTICAL) else "ros_body",
        times if times.any() else None,
        details={"topic": f"{topic}:{child}" if child else topic},
    )
    return frames, children[0]


def _choose_camera(path: Path, infos: list[Any], frame: str, distortion: bool) -> ImageCamera | None:
    """Return the camera of the CameraInfos with the poses' frame, or of the bag's only CameraInfo."""
    of_frame = [info for info in infos if frame and info.header.frame_id == frame]
    chosen = of_frame or (infos if len(infos) == 1 else [])
    cameras = [camera_of_info(path, info, distortion) for info in chosen]
    return None if None in cameras else one_camera([camera for camera in cameras if camera is not None], str(path))


def camera_of_info(place: object, info: Any, distortion: bool) -> ImageCamera | None:
    """Return the camera of a CameraInfo; warn and return None if it is not valid.

    It is that of the raw images if `distortion` is set and `D` is not zero, else of the rectified images.
    """
    try:
        raw = distortion and np.any(field(info, "d", "D"))
        return Camera.from_raw_camera_info(info) if raw else Camera.from_camera_info(info)
    except (CameraError, MessageError) as error:
        warn_user(f"{place}: its CameraInfo is not a valid camera: {error}", IntrinsicsWarning)
        return None


def _stamped(header: Any, place: Any, turn: Any, child: str = "") -> _Stamped:
    time = header.stamp.sec + 1e-9 * header.stamp.nanosec
    return _Stamped(time, header.frame_id, child, [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])


def _posed(header: Any, pose: Any, child: str = "") -> _Stamped:
    return _stamped(header, pose.position, pose.orientation, child)


def _transformed(item: Any) -> _Stamped:
    return _stamped(item.header, item.transform.translation, item.transform.rotation, item.child_frame_id)


_PATH = "nav_msgs/msg/Path"

# Poses of a message, by its type. The poses of a Path often have an empty frame_id.
_POSES: dict[str, Callable[[Any], list[_Stamped]]] = {
    "geometry_msgs/msg/PoseStamped": lambda message: [_posed(message.header, message.pose)],
    "geometry_msgs/msg/PoseWithCovarianceStamped": lambda message: [_posed(message.header, message.pose.pose)],
    "geometry_msgs/msg/TransformStamped": lambda message: [_transformed(message)],
    "geometry_msgs/msg/PoseArray": lambda message: [_posed(message.header, pose) for pose in message.poses],
    "nav_msgs/msg/Odometry": lambda message: [_posed(message.header, message.pose.pose, message.child_frame_id)],
    _PATH: lambda message: [
        _posed(item.header, item.pose)._replace(parent=message.header.frame_id) for item in message.poses
    ],
    **dict.fromkeys(TRANSFORMS, lambda message: [_transformed(item) for item in message.transforms]),
}
