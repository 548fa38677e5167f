# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Define frames to render: each consists of a camera pose and a world."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras.image_cameras import ImageCamera, require_image_camera
from warpvis.core.arrays import FARTHEST, as_numpy
from warpvis.core.checks import pluralize
from warpvis.core.pose_order import warn_of_order
from warpvis.core.poses import (
    Convention,
    QuaternionOrder,
    check_convention,
    find_invalid_rows,
    poses_to_opencv,
    to_xyzw,
)
from warpvis.core.types import ArrayInput, Json, ObjectPoses, PoseLike
from warpvis.errors import ArrayError, CameraError, PoseError

# Tolerance of the squared length of a normalized quaternion. Quaternions within it are not normalized again, so that
# poses that were saved and loaded are identical to the last bit.
_UNIT_ROUNDING = 4e-15


@dataclass(frozen=True, eq=False)
class Frames:
    """V frames, each a camera pose in a world, as NumPy arrays; `from_poses` validates its arguments."""

    camera_to_world: NDArray[np.float64]
    """Rows ``x y z qx qy qz qw`` [m] of the OpenCV camera frame, unit quaternions, shape ``(V, 7)``."""
    timestamps: NDArray[np.float64]
    """Time of every frame [s], shape ``(V,)``; 0, 1, 2, ... if the source has none."""
    object_poses: NDArray[np.float32] | None = None
    """Poses of the M movable objects in W worlds, as for `Renderer.render`, shape ``(W, M, 7)``; None to keep objects
    at the poses with which they were added."""
    world_index: NDArray[np.int32] | None = None
    """World of each frame, shape ``(V,)``; None if there is one world, or if W == V and frame i has world i."""
    source: Mapping[str, Json] = field(default_factory=dict)
    """Origin of the frames, as JSON-compatible values: ``{"file": "walk.txt", "format": "tum"}``."""
    camera: ImageCamera | None = None
    """The camera of the poses, if they are from a BOP, nerfstudio or COLMAP file, or a ROS bag, that defines it."""

    def __post_init__(self) -> None:
        """Check that the shapes of the fields are consistent; `from_poses` checks the values."""
        count = _length(self.camera_to_world, "camera_to_world", (None, 7))
        _length(self.timestamps, "timestamps", (count,))
        if self.camera is not None:
            require_image_camera(self.camera)
        if not isinstance(self.source, Mapping):
            raise ArrayError(f"source must be a mapping of JSON values, got {self.source!r}")
        worlds = 1 if self.object_poses is None else _length(self.object_poses, "object_poses", (None, None, 7))
        if self.world_index is not None:
            _length(self.world_index, "world_index", (count,))
            _check_world(self.world_index, count, self.object_poses)
        elif worlds not in (1, count):
            raise ArrayError(
                f"object_poses must be of 1 world or of {pluralize(count, 'world')}, one per frame, got {worlds}. "
                "Pass world_index for any other number."
            )

    def __len__(self) -> int:
        return len(self.camera_to_world)

    def __getitem__(self, part: slice) -> Frames:
        """Return the frames of a slice; if each frame has a separate world, the worlds are sliced, too."""
        if not isinstance(part, slice):
            raise ArrayError(f"frames must be indexed by a slice, frames[a:b], got {part!r}")
        return self.take(part)

    def take(self, rows: slice | NDArray[np.integer]) -> Frames:
        """Return the frames of a slice or of indices; if each frame has a separate world, only their worlds."""
        objects = self.object_poses
        if objects is not None and self.world_index is None and len(objects) > 1:
            objects = objects[rows]
        world_index = None if self.world_index is None else self.world_index[rows]
        return Frames(self.camera_to_world[rows], self.timestamps[rows], objects, world_index, self.source, self.camera)

    def world_of(self, frame: int) -> int:
        """Return the index of a frame's world in `object_poses`."""
        if self.world_index is not None:
            return int(self.world_index[frame])
        return frame if self.object_poses is not None and len(self.object_poses) > 1 else 0

    def choose_camera(self, camera: ImageCamera | None = None) -> ImageCamera:
        """Return the camera to render the frames with: the given one, or the frames' camera.

        Raises:
            CameraError: If there is no camera, or both exist and have different pixels.
        """
        if camera is None:
            if self.camera is None:
                raise CameraError("camera must be given because the frames define none")
            return self.camera
        require_image_camera(camera)
        if self.camera is not None and not camera.has_pixels_of(self.camera):
            raise CameraError(
                f"camera must have the pixels of the frames' camera, {self.camera.describe()}, got "
                f"{camera.describe()}. Leave it out, or remove the camera of the frames: "
                "dataclasses.replace(frames, camera=None), on the command line --replace-camera"
            )
        return camera

    @classmethod
    def from_poses(
        cls,
        poses: PoseLike,
        *,
        convention: Convention = "opencv",
        quaternion: QuaternionOrder = "xyzw",
        timestamps: ArrayInput | None = None,
        object_poses: ObjectPoses = None,
        world_index: ArrayInput | None = None,
        camera: ImageCamera | None = None,
        source: Mapping[str, Json] | None = None,
    ) -> Frames:
        """Create frames from poses, check them, and normalize the camera quaternions.

        Args:
            poses: Camera-to-world poses: rows ``x y z qx qy qz qw`` [m], shape ``(V, 7)``, or matrices, shape
                ``(V, 4, 4)``.
            convention: Axes of the camera frame of the poses; see `Renderer.render`.
            quaternion: Order of the quaternions in all poses of the call, ``"xyzw"`` or ``"wxyz"``.
            timestamps: Time of every frame [s], shape ``(V,)``; 0, 1, 2, ... by default.
            object_poses: Poses of the M movable objects in W worlds, rows ``x y z qx qy qz qw`` [m], shape ``(W, M,
                7)``, or ``(M, 7)`` for one world. They are stored in single precision and not normalized; renderers
                normalize them.
            world_index: World of each frame, integers from 0 to W - 1, shape ``(V,)``.
            camera: The camera of the poses.
            source: Origin of the frames, as JSON-compatible values.

        Raises:
            PoseError: If there are no poses, or poses of cameras or objects are malformed.
            ArrayError: If timestamps, worlds or the source are malformed.
        """
        poses = to_xyzw(poses, quaternion, "poses")
        object_poses = to_xyzw(object_poses, quaternion, "object_poses")
        rows = _camera_rows(poses, convention)
        if quaternion == "xyzw":
            warn_of_order(poses, convention)
        count = len(rows)
        objects = None if object_poses is None else _object_rows(object_poses)
        worlds = None if world_index is None else _check_world(world_index, count, objects)
        return cls(rows, _check_timestamps(timestamps, count), objects, worlds, _check_source(source), camera)


