# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lenses as JSON objects: the model, which is the name of the class, and its fields, with pixel centers at +0.5."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from inspect import isabstract
from typing import Any

from warpvis.cameras.lenses._lens import Lens
from warpvis.core.checks import check_mapping, is_number, is_whole, truncate
from warpvis.core.types import Json
from warpvis.errors import CameraError


def lens_to_dict(lens: Any) -> dict[str, Json]:
    """Convert a lens to a JSON object. The model of a class outside of warpvis is ``module:Class``."""
    model = _model_name(type(lens))
    if not is_dataclass(lens):
        raise CameraError(f"lens must be a dataclass to be written to a file, got {model}")
    parameters = {field.name: _to_json(getattr(lens, field.name)) for field in fields(lens) if field.init}
    wrong = next((name for name, value in parameters.items() if value is None), None)
    if wrong is not None:
        raise CameraError(
            f"{wrong} of lens {model} must be a number, a string or a tuple of these to be written to a file, got "
            f"{truncate(repr(getattr(lens, wrong)))}"
        )
    return {"model": model, **parameters}


def lens_from_dict(values: object) -> Lens:
    """Create a lens from the result of `lens_to_dict`.

    Raises:
        CameraError: If it is invalid, or if the class is in a module that is not imported.
    """
    parameters = dict(check_mapping(values, "lens", CameraError))
    model = parameters.pop("model", None)
    models = dict(_models(Lens))
    if not isinstance(model, str) or model not in models:
        known = sorted(name for name in models if ":" not in name)
        if not isinstance(model, str) or ":" not in model:
            raise CameraError(f"model of a lens must be one of {', '.join(known)}, got {truncate(repr(model))}")
        module, _, name = map(truncate, model.partition(":"))
        raise CameraError(f"class {name} of the lens is not part of warpvis. Import {module}, which defines it, first.")
    names = [field.name for field in fields(models[model]) if field.init]
    wrong = sorted(parameters.keys() - set(names))
    if wrong:
        raise CameraError(f"unknown {truncate(wrong[0])} of a lens; the fields of {model} are {', '.join(names)}")
    given = {name: tuple(value) if isinstance(value, list) else value for name, value in parameters.items()}
    try:
        return models[model](**given)
    except TypeError:
        raise CameraError(f"{model} needs the parameters {', '.join(names)}, got {', '.join(parameters)}") from None


def _models(base: Any) -> Iterator[tuple[str, Any]]:
    """Yield the models of imported classes: modules named in files are never imported."""
    for kind in base.__subclasses__():
        if is_dataclass(kind) and not isabstract(kind):
            yield _model_name(kind), kind
        yield from _models(kind)


def _model_name(kind: Any) -> str:
    is_ours = kind.__module__.startswith(f"{__package__}.")
    return kind.__name__ if is_ours else f"{kind.__module__}:{kind.__qualname__}"


def _to_json(value: object) -> Json:
    """Convert a number, a string or a tuple of these to JSON; return None for other values."""
    if isinstance(value, tuple):
        parts = [_to_json(part) for part in value]
        return None if None in parts else parts
    if isinstance(value, str | bool):
        return value
    return int(value) if is_whole(value) else float(value) if is_number(value) else None
