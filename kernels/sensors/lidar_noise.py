# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Range errors, lost returns and false returns of lidars: `warpvis.sensors.LidarNoise`."""

import warp as wp

from warpvis.kernels.constants import (
    REASON_DROPOUT,
    REASON_EMPTY,
    REASON_GRAZING,
    REASON_VALID,
    STREAM_DROPOUT,
    STREAM_FALSE_RANGE,
    STREAM_FALSE_RETURN,
    STREAM_POWER,
    STREAM_RANGE,
    STREAM_RINGS,
)
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, locate, pose_rotation
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs, limit_depth, range_reason, write_pixel
from warpvis.kernels.sensors.random_numbers import random_word, to_normal, to_uniform

wp.set_module_options(pixel_options("shared/noise.h", "shared/powers.h"))

LN_2 = wp.constant(0.6931471805599453)
MINUS_HALF_LOG2_E = wp.constant(-0.7213475204444817)


@wp.struct
class LidarModel:
    """The parameters of `warpvis.sensors.LidarNoise`. Power is in units of a white surface's at 1 m."""

    sigma: float  # [m]
    sigma_growth: float
    weak_sigma: float  # at the limit of detection [m]
    resolution: wp.float64  # [m]
    ring_sigma: float  # [m]
    dropout: float
    min_power: wp.float64  # 0 if power does not matter
    power_sigma: float  # relative to min_power
    attenuation: float  # exponent of 2 that power falls off with, both ways [1/m]
    false_returns: float
    false_range: float  # [m]


@wp.struct
class Pixel:
    """Key of the random numbers of a ray. Structs of arrays are slow to pass to functions on a CPU."""

    seed: wp.uint32
    number: wp.uint32  # of the view
    frame: wp.uint32
    y: int
    x: int


@wp.struct
class Glare:
    """The light that rays receive from surfaces of their neighbors: a Gaussian of the angle between the rays."""

    firsts: wp.array[wp.int32]
    """(ray + 1): first of its neighbors, row by row; None without glare."""
    neighbors: wp.array[wp.int32]
    """(neighbor): index of its ray."""
    angles: wp.array[float]
    """(neighbor): angle between the rays [rad]."""
    share: float
    """Fraction of the power that a ray receives from a surface next to it."""
    sigma: float
    """Standard deviation [rad]."""
    power: wp.array3d[float]
    """(view, y, x): power of the surface of each ray, relative to the limit of detection; 0 without one."""


@wp.struct
class Echo:
    """The light of a surface: its range [m], and power relative to the limit of detection, also if facing the beam."""

    range: wp.float64
    power: float
    straight: float


@wp.func_native("return warpvis::Powers<warpvis::OnePixel>::power_of_two(exponent);")
def power_of_two(exponent: float) -> float: ...


@wp.func_native("return warpvis::Powers<warpvis::OnePixel>::logarithm(number);")
def logarithm(number: float) -> float: ...


@wp.func
def pixel_of(seed: wp.uint32, draw: wp.vec2ui, y: int, x: int) -> Pixel:
    pixel = Pixel()
    pixel.seed = seed
    pixel.number = draw[0]
    pixel.frame = draw[1]
    pixel.y = y
    pixel.x = x
    return pixel


@wp.func
def draw_word(pixel: Pixel, stream: int) -> wp.uint32:
    return random_word(pixel.seed, wp.uint32(stream), pixel.number, pixel.frame, pixel.y, pixel.x)


@wp.func
def false_echo(model: LidarModel, pixel: Pixel) -> wp.float64:
    """Return the range of a return from a drop of water; +inf without one."""
    found = wp.float64(wp.inf)
    if model.false_returns > 0.0:
        if to_uniform(draw_word(pixel, STREAM_FALSE_RETURN)) < model.false_returns:
            uniform = to_uniform(draw_word(pixel, STREAM_FALSE_RANGE))
            found = wp.float64(-model.false_range * LN_2 * logarithm(uniform))
    return found


@wp.func
def bright_echo(distance: wp.float64) -> Echo:
    """Return an echo that is always detected unless it is lost at random."""
    echo = Echo()
    echo.range = distance
    echo.power = wp.inf
    echo.straight = wp.inf
    return echo


@wp.func
def surface_echo(model: LidarModel, distance: wp.float64, reflectivity: wp.float64, cosine: wp.float64) -> Echo:
    """Return the echo of a surface in fog or rain, by the lidar equation of a surface wider than the beam."""
    echo = bright_echo(distance)
    if model.min_power > wp.float64(0.0):
        straight = float(reflectivity / (distance * distance) / model.min_power)
        echo.straight = straight * power_of_two(-model.attenuation * float(distance))
        echo.power = echo.straight * float(cosine)
    return echo


