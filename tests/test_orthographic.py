# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Orthographic images, compared with a float64 reference, closed forms and MuJoCo's pictures, and invalid input."""

import pickle

import mujoco
import numpy as np
import pytest
import trimesh
from mujoco_models import shapes_model
from pose_samples import unit

import warpvis as wv
from warpvis.cameras.orthographic import OrthographicCamera
from warpvis.mujoco import BatchRenderer, Renderer, camera_from_mujoco, geom_poses, scene_from_mujoco
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer

import reference
from compare import assert_view_matches, hair
from support.coinciding import FLUSH, eye_of, model_of
from support.mujoco_drop_in import HEIGHT, WIDTH
from support.mujoco_following import task
from support.mujoco_renderer import assert_same_images, free_camera, geoms_only, images
from support.solids import build as build_solids
from support.worlds import ALL, random_poses

PLAN = OrthographicCamera(16, 11, fx=8.0, fy=6.0, cx=7.3, cy=5.1, near=0.8, far=3.0)


def assert_matches_reference(views, scene, camera, poses, **options):
    """Compare with the reference, except where a ray 1e-5 px away hits another surface."""
    for view, pose in enumerate(poses):
        expected = reference.cast_parallel_rays(scene, camera, pose, **options)

        def depth_beside(x, y, pose=pose):
            beside = np.array([x + 0.5, y + 0.5]) + hair(1e-5, 2)
            return reference.cast_parallel_rays(scene, camera, pose, pixels=beside, **options).depth

        assert_view_matches(views, view, expected, depth_beside)


@pytest.mark.slow
@pytest.mark.parametrize(("near_plane", "cull_backfaces"), [("occlude", True), ("clip", False), ("clip", True)])
def test_solids_and_moved_meshes_match_reference(near_plane, cull_backfaces, device):
    """The camera is among the objects, so that they intersect its plane."""
    rng = np.random.default_rng(1)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=1, radius=0.3)]
    scene = build_solids(device, random_poses(rng, 10, spread=1.0), extra=meshes)
    scene.add(trimesh.creation.box((5, 5, 0.1)), name="slab", pose=unit((0, 0, -1.2, 0.1, 0, 0, 1)))
    poses = np.array([wv.look_at((1.8, 0.3, 1.2), (0, 0, 0.4)), wv.look_at((0.2, -0.3, 0.5), (1.0, 0.6, 0.5))])
    options = {"cull_backfaces": cull_backfaces, "near_plane": near_plane}
    views = wv.render(scene, PLAN, poses, outputs=ALL, **options)
    depth = views.depth.numpy()
    assert np.isposinf(depth).any() and np.isfinite(depth).mean() > 0.1
    assert np.isneginf(depth).any() == (near_plane == "occlude")
    assert len(np.unique(views.segmentation.numpy())) >= 5
    assert_matches_reference(views, scene, PLAN, poses, **options)


