# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""MuJoCo's elements other than geoms: sites, tendons, skins, flexes, and those enabled by options."""

import copy
import pickle
import warnings

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.mujoco import BatchRenderer, Renderer, WorldPoses, geom_poses, scene_from_mujoco
from warpvis.mujoco._visuals import Visuals

from support.mujoco_renderer import assert_same_images, images
from support.recorded_warnings import recorded_warnings

HEIGHT, WIDTH = 120, 160
OBJ, FLAG = mujoco.mjtObj, mujoco.mjtVisFlag
SITE, TENDON, SKIN, FLEX = (int(getattr(OBJ, f"mjOBJ_{name}")) for name in ("SITE", "TENDON", "SKIN", "FLEX"))

HEAD = """<mujoco><statistic extent="2" center="0 0 .3" meansize=".2"/><visual><map znear=".005" zfar="20"/>
  <quality numslices="40" numstacks="20" offsamples="0"/></visual>"""
EYE = '<camera name="front" pos="0 -2.4 1.2" xyaxes="1 0 0 0 .4 .9" fovy="50"/>'

SITES = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <geom name="table" type="box" size=".2 .2 .1" pos=".9 .3 .1"/>
  <site name="box" type="box" size=".1 .2 .1" pos="-.8 0 .2" euler="10 20 30"/>
  <site name="on_table" type="box" size=".1 .1 .05" pos=".9 .3 .151"/>
  <site type="cylinder" size=".1 .2" pos="-.4 .4 .2" group="2"/>
  <site name="unshown" type="sphere" size=".3" pos="0 .8 .3" group="3"/>
  <site name="clear" type="sphere" size=".4" pos="0 0 .5" rgba="1 1 1 0"/>
  <body name="palm" pos=".3 0 .4"><freejoint/><geom name="palm" type="box" size=".1 .1 .1"/>
    <site name="palm" type="box" size=".1 .1 .1"/>
    <site type="ellipsoid" size=".1 .05 .2" pos="0 0 .35"/><site type="capsule" size=".05 .1" pos=".3 0 0"/>
    <site type="sphere" size=".1" pos="0 -.3 0" rgba="1 0 0 .2"/></body>{EYE}</worldbody></mujoco>"""

TENDONS = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <body pos="-.6 0 .9"><geom type="cylinder" name="wheel" size=".1 .1" euler="90 0 0"/><site name="over" pos="0 0 .3"/>
  </body>
  <geom name="ball" size=".12" pos=".1 0 .8"/><site name="above" pos=".1 0 1.2"/>
  <site name="a" pos="-.9 0 .3"/><site name="b" pos="-.2 0 .2"/><site name="c" pos=".4 0 .2"/>
  <site name="d" pos=".6 0 .9"/>
  <site name="e" pos="1 .1 .9"/><site name="f" pos=".5 0 .1"/><site name="g" pos=".8 0 .1"/>
  <body pos="-.3 0 .5"><joint name="lift" type="slide" axis="0 0 1"/><geom size=".04"/><site name="load"/></body>
  <body pos=".9 .1 .5"><joint type="slide" axis="0 0 1" range="-1 1"/><geom size=".04"/><site name="end"/></body>
  <body pos="0 -.5 .2"><joint type="slide" axis="1 0 0"/><geom size=".05"/>
    <site name="slider" zaxis="1 0 0" size=".01"/></body>
  <body pos=".3 -.5 .2"><joint type="hinge" axis="0 1 0"/><geom size=".05"/><site name="crank" pos="0 0 .15"/></body>
  {EYE}</worldbody>
  <tendon><spatial name="belt" width=".02">
      <site site="a"/><geom geom="wheel" sidesite="over"/><site site="load"/>
      <pulley divisor="2"/><site site="load"/><geom geom="ball" sidesite="above"/><site site="c"/></spatial>
    <spatial name="string" width=".015" limited="true" range="0 .9" rgba="1 0 0 0"><site site="d"/><site site="end"/>
    </spatial>
    <spatial name="unshown" width=".05" group="4"><site site="f"/><site site="g"/></spatial>
    <fixed name="none"><joint joint="lift" coef="1"/></fixed></tendon>
  <actuator><general name="engine" cranksite="crank" slidersite="slider" cranklength=".4"/></actuator></mujoco>"""