@wp.func
def shown_echo(
    model: LidarModel,
    inputs: SensorInputs,
    rays_to_world: wp.array[wp.transform],
    ray: wp.vec3d,
    incidence: wp.array3d[float],
    view: int,
    y: int,
    x: int,
) -> Echo:
    """Return the echo of the surface that a ray of the lidar's frame shows; arguments are those of `measure_lidar`."""
    length = wp.length(ray)
    reflectivity = wp.float64(1.0)
    if inputs.segmentation:
        reflectivity = wp.float64(inputs.reflectivity[inputs.segmentation[view, y, x]])
    cosine = wp.float64(0.0)
    if incidence:
        cosine = wp.float64(incidence[view, y, x])
    else:
        along = wp.quat_rotate(pose_rotation(rays_to_world[view]), ray)
        cosine = wp.abs(wp.dot(along, wp.vec3d(inputs.normals[view, y, x])))
    return surface_echo(model, wp.float64(inputs.true_depth[view, y, x]) * length, reflectivity, cosine / length)


@wp.func
def loss_of(model: LidarModel, pixel: Pixel, echo: Echo) -> int:
    """Return why an echo is not detected; VALID if it is."""
    if model.dropout > 0.0:
        if to_uniform(draw_word(pixel, STREAM_DROPOUT)) < model.dropout:
            return REASON_DROPOUT
    noise = float(0.0)
    if model.power_sigma > 0.0:
        noise = model.power_sigma * to_normal(draw_word(pixel, STREAM_POWER))
    if echo.power > 0.0 and echo.power + noise >= 1.0:
        return REASON_VALID
    if echo.straight > 0.0 and echo.straight + noise >= 1.0:
        return REASON_GRAZING
    return REASON_DROPOUT


@wp.func
def ring_noise(sigma: float, seed: wp.uint32, ring: int) -> float:
    """Return the random part of a ring's range error [m]."""
    if sigma == 0.0:
        return 0.0
    zero = wp.uint32(0)
    return sigma * to_normal(random_word(seed, wp.uint32(STREAM_RINGS), zero, zero, 0, ring))


@wp.func
def measured_range(model: LidarModel, pixel: Pixel, echo: Echo, ring_error: float) -> wp.float64:
    """Return the range of a detected echo with errors, rounded to the resolution [m]."""
    found = echo.range + wp.float64(ring_error)
    growth = model.sigma_growth * float(echo.range)
    weak = model.weak_sigma * model.weak_sigma / echo.power
    sigma = wp.sqrt(model.sigma * model.sigma + growth * growth + weak)
    if sigma > 0.0:
        found += wp.float64(sigma * to_normal(draw_word(pixel, STREAM_RANGE)))
    if model.resolution > wp.float64(0.0):
        found = wp.floor(found / model.resolution + wp.float64(0.5)) * model.resolution
    return found


@wp.kernel
def receive_power(
    # Cameras:
    rays_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    incidence_in: wp.array3d[float],
    model: LidarModel,
    inputs: SensorInputs,
    span: int,
    # Out:
    power_out: wp.array3d[float],
):
    """Write the power of every ray's surface relative to the limit of detection; 0 without one.

    See `measure_lidar`.
    """
    view, y, part = wp.tid()
    view, y = locate(window, view, y)

    for x in range(part * span, wp.min((part + 1) * span, inputs.true_depth.shape[2])):
        depth = inputs.true_depth[view, y, x]
        power = float(0.0)
        if wp.isfinite(depth):
            echo = shown_echo(model, inputs, rays_to_world, rays_in[y, x], incidence_in, view, y, x)
            power = echo.power
        power_out[view, y, x] = power


