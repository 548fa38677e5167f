# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of mirror images: kernels in `shading/mirrors.py`, one ray at a time."""

from dataclasses import replace

import numpy as np
from reference_layers import cast_layer
from reference_shading import lit_color


def mirror_views(point, normal, pose, boxes):
    """Return the plane of a mirror, the pose of a mirrored camera, (4, 4), and which boxes of objects are behind.

    The x axis of the mirrored camera is flipped. `boxes` are the corners of objects in the world.
    """
    normal = normal / np.linalg.norm(normal)
    if normal @ (pose[:3, 3] - point) < 0:
        normal = -normal
    reflection = np.eye(3) - 2 * np.outer(normal, normal)
    mirrored = np.eye(4)
    mirrored[:3, :3] = reflection @ pose[:3, :3] @ np.diag([-1.0, 1.0, 1.0])
    mirrored[:3, 3] = point + reflection @ (pose[:3, 3] - point)
    return (normal, normal @ point), mirrored, [bool(((corners - point) @ normal <= 0).all()) for corners in boxes]


def mirror_lights(lights, pose):
    """Return lights, with headlights as directional lights along the axis of a camera."""
    return [
        replace(light, kind="directional", direction=tuple(pose[:3, 2])) if light.kind == "headlight" else light
        for light in lights
    ]


def flip_points(width, pixels):
    """Return image points of an image that is flipped from right to left."""
    return np.stack([width - pixels[..., 0], pixels[..., 1]], axis=-1)


def cast_beyond_mirror(corners, plane, origin, direction):
    """Return the distance and the index of the first triangle that a ray meets beyond a plane; None for none."""
    normal, offset = plane
    start = (offset - normal @ origin) / (normal @ direction)
    for distance, number, _ in zip(*cast_layer(corners, origin, direction), strict=True):
        if distance > start * (1 + 1e-9):
            return distance, number
    return None


def hide_unmirrored(scene, rows, index, plane, point):
    """Return the reflectance of a surface, the row of an object and its face, if it is on a plane of an object."""
    normal, offset = plane
    if rows[0] != index or abs(normal @ point - offset) > 1e-6 * (1 + np.abs(point).sum()):
        return 0.0
    look = scene.objects[index].appearance
    return look.materials[0 if look.face_materials is None else look.face_materials[rows[1]]].reflectance


def add_mirror_image(color, mirrored):
    """Return a color with the dimmed color in the mirror, from 0 to 1."""
    return np.minimum(color + mirrored, 1.0)


def reflected_color(scene, triangles, planes, pose, origin, direction):
    """Return the color along a ray of untextured opaque surfaces, from 0 to 1, and whether it has a mirror image.

    `planes` are an object's index, a point and a normal each.
    """
    corners, rows = triangles

    def shade(number, point, eye, lights, dimming=1.0):
        item = scene.objects[rows[number][0]]
        look, face = item.appearance, rows[number][1]
        material = look.materials[0 if look.face_materials is None else look.face_materials[face]]
        base = (*(dimming * part for part in material.base_color[:3]), 1.0)
        material = replace(material, base_color=base, emission=tuple(dimming * part for part in material.emission))
        a, b, c = corners[number]
        normal = np.cross(b - a, c - a)
        normal = normal / np.linalg.norm(normal)
        return lit_color(lights, material, point, normal if normal @ (eye - point) > 0 else -normal, eye, pose[:3, 2])

    distances, numbers, _ = cast_layer(corners, origin, direction)
    if not len(numbers):
        return None, False
    point = origin + distances[0] * direction
    color, has_image = shade(numbers[0], point, pose[:3, 3], scene.lights), False
    for index, at, normal in planes:
        plane, mirrored, _ = mirror_views(at, normal, pose, [])
        share = hide_unmirrored(scene, rows[numbers[0]], index, plane, point)
        if share == 0.0:
            continue
        seen = np.flatnonzero(rows[:, 0] != index)
        # The ray in the mirror: its x axis is flipped, and so is that of the camera.
        local = pose[:3, :3].T @ direction * [-1, 1, 1]
        start = mirrored[:3, :3] @ (pose[:3, :3].T @ (origin - pose[:3, 3]) * [-1, 1, 1]) + mirrored[:3, 3]
        hit = cast_beyond_mirror(corners[seen], plane, start, mirrored[:3, :3] @ local)
        if hit is not None:
            at_hit = start + hit[0] * (mirrored[:3, :3] @ local)
            lights = mirror_lights(scene.lights, pose)
            color = add_mirror_image(color, shade(seen[hit[1]], at_hit, mirrored[:3, 3], lights, share))
            has_image = True
    return color, has_image
