# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Foreground fattening: matching windows spread nearer surfaces over farther ones."""

from __future__ import annotations

import dataclasses

import warp as wp

from warpvis.core.threads import launch_images
from warpvis.rendering import Exposure
from warpvis.sensors.depth._closest import closest_first


def fatten(exposure: Exposure, *, reach: int, scale: float, step: float) -> Exposure:
    """Return the exposure with nearer surfaces spread over farther ones.

    Args:
        exposure: The exact images.
        reach: Maximum distance of spreading [px].
        scale: Focal length times baseline [px m].
        step: Minimum difference of disparity between different surfaces [px].
    """
    from warpvis.kernels.fattening import FatteningModel, Surfaces, fatten_surfaces, find_nearest_in_rows

    shape, device = exposure.true_depth.shape, exposure.scene.device
    model, seen = FatteningModel(), Surfaces()
    model.disparity_scale, model.step, model.reach = scale, step, reach
    fattened: dict[str, wp.array] = {}
    for name, image in (
        ("depth", exposure.true_depth),
        ("normals", exposure.normals),
        ("segmentation", exposure.segmentation),
    ):
        if image is not None:
            setattr(seen, name, image)
            fattened[name] = exposure.scratch(f"fattened {name}", shape, image.dtype)
    nearest = exposure.scratch("nearest of rows", shape, wp.float32)
    offsets = wp.array(closest_first(reach), dtype=wp.vec2i, device=device)

    def launch(kernel: wp.Kernel, *arguments: object) -> None:
        launch_images(
            kernel, shape, lambda window: [window, model, *arguments], device=device, threads=exposure.threads
        )

    launch(find_nearest_in_rows, exposure.true_depth, nearest)
    launch(
        fatten_surfaces, seen, nearest, offsets, *(fattened.get(name) for name in ("depth", "normals", "segmentation"))
    )
    return dataclasses.replace(
        exposure,
        true_depth=fattened["depth"],
        normals=fattened.get("normals"),
        segmentation=fattened.get("segmentation"),
    )
