# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Read camera poses: camera to world, rows ``x y z qx qy qz qw`` or 4x4 matrices, in several conventions of axes."""

from __future__ import annotations

import math
from typing import Literal, get_args

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, as_point, get_device, on_gpu, share
from warpvis.core.device_poses import from_foreign, parse_on_device, to_xyzw_on_device
from warpvis.core.types import DeviceLike, PoseLike
from warpvis.errors import PoseError

Convention = Literal["opencv", "opengl", "ros_body", "ros_optical"]

QuaternionOrder = Literal["xyzw", "wxyz"]

# Quaternion (x, y, z, w) of the OpenCV camera frame (x right, y down, z forward) in each frame that poses may be given
# for: OpenGL is x right, y up, z backward; ROS bodies (REP 103) are x forward, y left, z up; ROS's optical frames are
# OpenCV's.
_OPENCV_TO: dict[str, tuple[float, float, float, float]] = {
    "opencv": (0.0, 0.0, 0.0, 1.0),
    "opengl": (1.0, 0.0, 0.0, 0.0),
    "ros_body": (-0.5, 0.5, -0.5, 0.5),
    "ros_optical": (0.0, 0.0, 0.0, 1.0),
}

# Shapes of a single pose, and a limit of coordinates that are finite in single precision.
_ONE_ROW, _ONE_MATRIX = ((1, 7), (7,)), ((1, 4, 4), (4, 4))
_MAX_COORDINATE = 1e30

# Maximum deviation of a rotation from orthonormality: matrices printed with four decimals pass, scaled ones do not.
_ROTATION_TOLERANCE = 1e-3

_FINITE_REMEDY = "; leave out views without a pose, as Recording.posed does"

LENGTH_TOLERANCE = 1e-3
"""Maximum deviation of the length of a quaternion from 1: quaternions printed with three decimals pass."""

# Limits of the squared length in single precision, within which the length is certainly within its tolerance.
_MIN_SQUARE, _MAX_SQUARE = 1 - 1.9 * LENGTH_TOLERANCE, 1 + 1.9 * LENGTH_TOLERANCE


def parse_poses(
    poses: PoseLike,
    *,
    convention: Convention = "opencv",
    axes: Convention = "opencv",
    device: DeviceLike = "cpu",
    name: str = "camera_to_world",
) -> wp.array:
    """Check poses, and convert them to transforms for casters.

    Poses on the host are checked one by one. Poses on a GPU are not copied to the host: only their shape, dtype and
    device are checked.

    Args:
        poses: Camera-to-world poses: rows ``x y z qx qy qz qw`` [m], shape ``(V, 7)`` or ``(7,)`` for one view, or
            matrices, shape ``(V, 4, 4)`` or ``(4, 4)``.
        convention: Axes of the camera frame the poses are for: ``"opencv"`` (x right, y down, z forward), ``"opengl"``
            (x right, y up, z backward), ``"ros_body"`` (x forward, y left, z up) or ``"ros_optical"`` (as OpenCV).
        axes: Axes of the frame of the result.
        device: Device of the result.
        name: Name of the poses in messages.

    Returns:
        Poses of the camera frame of those axes, shape ``(V,)`` `wp.transform` on `device`.

    Raises:
        PoseError: If shape, values or convention are invalid; the message contains the first invalid views.
    """
    device = get_device(device)
    rotation = _axes_rotation(convention, axes)
    if isinstance(poses, wp.array) and not poses.device.is_cpu:
        return parse_on_device(poses, rotation, device, name)
    if hasattr(poses, "__cuda_array_interface__"):
        return parse_on_device(from_foreign(poses, name), rotation, device, name)
    rows = _rotate_frames(poses.numpy() if isinstance(poses, wp.array) else poses, rotation, name)
    rounded = np.ascontiguousarray(rows, dtype=np.float32)
    if device.is_cpu and len(rounded):
        return share(rounded, (len(rounded),), wp.transform)
    return wp.array(rounded, dtype=wp.transform, device=device)


def _axes_rotation(convention: Convention, axes: Convention) -> tuple[float, float, float, float] | None:
    """Return the quaternion of the frame of `axes` in that of `convention`; None if they are the same."""
    convention, axes = check_convention(convention), check_convention(axes)
    if convention == axes:
        return None
    if axes == "opencv":
        return _OPENCV_TO[convention]
    *vector, w = _OPENCV_TO[axes]
    conjugate = np.array([*(-part for part in vector), w])
    x, y, z, w = quaternion_product(np.array(_OPENCV_TO[convention]), conjugate).tolist()
    return x, y, z, w


