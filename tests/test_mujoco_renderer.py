# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`warpvis.mujoco.Renderer` as a replacement of `mujoco.Renderer`, and batches of worlds."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import mujoco
import mujoco.rollout
import numpy as np
import pytest
import trimesh
import warp as wp
from mujoco_models import ROBOTS, robot_model, shapes_model

import warpvis as wv
from warpvis.mujoco import BatchRenderer, Kinematics, Renderer, WorldPoses, camera_poses, geom_poses

from support.mujoco_renderer import assert_same_images, free_camera, geoms_only, images

GEOM, UNKNOWN = int(mujoco.mjtObj.mjOBJ_GEOM), int(mujoco.mjtObj.mjOBJ_UNKNOWN)
BALL = """<mujoco><statistic extent="2"/><visual><map znear=".01" zfar="50"/></visual><worldbody>
  <body name="ball"><freejoint/><geom name="ball" size=".2"/></body>
  <body name="mark" mocap="true" pos="0 .6 0"><geom name="mark" type="box" size=".1 .1 .1"/></body>
  <geom name="wall" type="box" size=".1 4 4" pos="2 0 0"/>
  <camera name="eye" pos="-2 0 0" xyaxes="0 -1 0 0 0 1"/>
  <camera name="tele" pos="-2 0 0" xyaxes="0 -1 0 0 0 1" fovy="20"/>
  <camera name="twin" pos="-1 0 0" xyaxes="0 -1 0 0 0 1"/>
</worldbody></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(BALL)
WALL_PIXEL, BALL_PIXEL = [0, GEOM], [1, GEOM]


def ball_data(x=0.0, y=0.0):
    data = mujoco.MjData(MODEL)
    data.qpos[:2] = x, y
    mujoco.mj_forward(MODEL, data)
    return data


def mujoco_images(model, data, camera, height, width, option):
    with mujoco.Renderer(model, height, width) as renderer:
        return images(renderer, data, camera, option)


def tracking_camera():
    camera = mujoco.MjvCamera()
    camera.type, camera.trackbodyid, camera.distance = mujoco.mjtCamera.mjCAMERA_TRACKING, 1, 1.5
    return camera


def fixed_camera():
    camera = mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 1
    return camera


CAMERAS = {name: name for name in ("front", "side", "below", "lens", "follower", "wrist")}
CAMERAS |= {"id": 0, "default": -1, "free": free_camera(), "tracking": tracking_camera(), "fixed": fixed_camera()}


@pytest.mark.smoke("*-front", "*-side")
@pytest.mark.gl
@pytest.mark.parametrize("camera", CAMERAS)
def test_images_match_mujoco(camera, device):
    model, data = shapes_model()
    with Renderer(model, 150, 200, mesh_tolerance=2e-4, device=device) as renderer:
        ours = images(renderer, data, CAMERAS[camera])
    theirs = mujoco_images(model, data, CAMERAS[camera], 150, 200, None)
    assert_same_images(ours, theirs, 2e-4)
    assert len(np.unique(ours[1][..., 0])) >= 2


@pytest.mark.gl
def test_geom_groups_and_static_flag_match_mujoco():
    model, data = shapes_model()
    model.geom_group[::3] = 4
    renderer = Renderer(model, 120, 160, mesh_tolerance=2e-4)
    for groups, static in (((0, 1, 2), True), ((4,), True), ((0, 4), False), ((0, 1, 2, 3, 4, 5), True), ((), True)):
        option = mujoco.MjvOption()
        option.geomgroup[:] = [group in groups for group in range(6)]
        option.flags[mujoco.mjtVisFlag.mjVIS_STATIC] = static
        ours = images(renderer, data, "front", option)
        assert_same_images(ours, mujoco_images(model, data, "front", 120, 160, option), 2e-4)
    assert images(renderer, data, "front")[1].max() > 0  # the default is restored


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("name", ROBOTS)
def test_real_robots_match_mujoco(name):
    model, data = robot_model(name)
    option, seen = geoms_only(), set()
    renderer = Renderer(model, 180, 240)
    for camera in range(-1, model.ncam):
        ours = images(renderer, data, camera, option)
        assert_same_images(ours, mujoco_images(model, data, camera, 180, 240, option), 1e-3)
        seen |= set(np.unique(ours[1][..., 0]))
    assert len(seen) > 10


def test_moving_bodies_follow_data():
    renderer = Renderer(MODEL, 48, 64)
    renderer.enable_depth_rendering()
    for x in (0.0, 0.5, -1.0):
        renderer.update_scene(ball_data(x), "eye")
        depth = renderer.render()
        assert depth[24, 32] == pytest.approx(2 + x - 0.2, abs=4e-3)
        assert depth[24, 2] == pytest.approx(3.9, abs=1e-5)
    data = ball_data()
    data.mocap_pos[0] = 0.5, 0, 0
    data.qpos[0] = 1.2
    mujoco.mj_forward(MODEL, data)
    renderer.update_scene(data, "eye")
    assert renderer.render()[24, 32] == pytest.approx(2.4, abs=1e-5)


def test_images_keep_state_until_next_update():
    renderer, data = Renderer(MODEL, 48, 64), ball_data()
    renderer.update_scene(data, "eye")
    renderer.enable_depth_rendering()
    first = renderer.render()
    data.qpos[0] = 1.0
    mujoco.mj_forward(MODEL, data)
    assert np.array_equal(renderer.render(), first)
    renderer.update_scene(data, "eye")
    assert not np.array_equal(renderer.render(), first)


def test_images_are_written_to_out():
    renderer = Renderer(MODEL, 48, 64)
    depth, segmentation = images(renderer, ball_data(), "eye")
    renderer.enable_depth_rendering()
    for dtype in (np.float32, np.float64):
        out = np.zeros((48, 64), dtype=dtype)
        assert renderer.render(out=out) is out and np.array_equal(out, depth)
    renderer.enable_segmentation_rendering()
    out = np.zeros((48, 64, 2), dtype=np.int16)
    assert np.array_equal(renderer.render(out=out), segmentation)
    assert set(map(tuple, segmentation.reshape(-1, 2).tolist())) <= {(-1, -1), (0, GEOM), (1, GEOM), (2, GEOM)}
    assert (renderer.height, renderer.width, renderer.model) == (48, 64, MODEL)
    assert {item.name for item in renderer.scene} == {"ball", "mark", "wall"}


def test_near_plane_occlude_reports_near_depth():
    """MuJoCo clips it and shows what is behind: see `test_mujoco_near_plane`."""
    data = ball_data(x=-1.79)  # the ball is 1 cm in front of the camera, nearer than the near plane
    near = MODEL.vis.map.znear * MODEL.stat.extent
    assert near > 0.01
    depth, segmentation = images(Renderer(MODEL, 48, 64, near_plane="occlude"), data, "eye")
    assert depth[24, 32] == pytest.approx(0.01, abs=1e-3)
    assert segmentation[24, 32].tolist() == BALL_PIXEL


def test_camera_inside_geom_sees_through_back_faces():
    data = ball_data(x=-2.0)
    depth, segmentation = images(Renderer(MODEL, 48, 64), data, "eye")
    assert segmentation[24, 32].tolist() == WALL_PIXEL and depth[24, 32] == pytest.approx(3.9, abs=1e-5)
    depth, segmentation = images(Renderer(MODEL, 48, 64, cull_backfaces=False), data, "eye")
    assert segmentation[24, 32].tolist() == BALL_PIXEL and depth[24, 32] == pytest.approx(0.2, abs=2e-3)
    depth, segmentation = images(Renderer(MODEL, 48, 64, exclude=["ball"], cull_backfaces=False), data, "eye")
    assert segmentation[24, 32].tolist() == WALL_PIXEL


@pytest.mark.slow
def test_importing_warpvis_does_not_import_mujoco():
    code = "import sys, warpvis; assert 'mujoco' not in sys.modules; import warpvis.mujoco; sys.modules['mujoco']"
    subprocess.run([sys.executable, "-c", code], check=True)


# Batches.


def worlds_of(count):
    """Return data of `count` worlds, with the ball at a different position in each."""
    rng = np.random.default_rng(4)
    return [ball_data(*rng.uniform((-0.5, -0.8), (1.2, 0.8))) for _ in range(count)]


def expected_views(batch, worlds, cameras):
    """Return images of `warpvis.Renderer`, rendered one camera and one world at a time."""
    views = []
    for camera in cameras:
        renderer = wv.Renderer(
            batch.scene, batch.camera(camera), outputs=("depth", "segmentation"), cull_backfaces=True
        )
        for data in worlds:
            pose = camera_poses(data, MODEL, [camera])[0]
            views.append(renderer.render(pose, object_poses=geom_poses(data, batch.mujoco_scene)))
    return [np.concatenate([getattr(view, name).numpy() for view in views]) for name in ("depth", "segmentation")]


def assert_views(views, expected):
    depth, objects = expected
    assert np.array_equal(views.segmentation.numpy(), objects)
    assert np.array_equal(views.depth.numpy(), depth)


def batch_of(nworld=None, **options):
    return BatchRenderer(MODEL, nworld, height=24, width=32, outputs=("depth", "segmentation"), **options)


@pytest.mark.parametrize("cameras", [None, "tele", ["eye", "twin"], ["twin", 1, 0], [2, 2]])
def test_selected_cameras_in_all_worlds(cameras, device):
    batch, worlds = batch_of(6, device=device), worlds_of(6)
    ids = {None: [0, 1, 2], "tele": [1]}.get(cameras if not isinstance(cameras, list) else "", None)
    ids = ids or [MODEL.camera(camera).id for camera in cameras]
    expected = expected_views(batch, worlds, ids)
    assert len({image.tobytes() for image in expected[0]}) >= 6
    assert_views(batch.render(worlds, cameras=cameras), expected)
    again = batch.render(worlds, cameras=cameras)
    depth = again.depth
    assert batch.render(worlds[::-1], cameras=cameras, out=again) is again
    assert batch.render(worlds, cameras=cameras, out=again).depth is depth
    assert_views(again, expected)


def test_selected_worlds(device):
    batch, worlds = batch_of(8, device=device), worlds_of(8)
    chosen = [5, 2, 2, 7]
    expected = expected_views(batch, [worlds[k] for k in chosen], [0, 1])
    assert_views(batch.render(worlds, cameras=[0, 1], worlds=chosen), expected)
    qpos = np.stack([data.qpos for data in worlds])
    assert_views(batch.render(qpos, cameras=[0, 1], worlds=np.array(chosen)), expected)


def test_pose_sources_are_equivalent(device):
    batch, worlds = batch_of(4, device=device), worlds_of(4)
    expected = expected_views(batch, worlds, [0])
    stacked = WorldPoses.of(worlds)
    fields = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat")
    arrays = {name: np.asarray(getattr(stacked, name), dtype=np.float32) for name in fields}
    matrices = {name: a if a.shape[2] == 3 else a.reshape(4, -1, 3, 3) for name, a in arrays.items()}
    # Arrays like those of MuJoCo Warp's data: on a GPU they stay there.
    dtypes = {"geom_xpos": wp.vec3, "geom_xmat": wp.mat33, "cam_xpos": wp.vec3, "cam_xmat": wp.mat33}
    on_device = {name: wp.array(a, dtype=dtypes[name], device=device) for name, a in matrices.items()}
    qpos = np.stack([data.qpos for data in worlds])
    for poses in (worlds, stacked, WorldPoses(**arrays), SimpleNamespace(**matrices), WorldPoses(**on_device), qpos):
        assert_views(batch.render(poses, cameras="eye"), expected)
    assert_views(batch_of(device=device).render(worlds[2], cameras=0), [image[2:3] for image in expected])


def test_batch_segmentation_matches_renderer(device):
    batch, worlds = batch_of(3, device=device), worlds_of(3)
    views = batch.render(worlds, cameras="eye")
    geoms = batch.geom_ids(views)
    assert batch.geom_ids(views, out=geoms) is geoms
    renderer = Renderer(MODEL, 24, 32, device=device)
    for data, got in zip(worlds, geoms.numpy(), strict=True):
        _, segmentation = images(renderer, data, "eye")
        assert np.array_equal(got, segmentation[..., 0])


def test_added_objects_are_rendered(device):
    """Objects are added before or after the first image, movable or static, and are distinguished from geoms."""
    data, box = ball_data(), trimesh.creation.box((0.1, 0.1, 0.1))
    renderer, batch = Renderer(MODEL, 24, 32, device=device), batch_of(device=device)
    before, _ = images(renderer, data, "eye")
    assert before[12, 16] == pytest.approx(1.8, abs=1e-2)
    batch.render([data, data], cameras="eye")
    for name, x, movable in (("fixed", -0.5, False), ("loose", -0.75, True)):
        for scene in (renderer.scene, batch.scene):
            scene.add(box, name=name, pose=(x, 0, 0, 0, 0, 0, 1), movable=movable)
        depth, segmentation = images(renderer, data, "eye")
        assert depth[12, 16] == pytest.approx(2 + x - 0.05, abs=1e-5)
        assert segmentation[12, 16].tolist() == [-1, UNKNOWN] and [1, GEOM] in segmentation.reshape(-1, 2).tolist()
        views = batch.render([data, data], cameras="eye")
        assert np.array_equal(views.depth.numpy()[1], depth) and np.array_equal(*views.depth.numpy())
        assert np.array_equal(batch.geom_ids(views).numpy()[1], segmentation[..., 0])
    # Poses of geoms still follow MuJoCo.
    moved = ball_data(y=0.5)
    depth, segmentation = images(renderer, moved, "eye")
    views = batch.render([data, moved], cameras="eye")
    assert np.array_equal(views.depth.numpy()[1], depth)
    assert np.array_equal(batch.geom_ids(views).numpy()[1], segmentation[..., 0])


def test_batch_depth_follows_rep_117():
    batch = batch_of(near_plane="occlude")
    views = batch.render(ball_data(x=-1.79), cameras="eye")
    assert views.depth.numpy()[0, 12, 16] == -np.inf
    views = batch.render(ball_data(x=-1.79), cameras="twin")
    assert views.depth.numpy()[0, 12, 16] == pytest.approx(2.9, abs=1e-5)


@pytest.mark.parametrize("threads", [1, 3])
def test_kinematics_match_mujoco(threads):
    model, data = shapes_model()
    rng = np.random.default_rng(5)
    qpos, mocap_pos = rng.normal(size=(7, model.nq)), rng.normal(size=(7, model.nmocap, 3))
    mocap_quat = rng.normal(size=(7, model.nmocap, 4))
    kinematics = Kinematics(model, threads=threads)
    for moved in (True, False):  # the second call must not keep the mocap poses of the first
        mocap = {"mocap_pos": mocap_pos, "mocap_quat": mocap_quat} if moved else {}
        poses = kinematics.from_qpos(qpos, **mocap)
        for world in range(7):
            mujoco.mj_resetData(model, data)
            data.qpos[:] = qpos[world]
            for name, values in mocap.items():
                getattr(data, name)[:] = values[world]
            mujoco.mj_forward(model, data)
            for name in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat"):
                assert np.abs(getattr(poses, name)[world] - getattr(data, name)).max() < 1e-6


def test_rollout_states_are_rendered():
    data = [ball_data(), ball_data()]
    size, spec = mujoco.mj_stateSize(MODEL, mujoco.mjtState.mjSTATE_FULLPHYSICS), mujoco.mjtState.mjSTATE_FULLPHYSICS
    start = np.zeros((3, size))
    for row, x in zip(start, (0.0, 0.5, 1.0), strict=True):
        mujoco.mj_getState(MODEL, ball_data(x), row, spec)
    states, _ = mujoco.rollout.rollout(MODEL, data, start, nstep=5)
    batch = batch_of()
    poses = batch.kinematics.from_states(states)
    assert poses.geom_xpos.shape == (15, MODEL.ngeom, 3)
    assert_views(batch.render(poses), expected_views(batch, list(data_of(states)), [0, 1, 2]))


def data_of(states):
    spec = mujoco.mjtState.mjSTATE_FULLPHYSICS
    for state in states.reshape(-1, states.shape[-1]):
        data = mujoco.MjData(MODEL)
        mujoco.mj_setState(MODEL, data, state, spec)
        mujoco.mj_forward(MODEL, data)
        yield data


def test_mujoco_batch_is_a_source_of_poses():
    module = pytest.importorskip("mujoco.batch", reason="MuJoCo before 4.0 has no mujoco.batch")
    simulations = module.Batch(MODEL, 3)
    simulations.bind("qpos")[:, 0] = 0.0, 0.5, 1.0
    names = ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat")
    for name in names:
        simulations.bind(name)
    simulations.forward()
    views = batch_of(3).render(simulations, cameras="eye")
    assert_views(views, expected_views(batch_of(), [ball_data(0.0), ball_data(0.5), ball_data(1.0)], [0]))


@pytest.mark.slow
def test_mujoco_warp_data_is_a_source_of_poses(device):
    mjwarp = pytest.importorskip("mujoco_warp", reason="the package mujoco_warp is not installed")
    with wp.ScopedDevice(device):
        model, data = mjwarp.put_model(MODEL), mjwarp.put_data(MODEL, ball_data(), nworld=3)
        qpos = np.stack([ball_data(x).qpos for x in (0.0, 0.5, 1.0)])
        wp.copy(data.qpos, wp.array(qpos, dtype=float, device=device))
        mjwarp.kinematics(model, data)
        mjwarp.com_pos(model, data)
        mjwarp.camlight(model, data)
    batch = batch_of(3, device=device)
    assert_views(batch.render(data, cameras="eye"), expected_views(batch, [ball_data(x) for x in (0.0, 0.5, 1.0)], [0]))


def test_threads_may_share_a_batch():
    batch, worlds = batch_of(), worlds_of(8)
    qpos = np.stack([data.qpos for data in worlds])
    expected = expected_views(batch, worlds, [0])[0]
    with ThreadPoolExecutor(4) as pool:
        results = list(pool.map(lambda k: batch.render(qpos[k : k + 1], cameras=0).depth.numpy()[0], [*range(8)] * 4))
    for k, depth in enumerate(results):
        assert np.array_equal(depth, expected[k % 8])


def rendered(mode="depth", **options):
    renderer = Renderer(MODEL, 24, 32)
    renderer.update_scene(ball_data())
    if mode:
        getattr(renderer, f"enable_{mode}_rendering")()
    return renderer.render(**options)


def closed():
    with Renderer(MODEL, 24, 32) as renderer:
        renderer.update_scene(ball_data())
        renderer.enable_depth_rendering()
    return renderer.render()


def with_hulls():
    option = mujoco.MjvOption()
    option.flags[mujoco.mjtVisFlag.mjVIS_CONVEXHULL] = True
    Renderer(MODEL).update_scene(ball_data(), scene_option=option)


def user_camera():
    camera = mujoco.MjvCamera()
    camera.type = mujoco.mjtCamera.mjCAMERA_USER
    return camera


def track(body):
    camera = tracking_camera()
    camera.trackbodyid = body
    return camera


def depth_only():
    return BatchRenderer(MODEL, height=24, width=32)


BAD = {
    "no model": (lambda: Renderer("model.xml"), "model must be a mujoco.MjModel, got str"),
    "no size": (lambda: Renderer(MODEL, 0, 5), "height must be a whole number of pixels from 1 up, got 0"),
    "no update": (lambda: _enabled().render(), r"update_scene\(\) must be called before render\(\)"),
    "closed": (closed, "render cannot be called after close"),
    "bad out": (lambda: rendered(out=np.zeros((24, 33))), r"out must have shape \(24, 32\), got \(24, 33\)"),
    "out no array": (lambda: rendered(out=[1]), r"out must have shape \(24, 32\), got list"),
    "other data": (
        lambda: Renderer(MODEL).update_scene(mujoco.MjData(shapes_model()[0])),
        "data must be a mujoco.MjData of the renderer's model",
    ),
    "no such camera": (lambda: Renderer(MODEL).update_scene(ball_data(), "nose"), "camera 'nose' is not in the model"),
    "camera -2": (
        lambda: Renderer(MODEL).update_scene(ball_data(), -2),
        "camera -2 is not in the model, which has 'eye'",
    ),
    "user camera": (
        lambda: Renderer(MODEL).update_scene(ball_data(), user_camera()),
        "of type FREE, TRACKING or FIXED",
    ),
    "no body": (lambda: Renderer(MODEL).update_scene(ball_data(), track(9)), "trackbodyid must be from 0 to 2, got 9"),
    "hulls": (with_hulls, "must not enable convex hulls"),
    "nworld 0": (lambda: BatchRenderer(MODEL, 0), "nworld must be a whole number from 1 up, got 0"),
    "other nworld": (
        lambda: batch_of(3).render(worlds_of(2)),
        "poses must be of nworld worlds",
    ),
    "no cameras": (lambda: batch_of().render(worlds_of(1), cameras=[]), "cameras must contain at least one camera"),
    "unknown camera": (lambda: batch_of().render(worlds_of(1), cameras=[0, 7]), "camera 7 is not in the model"),
    "world 2": (lambda: batch_of().render(worlds_of(2), worlds=[0, 2]), "worlds must be from 0 to 1, got 2 at index 1"),
    "worlds by name": (lambda: batch_of().render(worlds_of(2), worlds=["a"]), "worlds must be an array of numbers"),
    "no worlds": (lambda: batch_of().render(worlds_of(2), worlds=[]), "worlds must be one or more indices"),
    "qpos": (lambda: batch_of().render(np.zeros((2, 6))), r"qpos must have shape \(W, 7\), got \(2, 6\)"),
    "NaN qpos": (
        lambda: batch_of().render(np.full((2, 7), np.nan)),
        "qpos must be finite, got others in 2 of 2 worlds",
    ),
    "poses by name": (lambda: batch_of().render("poses"), "poses must be an array of numbers"),
    "no such state": (lambda: Kinematics(MODEL).from_states(np.zeros((2, 3))), r"states must have shape \(W, \d+\)"),
    "unequal mocap": (
        lambda: Kinematics(MODEL).from_qpos(np.zeros((2, 7)), mocap_pos=np.zeros((1, 1, 3))),
        "mocap_pos must be of 2 worlds like qpos, got 1",
    ),
    "other views": (
        lambda: batch_of().render(worlds_of(2), out=batch_of().render(worlds_of(1))),
        r"out.depth must have shape \(6, 24, 32\), got \(3, 24, 32\)",
    ),
    "out no views": (lambda: batch_of().render(worlds_of(2), out=3), "out must be warpvis.Views, got int"),
    "no objects": (lambda: depth_only().geom_ids(depth_only().render(worlds_of(1))), "views must have segmentation"),
    "no geometry": (lambda: batch_of(geom_groups=(5,)), r"the model has no geoms to render in groups \(5,\)"),
}


def _enabled():
    renderer = Renderer(MODEL, 24, 32)
    renderer.enable_depth_rendering()
    return renderer


@pytest.mark.parametrize("name", BAD)
def test_invalid_arguments_are_rejected(name):
    call, message = BAD[name]
    with pytest.raises(wv.WarpvisError, match=message):
        call()