SKINS = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <body name="upper" pos="-.4 0 .5"><joint type="ball"/><geom size=".05" group="4"/>
    <body name="lower" pos=".5 0 0"><joint type="hinge" axis="0 1 0"/><geom size=".05" group="4"/></body></body>
  {EYE}</worldbody>
  <deformable><skin name="sleeve" inflate=".01" rgba="1 0 0 .3"
     vertex="-.5 -.1 .4  -.5 .1 .4  -.5 0 .6  .1 -.1 .4  .1 .1 .4  .1 0 .6  .5 -.1 .4  .5 .1 .4  .5 0 .6"
     face="0 2 1  0 1 4 0 4 3 1 2 5 1 5 4 2 0 3 2 3 5  3 4 7 3 7 6 4 5 8 4 8 7 5 3 6 5 6 8  6 7 8">
     <bone body="upper" bindpos="-.4 0 .5" bindquat="1 0 0 0" vertid="0 1 2 3 4 5" vertweight="1 1 1 .5 .5 .5"/>
     <bone body="lower" bindpos=".1 0 .5" bindquat="1 0 0 0" vertid="3 4 5 6 7 8" vertweight=".5 .5 .5 1 1 1"/>
  </skin></deformable></mujoco>"""

FLEXES = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1"/>
  <flexcomp name="rope" type="grid" dim="1" count="8 1 1" spacing=".1 .1 .1" pos="-.7 0 .7" radius=".02" mass="1">
    <edge equality="true"/></flexcomp>
  <flexcomp name="cloth" type="grid" dim="2" count="5 5 1" spacing=".12 .12 .1" pos="0 0 .5" radius=".02" mass="1">
    <edge equality="true"/></flexcomp>
  <flexcomp name="jelly" type="grid" dim="3" count="4 3 3" spacing=".1 .1 .1" pos=".8 0 .4" radius=".01" mass="1">
    <edge equality="true"/></flexcomp>{EYE}</worldbody></mujoco>"""

MODELS = {"sites": SITES, "tendons": TENDONS, "skins": SKINS, "flexes": FLEXES}


def model_of(name):
    model = mujoco.MjModel.from_xml_string(MODELS[name])
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


def stir(model, data):
    """Change the state so that tendons, skins and flexes change shape."""
    data.qvel[:] = np.random.default_rng(3).normal(scale=0.5, size=model.nv)
    for _ in range(40):
        mujoco.mj_step(model, data)


def option_with(flags=None, **fields):
    option = mujoco.MjvOption()
    for name, value in (flags or {}).items():
        option.flags[int(getattr(FLAG, f"mjVIS_{name}"))] = value
    for name, value in fields.items():
        if name == "frame":
            option.frame = value
        else:
            getattr(option, name)[:] = [group in value for group in range(6)]
    return option


def pixels(segmentation):
    pairs, counts = np.unique(segmentation.reshape(-1, 2), axis=0, return_counts=True)
    return dict(zip(map(tuple, pairs.tolist()), counts.tolist(), strict=True))


def assert_drawn(ours, theirs, share=0.8):
    """Check that elements in MuJoCo's image are in ours at the same pixels."""
    assert_same_images(ours, theirs, 1e-3)
    (_, segmentation), (_, expected) = ours, theirs
    for pair, count in pixels(expected).items():
        one, other = ((image == pair).all(axis=-1) for image in (segmentation, expected))
        assert count <= 12 or (one & other).sum() >= share * (one | other).sum(), pair


def assert_all_drawn(model, data, options, renderer=None, share=0.8):
    """Compare images for all options in turn, and return pixel counts of MuJoCo's last image."""
    renderer = Renderer(model, HEIGHT, WIDTH) if renderer is None else renderer
    with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs, warnings.catch_warnings():
        warnings.simplefilter("error")
        for option in options:
            expected = images(theirs, data, "front", option)
            assert_drawn(images(renderer, data, "front", option), expected, share)
    return pixels(expected[1])


