# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of rangefinder sensors against MuJoCo's `sensordata` and the float64 reference."""

import copy
import pickle

import mujoco
import numpy as np
import pytest
import warp as wp
from mujoco_models import SHAPES

import warpvis as wv
from warpvis.mujoco import Kinematics, Rangefinders, WorldPoses

import reference

# Single precision of poses at distances of a few meters [m].
TOLERANCE = 1e-5
FIELDS = ("dist", "dist dir", "origin point normal depth", "dist dir origin point normal depth", "normal", "depth")
WITHOUT_FIELD = SHAPES.replace('type="sdf" mesh="wedge"', 'type="mesh" mesh="wedge"')


def probed(sensors, *, seed=0, count=48):
    """Return a model with all types of geoms, `count` sites on a mocap body, and the given sensors."""
    rng, sites = np.random.default_rng(seed), []
    for index in range(count):
        numbers = [*rng.uniform((-1, -1, -0.05), (1, 1, 0.8)), *rng.normal(size=3)]
        sites.append('<site name="s{}" pos="{} {} {}" zaxis="{} {} {}"/>'.format(index, *numbers))
    probe = f'<body name="probe" mocap="true">{"".join(sites)}<geom type="sphere" size=".3"/></body>'
    text = WITHOUT_FIELD.replace('resolution="200 120"', 'resolution="40 24"')
    text = text.replace('<camera name="flat"', '<camera name="flat" resolution="9 7"')
    text = text.replace('<camera name="side"', '<camera name="side" resolution="16 12"')
    text = text.replace("</worldbody>", f"{probe}</worldbody><sensor>{sensors}</sensor>")
    model = mujoco.MjModel.from_xml_string(text)
    model.hfield_data[:] = rng.random(len(model.hfield_data))
    return model


def moved(model, count, seed=1):
    """Return data of `count` worlds with randomly displaced bodies."""
    rng, worlds = np.random.default_rng(seed), []
    for _ in range(count):
        data = mujoco.MjData(model)
        data.qpos[:] = model.qpos0 + rng.normal(scale=0.1, size=model.nq)
        data.mocap_pos[-1], quaternion = rng.uniform(-0.3, 0.3, 3), rng.normal(size=4)
        data.mocap_quat[-1] = quaternion / np.linalg.norm(quaternion)
        mujoco.mj_forward(model, data)
        worlds.append(data)
    return worlds


def assert_equal(found, worlds, sensors):
    expected = np.stack([data.sensordata[sensors.addresses] for data in worlds])
    assert found.shape == expected.shape
    assert (np.abs(found - expected) <= TOLERANCE * np.maximum(1, np.abs(expected))).all()
    return expected


def test_sites_match_mujoco_sensordata(device):
    """All fields, types of geoms and cutoffs, from inside and outside of shapes."""
    options = ['cutoff=".7"', "", "", ""]
    sensors = "".join(
        f'<rangefinder site="s{index}" data="{FIELDS[index % 6]}" {options[index % 4]}/>' for index in range(48)
    )
    model = probed(sensors)
    worlds = moved(model, 40)
    finders = Rangefinders(model, device=device)
    expected = assert_equal(finders.read(worlds).numpy(), worlds, finders)
    distances = expected[:, np.isin(finders.sensors, np.arange(0, 48, 6))]
    assert (distances == -1).any() and (distances == 0.7).any() and (distances > 1).any() and (distances < 0.05).any()


def test_normals_and_distances_match_reference(device):
    model = probed("".join(f'<rangefinder site="s{index}" data="dist normal"/>' for index in range(48)))
    (data,) = moved(model, 1)
    found = Rangefinders(model, device=device).read(data).numpy().reshape(48, 4)
    axes = data.site_xmat.reshape(-1, 3, 3)[:, :, 2]
    for site in range(48):
        body = int(model.site_bodyid[site])
        distance, normal = reference.read_rangefinders(model, data, data.site_xpos[site], axes[site], body)
        assert np.abs(found[site] - [distance, *normal]).max() < TOLERANCE * max(1, distance)


@pytest.mark.parametrize(("camera", "fields"), [("lens", "dist normal depth"), ("flat", FIELDS[3])])
def test_cameras_match_mujoco_sensordata(camera, fields, device):
    model = probed(f'<rangefinder camera="{camera}" data="{fields}"/>')
    worlds = moved(model, 4)
    finders = Rangefinders(model, device=device)
    assert set(finders.sensors.tolist()) == {0}
    assert_equal(finders.read(worlds).numpy(), worlds, finders)


