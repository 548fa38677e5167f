# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rays of a table by packets on CPU cores: by the float64 reference, at the borders of faces, whatever their order."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
import trimesh
from test_solids import build as build_solids
from test_worlds import ALL, random_poses

import warpvis as wv
from warpvis.core.ray_camera import RayCamera
from warpvis.rendering._ray_bundles import prepare_rays

import reference
from compare import assert_view_matches, hair

STRAIGHT = np.array([0, 0, 0, 0, 0, 0, 1.0])


@dataclass(frozen=True)
class Table(RayCamera):
    """Any rays."""

    table: np.ndarray
    kind: str = "range"
    near: float = 0.0
    far: float = np.inf

    @property
    def height(self):
        return self.table.shape[0]

    @property
    def width(self):
        return self.table.shape[1]

    @property
    def rays(self):
        return self.table

    def rays_at(self, pixels):
        raise AssertionError("nobody asks")


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def scan(height, width, tall):
    """A lidar's rays, all around, in a camera frame."""
    azimuth, up = np.meshgrid(np.linspace(-np.pi, np.pi, width, endpoint=False), np.linspace(-tall, tall, height))
    return np.stack([np.cos(up) * np.sin(azimuth), np.sin(up), np.cos(up) * np.cos(azimuth)], axis=-1)


def wide(height, width, reach):
    """Rays of depth 1 ahead, which need more than one face."""
    x, y = np.meshgrid(np.linspace(-reach, reach, width), np.linspace(-reach, reach, height))
    return np.stack([x, y, np.ones_like(x)], axis=-1)


def borders():
    """Rays through the corners, the edges and the middles of a cube: on the borders of up to three faces."""
    steps = np.array(list(itertools.product(np.linspace(-1, 1, 9), repeat=3)))
    return unit(steps[np.abs(steps).max(axis=1) == 1])[None]


def with_gaps(rays):
    rays = rays.copy()
    rays[np.random.default_rng(2).random(rays.shape[:2]) < 0.1] = np.nan
    return rays


PATTERNS = {
    "lidar": Table(scan(20, 72, 0.4)),
    "few rows": Table(scan(4, 300, 0.3)),
    "dome": Table(scan(40, 50, np.pi / 2)),
    "no order": Table(unit(np.random.default_rng(1).normal(size=(1, 1500, 3)))),
    "planar, wide": Table(wide(32, 40, 6.0), kind="z"),
    "planar": Table(wide(33, 45, 0.7), kind="z"),
    "gaps": Table(with_gaps(scan(30, 60, 0.7))),
    "column": Table(scan(200, 1, 1.5)),
    "borders": Table(borders()),
    "one": Table(np.array([[[0.0, 0.0, 1.0]]])),
}


def assert_matches_reference(scene, camera, poses, **options):
    views = wv.render(scene, camera, poses, outputs=ALL, **options)
    for view, pose in enumerate(poses):
        ranges = options | {"near": camera.near, "far": camera.far}
        expected = reference.cast_ray_table(scene, camera.rays, pose, **ranges)

        def depth_beside(x, y, pose=pose, ranges=ranges):
            return reference.cast_ray_table(scene, camera.rays[y, x] + hair(1e-6, 3), pose, **ranges).depth

        assert_view_matches(views, view, expected, depth_beside)
    return views


@pytest.mark.parametrize("name", PATTERNS)
def test_the_room_matches_the_reference(name):
    scene = wv.scenes.PRESETS["room"].build()
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    assert_matches_reference(scene, PATTERNS[name], poses)


@pytest.mark.parametrize(
    ("name", "near_plane"),
    [
        ("lidar", "occlude"),
        ("lidar", "clip"),
        ("no order", "occlude"),
        ("no order", "clip"),
        ("planar", "clip"),
        ("planar, wide", "occlude"),
    ],
)
def test_solids_meshes_and_their_range_match_the_reference(name, near_plane):
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=1, radius=0.3)]
    scene = build_solids("cpu", random_poses(rng, 10, spread=2.0), extra=meshes)
    camera = Table(PATTERNS[name].table, PATTERNS[name].kind, near=0.5, far=2.0)
    views = assert_matches_reference(scene, camera, random_poses(rng, 2, spread=0.3), near_plane=near_plane)
    assert len(np.unique(views.segmentation.numpy())) >= 4
    assert np.isneginf(views.depth.numpy()).any() == (near_plane == "occlude")


def test_rays_on_the_borders_of_faces_are_cast_once():
    """In a box all of them meet a wall, at a length that is known."""
    half = np.array([2.0, 1.5, 2.5])
    scene = wv.Scene()
    scene.add(trimesh.creation.box(2 * half), name="box")
    for camera in PATTERNS.values():
        known = np.isfinite(camera.rays).all(axis=-1)
        with np.errstate(divide="ignore"):
            expected = (half / np.abs(camera.rays)).min(axis=-1)
        depth = wv.render(scene, camera, STRAIGHT, outputs="depth").depth.numpy()[0]
        np.testing.assert_allclose(depth[known], expected[known], rtol=2e-6)
        assert np.isposinf(depth[~known]).all()


