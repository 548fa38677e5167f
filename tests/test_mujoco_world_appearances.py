# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors, materials, textures and lights of MuJoCo models that differ between worlds, move, or are changed later.

Each world is compared with a model that has its numbers, and with MuJoCo's pictures.
"""

import copy
import pickle

import mujoco
import numpy as np
import pytest
import reference_mujoco_appearances as reference
import reference_shading
import warp as wp

import warpvis as wv
from warpvis.errors import ArrayError, SceneError
from warpvis.scene.lights import Background
from warpvis.scene.world_appearances import WorldAppearances

MODEL = """<mujoco><visual><headlight ambient=".2 .2 .2" diffuse=".2 .2 .2" specular="0 0 0"/>
<quality offsamples="0"/></visual>
<asset>
<texture name="checks" type="2d" builtin="checker" rgb1="1 .9 .1" rgb2=".1 .2 .6" width="32" height="32"/>
<texture name="stripes" type="2d" builtin="gradient" rgb1=".9 .1 .1" rgb2=".1 .9 .1" width="32" height="32"/>
<texture name="cube" type="cube" builtin="gradient" rgb1=".2 .4 .9" rgb2=".9 .9 .9" width="16" height="96"/>
<material name="plain" rgba=".8 .6 .4 1" specular=".3" shininess=".4"/>
<material name="checked" texture="checks" texrepeat="2 2" rgba=".9 .9 .9 1"/>
<material name="wrapped" texture="cube"/><material name="lamp" rgba=".9 .8 .3 1" emission=".5"/>
</asset><worldbody>
<camera name="eye" pos="0 -2.5 1.6" xyaxes="1 0 0 0 .5 1"/>
<light name="sun" type="directional" dir=".3 .4 -1" diffuse=".4 .4 .5" specular=".2 .2 .2"/>
<geom name="floor" type="plane" size="3 3 .1" material="checked"/>
<geom name="box" type="box" size=".25 .25 .25" pos="-.8 0 .25" material="plain"/>
<geom name="glow" type="box" size=".15 .15 .15" pos="-.2 .6 .15" material="lamp"/>
<body name="carrier" pos=".4 0 1"><joint name="slide" type="slide" axis="1 0 0"/><joint name="turn" axis="0 1 0"/>
<geom name="ball" type="sphere" size=".2" rgba=".2 .7 .3 1"/>
<geom name="wrap" type="box" size=".1 .1 .2" pos="0 0 .4" material="wrapped"/>
<light name="torch" pos="0 0 -.25" dir="0 0 -1" diffuse=".8 .7 .5" specular=".3 .3 .3" ambient=".05 .05 .05"
 attenuation="1 0 .1" cutoff="40" exponent="4"/></body>
