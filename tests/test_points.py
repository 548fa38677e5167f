# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Point visibility in scenes and measured images: visible, occluded and by which object, out of view, out of range."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import Visibility, scenes
from warpvis.kernels.visibility.points import camera_frames
from warpvis.scene import solids

import reference

CAMERA = wv.Camera.from_fov(320, 240, hfov=1.0, near=0.6, far=4.0)
ROOMY = wv.Camera.from_fov(320, 240, hfov=1.0, near=1.5, far=4.0)


def points_around(scene, rng, count):
    low, high = scene.bounds
    return rng.uniform(low - 0.2, high + 0.2, (count, 3)).astype(np.float32)


def points_on(scene, rng, count):
    """Return points on triangles, in single precision."""
    corners = np.concatenate([item.vertices[item.faces] for item in scene.objects]).astype(np.float64)
    chosen = corners[rng.integers(0, len(corners), count)]
    shares = rng.dirichlet((1, 1, 1), count)
    return np.einsum("nc,ncx->nx", shares, chosen).astype(np.float32)


def assert_matches(scene, camera, poses, points, *, tolerance, caster, twins=None, slack=2e-5, **options):
    """Compare every view with the float64 reference of the scene, or of a copy with static objects."""
    options = {"tolerance": tolerance, "caster": caster, **options}
    status, occluders = (
        a.numpy() for a in wv.point_visibility(scene, camera, poses, points, occluders=True, **options)
    )
    assert status.shape == occluders.shape == (len(poses), len(points))
    assert (wv.point_visibility(scene, camera, poses, points, **options).numpy() == status).all()
    found = set()
    for view, pose in enumerate(poses):
        twin = twins[view] if twins else scene
        expected, hidden_by, margin = reference.judge_points(twin, camera, pose, points, tolerance)
        differs = status[view] != expected
        # Rays within a micrometer of an edge may miss or hit it; so may those whose points are at the limit.
        assert (differs & (margin > slack)).sum() == 0
        same = ~differs & (expected == Visibility.OCCLUDED)
        assert (occluders[view][same] == hidden_by[same]).mean() > 0.999 if same.any() else True
        others = ~differs & (expected != Visibility.OCCLUDED)
        assert (occluders[view][others] == -1).all()
        found |= set(expected.tolist())
    return found


def test_camera_frames_match_reference(device):
    rng = np.random.default_rng(3)
    rows = np.concatenate([rng.uniform(-50, 50, (20, 3)), rng.normal(size=(20, 4))], axis=1).astype(np.float32)
    poses = wp.array(rows, dtype=wp.transform, device=device)
    frames = [wp.empty(len(rows), dtype=dtype, device=device) for dtype in (wp.vec3d, wp.mat33d)]
    wp.launch(camera_frames, dim=len(rows), inputs=[poses, *frames], device=device)
    for ours, expected in zip(frames, reference.camera_frames(rows), strict=True):
        np.testing.assert_allclose(ours.numpy(), expected, rtol=0, atol=1e-12)


@pytest.mark.smoke("*-rays-experiment_1", "*-packets-room")
@pytest.mark.parametrize("name", ["room", "experiment_1"])
def test_random_and_surface_points_match_reference(name, device, caster):
    preset = scenes.PRESETS[name]
    scene, rng = preset.build(device), np.random.default_rng(0)
    poses = preset.poses(2)
    anywhere, on = points_around(scene, rng, 3000), points_on(scene, rng, 1000)
    found = assert_matches(scene, ROOMY, poses, anywhere, tolerance=0.0, caster=caster)
    assert found == {0, 1, 2, 3, 4}
    assert_matches(scene, ROOMY, poses, on, tolerance=1e-4, caster=caster)


