# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Soft shadows and ambient occlusion, ray by ray; the reference. Points and directions: `scene.light_samples`."""

import warp as wp

from warpvis.kernels.casting.triangle_scene import TriangleScene
from warpvis.kernels.casting.worlds import Worlds, row_of
from warpvis.kernels.pinhole import Window, locate
from warpvis.kernels.shading.lighting import DeviceLight, Lights
from warpvis.kernels.shading.shadow_rays import LIGHT_DIRECTIONAL, can_light, is_blocked, is_blocked_up_to, lifted

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def class_of(y: int, x: int) -> int:
    """Return the class of a pixel, by which points of lights are chosen."""
    return (y & 3) * 4 + (x & 3)


@wp.func
def light_at(light: DeviceLight, sample: wp.vec3) -> DeviceLight:
    """Return a light at one of its points, in a frame whose third axis is the light's direction.

    The frame is that of Duff et al. 2017, "Building an Orthonormal Basis, Revisited".
    """
    x, y, z = light.direction[0], light.direction[1], light.direction[2]
    sign = wp.where(z < 0.0, -1.0, 1.0)
    a = -1.0 / (sign + z)
    b = x * y * a
    aside = light.radius * (
        sample[0] * wp.vec3(1.0 + sign * x * x * a, sign * b, -sign * x) + sample[1] * wp.vec3(b, sign + y * y * a, -y)
    )
    moved = light
    if light.kind == LIGHT_DIRECTIONAL:
        moved.direction = wp.normalize(light.direction + aside)
    else:
        moved.position = light.position + aside + light.radius * sample[2] * light.direction
    return moved


@wp.func
def faces_light(light: DeviceLight, point: wp.vec3, normal: wp.vec3) -> bool:
    """Return whether a surface faces a light."""
    if light.kind == LIGHT_DIRECTIONAL:
        return wp.dot(normal, light.direction) < 0.0
    return wp.dot(normal, light.position - point) > 0.0


@wp.kernel
def cast_soft_shadow_rays(
    # Scene:
    scene: TriangleScene,
    lights: Lights,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    shadows_out: wp.array4d[wp.uint8],
):
    """Write the fraction of each light with a radius that shines on the surface of a pixel: (light, view, y, x).

    It is that of the light's points above the plane of the surface, and 0 where its center cannot light the surface.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    point, normal = points_in[view, y, x], normals_in[view, y, x]
    is_seen = segmentation_in[view, y, x] >= 0
    start = lifted(point, normal, wp.transform_get_translation(camera_to_world[view]))
    row = row_of(worlds, view, lights.all.shape[0])
    for number in range(lights.all.shape[1]):
        light = lights.all[row, number]
        if light.shadow >= 0 and light.sample_count > 0:
            above, lit = int(0), int(0)
            if is_seen:
                if can_light(lights, light, point, normal):
                    first = light.first_sample + class_of(y, x) * light.sample_count
                    for sample in range(light.sample_count):
                        moved = light_at(light, lights.samples[first + sample])
                        if faces_light(moved, point, normal):
                            above += 1
                            if not is_blocked(scene, worlds, view, moved, point, start):
                                lit += 1
            shadows_out[light.shadow, view, y, x] = wp.uint8((510 * lit + above) / wp.max(2 * above, 1))


@wp.kernel
def cast_occlusion_rays(
    # Scene:
    scene: TriangleScene,
    lights: Lights,
    # Cameras:
    camera_to_world: wp.array[wp.transform],
    window: Window,
    # In:
    worlds: Worlds,
    directions: wp.array2d[wp.vec3],
    distance: float,
    points_in: wp.array3d[wp.vec3],
    segmentation_in: wp.array3d[wp.int32],
    normals_in: wp.array3d[wp.vec3],
    # Out:
    occlusion_out: wp.array3d[wp.uint8],
):
    """Write the fraction of ambient light that surfaces within a distance do not block, 255 for 1.

    It is the mean over the directions of the pixel's class, (class, direction), that are above the surface, weighted by
    their cosines. `lights` are unused: packets have the same arguments.
    """
    view, y, x = wp.tid()
    view, y = locate(window, view, y)
    point, normal = points_in[view, y, x], normals_in[view, y, x]
    total, clear = float(0.0), float(0.0)
    if segmentation_in[view, y, x] >= 0:
        start = lifted(point, normal, wp.transform_get_translation(camera_to_world[view]))
        for sample in range(directions.shape[1]):
            direction = directions[class_of(y, x), sample]
            cosine = wp.dot(normal, direction)
            if cosine > 0.0:
                total += cosine
                if not is_blocked_up_to(scene, worlds, view, start, wp.vec3d(direction), distance):
                    clear += cosine
    if total > 0.0:
        occlusion_out[view, y, x] = wp.uint8(255.0 * (clear / total) + 0.5)
    else:
        occlusion_out[view, y, x] = wp.uint8(255)
