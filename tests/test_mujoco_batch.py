# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Batches whose worlds differ in model fields, and cameras of viewers."""

import copy
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.kernels.mujoco import arrays as kernels
from warpvis.mujoco import BatchRenderer, BatchViews, Kinematics, Renderer, WorldPoses

import reference
from support.mujoco_following import task

HEIGHT, WIDTH = 36, 48


def batch_of(model, **options):
    options = {"outputs": ("depth", "segmentation"), "height": HEIGHT, "width": WIDTH} | options
    return BatchRenderer(model, **options)


def single(model, data, camera, device):
    """Return depth and geoms of `Renderer`, which follows its model; depth is infinite where nothing is hit."""
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, HEIGHT, WIDTH, device=device)
    renderer.update_scene(data, camera)
    renderer.enable_segmentation_rendering()
    geoms = renderer.render()[..., 0]
    renderer.enable_depth_rendering()
    return np.where(geoms < 0, np.inf, renderer.render()), geoms


def assert_same(batch, views, worlds, cameras, device):
    """Compare each image with one of `worlds`, pairs of a model and data, rendered alone."""
    depth, geoms = views.depth.numpy(), batch.geom_ids(views).numpy()
    assert len(depth) == len(worlds) * len(cameras)
    expected = [single(*world, camera, device) for camera in cameras for world in worlds]
    for view, (expected_depth, expected_geoms) in enumerate(expected):
        same = geoms[view] == expected_geoms
        assert same.mean() > 0.998, view
        finite = same & np.isfinite(expected_depth)
        assert np.abs(depth[view][finite] - expected_depth[finite]).max(initial=0) < 1e-4
    return len({image.tobytes() for image in depth})


def randomized(count):
    """Return models with different values of all fields that poses depend on, and their data."""
    rng, worlds = np.random.default_rng(2), []
    for _ in range(count):
        model, data = task()
        model.body("drawer").pos[:2] += rng.uniform(-0.3, 0.3, 2)
        model.body("lid").quat[:] = 0.8, 0, 0, 0.6
        model.geom("handle").pos[0] += rng.uniform(-0.1, 0.1)
        model.geom("pole").quat[:] = 0.96, *(0.28 * np.eye(3)[rng.integers(3)])
        model.cam_pos[:, 2] += rng.uniform(-0.05, 0.2)
        data.qpos[:3] += rng.uniform(-0.2, 0.2, 3)
        worlds.append((model, data))
    return worlds


FIELDS = ("body_pos", "body_quat", "geom_pos", "geom_quat", "cam_pos", "cam_quat")


def fields(worlds, names=FIELDS):
    return {name: np.stack([getattr(model, name) for model, _ in worlds]) for name in names}


def test_static_bodies_and_cameras_differ_between_worlds(device):
    worlds = randomized(4)
    batch = batch_of(task()[0], movable="all", device=device)
    qpos = np.stack([data.qpos for _, data in worlds])
    views = batch.render(qpos, cameras=["front", "wrist"], model=fields(worlds))
    assert assert_same(batch, views, worlds, ["front", "wrist"], device) == 8
    # With computed data, and with a selection of worlds.
    views = batch.render([data for _, data in worlds], cameras="front")
    assert_same(batch, views, worlds, ["front"], device)
    views = batch.render(qpos, cameras="front", worlds=[3, 1], model=fields(worlds))
    assert_same(batch, views, [worlds[3], worlds[1]], ["front"], device)


def test_movable_selects_static_bodies(device):
    worlds = randomized(3)
    for model, _ in worlds:
        model.geom("pole").quat[:] = task()[0].geom("pole").quat
        model.geom("handle").pos[:] = task()[0].geom("handle").pos
    batch = batch_of(task()[0], movable=["drawer", "lid"], device=device)
    scene = batch.scene
    assert not scene["table"].movable and scene["lid"].parent is None
    assert scene.objects[scene["handle"].parent].name == "case"  # geoms of a body are rigidly attached
    views = batch.render(np.stack([data.qpos for _, data in worlds]), cameras="front", model=fields(worlds))
    assert assert_same(batch, views, worlds, ["front"], device) == 3