def test_cameras_with_fovy_match_mj_ray(device):
    """`mj_multiRay` misses some geoms that `mj_ray` hits; expect the hits."""
    model = probed('<rangefinder camera="side"/>')
    (data,) = moved(model, 1)
    found = Rangefinders(model, device=device).read(data).numpy()
    camera = model.camera("side").id
    height = np.tan(np.radians(model.cam_fovy[camera]) / 2)
    x, y = np.meshgrid((np.arange(16) - 7.5) / 6 * height, (5.5 - np.arange(12)) / 6 * height)
    rays = np.stack([x, y, -np.ones_like(x)], axis=-1).reshape(-1, 3)
    rays = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ data.cam_xmat[camera].reshape(3, 3).T
    for distance, ray in zip(found, rays, strict=True):
        expected = mujoco.mj_ray(model, data, data.cam_xpos[camera], ray, None, 1, 0, None)
        assert abs(distance - expected) <= TOLERANCE * max(1, expected)
    written = data.sensordata != -1
    assert np.abs(found - data.sensordata)[written].max() < TOLERANCE * 3 and written.sum() > 10


def test_pose_sources_give_equal_readings(device):
    model = probed("".join(f'<rangefinder site="s{index}"/>' for index in range(48)))
    worlds = [mujoco.MjData(model) for _ in range(5)]
    for index, data in enumerate(worlds):
        data.qpos[2] += 0.05 * index
        mujoco.mj_forward(model, data)
    qpos = np.stack([data.qpos for data in worlds])
    finders = Rangefinders(model, device=device, threads=2)
    expected = finders.read(worlds).numpy()
    assert expected.shape == (5, 48) and expected.dtype == np.float32
    poses = WorldPoses.of(worlds)
    out = wp.empty((5, 48), dtype=wp.float32, device=device)
    assert finders.read(poses, out=out) is out
    assert finders.read(worlds[2]).shape == finders.read(qpos[2]).shape == (48,)
    for found in (out, finders.read(qpos), finders.read(Kinematics(model).from_qpos(qpos))):
        assert np.array_equal(found.numpy(), expected)
    assert np.array_equal(finders.read(worlds[2]).numpy(), expected[2])
    assert np.array_equal(finders.read(qpos[2]).numpy(), expected[2])
    for again in (pickle.loads(pickle.dumps(finders)), copy.deepcopy(finders)):
        assert np.array_equal(again.read(worlds).numpy(), expected)


@pytest.mark.parametrize("geoms", [1, 15, 16, 17, 40])
def test_packed_launches_equal_one_thread_per_ray(geoms):
    """CPU cores test bounding spheres of 16 geoms at a time; both kernels write the same bits, for any threads."""
    rng = np.random.default_rng(geoms)
    parts = [
        '<geom type="{}" size=".2 .1 .15" pos="{} {} {}"/>'.format(kind, *rng.uniform(-1, 1, 3))
        for kind in rng.choice(["sphere", "capsule", "box", "ellipsoid", "cylinder"], geoms)
    ]
    sites = "".join('<site name="s{}" zaxis="{} {} {}"/>'.format(index, *rng.normal(size=3)) for index in range(300))
    sensors = "".join(f'<rangefinder site="s{index}" data="dist normal"/>' for index in range(300))
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody>{"".join(parts)}<body><freejoint/><geom size=".1"/>{sites}</body></worldbody>'
        f"<sensor>{sensors}</sensor></mujoco>"
    )
    worlds = [mujoco.MjData(model) for _ in range(6)]
    for data in worlds:
        data.qpos[:3] = rng.uniform(-0.5, 0.5, 3) + (1000 * (data is worlds[-1]), 0, 0)
        mujoco.mj_forward(model, data)
    expected = wp.empty((6, 1200), dtype=wp.float32, device="cpu")
    for threads in (1, 3):
        finders = Rangefinders(model, threads=threads)
        finders._launch(finders._read_frames(WorldPoses.of(worlds)), expected)
        assert np.array_equal(finders.read(worlds).numpy(), expected.numpy())
        for data, row in zip(worlds, expected.numpy(), strict=True):
            assert np.array_equal(finders.read(data).numpy(), row)
    assert (expected.numpy()[:, ::4] > 0).any()