</worldbody></mujoco>"""
SIZE = 48, 64
WORLDS = 3


@pytest.fixture
def model():
    return mujoco.MjModel.from_xml_string(MODEL)


def states_of(model, count=WORLDS):
    states = []
    for world in range(count):
        states.append(mujoco.MjData(model))
        states[-1].qpos[:] = 0.3 * world - 0.4, 0.25 * world
        mujoco.mj_forward(model, states[-1])
    return states


def batch_of(model, device, **options):
    options = {"outputs": ("color", "albedo", "segmentation"), **options}
    return wv.mujoco.BatchRenderer(model, height=SIZE[0], width=SIZE[1], device=device, **options)


def color_of(model, data, device, **options):
    """Return the picture of one world of a model that was made with its numbers."""
    current = mujoco.MjData(model)
    current.qpos[:] = data.qpos
    mujoco.mj_forward(model, current)
    scene = wv.mujoco.scene_from_mujoco(model, device=device)
    scene.scene.lights = wv.mujoco.lights_from_mujoco(model, current)
    camera = wv.mujoco.camera_from_mujoco(model, "eye", SIZE[1], SIZE[0])
    poses = wv.mujoco.camera_poses(current, model, [0])
    views = wv.render(
        scene.scene,
        camera,
        poses,
        object_poses=wv.mujoco.geom_poses(current, scene),
        outputs=("color", "albedo"),
        cull_backfaces=True,
        near_plane="clip",
        **options,
    )
    return views.color.numpy()[0].astype(int), views.albedo.numpy()[0].astype(int)


def with_fields(model, fields, world):
    """Return a copy of a model with the fields of a world."""
    changed = copy.copy(model)
    for name, rows in fields.items():
        getattr(changed, name)[:] = np.asarray(rows)[world % len(rows)]
    return changed


def assert_worlds_match(model, states, views, fields, device):
    pictures = [views.color.numpy().astype(int), views.albedo.numpy().astype(int)]
    for world, data in enumerate(states):
        expected = color_of(with_fields(model, fields, world), data, device)
        for found, wanted in zip(pictures, expected, strict=True):
            difference = np.abs(found[world] - wanted).max(axis=-1)
            assert (difference <= 1).mean() > 0.999, (world, difference.max(), (difference > 1).mean())
    assert (pictures[0][0] != pictures[0][1]).any()


def test_lights_move_with_bodies(model, device):
    states = states_of(model)
    batch = batch_of(model, device)
    views = batch.render(states, cameras="eye")
    assert_worlds_match(model, states, views, {}, device)
    from_joints = batch.render(np.array([data.qpos for data in states]), cameras="eye")
    np.testing.assert_array_equal(from_joints.color.numpy(), views.color.numpy())
    some = batch.render(states, cameras="eye", worlds=[2, 0])
    np.testing.assert_array_equal(some.color.numpy(), views.color.numpy()[[2, 0]])
    frozen = mujoco.MjData(model)
    mujoco.mj_forward(model, frozen)
    lit = wv.mujoco.lights_from_mujoco(model, states[2])
    assert lit[2].name == "torch" and np.allclose(lit[2].position, states[2].light_xpos[1])
    assert not np.allclose(lit[2].position, wv.mujoco.lights_from_mujoco(model, frozen)[2].position)


@pytest.mark.gl
def test_lights_that_move_look_as_in_mujoco(model):
    states = states_of(model)
    batch = batch_of(model, "cpu", shadows=False)
    found = batch.render(states, cameras="eye").color.numpy().astype(int)
    with mujoco.Renderer(model, *SIZE) as renderer:
        for world, data in enumerate(states):
            renderer.update_scene(data, "eye")
            for flag in (mujoco.mjtRndFlag.mjRND_SHADOW, mujoco.mjtRndFlag.mjRND_REFLECTION):
                renderer.scene.flags[flag] = 0
            difference = np.abs(found[world] - renderer.render()).max(axis=-1)
            assert np.quantile(difference, 0.9) <= 12  # MuJoCo lights the spot per vertex
            assert difference.mean() < 6


FIELDS = {
    "geom_rgba": lambda model, rng: rng.uniform(0, 1, (WORLDS, model.ngeom, 4)) * [1, 1, 1, 0] + [0, 0, 0, 1],
    "mat_rgba": lambda model, rng: rng.uniform(0, 1, (WORLDS, model.nmat, 4)) * [1, 1, 1, 0] + [0, 0, 0, 1],
    "geom_matid": lambda model, rng: rng.integers(-1, model.nmat, (WORLDS, model.ngeom)).astype(np.int32),
    "mat_texid": lambda model, rng: np.stack(
        [model.mat_texid, texid(model, [1, 0, -1, 2]), texid(model, [2, 2, 0, 0])]
    ),
    "light_diffuse": lambda model, rng: rng.uniform(0, 1, (WORLDS, model.nlight, 3)),
    "light_ambient": lambda model, rng: rng.uniform(0, 0.3, (WORLDS, model.nlight, 3)),
    "light_specular": lambda model, rng: rng.uniform(0, 1, (WORLDS, model.nlight, 3)),
    "light_attenuation": lambda model, rng: rng.uniform(0.3, 1, (WORLDS, model.nlight, 3)),
    "light_active": lambda model, rng: np.array([[True, False], [False, True], [False, False]]),
    "light_type": lambda model, rng: np.array([[1, 0], [0, 2], [3, 1]], dtype=np.int32),
    "light_cutoff": lambda model, rng: rng.uniform(10, 80, (WORLDS, model.nlight)),
    "light_exponent": lambda model, rng: rng.uniform(0, 20, (WORLDS, model.nlight)),
}


LIGHT_SHAPES = ("light_type", "light_cutoff", "light_exponent", "light_attenuation", "light_active")


def texid(model, numbers):
    rows = model.mat_texid.copy()
    rows[:, int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = numbers
    return rows


@pytest.mark.parametrize(
    "names", [*((name,) for name in FIELDS), ("geom_matid", "mat_rgba", "mat_texid"), LIGHT_SHAPES], ids="-".join
)
def test_fields_of_worlds(names, model, device):
    rng, states = np.random.default_rng(3), states_of(model)
    fields = {name: FIELDS[name](model, rng) for name in names}
    batch = batch_of(model, device)
    plain = batch.render(states, cameras="eye").color.numpy().copy()
    views = batch.render(states, cameras="eye", model=fields)
    assert_worlds_match(model, states, views, fields, device)
    assert (views.color.numpy() != plain).mean() > 0.01
    some = batch.render(states, cameras="eye", model=fields, worlds=[2, 1]).color.numpy()
    np.testing.assert_array_equal(some, views.color.numpy()[[2, 1]])
    np.testing.assert_array_equal(batch.render(states, cameras="eye").color.numpy(), plain)


def test_shapes_of_lights_agree_with_double_precision(device):
    """Spots, points, directional and image lights of worlds, with and without light of the last resort."""
    lights = "".join(f'<light pos="{x} -.5 1.5" dir="{-x} .3 -1"/>' for x in (0.6, -0.6))
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><visual><headlight active="0"/></visual><worldbody>{lights}
    <camera name="eye" pos="0 -2.5 1.6" xyaxes="1 0 0 0 .5 1"/><geom type="plane" size="2 2 .1" rgba=".7 .6 .5 1"/>
    <geom type="box" size=".3 .2 .3" pos="0 .2 .3" rgba=".3 .6 .8 1"/></worldbody></mujoco>""")
    data, rng = mujoco.MjData(model), np.random.default_rng(8)
    mujoco.mj_forward(model, data)
    fields = {
        "light_type": np.array([[0, 1], [2, 3], [1, 0], [3, 0]], dtype=np.int32),
        "light_active": np.array([[True, True], [True, True], [True, True], [True, False]]),
        "light_cutoff": rng.uniform(20, 60, (4, 2)),
        "light_exponent": rng.uniform(0, 9, (4, 2)),
        "light_attenuation": rng.uniform(0.2, 0.8, (4, 2, 3)),
    }
    batch = batch_of(model, device, outputs=("color", "points", "normals", "segmentation"), shadows=False)
    views = batch.render([data] * 4, cameras="eye", model=fields)
    materials = [item.appearance.materials[0] for item in batch.scene.objects]
    of_worlds = [list(wv.mujoco.lights_from_mujoco(with_fields(model, fields, world), data)) for world in range(4)]
    assert [len(lights) for lights in of_worlds] == [2, 2, 2, 1] and of_worlds[3][0].kind == "ambient"
    poses = np.tile(wv.mujoco.camera_poses(data, model, [0]), (4, 1))
    expected = reference_shading.shade_lit_colors(of_worlds, materials, poses, views)
    difference = np.abs(views.color.numpy() - expected).max(axis=-1)
    assert (difference <= 1).mean(axis=(1, 2)).min() > 0.998  # pixels at the edges of cones


