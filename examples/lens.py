# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render depth of a room with a pinhole, and with a lens of the same focal length and barrel distortion.

Prints the fraction of the image that the room fills for each camera; writes lens.png.
"""

import numpy as np

import warpvis as wv

room, pose = wv.scenes.PRESETS["room"].build(), wv.look_at((-1.6, -1.3, 1.6), (0.5, 0.4, 0.3))
straight = wv.Camera(640, 480, 330, 330, 320, 240)
barrel = wv.Camera.from_opencv([[330, 0, 319.5], [0, 330, 239.5], [0, 0, 1]], [-0.28, 0.06, 0, 0], 640, 480)
images = []
for name, camera in (("pinhole", straight), ("lens", barrel)):
    depth = wv.render(room, camera, pose, outputs="depth").depth.numpy()[0]
    print(f"{name}: {np.isfinite(depth).mean():.1%} of the image shows the room")
    images.append(depth[::2, ::2])
wv.viz.save_preview(np.hstack(images), "lens.png", (0.5, 4.0))
