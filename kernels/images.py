# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The images that casters write, which travel together."""

import warp as wp

from warpvis.kernels.pinhole import Window

wp.set_module_options({"enable_backward": False, "default_grid_stride": False})


@wp.struct
class Images:
    """What is seen of every view, ``[view, y, x]``; None where nobody asks."""

    depth: wp.array3d[float]
    points: wp.array3d[wp.vec3]
    normals: wp.array3d[wp.vec3]
    labels: wp.array3d[wp.uint8]
    segmentation: wp.array3d[wp.int32]
    faces: wp.array3d[wp.int32]


NAMES = ("depth", "points", "normals", "labels", "segmentation", "faces")

NATIVE_IMAGES = """
const Images out = {images.depth.data, (float*)images.points.data, (float*)images.normals.data, images.labels.data,
                    images.segmentation.data, images.faces.data, scene.object_label.data, scene.slot_face.data};
"""
"""The struct of ``native/shared/images.h`` of `Images` named ``images`` and of a scene named ``scene``."""


@wp.kernel
def fill_depth(
    window: Window,
    # In:
    empty: float,
    too_near: float,
    # Out:
    depth_out: wp.array3d[float],
):
    """Write finite numbers where depth says that something is too near, and where there is none for other reasons."""
    view, y, x = wp.tid()
    view, y = view + window.first_view, y + window.first_row
    depth = depth_out[view, y, x]
    if not wp.isfinite(depth):
        depth_out[view, y, x] = wp.where(depth == -wp.inf, too_near, empty)
