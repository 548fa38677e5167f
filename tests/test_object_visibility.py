# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of objects: BOP's definition in float64 NumPy, worlds, reasons, masks, and invalid input."""

import dataclasses

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.visibility import BOP_DELTA, _objects as module, object_visibility

import reference
from support.object_visibility import COUNTS, cameras, desk

SMALL = wv.Camera.from_fov(64, 48, hfov=1.0)
FIELDS = (*COUNTS, "fraction", "status", "occluder", "visible_box", "silhouette_box")


def expected_of(scene, camera, pose, index, canvas, delta, min_pixels=1):
    masks = reference.measure_silhouettes(scene, camera, pose, index, canvas=canvas, delta=delta)
    return masks, reference.judge_silhouettes(masks, canvas, min_pixels)


@pytest.fixture(scope="module")
def target():
    scene = wv.Scene()
    scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="cube", movable=True)
    scene.add(trimesh.creation.box((1, 1, 0.1)), name="screen", movable=True, pose=(9, 9, -9, 0, 0, 0, 1))
    return scene


@pytest.mark.smoke("*-0.015-packets")
@pytest.mark.parametrize("caster", ["packets", "rays"])
@pytest.mark.parametrize("delta", [0.0, BOP_DELTA])
def test_fractions_match_bop_reference(device, caster, delta):
    """The object alone on a canvas of 3 W x 3 H, range images, delta 15 mm: counts agree within one pixel."""
    scene, poses = desk(device), cameras()
    camera = wv.Camera.from_fov(40, 30, hfov=1.0, near=0.6, far=3.2)
    result = object_visibility(scene, camera, poses, delta=delta, caster=caster, masks=True)
    assert result.names == tuple(item.name for item in scene)
    canvas = (camera.width, camera.height, camera.width, camera.height)
    several = set()
    for view, pose in enumerate(poses):
        for index in range(len(scene)):
            masks, expected = expected_of(scene, camera, pose, index, canvas, delta)
            for name in COUNTS:
                assert abs(int(getattr(result, name).numpy()[view, index]) - expected[name]) <= 1, (name, view, index)
            whole = max(expected["silhouette_pixels"], 1)
            assert abs(result.fraction.numpy()[view, index] - expected["fraction"]) <= 2 / whole
            assert result.status.numpy()[view, index] == expected["status"], (view, scene.objects[index].name)
            assert result.occluder.numpy()[view, index] == expected["occluder"]
            for name in ("visible_box", "silhouette_box"):
                assert np.abs(getattr(result, name).numpy()[view, index] - expected[name]).max() <= 1
            mask = masks["silhouette"] + masks["visible"].astype(np.uint8)
            assert (result.masks.numpy()[view, index] != mask).sum() <= 1
            several.add(expected["status"])
    assert len(several) >= 3


def test_counts_equal_those_of_the_toolkit_on_the_same_depth_images(device):
    """Masks, counts, fractions and boxes by ``d_model - d_test <= delta`` on rendered images of both.

    Source: `estimate_visib_mask_gt` of bop_toolkit_lib/visibility.py and scripts/calc_gt_info.py of BOP's toolkit.
    """
    scene, poses = desk(device), cameras()
    camera = wv.Camera.from_fov(64, 48, hfov=1.0, near=0.0, far=np.inf)
    canvas = dataclasses.replace(camera, width=192, height=144, cx=camera.cx + 64, cy=camera.cy + 48)
    found = object_visibility(scene, camera, poses, delta=BOP_DELTA, masks=True)
    length = np.linalg.norm(camera.rays, axis=-1)
    test = wv.render(scene, camera, poses, outputs="depth").depth.numpy() * length
    partial = 0
    for index, name in enumerate(found.names):
        others = [other for other in found.names if other != name]
        model = wv.render(scene, canvas, poses, outputs="depth", exclude=others).depth.numpy()
        whole, distance = np.isfinite(model), model[:, 48:96, 64:128] * length
        with np.errstate(invalid="ignore"):
            behind = distance - test
        assert not (np.abs(behind - BOP_DELTA) < 1e-6).any()
        visible = np.isfinite(distance) & (behind <= BOP_DELTA)
        masks = found.masks.numpy()[:, index]
        np.testing.assert_array_equal(masks == 2, visible)
        np.testing.assert_array_equal(masks > 0, np.isfinite(distance))
        counts = visible.sum(axis=(1, 2)), whole.sum(axis=(1, 2))
        np.testing.assert_array_equal(found.visible_pixels.numpy()[:, index], counts[0])
        np.testing.assert_array_equal(found.silhouette_pixels.numpy()[:, index], counts[1])
        fractions = np.divide(*counts, out=np.zeros(len(poses)), where=counts[1] > 0)
        np.testing.assert_allclose(found.fraction.numpy()[:, index], fractions, rtol=1e-6)
        partial += ((fractions > 0.05) & (fractions < 0.95)).sum()
        for view in np.flatnonzero(counts[0]):
            for box, mask, shift in (("visible_box", visible, (0, 0)), ("silhouette_box", whole, (64, 48))):
                y, x = np.nonzero(mask[view])
                expected = [x.min() - shift[0], y.min() - shift[1], np.ptp(x) + 1, np.ptp(y) + 1]
                assert getattr(found, box).numpy()[view, index].tolist() == expected
    assert partial >= 5


