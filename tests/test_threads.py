# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of CPU threads: partition of images, concurrent callers, and forked processes."""

import multiprocessing
import os
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis import scenes
from warpvis.core import threads as core_threads
from warpvis.core.threads import Crew, core_count, run_each
from warpvis.kernels.maps.classify import back_project


@pytest.fixture
def split(monkeypatch):
    """Return a function that returns the pieces in which an image kernel is launched."""
    found = []
    monkeypatch.setattr(core_threads, "run_each", lambda work, pieces, threads: found.extend(pieces))

    def pieces_of(shape, threads, split_views):
        found.clear()
        options = {"device": wp.get_device("cpu"), "threads": threads, "split_views": split_views}
        core_threads.launch_images(back_project, shape, lambda window: [], **options)
        return list(found)

    return pieces_of


@pytest.mark.parametrize("shape", [(1, 1, 1), (1, 480, 640), (7, 240, 320), (64, 48, 64), (1000, 5, 7), (3, 1000, 2)])
@pytest.mark.parametrize("threads", [1, 2, 5, 64])
@pytest.mark.parametrize("split_views", [True, False])
def test_pieces_cover_every_row_once(split, shape, threads, split_views):
    views, height, width = shape
    covered = np.zeros((views, height), dtype=int)
    for view, view_count, row, row_count in split((views, height, width), threads, split_views):
        assert split_views or row_count == height
        covered[view : view + view_count, row : row + row_count] += 1
    assert (covered == 1).all()


def test_single_large_view_is_split(split):
    assert len(split((1, 480, 640), 2, True)) >= 4


def test_core_count_equals_affinity():
    assert core_count() == len(os.sched_getaffinity(0))


def test_concurrent_callers_get_correct_images():
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


@pytest.mark.filterwarnings("ignore::DeprecationWarning")  # Python 3.12 warns of forks in multithreaded processes
def test_forked_child_renders():
    """The pool's threads do not survive a fork; the child creates new ones."""
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


POOL = """
import threading
from warpvis.kernels.maps.classify import back_project
from warpvis.core.threads import run_each

def count_pool():
    return len([thread for thread in threading.enumerate() if thread.name.startswith("warpvis")])

print(count_pool())
for threads in (2, 3, 4, 5, 6, 9, 3, 2):
    together = threading.Barrier(threads, timeout=20)
    run_each(lambda _, together=together: together.wait(), range(threads), threads)
print(count_pool())
"""


@pytest.mark.slow
def test_pool_grows_to_the_largest_request():
    """There is one pool for all numbers of threads."""
    done = subprocess.run([sys.executable, "-c", POOL], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["0", "8"]  # the caller is the ninth thread


class Counted:
    """Short work that records the maximum number of concurrent threads."""

    def __init__(self):
        self.most, self.done = 0, []
        self._at_work, self._lock = 0, threading.Lock()

    def __call__(self, part):
        with self._lock:
            self._at_work += 1
            self.most = max(self.most, self._at_work)
        time.sleep(0.002)
        with self._lock:
            self._at_work -= 1
            self.done.append(part)


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_concurrency_is_limited_to_the_request(threads):
    """Even if the pool is larger."""
    work = Counted()
    run_each(lambda _: time.sleep(0.01), range(8), 8)
    run_each(work, range(40), threads)
    assert work.most <= threads


@pytest.mark.parametrize("threads", [1, 4])
def test_error_is_raised_after_all_workers_stop(threads):
    done, at_work = [], set()

    def work(part):
        if part == 3:
            raise ValueError("part 3")
        at_work.add(part)
        time.sleep(0.005)
        done.append(part)
        at_work.remove(part)

    with pytest.raises(ValueError, match="part 3"):
        run_each(work, range(1000), threads)
    assert not at_work
    assert len(done) < 100


def test_crew_size_is_shared_by_callers():
    work = Counted()
    with Crew(3, "crew") as crew, ThreadPoolExecutor(4) as callers:
        for first in range(0, 80, 20):
            callers.submit(crew.each, work, range(first, first + 20))
    assert sorted(work.done) == list(range(80))
    assert 1 < work.most <= 3


def test_crew_survives_an_error_of_one_caller():
    def work(part):
        if part == 3:
            raise ValueError("part 3")
        time.sleep(0.001)
        done.append(part)

    done = []
    with Crew(2, "crew") as crew:
        with pytest.raises(ValueError, match="part 3"):
            crew.each(work, range(1000))
        assert len(done) < 100
        done.clear()
        crew.each(work, [5, 6, 7])
        crew.each(work, [])
    assert sorted(done) == [5, 6, 7]
