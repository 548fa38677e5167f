# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of cameras, and derivatives of rays with respect to them, for calibration by gradients.

At a fixed pixel p, a change of a parameter turns the ray d so that its projection stays: ``dp/dd dd + dp/dparameter =
0`` with ``dd`` normal to the unit vector d. The lenses of warpvis have formulas for the derivatives; those of other
classes come from central differences of `Lens.project`, with a relative error of about 1e-9.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.base import AnyCamera
from warpvis.cameras.checks import as_floats
from warpvis.cameras.lens_camera import LensCamera
from warpvis.cameras.lenses import lens_jacobian, lens_parameters, lens_with_parameters
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.cameras.pinhole import Camera
from warpvis.cameras.rays import WideCamera
from warpvis.errors import CameraError

AnyCameraT = TypeVar("AnyCameraT", bound=AnyCamera)
"""The class of a camera."""

_INTRINSICS = ("fx", "fy", "cx", "cy")


def parameter_names(camera: AnyCamera) -> tuple[str, ...]:
    """Return the names of a camera's parameters, in the order of its constructor.

    These are ``fx fy cx cy`` of a pinhole camera and of an orthographic camera, all numbers of the lens of a
    `LensCamera` (its coefficients by their names: ``k1``, ``p1``, ...), and ``hfov`` of a `WideCamera`. Other cameras,
    such as `Rays`, have none.

    Args:
        camera: A camera.

    Raises:
        CameraError: If `camera` is not a camera.
    """
    return tuple(_parameters(camera))


def parameter_values(camera: AnyCamera) -> NDArray[np.float64]:
    """Return the values of `parameter_names`, shape ``(P,)``.

    Args:
        camera: A camera.

    Raises:
        CameraError: If `camera` is not a camera.
    """
    return np.array(list(_parameters(camera).values()), dtype=np.float64)


def with_parameters(camera: AnyCameraT, values: ArrayLike) -> AnyCameraT:
    """Return the same camera with other values of its parameters.

    Image size, range and the definition of depth stay the same.

    Args:
        camera: A camera.
        values: Values of `parameter_names`, shape ``(P,)``.

    Raises:
        CameraError: If `values` has another shape, or the camera or its lens does not support a value.
    """
    names, numbers = parameter_names(camera), as_floats(values, "values")
    if numbers.shape != (len(names),):
        listed = f" ({' '.join(names)})" if names else ""
        raise CameraError(f"values must have shape ({len(names)},){listed}, got {numbers.shape}")
    if not np.isfinite(numbers).all():
        raise CameraError(f"values must be finite numbers, got {numbers[~np.isfinite(numbers)][0]}")
    if not names:
        return camera
    changes: dict[str, Any] = dict(zip(names, numbers.tolist(), strict=True))
    if isinstance(camera, LensCamera):
        changes = {"lens": lens_with_parameters(camera.lens, numbers.tolist())}
    return replace(camera, **changes)  # type: ignore[type-var]  # cameras with parameters are dataclasses


def ray_jacobian(camera: AnyCamera) -> NDArray[np.float64]:
    """Return the derivatives of the rays through the pixel centers with respect to the camera's parameters.

    With depth z and a hit point ``o + z d`` on a plane with normal n, ``dz/dd = -z n / (n . d)``, so the derivative of
    depth is ``-z (n . J) / (n . d)``, all in the camera frame. The result is not cached.

    Args:
        camera: A camera.

    Returns:
        Derivatives of `camera.rays`, whose z or length stays 1, shape ``(*shape, 3, P)``, per unit of the parameters
        (pixels, radians, or none). 0 where a pixel has no ray, or where the lens turns back at the pixel.

    Raises:
        CameraError: If `camera` is not a camera.
    """
    count = len(_parameters(camera))
    if isinstance(camera, Camera):
        return _plane_jacobian(camera)
    if isinstance(camera, LensCamera):
        pixels = np.stack(np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5), axis=-1)
        jacobian = lens_jacobian(camera.lens, pixels.reshape(-1, 2), camera.directions.reshape(-1, 3))
        jacobian = jacobian.reshape(*camera.shape, 3, count)
        if camera.kind == "z":  # d (v / v_z) = (dv - (v / v_z) dv_z) / v_z
            jacobian -= camera.rays[..., None] * jacobian[..., 2:, :]
            jacobian /= camera.directions[..., 2:, None]
        jacobian[~np.isfinite(jacobian).all(axis=(-2, -1))] = 0.0
        return jacobian
    if isinstance(camera, WideCamera):
        return camera.angle_jacobian()[..., None]
    return np.zeros((*camera.shape, 3, count))


def origin_jacobian(camera: AnyCamera) -> NDArray[np.float64] | None:
    """Return the derivatives of the ray origins with respect to the camera's parameters.

    Args:
        camera: A camera.

    Returns:
        For an `OrthographicCamera`, whose parameters move the origins but not the rays, derivatives of `camera.origins`
        [m], shape ``(height, width, 3, 4)``. None for other cameras: their origins do not depend on parameters.

    Raises:
        CameraError: If `camera` is not a camera.
    """
    _parameters(camera)
    return _plane_jacobian(camera) if isinstance(camera, OrthographicCamera) else None


def _parameters(camera: object) -> dict[str, float]:
    if not isinstance(camera, AnyCamera):
        raise CameraError(f"camera must be a camera, got {type(camera).__name__}")
    if isinstance(camera, LensCamera):
        return lens_parameters(camera.lens)
    if isinstance(camera, WideCamera):
        return {"hfov": camera.hfov}
    if isinstance(camera, Camera | OrthographicCamera):
        return {name: getattr(camera, name) for name in _INTRINSICS}
    return {}


def _plane_jacobian(camera: Camera | OrthographicCamera) -> NDArray[np.float64]:
    """Return derivatives of ``((x - cx) / fx, (y - cy) / fy)`` at pixel centers, shape ``(height, width, 3, 4)``."""
    result = np.zeros((camera.height, camera.width, 3, 4))
    result[..., 0, 0] = -(np.arange(camera.width) + 0.5 - camera.cx) / camera.fx**2
    result[..., 1, 1] = -(np.arange(camera.height) + 0.5 - camera.cy)[:, None] / camera.fy**2
    result[..., 0, 2], result[..., 1, 3] = -1 / camera.fx, -1 / camera.fy
    return result