def test_delta_tolerates_surfaces_just_in_front(device):
    """A sheet 9 mm in front of a wall hides it, unless a delta of 15 mm treats the difference as noise."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((1, 1, 0.01)), name="wall", pose=(0, 0, 2, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((2, 2, 0.001)), name="sheet", pose=(0, 0, 1.986, 0, 0, 0, 1))
    pose = (0, 0, 0, 0, 0, 0, 1)
    exact, bop = (object_visibility(scene, SMALL, pose, delta=delta) for delta in (0.0, BOP_DELTA))
    assert exact.fraction.numpy()[0, 0] == 0 and exact.status.numpy()[0, 0] == wv.Visibility.OCCLUDED
    assert exact.occluder.numpy()[0, 0] == 1
    assert bop.fraction.numpy()[0, 0] == 1 and bop.occluder.numpy()[0, 0] == -1


@pytest.mark.parametrize("delta", [0.0, BOP_DELTA])
def test_large_object_behind_a_sheet(delta):
    """Tiles inside the image, whose pixels are counted together: the wall's pixels are those of the segmentation."""
    camera = wv.Camera.from_fov(128, 96, hfov=1.0)
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((3, 2.2, 0.01)), name="wall", pose=(0, 0, 4, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.9, 0.7, 0.01)), name="sheet", pose=(0.1, 0.05, 3, 0, 0, 0, 1))
    pose = (0, 0, 0, 0, 0, 0, 1)
    seen = wv.render(scene, camera, pose, outputs=("segmentation",)).segmentation.numpy()[0]
    result = object_visibility(scene, camera, pose, delta=delta)
    np.testing.assert_array_equal(result.visible_pixels.numpy()[0], [(seen == 0).sum(), (seen == 1).sum()])
    assert result.silhouette_pixels.numpy()[0, 0] == (seen >= 0).sum()
    assert result.occluder.numpy()[0].tolist() == [1, -1]


@pytest.mark.parametrize(
    ("cube", "screen", "status", "occluder"),
    [
        ((0, 0, 2), (9, 9, -9), wv.Visibility.VISIBLE, -1),
        ((0, 0, -2), (9, 9, -9), wv.Visibility.OUT_OF_VIEW, -1),
        ((5, 0, 2), (9, 9, -9), wv.Visibility.OUT_OF_VIEW, -1),
        ((0, 0, 0.3), (9, 9, -9), wv.Visibility.TOO_NEAR, -1),
        ((0, 0, 6), (9, 9, -9), wv.Visibility.TOO_FAR, -1),
        ((0, 0, 2), (0, 0, 1), wv.Visibility.OCCLUDED, 1),
        ((0, 0, 2), (0, 0, 0.2), wv.Visibility.OCCLUDED, 1),  # surfaces nearer than `near` occlude too
        ((0, 0, 4), (0, 0, 0.2), wv.Visibility.OCCLUDED, 1),
        ((0, 0, 0.3), (0, 0, 0.1), wv.Visibility.TOO_NEAR, 1),
    ],
)
def test_status_covers_every_reason(target, cube, screen, status, occluder):
    camera = wv.Camera.from_fov(64, 48, hfov=1.0, near=0.5, far=4.5)
    poses = np.array([[*cube, 0, 0, 0, 1], [*screen, 0, 0, 0, 1]], dtype=np.float32)
    result = object_visibility(target, camera, (0, 0, 0, 0, 0, 0, 1), objects=["cube"], object_poses=poses)
    assert result.status.numpy()[0, 0] == status
    if status != wv.Visibility.TOO_NEAR:
        assert result.occluder.numpy()[0, 0] == occluder
    assert (result.visible_pixels.numpy()[0, 0] > 0) == (status == wv.Visibility.VISIBLE)