def test_moved_static_geoms_are_rejected():
    worlds = randomized(2)
    qpos = np.stack([data.qpos for _, data in worlds])
    for _, data in worlds:
        data.qpos[:] = qpos[0]
    batch = batch_of(task()[0])
    match = (
        r"geom '\w+' is static and must have the model's pose, got another in world 0; "
        r"pass movable=\['\w+'\] or movable=\"all\" to the constructor of the renderer or wrapper"
    )
    with pytest.raises(wv.WarpvisError, match=match):
        batch.render(qpos, model=fields(worlds))
    for model, data in worlds:
        mujoco.mj_forward(model, data)
    with pytest.raises(wv.WarpvisError, match=match):
        batch.render([data for _, data in worlds])
    batch.render(qpos)


@pytest.mark.smoke("*-angles2")
@pytest.mark.parametrize("angles", [[40, 70, 55, 90], [50, 80, 50, 80], [60, 60, 60, 60], [1, 33.3, 77.7, 150]])
def test_fields_of_view_differ_between_worlds(angles, device):
    worlds = []
    for angle in angles:
        model, data = task()
        model.cam_fovy[model.camera("front").id] = angle
        data.qpos[0] = len(worlds) * 0.1
        worlds.append((model, data))
    batch = batch_of(task()[0], device=device)
    qpos, fovy = np.stack([data.qpos for _, data in worlds]), fields(worlds, ["cam_fovy"])
    views = batch.render(qpos, model=fovy)
    assert assert_same(batch, views, worlds, ["front", "wrist"], device) == 8
    again = batch.render(qpos, model=fovy, out=views)
    assert again is views
    assert_same(batch, again, worlds, ["front", "wrist"], device)
    on_device = {"cam_fovy": wp.array(fovy["cam_fovy"], dtype=float, device=device)}
    views = batch.render(qpos, cameras="front", worlds=[2, 1], model=on_device)
    assert_same(batch, views, [worlds[2], worlds[1]], ["front"], device)
    single_row = batch.render(qpos, cameras="front", model={"cam_fovy": fovy["cam_fovy"][1:2]})
    alike = batch.render(qpos, cameras="front", model={"cam_fovy": fovy["cam_fovy"][[1, 1, 1, 1]]})
    assert np.array_equal(single_row.depth.numpy(), alike.depth.numpy())


def test_visibility_of_geoms_differs_between_worlds(device):
    worlds = []
    for hidden in ("case", "palm", "knob", None):
        model, data = task()
        if hidden:
            model.geom(hidden).rgba[3] = 0
        else:
            model.mat_rgba[:, 3] = 0
        worlds.append((model, data))
    batch = batch_of(task()[0], device=device)
    batch.scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="mine", pose=(0.5, -0.4, 0.5, 0, 0, 0, 1))
    before = batch.render(task()[1].qpos, cameras="front")
    qpos, colors = np.stack([data.qpos for _, data in worlds]), fields(worlds, ["geom_rgba", "mat_rgba"])
    views = batch.render(qpos, cameras=["front", "wrist"], model=colors)
    seen = views.by_world().segmentation.numpy()
    for world, name in enumerate(("case", "palm", "knob", "lid")):
        index = batch.scene.index(name)
        assert not (seen[world] == index).any() and (before.segmentation.numpy() == index).any()
    assert (seen[:, 0] == batch.scene.index("mine")).any(axis=(1, 2)).all()
    views = batch.render(qpos, cameras="front", worlds=[3, 0], model=colors)
    assert np.array_equal(views.segmentation.numpy(), seen[[3, 0], 0])
    plain = batch.render(qpos, cameras="front")  # no color of the previous call remains
    assert np.array_equal(plain.segmentation.numpy()[0], before.segmentation.numpy()[0])


