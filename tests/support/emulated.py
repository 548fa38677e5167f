# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The CUDA packet caster in the emulator: the fixture, and images of the variant that a GPU would use."""

import pytest
from cuda_emulator import Emulator, Variant, emulated_renderer

import warpvis as wv

from support.worlds import ALL

CAMERA = wv.Camera.from_fov(45, 37, hfov=0.994837, near=0.05, far=100.0)


@pytest.fixture(scope="module")
def emulator(tmp_path_factory):
    """Return an emulator with sanitizers and line counts."""
    return Emulator(tmp_path_factory.mktemp("cuda_emulator"))


def render(emulator, scene, poses, *, side=16, camera=CAMERA, outputs=ALL, cull_backfaces=False, **options):
    """Render with the variant that a GPU would use."""
    with_id = bool(set(outputs) - {"depth", "points"})
    variant = Variant(side, with_id, bool(scene.bvh().struct.drawn_count))
    renderer = emulated_renderer(emulator, variant, scene, camera, outputs=outputs, cull_backfaces=cull_backfaces)
    return renderer.render(poses, **options)
