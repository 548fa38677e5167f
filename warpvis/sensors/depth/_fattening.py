# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What matching windows make of edges: a nearer surface spreads over what is behind it."""

from __future__ import annotations

import dataclasses

import warp as wp

from warpvis.core.threads import launch_images
from warpvis.rendering import Exposure
from warpvis.sensors.depth._closest import closest_first


def fatten(exposure: Exposure, *, reach: int, scale: float, step: float) -> Exposure:
    """Return the views as a sensor sees them whose nearer surfaces spread.

    Args:
        exposure: The views.
        reach: How far they spread [px].
        scale: Focal length times baseline [px m].
        step: Disparities that differ by this or more are of different surfaces [px].
    """
    from warpvis.kernels.fattening import FatteningModel, SeenSurfaces, fatten_surfaces, find_nearest_in_rows

    shape, device = exposure.true_depth.shape, exposure.scene.device
    model, seen = FatteningModel(), SeenSurfaces()
    model.disparity_scale, model.step, model.reach = scale, step, reach
    made: dict[str, wp.array] = {}
    for name, image in (
        ("depth", exposure.true_depth),
        ("normals", exposure.normals),
        ("segmentation", exposure.segmentation),
    ):
        if image is not None:
            setattr(seen, name, image)
            made[name] = exposure.room(f"fattened {name}", shape, image.dtype)
    nearest = exposure.room("nearest of rows", shape, wp.float32)
    places = wp.array(closest_first(reach), dtype=wp.vec2i, device=device)

    def launch(kernel: wp.Kernel, *given: object) -> None:
        launch_images(kernel, shape, lambda window: [window, model, *given], device=device, threads=exposure.threads)

    launch(find_nearest_in_rows, exposure.true_depth, nearest)
    launch(fatten_surfaces, seen, nearest, places, *(made.get(name) for name in ("depth", "normals", "segmentation")))
    return dataclasses.replace(
        exposure, true_depth=made["depth"], normals=made.get("normals"), segmentation=made.get("segmentation")
    )