def test_light_places_of_worlds(model, device):
    """Places of lights in their bodies differ between worlds for poses from joint positions."""
    rng, states = np.random.default_rng(4), states_of(model)
    fields = {"light_pos": model.light_pos + rng.uniform(-0.2, 0.2, (WORLDS, model.nlight, 3))}
    fields["light_dir"] = model.light_dir + rng.uniform(-0.2, 0.2, (WORLDS, model.nlight, 3))
    views = batch_of(model, device).render(np.array([data.qpos for data in states]), cameras="eye", model=fields)
    assert_worlds_match(model, states, views, fields, device)


def test_transparent_geoms_are_hidden_and_others_colored(model, device):
    states, colors = states_of(model, 2), np.tile(model.geom_rgba, (2, 1, 1))
    colors[1, model.geom("ball").id] = 1, 0, 0, 0
    colors[0, model.geom("ball").id] = 1, 0, 0, 1
    views = batch_of(model, device).render(states, cameras="eye", model={"geom_rgba": colors})
    albedo, seg = views.albedo.numpy(), views.segmentation.numpy()
    ball = seg == model.geom("ball").id
    assert ball[0].any() and not ball[1].any() and (albedo[0][ball[0]] == [255, 0, 0]).all()


def test_changes_of_the_model_are_followed(model, device):
    states, batch = states_of(model, 2), batch_of(model, device)
    before = batch.render(states, cameras="eye").color.numpy().copy()
    unchanged = copy.copy(model)
    steps = (
        lambda: model.geom_rgba.__setitem__(model.geom("ball").id, (0.9, 0.2, 0.1, 1)),
        lambda: model.mat_rgba.__setitem__(1, (0.4, 0.9, 0.6, 1)),
        lambda: model.geom_matid.__setitem__(model.geom("box").id, 2),
        lambda: model.light_diffuse.__setitem__(0, (0.9, 0.1, 0.1)),
        lambda: model.mat_emission.__setitem__(3, 0.1),
        lambda: model.light_active.__setitem__(0, False),
        lambda: setattr(model.vis.headlight, "diffuse", (0.5, 0.5, 0.1)),
    )
    last = before
    for step in steps:
        step()
        views = batch.render(states, cameras="eye")
        assert (views.color.numpy() != last).any()
        last = views.color.numpy().copy()
        assert_worlds_match(model, states, views, {}, device)
    del unchanged
    copied = pickle.loads(pickle.dumps(batch))
    np.testing.assert_array_equal(copied.render(states, cameras="eye").color.numpy(), last)