def test_models_like_mjx_have_a_world_dimension_where_worlds_differ(device):
    """In MJX's model, fields that worlds share have the shape of the `mujoco.MjModel`."""
    (plain, data), worlds = task(), []
    for name in ("case", "palm"):
        model, _ = task()
        model.geom(name).rgba[3] = 0
        worlds.append((model, data))
    shared = ("geom_dataid", "geom_matid", "mat_rgba", "geom_size", "cam_fovy", "cam_intrinsic", "body_pos")
    given = {name: getattr(plain, name) for name in shared} | fields(worlds, ["geom_rgba"])
    batch = batch_of(plain, device=device)
    qpos = np.stack([data.qpos] * 2)
    views = batch.render(qpos, cameras="front", model=SimpleNamespace(**given))
    expected = batch.render(qpos, cameras="front", model=fields(worlds, ["geom_rgba"]))
    assert np.array_equal(views.segmentation.numpy(), expected.segmentation.numpy())
    assert not np.array_equal(views.segmentation.numpy()[0], views.segmentation.numpy()[1])
    with pytest.raises(wv.WarpvisError, match="geom_size must be of 1 world or of 2, like the poses, got 12"):
        batch.render(qpos, cameras="front", model={"geom_size": plain.geom_size})


@pytest.mark.slow
def test_mujoco_warp_model_provides_fields(device):
    mjwarp = pytest.importorskip("mujoco_warp", reason="the package mujoco_warp is not installed")
    worlds = []
    for k, angle in enumerate((45.0, 75.0, 45.0)):
        model, data = task()
        model.cam_fovy[model.camera("front").id] = angle
        model.geom("palm").rgba[3] = k != 1
        mujoco.mj_forward(model, data)
        worlds.append((model, data))
    plain = task()[0]
    with wp.ScopedDevice(device):
        warp_model, warp_data = mjwarp.put_model(plain), mjwarp.put_data(plain, worlds[0][1], nworld=3)
        rows = fields(worlds, ["cam_fovy", "geom_rgba"])
        warp_model.cam_fovy = wp.array(rows["cam_fovy"], dtype=float)
        warp_model.geom_rgba = wp.array(rows["geom_rgba"], dtype=wp.vec4)
    batch = batch_of(plain, device=device)
    views = batch.render(warp_data, cameras="front", model=warp_model)
    assert assert_same(batch, views, worlds, ["front"], device) == 2  # the first and last worlds are equal


def free(**values):
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation, camera.distance, camera.lookat[:] = 60, -35, 2.0, (0.1, 0.2, 0.3)
    for name, value in values.items():
        setattr(camera, name, value)
    return camera


def test_viewer_cameras(device):
    worlds = []
    for k in range(3):
        model, data = task()
        data.qpos[:3] += 0.1 * k
        worlds.append((model, data))
    hand = worlds[0][0].body("hand").id
    tracking = free(type=mujoco.mjtCamera.mjCAMERA_TRACKING, trackbodyid=hand, distance=0.8)
    fixed = free(type=mujoco.mjtCamera.mjCAMERA_FIXED, fixedcamid=worlds[0][0].camera("front").id)
    batch = batch_of(worlds[0][0], device=device)
    qpos = np.stack([data.qpos for _, data in worlds])
    for cameras in ([free(), "front", tracking, -1, fixed, free(azimuth=200)], [free()], [tracking]):
        views = batch.render(qpos, cameras=cameras if len(cameras) > 1 else cameras[0])
        different = assert_same(batch, views, worlds, cameras, device)
        assert different == 3 * len(cameras) - 3 * (len(cameras) > 1)  # "front" is the camera of `fixed`
    stacked = WorldPoses.of([data for _, data in worlds])
    assert_same(batch, batch.render(stacked, cameras=tracking), worlds, [tracking], device)
    fields = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat")
    without = WorldPoses(**{name: getattr(stacked, name) for name in fields})
    assert_same(batch, batch.render(without, cameras=free()), worlds, [free()], device)
    with pytest.raises(wv.WarpvisError, match="an object with subtree_com"):
        batch.render(without, cameras=tracking)


