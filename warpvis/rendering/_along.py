# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering along rays that differ between views, for other modules of this package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import warp as wp

from warpvis.cameras.rays import RayCamera
from warpvis.rendering._views import CAST_OUTPUTS, Views, views_for
from warpvis.rendering.casters import RayTableCaster, as_rows
from warpvis.scene import Scene

if TYPE_CHECKING:
    from warpvis.kernels.casting.worlds import Worlds


def render_along(
    scene: Scene,
    camera: RayCamera,
    poses: wp.array,
    worlds: Worlds,
    rays: wp.array,
    *,
    outputs: Sequence[str],
    threads: int,
) -> Views:
    """Render along rays of the camera frame; surfaces are two-sided.

    Args:
        scene: The scene to render.
        camera: The camera; defines the depth range and whether depth is planar or a length.
        poses: Camera poses from `warpvis.core.poses.parse_poses`.
        worlds: Worlds from `warpvis.scene.worlds.parse_worlds`.
        rays: N rays of depth 1 per view, shape ``(V, N)`` vec3d; a NaN ray hits nothing.
        outputs: Images to render.
        threads: CPU threads.

    Returns:
        The outputs, of shape ``(V, N)``, on the scene's device.
    """
    views = views_for(outputs, rays.shape, scene.device)
    rows = [as_rows(getattr(views, name)) if name in outputs else None for name in CAST_OUTPUTS]
    caster = RayTableCaster(scene, camera, cull_backfaces=False, clip_near=False, threads=threads)
    caster.cast_along(caster.parse_poses(poses, "opencv"), worlds, as_rows(rays), rows)
    return views
