# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""JSON representation of depth-camera models, for manifests of datasets."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, is_dataclass
from typing import Any

import numpy as np

from warpvis.cameras.pinhole import Camera
from warpvis.core.checks import describe_exception, is_number, is_whole, truncate
from warpvis.core.types import Json
from warpvis.errors import ArrayError, CameraError
from warpvis.rendering import DepthSensor

_INFINITE = "inf"
"""JSON string for infinity, which is not a JSON number."""

_PACKED = {"dtype", "shape", "base64"}
"""Keys of packed arrays; lists of tables and images would take megabytes."""


def sensor_to_fields(sensor: DepthSensor) -> dict[str, Json]:
    """Convert a sensor to a JSON object: its model, which is the name of its class, and the fields of that class.

    Raises:
        ArrayError: If a field is not a number, a string, a camera, a sensor, or a list or mapping of these.
    """
    kind = type(sensor)
    name = kind.__name__ if _find_model(kind.__name__) is kind else f"{kind.__module__}.{kind.__qualname__}"
    attributes = (
        {field.name: getattr(sensor, field.name) for field in fields(sensor)} if is_dataclass(sensor) else vars(sensor)
    )
    return {"model": name, **{key: _to_json(value, f"{kind.__name__}.{key}") for key, value in attributes.items()}}


def sensor_from_fields(values: Mapping[str, Json]) -> DepthSensor | None:
    """Create a sensor from fields of `sensor_to_fields`; return None if a model in them is not part of warpvis."""
    model = values.get("model")
    if not isinstance(model, str):
        raise CameraError(f"model of a sensor must be the name of its class, got {truncate(repr(model))}")
    kind = _find_model(model)
    if kind is None:
        return None
    try:
        parameters = {key: _from_json(value) for key, value in values.items() if key != "model"}
        inner = [key for key, value in values.items() if isinstance(value, Mapping) and "model" in value]
        return None if any(parameters[key] is None for key in inner) else kind(**parameters)
    except (TypeError, ValueError, ArithmeticError, RecursionError) as error:
        raise CameraError(f"the fields of a {model} are invalid: {describe_exception(error)}") from None


def _find_model(name: str) -> Any:
    from warpvis.sensors import depth

    kind = getattr(depth, name, None)
    return kind if isinstance(kind, type) and issubclass(kind, DepthSensor) else None


def _to_json(value: object, name: str) -> Json:
    if value is None or isinstance(value, bool | str):
        return value
    if is_whole(value):
        return int(value)
    if is_number(value):
        if math.isnan(value):
            raise ArrayError(f"{name} must be a number, got NaN")
        return float(value) if math.isfinite(value) else _INFINITE if value > 0 else f"-{_INFINITE}"
    if isinstance(value, DepthSensor):
        return sensor_to_fields(value)
    if is_dataclass(value) and not isinstance(value, type):
        return {key: _to_json(part, name) for key, part in asdict(value).items()}
    if isinstance(value, Mapping):
        return {str(key): _to_json(part, name) for key, part in value.items()}
    if isinstance(value, np.ndarray):
        return _pack(value) if value.ndim > 1 else _to_json(value.tolist(), name)
    if isinstance(value, Sequence) and not isinstance(value, bytes):
        return [_to_json(part, name) for part in value]
    shown = truncate(" ".join(repr(value).split()))
    raise ArrayError(f"{name} must be numbers or text to be written to the manifest of a dataset, got {shown}")


def _pack(image: np.ndarray) -> Json:
    """Pack an array as little-endian bytes in base64. Compressed bytes would depend on the version of a library."""
    plain = np.ascontiguousarray(image, dtype=image.dtype.newbyteorder("<"))
    packed = base64.b64encode(plain.tobytes()).decode("ascii")
    return {"dtype": plain.dtype.str, "shape": [*image.shape], "base64": packed}


def _unpack(values: Mapping[str, Json]) -> np.ndarray:
    """Return the array packed by `_pack`."""
    dtype, shape = np.dtype(values["dtype"]), values["shape"]  # type: ignore[arg-type]
    if (
        dtype.kind not in "iuf"
        or not isinstance(shape, list)
        or not all(is_whole(side) and side >= 0 for side in shape)
    ):
        raise ValueError("an array must have a numeric dtype and a shape of whole numbers")
    data = base64.b64decode(str(values["base64"]), validate=True)
    if len(data) != math.prod(shape) * dtype.itemsize:
        raise ValueError(f"an array of {dtype} of shape {tuple(shape)} must not have {len(data)} bytes")
    return np.frombuffer(data, dtype=dtype).reshape(shape)


def _from_json(value: Json) -> Any:
    if value in (_INFINITE, f"-{_INFINITE}"):
        return float(str(value))
    if isinstance(value, list):
        return tuple(_from_json(part) for part in value)
    if isinstance(value, dict):
        if "model" in value:
            return sensor_from_fields(value)
        if value.keys() == _PACKED:
            return _unpack(value)
        parts = {key: _from_json(part) for key, part in value.items()}
        return Camera(**parts) if {"width", "fx"} <= parts.keys() else parts
    return value