# Comparison with MuJoCo.


@pytest.mark.gl
def test_sites_match_mujoco():
    model, data = model_of("sites")
    groups = [option_with(sitegroup=chosen) for chosen in ((), (3,), (0, 1, 2, 3))]
    fixed = [option_with({"STATIC": 0}), None]
    seen = assert_all_drawn(model, data, [*groups, *fixed])
    shown = [site for site in range(model.nsite) if model.site(site).name not in ("unshown", "clear")]
    assert {(site, SITE) for site in shown} <= set(seen)


@pytest.mark.gl
def test_sites_follow_the_model():
    model, data = model_of("sites")
    renderer = Renderer(model, HEIGHT, WIDTH)
    assert_all_drawn(model, data, [None], renderer)
    data.qpos[:3] += 0.1, 0.2, 0.1
    model.site("box").pos[:] += 0.3, 0, 0.1
    model.site("palm").size[:] *= 1.2
    model.site("clear").rgba[3] = 1
    model.site("unshown").group[:] = 1
    model.site("on_table").rgba[3] = 0
    mujoco.mj_forward(model, data)
    assert_all_drawn(model, data, [None], renderer)
    data.site_xpos[model.site("box").id, 2] += 0.2  # data changed directly
    assert_all_drawn(model, data, [None], renderer)


@pytest.mark.gl
def test_tendons_match_mujoco():
    model, data = model_of("tendons")
    renderer = Renderer(model, HEIGHT, WIDTH)
    for _ in range(2):
        for site in range(model.nsite):
            model.site(site).rgba[3] = 0
        options = [option_with({"TENDON": 0}), option_with(tendongroup=(4,)), None]
        seen = assert_all_drawn(model, data, options, renderer, share=0.7)
        crank = (model.actuator("engine").id, int(OBJ.mjOBJ_ACTUATOR))
        assert {(model.tendon(name).id, TENDON) for name in ("belt", "string")} | {crank} <= set(seen)
        stir(model, data)


@pytest.mark.gl
def test_skins_match_mujoco():
    model, data = model_of("skins")
    renderer, (skin,) = Renderer(model, HEIGHT, WIDTH), [(0, SKIN)]
    for _ in range(2):
        options = [option_with({"SKIN": 0}), option_with(skingroup=(3,)), None]
        assert assert_all_drawn(model, data, options, renderer)[skin] > 500
        stir(model, data)
    model.skin_rgba[0, 3] = 0
    assert skin not in assert_all_drawn(model, data, [None], renderer)


FLEX_FLAGS = {
    "default": {},
    "nothing": {"FLEXSKIN": 0, "FLEXEDGE": 0},
    "edges": {"FLEXSKIN": 0},
    "faces": {"FLEXSKIN": 0, "FLEXFACE": 1},
    "vertices": {"FLEXSKIN": 0, "FLEXVERT": 1, "FLEXEDGE": 0},
}


@pytest.mark.slow
@pytest.mark.gl
def test_flexes_match_mujoco():
    model, data = model_of("flexes")
    renderer = Renderer(model, HEIGHT, WIDTH)
    options = [option_with(flags) for flags in FLEX_FLAGS.values()] + [option_with(flexgroup=(5,)), None]
    inner = option_with(FLEX_FLAGS["faces"])
    inner.flex_layer = 1
    options.insert(4, inner)
    for _ in range(2):
        seen = assert_all_drawn(model, data, options, renderer, share=0.75)
        assert all((flex, FLEX) in seen for flex in range(3))
        stir(model, data)