@wp.kernel
def measure_lidar(
    # Cameras:
    rays_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    rays_in: wp.array2d[wp.vec3d],
    rings_in: wp.array2d[wp.int32],
    ring_offsets_in: wp.array[float],
    incidence_in: wp.array3d[float],
    model: LidarModel,
    glare: Glare,
    inputs: SensorInputs,
    span: int,
    # Out:
    images_out: MeasuredImages,
):
    """Write the measured depth of every ray, and the reason for missing depth.

    `rays_in` have depth 1, and only the depth range of `inputs.camera` is read. `rings_in` is None if rings have no
    errors, and `ring_offsets_in` [m] if these are unknown. `incidence_in`, for a motion, are cosines of incidence times
    the length of rays; None if they follow from `rays_to_world`. `glare` has neighbors of rays, or arrays of None. Each
    thread takes `span` rays of a row.
    """
    view, y, part = wp.tid()
    view, y = locate(window, view, y)

    for x in range(part * span, wp.min((part + 1) * span, inputs.true_depth.shape[2])):
        depth = inputs.true_depth[view, y, x]
        if not wp.isfinite(depth) and model.false_returns == 0.0 and not glare.firsts:
            write_pixel(images_out, view, y, x, depth, REASON_EMPTY)
            continue
        ray = rays_in[y, x]
        length = wp.length(ray)
        echo = bright_echo(wp.float64(depth) * length)
        pixel = pixel_of(inputs.seed, inputs.draws[view], y, x)
        drop = false_echo(model, pixel)
        seen = limit_depth(inputs.camera, float(drop / length))
        if drop < echo.range and seen == float(drop / length):
            echo.range = drop
        elif not wp.isfinite(depth):
            echo.power = 0.0
            echo.straight = 0.0
        elif model.min_power > wp.float64(0.0):
            echo = shown_echo(model, inputs, rays_to_world, ray, incidence_in, view, y, x)

        reason = loss_of(model, pixel, echo)
        if glare.firsts:
            number = y * rays_in.shape[1] + x
            stray = Echo()
            for k in range(glare.firsts[number], glare.firsts[number + 1]):
                other = glare.neighbors[k]
                j, i = other // rays_in.shape[1], other % rays_in.shape[1]
                deviation = glare.angles[k] / glare.sigma
                power = glare.share * power_of_two(MINUS_HALF_LOG2_E * deviation * deviation) * glare.power[view, j, i]
                if power > stray.power:
                    stray.power = power
                    stray.range = wp.float64(inputs.true_depth[view, j, i]) * wp.length(rays_in[j, i])
            if stray.power > echo.power and loss_of(model, pixel, stray) == REASON_VALID:
                echo = stray
                reason = REASON_VALID
        measured = float(wp.nan)
        if echo.power == 0.0 and not wp.isfinite(depth):
            measured = depth
            reason = REASON_EMPTY
        elif reason == REASON_VALID:
            ring_error = float(0.0)
            if rings_in:
                ring_error = ring_noise(model.ring_sigma, inputs.seed, rings_in[y, x])
                if ring_offsets_in:
                    ring_error += ring_offsets_in[rings_in[y, x]]
            found = measured_range(model, pixel, echo, ring_error)
            measured = limit_depth(inputs.camera, float(found / length))
            reason = range_reason(measured)
        write_pixel(images_out, view, y, x, measured, reason)


@wp.kernel
def measure_returns(
    window: Window,
    # In:
    range_in: wp.array3d[float],
    intensity_in: wp.array3d[float],
    rings_in: wp.array2d[wp.int32],
    ring_offsets_in: wp.array[float],
    falls_off: bool,
    model: LidarModel,
    inputs: SensorInputs,
    span: int,
    # Out:
    range_out: wp.array3d[float],
    intensity_out: wp.array3d[float],
):
    """Write measured ranges and intensities of returns, (V, returns x height, width); +inf and 0 for lost returns.

    `falls_off`: Whether intensity has been divided by the squared range [1/m^2].
    """
    view, y, part = wp.tid()
    view, y = locate(window, view, y)

    row = y % int(inputs.camera.height)
    for x in range(part * span, wp.min((part + 1) * span, range_in.shape[2])):
        distance = range_in[view, y, x]
        intensity = float(intensity_in[view, y, x])
        echo = bright_echo(wp.float64(distance))
        pixel = pixel_of(inputs.seed, inputs.draws[view], y, x)
        drop = wp.float64(wp.inf)
        if y == row:
            drop = false_echo(model, pixel)
        if drop < echo.range and limit_depth(inputs.camera, float(drop)) == float(drop):
            echo.range = drop
            weakest = model.min_power
            if not falls_off:
                weakest = weakest * drop * drop
            intensity = float(weakest)
        elif not wp.isfinite(distance):
            range_out[view, y, x] = distance
            intensity_out[view, y, x] = intensity
            continue
        else:
            reflectivity = wp.float64(intensity)
            if falls_off:
                reflectivity = reflectivity * echo.range * echo.range
            echo = surface_echo(model, echo.range, reflectivity, wp.float64(1.0))

        measured = float(wp.inf)
        if loss_of(model, pixel, echo) == REASON_VALID:
            ring_error = float(0.0)
            if rings_in:
                ring_error = ring_noise(model.ring_sigma, inputs.seed, rings_in[row, x])
                if ring_offsets_in:
                    ring_error += ring_offsets_in[rings_in[row, x]]
            found = measured_range(model, pixel, echo, ring_error)
            measured = limit_depth(inputs.camera, float(found))
        range_out[view, y, x] = measured
        intensity_out[view, y, x] = wp.where(wp.isfinite(measured), intensity, 0.0)
