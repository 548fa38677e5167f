# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What comes back of a lidar's beams: incidence and intensity of rays, beams of several rays, and their returns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from warpvis.core.arrays import as_numpy, check_out, check_shape, empty
from warpvis.core.checks import check_angle, check_choice, check_flag, check_number, check_whole, is_number
from warpvis.core.motion import Motion
from warpvis.core.poses import Convention, QuaternionOrder, parse_poses, to_xyzw
from warpvis.core.threads import launch_images
from warpvis.core.types import PoseLike
from warpvis.errors import ArrayError, SceneError
from warpvis.rendering import Views, parse_sensor
from warpvis.scene import Scene, require_scene
from warpvis.sensors._rays import Rays

Reflectivity: TypeAlias = float | Mapping[str, float] | ArrayLike
"""Of all objects; by their names, 1 for others; or of each, in the scene's order."""

Keep = Literal["strongest", "last", "dual"]
"""Which returns of a beam a lidar keeps."""

_MAX_SUBRAYS = 1024
_GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))


@dataclass
class Returns:
    """What came back of beams, `wp.array`s indexed ``[view, return, y, x]``."""

    range: wp.array
    """Ranges [m], ``(V, R, H, W)`` float32, or ``(V, R, N)`` of a list of rays: +inf where there is no such return,
    -inf where a whole beam is too near."""
    intensity: wp.array
    """Intensities, of the same shape, float32: the mean of the beam's rays, 0 where there is no such return."""


def spread_beams(rays: Rays, divergence: float, count: int = 7) -> Rays:
    """Make each ray a beam: several rays that fill a cone about it, evenly.

    Args:
        rays: The rays in the beams' middles, of shape ``(H, W)`` or ``(N,)``.
        divergence: The cone's whole angle [rad]: 0.003 makes 3 cm of 10 m.
        count: How many rays a beam has.

    Returns:
        Rays of shape ``(H, W * count)`` or ``(N * count,)``, those of a beam side by side, with the origin, time and
        ring of the ray that they were made of. `gather_returns` puts them together again.

    Raises:
        ArrayError: An argument is not what it has to be.
    """
    _require_rays(rays)
    divergence = check_angle(divergence, "divergence", least=0.0, most=math.pi)
    count = check_whole(count, "count")
    if count > _MAX_SUBRAYS:
        raise ArrayError(f"count must be at most {_MAX_SUBRAYS} rays in a beam, got {count}")
    middle = np.asarray(rays.directions)
    # A sunflower's seeds: each has as much of the cone as any other.
    radius = np.tan(divergence / 2.0) * np.sqrt((np.arange(count) + 0.5) / count) if count > 1 else np.zeros(1)
    angle = _GOLDEN_ANGLE * np.arange(count)
    first, second = _across(middle)
    spread = middle[..., None, :] + radius[:, None] * (
        np.cos(angle)[:, None] * first[..., None, :] + np.sin(angle)[:, None] * second[..., None, :]
    )
    spread /= np.linalg.norm(spread, axis=-1, keepdims=True)
    return Rays(
        _side_by_side(spread, middle.shape[:-1], count),
        origins=_repeated(rays.origins, count, axis=-2),
        times=_repeated(rays.times, count, axis=-1),
        rings=_repeated(rays.rings, count, axis=-1),
        near=rays.near,
        far=rays.far,
        kind=rays.kind,
        axes=rays.axes,
    )


def measure_incidence(
    views: Views,
    rays: Rays,
    sensor_to_world: PoseLike | Motion,
    *,
    convention: Convention | None = None,
    quaternion: QuaternionOrder = "xyzw",
    out: wp.array | None = None,
) -> wp.array:
    """Compute the cosine between every ray and the normal of what it meets: 1 straight on, 0 along the surface.

    Args:
        views: Images of these rays, with normals.
        rays: What was rendered.
        sensor_to_world: The poses that were rendered, or the motion.
        convention: Axes of the sensor frame of the poses; the rays' own by default.
        quaternion: Order of the quaternions in the poses, ``"xyzw"`` or ``"wxyz"``.
        out: An incidence of an earlier call to write into.

    Returns:
        Cosines, shape ``(V, *rays)`` float32, NaN where nothing is seen.

    Raises:
        ArrayError: An array is not what it has to be.
        PoseError: The poses are malformed.
    """
    from warpvis.kernels import echoes

    _require_rays(rays)
    normals = _image(views, "normals")
    device = normals.device
    if isinstance(sensor_to_world, Motion):
        return _measure_moving_incidence(normals, rays, sensor_to_world, convention, out)
    named = rays.axes if convention is None else convention
    sensor_to_world = to_xyzw(sensor_to_world, quaternion, "sensor_to_world")
    poses = parse_poses(sensor_to_world, convention=named, axes=rays.axes, device=device, name="sensor_to_world")
    check_shape(normals.shape, (len(poses), *rays.shape), name="normals")
    directions = rays.directions.astype(np.float32).reshape(1, -1, 3)
    along = wp.array(directions, dtype=wp.vec3, device=device).reshape(_as_image(rays.shape, 1))
    out = _output(out, normals.shape, "out", device)
    shape = _as_image(rays.shape, len(poses))
    inputs = [along, normals.reshape(shape), out.reshape(shape)]
    launch_images(echoes.measure_incidence, shape, lambda window: [poses, window, *inputs], device=device)
    return out