@pytest.mark.gl
def test_optional_elements_match_mujoco():
    """Elements that MuJoCo draws only with options."""
    model, data = model_of("tendons")
    data.qpos[model.joint("lift").qposadr] = -0.5  # in contact with the floor
    mujoco.mj_forward(model, data)
    assert data.ncon
    solid = option_with({"JOINT": 1, "ACTUATOR": 1, "COM": 1, "CONTACTPOINT": 1, "CONTACTFORCE": 1, "LIGHT": 1})
    lines = option_with({"BODYBVH": 1}, frame=mujoco.mjtFrame.mjFRAME_WORLD)
    kinds = {kind for _, kind in assert_all_drawn(model, data, [lines, solid], share=0.6)}
    assert {int(getattr(OBJ, f"mjOBJ_{name}")) for name in ("JOINT", "ACTUATOR", "UNKNOWN")} <= kinds
    model, data = model_of("skins")
    inertia = option_with({"INERTIA": 1, "SKIN": 0}, frame=mujoco.mjtFrame.mjFRAME_BODY)
    assert len(assert_all_drawn(model, data, [inertia])) > 4


RAYS = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.5"/>
  <body mocap="true"><site name="down" pos="-.5 0 .8" zaxis="-.2 .1 -1"/>
  <site name="slant" pos=".9 .5 .8" zaxis="-1 -.2 -.6"/>
  <site name="behind" pos=".3 -3 1.6" zaxis="-.1 1 -.4"/></body><body pos="0 0 .2"><geom size=".2"/></body>
  {{eye}}</worldbody><sensor>
  <rangefinder site="down"/><rangefinder site="slant"/><rangefinder site="behind"/></sensor></mujoco>"""


@pytest.mark.smoke("perspective")
@pytest.mark.gl
@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_rangefinder_lines_match_mujoco(projection):
    """Lines of rangefinders are drawn by default and are some pixels wide at any distance."""
    wide = "fovy='2'" if projection == "orthographic" else "fovy='50'"
    eye = EYE.replace('fovy="50"', f"{wide} projection='{projection}'")
    model = mujoco.MjModel.from_xml_string(RAYS.format(eye=eye))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert (data.sensordata > 0).all()
    seen = assert_all_drawn(model, data, [option_with({"RANGEFINDER": 0}), None], share=0.75)
    assert sum(kind == OBJ.mjOBJ_SENSOR for _, kind in seen) >= 2


# Cost, and interaction with the rest of the scene.


def test_shape_changes_rebuild_nothing(device):
    for name in ("tendons", "skins", "flexes"):
        model, data = model_of(name)
        renderer = Renderer(model, 24, 32, device=device)
        renderer.enable_depth_rendering()
        renderer.update_scene(data, "front")
        before, objects, tree = renderer.render(), renderer.scene.objects, renderer.scene.bvh()
        stir(model, data)
        renderer.update_scene(data, "front")
        assert not np.array_equal(renderer.render(), before)
        assert renderer.scene.bvh() is tree
        assert all(map(lambda one, other: one is other, renderer.scene.objects, objects))


def test_models_without_visuals_skip_drawing():
    model = mujoco.MjModel.from_xml_string(
        f"{HEAD}<worldbody><geom size='1'/><site name='s'/>{EYE}</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    visuals = Visuals(model, mesh_tolerance=1e-3)
    assert not visuals.may_draw(None) and not visuals.may_draw(mujoco.MjvOption())
    assert visuals.may_draw(option_with({"JOINT": 1})) and visuals.may_draw(
        option_with(frame=mujoco.mjtFrame.mjFRAME_BODY)
    )
    assert all(Visuals(model_of(name)[0], mesh_tolerance=1e-3).may_draw(None) for name in MODELS if name != "sites")


def test_added_objects_stay_last():
    """Objects are added before anything is drawn, and more elements are drawn later."""
    model, data = model_of("tendons")
    renderer, box = Renderer(model, HEIGHT, WIDTH), trimesh.creation.box((0.3, 0.3, 0.3))
    renderer.scene.add(box, name="mine", pose=(0.8, -0.5, 0.3, 0, 0, 0, 1), movable=True)
    renderer.scene.add(box, name="worn", pose=(0.8, -0.5, 0.6, 0, 0, 0, 1), attach_to="mine")
    counts = []
    for option in (None, option_with(frame=mujoco.mjtFrame.mjFRAME_BODY), option_with({"JOINT": 1}), None):
        depth, segmentation = images(renderer, data, "front", option)
        assert pixels(segmentation)[-1, int(OBJ.mjOBJ_UNKNOWN)] > 500
        names = [item.name for item in renderer.scene]
        assert names[-2:] == ["mine", "worn"] and renderer.scene["worn"].parent == len(names) - 2
        assert {"belt", "string", "actuator_0_cylinder"} <= set(names)
        counts.append((len(names), depth))
    assert counts[0][0] < counts[1][0] <= counts[2][0] == counts[3][0]
    assert np.array_equal(counts[0][1], counts[3][1]) and not np.array_equal(counts[0][1], counts[2][1])


@pytest.mark.smoke("sites-*")
@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda item: pickle.loads(pickle.dumps(item))], ids=["copy", "pickle"]
)
@pytest.mark.parametrize("name", MODELS)
def test_copies_render_equal_images(name, copied):
    model, data = model_of(name)
    renderer = Renderer(model, 60, 80)
    renderer.update_scene(data, "front", option_with({"JOINT": 1}))
    stir(model, data)
    renderer.scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="mine", pose=(0.8, -0.5, 0.3, 0, 0, 0, 1))
    expected = images(renderer, data, "front")
    again = copied(renderer)
    again.enable_depth_rendering()
    depth = again.render()
    again.enable_segmentation_rendering()
    assert np.allclose(depth, expected[0], atol=1e-5) and np.array_equal(again.render(), expected[1])
    assert again.scene.objects[-1].name == "mine"
    stir(again.model, data)
    moved = images(again, data, "front")
    assert np.allclose(moved[0], images(renderer, data, "front")[0], atol=1e-5)


def test_exclude_and_labels_apply_to_elements():
    model, data = model_of("tendons")
    labels = {"string": "robot", "d": "human"}
    renderer = Renderer(model, HEIGHT, WIDTH, exclude=["belt", "b"], labels=labels)
    _, segmentation = images(renderer, data, "front")
    seen = pixels(segmentation)
    assert (model.tendon("belt").id, TENDON) not in seen and (model.tendon("string").id, TENDON) in seen
    assert renderer.scene["string"].label == wv.Label.ROBOT and renderer.scene["d"].label == wv.Label.HUMAN
    assert "b" not in renderer.scene and "c" in renderer.scene
    with pytest.raises(wv.WarpvisError, match="'nobody' in exclude must match a geom or body of the model"):
        Renderer(model, HEIGHT, WIDTH, exclude=["nobody"])


def test_unsupported_elements_warn_once(monkeypatch):
    monkeypatch.setattr("warpvis.mujoco._visuals._LINES", ())
    model, data = model_of("skins")
    renderer, option = Renderer(model, HEIGHT, WIDTH), option_with({"BODYBVH": 1})
    renderer.update_scene(data, "front")
    with recorded_warnings(r"elements of mujoco\.Renderer that are not rendered: mjGEOM_LINEBOX of mjOBJ_") as caught:
        renderer.update_scene(data, "front", option)
    assert caught[0].filename == __file__
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        renderer.update_scene(data, "front", option)


# Batches.


def test_batches_render_sites_with_scene_option(device):
    model, data = model_of("sites")
    size = {"height": 60, "width": 80, "outputs": ("depth", "segmentation"), "device": device}
    plain = BatchRenderer(model, **size).render(data, cameras="front")
    batch = BatchRenderer(model, **size, scene_option=mujoco.MjvOption())
    worlds = [copy.copy(data), data]
    worlds[0].qpos[:3] += 0.2, 0.1, 0.2
    mujoco.mj_forward(model, worlds[0])
    expected = [images(Renderer(model, 60, 80, device=device), world, "front") for world in worlds]
    qpos = np.stack([world.qpos for world in worlds])
    poses = WorldPoses.of(worlds)
    for source in (worlds, poses, qpos):
        views = batch.render(source, cameras="front")
        for image, ids, (depth, segmentation) in zip(
            views.depth.numpy(), batch.geom_ids(views).numpy(), expected, strict=True
        ):
            near = np.isfinite(image)
            assert np.allclose(image[near], depth[near], atol=1e-5)
            assert np.array_equal(near, segmentation[..., 0] >= 0)
            is_geom = segmentation[..., 1] == OBJ.mjOBJ_GEOM
            assert np.array_equal(ids, np.where(is_geom, segmentation[..., 0], -1))
    assert (plain.depth.numpy()[0] > batch.render(data, cameras="front").depth.numpy()[0] + 0.01).sum() > 100
    bodies = batch.body_ids(views).numpy()
    assert set(np.unique(bodies)) == {-1, 0, model.body("palm").id}
    marked = batch.semantic_ids(views, {"on_table": 7}).numpy()
    on_table = (expected[1][1] == [model.site("on_table").id, SITE]).all(axis=-1)
    assert on_table.any() and np.array_equal(marked[1] == 7, on_table)
    poses.site_xpos[1, model.site("on_table").id] += 0.5
    with pytest.raises(
        wv.WarpvisError, match="site 'on_table' is static and must have the model's pose, got another in world 1"
    ):
        batch.render(poses, cameras="front")
    with pytest.raises(wv.WarpvisError, match="or an object with site_xpos"):
        batch.render(
            WorldPoses(*(getattr(poses, f"{name}") for name in ("geom_xpos", "geom_xmat", "cam_xpos", "cam_xmat")))
        )


def test_site_groups_select_sites():
    model, data = model_of("sites")
    plain, scene = scene_from_mujoco(model), scene_from_mujoco(model, site_groups=(0, 3))
    assert len(plain.site_ids) == 0 and np.array_equal(plain.geom_ids, scene.geom_ids)
    ids = {model.site(site).name or site for site in scene.site_ids.tolist()}
    assert {"box", "unshown", "palm"} <= ids and not {"clear", 2} & ids
    rows = geom_poses(data, scene)
    assert len(rows) == len(scene.movable_geoms) + len(scene.movable_sites)
    assert np.allclose(rows[len(scene.movable_geoms) :, :3], data.site_xpos[scene.movable_sites], atol=1e-6)
    assert len(copy.deepcopy(scene).site_ids) == len(scene.site_ids)
    with pytest.raises(wv.WarpvisError, match=r"site_groups must be of 0 to 5, got \(6,\)"):
        scene_from_mujoco(model, site_groups=6)


def test_soft_elements_of_scenes_warn():
    expected = {"tendons": "tendon 'belt', tendon 'string'", "skins": "skin 'sleeve'"}
    expected["flexes"] = "flex 'rope', flex 'cloth', flex 'jelly'"
    for name, soft in expected.items():
        model, _ = model_of(name)
        with recorded_warnings(f"warpvis.mujoco.Renderer that are not rendered: {soft}$") as caught:
            scene_from_mujoco(model)
        assert caught[0].filename == __file__ and len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene_from_mujoco(model_of("sites")[0])
        scene_from_mujoco(model, exclude=["rope", "cloth", "jelly"])


@pytest.mark.gl
def test_skin_of_dm_control_dog_matches_mujoco():
    """The dog of dm_control's suite consists of a skin."""
    dog = pytest.importorskip("dm_control.suite.dog")
    model = mujoco.MjModel.from_xml_string(*dog.get_model_and_assets(10))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer = Renderer(model, HEIGHT, WIDTH)
    for _ in range(2):
        with mujoco.Renderer(model, HEIGHT, WIDTH) as theirs:
            for camera in range(model.ncam):
                depth, segmentation = images(renderer, data, camera)
                expected, _ = images(theirs, data, camera)
                assert (np.abs(depth - expected) < 0.01).mean() > 0.999
                assert pixels(segmentation)[0, SKIN] > 300
        stir(model, data)
