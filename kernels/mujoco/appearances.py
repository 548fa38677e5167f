# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of objects and fields of lights in worlds, from MuJoCo's arrays."""

import warp as wp

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

NO_LIGHT, LAST_RESORT = wp.constant(-1), wp.constant(-2)  # headlights, and light of models without others
TYPE_SPOT, TYPE_DIRECTIONAL, TYPE_POINT = wp.constant(0), wp.constant(1), wp.constant(2)  # mujoco.mjtLightType
LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT = wp.constant(1), wp.constant(2), wp.constant(3)


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
    types: wp.array2d[wp.int32],
    worlds: wp.array[wp.int32],
    lights: wp.array[wp.int32],
    # Out:
    intensities_out: wp.array2d[float],
):
    """Write 1 for lights that are on in a world and 0 for others, such as image lights.

    Light of the last resort is on in worlds that have point lights at most.
    """
    row = wp.tid()
    world = worlds[row]
    others = int(0)
    for column in range(lights.shape[0]):
        is_on, light = bool(lights[column] == NO_LIGHT), lights[column]
        is_counted = bool(is_on)
        if light >= 0:
            kind = types[world % types.shape[0], light]
            is_on = active[world % active.shape[0], light] and kind >= TYPE_SPOT and kind <= TYPE_POINT
            is_counted = is_on and kind != TYPE_POINT
        if light == LAST_RESORT:
            is_on = others == 0
        intensities_out[row, column] = wp.where(is_on, 1.0, 0.0)
        if is_counted:
            others += 1


@wp.kernel
def light_shapes(
    # In:
    types: wp.array2d[wp.int32],
    cutoffs: wp.array2d[float],
    exponents: wp.array2d[float],
    attenuations: wp.array2d[wp.vec3],
    worlds: wp.array[wp.int32],
    lights: wp.array[wp.int32],
    original: wp.array[wp.int32],
    # Out:
    kinds_out: wp.array2d[wp.int32],
    cones_out: wp.array2d[wp.vec2],
    attenuations_out: wp.array2d[wp.vec3],
):
    """Write kinds, cones and attenuations of selected lights in selected worlds; only spots have the latter two.

    Lights without an id are of the `original` kind.
    """
    row, column = wp.tid()
    world, light = worlds[row], lights[column]
    kind = int(original[column])
    cone, attenuation = wp.vec2(wp.PI, 0.0), wp.vec3(1.0, 0.0, 0.0)
    if light >= 0:
        found = types[world % types.shape[0], light]
        kind = wp.where(found == TYPE_DIRECTIONAL, LIGHT_DIRECTIONAL, LIGHT_POINT)
        if found == TYPE_SPOT:
            kind = LIGHT_SPOT
            cutoff = cutoffs[world % cutoffs.shape[0], light]
            angle = wp.where(cutoff < 180.0, wp.radians(wp.max(cutoff, 0.0)), wp.PI)
            cone = wp.vec2(angle, wp.max(exponents[world % exponents.shape[0], light], 0.0))
            attenuation = wp.max(attenuations[world % attenuations.shape[0], light], wp.vec3(0.0, 0.0, 0.0))
    kinds_out[row, column] = kind
    cones_out[row, column] = cone
    attenuations_out[row, column] = attenuation