def test_free_camera_renders_model_without_cameras(device):
    model = mujoco.MjModel.from_xml_string("<mujoco><worldbody><geom type='box' size='1 1 1'/></worldbody></mujoco>")
    batch = batch_of(model, device=device)
    assert np.isfinite(batch.render(mujoco.MjData(model).qpos[None], cameras=-1).depth.numpy()).any()


def test_viewer_kernels_match_reference(device):
    rng = np.random.default_rng(0)
    com, worlds = rng.normal(size=(5, 4, 3)), np.array([3, 0, 0], dtype=np.int32)
    cameras, bodies = np.array([-1, 2, -1], dtype=np.int32), np.array([2, -1, -1], dtype=np.int32)
    poses = rng.normal(size=(3, 7))
    out = wp.full((3, 3), wp.transform(*[np.nan] * 7), dtype=wp.transform, device=device)
    arrays = [(com, wp.vec3), (cameras, wp.int32), (bodies, wp.int32), (poses, wp.transform), (worlds, wp.int32)]
    inputs = [wp.array(values, dtype=dtype, device=device) for values, dtype in arrays]
    wp.launch(kernels.viewer_transforms, dim=(3, 3), inputs=[*inputs, out], device=device)
    expected = reference.viewer_transforms(com, cameras, bodies, poses, worlds)
    np.testing.assert_allclose(out.numpy(), expected, atol=1e-6)

    rgba = rng.choice([0.0, 0.5, 1.0], size=(5, 6, 4)).astype(np.float32)
    rgba[:, ::2] = 0.5, 0.5, 0.5, 1
    matid = rng.integers(-1, 2, size=(1, 6)).astype(np.int32)
    mat_rgba = rng.choice([0.0, 1.0], size=(5, 2, 4)).astype(np.float32)
    geoms = np.array([0, -1, 5, 2, 3], dtype=np.int32)
    hidden = wp.empty((6, 5), dtype=wp.uint8, device=device)
    arrays = [(rgba, wp.vec4), (matid, wp.int32), (mat_rgba, wp.vec4), (worlds, wp.int32), (geoms, wp.int32)]
    inputs = [wp.array(values, dtype=dtype, device=device) for values, dtype in arrays]
    wp.launch(kernels.hidden_objects, dim=(6, 5), inputs=[*inputs, hidden], device=device)
    expected = reference.hidden_objects(rgba, matid, mat_rgba, worlds, geoms, 6)
    assert np.array_equal(hidden.numpy(), expected) and 0 < expected.mean() < 1


def test_scene_option_selects_geoms():
    model, data = task()
    option = mujoco.MjvOption()
    option.geomgroup[:] = 0, 0, 0, 0, 1, 0
    assert [item.name for item in batch_of(model, scene_option=option).scene] == ["spare"]
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_STATIC] = 0
    batch = batch_of(model, scene_option=option)
    assert {item.name for item in batch.scene} == {"palm", "finger", "ring"}
    assert np.isinf(batch.render(data.qpos, cameras="front").depth.numpy()).any()


def test_world_mask_and_single_row_of_positions(device):
    model, data = task()
    batch = batch_of(model, device=device)
    rows = np.stack([data.qpos + 0.1 * k * np.eye(model.nq)[0] for k in range(4)])
    everything = batch.render(rows, cameras="front").depth.numpy()
    mask = np.array([False, True, False, True])
    for poses in (rows, batch.kinematics.from_qpos(rows)):
        assert np.array_equal(batch.render(poses, cameras="front", worlds=mask).depth.numpy(), everything[[1, 3]])
    assert np.array_equal(batch.render(rows[2], cameras="front").depth.numpy(), everything[2:3])
    assert np.array_equal(
        Kinematics(model).from_qpos(rows[2]).geom_xpos, batch.kinematics.from_qpos(rows).geom_xpos[2:3]
    )


