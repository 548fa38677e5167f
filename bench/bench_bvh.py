# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Building a scene's tree, for either caster: what its first view costs more than the others."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.scene._bvh import build_bvh

NAMES = ["experiment_3", "room", "blobs_77k", "blobs_1m"]


def rounds(scene):
    return 5 if scene.triangle_count > 500_000 else 50


@pytest.mark.benchmark(group="tree")
@pytest.mark.parametrize("build", [wv.Scene.bvh, wv.Scene.triangles], ids=["bvh", "triangles"])
@pytest.mark.parametrize("name", NAMES)
def test_build(benchmark, scene_of, name, build):
    scene = scene_of(name)

    def without_tree():
        return (scene.to(scene.device),), {}

    benchmark.pedantic(build, setup=without_tree, rounds=rounds(scene), warmup_rounds=1)
    benchmark.extra_info["triangles"] = scene.triangle_count


@pytest.mark.benchmark(group="tree")
@pytest.mark.parametrize("lanes", [16, 32])
@pytest.mark.parametrize("name", NAMES)
def test_lanes(benchmark, scene_of, name, lanes):
    """The BVH alone, as wide as the casters on the CPU and on CUDA take it."""
    scene = scene_of(name)
    first = np.cumsum([0] + [len(item.vertices) for item in scene.objects])
    vertices = np.concatenate([item.vertices for item in scene.objects])
    faces = np.concatenate([item.faces + start for item, start in zip(scene.objects, first, strict=False)])
    owner = np.repeat(np.arange(len(scene)), [len(item.faces) for item in scene.objects])
    arguments = (vertices, faces, owner, np.ones(len(scene), dtype=bool))
    benchmark.pedantic(build_bvh, arguments, {"lanes": lanes}, rounds=rounds(scene), warmup_rounds=1)
    benchmark.extra_info["triangles"] = scene.triangle_count
