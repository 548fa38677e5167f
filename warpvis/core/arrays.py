# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check arrays and convert anything with ``__dlpack__`` or ``__array__`` to `wp.array`."""

from __future__ import annotations

import ctypes
import math
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.checks import is_number
from warpvis.core.kernel_cache import init_warp
from warpvis.core.types import ArrayInput, DeviceLike
from warpvis.errors import ArrayError, WarpvisError

Shape = tuple[int | str, ...]
"""An expected shape: integers must match; names match any size and appear in error messages."""

FARTHEST = 1e18
"""Largest absolute coordinate [m]: its square must stay finite in single precision."""

_CACHE_LINE = 64

_SMALL = 1 << 16  # arrays of fewer bytes: clearing them is faster than querying the address of a NumPy array

_KINDS = {wp.float32: "fiu", wp.int32: "iu", wp.uint8: "iu"}


def get_device(device: DeviceLike) -> wp.Device:
    """Return the Warp device with this name."""
    init_warp()
    try:
        return wp.get_device(device)
    except Exception:  # Warp raises several kinds for unknown, absent and malformed names
        known = ", ".join(str(known) for known in wp.get_devices())
        raise ArrayError(f"device {str(device)!r} is not on this machine, which has: {known}") from None


def as_warp(value: ArrayInput | None, dtype: type, shape: Shape, *, name: str, device: wp.Device) -> wp.array:
    """Return `value` as a Warp array on `device`, without a copy where memory can be shared.

    Args:
        value: Any array: Warp's, NumPy's, a PyTorch or JAX tensor, nested lists.
        dtype: Warp dtype of the elements. In other arrays, the components of a vector dtype are the last axis.
        shape: Expected shape of the elements.
        name: Name of the argument in error messages.
        device: Required device. Host arrays are copied to it; arrays on another device raise an error.
    """
    if value is None:
        raise ArrayError(f"{name} must be an array of shape {format_shape(shape, dtype)}, got None")
    if isinstance(value, wp.array):
        return _check_warp(value, dtype, shape, name=name, device=device)
    if on_gpu(value):
        try:
            return _check_warp(wp.from_dlpack(value, dtype=dtype), dtype, shape, name=name, device=device)
        except (RuntimeError, TypeError) as error:
            raise ArrayError(f"{name} must have shape {format_shape(shape, dtype)}: {error}") from None
    host = as_numpy(value, name=name)
    scalar = getattr(dtype, "_wp_scalar_type_", dtype)
    check_shape(host.shape, (*shape, *getattr(dtype, "_shape_", ())), name=name)
    if host.dtype.kind not in _KINDS[scalar]:
        raise ArrayError(f"{name} must be {scalar.__name__}, got {host.dtype}")
    target = wp.dtype_to_numpy(scalar)
    if host.dtype.kind in "iu" and host.size and not _fits(host, target):
        raise ArrayError(f"{name} must fit {scalar.__name__}, got values from {host.min()} to {host.max()}")
    # NumPy treats any stride of an axis of length 1 as contiguous, Warp does not: flattening normalizes the strides.
    host = np.ascontiguousarray(host, dtype=target).reshape(-1).reshape(host.shape)
    if device.is_cpu and host.ndim:
        return share(host, host.shape[: len(shape)], dtype)
    return wp.array(host, dtype=dtype, device=device, copy=not device.is_cpu)


def count_axes(value: ArrayInput, dtype: type) -> int:
    """Return the number of axes of the elements, or -1 for a ragged sequence; vector components are not counted."""
    if isinstance(value, wp.array) and value.dtype is dtype:
        return value.ndim
    try:
        axes = value.ndim if hasattr(value, "ndim") else np.ndim(value)
    except ValueError:
        return -1
    return axes - len(getattr(dtype, "_shape_", ()))


def as_points(points: ArrayInput, name: str, count: str, device: wp.Device) -> wp.array:
    """Convert points to a vec3 array on a device, and check that points in host memory are finite."""
    array = as_warp(points, wp.vec3, (count,), name=name, device=device)
    if not on_gpu(points):
        rows = array.numpy()
        finite = surely_finite(rows) or np.isfinite(rows).all(axis=1)
        bad = np.flatnonzero(np.logical_not(finite))
        if len(bad):
            raise ArrayError(f"{name} must be finite: {len(bad)} are not, the first at {bad[0]}")
    return array


def as_numpy(value: ArrayInput, *, name: str) -> np.ndarray:
    """Return `value` as a NumPy array that shares its memory where possible; Warp's arrays are copied from a GPU."""
    try:
        if isinstance(value, wp.array):
            value = value.numpy()
        host = np.from_dlpack(value) if hasattr(value, "__dlpack__") and not isinstance(value, np.ndarray) else value
        host = np.asarray(host)
    except Exception as error:  # third-party arrays may raise any exception
        raise ArrayError(f"{name} must be an array of numbers: {error}") from None
    if host.dtype.kind not in "fiub":
        raise ArrayError(f"{name} must be an array of numbers, got dtype {host.dtype}")
    return host


