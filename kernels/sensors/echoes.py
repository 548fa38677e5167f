# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lidar echoes: intensities of rays, and the returns of beams that consist of several rays."""

import warp as wp

from warpvis.kernels.pinhole import Window, locate

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Return:
    """A return: the echo of surfaces that are too close to each other to be resolved."""

    distance: float
    intensity: float


@wp.kernel
def measure_incidence(
    # Cameras:
    rays_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    directions_in: wp.array2d[wp.vec3],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    incidence_out: wp.array3d[float],
):
    """Write the absolute cosine between every ray and the surface normal at its hit; NaN for a miss.

    `directions_in` contains unit vectors in the frame of the poses.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    along = wp.transform_vector(rays_to_world[view], directions_in[y, x])
    incidence_out[view, y, x] = wp.abs(wp.dot(along, normals_in[view, y, x]))


@wp.kernel
def reflect_rays(
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    incidence_in: wp.array3d[float],
    segmentation_in: wp.array3d[wp.int32],
    reflectivity_in: wp.array[float],
    falls_off: bool,
    # Out:
    intensity_out: wp.array3d[float],
):
    """Write the intensity of every ray: the object's reflectivity times the cosine of incidence; 0 for a miss.

    `falls_off`: Whether intensity also decreases with the square of the range [1/m^2].
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    distance = depth_in[view, y, x]
    hit = segmentation_in[view, y, x]
    found = float(0.0)
    if hit >= 0 and wp.isfinite(distance):
        found = reflectivity_in[hit] * incidence_in[view, y, x]
        if falls_off:
            found = found / (distance * distance)
    intensity_out[view, y, x] = found


@wp.func
def next_distance(depth_in: wp.array3d[float], view: int, y: int, first: int, count: int, after: float) -> float:
    """Return the smallest range of a beam's rays that is greater than `after`; +inf if there are no more."""
    found = float(wp.inf)
    for i in range(count):
        distance = depth_in[view, y, first + i]
        if distance > after and distance < found:
            found = distance
    return found


@wp.func
def return_within(
    depth_in: wp.array3d[float],
    intensity_in: wp.array3d[float],
    view: int,
    y: int,
    first: int,
    count: int,
    low: float,
    high: float,
) -> Return:
    """Return the echo of a beam's rays with ranges from `low` to `high`: their intensity-weighted mean range."""
    total = float(0.0)
    moment = float(0.0)
    for i in range(count):
        distance = depth_in[view, y, first + i]
        if distance >= low and distance <= high:
            intensity = intensity_in[view, y, first + i]
            total += intensity
            moment += intensity * (distance - low)
    echo = Return()
    echo.distance = low
    if total > 0.0:
        echo.distance = low + moment / total
    echo.intensity = total / float(count)
    return echo


@wp.kernel
def gather_returns(
    window: Window,
    # In:
    depth_in: wp.array3d[float],
    intensity_in: wp.array3d[float],
    count: int,
    separation: float,
    min_intensity: float,
    keeps_last: bool,
    # Out:
    range_out: wp.array4d[float],
    intensity_out: wp.array4d[float],
):
    """Write one or two returns of beams of `count` adjacent rays: first the strongest, or the last if `keeps_last`.

    Rays belong to one return while gaps between their ranges are at most `separation` [m]. Returns weaker than
    `min_intensity` are dropped. Output indices are (view, return, y, x). The second return is the last one, or the
    second strongest if the last one is the strongest. Without a return, range is +inf and intensity 0; range is -inf if
    the whole beam is too near.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)

    first = x * count
    blocked = int(0)
    for i in range(count):
        if depth_in[view, y, first + i] == -wp.inf:
            blocked += 1

    strongest = Return()
    second = Return()
    last = Return()
    no_range = float(wp.inf)
    if blocked == count:
        no_range = -wp.inf
    strongest.distance = no_range
    second.distance = no_range
    last.distance = no_range

    low = next_distance(depth_in, view, y, first, count, -wp.inf)
    while low < wp.inf:
        high = low
        beyond = next_distance(depth_in, view, y, first, count, high)
        while beyond - high <= separation:
            high = beyond
            beyond = next_distance(depth_in, view, y, first, count, high)
        echo = return_within(depth_in, intensity_in, view, y, first, count, low, high)
        if echo.intensity >= min_intensity and echo.intensity > 0.0:
            last = echo
            if echo.intensity > strongest.intensity:
                second = strongest
                strongest = echo
            elif echo.intensity > second.intensity:
                second = echo
        low = beyond

    primary = strongest
    if keeps_last:
        primary = last
    range_out[view, 0, y, x] = primary.distance
    intensity_out[view, 0, y, x] = primary.intensity
    if range_out.shape[1] > 1:
        if last.distance != strongest.distance:
            second = last
        range_out[view, 1, y, x] = second.distance
        intensity_out[view, 1, y, x] = second.intensity