def opencv_frame(convention: Convention) -> NDArray[np.float64]:
    """Return the pose of the OpenCV camera frame in that of a convention, shape ``(4, 4)``."""
    return poses_to_matrices([0.0, 0.0, 0.0, *_OPENCV_TO[convention]])


def vectors_in_axes(vectors: NDArray[np.float64], source: Convention, axes: Convention) -> NDArray[np.float64]:
    """Convert vectors in a camera frame from the axes `source` to other axes."""
    to_source, to_axes = (opencv_frame(name)[:3, :3] for name in (source, axes))
    return vectors @ (to_axes @ to_source.T).T


def host_poses(
    poses: PoseLike,
    convention: Convention = "opencv",
    *,
    axes: Convention = "opencv",
    name: str = "camera_to_world",
) -> NDArray[np.float32]:
    """Return the result of `parse_poses` as rows ``(V, 7)`` for casters on the CPU, with minimum overhead.

    Valid poses pass a quick check. Poses in single precision are not normalized, because casters do that.
    """
    array = poses.numpy() if type(poses) is wp.array and poses.device.is_cpu else poses
    if type(array) is np.ndarray:
        rows = None
        if array.size == 7 and array.shape in _ONE_ROW:
            rows = _one_row(array)
        elif array.size == 16 and array.shape in _ONE_MATRIX:
            rows = _one_matrix(array)
        elif array.dtype == np.float32 and array.ndim == 2 and array.shape[1] == 7 and are_valid_rows(array):
            rows = array
        if rows is not None and check_convention(convention) == axes:
            return rows
    parsed = parse_poses(poses, convention=convention, axes=axes, device="cpu", name=name)
    return parsed.numpy().view(np.float32).reshape(-1, 7)


def _one_row(pose: NDArray) -> NDArray[np.float32] | None:
    """Return one row, shape ``(7,)`` or ``(1, 7)``, as ``(1, 7)`` in single precision; None if it may be invalid."""
    if pose.dtype not in (np.float32, np.float64):
        return None
    x, y, z, *q = pose.ravel().tolist()
    squared = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    # Comparisons are false for NaN.
    if not (
        -_MAX_COORDINATE < x < _MAX_COORDINATE
        and -_MAX_COORDINATE < y < _MAX_COORDINATE
        and -_MAX_COORDINATE < z < _MAX_COORDINATE
        and _MIN_SQUARE < squared < _MAX_SQUARE
    ):
        return None
    if pose.dtype == np.float32:
        return pose.reshape(1, 7)
    length = math.sqrt(squared)
    return np.array([[x, y, z, *(part / length for part in q)]], dtype=np.float32)


def _one_matrix(pose: NDArray) -> NDArray[np.float32] | None:
    """Return one matrix as a row ``(1, 7)`` in single precision, like `_rows_from_matrices`; None if maybe invalid."""
    if pose.dtype not in (np.float32, np.float64):
        return None
    a, b, c, x, d, e, f, y, g, h, i, z, *last = pose.ravel().tolist()
    if last != [0.0, 0.0, 0.0, 1.0] or not (
        -_MAX_COORDINATE < x < _MAX_COORDINATE
        and -_MAX_COORDINATE < y < _MAX_COORDINATE
        and -_MAX_COORDINATE < z < _MAX_COORDINATE
    ):
        return None
    errors = (
        a * a + b * b + c * c - 1,
        d * d + e * e + f * f - 1,
        g * g + h * h + i * i - 1,
        a * d + b * e + c * f,
        a * g + b * h + c * i,
        d * g + e * h + f * i,
    )
    # Comparisons are false for NaN. The determinant is about 1 for rotations and about -1 for reflections.
    if not all(-_ROTATION_TOLERANCE < error < _ROTATION_TOLERANCE for error in errors):
        return None
    if a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g) < 0:
        return None
    squares = (1 + a - e - i, 1 - a + e - i, 1 - a - e + i, 1 + a + e + i)
    largest = squares.index(max(squares))
    sums = (b + d, c + g, f + h)
    differences = (h - f, c - g, d - b)
    q = (
        (squares[0], sums[0], sums[1], differences[0]),
        (sums[0], squares[1], sums[2], differences[1]),
        (sums[1], sums[2], squares[2], differences[2]),
        (*differences, squares[3]),
    )[largest]
    length = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    return np.array([[x, y, z, *(part / length for part in q)]], dtype=np.float32)