def _measure_moving_incidence(
    normals: wp.array, rays: Rays, motion: Motion, convention: Convention | None, out: wp.array | None
) -> wp.array:
    from warpvis.kernels.moving_rays import measure_moving_incidence

    device = normals.device
    sensor, views = parse_sensor(rays, motion, convention, device)
    check_shape(normals.shape, (views, *rays.shape), name="normals")
    shape = _as_image(rays.shape, views)
    along = wp.array(rays.directions.reshape(*shape[1:], 3), dtype=wp.vec3d, device=device)
    times = None if rays.times is None else wp.array(rays.times.reshape(shape[1:]), dtype=wp.float64, device=device)
    out = _output(out, normals.shape, "out", device)
    inputs = [along, times, normals.reshape(shape), out.reshape(shape)]
    launch_images(measure_moving_incidence, shape, lambda window: [sensor, window, *inputs], device=device)
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
    """Compute the intensity of what comes back of every ray: reflectivity by the cosine of incidence.

    Args:
        scene: What was rendered.
        views: Its images, with depth and segmentation, on its device.
        incidence: Cosines between rays and normals, as `incidence` makes them, shape ``(V, *rays)`` float32.
        reflectivity: Of all objects, from 0 up; by their names, 1 for those not named; or of each, shape
            ``(objects,)``.
        falls_off: Whether intensity falls with the square of the range, as what a sensor receives does [1/m^2]; by
            default it is what sensors report, calibrated to the target.
        out: An intensity of an earlier call to write into.

    Returns:
        Intensities, shape ``(V, *rays)`` float32, 0 where nothing is seen.

    Raises:
        ArrayError: An array is not what it has to be.
        SceneError: The scene has no object of a name.
    """
    from warpvis.kernels.echoes import reflect_rays

    require_scene(scene)
    depth, segmentation = _image(views, "depth"), _image(views, "segmentation")
    device = depth.device
    check_out(incidence, wp.float32, depth.shape, name="incidence", device=device)
    shares = wp.array(reflectivities(scene, reflectivity), dtype=wp.float32, device=device)
    falls_off = check_flag(falls_off, "falls_off")
    out = _output(out, depth.shape, "out", device)
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
    threshold: float = 0.0,
    out: Returns | None = None,
) -> Returns:
    """Find what comes back of every beam: surfaces that are apart are returns of their own.

    A return's range is the mean of its rays', weighted by intensity, and its intensity is their part of the beam's, so
    that an edge that only half of a beam meets returns half as much.

    Args:
        depth: Ranges of the rays [m], shape ``(V, H, W * count)`` float32, or of a list ``(V, N * count)``: images of
            what `spread_beams` made.
        intensity: Their intensities, of the same shape and device, float32.
        count: How many rays a beam has.
        keep: The return that is kept: ``"strongest"``; ``"last"``, the farthest; or ``"dual"``, the strongest and the
            last, and where that is the same one, the second strongest, as Velodyne's dual return mode has it.
        separation: How far behind each other surfaces have to be to return apart [m].
        threshold: Least intensity that is noticed; with intensities that fall off, it makes dark and slanted surfaces
            go missing at shorter ranges than others.
        out: Returns of an earlier call to write into.

    Returns:
        Ranges and intensities, shape ``(V, 1, H, W)``, and ``(V, 2, H, W)`` for ``"dual"``; of a list ``(V, 1, N)``.

    Raises:
        ArrayError: An argument is not what it has to be.
    """
    from warpvis.kernels import echoes

    keep = check_choice(keep, "keep", ("strongest", "last", "dual"))  # type: ignore[assignment]
    count = check_whole(count, "count")
    separation = check_number(separation, "separation", least=0.0)
    threshold = check_number(threshold, "threshold", least=0.0)
    if not isinstance(depth, wp.array) or depth.dtype is not wp.float32 or depth.ndim not in (2, 3):
        raise ArrayError("depth must be a wp.array of float32 of shape (V, H, W * count) or (V, N * count)")
    if depth.shape[-1] % count:
        raise ArrayError(f"depth must have {count} columns for each beam, got {depth.shape[-1]} columns")
    check_out(intensity, wp.float32, depth.shape, name="intensity", device=depth.device)
    views, height, width = _as_image((*depth.shape[1:-1], depth.shape[-1] // count), depth.shape[0])
    kept = 2 if keep == "dual" else 1
    shape = (views, kept, *depth.shape[1:-1], width)
    if out is not None and not isinstance(out, Returns):
        raise ArrayError(f"out must be Returns, got {type(out).__name__}")
    found = Returns(
        _output(out and out.range, shape, "out.range", depth.device),
        _output(out and out.intensity, shape, "out.intensity", depth.device),
    )
    images = [image.reshape((views, height, width * count)) for image in (depth, intensity)]
    targets = [image.reshape((views, kept, height, width)) for image in (found.range, found.intensity)]
    options = [count, separation, threshold, keep == "last"]
    launch_images(
        echoes.gather_returns,
        (views, height, width),
        lambda window: [window, *images, *options, *targets],
        device=depth.device,
    )
    return found if out is None else out


def _as_image(shape: tuple[int, ...], views: int) -> tuple[int, int, int]:
    """Return views, height and width of images of rays of a shape; a list of rays is one row."""
    return (views, *shape) if len(shape) == 2 else (views, 1, *shape)  # type: ignore[return-value]


def _require_rays(rays: object) -> None:
    if not isinstance(rays, Rays):
        raise ArrayError(f"rays must be warpvis.sensors.Rays, got {type(rays).__name__}")


def _across(directions: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return two unit vectors at right angles to each direction, and to each other."""
    least = np.argmin(np.abs(directions), axis=-1)
    first = np.cross(directions, np.eye(3)[least])
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(directions, first)


def _side_by_side(spread: NDArray[np.float64], shape: tuple[int, ...], count: int) -> NDArray[np.float64]:
    return spread.reshape(*shape[:-1], shape[-1] * count, 3)


def _repeated(values: NDArray | None, count: int, axis: int) -> NDArray | None:
    return None if values is None else np.repeat(np.asarray(values), count, axis=axis)


def _image(views: object, name: str) -> wp.array:
    if not isinstance(views, Views):
        raise ArrayError(f"views must be warpvis.Views, got {type(views).__name__}")
    image = getattr(views, name)
    if not isinstance(image, wp.array):
        raise ArrayError(f"views must have {name}: ask for it in outputs")
    return image


def _output(out: wp.array | None, shape: tuple[int, ...], name: str, device: wp.Device) -> wp.array:
    if out is None:
        return empty(shape, wp.float32, name=name, device=device)
    return check_out(out, wp.float32, shape, name=name, device=device)


def reflectivities(scene: Scene, reflectivity: Reflectivity) -> NDArray[np.float32]:
    """Return the reflectivity of every object of a scene, shape ``(objects,)``."""
    count = len(scene.objects)
    if is_number(reflectivity):
        found = np.full(count, check_number(reflectivity, "reflectivity", least=0.0))
    elif isinstance(reflectivity, Mapping):
        places = {part.name: place for place, part in enumerate(scene.objects)}
        found = np.ones(count)
        for name, value in reflectivity.items():
            if name not in places:
                raise SceneError(f"the scene has no object {name!r}, for which there is a reflectivity")
            found[places[name]] = check_number(value, f"reflectivity[{name!r}]", least=0.0)
    else:
        found = as_numpy(reflectivity, name="reflectivity")
        if found.shape != (count,) or found.dtype.kind not in "fiu" or not (found >= 0).all():
            raise ArrayError(f"reflectivity must be {count} numbers from 0 up, one for each object, got {found.shape}")
    if not np.isfinite(found).all():
        raise ArrayError("reflectivity must be finite")
    return found.astype(np.float32)
