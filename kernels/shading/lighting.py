# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of visible surfaces under the lights of a scene: ambient light, Lambert's law, and specular highlights.

Formulas are those of `warpvis.scene.lights.Light`, summed over the lights; there are no shadows.
"""

import warp as wp

from warpvis.kernels.casting.worlds import Worlds
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.base_colors import (
    DeviceMaterials,
    Footprint,
    factors_of,
    frame_of,
    material_of,
    scaled_triangle,
    surface_color,
    to_bytes,
    weights,
)
from warpvis.kernels.shading.textures import to_linear, to_screen

wp.set_module_options({"enable_backward": False, "fuse_fp": False, "default_grid_stride": False})

LIGHT_AMBIENT, LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT, LIGHT_HEADLIGHT = (wp.constant(kind) for kind in range(5))
FALLOFF_OPENGL, FALLOFF_WEBOTS, FALLOFF_GLTF = (wp.constant(kind) for kind in range(3))
PI = wp.constant(3.14159265358979)


@wp.struct
class DeviceLight:
    """A light in the world frame; colors include its intensity and are in the space in which light is summed."""

    kind: int
    position: wp.vec3
    direction: wp.vec3
    color: wp.vec3
    ambient: wp.vec3
    specular: wp.vec3
    falloff: int
    attenuation: wp.vec3
    reach: float
    inner_angle: float
    outer_angle: float
    exponent: float


@wp.struct
class Lights:
    """All lights of a scene."""

    all: wp.array[DeviceLight]
    is_linear: bool  # whether light is summed in linear space, or else in display color space


@wp.func
def cone_share(light: DeviceLight, cosine: float) -> float:
    """Return the fraction of a spot's light in a direction, given the cosine of its angle to the axis."""
    if light.falloff == FALLOFF_GLTF:
        limit = wp.cos(light.outer_angle)
        share = wp.clamp((cosine - limit) / wp.max(wp.cos(light.inner_angle) - limit, 1.0e-3), 0.0, 1.0)
        return share * share
    angle = wp.acos(wp.clamp(cosine, -1.0, 1.0))
    if light.falloff == FALLOFF_WEBOTS:
        if angle <= light.inner_angle:
            return 1.0
        return wp.clamp((light.outer_angle - angle) / wp.max(light.outer_angle - light.inner_angle, 1.0e-30), 0.0, 1.0)
    if light.outer_angle >= PI:
        return 1.0
    if angle > light.outer_angle:
        return 0.0
    return wp.pow(wp.max(cosine, 0.0), light.exponent)


@wp.func
def strength(light: DeviceLight, distance: float, cosine: float) -> float:
    """Return the fraction of a point or spot light that reaches a distance `distance`, as in `Light.strength`."""
    if distance > light.reach:
        return 0.0
    divisor = light.attenuation[0] + light.attenuation[1] * distance + light.attenuation[2] * distance * distance
    share = 1.0 / divisor
    if light.falloff == FALLOFF_GLTF and light.reach < 1.0e30:
        part = distance / light.reach
        share *= wp.clamp(1.0 - part * part * part * part, 0.0, 1.0)
    if light.kind == LIGHT_SPOT:
        share *= cone_share(light, cosine)
    return share


@wp.func
def lit(
    light: DeviceLight,
    point: wp.vec3,
    normal: wp.vec3,
    to_eye: wp.vec3,
    forward: wp.vec3,
    base: wp.vec3,
    gloss: wp.vec4,
) -> wp.vec3:
    """Return the reflection of a light: `base` is the surface's color, `gloss` its specular color and exponent."""
    if light.kind == LIGHT_AMBIENT:
        return wp.cw_mul(light.ambient, base)
    to_light, share = -light.direction, float(1.0)
    if light.kind == LIGHT_HEADLIGHT:
        to_light = -forward
    elif light.kind != LIGHT_DIRECTIONAL:
        offset = light.position - point
        distance = wp.length(offset)
        to_light = offset / wp.max(distance, 1.0e-12)
        share = strength(light, distance, -wp.dot(to_light, light.direction))
    facing = wp.dot(normal, to_light)
    shown = wp.cw_mul(light.ambient, base)
    if facing > 0.0:
        scattered = wp.cw_mul(light.color, base) * facing
        if light.falloff == FALLOFF_GLTF:  # Lambertian reflection of an illuminance [lx]
            scattered = scattered / PI
        half = wp.normalize(to_light + to_eye)
        glossy = wp.pow(wp.max(wp.dot(half, normal), 0.0), gloss[3])
        shown += scattered + wp.cw_mul(light.specular, wp.vec3(gloss[0], gloss[1], gloss[2])) * glossy
    return shown * share