def test_appearances_replace_those_of_the_model(model, device):
    states, batch = states_of(model), batch_of(model, device)
    rng = np.random.default_rng(5)
    colors = rng.uniform(0, 1, (WORLDS, len(batch.scene), 3)).astype(np.float32)
    look = WorldAppearances(object_colors=colors, light_intensities=rng.uniform(0, 1, (1, len(batch.scene.lights))))
    views = batch.render(states, cameras=["eye", -1], appearances=look)
    seg, albedo = views.segmentation.numpy()[:WORLDS], views.albedo.numpy()[:WORLDS]
    ball = batch.scene.index("ball")
    for world in range(WORLDS):
        seen = albedo[world][seg[world] == ball]
        assert len(seen) and np.abs(seen - colors[world, ball] * 255).max() <= 1
    both = batch.render(states, cameras="eye", appearances=look, model={"geom_rgba": model.geom_rgba[None]})
    np.testing.assert_array_equal(both.albedo.numpy(), albedo)
    with pytest.raises(ArrayError, match="backgrounds must have 1 or 3 rows, like the worlds to render, got 2"):
        batch.render(states, cameras="eye", appearances=WorldAppearances(backgrounds=np.zeros((2, 3))))


def test_skies_of_worlds(model, device):
    states, batch = states_of(model), batch_of(model, device)
    skies = [Background(gradient=((0.1, 0.2, 0.9), (0.8, 0.9, 1.0))), Background((0.9, 0.1, 0.2))]
    plain = batch.render(states, cameras=["eye", -1]).color.numpy().copy()
    look = WorldAppearances(skies=skies, world_skies=np.array([1, -1, 0], dtype=np.int32))
    views = batch.render(states, cameras=["eye", -1], appearances=look)
    empty, colors = views.segmentation.numpy() < 0, views.color.numpy()
    assert empty.any(axis=(1, 2)).all()
    np.testing.assert_array_equal(colors[~empty], plain[~empty])
    np.testing.assert_array_equal(colors[1::3], plain[1::3])
    assert (colors[0::3][empty[0::3]] == np.rint(255 * np.array([0.9, 0.1, 0.2]))).all()
    blue = colors[2::3][empty[2::3]]
    assert (blue[:, 2] >= 230).all() and len(np.unique(blue[:, 0])) > 3


def test_lights_of_the_user_stay(model, device):
    states, batch = states_of(model), batch_of(model, device)
    batch.scene.lights = [wv.scene.lights.Light("ambient", ambient=(1, 1, 1))]
    views = batch.render(states, cameras="eye")
    seg = views.segmentation.numpy()
    lamp = seg == batch.scene.index("glow")  # it emits light, too
    np.testing.assert_array_equal(views.color.numpy()[~lamp], views.albedo.numpy()[~lamp])


