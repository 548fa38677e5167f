# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of base and lit colors: `warpvis.kernels.shading.base_colors` without lookup tables."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from warpvis.core.poses import poses_to_matrices
from warpvis.scene.materials import Appearance

SIDES = ((0, 1), (0, -1), (1, 1), (1, -1), (2, 1), (2, -1))
"""Axis and sign of a cube's faces: right, left, up, down, front, back."""


def to_linear(values):
    """Return linear light of sRGB values (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def to_screen(values):
    """Return sRGB values of linear light."""
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * np.maximum(values, 0) ** (1 / 2.4) - 0.055)


def converted(colors, of, to):
    """Return colors (..., 4) converted between color spaces; opacity is unchanged."""
    if of == to:
        return colors
    change = to_linear if to == "linear" else to_screen
    return np.concatenate([change(colors[..., :3]), colors[..., 3:]], axis=-1)


def levels_of(image, is_encoded=False):
    """Return the mip levels of an image, down to one texel: interpolated at the centers of half as many texels.

    Bytes are rounded at every level, floats are not.
    """
    has_bytes = image.dtype == np.uint8
    if has_bytes:
        image = np.concatenate([image, np.full((*image.shape[:2], 4 - image.shape[2]), 255)], axis=2)
    levels = [image.astype(np.float64)]
    while max(levels[-1].shape[:2]) > 1:
        shown = converted(levels[-1] / 255, "srgb", "linear") if is_encoded else levels[-1] / 255
        for axis in (0, 1):
            size = shown.shape[axis]
            half = max(1, size // 2)
            centers = (np.arange(half) + 0.5) / half
            shown = np.apply_along_axis(
                lambda row, at=centers, of=size: np.interp(at, (np.arange(of) + 0.5) / of, row), axis, shown
            )
        shown = converted(shown, "linear", "srgb") if is_encoded else shown
        levels.append(np.floor(shown * 255 + 0.5 + 1e-9) if has_bytes else shown * 255)
    return levels


@lru_cache(maxsize=16)
def texture_levels(texture, is_encoded):
    return levels_of(texture.image, is_encoded)


def wrapped(index, size, mode):
    if mode == "clamp":
        return min(max(index, 0), size - 1)
    if mode == "mirror":
        index %= 2 * size
        return index if index < size else 2 * size - 1 - index
    return index % size


def texel(level, column, row, texture, space):
    at = level[wrapped(row, len(level), texture.wrap_v), wrapped(column, level.shape[1], texture.wrap_u)]
    return converted(at / 255, texture.color_space, space)


def sample_level(level, uv, texture, space):
    """Return the color of one mip level at `uv`, v upwards."""
    x, y = uv[0] * level.shape[1], (1 - uv[1]) * len(level)
    if texture.filter == "nearest":
        return texel(level, int(np.floor(x)), int(np.floor(y)), texture, space)
    column, row = int(np.floor(x - 0.5)), int(np.floor(y - 0.5))
    right, below = x - 0.5 - column, y - 0.5 - row
    mixed = 0.0
    for dy, of_row in ((0, 1 - below), (1, below)):
        for dx, of_column in ((0, 1 - right), (1, right)):
            mixed = mixed + of_row * of_column * texel(level, column + dx, row + dy, texture, space)
    return mixed


def sample(texture, uv, across, below, space):
    """Return the color at `uv`, where `across` and `below` are the offsets to the adjacent pixels."""
    levels = texture_levels(texture, space == "linear" and texture.color_space == "srgb")
    levels = levels if texture.mipmaps else levels[:1]
    size = np.array(levels[0].shape[1::-1])
    longest = max(np.linalg.norm(across * size), np.linalg.norm(below * size))
    level = 0.0
    if texture.filter == "linear" and longest > 1:
        level = min(np.log2(longest), len(levels) - 1)
    finer = int(level)
    color = sample_level(levels[finer], uv, texture, space)
    if level > finer:
        color = color + (level - finer) * (sample_level(levels[finer + 1], uv, texture, space) - color)
    return color


def weights(corners, point):
    """Return the barycentric coordinates of a point in the triangle's plane."""
    a, ab, ac = corners[0], corners[1] - corners[0], corners[2] - corners[0]
    normal = np.cross(ab, ac)
    b = np.cross(point - a, ac) @ normal / (normal @ normal)
    c = np.cross(ab, point - a) @ normal / (normal @ normal)
    return np.array([1 - b - c, b, c])