def test_by_world_reorders_images(device):
    model, data = task()
    batch = batch_of(model, outputs=("depth", "points", "segmentation"), device=device)
    rows = np.stack([data.qpos + 0.1 * k * np.eye(model.nq)[0] for k in range(3)])
    views = batch.render(rows)
    assert isinstance(views, BatchViews) and (views.cameras, views.worlds) == (2, 3)
    turned = views.by_world()
    assert turned.labels is None and turned.depth.ptr == views.depth.ptr
    for name in ("depth", "points", "segmentation"):
        image = getattr(views, name).numpy()
        expected = np.swapaxes(image.reshape(2, 3, *image.shape[1:]), 0, 1)
        assert np.array_equal(getattr(turned, name).numpy(), expected, equal_nan=name == "points")
    assert turned.depth.shape == (3, 2, HEIGHT, WIDTH)
    plain = wv.render(batch.scene, batch.camera(0), np.eye(4)[None].repeat(6, axis=0), outputs=batch._outputs)
    filled = batch.render(rows, out=plain)
    assert np.array_equal(filled.by_world().depth.numpy(), turned.depth.numpy()) and filled.depth is plain.depth


def test_body_and_semantic_ids_of_pixels(device):
    model, data = task()
    batch = batch_of(model, device=device)
    batch.scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="mine", pose=(0.5, -0.4, 0.5, 0, 0, 0, 1))
    views = batch.render(data.qpos, cameras="front")
    geoms, bodies = batch.geom_ids(views).numpy(), batch.body_ids(views).numpy()
    assert np.array_equal(bodies, np.where(geoms < 0, -1, model.geom_bodyid[geoms])) and len(np.unique(bodies)) > 3
    ids = batch.semantic_ids(views, {"*": 7, "drawer": 3, "palm": 0})
    assert batch.semantic_ids(views, {"floor": 2}, out=ids) is ids
    assert np.array_equal(ids.numpy(), np.where(geoms == model.geom("floor").id, 2, -1))
    classes = batch.semantic_ids(views, {"*": 7, "drawer": 3, "palm": 0}).numpy()
    drawer = np.isin(geoms, [model.geom(name).id for name in ("case", "handle", "knob")])
    assert (classes[drawer] == 3).all() and drawer.any() and (classes[geoms < 0] == -1).all() and (geoms < 0).any()
    assert (classes[geoms == model.geom("palm").id] == 0).all() and (classes == 7).any()


def test_fill_far_replaces_infinite_depth(device):
    model, data = task()
    far = batch_of(model, fill="far", near_plane="clip", device=device)
    depth = far.render(data.qpos, cameras=free(elevation=10)).depth.numpy()
    infinite = batch_of(model, device=device).render(data.qpos, cameras=free(elevation=10)).depth.numpy()
    assert np.array_equal(depth, np.where(np.isinf(infinite), np.float32(far.camera("front").far), infinite))
    assert np.isinf(infinite).any()


MODEL, DATA = task()
QPOS = np.stack([DATA.qpos] * 2)
RGBA = MODEL.geom_rgba[None].repeat(2, axis=0)
BAD = {
    "meshes": ({"geom_dataid": np.zeros((2, MODEL.ngeom))}, "geom_dataid must equal that of the renderer's model"),
    "meshes as lists": ({"geom_dataid": [[7] * MODEL.ngeom]}, "geom_dataid must equal that of the renderer's"),
    "another model's meshes": (
        SimpleNamespace(geom_dataid=MODEL.geom_dataid[None] + 1),
        "geom_dataid must equal that of the renderer",
    ),
    "one mesh": ({"geom_dataid": 2}, "geom_dataid must equal that of the renderer's model"),
    "no rotation": ({"geom_quat": np.zeros((1, MODEL.ngeom, 4))}, "geom_quat must be quaternions, got one of length 0"),
    "unknown": ({"geom_color": RGBA}, "model must have keys among body_pos, .*, got geom_color"),
    "a model": (MODEL, "got an MjModel"),
    "a word": ("model", "model must have attributes among body_pos, .*, got str"),
    "shape": ({"cam_fovy": np.ones((2, 9))}, r"cam_fovy must be numbers of shape \(W, 2\), got float64 of shape"),
    "worlds": ({"cam_fovy": np.ones((3, 2))}, "cam_fovy must be of 1 world or of 2, like the poses, got 3"),
    "colors": ({"geom_rgba": RGBA[:, :3]}, "geom_rgba must have shape"),
    "colors of worlds": ({"geom_rgba": RGBA[[0, 0, 0]]}, "geom_rgba must be of 1 world or of 2"),
    "NaN": ({"body_pos": np.full((2, MODEL.nbody, 3), np.nan)}, "body_pos must be finite"),
    "half a turn": ({"cam_fovy": [[50, 180], [50, 50]]}, "from 0 to 180 degrees, got 180.0 for camera 1 in world 0"),
}