def are_valid_rows(rows: NDArray[np.float32]) -> bool:
    """Return whether all rows, shape ``(n, 7)``, are definitely valid; `einsum` is fast and does not warn of NaN."""
    if not len(rows):
        return True
    quaternions = rows[:, 3:]
    squared = np.einsum("ij,ij->i", quaternions, quaternions)
    # A sum is finite only if its terms are.
    finite = math.isfinite(np.einsum("ij->", rows))
    return finite and squared.min() > _MIN_SQUARE and squared.max() < _MAX_SQUARE


def poses_to_opencv(poses: ArrayLike, convention: Convention = "opencv", *, name: str = "poses") -> NDArray[np.float64]:
    """Convert poses on the host to checked, normalized rows of the OpenCV camera frame, shape ``(V, 7)``."""
    return _rotate_frames(poses, _axes_rotation(convention, "opencv"), name)


def convert_axes(poses: ArrayLike, convention: Convention, axes: Convention) -> NDArray[np.float64]:
    """Convert poses on the host from one convention to another; return checked, normalized rows, shape ``(V, 7)``."""
    return _rotate_frames(poses, _axes_rotation(convention, axes), "poses")


def _rotate_frames(poses: ArrayLike, rotation: tuple[float, ...] | None, name: str) -> NDArray[np.float64]:
    """Check and normalize poses on the host, and rotate each frame by a quaternion; return rows, shape ``(V, 7)``."""
    array = as_numpy(poses, name=name).astype(np.float64)
    if array.shape in ((7,), (4, 4)):
        array = array[None]
    if array.ndim == 2 and array.shape[1] == 7:
        rows = _check_rows(array, name)
        if rotation is None:
            return rows
    elif array.ndim == 3 and array.shape[1:] == (4, 4):
        rows = _rows_from_matrices(array, name)
    else:
        raise PoseError(
            f"{name} must have shape (V, 7), rows x y z qx qy qz qw, or (V, 4, 4), camera to world, got {array.shape}"
            f"{_shape_remedy(array.shape)}"
        )
    rotation = _OPENCV_TO["opencv"] if rotation is None else rotation
    return np.concatenate([rows[:, :3], quaternion_product(rows[:, 3:], np.array(rotation))], axis=1)


def read_pose(pose: ArrayLike, quaternion: QuaternionOrder, *, name: str = "pose") -> NDArray[np.float64]:
    """Convert one pose on the host, a row or a matrix, to a normalized row ``x y z qx qy qz qw``.

    Valid rows take a fast path, because scenes may have many thousands of objects.

    Raises:
        PoseError: If the pose is invalid, or if there are several.
    """
    if quaternion == "xyzw" and isinstance(pose, tuple | list | np.ndarray) and len(pose) == 7:
        row = as_numpy(pose, name=name).astype(np.float64)
        if row.ndim == 1:
            x, y, z, *q = row.tolist()
            squared = sum(part * part for part in q)
            if math.isfinite(x + y + z) and _MIN_SQUARE < squared < _MAX_SQUARE:
                row[3:] /= math.sqrt(squared)
                return row
    rows = poses_to_opencv(to_xyzw(pose, quaternion, name), name=name)
    if len(rows) != 1:
        raise PoseError(f"{name} must be one pose, got {len(rows)}")
    return rows[0]


def poses_to_matrices(poses: ArrayLike) -> NDArray[np.float64]:
    """Convert rows ``x y z qx qy qz qw``, shape ``(..., 7)``, to matrices, shape ``(..., 4, 4)``."""
    rows = np.asarray(poses, dtype=np.float64)
    x, y, z, w = np.moveaxis(rows[..., 3:] / np.linalg.norm(rows[..., 3:], axis=-1, keepdims=True), -1, 0)
    matrices = np.zeros((*rows.shape[:-1], 4, 4))
    matrices[..., 0, :3] = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)], axis=-1)
    matrices[..., 1, :3] = np.stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)], axis=-1)
    matrices[..., 2, :3] = np.stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)], axis=-1)
    matrices[..., :3, 3] = rows[..., :3]
    matrices[..., 3, 3] = 1
    return matrices


