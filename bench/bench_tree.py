# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Building a scene's tree, for either caster: what its first view costs more than the others."""

import pytest

import warpvis as wv


@pytest.mark.benchmark(group="tree")
@pytest.mark.parametrize("build", [wv.Scene.clusters, wv.Scene.triangles], ids=["clusters", "triangles"])
@pytest.mark.parametrize("name", ["experiment_3", "room", "blobs_77k", "blobs_1m"])
def test_build(benchmark, scene_of, name, build):
    scene = scene_of(name)

    def without_tree():
        return (scene.to(scene.device),), {}

    rounds = 5 if scene.triangle_count > 500_000 else 50
    benchmark.pedantic(build, setup=without_tree, rounds=rounds, warmup_rounds=1)
    benchmark.extra_info["triangles"] = scene.triangle_count
