# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Time-of-flight depth from the phase of modulated light: the return of each pixel, and the measured range.

Phases are in cycles, computed in double precision by polynomials, so that all devices agree.
"""

import warp as wp

from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window, image_ray, locate
from warpvis.kernels.sensors.noise import MeasuredImages, SensorInputs
from warpvis.kernels.sensors.sub_rays import SIDE, SUB_RAYS, TILE_PIXELS, sub_ray_corner

wp.set_module_options(pixel_options("shared/time_of_flight.h"))


@wp.struct
class FlightModel:
    """Parameters of a sensor. The unit of light is the return of a white surface at 1 m at normal incidence."""

    frequencies: int  # number of modulation frequencies
    turns: wp.vec3d  # phase cycles per meter of range, in descending order; 0 for unused frequencies
    unambiguous: wp.float64  # range at which all phases repeat [m]
    laps: int  # cycles of the first frequency in the unambiguous range
    noise_scale: float  # standard deviation of the range if light and amplitude are 1, without background [m]
    background: float
    min_signal: float
    max_signal: float
    min_coherence: float
    offset: wp.float64  # [m]
    wiggle: wp.float64  # [m]
    wiggle_turns: wp.float64  # phase of the wiggling error at range 0 [cycles]
    slots: wp.array3d[wp.int32]  # number of an edge pixel with sub-rays, -1 for other pixels; None without sub-rays
    mixes: wp.array2d[wp.vec4]  # the output of `mix_sub_rays`


@wp.func_native("return warpvis::Phase<warpvis::OnePixel>::sine(turns);")
def sine(turns: wp.float64) -> wp.float64: ...


@wp.func
def cosine(turns: wp.float64) -> wp.float64:
    return sine(turns + wp.float64(0.25))


@wp.func
def angle(x: wp.float64, y: wp.float64) -> wp.float64:
    """Return the angle of a phasor in [0, 1) [cycles] by a polynomial with an error below 2e-12."""
    zero = wp.float64(0.0)
    small, large = wp.min(wp.abs(x), wp.abs(y)), wp.max(wp.abs(x), wp.abs(y))
    if large == zero:
        return zero
    t = small / large
    s = t * t
    total = s * wp.float64(6.846281285625003e-05) - wp.float64(0.0005190813772065897)
    total = total * s + wp.float64(0.0018465664310945834)
    total = total * s - wp.float64(0.004181249885153829)
    total = total * s + wp.float64(0.006987357495699451)
    total = total * s - wp.float64(0.009610647637873044)
    total = total * s + wp.float64(0.011940171744691598)
    total = total * s - wp.float64(0.014405332246503474)
    total = total * s + wp.float64(0.017675200770167324)
    total = total * s - wp.float64(0.022735701388264275)
    total = total * s + wp.float64(0.031830957350162684)
    total = total * s - wp.float64(0.05305164715890183)
    total = total * s + wp.float64(0.1591549430903502)
    turns = total * t
    if wp.abs(y) > wp.abs(x):
        turns = wp.float64(0.25) - turns
    if x < zero:
        turns = wp.float64(0.5) - turns
    if y < zero:
        turns = wp.float64(1.0) - turns
    return wp.where(turns < wp.float64(1.0), turns, zero)


@wp.func_native(
    """
