# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions from the counters of targets, separate from rays because this module compiles quickly."""

import warp as wp

from warpvis.kernels.constants import (
    FRACTION_BOX,
    IMAGE_SAMPLES,
    SAMPLES_ACROSS,
    SILHOUETTE_CENTERS,
    SILHOUETTE_EDGES,
    SILHOUETTE_SAMPLES,
    STATE_EDGES,
    TOO_FAR_SAMPLES,
    TOO_NEAR_SAMPLES,
    VISIBLE_CENTERS,
    VISIBLE_SAMPLES,
)
from warpvis.kernels.visibility.silhouettes import box_of, reason

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.func
def area_error(counts: wp.array3d[wp.int32], view: int, target: int, fraction: wp.float64) -> float:
    """Return the bound of a fraction's error: half a sample's area is uncertain between samples of different states.

    Also where both the silhouette and what hides it end, the object may be visible between them. With the areas V and S
    of visible samples and of the silhouette, and errors v and s, the error of V / S is at most
    ``(v + s V / S) / (S - s)``.
    """
    visible_error = wp.float64(0.5) * wp.float64(counts[STATE_EDGES, view, target])
    silhouette_error = wp.float64(0.5) * wp.float64(counts[SILHOUETTE_EDGES, view, target])
    certain = wp.float64(counts[SILHOUETTE_SAMPLES, view, target]) - silhouette_error
    if certain <= wp.float64(0.0):
        return 1.0
    return wp.min(float((visible_error + silhouette_error * fraction) / certain), 1.0)


@wp.struct
class FractionResults:
    """The results of targets, as in `warpvis.visibility.ObjectFractions`, ``(view, target)``."""

    fraction: wp.array2d[float]
    error: wp.array2d[float]
    image_share: wp.array2d[float]
    status: wp.array2d[wp.uint8]
    box: wp.array2d[wp.vec4i]
    visible_pixels: wp.array2d[wp.int32]
    silhouette_pixels: wp.array2d[wp.int32]
    occluders: wp.array3d[wp.int32]
    """(view, target, rank)."""
    occluder_shares: wp.array3d[float]


@wp.kernel
def judge_fractions(
    # In:
    counts: wp.array3d[wp.int32],
    hidden_by: wp.array3d[wp.int32],
    image_pixels: int,
    # Out:
    results_out: FractionResults,
):
    """Derive fractions, their error bounds, reasons and the main occluders from the counters of targets."""
    view, target = wp.tid()
    visible, silhouette = counts[VISIBLE_SAMPLES, view, target], counts[SILHOUETTE_SAMPLES, view, target]
    inside, across = counts[IMAGE_SAMPLES, view, target], counts[SAMPLES_ACROSS, view, target]
    near, far = counts[TOO_NEAR_SAMPLES, view, target], counts[TOO_FAR_SAMPLES, view, target]
    fraction, error = wp.float64(0.0), float(0.0)
    if silhouette > 0:
        fraction = wp.float64(visible) / wp.float64(silhouette)
    if across > 0:
        error = area_error(counts, view, target, fraction)
        samples = wp.float64(across * across) * wp.float64(image_pixels)
        results_out.image_share[view, target] = float(wp.float64(visible) / samples)
    else:
        results_out.image_share[view, target] = 0.0
    results_out.fraction[view, target] = float(fraction)
    results_out.error[view, target] = error
    results_out.status[view, target] = reason(visible, inside - visible - near - far, near, far, silhouette - inside, 1)
    results_out.box[view, target] = box_of(counts, view, target, FRACTION_BOX)
    results_out.visible_pixels[view, target] = counts[VISIBLE_CENTERS, view, target]
    results_out.silhouette_pixels[view, target] = counts[SILHOUETTE_CENTERS, view, target]
    bound, last = int(2147483647), int(-1)
    for rank in range(results_out.occluders.shape[2]):
        occluder, most = int(-1), int(0)
        for index in range(hidden_by.shape[2]):
            samples_hidden = hidden_by[view, target, index]
            is_next = samples_hidden < bound or (samples_hidden == bound and index > last)
            if is_next and samples_hidden > most:
                occluder, most = index, samples_hidden
        results_out.occluders[view, target, rank] = occluder
        share = float(0.0)
        if occluder >= 0:
            share = float(wp.float64(most) / wp.float64(silhouette))
        results_out.occluder_shares[view, target, rank] = share
        bound, last = most, occluder
