# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Images of a MuJoCo scene."""

import warpvis as wv
from warpvis.mujoco import (
    camera_poses,
    geom_poses,
)


def rendered(geoms, data):
    """Return depth and segmentation of a small image."""
    eye, model = wv.Camera.from_fov(32, 24, hfov=1), data.model
    renderer = wv.Renderer(geoms.scene, eye, outputs=("depth", "segmentation"))
    views = renderer.render(camera_poses(data, model, [model.camera("front").id]), object_poses=geom_poses(data, geoms))
    return views.depth.numpy().tobytes() + views.segmentation.numpy().tobytes()
