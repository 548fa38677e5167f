# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render 12 worlds of a MuJoCo model with random colors, textures, lights and backgrounds.

The model is aloha_pot of the package mujoco-warp. World 0 is the model as it is; the others are drawn by
`randomize_appearances`. Writes randomized_worlds.png, or the file that is given.
"""

import importlib.resources
import sys

import mujoco  # noqa: TID253
import numpy as np
from PIL import Image  # noqa: TID253

import warpvis as wv
from warpvis.scene.materials import Texture
from warpvis.scene.randomization import randomize_appearances

COLUMNS, ROWS, WIDTH, HEIGHT = 4, 3, 240, 180

file = importlib.resources.files("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"
model = mujoco.MjModel.from_xml_path(str(file))
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
mujoco.mj_forward(model, data)

rng = np.random.default_rng(0)
y, x = np.mgrid[:64, :64] / 64


def pattern(mask: np.ndarray) -> Texture:
    """Return a texture of two random colors."""
    first, second = rng.integers(0, 256, (2, 3))
    return Texture(np.where(mask[..., None], first, second).astype(np.uint8))


textures = [pattern((x * 8 % 2 < 1) ^ (y * 8 % 2 < 1)) for _ in range(3)]  # checks
textures += [pattern((x + y) * 8 % 2 < 1) for _ in range(3)]  # stripes
textures += [pattern(np.hypot(x * 4 % 1 - 0.5, y * 4 % 1 - 0.5) < 0.3) for _ in range(3)]  # dots

count = COLUMNS * ROWS
batch = wv.mujoco.BatchRenderer(model, height=HEIGHT, width=WIDTH, outputs=("color",))
appearances = randomize_appearances(batch.scene, count, seed=4, textures=textures, textured=0.3)
camera = "teleoperator_pov"
images = batch.render([data] * count, cameras=camera, appearances=appearances).color.numpy()
images[0] = batch.render(data, cameras=camera).color.numpy()[0]
tiles = images.reshape(ROWS, COLUMNS, HEIGHT, WIDTH, 3).transpose(0, 2, 1, 3, 4).reshape(ROWS * HEIGHT, -1, 3)
out = sys.argv[1] if len(sys.argv) > 1 else "randomized_worlds.png"
Image.fromarray(tiles).quantize(128, dither=Image.Dither.NONE).save(out)
print(f"{count} worlds in {out}")