def test_poses_of_one_world_have_all_forms():
    """Double precision, 3 x 3 matrices, and contiguous or not; wrong shapes and poses raise in each."""
    model = probed("".join(f'<rangefinder site="s{index}"/>' for index in range(48)))
    (data,) = moved(model, 1)
    finders = Rangefinders(model)
    expected = finders.read(data).numpy()
    names = ("geom_xpos", "geom_xmat", "site_xpos", "site_xmat")

    def poses(change):
        return WorldPoses(**{name: change(getattr(data, name)[None].copy()) for name in names})

    changes = (
        lambda value: value,
        lambda value: value.astype(np.float32),
        lambda value: value if value.shape[2] == 3 else value.reshape(1, -1, 3, 3),
        np.asfortranarray,
        lambda value: wp.array(
            value.reshape(-1), dtype=wp.vec3 if value.shape[2] == 3 else wp.mat33, shape=value.shape[:2], device="cpu"
        ),
    )
    for change in changes:
        found = finders.read(poses(change))
        assert found.shape == (1, 48) and np.array_equal(found.numpy()[0], expected)
    with pytest.raises(wv.WarpvisError, match="out must have shape"):
        finders.read(data, out=wp.empty(47, dtype=wp.float32, device="cpu"))
    with pytest.raises(wv.WarpvisError, match="geom_xpos must have shape"):
        finders.read(poses(lambda value: value[:, :-1]))
    with pytest.raises(wv.WarpvisError, match=r"must be float32"):
        finders.read(poses(lambda value: value > 0))
    with pytest.raises(wv.WarpvisError, match="poses must be computed, got geom_xmat of zeros"):
        finders.read(mujoco.MjData(model))
    data.site_xpos[3, 1] = np.nan
    with pytest.raises(wv.WarpvisError, match=r"site_xpos must be finite, got .* at index 3"):
        finders.read(data)
    assert np.array_equal(finders.read(poses(np.nan_to_num)).numpy()[0][4:], expected[4:])