def test_coinciding_geoms_have_the_color_of_their_segmentation(device):
    """The last geom of a model wins: its color and texture show wherever segmentation names it."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><camera name="eye" pos="0 -2 2" xyaxes="1 0 0 0 1 1"/>
    <geom name="a" type="box" size=".6 .6 .1" rgba="1 0 0 1"/><geom name="b" type="box" size=".3 .3 .1" rgba="0 0 1 1"/>
    <body pos=".5 .5 .4"><freejoint/><geom name="c" type="sphere" size=".2" rgba="0 1 0 1"/>
    <geom name="d" type="sphere" size=".2" rgba="1 1 0 1"/></body>
    <body pos="-.5 .5 .4"><freejoint/><geom name="e" type="cylinder" size=".2 .1" rgba="1 0 1 1"/>
    <geom name="f" type="box" size=".1 .1 .1" rgba="0 1 1 1"/></body></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for outputs in (("color", "albedo", "segmentation"), ("albedo",)):
        batch = batch_of(model, device, outputs=outputs)
        colors = np.tile(model.geom_rgba, (2, 1, 1))
        colors[1, :, :3] = 1 - colors[1, :, :3] * 0.5
        plain = batch.render([data] * 2, cameras="eye").albedo.numpy().copy()
        views = batch.render([data] * 2, cameras="eye", model={"geom_rgba": colors})
        albedo = views.albedo.numpy()
        if "segmentation" in outputs:
            seg = views.segmentation.numpy()[0]
            assert {model.geom(name).id for name in "bdf"} <= set(np.unique(seg)) and model.geom("c").id not in seg
        for world in range(2):
            wanted = np.floor(colors[world][seg][..., :3] * 255 + 0.5)
            assert np.abs(albedo[world] - wanted)[seg >= 0].max() <= 1
        np.testing.assert_array_equal(plain[0], albedo[0])


def test_emission_differs_between_worlds(model, device):
    states, rng = states_of(model), np.random.default_rng(4)
    fields = {"mat_emission": rng.uniform(0, 1, (len(states), model.nmat)).astype(np.float32)}
    batch = batch_of(model, device)
    views = batch.render(states, cameras="eye", model=fields)
    assert_worlds_match(model, states, views, fields, device)
    assert (views.color.numpy() != batch.render(states, cameras="eye").color.numpy()).any()


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"light_diffuse": np.zeros((3, 1, 3))}, r"light_diffuse must have shape \(W, 2, 3\), got"),
        ({"light_diffuse": np.full((1, 2, 3), np.nan)}, "light_diffuse must be finite"),
        ({"mat_texid": np.full((1, 4, 10), 9)}, "mat_texid must be from -1 to 2, got 9 to 9"),
        ({"geom_matid": np.full((1, 5), 9)}, "geom_matid must be from -1 to 3, got 9"),
        ({"light_type": np.full((1, 2), 4)}, "light_type must be from 0 to 3, of mujoco.mjtLightType, got 4 to 4"),
        ({"light_cutoff": np.full((3, 2), np.inf)}, "light_cutoff must be finite, got inf at index 0 in world 0"),
        ({"light_castshadow": np.zeros((1, 2))}, "light_castshadow must equal that of the renderer's model"),
        ({"mat_specular": np.ones((1, 4))}, "mat_specular must equal that of the renderer's model"),
        ({"mat_emission": np.ones((1, 3))}, r"mat_emission must have shape \(W, 4\), got"),
        ({"light_color": np.ones((1, 2))}, "model must have keys among"),
    ],
)
def test_bad_fields_are_refused(fields, message, model, device):
    with pytest.raises(ArrayError, match=message):
        batch_of(model, device).render(states_of(model), cameras="eye", model=fields)


def test_poses_without_lights_are_refused(model, device):
    states, batch = states_of(model), batch_of(model, device)
    poses = wv.mujoco.WorldPoses.of(states)
    poses.light_xpos = None
    with pytest.raises(ArrayError, match="poses must have light_xpos for the output color"):
        batch.render(poses, cameras="eye")
    with pytest.raises(SceneError, match=r"model and data must be a mujoco\.MjModel and its MjData"):
        wv.mujoco.lights_from_mujoco(model, None)


def test_kernels_match_reference(model, device):
    from warpvis.kernels.mujoco import appearances as kernels

    rng = np.random.default_rng(6)
    geom_rgba, mat_rgba = (rng.uniform(-0.2, 1.2, (2, count, 4)).astype(np.float32) for count in (5, 3))
    geom_rgba[:, ::2] = 0.5, 0.5, 0.5, 1
    matid, emission = rng.integers(-1, 3, (1, 5)).astype(np.int32), rng.normal(size=(2, 3)).astype(np.float32)
    worlds, geoms = np.array([1, 0, 1], dtype=np.int32), np.array([3, -1, 0, 4, 2], dtype=np.int32)
    out = wp.zeros((3, 5), dtype=wp.vec4, device=device), wp.zeros((3, 5), dtype=wp.vec3, device=device)
    types = [(geom_rgba, wp.vec4), (matid, wp.int32), (mat_rgba, wp.vec4), (emission, float), (worlds, wp.int32)]
    inputs = [wp.array(rows, dtype=kind, device=device) for rows, kind in [*types, (geoms, wp.int32)]]
    wp.launch(kernels.object_colors, (3, 5), [*inputs, *out], device=device)
    for found, wanted in zip(out, reference.object_colors(*(rows for rows, _ in types), geoms), strict=True):
        np.testing.assert_allclose(found.numpy(), wanted, rtol=1e-6)
    values, own = rng.normal(size=(2, 4, 3)).astype(np.float32), rng.normal(size=(3, 3)).astype(np.float32)
    lights = np.array([-1, 3, 0], dtype=np.int32)
    found = wp.zeros((3, 3), dtype=wp.vec3, device=device)
    types = [(values, wp.vec3), (own, wp.vec3), (worlds, wp.int32), (lights, wp.int32)]
    inputs = [wp.array(rows, dtype=kind, device=device) for rows, kind in types]
    wp.launch(kernels.light_vectors, (3, 3), [*inputs, 0.0, found], device=device)
    np.testing.assert_array_equal(found.numpy(), reference.light_vectors(values, own, worlds, lights, 0.0))
    active, kinds = rng.random((2, 4)) > 0.5, np.array([[0, 1, 2, 3], [2, 2, 0, 1], [1, 2, 0, 0]], dtype=np.int32)
    for ids in ([-1, 3, 0], [3, 1, -2], [2, -2], [0, 1, 2, 3, -2]):
        numbers = np.array(ids, dtype=np.int32)
        found = wp.zeros((3, len(ids)), dtype=float, device=device)
        inputs = [wp.array(active, dtype=wp.bool, device=device)]
        inputs += [wp.array(rows, dtype=wp.int32, device=device) for rows in (kinds, worlds, numbers)]
        wp.launch(kernels.light_switches, 3, [*inputs, found], device=device)
        np.testing.assert_array_equal(found.numpy(), reference.light_switches(active, kinds, worlds, numbers))
    cutoffs = np.array([[-5, 40, 180, 200], [30, 0, 179.9, 90]], dtype=np.float32)
    exponents, lights = rng.normal(size=(1, 4)).astype(np.float32), np.array([-1, 2, 0, 3, 1, -2], dtype=np.int32)
    own = np.array([4, 3, 3, 3, 3, 0], dtype=np.int32)
    out = [wp.zeros((3, 6), dtype=dtype, device=device) for dtype in (wp.int32, wp.vec2, wp.vec3)]
    types = [(kinds, wp.int32), (cutoffs, float), (exponents, float), (values, wp.vec3)]
    types += [(rows, wp.int32) for rows in (worlds, lights, own)]
    inputs = [wp.array(rows, dtype=kind, device=device) for rows, kind in types]
    wp.launch(kernels.light_shapes, (3, 6), [*inputs, *out], device=device)
    for found, wanted in zip(out, reference.light_shapes(*(rows for rows, _ in types)), strict=True):
        np.testing.assert_allclose(found.numpy(), wanted, rtol=1e-6)
    assert (out[1].numpy()[1, 1, 0] == np.float32(np.pi)).all()  # 180 degrees is a point light
