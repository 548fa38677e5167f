# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compilation of kernels in advance, into the cache that all processes share."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np
import warp as wp

from warpvis.batch._frame_renderer import VISIBILITY, FrameRenderer
from warpvis.cameras.pinhole import Camera
from warpvis.core.arrays import get_device
from warpvis.core.checks import as_items
from warpvis.core.labels import Label
from warpvis.core.types import DeviceLike
from warpvis.rendering import OUTPUTS, Caster, check_outputs
from warpvis.scene import Scene

ALL_OUTPUTS = (*OUTPUTS, VISIBILITY)

# A camera outside the scene, whose images are one packet of the largest size.
_CAMERA = Camera.from_fov(32, 32, hfov=1.0)
_POSE = np.array([[0.0, 0, -5, 0, 0, 0, 1]])


def warmup(
    device: DeviceLike = "cpu", *, outputs: Sequence[str] = ALL_OUTPUTS, casters: Sequence[Caster] = ("packets", "rays")
) -> float:
    """Compile and load the kernels that rendering on a device needs.

    Compiled kernels stay in Warp's cache (``WARP_CACHE_PATH``), which other processes share. Several processes may call
    this at the same time.

    Args:
        device: Device to render on.
        outputs: Images of `Renderer`, and ``"visibility"``; all by default.
        casters: Casters of `Renderer`; both by default.

    Returns:
        Elapsed time [s], which is short if all kernels were already compiled.
    """
    start = time.perf_counter()
    device = get_device(device)
    names = check_outputs(outputs, ALL_OUTPUTS)
    images = [name for name in names if name != VISIBILITY]
    caster_names = as_items(casters, "casters")
    for scene in _scenes(device):
        for caster in caster_names:
            # On a GPU, depth alone and depth with other images are rendered by two different kernels.
            for group in [part for part in (images[:1], images, [VISIBILITY]) if set(part) <= set(names) and part]:
                renderer = FrameRenderer(scene, _CAMERA, outputs=group, caster=caster)
                for views in _view_counts(device) if caster == "packets" else [1]:
                    renderer.render({"camera_to_world": np.repeat(_POSE, views, axis=0)})
    wp.synchronize_device(device)
    return time.perf_counter() - start


def _scenes(device: wp.Device) -> Iterator[Scene]:
    """Yield a static scene, one with a movable mesh, and one with a movable round solid."""
    from warpvis.scene.solids import sphere

    corners, faces = np.eye(3), np.array([[0, 1, 2]])
    for moving in (None, (corners, faces), sphere(1.0)):
        scene = Scene(device=device)
        scene.add((corners, faces), name="stays", label=Label.OBSTACLE)
        if moving is not None:
            scene.add(moving, name="moves", movable=True)
        yield scene


def _view_counts(device: wp.Device) -> list[int]:
    """Return numbers of 32x32 images for which the packets caster selects each of its packet sizes on a GPU."""
    if device.is_cpu:
        return [1]
    processors = device.sm_count
    return [1, 6 * processors + 1, 64 * processors]
