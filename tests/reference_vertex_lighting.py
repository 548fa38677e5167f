# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision reference of light at vertices: all triangles of an object are searched for those of its pixels."""

from dataclasses import replace

import numpy as np
from reference_shading import light_sums, to_screen

from warpvis.core.poses import poses_to_matrices


def find_triangles(points, corners):
    """Return the nearest of triangles (m, 3, 3) to each of points (n, 3), and their barycentric coordinates in it."""
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    normal = np.cross(ab, ac)
    square = np.maximum((normal**2).sum(axis=-1), 1e-300)
    offset = points[:, None] - a
    b = (np.cross(offset, ac) * normal).sum(axis=-1) / square
    c = (np.cross(ab, offset) * normal).sum(axis=-1) / square
    shares = np.stack([1 - b - c, b, c], axis=-1)
    inside = np.clip(shares, 0, 1)
    inside /= inside.sum(axis=-1, keepdims=True)
    distance = np.linalg.norm(np.einsum("nmk,mkd->nmd", inside, corners) - points[:, None], axis=-1)
    best = distance.argmin(axis=1)
    return best, shares[np.arange(len(points)), best]


def shade_vertex_lit_colors(lights, materials, poses, views, triangles, shadows=None):
    """Return the expected colors, (V, H, W, 3), of untextured objects from the points and normals of views.

    `triangles` are, for each object, the corners in the world of those that are lit, (m, 3, 3), and normals of the
    corners, or None for the normals of the pixels. `shadows` are as for `shade_lit_colors`.
    """
    seg, points, normals = (getattr(views, key).numpy() for key in ("segmentation", "points", "normals"))
    expected = np.zeros((*seg.shape, 3))
    is_linear = any(light.color_space == "linear" for light in lights)
    casting = [light for light in lights if light.casts_shadow and shadows is not None and not is_linear]
    steady = [light for light in lights if light not in casting]
    for view, matrix in enumerate(poses_to_matrices(np.atleast_2d(poses)).astype(np.float64)):
        eye = matrix[:3, 3], matrix[:3, 2]
        for number in np.unique(seg[view][seg[view] >= 0]):
            mask, (corners, corner_normals) = seg[view] == number, triangles[number]
            seen = points[view][mask].astype(np.float64)
            which, shares = find_triangles(seen, corners)
            flat = normals[view][mask].astype(np.float64)
            used = np.repeat(flat[:, None], 3, axis=1) if corner_normals is None else corner_normals[which]
            colors = []
            for pixel, (triangle, share, at) in enumerate(zip(which, shares, np.argwhere(mask), strict=True)):
                colors.append(
                    _interpolated(
                        steady, materials[number], corners[triangle], used[pixel], share, eye, is_linear=is_linear
                    )
                )
                for index, light in enumerate(casting):
                    dark = replace(materials[number], emission=(0.0, 0.0, 0.0))
                    part = _interpolated([light], dark, corners[triangle], used[pixel], share, eye, is_linear=False)
                    colors[-1] = colors[-1] + part * (shadows[index, view, at[0], at[1]] / 255)
            shown = to_screen(np.array(colors)) if is_linear else np.array(colors)
            expected[view][mask] = np.clip(shown, 0, 1) * 255
    return expected


def _interpolated(lights, material, corners, normals, share, eye, *, is_linear):
    """Return light at the corners, clamped to 1 in display color space, and interpolated."""
    space = "linear" if is_linear else "srgb"
    pairs = zip(corners, normals, strict=True)
    at = [light_sums(lights, material, corner, normal, *eye, space)[0] for corner, normal in pairs]
    return share @ (np.array(at) if is_linear else np.minimum(at, 1))


shade_vertex_color_rows = shade_vertex_lit_colors  # on CPU cores