def test_status_covers_every_reason(device, caster):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 1, 1)), name="wall", pose=(2, 0, 0, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.02, 0.1, 0.1)), name="lens cap", pose=(0.3, 0.3, 0, 0, 0, 0, 1))
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    points = [(1, 0, 0), (1.9, 0, 0), (2.5, 0, 0), (-1, 0, 0), (1, 5, 0), (0.4, 0, 0), (9, 1.5, 0), (2, 2, 0)]
    status, occluders = wv.point_visibility(scene, CAMERA, pose, points, occluders=True, caster=caster)
    names = [Visibility(value).name for value in status.numpy()[0]]
    out = "OUT_OF_VIEW"
    assert names == ["VISIBLE", "VISIBLE", "OCCLUDED", out, out, "TOO_NEAR", "TOO_FAR", out]
    assert occluders.numpy()[0].tolist() == [-1, -1, 0, -1, -1, -1, -1, -1]
    wide = wv.Camera.from_fov(320, 240, hfov=2.0, near=0.6, far=4.0)
    status, occluders = wv.point_visibility(scene, wide, pose, [(0.9, 0.9, 0)], occluders=True, caster=caster)
    assert status.numpy()[0, 0] == Visibility.OCCLUDED  # occluded by a surface nearer than `near`
    assert occluders.numpy()[0, 0] == 1


