# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Create and read ROS 2 messages; ROS is imported only if its message classes are requested.

Messages are recognized by their fields: messages of ROS 2, rosbags and ROS 1 (whose CameraInfo has K, P and D) are
read in the same way.
"""

from __future__ import annotations

import array
import importlib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import ROUND_HALF_EVEN, Decimal
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy
from warpvis.core.checks import check_flag, check_text, is_number
from warpvis.core.user_warnings import warn_user
from warpvis.errors import ArrayError, CameraError, IntrinsicsWarning, MessageError

Message: TypeAlias = Any
"""A ROS message: an object with the fields of its definition."""

_LAST_SECOND = 2**31 - 1
_IDENTITY = np.eye(3).ravel()


class MessageTypes(Protocol):
    """A rosbags type store, as returned by `rosbags.typesys.get_typestore`."""

    @property
    def types(self) -> Mapping[str, Any]:
        """Message classes by message type, ``"sensor_msgs/msg/Image"``."""


Stamp = float | Message
"""A time [s], or a ``builtin_interfaces/Time`` message."""


class MessageMaker:
    """Creates ROS 2 messages."""

    def __init__(self, types: MessageTypes | None = None) -> None:
        """Choose the classes: of a rosbags type store, or, by default, those of ROS, which are imported when used."""
        if types is not None and not isinstance(getattr(types, "types", None), Mapping):
            raise MessageError(f"types must be a type store of rosbags, or None for ROS's own, got {types!r}")
        self._types = types

    def make(self, kind: str, **fields: Any) -> Message:
        """Create a message of a type such as ``"sensor_msgs/msg/Image"`` from its fields, by their names in ROS 2."""
        if self._types is None:
            return _ros_class(kind)(**fields)
        try:
            return self._types.types[kind](**fields)
        except KeyError:
            raise MessageError(f"types must contain {kind}. Use a store of ROS 2, such as Stores.ROS2_JAZZY.") from None
        except TypeError as error:
            raise MessageError(f"types must define {kind} as in ROS 2 ({error}). Use Stores.ROS2_JAZZY.") from None

    def sequence(self, values: NDArray[Any]) -> Any:
        """Convert numbers to the type of a sequence field; rosbags uses the NumPy array itself.

        The message classes of ROS accept an `array.array` without inspection, but check each element of other types.
        """
        if self._types is not None:
            return values
        copied = array.array(values.dtype.char)
        copied.frombytes(values.view(np.uint8).data)
        return copied

    def header(self, frame_id: str, stamp: Stamp) -> Message:
        """Create a message header."""
        frame_id = check_text(frame_id, "frame_id", MessageError)
        sec, nanosec = divmod(stamp_nanoseconds(stamp), 10**9)
        time = self.make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)
        return self.make("std_msgs/msg/Header", stamp=time, frame_id=frame_id)

    def camera_info(
        self,
        size: tuple[int, int],
        k: NDArray[np.float64],
        header: Message,
        d: Sequence[float],
        model: str,
    ) -> Message:
        """Create a CameraInfo without binning or region of interest; the rectified image has the same intrinsics.

        Pixel centers are at integer coordinates, and `d` is the distortion of the raw image by `model`.
        """
        width, height = size
        region = {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}
        return self.make(
            "sensor_msgs/msg/CameraInfo",
            header=header,
            height=height,
            width=width,
            distortion_model=model,
            d=self.sequence(np.array(d, dtype=np.float64)),
            k=k.ravel(),
            r=_IDENTITY.copy(),
            p=np.concatenate([k, np.zeros((3, 1))], axis=1).ravel(),
            binning_x=0,
            binning_y=0,
            roi=self.make("sensor_msgs/msg/RegionOfInterest", **region),
        )


def _ros_class(kind: str) -> Any:
    """Import a message class of ROS."""
    package, _, name = kind.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError):
        raise MessageError(
            f"{kind} requires ROS 2, which is not on Python's path (source its setup file), or rosbags: "
            "pip install 'warpvis[ros]' and types=get_typestore(Stores.ROS2_JAZZY)"
        ) from None


def nanoseconds(seconds: float) -> int:
    """Convert a time [s] to integer nanoseconds, from its shortest decimal representation, as written in text files."""
    return int((Decimal(repr(seconds)) * 10**9).to_integral_value(ROUND_HALF_EVEN))


def stamp_nanoseconds(stamp: Stamp) -> int:
    """Convert a time [s], or a ``builtin_interfaces/Time`` or ROS 1 ``Time`` message, to nanoseconds."""
    if is_number(stamp):
        if not 0 <= stamp < _LAST_SECOND:
            raise MessageError(f"stamp must be from 0 to {_LAST_SECOND} s, the range of ROS 2, got {stamp!r}")
        return nanoseconds(float(stamp))
    for names in (("sec", "nanosec"), ("secs", "nsecs")):
        if all(hasattr(stamp, name) for name in names):
            sec, nanosec = (int(getattr(stamp, name)) for name in names)
            return sec * 10**9 + nanosec
    raise MessageError(f"stamp must be a time in seconds or a Time message, got {stamp!r}")


def field(message: Message, *names: str) -> Any:
    """Return the first of these fields that a message has."""
    for name in names:
        if hasattr(message, name):
            return getattr(message, name)
    raise MessageError(f"message must have the field {names[0]}, got {type(message).__name__}")


def whole_field(message: Message, name: str) -> int:
    """Return a message field that contains a nonnegative integer."""
    value = field(message, name)
    if not is_number(value) or not math.isfinite(value) or value != int(value) or value < 0:
        raise MessageError(f"{name} of a message must be a whole number from 0 up, got {value!r}")
    return int(value)


@dataclass(frozen=True)
class CameraInfo:
    """Size and intrinsics of the images described by a CameraInfo."""

    width: int
    """Image width [px]."""
    height: int
    """Image height [px]."""
    K: NDArray[np.float64]
    """Intrinsics of the image, with pixel centers at integer coordinates, shape ``(3, 3)``."""


def read_camera_info(message: Message, *, rectified: bool = True) -> CameraInfo:
    """Read a ``sensor_msgs/CameraInfo``, with binning and region of interest as `image_geometry` applies them.

    The intrinsics are those of the rectified image (`P`), or of the raw image (`K`).
    """
    rectified = check_flag(rectified, "rectified", CameraError)
    k = _read_k(message)
    p = _matrix(field(message, "p", "P"), (3, 4), "P")
    is_distorted = bool(_numbers(field(message, "d", "D"), "D").any())
    region = _read_region(message)
    if rectified and p[0, 0] != 0:
        _check_projection(p)
        is_rectified = not is_distorted and bool((p[:, :3] == k).all())
        if is_rectified:
            r = _matrix(field(message, "r", "R"), (3, 3), "R")
            is_rectified = not r.any() or bool((r == np.eye(3)).all())
        if region.rectify and not region.is_full and not is_rectified:
            raise CameraError(
                "CameraInfo has a region of interest of the raw image, but does not define the corresponding region of "
                "the rectified image (do_rectify). Rectify the whole image."
            )
        k = p[:, :3].copy()
    elif is_distorted:
        problem = "has no P" if rectified else "is of a raw image with distortion"
        raise CameraError(
            f"CameraInfo {problem}, but a Camera has no distortion. Use the rectified image (image_rect) and its P."
        )
    return _in_region(k, region)


def read_raw_camera_info(message: Message) -> tuple[CameraInfo, NDArray[np.float64], str]:
    """Read the raw image's size and `K`, and the lens's `D` and distortion model, from a ``sensor_msgs/CameraInfo``.

    Binning and region of interest are optional.
    """
    k = _read_k(message)
    coefficients, model = _numbers(field(message, "d", "D"), "D"), field(message, "distortion_model")
    if not isinstance(model, str):
        raise CameraError(f"distortion_model of CameraInfo must be text, got {model!r}")
    if not hasattr(message, "roi"):
        return CameraInfo(whole_field(message, "width"), whole_field(message, "height"), k), coefficients, model
    return _in_region(k, _read_region(message)), coefficients, model


def _read_k(message: Message) -> NDArray[np.float64]:
    k = _matrix(field(message, "k", "K"), (3, 3), "K")
    if k[0, 0] == 0:
        raise CameraError("K of CameraInfo must not be zero: the camera is not calibrated")
    return k


def _in_region(k: NDArray[np.float64], region: _Region) -> CameraInfo:
    """Apply a region of interest and binning to the full image's intrinsics, in place."""
    k[:2, 2] -= region.x, region.y
    k[:2] /= np.array([[region.binning_x], [region.binning_y]])
    return CameraInfo(region.width // region.binning_x, region.height // region.binning_y, k)


@dataclass(frozen=True)
class _Region:
    """Region of the full image that a camera reads [px], and its binning."""

    x: int
    y: int
    width: int
    height: int
    binning_x: int
    binning_y: int
    is_full: bool
    rectify: bool


def _read_region(message: Message) -> _Region:
    width, height = whole_field(message, "width"), whole_field(message, "height")
    roi = field(message, "roi")
    x, y, columns, rows = (whole_field(roi, name) for name in ("x_offset", "y_offset", "width", "height"))
    if (x, y, columns, rows) == (0, 0, 0, 0):
        columns, rows = width, height
    if x + columns > width or y + rows > height or min(columns, rows) < 1:
        raise CameraError(
            f"region of interest of CameraInfo must be within its image of {width} x {height} pixels, got {columns} x "
            f"{rows} pixels from ({x}, {y})"
        )
    binning_x, binning_y = (max(whole_field(message, name), 1) for name in ("binning_x", "binning_y"))
    if binning_x > columns or binning_y > rows:
        raise CameraError(
            f"binning of CameraInfo must be at most the image size {columns} x {rows}, got {binning_x} x {binning_y}"
        )
    is_full = (columns, rows) == (width, height)
    return _Region(x, y, columns, rows, binning_x, binning_y, is_full, bool(field(roi, "do_rectify")))


def _check_projection(p: NDArray[np.float64]) -> None:
    """Warn if the camera is offset from its frame."""
    if p[2, 3] != 0:
        raise CameraError(f"P of CameraInfo must have a last column Tx, Ty, 0, got {p[:, 3].tolist()}")
    if p[0, 3] == 0 and p[1, 3] == 0:
        return
    x, y = 0.0 - p[0, 3] / p[0, 0], 0.0 - p[1, 3] / p[1, 1]
    warn_user(
        f"P of CameraInfo is of the second camera of a stereo pair, at x = {x:.6g} m, y = {y:.6g} m in the frame of "
        "its header. A Camera ignores this offset: include it in the pose.",
        IntrinsicsWarning,
    )


def _numbers(values: ArrayLike | Iterable[float], name: str) -> NDArray[np.float64]:
    try:
        numbers = as_numpy(np.array([], dtype=np.float64) if len(values) == 0 else values, name=name)  # type: ignore[arg-type]
    except (ArrayError, TypeError):
        raise CameraError(f"{name} of CameraInfo must be numbers, got {values!r}") from None
    if not np.isfinite(numbers).all():
        raise CameraError(f"{name} of CameraInfo must be finite, got {numbers.tolist()}")
    return numbers.astype(np.float64)


def _matrix(values: ArrayLike, shape: tuple[int, int], name: str) -> NDArray[np.float64]:
    numbers = _numbers(values, name)
    if numbers.size != math.prod(shape):
        raise CameraError(f"{name} of CameraInfo must be {shape[0]} x {shape[1]} numbers, got {numbers.size}")
    return numbers.reshape(shape)
