# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lidar returns: angle of incidence and intensity of rays, beams of several rays, and their returns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.cameras.rays import Rays
from warpvis.core.arrays import as_numpy, check_out, check_shape, take_out
from warpvis.core.checks import check_angle, check_choice, check_flag, check_number, check_whole, is_number
from warpvis.core.motion import Motion
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.threads import launch_images
from warpvis.core.types import PoseLike
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering import Views, parse_sensor
from warpvis.scene import Scene, require_scene

Reflectivity: TypeAlias = float | Mapping[str, float] | ArrayLike
"""One value for all objects, a mapping from object names to values (1 for others), or values in scene order."""

Keep = Literal["strongest", "last", "dual"]
"""Which returns of a beam a lidar keeps."""

_MAX_SUBRAYS = 1024
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass
class Returns:
    """Returns of beams: `wp.array`s indexed ``[view, return, y, x]``."""

    range: wp.array
    """Ranges [m], shape ``(V, R, H, W)``, or ``(V, R, N)`` for a list of rays, float32; +inf where there is no such
    return, -inf where all rays of the beam are below the minimum range."""
    intensity: wp.array
    """Intensities, of the same shape, float32: the mean over the beam's rays; 0 where there is no such return."""


def spread_beams(rays: Rays, divergence: float, count: int = 7) -> Rays:
    """Replace each ray by a beam: several rays that fill a cone about it evenly.

    Args:
        rays: The central rays of the beams, shape ``(H, W)`` or ``(N,)``.
        divergence: Full angle of the cone [rad]: with 0.003, the beam is 3 cm wide at 10 m.
        count: Number of rays per beam.

    Returns:
        Rays of shape ``(H, W * count)`` or ``(N * count,)``, with the rays of a beam next to each other, and with the
        origin, time and ring of their central ray. `gather_returns` combines them to returns.
    """
    require_rays(rays)
    divergence = check_angle(divergence, "divergence", minimum=0.0, maximum=math.pi)
    count = check_whole(count, "count")
    if count > _MAX_SUBRAYS:
        raise ArrayError(f"count must be at most {_MAX_SUBRAYS} rays per beam, got {count}")
    center = np.asarray(rays.directions)
    # Fermat spiral with the golden angle: each ray covers an equal share of the cone's cross-section.
    radius = np.tan(divergence / 2.0) * np.sqrt((np.arange(count) + 0.5) / count) if count > 1 else np.zeros(1)
    angle = _GOLDEN_ANGLE * np.arange(count)
    first, second = _perpendicular(center)
    spread = center[..., None, :] + radius[:, None] * (
        np.cos(angle)[:, None] * first[..., None, :] + np.sin(angle)[:, None] * second[..., None, :]
    )
    spread /= np.linalg.norm(spread, axis=-1, keepdims=True)
    *shape, last = center.shape[:-1]
    given = ((name, getattr(rays, name), axis) for name, axis in (("origins", -2), ("times", -1), ("rings", -1)))
    options: dict[str, Any] = {
        name: np.repeat(np.asarray(values), count, axis) for name, values, axis in given if values is not None
    }
    options |= {name: getattr(rays, name) for name in ("near", "far", "kind", "axes")}
    return Rays(spread.reshape(*shape, last * count, 3), **options)