def test_ball_and_floor_from_above_match_closed_form(device):
    """Size does not depend on distance: compare depths of a ball and of the floor."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 4, 0.2)), name="floor", label="ground", pose=(0, 0, -0.1, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(subdivisions=5, radius=0.5), name="ball", pose=(0.3, 0.2, 0.5, 0, 0, 0, 1))
    camera = OrthographicCamera.from_extent(60, 40, across=3.0, far=50.0)
    assert camera == OrthographicCamera.from_extent(60, 40, down=2.0, far=50.0)
    heights = np.array([2.0, 5.0, 40.0])
    poses = np.array([(0, 0, h, 1, 0, 0, 0) for h in heights])  # y down in the image is -y of the world
    depth = wv.render(scene, camera, poses, outputs=("depth",)).depth.numpy()
    y, x = np.mgrid[:40, :60] + 0.5
    east, north = (x - 30) / 20 - 0.3, (20 - y) / 20 - 0.2
    under = 0.25 - east**2 - north**2
    top = np.where(under > 0, 0.5 + np.sqrt(np.maximum(under, 0)), 0.0)
    np.testing.assert_allclose(depth, heights[:, None, None] - top, atol=1e-3)


def test_render_at_pixel_centers_matches_image(device):
    scene, camera = wv.scenes.PRESETS["room"].build(device), OrthographicCamera.from_extent(32, 24, across=3.0)
    pose = np.array([wv.look_at((0.1, 0.2, 1.9), (0.5, 0.4, 0.3))])
    renderer = wv.Renderer(scene, camera, outputs=ALL, caster="rays")
    images = renderer.render(pose)
    y, x = np.mgrid[:24, :32] + 0.5
    at = np.stack([x, y], axis=-1).reshape(1, -1, 2)
    at = np.concatenate([at, [[(-0.1, 3), (32, 3), (np.nan, 1)]]], axis=1)
    points = renderer.render_at(pose, at)
    for name in ALL:
        image, row = getattr(images, name).numpy(), getattr(points, name).numpy()
        assert np.array_equal(row[:, :-3].reshape(image.shape), image, equal_nan=True)
        assert not np.isfinite(points.depth.numpy()[:, -3:]).any()


def test_flush_geoms_match_reference(device):
    model, data = model_of(FLUSH)
    geoms, camera = scene_from_mujoco(model, device=device), OrthographicCamera.from_extent(160, 120, across=1.6)
    coinciding = CoincidingGeoms(model, geoms.scene, geoms.geom_ids)
    options = {"outputs": ("segmentation", "depth", "labels"), "cull_backfaces": True}
    given = {"object_poses": geom_poses(data, geoms)[None]}
    eye = eye_of(model, data)
    seen = GeomRenderer(geoms.scene, camera, coinciding, **options).render(eye, **given)
    plain = wv.Renderer(geoms.scene, camera, **options).render(eye, **given)
    was, depth = plain.segmentation.numpy()[0], plain.depth.numpy()[0]
    rows = given["object_poses"][0]
    expected = reference.show_later_from_plane(geoms.scene, camera, eye[0], was, depth, object_poses=rows)
    now = seen.segmentation.numpy()[0]
    assert (now != expected).sum() <= 2 and (now != was).sum() > 300
    assert np.array_equal(seen.depth.numpy()[0], depth)
    labels = np.array([int(item.label) for item in geoms.scene.objects] + [0])
    assert np.array_equal(seen.labels.numpy()[0], labels[now])


@pytest.mark.smoke("free")
@pytest.mark.gl
@pytest.mark.parametrize("camera", ["flat", -1, "free"])
def test_orthographic_cameras_match_mujoco(camera):
    model, data = shapes_model()
    model.vis.global_.orthographic, model.vis.global_.fovy = 1, 2.4
    if camera == "free":  # the camera itself specifies its projection
        camera = free_camera()
        camera.orthographic = 1
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs, Renderer(model, HEIGHT, WIDTH) as renderer:
        expected = images(theirs, data, camera, geoms_only())
        assert_same_images(images(renderer, data, camera), expected, 1e-3)
        for each in (renderer, theirs):
            each.update_scene(data, camera, geoms_only())
        eyes = [mujoco.mjv_averageCamera(*each.scene.camera) for each in (renderer, theirs)]
        assert [eye.orthographic for eye in eyes] == [1, 1]
        for side in ("bottom", "top", "center", "width", "near", "far"):
            assert getattr(eyes[0], f"frustum_{side}") == pytest.approx(getattr(eyes[1], f"frustum_{side}"), rel=1e-6)
        renderer.enable_depth_rendering()
        again = pickle.loads(pickle.dumps(renderer))
        np.testing.assert_allclose(again.render(), renderer.render(), atol=1e-5)


@pytest.mark.gl
def test_scene_camera_set_to_orthographic_matches_mujoco():
    model, data = task()
    mujoco.mj_forward(model, data)
    pictures = []
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs, Renderer(model, HEIGHT, WIDTH) as renderer:
        for each in (renderer, theirs):
            each.update_scene(data, "front")
            for eye in each.scene.camera:
                eye.orthographic, eye.frustum_top, eye.frustum_bottom = 1, 0.9, -0.7
                eye.frustum_width, eye.frustum_center = 0.0, 0.0
            each.enable_depth_rendering()
            depth = each.render()
            each.enable_segmentation_rendering()
            pictures.append((depth, each.render()))
    assert_same_images(*pictures, 1e-3)


def test_batches_support_orthographic_cameras(device):
    model, data = shapes_model()
    batch = BatchRenderer(model, height=HEIGHT, width=WIDTH, outputs=("depth", "segmentation"), device=device)
    views = batch.render(data, cameras=["front", "flat"])
    for view, name in enumerate(("front", "flat")):
        renderer = Renderer(model, HEIGHT, WIDTH, device=device)
        depth, pairs = images(renderer, data, name)
        np.testing.assert_allclose(np.minimum(views.depth.numpy()[view], depth.max()), depth, rtol=1e-5)
        assert np.array_equal(batch.geom_ids(views).numpy()[view], pairs[..., 0])
    wide = batch.render(data, cameras="flat", model={"cam_fovy": [[4.0] * model.ncam]})
    seen = camera_from_mujoco(model, "flat", WIDTH, HEIGHT)
    assert isinstance(seen, OrthographicCamera) and seen.fy == pytest.approx(HEIGHT / 2)
    model.cam_fovy[model.camera("flat").id] = 4.0
    other = BatchRenderer(model, height=HEIGHT, width=WIDTH, device=device)
    assert np.array_equal(wide.depth.numpy(), other.render(data, cameras="flat").depth.numpy())
    with pytest.raises(wv.WarpvisError, match=r"cam_fovy must be a number of meters above 0, got 0.0 for camera"):
        fovy = np.array([[45.0] * model.ncam])
        fovy[0, model.camera("flat").id] = 0.0
        batch.render(data, cameras="flat", model={"cam_fovy": fovy})


FLAT = OrthographicCamera.from_extent(8, 6, across=1.0)
BAD = {
    "no extent": (lambda: OrthographicCamera.from_extent(8, 6), "either across or down must be given, in meters"),
    "two extents": (
        lambda: OrthographicCamera.from_extent(8, 6, across=1, down=1),
        "either across or down must be given",
    ),
    "flat": (
        lambda: OrthographicCamera.from_extent(8, 6, down=0.0),
        "down must be a positive number of meters, got 0.0",
    ),
    "scale": (
        lambda: OrthographicCamera(8, 6, 0, 1, 4, 3),
        "fx and fy must be greater than 0 px/m, got fx=0.0, fy=1.0",
    ),
    "NaN": (lambda: OrthographicCamera(8, 6, 1, 1, np.nan, 3), "cx must be a finite number, got nan"),
    "range": (lambda: OrthographicCamera(8, 6, 1, 1, 4, 3, 2, 1), "the depth range needs 0 <= near < far"),
    "packets": (
        lambda: wv.Renderer(wv.scenes.PRESETS["room"].build(), FLAT, caster="packets"),
        'caster must be "rays" or "auto" for an OrthographicCamera, got "packets"',
    ),
    "points": (
        lambda: wv.point_visibility(wv.scenes.PRESETS["room"].build(), FLAT, (0, 0, 1, 0, 0, 0, 1), [[0, 0, 0]]),
        "camera must be a warpvis.Camera or a warpvis.cameras.LensCamera, got OrthographicCamera",
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_arguments_are_rejected(name):
    call, message = BAD[name]
    with pytest.raises(wv.WarpvisError, match=message):
        call()
