# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A textured card in the scene of tests of gradients, for tests of colors."""

import numpy as np

from warpvis.scene.materials import Appearance, Material, Texture

from support.gradients import build_scene

CARD_ROW = np.array([1.6, 0.45, 0.5, 0.1, 0.2, -0.1, 0.97])
CARD_ROW[3:] /= np.linalg.norm(CARD_ROW[3:])
CARD = np.array([[0, -0.4, -0.3], [0, 0.4, -0.3], [0, 0.4, 0.3], [0, -0.4, 0.3]])
CARD_FACES = np.array([[0, 1, 2], [0, 2, 3]])
CARD_UV = np.float32([[-0.6, -0.3], [1.7, -0.3], [1.7, 1.4], [-0.6, 1.4]])
TEXTURE = np.random.default_rng(5).integers(0, 256, (7, 9, 3)).astype(np.uint8)
WRAPS = [("repeat", "clamp"), ("clamp", "mirror"), ("mirror", "repeat")]


def build_card_scene(device="cpu", wraps=WRAPS[0], *, movable=True, **options):
    """Return the scene of other tests of gradients, with a textured card in front of its objects."""
    scene = build_scene(device)
    texture = Texture(TEXTURE, wrap_u=wraps[0], wrap_v=wraps[1], mipmaps=False)
    appearance = Appearance((Material(texture=texture, **options),), uv=CARD_UV)
    scene.add((CARD, CARD_FACES), name="card", appearance=appearance, pose=CARD_ROW, movable=movable)
    return scene