def measure_incidence(
    views: Views,
    rays: Rays,
    sensor_to_world: PoseLike | Motion,
    *,
    convention: Convention | None = None,
    quaternion: QuaternionOrder = "xyzw",
    out: wp.array | None = None,
) -> wp.array:
    """Compute the cosine of the angle of incidence of each ray: 1 at normal incidence, 0 at grazing incidence.

    Args:
        views: Rendered images of the rays, with normals.
        rays: The rendered ray pattern.
        sensor_to_world: The rendered poses, or the motion.
        convention: Axes of the sensor frame of the poses; by default `axes` of the rays.
        quaternion: Order of the quaternions in the poses, ``"xyzw"`` or ``"wxyz"``.
        out: The result of an earlier call, to be overwritten.

    Returns:
        Cosines, shape ``(V, *rays)``, float32; NaN where a ray hits nothing.
    """
    require_rays(rays)
    normals = require_image(views, "normals")
    device = normals.device
    times: list[wp.array | None] = []
    if isinstance(sensor_to_world, Motion):
        from warpvis.kernels.casting.moving_rays import measure_moving_incidence as kernel

        sensor, count = parse_sensor(rays, sensor_to_world, convention, device)
        shape, dtype = _as_image(rays.shape, count), wp.vec3d
        moments = rays.times
        times = [None if moments is None else wp.array(moments.reshape(shape[1:]), dtype=wp.float64, device=device)]
    else:
        from warpvis.kernels.sensors.echoes import measure_incidence as kernel

        named = rays.axes if convention is None else convention
        rows = to_xyzw(sensor_to_world, quaternion, "sensor_to_world")
        sensor = parse_poses(rows, convention=named, axes=rays.axes, device=device, name="sensor_to_world")
        shape, dtype = _as_image(rays.shape, len(sensor)), wp.vec3
    check_shape(normals.shape, (shape[0], *rays.shape), name="normals")
    along = wp.array(rays.directions.reshape(*shape[1:], 3), dtype=dtype, device=device)
    out = take_out(out, wp.float32, normals.shape, device=device)
    inputs = [along, *times, normals.reshape(shape), out.reshape(shape)]
    launch_images(kernel, shape, lambda window: [sensor, window, *inputs], device=device)
    return out


def reflect(
    scene: Scene,
    views: Views,
    incidence: wp.array,
    reflectivity: Reflectivity = 1.0,
    *,
    falls_off: bool = False,
    out: wp.array | None = None,
) -> wp.array:
    """Compute the intensity of each ray: reflectivity times the cosine of the angle of incidence.

    Args:
        scene: The rendered scene.
        views: Its images, with depth and segmentation, on its device.
        incidence: Cosines of the angle of incidence from `measure_incidence`, shape ``(V, *rays)``, float32.
        reflectivity: Non-negative reflectivity: one value for all objects; a mapping from object names to values, 1 for
            others; or one value per object, shape ``(objects,)``.
        falls_off: Whether to divide intensity by the squared range, as for received power [1/m^2]. By default,
            intensity does not depend on range, like the calibrated values that sensors report.
        out: The result of an earlier call, to be overwritten.

    Returns:
        Intensities, shape ``(V, *rays)``, float32; 0 where a ray hits nothing.
    """
    from warpvis.kernels.sensors.echoes import reflect_rays

    require_scene(scene)
    depth, segmentation = require_image(views, "depth"), require_image(views, "segmentation")
    device = depth.device
    check_out(incidence, wp.float32, depth.shape, name="incidence", device=device)
    shares = wp.array(reflectivities(scene, reflectivity), dtype=wp.float32, device=device)
    falls_off = check_flag(falls_off, "falls_off")
    out = take_out(out, wp.float32, depth.shape, device=device)
    shape = _as_image(depth.shape[1:], depth.shape[0])
    images = [image.reshape(shape) for image in (depth, incidence, segmentation)]
    target = out.reshape(shape)
    launch_images(reflect_rays, shape, lambda window: [window, *images, shares, falls_off, target], device=device)
    return out