def test_tolerance_is_measured_along_the_ray(device, caster):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 9, 9)), name="wall", pose=(2.1, 0, 0, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(320, 240, hfov=2.2)
    pose = wv.look_at((0, 0, 0), (1, 0, 0))
    ray = np.array([1.0, 1.5, 0.5])
    points = [ray * 2 * (1 + behind / (2 * np.linalg.norm(ray))) for behind in (0.009, 0.011)]
    status = wv.point_visibility(scene, camera, pose, points, tolerance=0.01, caster=caster).numpy()[0]
    assert status.tolist() == [Visibility.VISIBLE, Visibility.OCCLUDED]


def test_worlds_and_exclusion_of_solids(device, caster):
    scene = wv.Scene(device=device)
    scene.add(solids.sphere(0.3), name="ball", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    poses = np.tile(wv.look_at((0, 0, 0), (1, 0, 0)), (3, 1))
    worlds = np.array([[[2, 0, 0, 0, 0, 0, 1]], [[2, 0.5, 0, 0, 0, 0, 1]]], dtype=np.float32)
    points = [(3, 0, 0), (1.7, 0, 0), (3, 0.75, 0)]
    hidden = np.array([[0], [0], [1]], dtype=np.uint8)
    options = {"object_poses": worlds, "world_index": np.array([0, 1, 0]), "exclude": hidden, "caster": caster}
    status = wv.point_visibility(scene, CAMERA, poses, points, **options).numpy()
    seen, behind = int(Visibility.VISIBLE), int(Visibility.OCCLUDED)
    assert status.tolist() == [[behind, seen, seen], [seen, seen, behind], [seen, seen, seen]]


def add_movables(scene, rows):
    """Add meshes and solids of several kinds at these poses in front of a static wall."""
    scene.add(trimesh.creation.box((0.1, 2.0, 1.5)), name="wall", pose=(2.8, 0, 0, 0, 0, 0, 1))
    meshes = (
        trimesh.creation.icosphere(subdivisions=2, radius=0.3),
        solids.sphere(0.25),
        trimesh.creation.torus(0.3, 0.1, major_sections=12, minor_sections=8),
        solids.cylinder(0.2, 0.6),
        solids.capsule(0.15, 0.4),
    )
    for index, (mesh, row) in enumerate(zip(meshes, rows, strict=True)):
        scene.add(mesh, name=f"moved_{index}", pose=row, movable=True)


def test_worlds_match_static_scenes(device, caster):
    rng = np.random.default_rng(3)
    worlds = np.concatenate([rng.uniform((1, -1, -0.7), (2.5, 1, 0.7), (3, 5, 3)), rng.normal(size=(3, 5, 4))], axis=-1)
    worlds[..., 3:] /= np.linalg.norm(worlds[..., 3:], axis=-1, keepdims=True)
    worlds = worlds.astype(np.float32)
    poses = np.array([wv.look_at(eye, (2, 0, 0)) for eye in ((0, 0, 0), (0.1, 0.8, 0.5), (4, 0, 0), (1, 0, 3))])
    world, exclude = np.array([0, 1, 2, 1]), np.zeros((4, 6), dtype=np.uint8)
    exclude[1, 0] = exclude[3, [2, 4]] = 1  # the wall, and two movable objects
    scene, twins = wv.Scene(device=device), []
    add_movables(scene, worlds[0])
    for view, index in enumerate(world):
        twin, rows = wv.Scene(), worlds[index].copy()
        rows[exclude[view, 1:] != 0] = (0, 0, -1e4, 0, 0, 0, 1)
        add_movables(twin, rows)
        twins.append(twin)
    twins[1].objects[0].vertices[:, 2] -= 1e4
    points = rng.uniform((0.5, -1.2, -1), (3.5, 1.2, 1), (3000, 3)).astype(np.float32)
    options = {"object_poses": worlds, "world_index": world, "exclude": exclude, "twins": twins, "caster": caster}
    for tolerance in (0.0, 0.01):
        found = assert_matches(scene, CAMERA, poses.astype(np.float32), points, tolerance=tolerance, **options)
        assert found == {0, 1, 2, 3, 4}


@pytest.mark.parametrize("tolerance", [0.0, 1e-3])
def test_points_far_from_the_origin_match_reference(device, caster, tolerance):
    """At 10 km, single precision has steps of a millimeter, which affect inputs but not the test of visibility."""
    place, rng = np.array([1e4, -7e3, 4e3]), np.random.default_rng(4)
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(subdivisions=3, radius=0.5), name="ball", pose=(*place, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((3, 3, 0.1)), name="floor", pose=(*(place - [0, 0, 0.5]), 0, 0, 0, 1))
    poses = np.array([wv.look_at(place + eye, place) for eye in ((2, 1, 0.5), (0, -2, 2))]).astype(np.float32)
    points = (place + rng.uniform(-1.5, 1.5, (3000, 3))).astype(np.float32)
    found = assert_matches(scene, CAMERA, poses, points, tolerance=tolerance, caster=caster)
    assert {Visibility.OUT_OF_VIEW, Visibility.OCCLUDED, Visibility.VISIBLE} <= found


def test_image_borders_and_extreme_points(device, caster):
    """The left and top image borders are inside, the right and bottom ones outside, like points behind the camera."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 1)), pose=(0, 0, 40, 0, 0, 0, 1))
    camera = wv.Camera(64, 48, 32.0, 32.0, 32.0, 24.0)
    seen, out = int(Visibility.VISIBLE), int(Visibility.OUT_OF_VIEW)
    x, y, before = np.float32(1), np.float32(0.75), np.float32(0.99999994)
    cases = [
        ((-x, 0, 1), seen),
        ((x, 0, 1), out),
        ((x * before, 0, 1), seen),
        ((0, -y, 1), seen),
        ((0, y, 1), out),
        *[((-z, -0.75 * z, z), seen) for z in (2.0, 3.0, 5.0, 7.0, 9.0, 11.0)],
        *[((z, 0.0, z), out) for z in (2.0, 3.0, 5.0, 7.0, 9.0, 11.0)],
        ((0, 0, 0), out),
        ((0, 0, -1), out),
        ((1, 1, 0), out),
        ((0, 0, 1e-30), seen),
        ((0, 0, 1e18), int(Visibility.OCCLUDED)),
        ((1e18, 0, 1.5e18), seen),
    ]
    status = wv.point_visibility(scene, camera, (0, 0, 0, 0, 0, 0, 1), [point for point, _ in cases], caster=caster)
    assert status.numpy()[0].tolist() == [expected for _, expected in cases]


def test_large_tolerance_disables_occlusion(device, caster):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.2, 9, 9)), pose=(2.1, 0, 0, 0, 0, 0, 1))
    points = np.array([(3, 0, 0), (3.5, 0.2, 0.1), (4, 0, 0)])
    given = (scene, CAMERA, wv.look_at((0, 0, 0), (1, 0, 0)), points)
    for tolerance, seen in ((1.2, [1, 0, 0]), (3.6, [1, 1, 1]), (1e6, [1, 1, 1])):
        status = wv.point_visibility(*given, tolerance=tolerance, caster=caster).numpy()[0]
        assert (status == Visibility.VISIBLE).tolist() == [bool(value) for value in seen]


def test_threads_and_device_arrays_do_not_change_results(device):
    preset = scenes.PRESETS["room"]
    scene, rng = preset.build(device), np.random.default_rng(1)
    points = points_around(scene, rng, 5000)
    one, two = (
        wv.point_visibility(scene, CAMERA, preset.poses(2), points, threads=threads).numpy() for threads in (1, 2)
    )
    assert (one == two).all()
    on_device = wp.array(points, dtype=wp.vec3, device=device)
    assert (wv.point_visibility(scene, CAMERA, preset.poses(2), on_device).numpy() == one).all()
    assert wv.point_visibility(scene, CAMERA, preset.poses(2), np.zeros((0, 3))).shape == (2, 0)


def test_measured_depth_matches_reference(device):
    rng = np.random.default_rng(2)
    preset = scenes.PRESETS["room"]
    scene, poses = preset.build(device), preset.poses(3)
    depth = wv.render(scene, ROOMY, poses, outputs="depth").depth.numpy()
    depth[rng.random(depth.shape) < 0.1] = np.nan
    depth[rng.random(depth.shape) < 0.1] = 0.0
    points = points_around(scene, rng, 4000)
    status = wv.point_visibility_from_depth(depth, ROOMY, poses, points, tolerance=0.02, device=device).numpy()
    found = set()
    for view, pose in enumerate(poses):
        expected = reference.judge_points_measured(ROOMY, pose, depth[view], points, 0.02)
        assert (status[view] != expected).mean() <= 5e-4  # a point at a pixel border may be rounded to either pixel
        found |= set(expected.tolist())
    assert found == {0, 1, 2, 3, 4, 5}
    one = wv.point_visibility_from_depth(depth[0], ROOMY, poses[0], points, tolerance=0.02, device=device).numpy()
    assert (one == status[:1]).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"scene": 3}, "scene must be a warpvis.Scene, got int"),
        ({"scene": wv.Scene()}, "the scene has no objects; add() one first"),
        ({"camera": None}, "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got NoneType"),
        ({"tolerance": -1}, "tolerance must be a number of meters from 0 up, got -1"),
        ({"tolerance": np.nan}, "tolerance must be a number of meters from 0 up, got nan"),
        ({"points": [(0, 0, np.nan), (0, 0, 0)]}, "points must be finite: 1 are not, the first at 0"),
        ({"points": np.zeros((4, 2))}, "points must have shape (N, 3), got (4, 2)"),
    ],
)
def test_invalid_arguments_are_rejected(change, said):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 1)))
    given = {"scene": scene, "camera": CAMERA, "camera_to_world": np.eye(4), "points": np.zeros((2, 3)), **change}
    with pytest.raises(wv.WarpvisError) as error:
        wv.point_visibility(**given)
    assert str(error.value) == said


@pytest.mark.parametrize(
    ("depth", "said"),
    [
        (np.zeros((2, 240, 320)), "camera_to_world must have one pose for each view of depth, 2, got 1"),
        (np.zeros((1, 24, 32)), "depth must have shape (V, 240, 320), got (1, 24, 32)"),
    ],
)
def test_invalid_depth_images_are_rejected(depth, said):
    with pytest.raises(wv.WarpvisError) as error:
        wv.point_visibility_from_depth(depth.astype(np.float32), CAMERA, np.eye(4), np.zeros((2, 3)))
    assert str(error.value) == said
