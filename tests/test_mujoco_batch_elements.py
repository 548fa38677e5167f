# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tendons, skins, flexes and sites of many worlds."""

import copy
import pickle
import re
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import warp as wp

import warpvis as wv
from warpvis.kernels.mujoco import arrays as kernels
from warpvis.kernels.mujoco.tendons import Paths, tendon_arcs, tendon_capsules
from warpvis.mujoco import BatchRenderer, Renderer, WorldPoses

import reference
from support.mujoco_renderer import images

SIZE = {"height": 60, "width": 80, "outputs": ("depth", "segmentation", "color")}
OBJ = mujoco.mjtObj
EYE = '<camera name="front" pos="0 -2.4 1.2" xyaxes="1 0 0 0 .4 .9" fovy="50"/>'
HEAD = """<mujoco><statistic extent="2" center="0 0 .3" meansize=".2"/>
  <visual><map znear=".005" zfar="20"/><quality numslices="12" offsamples="0"/></visual>"""

PULLEYS = f"""{HEAD}<default><site size=".04"/></default><worldbody>
  <geom name="floor" type="plane" size="3 3 .1"/><light pos="0 -1 3"/>
  <body pos="-.6 0 .9"><geom type="cylinder" name="wheel" size=".1 .1" euler="90 0 0"/><site name="over" pos="0 0 .3"/>
  </body>
  <geom name="ball" size=".12" pos=".1 0 .8"/><site name="above" pos=".1 0 1.2"/>
  <site name="a" pos="-.9 0 .3"/><site name="b" pos="-.2 0 .2"/><site name="c" pos=".4 0 .2"/>
  <site name="d" pos=".6 0 .9"/><site name="f" pos=".5 0 .1"/><site name="g" pos=".8 0 .1"/>
  <body name="load" pos="-.3 0 .5"><joint name="lift" type="slide" axis="0 0 1"/><geom name="load" size=".04"/>
    <site name="load"/></body>
  <body pos=".9 .1 .5"><joint type="slide" axis="0 0 1" range="-1 1"/><joint type="slide" axis="1 0 0"/>
    <geom size=".04"/><site name="end"/></body>{EYE}</worldbody>
  <tendon><spatial name="belt" width=".03" rgba="0 .7 .2 1"><site site="a"/><geom geom="wheel" sidesite="over"/>
      <site site="load"/><pulley divisor="2"/><site site="load"/><geom geom="ball" sidesite="above"/><site site="c"/>
    </spatial>
    <spatial name="string" width=".02" limited="true" range="0 .9" rgba="1 0 0 1"><site site="d"/><site site="end"/>
    </spatial>
    <spatial name="unshown" width=".05" group="4"><site site="f"/><site site="g"/></spatial>
    <fixed name="none"><joint joint="lift" coef="1"/></fixed></tendon></mujoco>"""

