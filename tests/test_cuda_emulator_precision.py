# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The CUDA packet caster in the emulator at the limits of single precision: vertices, slivers, far walls."""

import numpy as np
import pytest
import trimesh
from corner_walls import wall

import warpvis as wv

from compare import assert_matches_reference
from support import emulated
from support.emulated import render
from support.exact_pixels import FAMILIES, wrong_pixels
from support.worlds import STILL, assert_bits_equal, build, eyes, random_poses

pytestmark = pytest.mark.cxx

emulator = emulated.emulator  # a fixture


@pytest.mark.parametrize("seeds", [range(10), pytest.param(range(10, 40), marks=pytest.mark.slow)], ids=["few", "more"])
def test_near_corner_of_a_wall_of_kilometers_is_exact(emulator, seeds):
    """Compares with all triangles in double precision."""
    for seed in seeds:
        case = FAMILIES["far_corners"](np.random.default_rng(seed), 45, 37, 2)
        depth = render(emulator, case.scene("cpu"), case.poses, camera=case.camera, outputs=("depth",)).depth
        assert wrong_pixels(case, depth) == [], seed


@pytest.mark.slow
def test_slivers_and_grazing_planes(emulator):
    """Small and large triangles for which single precision is insufficient."""
    rng = np.random.default_rng(5)
    ends = rng.uniform(-1, 1, (60, 2, 3))
    corners = np.concatenate([ends, ends[:, 1:] + rng.normal(size=(60, 1, 3)) * 2e-3], axis=1)
    camera = wv.Camera.from_fov(45, 37, hfov=0.9, near=1e-3, far=1000.0)
    pose = np.array([wv.look_at((3, 0.2, 0.01 + 1e-4), (0, 0, 0.01)), wv.look_at((3, 0, 0.4), (0, 0, 0))])
    for movable in (False, True):
        scene = wv.Scene()
        scene.add(trimesh.creation.box((600, 600, 0.02)), name="floor")
        faces = np.arange(180).reshape(-1, 3)
        scene.add((corners.reshape(-1, 3), faces), name="slivers", pose=(0, 0, 0.5, 0, 0, 0, 1), movable=movable)
        views = render(emulator, scene, pose.astype(np.float32), camera=camera)
        assert_matches_reference(views, scene, camera, pose.astype(np.float32))


@pytest.mark.slow
@pytest.mark.parametrize("movable", [False, True])
def test_slivers_near_the_camera_need_few_exact_decisions(emulator, movable):
    """A post of slivers extends behind the camera, where their projections are unbounded."""
    scene = wv.Scene()
    post = trimesh.creation.cylinder(radius=0.02, height=2.0, sections=600)
    for x in (-0.41, 0.41):
        scene.add(post, name=f"post {x}", pose=(x, 0, 0, 0, 0, 0, 1), movable=movable)
    camera = wv.Camera.from_fov(64, 64, hfov=1.0, near=0.01, far=10.0)
    poses = wv.look_at((0, -0.3, 0.6), (0, 0.1, 0.1))[None]

    def exact_decisions():
        return sum(count for (_, _, text), count in emulator.line_counts().items() if "Key found = key(" in text)

    before = exact_decisions()
    views = render(emulator, scene, poses, side=32, camera=camera, outputs=("depth",))
    assert_matches_reference(views, scene, camera, poses)
    assert np.isfinite(views.depth.numpy()).mean() > 0.02
    # Out of 4,096 pixels in each of 5 lane orders; a pixel may have several triangles' edges near its center.
    assert exact_decisions() - before < 5 * 200


