# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""CPU threads: pieces cover every pixel once, callers on several threads are safe, forked children work."""

import multiprocessing
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis import scenes
from warpvis.threads import _split, core_count


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 480, 640), (7, 240, 320), (64, 48, 64), (1000, 5, 7), (3, 1000, 2)])
@pytest.mark.parametrize("threads", [1, 2, 5, 64])
@pytest.mark.parametrize("split_views", [True, False])
def test_pieces_cover_every_row_once(shape, threads, split_views):
    views, height, width = shape
    covered = np.zeros((views, height), dtype=int)
    for view, view_count, row, row_count in _split(views, height, width, threads, split_views):
        assert split_views or row_count == height
        covered[view : view + view_count, row : row + row_count] += 1
    assert (covered == 1).all()


def test_a_large_single_view_is_shared():
    assert len(_split(1, 480, 640, 2, True)) >= 4


def test_the_pool_is_as_large_as_the_affinity():
    assert core_count() == len(os.sched_getaffinity(0))


def test_callers_on_several_threads_are_safe():
    preset = scenes.PRESETS["room"]
    renderer = wv.Renderer(preset.build(), wv.Camera.from_fov(64, 48, hfov=1), outputs=("depth",))
    poses = preset.poses(8)
    expected = renderer.render(poses).depth.numpy()
    with ThreadPoolExecutor(8) as callers:
        images = list(callers.map(lambda i: renderer.render(poses[i % 8]).depth.numpy()[0], range(64)))
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image, expected[i % 8])


def _render_in_child(queue):
    preset = scenes.PRESETS["room"]
    queue.put(wv.render(preset.build(), wv.Camera.from_fov(64, 48, hfov=1), preset.poses(4)).labels.numpy().sum())


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python 3.12 warns of forks beside threads: the case at hand
def test_a_forked_child_renders():
    """After a fork the pool's threads are gone; the child makes its own."""
    if wp.is_cuda_available():
        pytest.skip("CUDA does not survive a fork")
    preset = scenes.PRESETS["room"]
    labels = wv.render(preset.build(), wv.Camera.from_fov(64, 48, hfov=1), preset.poses(4), threads=2).labels
    context = multiprocessing.get_context("fork")
    queue = context.Queue()
    child = context.Process(target=_render_in_child, args=(queue,))
    child.start()
    assert queue.get(timeout=60) == labels.numpy().sum()
    child.join(10)
    assert child.exitcode == 0