def _length(array: np.ndarray, name: str, shape: tuple[int | None, ...]) -> int:
    """Return the length of an array of numbers."""
    expected = "(" + ", ".join("n" if size is None else str(size) for size in shape) + ("," * (len(shape) == 1)) + ")"
    if not isinstance(array, np.ndarray) or array.dtype.kind not in "fiu":
        raise ArrayError(
            f"{name} of frames must be a NumPy array of numbers, shape {expected}, got {type(array).__name__}"
        )
    if array.ndim != len(shape) or any(size not in (None, got) for size, got in zip(shape, array.shape, strict=True)):
        raise ArrayError(f"{name} of frames must have shape {expected}, got {array.shape}")
    return len(array)


def _camera_rows(poses: PoseLike, convention: Convention) -> NDArray[np.float64]:
    convention = check_convention(convention)
    array = as_numpy(poses, name="poses")
    if array.dtype.kind == "b":
        raise PoseError("poses must be numbers, got booleans")
    array = array.astype(np.float64)
    if not array.size:
        raise PoseError(f"there must be at least one pose, got an array of shape {array.shape}")
    _check_size(array, "poses")
    rows = poses_to_opencv(array, convention)
    if array.ndim == 2 and array.shape[1] == 7 and convention == "opencv":
        squared = np.einsum("ij,ij->i", array[:, 3:], array[:, 3:])
        unit = np.abs(squared - 1) < _UNIT_ROUNDING
        rows[unit] = array[unit]
    return rows


