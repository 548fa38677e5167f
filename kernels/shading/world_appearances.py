# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Lights and materials of worlds, computed from arrays of what differs between them."""

import warp as wp

from warpvis.kernels.shading.lighting import DeviceLight

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})

LIGHT_DIRECTIONAL = wp.constant(1)
CONVERTS = wp.constant(1)  # colors of the light are converted to linear space
FOLLOWS = wp.constant(2)  # highlights have the light's color


@wp.func
def to_linear(value: float) -> float:
    """Convert a display value to linear light (IEC 61966-2-1)."""
    if value <= 0.04045:
        return value / 12.92
    return wp.pow((value + 0.055) / 1.055, 2.4)


@wp.struct
class LightFields:
    """Fields of lights that differ between worlds, each of shape (1 or world, light); None for the scene's."""

    position: wp.array2d[wp.vec3]
    direction: wp.array2d[wp.vec3]
    color: wp.array2d[wp.vec3]
    ambient: wp.array2d[wp.vec3]
    specular: wp.array2d[wp.vec3]
    intensity: wp.array2d[float]
    attenuation: wp.array2d[wp.vec3]
    kind: wp.array2d[wp.int32]  # directional lights then come from the plane through their position, as in MuJoCo
    cone: wp.array2d[wp.vec2]  # outer angle of a spot [rad], and its exponent


@wp.func
def vector_of(values: wp.array2d[wp.vec3], world: int, light: int, otherwise: wp.vec3) -> wp.vec3:
    """Return a field of a light in a world, or the scene's if it does not differ."""
    if not values:
        return otherwise
    return values[world % values.shape[0], light]


@wp.func
def light_color(values: wp.array2d[wp.vec3], world: int, light: int, kind: int, otherwise: wp.vec3) -> wp.vec3:
    """Return a color of a light in a world, in the space in which light is summed."""
    if not values:
        return otherwise
    color = values[world % values.shape[0], light]
    if (kind & CONVERTS) != 0:
        return wp.vec3(to_linear(color[0]), to_linear(color[1]), to_linear(color[2]))
    return color


@wp.kernel
def write_lights(
    # In:
    lights: wp.array2d[DeviceLight],
    intensities: wp.array[float],
    flags: wp.array[wp.int32],
    fields: LightFields,
    # Out:
    lights_out: wp.array2d[DeviceLight],
):
    """Write the lights of every world: those of the scene, which have the intensity 1 in `lights`, with other fields.

    A direction of length 0 is replaced by the scene's.
    """
    world, number = wp.tid()
    light = lights[0, number]
    kind = flags[number]
    intensity = intensities[number]
    if fields.intensity:
        intensity = fields.intensity[world % fields.intensity.shape[0], number]
    specular = wp.vec3(light.specular)
    if (kind & FOLLOWS) != 0:
        specular = light_color(fields.color, world, number, kind, specular)
    direction = wp.normalize(vector_of(fields.direction, world, number, light.direction))
    if wp.length(direction) == 0.0:
        direction = light.direction
    attenuation = vector_of(fields.attenuation, world, number, light.attenuation)
    if wp.length(attenuation) == 0.0:
        attenuation = wp.vec3(1.0, 0.0, 0.0)
    if fields.kind:
        light.kind = fields.kind[world % fields.kind.shape[0], number]
        light.shadow_plane = light.kind == LIGHT_DIRECTIONAL
    if fields.cone:
        cone = fields.cone[world % fields.cone.shape[0], number]
        light.outer_angle = cone[0]
        light.cos_outer = wp.cos(cone[0])
        light.exponent = cone[1]
    light.attenuation = attenuation
    light.position = vector_of(fields.position, world, number, light.position)
    light.direction = direction
    light.color = light_color(fields.color, world, number, kind, light.color) * intensity
    light.ambient = light_color(fields.ambient, world, number, kind, light.ambient) * intensity
    light.specular = light_color(fields.specular, world, number, kind, specular) * intensity
    light.intensity = intensity
    lights_out[world, number] = light


@wp.kernel
def write_entries(
    # In:
    materials: wp.array2d[wp.int32],
    entries: wp.array2d[wp.int32],
    # Out:
    entries_out: wp.array2d[wp.int32],
):
    """Write the entry of every object in every world, given those of its materials; -1 is its original material."""
    world, index = wp.tid()
    material = materials[world, index]
    if material < 0 or material >= entries.shape[1] - 1:
        material = -1
    entries_out[world, index] = entries[index, material + 1]