@pytest.mark.parametrize("name", PATTERNS)
def test_every_ray_has_one_place(name):
    rays = PATTERNS[name].rays
    known = np.isfinite(rays).all(axis=-1)
    struct = prepare_rays(rays).struct
    place = struct.place.numpy()
    np.testing.assert_array_equal(np.sort(place[place >= 0]), np.flatnonzero(known))
    np.testing.assert_array_equal(struct.without_ray.numpy(), np.flatnonzero(~known))
    focal, lanes = float(struct.focal), np.flatnonzero(place >= 0)
    # What has been rounded is kept: places are the rays', in the pinhole of their bundle.
    bundle = struct.bundle.numpy()
    which = np.searchsorted(bundle[:, 0], lanes // 4096, side="right") - 1
    shown = rays.reshape(-1, 3)[place[lanes]]
    along = [
        np.where(axis < 0, -1, 1) * shown[np.arange(len(lanes)), np.where(axis < 0, ~axis, axis)]
        for axis in bundle[which][:, 2:5].T
    ]
    for number, direction in (("u", along[0]), ("v", along[1])):
        value, rest = getattr(struct, number).numpy(), getattr(struct, f"rest_{number}").numpy()
        exact = value[lanes].astype(np.float64) + rest[lanes]
        np.testing.assert_allclose(exact, direction / along[2] * focal, rtol=1e-13, atol=1e-12)


def test_no_ray_slips_through_a_ball():
    """Through all corners of its triangles, and the middles of their edges."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    middles = ball.vertices[ball.edges_unique].mean(axis=1)
    scene = wv.Scene()
    scene.add(ball, name="ball")
    rays = unit(np.concatenate([ball.vertices, middles]))[None]
    for offset in ((0, 0, 0), (0.3, -0.2, 0.1)):
        from_there = unit(np.concatenate([ball.vertices, middles]) - offset)[None]
        depth = wv.render(scene, Table(from_there), [*offset, 0, 0, 0, 1], outputs="depth").depth.numpy()
        assert np.isfinite(depth).all() and depth.max() < 2.5
    assert rays.shape[1] > 10000


def test_a_floor_at_grazing_angles():
    """Lengths are the height over the sine, though 1 / z is a small difference."""
    scene, height = wv.Scene(), 0.7
    scene.add(trimesh.creation.box((8000, 8000, 0.1)), name="floor", pose=(0, 0, -0.05, 0, 0, 0, 1))
    down = np.radians(np.geomspace(0.02, 30, 64))
    azimuth = np.linspace(-np.pi, np.pi, 80)
    a, d = np.meshgrid(azimuth, down)
    rays = np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), -np.sin(d)], axis=-1)
    depth = wv.render(scene, Table(rays), [0, 0, height, 0, 0, 0, 1], outputs="depth").depth.numpy()[0]
    np.testing.assert_allclose(depth, np.float32(height) / np.sin(d), rtol=1e-5)


@pytest.mark.parametrize("name", ["lidar", "no order", "planar"])
def test_images_do_not_depend_on_threads_or_batches(name):
    scene, camera = wv.scenes.PRESETS["room"].build(), PATTERNS[name]
    poses = random_poses(np.random.default_rng(3), 5, spread=0.4)
    together = wv.render(scene, camera, poses, outputs=ALL, threads=1)
    shared = wv.Renderer(scene, camera, outputs=ALL, threads=3)
    for _ in range(2):
        again = shared.render(poses)
        for output in ALL:
            np.testing.assert_array_equal(getattr(again, output).numpy(), getattr(together, output).numpy())
    for view, pose in enumerate(poses):
        alone = shared.render(pose)
        for output in ALL:
            np.testing.assert_array_equal(getattr(alone, output).numpy()[0], getattr(together, output).numpy()[view])
    for output in ALL:  # nothing of what was not asked for changes what was
        one = wv.render(scene, camera, poses, outputs=output)
        np.testing.assert_array_equal(getattr(one, output).numpy(), getattr(together, output).numpy())


def test_worlds_sizes_instances_and_exclude_are_as_rays_see_them():
    scene = wv.Scene()
    scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.4), name="ball", movable=True)
    scene.add(trimesh.creation.box((0.4, 0.5, 0.6)), name="cart", movable=True)
    scene.add_instances(
        trimesh.creation.cone(0.3, 0.8), random_poses(np.random.default_rng(5), 30, spread=3.0), movable=False
    )
    scene.add(trimesh.creation.box((9, 9, 9)), name="walls")
    rng = np.random.default_rng(6)
    arguments = {
        "object_poses": np.stack([random_poses(rng, 2, spread=1.5) for _ in range(3)]),
        "object_scales": rng.uniform(0.5, 2.0, (3, 2, 3)),
        "world_index": np.array([2, 0, 1, 2]),
        "exclude": rng.random((4, len(scene))) < 0.2,
    }
    poses = random_poses(rng, 4, spread=0.2)
    for camera in (PATTERNS["lidar"], PATTERNS["no order"]):
        fast, slow = (wv.render(scene, camera, poses, outputs=ALL, caster=c, **arguments) for c in ("packets", "rays"))
        same = fast.segmentation.numpy() == slow.segmentation.numpy()
        assert same.mean() > 0.999
        depth, expected = fast.depth.numpy()[same], slow.depth.numpy()[same]
        hit = np.isfinite(expected)
        assert (np.isfinite(depth) == hit).all() and 0.5 < hit.mean()
        assert (np.abs(depth[hit] - expected[hit]) > 1e-5 * np.maximum(1, expected[hit])).mean() < 1e-3


def test_a_table_without_rays_is_empty():
    scene = wv.scenes.PRESETS["room"].build()
    views = wv.render(scene, Table(np.full((3, 4, 3), np.nan)), STRAIGHT, outputs=ALL)
    assert np.isposinf(views.depth.numpy()).all() and (views.segmentation.numpy() == -1).all()
    none = wv.render(scene, PATTERNS["lidar"], np.zeros((0, 7)), outputs=ALL)
    assert none.depth.shape == (0, 20, 72)


def test_casters_are_chosen():
    scene = wv.scenes.PRESETS["room"].build()
    assert wv.Renderer(scene, PATTERNS["lidar"]).caster == "packets"
    assert wv.Renderer(scene, PATTERNS["lidar"], caster="rays").caster == "rays"
