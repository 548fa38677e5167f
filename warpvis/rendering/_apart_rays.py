# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays with distinct origins: when they can be used, and their preparation for CPU cores.

Computed in double precision, once per ray table; used by ``kernels/native/cpu/apart_drawing.h``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warpvis.kernels.constants import CPU_LANES, NOWHERE
from warpvis.rendering._ray_bundles import PreparedRays, in_rows, prepare_rays, towards

if TYPE_CHECKING:
    from warpvis.core.ray_camera import RayCamera
    from warpvis.kernels.ray_origin_packets import RayOrigins
    from warpvis.kernels.worlds import Worlds
    from warpvis.scene import Scene

MAX_APART = 0.1
"""Maximum extent of the origins along each axis for which packets are used [m]."""
_ROUNDED = 1e-6  # relative rounding error bound of single precision
_GROUP = CPU_LANES * CPU_LANES


@dataclass(frozen=True)
class PreparedApartRays:
    """Rays of a table with distinct origins, prepared for packets."""

    rays: PreparedRays
    struct: RayOrigins
    begin: NDArray[np.float64]
    """Greatest z of a ray origin in each bundle [m]."""


def takes_packets(scene: Scene, camera: RayCamera, worlds: Worlds, clip_near: bool) -> bool:
    """Return whether packets can cast rays with a camera's ray origins.

    They cannot if the origins are far apart, the scene has movable analytic solids, worlds scale objects, or near
    surfaces are cut away.
    """
    if clip_near or worlds.object_sizes or scene.bvh().has_solids:
        return False
    origins = camera.origins
    assert origins is not None  # cameras without origins use another caster
    return camera.prepared("close origins", lambda: are_close(camera.rays, origins))


def are_close(rays: NDArray[np.float64], origins: NDArray[np.float64]) -> bool:
    """Return whether ray origins are so close to each other that packets of rays are coherent."""
    known = np.isfinite(rays).all(axis=-1)
    return not known.any() or bool(np.ptp(origins[known], axis=0).max() <= MAX_APART)


def prepare_apart(rays: NDArray[np.float64], origins: NDArray[np.float64]) -> PreparedApartRays:
    """Prepare rays of the camera frame, shape (H, W, 3), as `prepare_rays` does, and their origins, shape (H, W, 3)."""
    from warpvis.kernels.ray_origin_packets import RayOrigins

    prepared = prepare_rays(rays)
    given, starts = prepared.struct, origins.reshape(-1, 3)
    place = given.place.numpy()
    exact = [getattr(given, n).numpy().astype(np.float64) + getattr(given, f"rest_{n}").numpy() for n in ("u", "v")]
    passing, begin = np.zeros((2, len(place))), np.zeros(len(place))
    bundles = given.bundle.numpy()
    eyes, most = np.zeros((len(bundles), 3)), np.zeros((len(bundles), 3))
    last = np.zeros(len(bundles))
    for number, (group, count, *axes) in enumerate(bundles[:, :5].tolist()):
        part = np.arange(group, group + count)[:, None] * _GROUP * CPU_LANES + np.arange(_GROUP * CPU_LANES)
        slots = part.ravel()[place[part.ravel()] >= 0]
        at = np.stack([towards(starts[place[slots]], axis) for axis in axes])
        eyes[number, 2] = at[2].min()
        begin[slots] = at[2] - eyes[number, 2]
        for k in range(2):
            aside = at[k] - exact[k][slots] / given.focal * begin[slots]
            eyes[number, k] = (aside.min() + aside.max()) / 2
            passing[k, slots] = (aside - eyes[number, k]) * given.focal
            most[number, k] = np.abs(passing[k, slots]).max()
        most[number, 2] = np.linalg.norm(at.T - eyes[number], axis=1).max()
        last[number] = begin[slots].max()
    struct = RayOrigins()
    rounded = passing.astype(np.float32)
    tiles = rounded.reshape(2, -1, CPU_LANES, CPU_LANES)
    row_p, row_q = in_rows(tiles, _columns(given))
    with np.errstate(divide="ignore", over="ignore"):
        nearest = np.minimum(1 / begin, NOWHERE)
    arrays = {
        "p": rounded[0],
        "q": rounded[1],
        "begin": begin.astype(np.float32),
        "clip_inv_z": nearest.astype(np.float32),
        "row_p": row_p,
        "row_q": row_q,
        "range": _ranges(exact, passing, place >= 0),
        "maxima": (most * (1 + _ROUNDED)).astype(np.float32),
    }
    for name, array in arrays.items():
        setattr(struct, name, wp.array(array, dtype=wp.float32, device="cpu"))
    struct.eye = wp.array(eyes, dtype=wp.float64, device="cpu")
    return PreparedApartRays(prepared, struct, last)


def _columns(given: object) -> NDArray[np.int64]:
    """Return the number of columns of each tile's packets; 0 for tiles without a fit."""
    fit = given.fit.numpy()  # type: ignore[attr-defined]
    return np.where(fit[:, 9] > 0, 2 ** fit[:, 8].astype(np.int64), 0)


def _ranges(exact: list[NDArray], passing: NDArray, there: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Return each tile's ranges of p, q and u q - v p: three centers, then three half widths, as in ``RayOrigins``."""
    (u, v), (p, q) = exact, passing
    values = np.stack([p, q, u * q - v * p]).reshape(3, -1, _GROUP)
    there = there.reshape(-1, _GROUP)
    some = there.any(axis=-1)
    low = np.where(some, np.where(there, values, np.inf).min(axis=-1), 0)
    high = np.where(some, np.where(there, values, -np.inf).max(axis=-1), 0)
    middle = ((low + high) / 2).astype(np.float32).astype(np.float64)
    half = np.maximum(high - middle, middle - low)
    # The rounding error of u q - v p in single precision is relative to its terms.
    terms = np.abs(u * q).reshape(-1, _GROUP) + np.abs(v * p).reshape(-1, _GROUP)
    size = np.stack([np.abs(values[0]), np.abs(values[1]), terms]).max(axis=-1)
    return np.concatenate([middle, half + _ROUNDED * size]).T.astype(np.float32)