typedef warpvis::FlightReturn<warpvis::OnePixel> Return;
const Return light = Return::of(axes, ray[0], ray[1], depth, normal.c, reflectivity);
return wp::vec_t<3, double>(light.range, light.signal, light.straight);
"""
)
def light_of(ray: wp.vec3d, axes: wp.mat33, depth: float, normal: wp.vec3, reflectivity: float) -> wp.vec3d: ...


@wp.func
def unwrap(model: FlightModel, phases: wp.vec3d) -> wp.float64:
    """Return the range that fits the phases of all frequencies best, and the phase of the first one exactly."""
    best, min_error = wp.float64(0.0), wp.float64(wp.inf)
    for lap in range(model.laps):
        found = (phases[0] + wp.float64(lap)) / model.turns[0]
        error = wp.float64(0.0)
        for k in range(1, model.frequencies):
            difference = phases[k] - model.turns[k] * found
            difference = difference - wp.floor(difference + wp.float64(0.5))
            error += difference * difference
        if error < min_error:
            best, min_error = found, error
    return best


@wp.kernel
def mix_sub_rays(
    # Cameras:
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    model: FlightModel,
    inputs: SensorInputs,
    pixels: wp.array2d[wp.int32],
    points: wp.array3d[wp.vec2],
    depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    segmentation: wp.array3d[wp.int32],
    first: int,
    # Out:
    mixes_out: wp.array2d[wp.vec4],
):
    """Write the sum of each edge pixel's phasors: range [m], amplitude, total light, amplitude at normal incidence.

    The range is +inf without returned light, and NaN if coherence is too low because the light is of several ranges.
    Nothing is written for pixel -1.
    """
    view, tile, index = wp.tid()
    view, tile = locate(window, view, tile)
    number = first + tile * TILE_PIXELS + index
    if pixels[view, number] < 0:
        return
    corner = sub_ray_corner(tile, index)
    all_light, all_straight = wp.float64(0.0), wp.float64(0.0)
    real, imaginary = wp.vec3d(), wp.vec3d()
    for k in range(SUB_RAYS):
        i, j = corner[0] + k % SIDE, corner[1] + k / SIDE
        if depth[view, j, i] < wp.inf:
            share = float(1.0)
            if segmentation:
                if segmentation[view, j, i] >= 0:
                    share = inputs.reflectivity[segmentation[view, j, i]]
            ray = image_ray(inputs.camera, points[view, j, i])
            light = light_of(ray, axes[view], depth[view, j, i], normals[view, j, i], share)
            turns = light[0] * model.turns
            real += light[1] * wp.vec3d(cosine(turns[0]), cosine(turns[1]), cosine(turns[2]))
            imaginary += light[1] * wp.vec3d(sine(turns[0]), sine(turns[1]), sine(turns[2]))
            all_light += light[1]
            all_straight += light[2]
    mix = wp.vec4(wp.inf, 0.0, 0.0, 0.0)
    if all_light > wp.float64(0.0):
        phases = wp.vec3d()
        coherence_of_all = wp.float64(1.0)
        for k in range(model.frequencies):
            phases[k] = angle(real[k], imaginary[k])
            coherence_of_all = wp.min(
                coherence_of_all, wp.sqrt(real[k] * real[k] + imaginary[k] * imaginary[k]) / all_light
            )
        coherence = wp.sqrt(real[0] * real[0] + imaginary[0] * imaginary[0]) / all_light
        found = float(unwrap(model, phases))
        if coherence_of_all < wp.float64(model.min_coherence):
            found = wp.nan
        part = wp.float64(1.0 / float(SUB_RAYS))
        mix = wp.vec4(
            found, float(part * coherence * all_light), float(part * all_light), float(part * coherence * all_straight)
        )
    mixes_out[view, number] = mix


@wp.func_native("warpvis::measure<warpvis::Flight>(warpvis::sensor_row(inputs, images_out, view, y), x, model, axes);")
def measure_pixels(
    model: FlightModel,
    inputs: SensorInputs,
    axes: wp.mat33,
    view: int,
    y: int,
    x: int,
    images_out: MeasuredImages,
): ...


@wp.kernel
def measure_time_of_flight(
    # Cameras:
    axes: wp.array[wp.mat33],
    window: Window,
    # In:
    model: FlightModel,
    inputs: SensorInputs,
    # Out:
    images_out: MeasuredImages,
):
    """Write the measured depth of every pixel, and the reason for missing depth."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    measure_pixels(model, inputs, axes[view], view, y, x, images_out)
