# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks that numbers of a model are finite: the compiler rejects others, but programs may set them later."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco  # noqa: TID253 - the whole package is about it
import numpy as np

from warpvis.errors import SceneError, WarpvisError

# Fields that determine shapes, their visibility and their appearance.
_SHAPE_FIELDS = (
    "geom_size",
    "geom_rgba",
    "site_size",
    "site_rgba",
    "mat_rgba",
    "mat_texrepeat",
    "mat_emission",
    "mat_specular",
    "mat_shininess",
    "mat_metallic",
    "mat_roughness",
    "hfield_size",
    "skin_rgba",
    "flex_rgba",
    "tendon_rgba",
)
_LIGHT_FIELDS = (
    "light_pos",
    "light_dir",
    "light_cutoff",
    "light_exponent",
    "light_attenuation",
    "light_ambient",
    "light_diffuse",
    "light_specular",
)
_HEADLIGHT_FIELDS = ("ambient", "diffuse", "specular")
_CAMERA_FIELDS = ("cam_fovy", "cam_intrinsic", "cam_sensorsize")
_NOUNS = {
    "geom": "geom",
    "site": "site",
    "mat": "material",
    "hfield": "hfield",
    "skin": "skin",
    "flex": "flex",
    "tendon": "tendon",
    "light": "light",
    "cam": "camera",
}


def check_shape_numbers(model: mujoco.MjModel) -> None:
    """Raise a `SceneError` if a number that determines shapes, visibility or appearance is not finite."""
    _check(model, _SHAPE_FIELDS, SceneError)


def check_light_numbers(model: mujoco.MjModel, lights: Iterable[int]) -> None:
    """Raise a `SceneError` if a number of the given lights, or of the headlight, is not finite."""
    _check(model, _LIGHT_FIELDS, SceneError, list(lights))
    for name in _HEADLIGHT_FIELDS:
        value = getattr(model.vis.headlight, name)
        if not np.isfinite(value).all():
            raise SceneError(f"vis.headlight.{name} must be finite numbers, got {value.tolist()}")


def check_camera_numbers(model: mujoco.MjModel, camera: int, error: type[WarpvisError]) -> None:
    """Raise an error if a number that determines a camera's intrinsics is not finite."""
    _check(model, _CAMERA_FIELDS, error, [camera])


def _check(
    model: mujoco.MjModel, fields: Iterable[str], error: type[WarpvisError], chosen: list[int] | None = None
) -> None:
    for name in fields:
        values = getattr(model, name)
        rows = values if chosen is None else values[chosen]
        if np.isfinite(rows).all():
            continue
        row = int(np.argwhere(~np.isfinite(rows))[0, 0])
        index, kind = row if chosen is None else chosen[row], name.split("_")[0]
        label = getattr(model, _NOUNS[kind])(index).name or index
        raise error(f"{name} of {_NOUNS[kind]} {label!r} must be finite, got {values[index].tolist()}")
