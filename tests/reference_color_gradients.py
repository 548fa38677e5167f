# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Float64 twins of `warpvis.kernels.gradients.color_gradients`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from reference_gradients import rotation_matrix
from reference_shading import wrapped


def pixel_samples(images, index, object_row, vertices, faces, shape, uv=None, wraps=("repeat", "repeat")):
    """Yield the pixels of a view that see an object, and the rows, columns and weights of the colors they show.

    Args:
        images: Images of the view by name: points, segmentation and faces.
        index: Index of the object.
        object_row: Its pose ``x y z qx qy qz qw``.
        vertices: Its vertices in its frame, shape (n, 3).
        faces: Its triangles, (m, 3).
        shape: Height and width of the table of given colors, (1, n) for those of vertices.
        uv: Texture coordinates, (m, 3, 2); None for colors of vertices.
        wraps: Wrap modes of the texture.
    """
    rotation = rotation_matrix(object_row[3:])
    for pixel in zip(*np.nonzero(images["segmentation"] == index), strict=True):
        corners = faces[images["faces"][pixel]]
        point = (images["points"][pixel] - object_row[:3]) @ rotation
        # The least-squares solution is the projection onto the plane of the triangle.
        edges = (vertices[corners[1:]] - vertices[corners[0]]).T
        of_b, of_c = np.linalg.lstsq(edges, point - vertices[corners[0]])[0]
        weights = np.array([1 - of_b - of_c, of_b, of_c])
        if uv is None:
            yield pixel, np.zeros(3, dtype=int), corners, weights
            continue
        u, v = weights @ uv[images["faces"][pixel]]
        x, y = u * shape[1] - 0.5, (1 - v) * shape[0] - 0.5
        left, upper = int(np.floor(x)), int(np.floor(y))
        columns = [wrapped(left + k, shape[1], wraps[0]) for k in (0, 1)]
        rows = [wrapped(upper + k, shape[0], wraps[1]) for k in (0, 1)]
        across, down = [left + 1 - x, x - left], [upper + 1 - y, y - upper]
        yield pixel, np.repeat(rows, 2), np.tile(columns, 2), np.outer(down, across).ravel()


def interpolate_colors(given: NDArray, colors: NDArray, *scene, **options) -> NDArray[np.float64]:
    """Return the colors of a view, with those of the pixels that see an object from a table of given colors."""
    result = np.array(colors, dtype=np.float64)
    for pixel, rows, columns, weights in pixel_samples(*scene, given.shape[:2], **options):
        result[pixel] = weights @ given[rows, columns]
    return result


def sum_color_gradients(gradients: NDArray, shape: tuple[int, int], *scene, **options) -> NDArray[np.float64]:
    """Return gradients with respect to a table of given colors, shape ``(*shape, 3)``."""
    result = np.zeros((*shape, 3))
    for pixel, rows, columns, weights in pixel_samples(*scene, shape, **options):
        np.add.at(result, (rows, columns), weights[:, None] * gradients[pixel])
    return result
