# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The `rays` caster: depth of every preset, 320x240."""

import pytest

import warpvis as wv


@pytest.mark.benchmark(group="rays, depth")
@pytest.mark.parametrize("name", wv.scenes.PRESETS)
def test_depth(measure, scene_of, views_per_thread, threads, name):
    preset = wv.scenes.PRESETS[name]
    poses = preset.poses(views_per_thread(name) * threads)
    renderer = wv.Renderer(scene_of(name), preset.camera, outputs=("depth",), threads=threads)
    views = renderer.render(poses)
    measure(lambda: renderer.render(poses, out=views), len(poses))
