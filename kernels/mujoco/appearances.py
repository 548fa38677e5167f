# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of objects and fields of lights in worlds, from MuJoCo's arrays."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

NO_LIGHT, LAST_RESORT = wp.constant(-1), wp.constant(-2)  # headlights, and light of models without others


@wp.func
def is_default(rgba: wp.vec4) -> bool:
    """Return whether a geom with a material takes the material's color."""
    return rgba[0] == 0.5 and rgba[1] == 0.5 and rgba[2] == 0.5 and rgba[3] == 1.0


@wp.func
def clipped(color: wp.vec4) -> wp.vec4:
    return wp.min(wp.max(color, wp.vec4(0.0, 0.0, 0.0, 0.0)), wp.vec4(1.0, 1.0, 1.0, 1.0))


@wp.kernel
def object_colors(
    # In:
    geom_rgba: wp.array2d[wp.vec4],
    geom_matid: wp.array2d[wp.int32],
    mat_rgba: wp.array2d[wp.vec4],
    mat_emission: wp.array2d[float],
    worlds: wp.array[wp.int32],
    geoms: wp.array[wp.int32],
    # Out:
    colors_out: wp.array2d[wp.vec4],
    emission_out: wp.array2d[wp.vec3],
):
    """Write colors and emission of objects in selected worlds: NaN for objects that are not geoms (-1 in `geoms`)."""
    row, index = wp.tid()
    world, geom = worlds[row], geoms[index]
    if geom < 0:
        colors_out[row, index] = wp.vec4(wp.nan, wp.nan, wp.nan, wp.nan)
        emission_out[row, index] = wp.vec3(wp.nan, wp.nan, wp.nan)
        return
    color, factor = wp.vec4(geom_rgba[world % geom_rgba.shape[0], geom]), float(0.0)
    material = geom_matid[world % geom_matid.shape[0], geom]
    if material >= 0 and material < mat_emission.shape[1]:
        factor = wp.max(mat_emission[world % mat_emission.shape[0], material], 0.0)
        if is_default(color):
            color = wp.vec4(mat_rgba[world % mat_rgba.shape[0], material])
    color = clipped(color)
    colors_out[row, index] = color
    emission_out[row, index] = factor * wp.vec3(color[0], color[1], color[2])


@wp.kernel
def light_vectors(
    # In:
    values: wp.array2d[wp.vec3],
    original: wp.array[wp.vec3],
    worlds: wp.array[wp.int32],
    lights: wp.array[wp.int32],
    lowest: float,
    # Out:
    values_out: wp.array2d[wp.vec3],
):
    """Write a field of selected lights in selected worlds, at least `lowest`; lights without an id keep `original`."""
    row, column = wp.tid()
    light = lights[column]
    value = wp.vec3(original[column])
    if light >= 0:
        value = wp.max(wp.vec3(values[worlds[row] % values.shape[0], light]), wp.vec3(lowest, lowest, lowest))
    values_out[row, column] = value


@wp.kernel
def light_switches(
    # In:
    active: wp.array2d[wp.bool],
    worlds: wp.array[wp.int32],
    lights: wp.array[wp.int32],
    # Out:
    intensities_out: wp.array2d[float],
):
    """Write 1 for lights that are on in a world and 0 for others; light of the last resort is on without them."""
    row = wp.tid()
    world = worlds[row] % active.shape[0]
    others = int(0)
    for column in range(lights.shape[0]):
        is_on = bool(lights[column] == NO_LIGHT)
        if lights[column] >= 0:
            is_on = active[world, lights[column]]
        if lights[column] == LAST_RESORT:
            is_on = others == 0
        intensities_out[row, column] = wp.where(is_on, 1.0, 0.0)
        if is_on:
            others += 1