def test_geoms_at_body_origins_follow_geom_pos():
    # The compiler marks such geoms, and MuJoCo gives them the poses of their bodies, ignoring geom_pos.
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><camera name="eye" pos="0 0 3"/><body><freejoint/>
        <geom name="first" type="box" size=".1 .2 .3"/><geom type="box" size=".1 .1 .1" pos=".5 0 0"/>
        <geom type="box" size=".1 .1 .1" pos="-.5 0 0"/></body></worldbody></mujoco>""")
    assert model.geom_sameframe[0] != mujoco.mjtSameFrame.mjSAMEFRAME_NONE
    moved, half = model.geom_pos[None].repeat(2, axis=0), np.sqrt(0.5)
    moved[1] += (0, 0, 0.7)
    turned = np.array([(1.0, 0, 0, 0)] * 3 + [(half, 0, 0, half)] * 3).reshape(2, 3, 4)
    poses = Kinematics(model).from_qpos([model.qpos0] * 2, model={"geom_pos": moved, "geom_quat": 3 * turned})
    assert np.allclose(poses.geom_xpos[1] - poses.geom_xpos[0], (0, 0, 0.7), atol=1e-6)
    assert np.allclose(poses.geom_xmat[1].reshape(3, 3, 3), [(0, -1, 0), (1, 0, 0), (0, 0, 1)], atol=1e-6)
    assert batch_of(model).render([model.qpos0], model={"geom_size": model.geom_size[None]}).worlds == 1


@pytest.mark.parametrize("name", BAD)
def test_invalid_model_fields_are_rejected(name):
    given, match = BAD[name]
    with pytest.raises(wv.WarpvisError, match=match):
        batch_of(MODEL, movable="all").render(QPOS, model=given)


def test_other_invalid_arguments_are_rejected():
    batch = batch_of(MODEL)
    with pytest.raises(wv.WarpvisError, match=r"worlds must be a mask of 2 with a True, got 0 in shape \(2,\)"):
        batch.render(QPOS, worlds=[False, False])
    with pytest.raises(wv.WarpvisError, match=r"worlds must be a mask of 2 with a True, got 3 in shape \(3,\)"):
        batch.render(QPOS, worlds=[True] * 3)
    with pytest.raises(wv.WarpvisError, match="geom_groups must not be given with scene_option"):
        batch_of(MODEL, geom_groups=(1,), scene_option=mujoco.MjvOption())
    with pytest.raises(wv.WarpvisError, match=r"scene_option must be a mujoco\.MjvOption, got str"):
        batch_of(MODEL, scene_option="all")
    views = batch.render(QPOS)
    for classes, match in (
        ({"nobody": 1}, "'nobody' in classes must match a geom"),
        ({"palm": -1}, "from 0 up, got -1"),
    ):
        with pytest.raises(wv.WarpvisError, match=match):
            batch.semantic_ids(views, classes)
    with pytest.raises(wv.WarpvisError, match="'nobody' in movable must match a geom"):
        batch_of(MODEL, movable=["nobody"])


def test_copied_batch_renders_equal_images():
    batch = batch_of(MODEL)
    views = batch.render(QPOS)
    again = copy.deepcopy(batch).render(QPOS)
    assert np.array_equal(again.depth.numpy(), views.depth.numpy())