def freeze(array: np.ndarray) -> np.ndarray:
    """Make an array read-only, and return it."""
    array.flags.writeable = False
    return array


def check_shape(got: tuple[int, ...], expected: Shape, *, name: str) -> None:
    """Raise `ArrayError` unless `got` matches `expected`."""
    fits = len(got) == len(expected) and all(isinstance(e, str) or g == e for g, e in zip(got, expected, strict=False))
    if not fits:
        raise ArrayError(f"{name} must have shape {format_shape(expected)}, got {got}")


def empty(shape: tuple[int, ...], dtype: type, *, name: str, device: wp.Device) -> wp.array:
    """Allocate an array; if memory is insufficient, raise an error that states the required size."""
    return empty_images(shape, {name: dtype}, device)[name]


def empty_images(shape: tuple[int, ...], dtypes: Mapping[str, type], device: wp.Device) -> dict[str, wp.array]:
    """Allocate arrays of a shape by name; if memory is insufficient, raise an error that states the required size."""
    images: dict[str, wp.array] = {}
    for name, dtype in dtypes.items():
        try:
            images[name] = aligned_empty(shape, dtype) if device.is_cpu else wp.empty(shape, dtype=dtype, device=device)
        except (MemoryError, RuntimeError, ValueError) as error:
            gigabytes = np.prod(shape, dtype=np.float64) * wp.types.type_size_in_bytes(dtype) / 1e9
            raise ArrayError(
                f"{name} of shape {shape} needs {gigabytes:.1f} GB on {device}, which cannot be allocated ({error}). "
                "Render fewer views at a time."
            ) from None
    return images


def aligned_empty(shape: tuple[int, ...], dtype: type, *, allocate: Callable[..., np.ndarray] = np.empty) -> wp.array:
    """Allocate CPU memory aligned to a cache line, which is zero-initialized by `np.zeros`, or if it is small.

    For large arrays, NumPy requests huge pages from the system.
    """
    pattern, size = _pattern(shape, dtype)
    memory: Any
    if size < _SMALL:
        # Querying the address of a NumPy array takes longer than rendering a small image.
        memory = (ctypes.c_char * (size + _CACHE_LINE))()
        address = ctypes.addressof(memory)
    else:
        memory = allocate(size + _CACHE_LINE, dtype=np.uint8)
        address = memory.ctypes.data
    return _array_at(address + -address % _CACHE_LINE, pattern, shape, dtype, memory)


def share(host: np.ndarray, shape: tuple[int, ...], dtype: type) -> wp.array:
    """View a contiguous NumPy array with matching dtype and number of elements as a Warp array on the CPU."""
    return _array_at(host.ctypes.data, _pattern(shape, dtype)[0], shape, dtype, host)


def _array_at(
    address: int, pattern: dict[str, Any] | None, shape: tuple[int, ...], dtype: type, owner: object
) -> wp.array:
    """Create an array from memory that `owner` owns."""
    if pattern is None:
        array = wp.array(ptr=address, dtype=dtype, shape=shape, device="cpu")
    else:
        array = wp.array.__new__(wp.array)
        vars(array).update(pattern)
        array.ptr = address
    array._ref = owner
    return array


@lru_cache(maxsize=256)
def _pattern(shape: tuple[int, ...], dtype: type) -> tuple[dict[str, Any] | None, int]:
    """Return the attributes, apart from `ptr`, that all CPU Warp arrays of a shape share, and their size in bytes.

    Copying them takes a third of the time of the `wp.array` constructor, which takes longer than rendering a small
    image. The attributes are None if the arrays of this Warp version differ in anything but `ptr`.
    """
    device = wp.get_device("cpu")
    one, other = (wp.array(ptr=address, dtype=dtype, shape=shape, device=device) for address in (64, 128))
    same = {name: value for name, value in vars(one).items() if value == vars(other)[name]}
    known = vars(one).keys() - same.keys() == {"ptr"}
    return same if known else None, one.size * wp.types.type_size_in_bytes(dtype)


def aligned_zeros(shape: tuple[int, ...], dtype: type) -> wp.array:
    """Allocate a zero-initialized array with `aligned_empty`. Pages that are never written use no memory."""
    return aligned_empty(shape, dtype, allocate=np.zeros)


def take_rows(array: wp.array, rows: slice | NDArray[np.integer]) -> wp.array:
    """Return rows of an array: a view for a slice, a copy for indices."""
    if isinstance(rows, slice):
        if not array.size:  # Warp cannot slice an empty array
            shape = (len(range(*rows.indices(array.shape[0]))), *array.shape[1:])
            return wp.empty(shape, dtype=array.dtype, device=array.device)
        return array[rows]
    if array.device.is_cpu:  # copies row by row; Warp would copy element by element
        return wp.array(array.numpy()[rows], dtype=array.dtype, device=array.device)
    return array[wp.array(rows, dtype=wp.int32, device=array.device)].contiguous()