def base_color(*where):
    """Return the base color of a mesh where a ray hits one of its triangles, uint8; arguments of `exact_base_color`."""
    return np.floor(np.clip(exact_base_color(*where), 0, 1) * 255 + 0.5)


def exact_base_color(appearance, faces, face, corners, ray, steps, space="srgb"):
    """Return the base color of a mesh where a ray hits one of its triangles, in a color space.

    Args:
        appearance: A `warpvis.scene.materials.Appearance`.
        faces: The mesh's faces.
        face: Index of the triangle.
        corners: Its vertices relative to the ray's origin, (3, 3).
        ray: The ray, of any length.
        steps: Offsets to the rays of the next pixels across and below, (2, 3).
        space: The color space.
    """
    number = 0 if appearance.face_materials is None else appearance.face_materials[face]
    material = appearance.materials[number]
    normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    depth = normal @ corners[0] / (normal @ ray)
    point = ray * depth
    color = np.array(material.base_color)
    share = weights(corners, point)
    if appearance.vertex_colors is not None:
        rows = appearance.vertex_colors[faces[face]]
        color = color * (share @ (rows / 255 if rows.dtype == np.uint8 else rows))
    elif appearance.face_colors is not None:
        row = appearance.face_colors[face]
        color = color * (row / 255 if row.dtype == np.uint8 else row)
    if material.texture is not None:
        uv = appearance.corner_uv(faces)[face].astype(np.float64)
        repeat = np.array(material.texture_repeat)
        moves = [(step - ray * (normal @ step) / (normal @ ray)) * depth for step in steps]
        across, below = (((weights(corners, point + move) - share) @ uv) * repeat for move in moves)
        color = color * sample(material.texture, share @ uv * repeat, across, below, material.color_space)
    return converted(color, material.color_space, space)[:3]


def lit_color(lights, material, point, normal, eye, forward, unblocked=None, open_fraction=1.0):
    """Return the color of a surface point of an untextured material under all lights, sRGB from 0 to 1.

    `unblocked` are the fractions of lights with shadows that reach the point; None without shadows. In display color
    space, each of these lights is a separate pass, which is clamped and blocked as a whole.
    """
    space = "linear" if any(light.color_space == "linear" for light in lights) else "srgb"
    total, passes = light_sums(lights, material, point, normal, eye, forward, space, unblocked, open_fraction)
    total = np.minimum(total, 1) + passes if space == "srgb" else total
    return np.clip(converted(np.array([*total, 1.0]), space, "srgb")[:3], 0, 1)


def light_sums(lights, material, point, normal, eye, forward, space, unblocked=None, open_fraction=1.0):
    """Return the sum of the light of a point in a color space, and that of lights that are separate passes."""
    fractions = iter(() if unblocked is None else unblocked)

    def of(color, stored):
        return converted(np.array([*color[:3], 1.0]), stored, space)[:3]

    base, shine = of(material.base_color, material.color_space), of(material.specular, material.color_space)
    if material.shading == "unlit":
        return base, 0.0
    total, passes = of(material.emission, material.color_space), 0.0
    to_eye = (eye - point) / np.linalg.norm(eye - point)
    for light in lights:
        ambient, color = of(light.ambient, light.color_space), of(light.color, light.color_space)
        specular = color if light.specular is None else of(light.specular, light.color_space)
        share = light.intensity * light.strength(point)
        if light.kind in ("point", "spot"):
            way = np.array(light.position) - point
        else:
            way = -np.array(forward if light.kind == "headlight" else light.direction)
        way = way / np.linalg.norm(way)
        facing = way @ normal
        fraction = 1.0
        if light.casts_shadow:
            fraction = next(fractions, 1.0)
        shown = open_fraction * ambient * base
        if light.kind != "ambient" and facing > 0:
            half = (way + to_eye) / np.linalg.norm(way + to_eye)
            scattered = facing * color * base / (np.pi if light.falloff == "gltf" else 1.0)
            highlight = max(half @ normal, 0) ** material.shininess * specular * shine
            lit = scattered + highlight
            shown = shown + (lit if space == "srgb" else fraction * lit)
        if unblocked is not None and light.casts_shadow and space == "srgb":
            passes = passes + fraction * np.minimum(share * shown, 1)
        else:
            total = total + share * shown
    return total, passes