SKIN = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1"/><light pos="0 -1 3"/>
  <body name="upper" pos="-.4 0 .5"><joint type="ball"/><geom size=".05" group="4"/>
    <body name="lower" pos=".5 0 0"><joint type="hinge" axis="0 1 0"/><geom size=".05" group="4"/></body></body>
  {EYE}</worldbody><deformable><skin name="sleeve" inflate=".01" rgba="1 0 0 1"
     vertex="-.5 -.1 .4  -.5 .1 .4  -.5 0 .6  .1 -.1 .4  .1 .1 .4  .1 0 .6  .5 -.1 .4  .5 .1 .4  .5 0 .6"
     face="0 2 1  0 1 4 0 4 3 1 2 5 1 5 4 2 0 3 2 3 5  3 4 7 3 7 6 4 5 8 4 8 7 5 3 6 5 6 8  6 7 8">
     <bone body="upper" bindpos="-.4 0 .5" bindquat="1 0 0 0" vertid="0 1 2 3 4 5" vertweight="1 1 1 .5 .5 .5"/>
     <bone body="lower" bindpos=".1 0 .5" bindquat="1 0 0 0" vertid="3 4 5 6 7 8" vertweight=".5 .5 .5 1 1 1"/>
  </skin></deformable></mujoco>"""

CLOTH = f"""{HEAD}<worldbody><geom name="floor" type="plane" size="3 3 .1"/><light pos="0 -1 3"/>
  <flexcomp name="cloth" type="grid" dim="2" count="5 5 1" spacing=".12 .12 .1" pos="0 0 .5" radius=".02" mass="1"
    rgba="0 0 1 1"><edge equality="true"/></flexcomp>{EYE}</worldbody></mujoco>"""
MODELS = {"tendon": PULLEYS, "skin": SKIN, "flex": CLOTH}
NAMES = {"tendon": "belt", "skin": "sleeve", "flex": "cloth"}


def worlds_of(name, count=3):
    """Return a model and data of worlds in which it has moved."""
    model = mujoco.MjModel.from_xml_string(MODELS[name])
    worlds = []
    for world in range(count):
        data = mujoco.MjData(model)
        data.qvel[:] = np.random.default_rng(world).normal(scale=0.2 if name == "flex" else 0.7, size=model.nv)
        for _ in range(20 * world):
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
        worlds.append(data)
    return model, worlds


def capsules_of(batch, row, count):
    """Return ends and radii of the shown capsules of tendons in a world of the last call."""
    tendons, ((place,),) = batch._tendons, batch._worlds._free_workplaces._items.values()
    columns = slice(tendons._column, tendons._column + count)
    poses, sizes = place.objects.numpy()[row, columns], place.sizes.numpy()[row, columns]
    hidden = place.hidden.numpy()[row, tendons.first : tendons.first + count] != 0
    return poses[~hidden], sizes[~hidden]


@pytest.mark.parametrize("name", MODELS)
def test_batches_draw_soft_elements_as_the_renderer_does(name, device):
    model, worlds = worlds_of(name)
    batch = BatchRenderer(model, **SIZE, device=device)
    renderer = Renderer(model, 60, 80, fill="inf", lighting="pixel", device=device)
    kind = int(getattr(OBJ, f"mjOBJ_{name.upper()}"))
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    expected = []
    for camera in ("front", -1):
        for data in worlds:
            depth, segmentation = images(renderer, data, camera, option)
            expected.append((depth, segmentation, renderer.render()))
    assert all((segmentation[..., 1] == kind).sum() > 40 for _, segmentation, _ in expected[:3])
    poses = WorldPoses.of(worlds)
    on_device = WorldPoses(
        **{
            field: wp.array(value, dtype=wp.int32 if value.dtype.kind == "i" else wp.float32, device=device).numpy()
            for field, value in poses.__dict__.items()
        }
    )
    for source in (worlds, poses, on_device, np.stack([data.qpos for data in worlds])):
        views = batch.render(source, cameras=["front", -1])
        ids = batch.element_ids(views).numpy()
        for depth, pairs, color, (near, segmentation, colors) in zip(
            views.depth.numpy(), ids, views.color.numpy(), expected, strict=True
        ):
            same = (pairs == segmentation).all(axis=-1)
            assert same.mean() > 0.995
            is_seen = same & np.isfinite(near)
            assert np.quantile(np.abs(depth[is_seen] - near[is_seen]), 0.99) < 5e-4
            assert np.abs(color.astype(int) - colors)[same].mean() < 0.1
    assert not np.array_equal(views.depth.numpy()[0], views.depth.numpy()[2])
    (alone,) = BatchRenderer(model, **SIZE, device=device).render(worlds[2], cameras="front").depth.numpy()
    assert np.array_equal(alone, batch.render(worlds, cameras="front", worlds=[2]).depth.numpy()[0])


@pytest.mark.parametrize("name", MODELS)
def test_soft_elements_have_names_and_labels_and_may_be_left_out(name):
    model, worlds = worlds_of(name)
    pattern = NAMES[name]
    batch = BatchRenderer(model, **{**SIZE, "outputs": ("labels", "segmentation")}, labels={pattern: wv.Label.ROBOT})
    views = batch.render(worlds, cameras="front")
    pairs = batch.element_ids(views).numpy()
    mine = (pairs == [0, int(getattr(OBJ, f"mjOBJ_{name.upper()}"))]).all(axis=-1)
    assert mine.sum() > 100
    assert np.array_equal(views.labels.numpy() == wv.Label.ROBOT, mine)
    assert np.array_equal(batch.semantic_ids(views, {pattern: 4}).numpy() == 4, mine)
    assert (batch.geom_ids(views).numpy()[mine] == -1).all() and (batch.body_ids(views).numpy()[mine] == -1).all()
    without = BatchRenderer(model, **SIZE, exclude=[pattern])
    assert not {item.name for item in without.scene} & {pattern}
    hides = mujoco.MjvOption()
    getattr(hides, f"{name}group")[:] = 0
    assert pattern not in {item.name for item in BatchRenderer(model, scene_option=hides).scene}
    corners = np.array([[0, 0, 0], [0.3, 0, 0], [0, 0, 0.3]]) - [0, 1.5, 0]
    batch.scene.add((corners, np.array([[0, 1, 2]])), name="sign")
    pairs = batch.element_ids(batch.render(worlds, cameras="front")).numpy()
    assert ((pairs == (-1, OBJ.mjOBJ_UNKNOWN)).all(axis=-1).sum(axis=(1, 2)) > 10).all()


@pytest.mark.parametrize("name", MODELS)
def test_copies_of_batches_render_soft_elements(name):
    model, worlds = worlds_of(name)
    batch = BatchRenderer(model, **SIZE)
    expected = batch.render(worlds, cameras="front").color.numpy()
    copied = pickle.loads(pickle.dumps(batch))
    assert np.array_equal(copied.render(worlds, cameras="front").color.numpy(), expected)


def test_tendons_combine_with_colors_and_sizes_of_worlds(device):
    model, worlds = worlds_of("tendon")
    batch = BatchRenderer(model, **SIZE, resizable=["load"], device=device)
    plain = batch.element_ids(batch.render(worlds, cameras="front")).numpy()
    sizes, colors = (np.repeat(array[None], 3, axis=0) for array in (model.geom_size, model.geom_rgba))
    sizes[1, model.geom("load").id] *= 3
    colors[2, model.geom("ball").id, 3] = 0
    views = batch.render(worlds, cameras="front", model={"geom_size": sizes, "geom_rgba": colors})
    pairs = batch.element_ids(views).numpy()
    belt, load, ball = (0, int(OBJ.mjOBJ_TENDON)), (model.geom("load").id, 5), (model.geom("ball").id, 5)
    counts = {pair: [(image == pair).all(axis=-1).sum() for image in pairs] for pair in (belt, load, ball)}
    before = {pair: [(image == pair).all(axis=-1).sum() for image in plain] for pair in (belt, load, ball)}
    assert counts[load][1] > 4 * before[load][1] and counts[load][0] == before[load][0]
    assert counts[ball][2] == 0 < before[ball][2] and counts[belt][0] == before[belt][0] > 50


def test_capsules_are_those_of_mujoco():
    """Ends and radii agree with the geoms of `mjv_updateScene`, also of a slack tendon and around wrapped geoms."""
    model, worlds = worlds_of("tendon", 4)
    worlds[3].qpos[1:] = -0.6, 0.4  # taut
    mujoco.mj_forward(model, worlds[3])
    batch = BatchRenderer(model, **SIZE)
    batch.render(worlds, cameras="front")
    counts = []
    for row, data in enumerate(worlds):
        scene = mujoco.MjvScene(model, maxgeom=200)
        mujoco.mjv_updateScene(model, data, mujoco.MjvOption(), None, mujoco.MjvCamera(), 7, scene)
        geoms = [geom for geom in scene.geoms[: scene.ngeom] if geom.objtype == OBJ.mjOBJ_TENDON]
        poses, sizes = capsules_of(batch, row, len(batch._tendons))
        half = _axes(poses) * (sizes[:, 0] * sizes[:, 3])[:, None]
        ours = np.column_stack([poses[:, :3] - half, poses[:, :3] + half, sizes[:, 0]])
        ends = [geom.mat.reshape(3, 3)[:, 2] * geom.size[2] for geom in geoms]
        theirs = [[*(geom.pos - end), *(geom.pos + end), geom.size[0]] for geom, end in zip(geoms, ends, strict=True)]
        if not mujoco.__version__.startswith("3."):  # older ones draw straight lines through wrapped geoms
            assert len(ours) == len(theirs)
            distance = np.abs(ours[:, None] - np.array(theirs)[None]).max(axis=2)
            assert max(distance.min(axis=0).max(), distance.min(axis=1).max()) < 1e-5
        counts.append(len(ours))
    assert counts[0] > counts[3] > 20  # slack, and taut with two arcs


def _axes(poses):
    x, y, z, w = poses[:, 3:].T
    return np.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], axis=1)


# Lengths of slack tendons, relative to the distance of the ends; the last ones hang as two straight lines.
@pytest.mark.parametrize("excess", [1e-7, 1e-3, 0.3, 5.0, 60.0, 300.0])
def test_kernel_of_tendons_matches_reference(excess, device):
    rng = np.random.default_rng(int(1e4 * excess) % 97)
    worlds, nwrap = 4, 6
    xpos = rng.normal(size=(worlds, nwrap, 6)).astype(np.float32)
    objects = rng.choice([-2, -1, -1, 0, 1], size=(worlds, nwrap, 2)).astype(np.int32)
    objects[0, 2, 0] = -2
    first, count = (np.tile(values, (worlds, 1)).astype(np.int32) for values in ([0, 5, 7, 9], [5, 2, 2, 3]))
    count[1, 0] = 3
    between = xpos.reshape(worlds, -1, 3)[:, 6] - xpos.reshape(worlds, -1, 3)[:, 5]
    slack = np.array([0, (1 + excess) * np.linalg.norm(between, axis=1).min(), 1e-3, 0], dtype=np.float32)
    sizes = np.stack([np.array([0.01, 0.02, 0.03, 0.04], dtype=np.float32), slack], axis=1)
    segments = np.array([(0, k) for k in range(5)] + [(1, k) for k in range(9)] + [(2, 0), (3, 0), (3, 1), (3, 2)])
    rows = np.array([1, 0, 3], dtype=np.int32)
    up = np.array([0.1, -0.3, 0.9]) / np.linalg.norm([0.1, -0.3, 0.9])
    paths = paths_of(xpos, objects, first, count, device)
    inputs = [(rows, wp.int32), (segments.astype(np.int32), wp.vec2i), (sizes, wp.vec2)]
    arrays = [wp.array(values, dtype=dtype, device=device) for values, dtype in inputs]
    poses = wp.zeros((3, len(segments)), dtype=wp.transform, device=device)
    shapes = wp.zeros((3, len(segments)), dtype=wp.vec4, device=device)
    hidden = wp.zeros((6, len(segments)), dtype=wp.uint8, device=device)
    wp.launch(
        tendon_capsules, poses.shape, inputs=[paths, *arrays, wp.vec3(*up), 10, poses, shapes, hidden], device=device
    )
    ends, radii, shown = reference.tendon_capsules(xpos, objects, first, count, rows, segments, sizes, up, 10)
    assert shown.any() and not shown.all()
    assert np.array_equal(hidden.numpy()[:3] == 0, shown) and np.array_equal(hidden.numpy()[3:], hidden.numpy()[:3])
    poses, shapes = poses.numpy()[shown], shapes.numpy()[shown]
    half = _axes(poses) * (shapes[:, 0] * shapes[:, 3])[:, None]
    scale = 1 + slack.max()
    np.testing.assert_allclose(shapes[:, 0], radii[shown], rtol=1e-6)
    np.testing.assert_allclose(poses[:, :3] - half, ends[shown][:, 0], atol=2e-5 * scale)
    np.testing.assert_allclose(poses[:, :3] + half, ends[shown][:, 1], atol=2e-5 * scale)


def paths_of(xpos, objects, first, count, device):
    """Return paths of tendons as a kernel struct."""
    paths = Paths()
    paths.wrap_xpos = wp.array(xpos, dtype=wp.spatial_vector, device=device)
    paths.wrap_obj = wp.array(objects, dtype=wp.vec2i, device=device)
    paths.ten_wrapadr, paths.ten_wrapnum = (wp.array(rows, dtype=wp.int32, device=device) for rows in (first, count))
    return paths


def test_kernel_of_arcs_matches_reference(device):
    """Arcs of all lengths, in both directions, around spheres and cylinders."""
    rng = np.random.default_rng(3)
    worlds, frames = 40, np.linalg.qr(rng.normal(size=(40, 2, 3, 3)))[0].astype(np.float32)
    centers, is_cylinder = rng.normal(size=(40, 2, 3)).astype(np.float32), np.array([0, 1], dtype=np.int32)
    objects = np.array([[-1, 0], [0, -1], [-2, -1], [1, 1], [-1, -1]], dtype=np.int32)
    xpos = np.zeros((worlds, 5, 6), dtype=np.float32)
    points = xpos.reshape(worlds, 10, 3)
    for geom, place in enumerate((1, 6)):
        angles = np.stack([np.zeros(worlds), rng.uniform(0.1, 6.1, worlds) * rng.choice([-1, 1], worlds)], axis=1)
        local = np.stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)], axis=2) * rng.uniform(0.1, 1)
        if geom:
            local[:, 1, 2] = rng.normal(size=worlds)
        onward = np.stack([np.zeros(worlds), np.sign(angles[:, 1]), np.zeros(worlds)], axis=1)
        ends = np.einsum("wij,wkj->wki", frames[:, geom], np.stack([local[:, 0] - onward, *local.swapaxes(0, 1)], 1))
        points[:, place - 1 : place + 2] = ends + centers[:, geom, None]
    first, count = (np.full((worlds, 1), value, dtype=np.int32) for value in (0, 9))
    arcs = np.array([(0, number, piece) for number in range(3) for piece in range(12)], dtype=np.int32)
    rows, sizes = rng.permutation(worlds).astype(np.int32)[:30], np.array([[0.02, 0]], dtype=np.float32)
    inputs = [(centers, wp.vec3), (frames, wp.mat33), (is_cylinder, wp.int32), (rows, wp.int32), (arcs, wp.vec3i)]
    arrays = [wp.array(values, dtype=dtype, device=device) for values, dtype in [*inputs, (sizes, wp.vec2)]]
    poses = wp.zeros((30, len(arcs)), dtype=wp.transform, device=device)
    shapes, hidden = (wp.zeros(poses.shape, dtype=dtype, device=device) for dtype in (wp.vec4, wp.uint8))
    paths = paths_of(xpos, objects[None].repeat(worlds, axis=0), first, count, device)
    wp.launch(tendon_arcs, poses.shape, inputs=[paths, *arrays, 10.0, 12, poses, shapes, hidden], device=device)
    given = [values for values, _ in inputs]
    repeated = objects[None].repeat(worlds, axis=0)
    ends, shown = reference.tendon_arcs(xpos, repeated, first, count, *given, sizes, 10.0, 12)
    assert np.array_equal(hidden.numpy() == 0, shown) and not shown[:, 24:].any()
    assert set(np.unique(shown[:, :24].reshape(30, 2, 12).sum(axis=2))) >= {2, 6, 12}
    poses, shapes = poses.numpy()[shown], shapes.numpy()[shown]
    half = _axes(poses) * (shapes[:, 0] * shapes[:, 3])[:, None]
    np.testing.assert_allclose(poses[:, :3] - half, ends[shown][:, 0], atol=2e-5)
    np.testing.assert_allclose(poses[:, :3] + half, ends[shown][:, 1], atol=2e-5)
    np.testing.assert_allclose(shapes[:, 0], 0.02, rtol=1e-6)


def test_kernel_of_pairs_matches_reference(device):
    rng = np.random.default_rng(0)
    objects, pairs = rng.integers(-1, 4, size=100).astype(np.int32), rng.integers(-1, 9, size=(4, 2)).astype(np.int32)
    out = wp.zeros((100, 2), dtype=wp.int32, device=device)
    inputs = [wp.array(objects, device=device), wp.array(pairs, dtype=wp.vec2i, device=device), out]
    wp.launch(kernels.pairs_of_objects, dim=100, inputs=inputs, device=device)
    assert np.array_equal(out.numpy(), reference.pairs_of_objects(objects, pairs))


def test_site_groups_of_batches():
    model, worlds = worlds_of("tendon")
    batch = BatchRenderer(model, **SIZE, site_groups=0)
    pairs = batch.element_ids(batch.render(worlds, cameras="front")).numpy()
    assert (pairs[..., 1] == OBJ.mjOBJ_SITE).sum() > 20
    with pytest.raises(wv.WarpvisError, match="site_groups must not be given with scene_option"):
        BatchRenderer(model, site_groups=0, scene_option=mujoco.MjvOption())
    with pytest.raises(wv.WarpvisError, match=r"site_groups must be of 0 to 5, got \(6,\)"):
        BatchRenderer(model, site_groups=6)


@pytest.mark.parametrize("name", MODELS)
def test_poses_without_soft_elements_are_refused(name):
    model, worlds = worlds_of(name)
    poses = WorldPoses.of(worlds)
    field = {"tendon": "wrap_obj", "skin": "xquat", "flex": "flexvert_xpos"}[name]
    given = dict(poses.__dict__)
    rows = given.pop(field)
    batch = BatchRenderer(model, **SIZE)
    message = (
        f"poses must have {field} for the model's {'flexes' if name == 'flex' else name + 's'}, got SimpleNamespace;"
    )
    with pytest.raises(wv.WarpvisError, match=re.escape(message)):
        batch.render(SimpleNamespace(**given), cameras="front")
    # MJX has some of these fields in `_impl`.
    apart = batch.render(SimpleNamespace(**given, _impl=SimpleNamespace(**{field: rows})), cameras="front")
    assert np.array_equal(apart.depth.numpy(), batch.render(poses, cameras="front").depth.numpy())
    with pytest.raises(wv.WarpvisError, match=f"{field} must "):
        batch.render(WorldPoses(**given, **{field: rows[:, :-1]}), cameras="front")
    with pytest.raises(wv.WarpvisError, match=f"{field} must be of (3|as many) worlds"):
        batch.render(WorldPoses(**given, **{field: rows[:-1]}), cameras="front")
    broken = copy.deepcopy(given)
    floats = {"tendon": "wrap_xpos", "skin": "xpos", "flex": "flexvert_xpos"}[name]
    broken[floats] = np.array(getattr(poses, floats))
    broken[floats][1, 2, 0] = np.nan
    with pytest.raises(wv.WarpvisError, match=f"{floats} must be finite, got .* at index 2 in world 1"):
        batch.render(WorldPoses(**{field: rows} | broken), cameras="front")


@pytest.mark.parametrize("name", ["tendon", "skin"])
def test_elements_that_were_not_computed_are_refused(name):
    model, worlds = worlds_of(name)
    poses, batch = WorldPoses.of(worlds), BatchRenderer(model, **SIZE)
    field = {"tendon": "ten_wrapnum", "skin": "xquat"}[name]
    getattr(poses, field)[1] = 0
    with pytest.raises(wv.WarpvisError, match=f"poses must be computed, got {field} of zeros in world 1; call"):
        batch.render(poses, cameras="front")
    assert batch.render(poses, cameras="front", worlds=[0, 2]).worlds == 2


def test_soft_elements_are_refused_in_cuda_graphs(cuda):
    model, worlds = worlds_of("skin")
    batch = BatchRenderer(model, **SIZE, device=cuda)
    poses = WorldPoses.of(worlds)
    out = batch.render(poses, cameras="front")
    with pytest.raises(wv.WarpvisError, match=r"CUDA graph, .* exclude=\['sleeve'\]"), wp.ScopedCapture(cuda):
        batch.render(poses, cameras="front", out=out)


def test_mujoco_warp_data_has_tendons(device):
    mjwarp = pytest.importorskip("mujoco_warp", reason="the package mujoco_warp is not installed")
    model, worlds = worlds_of("tendon")
    with wp.ScopedDevice(device):
        data = mjwarp.put_data(model, worlds[2], nworld=2)
        views = BatchRenderer(model, **SIZE, device=device).render(data, cameras="front")
    expected = BatchRenderer(model, **SIZE, device=device).render(worlds[2], cameras="front")
    for image in views.depth.numpy():
        assert np.isclose(image, expected.depth.numpy()[0], atol=1e-4).mean() > 0.999


def test_mirrors_show_soft_elements(device):
    """A floor with a reflectance, in a scene with a mesh that deforms."""
    mirror = '<asset><material name="mirror" reflectance=".5"/></asset><worldbody><geom material="mirror" name="floor"'
    model = mujoco.MjModel.from_xml_string(SKIN.replace('<worldbody><geom name="floor"', mirror))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    batch, plain = (BatchRenderer(model, **SIZE, device=device, reflections=shown) for shown in (True, False))
    views = batch.render([data, data], cameras="front").color.numpy()
    assert np.array_equal(views[0], views[1])
    assert (views[0] != plain.render(data, cameras="front").color.numpy()[0]).any(axis=-1).sum() > 50