@pytest.mark.smoke("False")
@pytest.mark.parametrize("movable", [False, True])
def test_surfaces_through_the_camera_and_closer_than_near(emulator, movable):
    """A surface through the camera is not visible; surfaces closer than `near` occlude but have no depth."""
    wall = (np.array([(0, -3, -3), (0, 3, -3), (0, 3, 3), (0, -3, 3)]), np.array([(0, 1, 2), (0, 2, 3)]))
    scene, twin = wv.Scene(), wv.Scene()
    for one in (scene, twin):
        one.add(trimesh.creation.box((6, 6, 1)), name="floor", pose=(0, 0, -0.5, 0, 0, 0, 1))
        one.add(trimesh.creation.box((1, 1, 1)), name="box", pose=(2, 0, 0.5, 0, 0, 0, 1), movable=movable)
    scene.add(wall, name="wall", movable=movable)
    camera = wv.Camera.from_fov(45, 37, hfov=1.4, near=0.2, far=3.0)
    places, targets = [(0, 0.1, 0.4), (1.4, 0, 0.5)], [(1, 0.2, 0.3), (2, 0, 0.5)]
    poses = np.array([wv.look_at(*both) for both in zip(places, targets, strict=True)]).astype(np.float32)
    views = render(emulator, scene, poses, camera=camera)
    assert_matches_reference(views, twin, camera, poses)
    assert np.isneginf(views.depth.numpy()[1]).any() and np.isfinite(views.depth.numpy()[0]).any()


@pytest.mark.smoke("0.01-True")
@pytest.mark.parametrize("movable", [False, True])
@pytest.mark.parametrize("nearest", [-1.0, 0.01])
def test_triangles_passing_the_camera_reach_the_packets_edge(emulator, nearest, movable):
    """From behind or just in front of the camera to far away, hit only by the rays of one row or column."""
    for axis, sign in ((1, -1), (1, 1), (0, -1), (0, 1)):
        corners = np.zeros((4, 3))
        corners[:, axis], corners[:, 1 - axis], corners[:, 2] = 1e-3 * sign, [-2, 2, 2, -2], [nearest, nearest, 4, 4]
        scene = wv.Scene()
        scene.add((corners, np.array([(0, 1, 2), (0, 2, 3)])), name="sheet", movable=movable)
        center = np.array([22.5, 18.5])
        center[axis] = 32 - 0.6 * sign  # packets of all sizes end there
        camera = wv.Camera(45, 37, 40.0, 40.0, *center, near=1e-4, far=100.0)
        pose = np.array([STILL], dtype=np.float32)
        views = render(emulator, scene, pose, camera=camera)
        assert_matches_reference(views, scene, camera, pose)
        last, seen = 32 if sign < 0 else 31, np.isfinite(views.depth.numpy()[0]).any(axis=axis)
        assert seen[last] and not seen[last + 1 if sign < 0 else last - 1]


def test_large_offset_changes_nothing(emulator):
    """The rounding error of moved camera positions is stored separately: no bit changes."""
    rows, poses = random_poses(np.random.default_rng(14), 5), eyes(1)
    rows[:, :3], poses[:, :3] = np.round(rows[:, :3] * 64) / 64, np.round(poses[:, :3] * 64) / 64
    scene = build("cpu", rows, movable=True, static=False)
    outputs, offset = ("depth", "normals", "segmentation"), np.array([8192, -8192, 4096, 0, 0, 0, 0])
    here = render(emulator, scene, poses, outputs=outputs, object_poses=rows)
    there = render(emulator, scene, poses + offset, outputs=outputs, object_poses=rows + offset)
    assert_bits_equal(there, here)
    assert np.isfinite(here.depth.numpy()).any()


WALLS = [(movable, seed, side) for movable in (False, True) for seed in (0, 1, 5) for side in (8, 32)]
FAST_WALLS = ((False, 0, 32), (True, 1, 8))


@pytest.mark.smoke("False-0-32")
@pytest.mark.parametrize(
    ("movable", "seed", "side"),
    [pytest.param(*given, marks=() if given in FAST_WALLS else pytest.mark.slow) for given in WALLS],
)
def test_no_ray_passes_through_a_vertex(emulator, movable, seed, side):
    """Walls with a vertex at every pixel center, up to rounding."""
    camera, pose, vertices, faces = wall(seed)
    scene = wv.Scene()
    scene.add((vertices, faces), movable=movable)
    depth = render(emulator, scene, pose[None], side=side, camera=camera, outputs=("depth",)).depth.numpy()
    assert np.isfinite(depth).all()
