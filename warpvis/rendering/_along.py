# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rendering along rays that differ between views, for other modules of this package."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import warp as wp

from warpvis.cameras.rays import RayCamera
from warpvis.rendering._views import Views, views_for
from warpvis.rendering.casters.base import CastOptions, ViewBatch, as_image
from warpvis.rendering.casters.rays import RayBundleCaster
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
    images = {name: getattr(views, name) for name in outputs}
    caster = RayBundleCaster(scene, camera, CastOptions(threads=threads))
    caster.cast_along(ViewBatch(caster.parse_poses(poses, "opencv"), worlds), as_image(rays), images)
    return views
