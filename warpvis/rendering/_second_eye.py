# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Which points of depth images a second eye sees: what shadows of stereo pairs and projectors are made of."""

from __future__ import annotations

from typing import TYPE_CHECKING

import warp as wp

from warpvis.core.arrays import empty
from warpvis.core.threads import launch_images
from warpvis.rendering._cpu_remap import CpuRemapCaster
from warpvis.rendering._views import OUTPUTS
from warpvis.rendering.casters import CastPoses, RaysCaster

if TYPE_CHECKING:
    from warpvis.kernels.worlds import Worlds

SLACK = 1e-4
"""What is nearer than a point by less than this part of its depth does not hide it: more than rounding of either."""


def find_hidden(
    caster: RaysCaster | CpuRemapCaster,
    poses: CastPoses,
    worlds: Worlds,
    depth: wp.array,
    shift: float,
    hidden: wp.array,
    *,
    threads: int,
) -> None:
    """Write whether anything hides the points of depth images from a second eye beside the camera.

    A point that the second eye's image does not hold is not hidden. Rays are cast from the second eye through the
    points themselves.

    Args:
        caster: Of the camera, which is the second eye's too.
        poses: Of the second eye, as the caster takes them: turned as the camera is, and to its right or left.
        worlds: Of the views.
        depth: Planar depth in the camera's pixels [m], ``(V, H, W)`` float32; where it is not finite there is no point.
        shift: Focal length times how far to the right the second eye is [px m], less than 0 for the left.
        hidden: Where to write 1 for points that are hidden and 0 for others, ``(V, H, W)`` uint8.
        threads: CPU threads.
    """
    if isinstance(caster, CpuRemapCaster):
        caster.find_hidden(poses, worlds, depth, shift, SLACK, hidden)
        return
    from warpvis.kernels.second_eye import judge_hidden, shift_places

    device = depth.device
    places = empty(depth.shape, wp.vec2, name="places", device=device)
    surface = empty(depth.shape, wp.float32, name="surface", device=device)
    images = [surface if name == "depth" else None for name in OUTPUTS]
    launch_images(
        shift_places, depth.shape, lambda window: [window, depth, shift, places], device=device, threads=threads
    )
    caster.cast_at(poses, worlds, places, images)
    launch_images(
        judge_hidden,
        depth.shape,
        lambda window: [window, depth, surface, SLACK, hidden],
        device=device,
        threads=threads,
    )
