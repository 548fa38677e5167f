# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of transparent surfaces: kernels in `casting/layers.py` and `shading/layers.py`."""

import numpy as np
from reference_shading import converted, sample_level, weights

from warpvis.core.poses import poses_to_matrices
from warpvis.scene.materials import Appearance

MAX_LAYERS = 8


def world_triangles(scene, poses=None, scales=None, exclude=()):
    """Return the triangles of all objects in the world, (n, 3, 3), and rows of their objects and faces, (n, 2)."""
    corners, rows = [], []
    movable = list(scene.movable)
    for index, item in enumerate(scene.objects):
        if item.name in exclude:
            continue
        vertices = item.vertices.astype(np.float64)
        if item.movable and poses is not None:
            column = movable.index(index)
            matrix = poses_to_matrices(np.asarray(poses[column], dtype=np.float64)[None])[0]
            factors = 1.0 if scales is None else np.asarray(scales[column])
            vertices = item.mesh_vertices * factors @ matrix[:3, :3].T + matrix[:3, 3]
        corners.append(vertices[item.faces])
        rows.append(np.stack([np.full(len(item.faces), index), np.arange(len(item.faces))], axis=1))
    return np.concatenate(corners), np.concatenate(rows)


def cast_layer(corners, origin, direction):
    """Return all triangles along a ray front to back: distances, indices, and whether they are seen from behind."""
    a = corners[:, 0]
    ab, ac = corners[:, 1] - a, corners[:, 2] - a
    cross = np.cross(direction, ac)
    size = (cross * ab).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u = (cross * (origin - a)).sum(axis=1) / size
        along = np.cross(origin - a, ab)
        v = along @ direction / size
        t = (along * ac).sum(axis=1) / size
    hit = np.flatnonzero((np.abs(size) > 1e-14) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 1e-9))
    order = hit[np.argsort(t[hit])]
    return t[order], order, size[order] < 0


def find_opacity(item, face, corners, point, *, is_back):
    """Return a surface's opacity, its base color in sRGB, and whether it is blended twice."""
    look = item.appearance or Appearance()
    material = look.materials[0 if look.face_materials is None else look.face_materials[face]]
    share = weights(corners, point)
    color = np.array(material.base_color)
    if look.vertex_colors is not None:
        rows = look.vertex_colors[item.faces[face]]
        color = color * (share @ (rows / 255 if rows.dtype == np.uint8 else rows))
    if material.texture is not None:
        image = material.texture.image
        if image.shape[2] == 3:
            image = np.concatenate([image, np.full((*image.shape[:2], 1), 255)], axis=2)
        uv = share @ look.corner_uv(item.faces)[face].astype(np.float64)
        color = color * sample_level(image, uv, material.texture, material.color_space)
    shown = converted(color, material.color_space, "srgb")[:3]
    if material.alpha_mode == "opaque":
        return 1.0, shown, False
    is_opaque = material.alpha_mode == "blend" and color[3] >= 0.995
    if is_back and not material.double_sided and not is_opaque:
        return 0.0, shown, False
    if material.alpha_mode == "mask":
        return float(color[3] >= material.alpha_cutoff), shown, False
    return (1.0 if is_opaque else color[3]), shown, material.blends_twice


def blend_layer(layers, background):
    """Return the color of layers front to back, rows of opacity, color and whether both passes draw it.

    The background and then each layer is painted over what there is: in the first pass front to back, in the second one
    back to front.
    """
    layers = [list(layer) for layer in layers[:MAX_LAYERS]]
    if len(layers) == MAX_LAYERS:
        layers[-1][0] = 1.0
    opaque = next((number for number, layer in enumerate(layers) if layer[0] == 1.0), len(layers))
    color = np.array(layers[opaque][1] if opaque < len(layers) else background, dtype=np.float64)
    front = layers[:opaque]
    for alpha, shown, twice in front:
        if twice:
            color = alpha * shown + (1 - alpha) * color
    for alpha, shown, _ in front[::-1]:
        color = alpha * shown + (1 - alpha) * color
    return color


def blended_color(scene, triangles, origin, direction, background):
    """Return the color along a ray of the world, sRGB from 0 to 1, and the number of its surfaces."""
    corners, rows = triangles
    layers = []
    for distance, number, is_back in zip(*cast_layer(corners, origin, direction), strict=True):
        index, face = rows[number]
        point = origin + distance * direction
        layers.append(find_opacity(scene.objects[index], face, corners[number], point, is_back=is_back))
    return blend_layer(layers, background), len(layers)


# On CPU cores, for listed pixels.
find_transparent_rows, cast_layer_rows, blend_layer_rows = find_opacity, cast_layer, blend_layer


def list_transparent_rows(is_transparent, columns):
    """Return the pixels of an image that are listed, y width + x, as an image of some columns; -1 for unused places.

    The pixels of blocks of 4 x 4 are next to each other, and each 16 of them become a block of the list.
    """
    width = is_transparent.shape[1]
    y, x = np.nonzero(is_transparent)
    order = np.lexsort((x % 4, y % 4, x // 4, y // 4))
    across = columns // 4
    listed = np.full((-(-len(order) // (16 * across)), across, 4, 4), -1)
    listed.reshape(-1)[: len(order)] = (y * width + x)[order]
    return listed.transpose(0, 2, 1, 3).reshape(-1, columns)