def put_rows(array: wp.array, rows: NDArray[np.integer], values: wp.array) -> None:
    """Write `values` to the rows of an array at the given indices."""
    if array.device.is_cpu:
        array.numpy()[rows] = values.numpy()
    else:
        wp.copy(array[wp.array(rows, dtype=wp.int32, device=array.device)], values)


def check_out(out: wp.array, dtype: type, shape: tuple[int, ...], *, name: str, device: wp.Device) -> wp.array:
    """Check that kernels can write to `out`, and return it."""
    if not isinstance(out, wp.array):
        raise ArrayError(f"{name} must be a wp.array to be written to, got {type(out).__name__}")
    return _check_warp(out, dtype, shape, name=name, device=device)


def take_out(
    out: wp.array | None, dtype: type, shape: tuple[int, ...], *, name: str = "out", device: wp.Device
) -> wp.array:
    """Return `out` after a check, or a new array if it is None."""
    if out is None:
        return empty(shape, dtype, name=name, device=device)
    return check_out(out, dtype, shape, name=name, device=device)


def as_point(value: ArrayLike, name: str, error: type[WarpvisError] = ArrayError) -> NDArray[np.float64]:
    """Return one point as float64, shape ``(3,)``."""
    point = as_numpy(value, name=name).astype(np.float64)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise error(f"{name} must be three finite numbers, got {point.tolist()}")
    return point


def as_box(value: ArrayLike, name: str) -> NDArray[np.float64]:
    """Return the lower and upper corner of a box [m] as float64, shape ``(2, 3)``."""
    corners = as_numpy(value, name=name).astype(np.float64)
    if corners.shape != (2, 3) or not np.isfinite(corners).all() or (corners[1] <= corners[0]).any():
        raise ArrayError(f"{name} must be the lower and upper corner of a box, shape (2, 3), got {corners.tolist()}")
    return corners


def check_length(
    value: object,
    name: str,
    *,
    signed: bool = False,
    zero: bool = True,
    infinite: bool = False,
    error: type[WarpvisError] = ArrayError,
) -> float:
    """Check a length in meters, and return it as a float."""
    if (
        not is_number(value)
        or not (signed or value > 0 or (zero and value == 0))
        or not (infinite or math.isfinite(value))
    ):
        expected = "a number of meters from 0 up" if zero else "a positive number of meters"
        raise error(f"{name} must be {'a finite number of meters' if signed else expected}, got {value!r}")
    return float(value)


def format_shape(shape: Shape, dtype: type | None = None) -> str:
    """Format a shape for error messages, including the components of a vector dtype."""
    sizes = (*shape, *getattr(dtype, "_shape_", ()))
    return "(" + ", ".join(str(size) for size in sizes) + ("," if len(sizes) == 1 else "") + ")"


def _check_warp(array: wp.array, dtype: type, shape: Shape, *, name: str, device: wp.Device) -> wp.array:
    # Identity and equality are tested first, since this is called in every frame.
    if array.device is not device and array.device != device:
        raise ArrayError(f"{name} must be on device {device}, got {array.device}")
    if array.dtype is not dtype and not wp.types.types_equal(array.dtype, dtype):
        raise ArrayError(f"{name} must have dtype {_dtype_name(dtype)}, got {_dtype_name(array.dtype)}")
    if array.shape != shape:
        check_shape(array.shape, shape, name=name)
    if not array.is_contiguous:
        raise ArrayError(f"{name} must be contiguous, got strides {array.strides} for shape {array.shape}")
    return array


def _dtype_name(dtype: type) -> str:
    vectors = {wp.vec2: "wp.vec2", wp.vec3: "wp.vec3", wp.vec4: "wp.vec4", wp.transform: "wp.transform"}
    return vectors.get(dtype, dtype.__name__)


def _fits(host: np.ndarray, target: np.dtype) -> bool:
    if np.dtype(target).kind == "f":
        return True
    limits = np.iinfo(target)
    return bool(limits.min <= host.min() and host.max() <= limits.max)


def surely_finite(numbers: np.ndarray) -> bool:
    """Return whether all numbers of a contiguous float array are provably finite, from their sum of squares.

    This takes a tenth of the time of testing each number. False is inconclusive: squares of large numbers overflow.
    """
    flat = numbers.reshape(-1)
    with np.errstate(invalid="ignore", over="ignore"):
        return bool(np.isfinite(np.dot(flat, flat)))


def on_gpu(value: object) -> bool:
    """Return whether an array of any library is in GPU memory."""
    if isinstance(value, wp.array):
        return not value.device.is_cpu
    return hasattr(value, "__cuda_array_interface__") or (
        hasattr(value, "__dlpack_device__") and value.__dlpack_device__()[0] == 2  # kDLCUDA
    )
