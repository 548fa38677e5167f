# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Double-precision references of anti-aliasing: `warpvis.kernels.shading.edges`."""

import numpy as np

CREASE, STEP = 0.9, 0.5


def list_edges(segmentation, points, normals):
    """Return whether each pixel of a view, (H, W), shows another surface than one of its four neighbors."""
    found = np.zeros(segmentation.shape, dtype=bool)
    points, normals = points.astype(np.float64), normals.astype(np.float64)
    for axis in (0, 1):
        for shift in (-1, 1):
            inside = [slice(None), slice(None)]
            inside[axis] = slice(1, None) if shift == 1 else slice(None, -1)
            other, bent, way = (np.roll(image, shift, axis) for image in (segmentation, normals, points))
            way = way - points
            with np.errstate(invalid="ignore"):
                crease = (normals * bent).sum(axis=-1) < CREASE
                step = np.abs((way * normals).sum(axis=-1)) > STEP * np.linalg.norm(way, axis=-1)
            differs = (other != segmentation) | ((segmentation >= 0) & (crease | step))
            found[tuple(inside)] |= differs[tuple(inside)]
    return found


def place_samples(edges, pattern):
    """Return the image points of a pattern in each pixel of a mask (H, W), in rows, shape (N, samples, 2)."""
    y, x = np.nonzero(edges)
    return np.stack([x, y], axis=-1)[:, None] + np.asarray(pattern)


def average_samples(colors):
    """Return the means of colors (N, samples, 3), rounded half up."""
    return np.floor(colors.astype(np.float64).mean(axis=1) + 0.5).astype(np.uint8)
