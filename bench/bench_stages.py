# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure each stage from a scene to a map of visible surfaces, and the complete pipeline, on the experiments."""

import pytest

import warpvis as wv

PRESET = wv.scenes.PRESETS["experiment_3"]

# Images that wait to be processed take 1.6 MB per view, which many cores share.
MAX_VIEWS = 200


@pytest.fixture(scope="module")
def images():
    """Return views of the experiment, the input of the stages after casting."""
    return wv.render(PRESET.build(), PRESET.camera, PRESET.poses(MAX_VIEWS), caster="packets")


def count(per_thread, threads):
    return min(per_thread * threads, MAX_VIEWS)


@pytest.mark.benchmark(group="stages")
@pytest.mark.parametrize(
    "outputs", [("depth",), ("depth", "points", "labels", "segmentation")], ids=["depth", "default"]
)
def test_cast(measure_casting, outputs):
    measure_casting(PRESET.name, outputs)


@pytest.mark.benchmark(group="stages")
def test_back_project(measure, images, threads):
    depth = images.depth[: count(100, threads)]
    poses = PRESET.poses(len(depth))
    points = wv.back_project(depth, PRESET.camera, poses)
    measure(lambda: wv.back_project(depth, PRESET.camera, poses, threads=threads, out=points), len(poses))


@pytest.mark.benchmark(group="stages")
def test_classify(measure, images, threads):
    depth = images.depth[: count(64, threads)]
    poses = PRESET.poses(len(depth))
    labels = wv.classify(depth, PRESET.camera, poses, spheres=PRESET.spheres)

    def call():
        wv.classify(depth, PRESET.camera, poses, spheres=PRESET.spheres, threads=threads, out=labels)

    measure(call, len(poses))


@pytest.mark.benchmark(group="stages")
def test_visibility_map(measure, scene_of, images, threads):
    points, labels = (array[: count(40, threads)] for array in (images.points, images.labels))
    bounds = scene_of(PRESET.name).bounds
    measure(lambda: wv.floor_map(points, labels, bounds=bounds, threads=threads), len(points))


@pytest.mark.benchmark(group="whole path")
@pytest.mark.parametrize("name", [preset.name for preset in wv.scenes.EXPERIMENTS])
def test_experiment(measure, scene_of, threads, name):
    preset, scene = wv.scenes.PRESETS[name], scene_of(name)
    poses = preset.poses(count(10, threads))
    renderer = wv.Renderer(scene, preset.camera, caster="packets", threads=threads)
    views = renderer.render(poses)
    labels = wv.classify(views.depth, preset.camera, poses, spheres=preset.spheres)

    def call():
        renderer.render(poses, out=views)
        wv.classify(views.depth, preset.camera, poses, spheres=preset.spheres, threads=threads, out=labels)
        wv.floor_map(views.points, labels, bounds=scene.bounds, threads=threads)

    measure(call, len(poses))