def look_at(eye: ArrayLike, target: ArrayLike, *, up: str | ArrayLike = "z") -> NDArray[np.float64]:
    """Return the pose of an OpenCV camera at `eye` that looks at `target`.

    Args:
        eye: Camera position in the world [m], shape ``(3,)``.
        target: Point at the center of the image [m], shape ``(3,)``.
        up: Direction that points up in the image: ``"z"``, ``"y"``, or a world direction of shape ``(3,)``.

    Returns:
        Row ``x y z qx qy qz qw``, camera to world, shape ``(7,)``.

    Raises:
        PoseError: If `eye` and `target` coincide, or if the viewing direction is parallel to `up`.
    """
    eye, target = as_point(eye, "eye", PoseError), as_point(target, "target", PoseError)
    vertical = np.eye(3)[check_up(up)] if isinstance(up, str) else as_point(up, "up", PoseError)
    forward = target - eye
    right = np.cross(forward, vertical)
    if np.linalg.norm(right) <= 1e-9 * np.linalg.norm(forward) * np.linalg.norm(vertical):
        raise PoseError(
            f"eye {eye.tolist()} and target {target.tolist()} must differ, and not along up, {vertical.tolist()}. "
            "Pass another up for a camera that looks straight down."
        )
    axes = np.stack([right, np.cross(forward, right), forward], axis=1)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes / np.linalg.norm(axes, axis=0), eye
    return _rows_from_matrices(matrix[None], "pose")[0]


def check_up(up: str) -> int:
    """Return the index of the world's vertical axis."""
    if not isinstance(up, str) or up not in ("z", "y"):
        raise PoseError(f'up must be "z" or "y", got {up!r}')
    return "xyz".index(up)


def to_xyzw(poses: PoseLike, quaternion: QuaternionOrder, name: str) -> PoseLike:
    """Return poses with quaternions in the order ``x y z w``, which all functions use.

    Args:
        poses: Rows of 7 numbers, of any leading shape, or matrices, on the host or on a GPU; or None.
        quaternion: Order of the given quaternions: ``"xyzw"`` (Warp, TUM, ROS) or ``"wxyz"`` (MuJoCo, COLMAP, USD).
        name: Name of the poses in messages.

    Returns:
        The poses themselves for ``"xyzw"`` and for matrices; else reordered copies.
    """
    if isinstance(quaternion, str) and quaternion == "xyzw":
        return poses
    check_quaternion(quaternion)
    if poses is None:
        return None
    if on_gpu(poses):
        return to_xyzw_on_device(poses if isinstance(poses, wp.array) else from_foreign(poses, name))
    rows = as_numpy(poses, name=name)
    return rows[..., [0, 1, 2, 4, 5, 6, 3]] if rows.shape[-1:] == (7,) else rows


def check_quaternion(quaternion: object) -> None:
    """Raise a `PoseError` if `quaternion` is not an order of quaternions."""
    if not isinstance(quaternion, str) or quaternion not in get_args(QuaternionOrder):
        raise PoseError(f'quaternion must be "xyzw" or "wxyz", got {quaternion!r}')


def check_convention(convention: object) -> Convention:
    """Check a convention, and return it; ``"ros_optical"`` becomes ``"opencv"``."""
    if isinstance(convention, str) and convention == "ros":
        raise PoseError(
            'convention must be "ros_body" (x forward, y left, z up) or "ros_optical" (x right, y down, z forward, as '
            '"opencv"), got "ros", which is ambiguous'
        )
    if not isinstance(convention, str) or convention not in _OPENCV_TO:
        raise PoseError(f"convention must be one of {', '.join(map(repr, _OPENCV_TO))}, got {convention!r}")
    return "opencv" if convention == "ros_optical" else convention  # type: ignore[return-value]