def shade_base_colors(scene, camera, poses, views, *, object_poses=None):
    """Return the expected colors of pixels, at the hit point of their ray on the triangle that the view reports."""
    seg, faces = views.segmentation.numpy(), views.faces.numpy()
    expected = np.zeros((*seg.shape, 3))
    steps = np.diag([1 / camera.fx, 1 / camera.fy, 1])[:2]
    for view, pose in enumerate(poses_to_matrices(np.atleast_2d(poses)).astype(np.float64)):
        for y, x in np.argwhere(seg[view] >= 0):
            item, face = scene.objects[seg[view, y, x]], faces[view, y, x]
            vertices = item.vertices
            if object_poses is not None and item.movable:
                place = poses_to_matrices(object_poses[view])
                vertices = item.mesh_vertices.astype(np.float64) @ place[:3, :3].T + place[:3, 3]
            corners = (vertices[item.faces[face]].astype(np.float64) - pose[:3, 3]) @ pose[:3, :3]
            ray = np.array([(x + 0.5 - camera.cx) / camera.fx, (y + 0.5 - camera.cy) / camera.fy, 1.0])
            look = item.appearance or Appearance()
            expected[view, y, x] = base_color(look, item.faces, face, corners, ray, steps)
    return expected


def write_lights(lights, worlds, fields):
    """Return the lights of every world, as lists of `Light`: those of the scene, with arrays of other fields."""
    names = {f"light_{name}s": name for name in ("position", "direction", "color", "ambient", "specular")}
    names["light_intensities"] = "intensity"
    found = []
    for world in range(worlds):
        rows = {names[name]: rows[world % len(rows)] for name, rows in fields.items() if rows is not None}
        found.append(
            [
                replace(
                    light, **{name: row[k].tolist() if row.ndim > 1 else float(row[k]) for name, row in rows.items()}
                )
                for k, light in enumerate(lights)
            ]
        )
    return found


def write_entries(materials, entries):
    """Return the entry of every object in every world: column 0 of `entries` is its own, the others are materials'."""
    chosen = np.where((materials < 0) | (materials >= entries.shape[1] - 1), -1, materials)
    return entries[np.arange(len(entries))[None], chosen + 1]


def shade_lit_colors(lights, materials, poses, views, shadows=None):
    """Return the expected lit colors from a view's points and normals, (V, H, W, 3).

    There is one material per object. Both may be lists with one item for each view. `shadows` are images of the
    lights with shadows, 255 where they shine, (light, V, H, W).
    """
    count = len(np.atleast_2d(poses))
    lights = lights if isinstance(lights[0], list) else [lights] * count
    materials = materials if isinstance(materials[0], list) else [materials] * count
    seg, points, normals = (getattr(views, key).numpy() for key in ("segmentation", "points", "normals"))
    expected = np.zeros((*seg.shape, 3))
    for view, matrix in enumerate(poses_to_matrices(np.atleast_2d(poses))):
        for y, x in np.argwhere(seg[view] >= 0):
            point, normal = (image[view, y, x].astype(np.float64) for image in (points, normals))
            unblocked = None if shadows is None else shadows[:, view, y, x] / 255
            eye = matrix[:3, 3], matrix[:3, 2]
            material = materials[view][seg[view, y, x]]
            shown = lit_color(lights[view], material, point, normal, *eye, unblocked)
            expected[view, y, x] = shown * 255
    return expected


def find_planes(points, faces, frame):
    """Return corner a of faces, from points and faces in one frame, and the gradients of weights of b and c, (m, 9).

    The gradients are rows of the pseudoinverse of the matrix with columns ab and ac.
    """
    matrix = poses_to_matrices(np.asarray(frame, dtype=np.float64))
    corners = (np.asarray(points, dtype=np.float64)[faces] - matrix[:3, 3]) @ matrix[:3, :3]
    a, b, c = corners.transpose(1, 0, 2)
    gradients = np.linalg.pinv(np.stack([b - a, c - a], axis=2))
    return np.concatenate([a, gradients.reshape(-1, 6)], axis=1)


shade_color_rows = shade_lit_colors  # on CPU cores, as `shade_base_colors` if `is_lit` is 0