@wp.func
def rgb(color: wp.vec4) -> wp.vec3:
    return wp.vec3(color[0], color[1], color[2])


@wp.func
def in_space(color: wp.vec3, is_linear: bool, target_linear: bool) -> wp.vec3:
    """Convert a color between linear and display color space."""
    if target_linear and not is_linear:
        return wp.vec3(to_linear(color[0]), to_linear(color[1]), to_linear(color[2]))
    if is_linear and not target_linear:
        return wp.vec3(to_screen(color[0]), to_screen(color[1]), to_screen(color[2]))
    return color


@wp.func
def smooth_normal(
    appearance: DeviceMaterials, worlds: Worlds, view: int, index: int, face: int, point: wp.vec3, flat: wp.vec3
) -> wp.vec3:
    """Return the object's interpolated vertex normal, on the visible side; `flat` if it has no vertex normals."""
    rows = appearance.object_rows[index, 4]
    if face < 0 or rows < 0:
        return flat
    frame, factors = frame_of(appearance, worlds, view, index), factors_of(appearance, worlds, view, index)
    triangle = scaled_triangle(appearance, appearance.object_rows[index, 0] + face, factors)
    w = weights(triangle, wp.transform_point(wp.transform_inverse(frame), point))
    row = rows + face
    mixed = w[0] * appearance.normals[row, 0] + w[1] * appearance.normals[row, 1] + w[2] * appearance.normals[row, 2]
    normal = wp.transform_vector(frame, wp.cw_div(mixed, factors))
    length = wp.length(normal)
    if length <= 1.0e-6:
        return flat
    normal = normal / length
    if wp.dot(wp.transform_vector(frame, wp.cw_div(triangle.normal, factors)), flat) < 0.0:  # seen from behind
        normal = -normal
    return normal


@wp.kernel
def shade_lit_colors(
    # Scene:
    appearance: DeviceMaterials,
    lights: Lights,
    # Cameras:
    footprint: Footprint,
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    faces_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    color_out: wp.array3d[wp.vec3ub],
):
    """Write lit colors of visible surfaces, and the background elsewhere."""
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    index = segmentation_in[view, y, x]
    color = 1.0 * appearance.background
    if index >= 0:
        camera, face = camera_to_world[view], faces_in[view, y, x]
        point, flat = points_in[view, y, x], normals_in[view, y, x]
        normal = smooth_normal(appearance, worlds, view, index, face, point, flat)
        surface = surface_color(appearance, footprint, camera, worlds, view, point, index, face)
        material = appearance.materials[material_of(appearance, index, face)]
        base, texel = rgb(surface.color), rgb(surface.texel)
        # The fixed-function pipeline lights the untextured surface, clamps the result and multiplies by the texture.
        if lights.is_linear or surface.is_linear:
            base = in_space(wp.cw_mul(base, texel), surface.is_linear, lights.is_linear)
            texel = wp.vec3(1.0, 1.0, 1.0)
        specular = in_space(material.specular, material.is_linear, lights.is_linear)
        gloss = wp.vec4(specular[0], specular[1], specular[2], material.shininess)
        to_eye = wp.normalize(wp.transform_get_translation(camera) - point)
        forward = wp.quat_rotate(wp.transform_get_rotation(camera), wp.vec3(0.0, 0.0, 1.0))
        total = in_space(material.emission, material.is_linear, lights.is_linear)
        for number in range(lights.all.shape[0]):
            total += lit(lights.all[number], point, normal, to_eye, forward, base, gloss)
        if not lights.is_linear:
            total = wp.cw_mul(wp.min(total, wp.vec3(1.0, 1.0, 1.0)), texel)
        color = in_space(total, lights.is_linear, False)
    color_out[view, y, x] = to_bytes(color)