def quaternion_product(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the Hamilton product ``a b`` of quaternions ``x y z w``, shapes ``(..., 4)``: first `b`, then `a`."""
    ax, ay, az, aw = np.moveaxis(a, -1, 0)
    bx, by, bz, bw = np.moveaxis(b, -1, 0)
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def find_invalid_rows(rows: np.ndarray) -> tuple[str, NDArray[np.bool_]]:
    """Return what is wrong with rows ``x y z qx qy qz qw``, shape ``(..., 7)``, and which are invalid, ``(...,)``."""
    bad = ~np.isfinite(rows).all(axis=-1)
    if bad.any():
        return "must be finite", bad
    with np.errstate(over="ignore"):
        lengths = np.linalg.norm(rows[..., 3:].astype(np.float64), axis=-1)
    bad = ~(np.abs(lengths - 1) <= LENGTH_TOLERANCE)
    if not bad.any():
        return "", bad
    length, start = float(lengths[bad][0]), float(np.linalg.norm(rows[bad][0, :4].astype(np.float64)))
    swapped = length > LENGTH_TOLERANCE and abs(start - 1) <= LENGTH_TOLERANCE
    hint = ", although its first four numbers have length 1; rows are x y z qx qy qz qw, position first"
    return f"must have quaternions of length 1, got {length:.6g}{hint if swapped else ''}", bad


def is_orthonormal(matrices: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which matrices, shape ``(..., 3, 3)``, are rotations or mirrors, without scale."""
    return np.abs(matrices @ matrices.swapaxes(-1, -2) - np.eye(3)).max(axis=(-1, -2)) <= _ROTATION_TOLERANCE


def _check_rows(rows: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    problem, bad = find_invalid_rows(rows)
    _reject(name, bad, problem, _FINITE_REMEDY if problem == "must be finite" else "")
    length = np.linalg.norm(rows[:, 3:], axis=1)
    return np.concatenate([rows[:, :3], rows[:, 3:] / length[:, None]], axis=1)


def _rows_from_matrices(matrices: NDArray[np.float64], name: str) -> NDArray[np.float64]:
    _reject(name, ~np.isfinite(matrices).all(axis=(1, 2)), "must be finite", _FINITE_REMEDY)
    transposed = bool((matrices[:, :, 3] == [0, 0, 0, 1]).all()) and len(matrices) > 0
    hint = "; they are transposed: swap their last two axes" if transposed else ""
    _reject(name, (matrices[:, 3] != [0, 0, 0, 1]).any(axis=1), "must have the last row 0 0 0 1", hint)
    rotation = matrices[:, :3, :3]
    _reject(name, ~is_orthonormal(rotation), "must be rotations without scale", "; divide the 3 x 3 parts by it")
    mirrored = np.linalg.det(rotation) < 0
    _reject(name, mirrored, "must be rotations, not mirrors", "; negate an axis of the left-handed frame")
    return np.concatenate([matrices[:, :3, 3], _quaternions(rotation)], axis=1)


def _quaternions(rotations: NDArray[np.float64]) -> NDArray[np.float64]:
    """Convert rotation matrices to unit quaternions ``x y z w``, from the largest component (Shepperd 1978)."""
    m00, m11, m22 = rotations[:, 0, 0], rotations[:, 1, 1], rotations[:, 2, 2]
    squares = np.stack([1 + m00 - m11 - m22, 1 - m00 + m11 - m22, 1 - m00 - m11 + m22, 1 + m00 + m11 + m22], axis=1)
    # Row k of `products` is 4 q_k (x, y, z, w); the row with the largest diagonal loses no digits.
    products = np.empty((len(rotations), 4, 4))
    products[:, range(4), range(4)] = squares
    for a, b in ((0, 1), (0, 2), (1, 2)):
        products[:, a, b] = products[:, b, a] = rotations[:, a, b] + rotations[:, b, a]
    for k, (a, b) in enumerate(((2, 1), (0, 2), (1, 0))):
        products[:, k, 3] = products[:, 3, k] = rotations[:, a, b] - rotations[:, b, a]
    rows = products[np.arange(len(rotations)), squares.argmax(axis=1)]
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


def _shape_remedy(shape: tuple[int, ...]) -> str:
    """Return the end of an error message about poses of a common other shape."""
    if shape[-2:] == (3, 4):
        return "; append the row 0 0 0 1 to each matrix"
    remedies = {8: "omit the column of times", 6: "convert angles to quaternions", 12: "reshape to (V, 3, 4)"}
    return f"; {remedies[shape[-1]]}" if shape and len(shape) <= 2 and shape[-1] in remedies else ""


def _reject(name: str, bad: ArrayLike, requirement: str, remedy: str = "") -> None:
    indices = np.flatnonzero(bad)
    if len(indices):
        first = ", ".join(map(str, indices[:5])) + (", ..." if len(indices) > 5 else "")
        raise PoseError(f"{name} {requirement}: wrong in {len(indices)} of {np.size(bad)}, at index {first}{remedy}")