def _object_rows(poses: PoseLike) -> NDArray[np.float32]:
    array = as_numpy(poses, name="object_poses")
    array = array[None] if array.ndim == 2 else array
    if array.dtype.kind == "b" or array.ndim != 3 or array.shape[2] != 7 or not array.size:
        raise PoseError(
            "object_poses must have shape (W, M, 7), rows x y z qx qy qz qw of M objects in W worlds, "
            f"got {array.dtype} of shape {array.shape}"
        )
    _check_size(array.astype(np.float64), "object_poses")
    rows = array.astype(np.float32)
    problem, bad = find_invalid_rows(rows)
    if problem:
        objects = ", ".join(f"object {m} in world {w}" for w, m in np.argwhere(bad)[:3])
        raise PoseError(f"object_poses {problem}: wrong in {bad.sum()}, of {objects}")
    return rows


def _check_size(array: NDArray[np.float64], name: str) -> None:
    """Raise `PoseError` if values are not finite, or too large to be squared in single precision."""
    with np.errstate(invalid="ignore"):
        valid = np.less_equal(np.abs(np.atleast_1d(array)), FARTHEST)
    valid = np.all(valid.reshape(len(valid), -1), axis=1)
    bad = np.flatnonzero(~valid)
    if len(bad):
        raise PoseError(
            f"{name} must be finite numbers of at most 1e18: {len(bad)} of {len(valid)} are not, the first at index "
            f"{bad[0]}"
        )


def _check_timestamps(timestamps: ArrayInput | None, count: int) -> NDArray[np.float64]:
    if timestamps is None:
        return np.arange(count, dtype=np.float64)
    times = as_numpy(timestamps, name="timestamps")
    if times.dtype.kind == "b" or times.shape != (count,):
        raise ArrayError(
            f"timestamps must be {count} numbers of seconds, one per frame, got {times.dtype} of shape {times.shape}"
        )
    times = times.astype(np.float64)
    bad = np.flatnonzero(~np.isfinite(times))
    if len(bad):
        raise ArrayError(f"timestamps must be finite: {len(bad)} are not, the first at index {bad[0]}")
    return times


def _check_world(world_index: ArrayInput | None, count: int, objects: NDArray[np.float32] | None) -> NDArray[np.int32]:
    if objects is None:
        raise ArrayError("object_poses must be given with world_index, which contains indices into them")
    worlds = as_numpy(world_index, name="world_index")
    if worlds.dtype.kind not in "iu" or worlds.shape != (count,):
        raise ArrayError(
            f"world_index must be {count} whole numbers, one per frame, got {worlds.dtype} of shape {worlds.shape}"
        )
    bad = np.flatnonzero((worlds < 0) | (worlds >= len(objects)))
    if len(bad):
        raise ArrayError(
            f"world_index must be from 0 to {len(objects) - 1}, the worlds of object_poses, got {worlds[bad[0]]} for "
            f"frame {bad[0]}"
        )
    return worlds.astype(np.int32)


def _check_source(source: Mapping[str, Json] | None) -> dict[str, Json]:
    """Return the source after a JSON round trip, so that saved and loaded sources compare equal."""
    if source is None:
        return {}
    try:
        if isinstance(source, Mapping):
            return json.loads(json.dumps(dict(source), allow_nan=False))
    except (TypeError, ValueError):
        pass
    raise ArrayError(f"source must be a mapping of JSON values, got {source!r}")