def gather_returns(
    depth: wp.array,
    intensity: wp.array,
    count: int,
    *,
    keep: Keep = "strongest",
    separation: float = 0.5,
    min_intensity: float = 0.0,
    out: Returns | None = None,
) -> Returns:
    """Combine the rays of each beam to returns: surfaces separated in range give distinct returns.

    The range of a return is the mean range of its rays weighted by intensity. Its intensity is the sum over its rays
    divided by the number of rays of the beam: a surface that covers half of a beam returns half the intensity.

    Args:
        depth: Ranges of the rays of `spread_beams` [m], shape ``(V, H, W * count)``, or ``(V, N * count)`` for a list,
            float32.
        intensity: Intensities of the rays, with the same shape and device, float32.
        count: Number of rays per beam.
        keep: Which returns to keep: ``"strongest"``; ``"last"``, the farthest; or ``"dual"``, the strongest and the
            last, or the second strongest where these are the same, as in Velodyne's dual return mode.
        separation: Minimum distance in range between surfaces of distinct returns [m].
        min_intensity: Minimum intensity of a detected return. With `reflect(..., falls_off=True)`, dark and slanted
            surfaces then disappear at shorter ranges than others.
        out: The result of an earlier call, to be overwritten.

    Returns:
        Ranges and intensities, shape ``(V, 1, H, W)``, or ``(V, 1, N)`` for a list; two returns for ``"dual"``.
    """
    from warpvis.kernels.sensors import echoes

    keep = check_choice(keep, "keep", ("strongest", "last", "dual"))  # type: ignore[assignment]
    count = check_whole(count, "count")
    separation = check_number(separation, "separation", minimum=0.0)
    min_intensity = check_number(min_intensity, "min_intensity", minimum=0.0)
    if not isinstance(depth, wp.array) or depth.dtype is not wp.float32 or depth.ndim not in (2, 3):
        raise ArrayError("depth must be a wp.array of float32 of shape (V, H, W * count) or (V, N * count)")
    if depth.shape[-1] % count:
        raise ArrayError(f"depth must have {count} columns for each beam, got {depth.shape[-1]} columns")
    check_out(intensity, wp.float32, depth.shape, name="intensity", device=depth.device)
    views, height, width = _as_image((*depth.shape[1:-1], depth.shape[-1] // count), depth.shape[0])
    num_returns = 2 if keep == "dual" else 1
    shape = (views, num_returns, *depth.shape[1:-1], width)
    if out is not None and not isinstance(out, Returns):
        raise ArrayError(f"out must be Returns, got {type(out).__name__}")
    result = Returns(
        take_out(out and out.range, wp.float32, shape, name="out.range", device=depth.device),
        take_out(out and out.intensity, wp.float32, shape, name="out.intensity", device=depth.device),
    )
    images = [image.reshape((views, height, width * count)) for image in (depth, intensity)]
    targets = [image.reshape((views, num_returns, height, width)) for image in (result.range, result.intensity)]
    options = [count, separation, min_intensity, keep == "last"]
    launch_images(
        echoes.gather_returns,
        (views, height, width),
        lambda window: [window, *images, *options, *targets],
        device=depth.device,
    )
    return result if out is None else out


def _as_image(shape: tuple[int, ...], views: int) -> tuple[int, int, int]:
    """Return (views, height, width) of images of rays with this shape; a list of rays is one row."""
    return (views, *shape) if len(shape) == 2 else (views, 1, *shape)  # type: ignore[return-value]


def require_rays(rays: object) -> None:
    """Raise an error if `rays` is not a ray pattern."""
    if not isinstance(rays, Rays):
        raise ArrayError(f"rays must be warpvis.cameras.Rays, got {type(rays).__name__}")


def _perpendicular(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors that are orthogonal to each direction and to each other."""
    smallest = np.argmin(np.abs(directions), axis=-1)
    first = np.cross(directions, np.eye(3)[smallest])
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(directions, first)


def require_image(views: object, name: str) -> wp.array:
    """Return an output of `views`, which must be rendered images with this output."""
    if not isinstance(views, Views):
        raise ArrayError(f"views must be warpvis.Views, got {type(views).__name__}")
    image = getattr(views, name)
    if not isinstance(image, wp.array):
        raise ArrayError(f"views must have {name}. Add it to outputs.")
    return image


def reflectivities(scene: Scene, reflectivity: Reflectivity) -> NDArray[np.float32]:
    """Return the reflectivity of each object of a scene, shape ``(objects,)``."""
    count = len(scene.objects)
    if is_number(reflectivity):
        result = np.full(count, check_number(reflectivity, "reflectivity", minimum=0.0))
    elif isinstance(reflectivity, Mapping):
        indices = {part.name: index for index, part in enumerate(scene.objects)}
        result = np.ones(count)
        for name, value in reflectivity.items():
            if name not in indices:
                raise SceneError(f"the scene has no object {name!r}, given in reflectivity")
            result[indices[name]] = check_number(value, f"reflectivity[{name!r}]", minimum=0.0)
    else:
        result = as_numpy(reflectivity, name="reflectivity")
        if result.shape != (count,) or result.dtype.kind not in "fiu" or not (result >= 0).all():
            raise ArrayError(
                f"reflectivity must be {count} numbers from 0 up, one for each object, got shape {result.shape}"
            )
    if not np.isfinite(result).all():
        raise ArrayError("reflectivity must be finite")
    return result.astype(np.float32)