def test_truncated_part_counts_as_unseen(target):
    """Half of a cube is outside the image; BOP's canvas includes that half, a canvas without border does not."""
    poses = np.array([[[0, 0, 2, 0, 0, 0, 1], [9, 9, -9, 0, 0, 0, 1]]], dtype=np.float32)
    cut = wv.Camera(64, 48, 100, 100, 0.0, 24.0)
    wide = object_visibility(target, cut, (0, 0, 0, 0, 0, 0, 1), objects=["cube"], object_poses=poses)
    image = object_visibility(target, cut, (0, 0, 0, 0, 0, 0, 1), objects=[0], object_poses=poses, canvas=(0, 0, 0, 0))
    assert wide.fraction.numpy()[0, 0] == pytest.approx(0.5, abs=0.02)
    assert image.fraction.numpy()[0, 0] == 1
    assert wide.silhouette_box.numpy()[0, 0, 0] < 0 == image.silhouette_box.numpy()[0, 0, 0]
    assert (wide.visible_box.numpy() == image.visible_box.numpy()).all()


@pytest.mark.smoke("*packets*")
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_silhouettes_that_surround_the_camera(device, caster):
    """Inside an object, its silhouette fills the canvas; a floor extends behind the camera."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 4, 4)), name="room")
    scene.add(trimesh.creation.box((50, 50, 0.1)), name="floor", pose=(0, 0, -1, 0, 0, 0, 1))
    scene.add(wv.scene.solids.sphere(3.0), name="dome", movable=True)
    result = object_visibility(scene, SMALL, wv.look_at((0, 0, 0), (1, 0, 0)), caster=caster)
    assert result.silhouette_pixels.numpy()[0, 0] == 9 * 64 * 48
    assert result.silhouette_box.numpy()[0, 0].tolist() == [-64, -48, 192, 144]
    assert result.silhouette_pixels.numpy()[0, 2] == 9 * 64 * 48
    _, expected = expected_of(scene, SMALL, wv.look_at((0, 0, 0), (1, 0, 0)), 1, (64, 48, 64, 48), 0.0)
    assert abs(result.silhouette_pixels.numpy()[0, 1] - expected["silhouette_pixels"]) <= 1


def test_ball_silhouette_matches_closed_form():
    """An off-axis ball at (x, 0, z) projects to an ellipse of area pi f^2 r^2 z / (z^2 - r^2)^1.5, z along the axis."""
    scene = wv.Scene()
    scene.add(wv.scene.solids.sphere(0.5), name="ball", movable=True, pose=(0, 0, 3, 0, 0, 0, 1))
    camera = wv.Camera.from_fov(640, 480, hfov=1.0)
    result = object_visibility(scene, camera, (0, 0, 0, 0, 0, 0, 1))
    area = np.pi * camera.fx**2 * 0.25 / (9 - 0.25)
    assert result.silhouette_pixels.numpy()[0, 0] == pytest.approx(area, rel=2e-3)


def worlds_of(scene, count, seed=3):
    rng = np.random.default_rng(seed)
    rows = np.tile(np.array([scene.objects[i].pose for i in scene.movable], dtype=np.float32), (count, 1, 1))
    rows[:, :, :3] += rng.uniform(-0.4, 0.4, (count, len(scene.movable), 3)).astype(np.float32)
    return rows


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_worlds_and_exclusion_match_single_calls(device, caster):
    scene, poses = desk(device), cameras()
    worlds, which = worlds_of(scene, 3), np.array([2, 0, 2, 1], dtype=np.int32)
    flags = np.zeros((4, len(scene)), dtype=np.uint8)
    flags[1, scene.index("wall")] = flags[3, scene.index("cart")] = 1
    together = object_visibility(
        scene, SMALL, poses, object_poses=worlds, world_index=which, exclude=flags, caster=caster
    )
    for view in range(4):
        names = [item.name for item, flag in zip(scene, flags[view], strict=True) if flag]
        alone = object_visibility(
            scene, SMALL, poses[view], object_poses=worlds[which[view]], exclude=names, caster=caster
        )
        for field in FIELDS:
            assert (getattr(together, field).numpy()[view] == getattr(alone, field).numpy()[0]).all(), field
    assert together.silhouette_pixels.numpy()[1, scene.index("wall")] == 0
    assert together.status.numpy()[1, scene.index("wall")] == wv.Visibility.OUT_OF_VIEW
    assert together.silhouette_pixels.numpy()[3, scene.index("mast")] > 0


def test_casters_threads_and_chunks_agree(monkeypatch):
    scene, rng = desk(), np.random.default_rng(5)
    eyes = rng.uniform([-3, -3, 0.2], [3, 3, 2], (40, 3))
    poses = np.array([wv.look_at(eye, rng.uniform(-0.5, 1, 3)) for eye in eyes], dtype=np.float32)
    results = [object_visibility(scene, SMALL, poses, delta=0.01, threads=n, masks=True) for n in (1, 2, 3)]
    monkeypatch.setattr(module, "_CPU_BYTES", 200_000)  # several chunks of unequal size
    results.append(object_visibility(scene, SMALL, poses, delta=0.01, masks=True))
    for field in (*FIELDS, "masks"):
        for other in results[1:]:
            assert getattr(results[0], field).numpy().tobytes() == getattr(other, field).numpy().tobytes(), field
    rays = object_visibility(scene, SMALL, poses, delta=0.01, caster="rays")
    for field in COUNTS:
        assert np.abs(getattr(rays, field).numpy() - getattr(results[0], field).numpy()).max() <= 1


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_skip_unseen_omits_silhouettes(device, caster):
    scene, poses = desk(device), cameras()
    every = object_visibility(scene, SMALL, poses, caster=caster)
    some = object_visibility(scene, SMALL, poses, caster=caster, skip_unseen=True)
    seen = every.visible_pixels.numpy() > 0
    assert 0 < seen.sum() < seen.size
    for field in FIELDS:
        wanted = every.image_pixels if field == "silhouette_pixels" else getattr(every, field)
        got = getattr(some, field).numpy()
        assert (got[seen] == getattr(every, field).numpy()[seen]).all(), field
        if field != "silhouette_box":
            assert (got[~seen] == wanted.numpy()[~seen]).all(), field


def test_objects_selects_in_given_order():
    scene, poses = desk(), cameras()
    every = object_visibility(scene, SMALL, poses)
    some = object_visibility(scene, SMALL, poses, objects=["mast", 0, "ball"])
    assert some.objects == (5, 0, 2) and some.names == ("mast", "floor", "ball")
    for field in FIELDS:
        assert (getattr(some, field).numpy() == getattr(every, field).numpy()[:, [5, 0, 2]]).all(), field


def test_min_pixels_threshold():
    scene = wv.Scene()
    scene.add(trimesh.creation.icosphere(radius=0.03), name="pea", pose=(0, 0, 1, 0, 0, 0, 1))
    pose = (0, 0, 0, 0, 0, 0, 1)
    one = object_visibility(scene, SMALL, pose)
    assert 0 < one.visible_pixels.numpy()[0, 0] < 20 and one.status.numpy()[0, 0] == wv.Visibility.VISIBLE
    many = object_visibility(scene, SMALL, pose, min_pixels=20)
    assert many.status.numpy()[0, 0] == wv.Visibility.TOO_FAR
    assert many.visible_pixels.numpy()[0, 0] == one.visible_pixels.numpy()[0, 0]


def test_silhouette_follows_updated_vertices(device):
    scene = wv.Scene(device=device)
    cube = trimesh.creation.box((0.2, 0.2, 0.2))
    scene.add(cube, name="cube", movable=True, pose=(0, 0, 2, 0, 0, 0, 1))
    pose = (0, 0, 0, 0, 0, 0, 1)
    before = object_visibility(scene, SMALL, pose).silhouette_pixels.numpy()[0, 0]
    for factor in (2.0, 3.0):
        scene.update_vertices("cube", (cube.vertices * [factor, 1, 1]).astype(np.float32))
        after = object_visibility(scene, SMALL, pose).silhouette_pixels.numpy()[0, 0]
        assert after == pytest.approx(factor * before, rel=0.15)
    scene.add(cube, name="another", pose=(0.5, 0, 2, 0, 0, 0, 1))
    assert object_visibility(scene, SMALL, pose).silhouette_pixels.shape == (1, 2)


def test_zero_views():
    result = object_visibility(desk(), SMALL, np.zeros((0, 7)), masks=True)
    assert result.fraction.shape == (0, 8) and result.masks.shape == (0, 8, 48, 64)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"objects": ["cup"]}, "the scene has no object 'cup'; it has 'floor'"),
        ({"objects": []}, r"objects must be one or more distinct objects of the scene, got \[\]"),
        ({"objects": ["ball", 2]}, "objects must be one or more distinct objects"),
        ({"objects": [8]}, "objects must be names, or indices from 0 to 7, got 8"),
        ({"objects": [True]}, "objects must be names, or indices from 0 to 7, got True"),
        ({"delta": -1.0}, "delta must be a number of meters from 0 up, got -1.0"),
        ({"delta": float("nan")}, "delta must be a number of meters from 0 up, got nan"),
        ({"min_pixels": 0}, "min_pixels must be a whole number from 1 up, got 0"),
        (
            {"canvas": (1, 2, 3)},
            r"canvas must be four whole numbers of pixels: left, top, right, bottom, got \(1, 2, 3\)",
        ),
        ({"canvas": (-1, 0, 0, 0)}, "canvas must be four whole numbers of pixels"),
        ({"object_poses": np.zeros((1, 5, 7))}, r"object_poses must have shape \(W, 2, 7\)"),
        ({"exclude": ["cup"]}, "the scene has no object 'cup'"),
        ({"world_index": [7]}, "world_index must be from 0 to 0"),
    ],
)
def test_invalid_arguments_are_rejected(arguments, message):
    with pytest.raises(wv.WarpvisError, match=message):
        object_visibility(desk(), SMALL, cameras()[0], **arguments)


def test_invalid_scene_and_camera_are_rejected():
    with pytest.raises(wv.errors.SceneError, match=r"scene must be a warpvis\.Scene, got list"):
        object_visibility([], SMALL, cameras())
    with pytest.raises(wv.errors.CameraError, match=r"camera must be a warpvis\.Camera or a .*LensCamera, got int"):
        object_visibility(desk(), 3, cameras())
    with pytest.raises(wv.errors.SceneError, match="the scene has no objects"):
        object_visibility(wv.Scene(), SMALL, cameras())


def test_spread_poses_matches_reference():
    from warpvis.kernels.visibility.object_frames import spread_poses

    rows, columns = np.random.default_rng(0).normal(size=(2, 3, 7)).astype(np.float32), np.array([2, -1, 0, 0])
    at_rest = np.random.default_rng(1).normal(size=(1, 4, 7)).astype(np.float32)
    out = wp.zeros((2, 4), dtype=wp.transform, device="cpu")
    places = [wp.array(array, dtype=wp.transform, device="cpu") for array in (rows, at_rest)]
    inputs = [places[0], wp.array(columns, dtype=wp.int32, device="cpu"), places[1], out]
    wp.launch(spread_poses, dim=(2, 4), inputs=inputs, device="cpu")
    assert (out.numpy().view(np.float32).reshape(2, 4, 7) == reference.spread_poses(rows, columns, at_rest)).all()


def test_spread_sizes_matches_reference():
    from warpvis.kernels.visibility.object_frames import spread_sizes

    rng, columns, is_attached = np.random.default_rng(0), np.array([2, -1, 0, 0, 1]), np.array([0, 0, 1, 0, 0])
    arrays = [rng.uniform(0.5, 2, shape).astype(np.float32) for shape in ((2, 3, 4), (3, 4), (5, 4))]
    out = wp.zeros((2, 5), dtype=wp.vec4, device="cpu")
    inputs = [wp.array(array, dtype=wp.vec4, device="cpu") for array in arrays]
    flags = wp.array(is_attached, dtype=wp.uint8, device="cpu")
    inputs += [wp.array(columns, dtype=wp.int32, device="cpu"), flags, out]
    wp.launch(spread_sizes, dim=(2, 5), inputs=inputs, device="cpu")
    assert np.allclose(out.numpy(), reference.spread_sizes(*arrays, columns, is_attached), rtol=1e-6, atol=0)