@pytest.mark.slow
def test_mujoco_warp_data_is_read(device):
    mujoco_warp = pytest.importorskip("mujoco_warp")
    text = """<mujoco><worldbody><geom type="plane" size="5 5 1"/><body pos="0 0 1"><freejoint/>
      <geom type="capsule" size=".1 .2"/><site name="down" zaxis=".2 .1 -1"/><site name="up"/></body></worldbody>
      <sensor><rangefinder site="down"/><rangefinder site="up"/></sensor></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with wp.ScopedDevice(device):
        many = mujoco_warp.put_data(model, data, nworld=3)
    found = Rangefinders(model, device=device).read(many).numpy()
    assert found.shape == (3, 2) and found[0, 1] == -1
    np.testing.assert_allclose(found, np.tile(data.sensordata, (3, 1)), atol=1e-6)


def test_only_geoms_of_own_body_are_ignored(device):
    """Geoms of welded child bodies are hit; geoms that `mj_ray` treats as invisible are not."""
    text = """<mujoco><asset><material name="none" rgba="1 1 1 0"/></asset><worldbody>
      <body name="own"><site name="eye"/><geom type="sphere" size=".1"/>
        <body pos="0 0 1"><geom type="box" size=".1 .1 .1" {}/></body></body>
      <geom type="plane" size="0 0 1" pos="0 0 2" quat="0 1 0 0" group="5"/>
      <geom type="box" size="1 1 .1" pos="0 0 5"/>
    </worldbody><sensor><rangefinder site="eye"/></sensor></mujoco>"""
    found = []
    for look in ("", 'rgba="1 1 1 0"', 'material="none"', 'material="none" rgba="1 0 0 1"', 'group="4"'):
        model = mujoco.MjModel.from_xml_string(text.format(look))
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        found.append(Rangefinders(model, device=device).read(data).numpy())
        assert found[-1] == pytest.approx(data.sensordata, abs=1e-6)
    assert np.ravel(found) == pytest.approx([0.9, 2, 2, 2, 0.9])


def test_meshes_and_height_fields_are_hit_from_inside(device):
    text = """<mujoco><asset><hfield name="hills" nrow="3" ncol="3" size="2 2 1 .5"/>
      <mesh name="block" vertex="-1 -1 -1 1 -1 -1 1 1 -1 -1 1 -1 -1 -1 1 1 -1 1 1 1 1 -1 1 1"/></asset><worldbody>
      <geom type="hfield" hfield="hills"/><geom type="mesh" mesh="block" pos="9 0 0"/>
      <body>{}</body></worldbody><sensor>{}</sensor></mujoco>"""
    rays = {
        ".3 .2 .1": (".1 .2 -1", ".1 .2 1", "1 .2 .01", "-1 .3 -.05"),
        ".3 .2 -.1": (".1 .2 1", "1 .2 .01"),
        "9 .1 .2": ("1 .2 .3",),
    }
    places = [(place, axis) for place, axes in rays.items() for axis in axes]
    sites = [f'<site name="{i}" pos="{place}" zaxis="{axis}"/>' for i, (place, axis) in enumerate(places)]
    sensors = [f'<rangefinder site="{index}" data="dist normal"/>' for index in range(len(sites))]
    model = mujoco.MjModel.from_xml_string(text.format("".join(sites), "".join(sensors)))
    model.hfield_data[:] = 0.6
    model.hfield_data[4] = 1
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = Rangefinders(model, device=device).read(data).numpy()
    assert found == pytest.approx(data.sensordata, abs=1e-5)
    assert found[::4].min() > 0.05


EDITS = {
    "sizes": lambda model: model.geom_size.__imul__(1.6),
    "smaller sizes": lambda model: model.geom_size.__imul__(0.7),
    "opacity": lambda model: model.geom_rgba[::2, 3].fill(0),
    "opacity of materials": lambda model: model.mat_rgba[:, 3].fill(1),
    "materials": lambda model: model.geom_matid[:5].fill(0),
    "types": lambda model: np.putmask(
        model.geom_type, model.geom_type == mujoco.mjtGeom.mjGEOM_CAPSULE, mujoco.mjtGeom.mjGEOM_CYLINDER
    ),
    "vertices": lambda model: model.mesh_vert.__imul__(0.8),
    "heights": lambda model: np.copyto(model.hfield_data, 1 - model.hfield_data),
    "sizes of fields": lambda model: model.hfield_size.__imul__(0.8),
    "cutoffs": lambda model: model.sensor_cutoff.fill(0.5),
    "where bodies are": lambda model: model.body_pos.__iadd__(0.05),
}


@pytest.mark.parametrize("name", EDITS)
def test_model_edits_are_followed(name, device):
    model = probed("".join(f'<rangefinder site="s{index}" data="dist normal"/>' for index in range(48)))
    finders = Rangefinders(model, device=device)
    before = finders.read(moved(model, 10)).numpy()
    EDITS[name](model)
    worlds = moved(model, 10)
    found = finders.read(worlds).numpy()
    assert_equal(found, worlds, finders)
    assert (np.abs(found - before) > 0.01).any()
    again = pickle.loads(pickle.dumps(finders))
    assert np.array_equal(again.read(worlds).numpy(), found)


def test_fovy_edits_are_followed(device):
    model = probed('<rangefinder camera="side"/>')
    finders = Rangefinders(model, device=device)
    (data,) = moved(model, 1)
    before = finders.read(data).numpy()
    model.cam_fovy[model.camera("side").id] /= 2
    found = finders.read(data).numpy()
    assert not np.array_equal(found, before)
    assert np.array_equal(found, Rangefinders(model, device=device).read(data).numpy())


def test_unsupported_models_and_shapes_raise():
    with pytest.raises(wv.WarpvisError, match=r"model must be a mujoco.MjModel, got str"):
        Rangefinders("robot.xml")
    model = mujoco.MjModel.from_xml_string("<mujoco/>")
    with pytest.raises(wv.WarpvisError, match="must have rangefinder sensors, got none among 0 sensors"):
        Rangefinders(model)
    text = SHAPES.replace("</mujoco>", '<sensor><rangefinder camera="wrist"/></sensor></mujoco>')
    text = text.replace('<camera name="wrist"', '<camera name="wrist" resolution="4 4"')
    with pytest.raises(wv.WarpvisError, match=r"geoms must not be signed distance fields, .* got 'field'"):
        Rangefinders(mujoco.MjModel.from_xml_string(text))
    finders = Rangefinders(probed('<rangefinder site="s0"/>'))
    with pytest.raises(wv.WarpvisError, match=r"qpos must have shape \(W, 30\)"):
        finders.read(np.zeros((2, 3)))
    with pytest.raises(wv.WarpvisError, match=r"an object with site_xpos"):
        finders.read(WorldPoses(np.zeros((1, finders.model.ngeom, 3)), np.ones((1, finders.model.ngeom, 9))))
