# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Geom sizes that differ between the worlds of a batch: each world matches a batch of a model with its sizes."""

import copy
import pickle
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.kernels.mujoco import arrays as kernels
from warpvis.mujoco import BatchRenderer, WorldPoses, camera_poses, geom_poses, scene_from_mujoco

import reference
from support.coinciding import FLUSH, TWICE, model_of, twice

ALL = ("depth", "points", "normals", "labels", "segmentation")
HEIGHT, WIDTH = 36, 48

# All types of geoms, static and moving, several per body, some of them not resizable.
BODIES = """
<mujoco>
  <statistic extent="2"/><visual><map znear=".02" zfar="20"/></visual>
  <asset><mesh name="wedge" vertex="0 0 0  .2 0 0  .2 .2 0  0 .2 0  0 .1 .2  .2 .1 .2"/></asset>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1" pos="0 0 -.4"/>
    <geom name="wall" type="box" size=".05 1 .3" pos="1.2 0 0"/>
    <geom name="post" type="cylinder" size=".06 .4" pos=".8 .5 0" euler="10 20 0"/>
    <body name="arm" pos="0 -.1 .1" euler="20 10 5"><freejoint/>
      <geom name="block" type="box" size=".15 .1 .2"/>
      <geom name="limb" type="capsule" size=".06 .2" pos=".3 0 0" euler="0 70 0"/>
      <geom name="hook" type="mesh" mesh="wedge" pos="-.3 0 0"/>
      <geom name="hidden" type="box" size=".1 .1 .1" group="4"/>
    </body>
    <body name="ball" pos=".1 .5 .2"><freejoint/><geom name="ball" type="sphere" size=".14"/>
      <geom name="egg" type="ellipsoid" size=".1 .2 .12" pos="0 .3 0"/></body>
    <body name="can" pos=".3 -.6 0" euler="30 0 40"><freejoint/><geom name="can" type="cylinder" size=".12 .15"/></body>
    <camera name="eye" pos="-1.6 0 .6" xyaxes="0 -1 0 .3 0 1" fovy="60"/>
    <camera name="side" pos=".2 -2 .5" xyaxes="1 0 0 0 .2 1" fovy="55"/>
  </worldbody>
</mujoco>"""
PRIMITIVES = ("wall", "post", "block", "limb", "ball", "egg", "can")


def worlds_of(count, *, text=BODIES, names=PRIMITIVES, seed=0):
    """Return models with different sizes of the geoms `names`, and their data."""
    rng, worlds = np.random.default_rng(seed), []
    for _ in range(count):
        model, data = model_of(text)
        for name in names:
            model.geom(name).size[:] *= np.exp(rng.uniform(-0.6, 0.5, 3))
        data.qpos[:3] += rng.uniform(-0.1, 0.1, 3)
        mujoco.mj_forward(model, data)
        worlds.append((model, data))
    return worlds


def sizes_of(worlds):
    return {"geom_size": np.stack([model.geom_size for model, _ in worlds])}


def poses_of(worlds):
    return WorldPoses.of([data for _, data in worlds])


def batch_of(model, **options):
    return BatchRenderer(model, **{"outputs": ALL, "height": HEIGHT, "width": WIDTH, **options})


def images_of(batch, views):
    """Return all images, with geoms for objects, of shape ``(cameras, worlds, H, W)``."""
    images = {name: getattr(views, name).numpy() for name in ALL[:-1]} | {"geoms": batch.geom_ids(views).numpy()}
    return {name: image.reshape(-1, views.worlds, *image.shape[1:]) for name, image in images.items()}


def assert_as_their_own(batch, views, worlds, **options):
    """Compare each image with one of a batch of that world's model alone."""
    images = images_of(batch, views)
    for world, (model, data) in enumerate(worlds):
        alone = batch_of(model, device=batch.scene.device, **options)
        for name, expected in images_of(alone, alone.render(data)).items():
            got = images[name][:, [world]]
            far = ~np.isclose(got, expected, rtol=0, atol=2e-4 if name == "normals" else 1e-5, equal_nan=True)
            assert far.reshape(*far.shape[:4], -1).any(axis=-1).mean() <= 2e-3, (world, name)


@pytest.mark.parametrize("options", [{}, {"cull_backfaces": False, "near_plane": "occlude"}])
def test_worlds_match_batches_of_their_models(options, device):
    worlds = worlds_of(3)
    batch = batch_of(model_of(BODIES)[0], resizable="all", device=device, **options)
    views = batch.render(poses_of(worlds), model=sizes_of(worlds))
    assert_as_their_own(batch, views, worlds, **options)
    assert len({image.tobytes() for image in views.depth.numpy()}) == 6
    depth = views.depth.numpy()
    again = batch.render(poses_of(worlds), model=sizes_of(worlds), worlds=[2, 0], out=None)
    np.testing.assert_array_equal(
        again.depth.numpy(), depth.reshape(2, 3, HEIGHT, WIDTH)[:, [2, 0]].reshape(4, HEIGHT, -1)
    )


def test_pixels_match_mj_ray(device):
    worlds = worlds_of(2, seed=1)
    batch = batch_of(model_of(BODIES)[0], resizable="all", cull_backfaces=False, device=device)
    views = batch.render(poses_of(worlds), cameras="eye", model=sizes_of(worlds))
    geoms, depth = batch.geom_ids(views).numpy(), views.depth.numpy().astype(np.float64)
    groups, hit = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8), np.zeros(1, dtype=np.int32)
    for world, (model, data) in enumerate(worlds):
        eye, matrix = batch.camera("eye"), poses_to_matrices(camera_poses(data, model, [0])[0])
        rays = reference.pixel_rays(eye)
        lengths = np.linalg.norm(rays, axis=-1)
        rays = rays / lengths[..., None] @ matrix[:3, :3].T
        same = 0
        for pixel in np.ndindex(HEIGHT, WIDTH):
            distance = mujoco.mj_ray(model, data, matrix[:3, 3].copy(), rays[pixel], groups, 1, -1, hit)
            if hit[0] == geoms[world][pixel]:
                same += 1
                if hit[0] >= 0:
                    assert abs(distance / lengths[pixel] - depth[world][pixel]) < 2e-5
        assert same >= 0.998 * HEIGHT * WIDTH


def test_model_sizes_do_not_change_images(device):
    model, data = model_of(BODIES)
    batch = batch_of(model, resizable="all", device=device)
    plain, given = batch.render(data), batch.render(data, model={"geom_size": model.geom_size[None]})
    for name in ALL:
        assert getattr(plain, name).numpy().tobytes() == getattr(given, name).numpy().tobytes()


def test_resizable_selects_by_name_and_pattern(device):
    """Patterns match bodies too. Invisible geoms may have any size, and one row of sizes applies to all worlds."""
    names = ("block", "limb", "ball")
    worlds = worlds_of(2, names=(*names, "hidden"), seed=2)
    batch = batch_of(model_of(BODIES)[0], resizable=["arm", "ba*l"], device=device)
    views = batch.render(poses_of(worlds), model=sizes_of(worlds))
    assert_as_their_own(batch, views, worlds)
    alike = [(worlds[0][0], data) for _, data in worlds]
    views = batch.render(poses_of(worlds), model=sizes_of(worlds[:1]))
    assert_as_their_own(batch, views, alike)


def test_sizes_combine_with_other_fields(device):
    """Static boxes are resized at their poses in each world; objects added to the scene keep their size."""
    worlds = worlds_of(3, seed=3)
    for k, (model, data) in enumerate(worlds):
        model.geom("wall").pos[1] += 0.1 * k
        model.cam_fovy[:] = 50 + 5 * (k % 2)
        model.geom("ball").rgba[3] = k != 1
        mujoco.mj_forward(model, data)
    fields = {name: np.stack([getattr(m, name) for m, _ in worlds]) for name in ("geom_pos", "cam_fovy", "geom_rgba")}
    batch = batch_of(model_of(BODIES)[0], resizable="all", device=device)
    qpos = np.stack([data.qpos for _, data in worlds])
    views = batch.render(qpos, model={**fields, **sizes_of(worlds)})
    assert_as_their_own(batch, views, worlds)
    some = batch.render(qpos, model={**fields, **sizes_of(worlds)}, worlds=[2, 1])
    assert_as_their_own(batch, some, [worlds[2], worlds[1]])
    batch.scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="mine", pose=(0, 0, 0.6, 0, 0, 0, 1), movable=True)
    more = batch.render(qpos, model={**fields, **sizes_of(worlds)})
    mine = more.segmentation.numpy() == batch.scene.index("mine")
    assert mine.any(axis=(1, 2)).all()
    np.testing.assert_array_equal(more.depth.numpy()[~mine], views.depth.numpy()[~mine])


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_resized_geoms_match_reference(caster, device):
    """The reference is a double-precision scene of the world's model."""
    from compare import assert_matches_reference

    ((model, data),) = worlds_of(1, seed=4)
    batch = batch_of(model_of(BODIES)[0], resizable="all", device=device)
    batch._render_options["caster"] = caster
    views = batch.render(data, cameras=["eye"], model=sizes_of([(model, data)]))
    twin = scene_from_mujoco(model, movable="all")
    rows = geom_poses(data, twin)
    scene = wv.Scene()
    for index, item in enumerate(twin.scene.objects):
        moves = index in twin.scene.movable
        pose = rows[twin.scene.movable.index(index)] if moves else (0, 0, 0, 0, 0, 0, 1)
        shape = item.solid if item.solid is not None else (item.mesh_vertices if moves else item.vertices, item.faces)
        scene.add(shape, name=item.name, label=item.label, pose=pose, movable=item.solid is not None)
    eye = camera_poses(data, model, [0])
    assert_matches_reference(views, scene, batch.camera("eye"), eye, cull_backfaces=True, near_plane="clip")


@pytest.mark.parametrize("kind", [kind for kind in TWICE if kind not in ("mesh", "plane")])
def test_later_of_equal_geoms_is_visible_at_any_size(kind, device):
    """The geoms are equal in the model and in one world, or in one world only."""
    model, data = twice(kind, moving=True)
    batch = batch_of(model, resizable=["collision", "visual"], device=device)
    collision, visual = (model.geom(name).id for name in ("collision", "visual"))
    sizes = np.stack([model.geom_size] * 4)
    sizes[1, [collision, visual]] *= 1.3
    sizes[2, collision] *= 1.1
    sizes[3, visual] *= 1.1
    shown = batch.geom_ids(batch.render([data] * 4, model={"geom_size": sizes})).numpy()
    count = np.array([[(image == geom).sum() for geom in (collision, visual)] for image in shown])
    assert (count[[0, 1, 3], 0] == 0).all() and (count[[0, 1, 3], 1] > 30).all()
    assert count[2, 1] == 0 < count[2, 0]
    model.geom_size[collision] *= 0.9
    apart = batch_of(model, resizable=["collision", "visual"], device=device)
    sizes[1, collision] = sizes[1, visual]
    shown = apart.geom_ids(apart.render([data] * 2, model={"geom_size": sizes[:2]})).numpy()
    assert not (shown == collision).any() and (shown == visual).any(axis=(1, 2)).all()


def test_flush_surfaces_match_reference(device):
    """With the model's sizes, other sizes, and a box that becomes flush with another."""
    names = ("table", "mat", "spot", "spot2", "brick", "paper", "block", "plate", "rod", "knob", "tube")
    plain, _ = model_of(FLUSH)
    for factors in ({}, {"mat": 0.8, "spot2": 1.2, "knob": 0.9, "tube": 1.1, "plate": (1, 0.9, 1)}, {"brick": 1.5}):
        model, data = model_of(FLUSH)
        for name, factor in factors.items():
            model.geom(name).size[:] *= factor
        batch = batch_of(plain, resizable=names, height=2 * HEIGHT, width=2 * WIDTH, device=device)
        views = batch.render(data, cameras="eye", model={"geom_size": model.geom_size[None]})
        twin = scene_from_mujoco(model, movable="all")
        bare = wv.Renderer(twin.scene, batch.camera("eye"), outputs=ALL, cull_backfaces=True, near_plane="clip")
        eye, rows = camera_poses(data, model, [0]), geom_poses(data, twin)
        was = bare.render(eye, object_poses=rows)
        images = was.segmentation.numpy()[0], was.depth.numpy()[0]
        expected = reference.show_later(twin.scene, batch.camera("eye"), eye[0], *images, object_poses=rows)
        assert (views.segmentation.numpy()[0] != expected).sum() <= 2
        assert (views.segmentation.numpy()[0] != images[0]).sum() > 30


@pytest.mark.slow
def test_mujoco_warp_model_provides_sizes(device):
    mjwarp = pytest.importorskip("mujoco_warp", reason="the package mujoco_warp is not installed")
    worlds, (plain, data) = worlds_of(3, seed=5), model_of(BODIES)
    for _, each in worlds:
        each.qpos[:] = data.qpos
    for model, each in worlds:
        mujoco.mj_forward(model, each)
    with wp.ScopedDevice(device):
        warp_model, warp_data = mjwarp.put_model(plain), mjwarp.put_data(plain, data, nworld=3)
        batch = batch_of(plain, resizable="all", device=device)
        own = batch.render(warp_data, model=warp_model).depth.numpy()
        warp_model.geom_size = wp.array(sizes_of(worlds)["geom_size"], dtype=wp.vec3)
    views = batch.render(warp_data, model=warp_model)
    assert_as_their_own(batch, views, worlds)
    np.testing.assert_array_equal(own, batch.render(warp_data).depth.numpy())
    if device != "cpu":
        with pytest.raises(wv.errors.ArrayError, match="geom_size must be of 1 world if no geom is resizable"):
            batch_of(plain, device=device).render(warp_data, model=warp_model)


def test_size_kernel_matches_reference(device):
    assert (kernels.SPHERE, kernels.CAPSULE, kernels.ELLIPSOID, kernels.CYLINDER) == tuple(
        int(getattr(mujoco.mjtGeom, f"mjGEOM_{name}")) for name in ("SPHERE", "CAPSULE", "ELLIPSOID", "CYLINDER")
    )
    rng = np.random.default_rng(6)
    own, kinds = rng.uniform(0.1, 1, (6, 3)).astype(np.float32), np.array([0, 2, 3, 4, 5, 6], dtype=np.int32)
    sizes, made = (
        own * rng.uniform(0.5, 2, (2, 6, 3)).astype(np.float32),
        rng.uniform(0.1, 1, (7, 4)).astype(np.float32),
    )
    sizes[1, 5] = own[5]
    geoms, rows = np.array([1, 2, 3, 4, 5, -1, -1], dtype=np.int32), np.array([1, 0, 1], dtype=np.int32)
    types = {"sizes": wp.vec3, "rows": wp.int32, "geoms": wp.int32, "kinds": wp.int32, "own": wp.vec3, "made": wp.vec4}
    values = {"sizes": sizes, "rows": rows, "geoms": geoms, "kinds": kinds, "own": own, "made": made}
    arrays = [wp.array(values[name], dtype=dtype, device=device) for name, dtype in types.items()]
    out = wp.empty((3, 7), dtype=wp.vec4, device=device)
    wp.launch(kernels.geom_sizes, out.shape, [*arrays, out], device=device)
    np.testing.assert_allclose(out.numpy(), reference.geom_sizes(*values.values()), rtol=1e-6)


def test_copies_render_equal_images():
    worlds = worlds_of(2, seed=7)
    batch = batch_of(model_of(BODIES)[0], resizable="all")
    views = batch.render(poses_of(worlds), model=sizes_of(worlds)).depth.numpy()
    for again in (copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))):
        np.testing.assert_array_equal(again.render(poses_of(worlds), model=sizes_of(worlds)).depth.numpy(), views)


MODEL, DATA = model_of(BODIES)
OWN = MODEL.geom_size


def changed(name, value):
    sizes = np.stack([OWN, OWN])
    sizes[1, MODEL.geom(name).id] = value
    return sizes


BAD_SIZES = {
    "fixed size": (
        changed("wall", 1),
        "geom_size of 'wall' must equal the model's, got another in world 1; create the Batch",
    ),
    "fixed, as lists": (changed("wall", 1).tolist(), "with resizable=['wall'] or resizable=\"all\""),
    "a plane": (changed("floor", 1), "planes, height fields and meshes cannot be resized"),
    "a mesh": (changed("hook", 1), "planes, height fields and meshes cannot be resized"),
    "zero": (
        changed("block", 0),
        "geom_size of 'block' must be positive lengths [m] in every world, got [0.0,",
    ),
    "negative": (changed("block", (1, -1, 1)), "got [1.0, -1.0, 1.0] in world 1"),
    "NaN": (changed("block", np.nan), "'block' must be positive lengths [m] in every world, got [nan, nan, nan]"),
    "beyond single precision": (changed("block", 1e39), "got [inf, inf, inf] in world 1"),
    "worlds": (np.stack([OWN] * 3), "geom_size must be of 1 world or of 2, like the poses, got 3"),
    "shape": (OWN[None, :, :2], f"geom_size must be numbers of shape (W, {len(OWN)}, 3), got float64 of shape"),
    "of no world": (OWN, "geom_size must be of 1 world or of 2, like the poses, got"),
    "one number": (2.0, "geom_size must be an array of 1 or 2 worlds, got 2.0"),
    "words": ("large", "geom_size must be an array of numbers"),
    "flags": (OWN[None] > 0, f"geom_size must be numbers of shape (W, {len(OWN)}, 3), got bool"),
}


@pytest.mark.parametrize("name", BAD_SIZES)
def test_invalid_sizes_are_rejected(name):
    given, said = BAD_SIZES[name]
    batch = batch_of(MODEL, resizable=["block"])
    models = [{"geom_size": given}, SimpleNamespace(geom_size=given)]
    for model in models[:1] if name == "of no world" else models:  # in MJX's model, such a field is that of all worlds
        with pytest.raises(wv.errors.ArrayError) as error:
            batch.render([DATA, DATA], model=model)
        assert said in str(error.value)


@pytest.mark.parametrize(
    ("resizable", "said"),
    [
        (["nobody"], "'nobody' in resizable must match a geom or body of the model"),
        (
            ["block", "floor"],
            "'floor' in resizable must match a geom that is a box, sphere, capsule, cylinder or ellipsoid",
        ),
        ("block", "resizable must be \"all\", or a list of names or patterns of names, got 'block'"),
        ([3], "resizable must be names or patterns of names, got 3"),
        (None, "resizable must be"),
    ],
)
def test_invalid_resizable_is_rejected(resizable, said):
    with pytest.raises(wv.errors.SceneError) as error:
        batch_of(MODEL, resizable=resizable)
    assert said in str(error.value)


def test_unused_size_components_are_ignored(device):
    """A sphere has one size, a capsule two."""
    sizes = np.stack([OWN, OWN])
    sizes[:, MODEL.geom("ball").id, 1:] = np.nan
    sizes[:, MODEL.geom("limb").id, 2] = -1
    batch = batch_of(MODEL, resizable="all", device=device)
    views, plain = batch.render([DATA] * 2, model={"geom_size": sizes}), batch.render([DATA] * 2)
    np.testing.assert_allclose(views.depth.numpy(), plain.depth.numpy(), atol=1e-6)


def test_invalid_sizes_do_not_affect_other_worlds(device):
    """Sizes on a GPU are not validated: invalid ones may render anything, but do not affect other worlds."""
    batch = batch_of(MODEL, resizable="all", device=device)
    batch._resizable._checked = lambda given: True
    for value in (0.0, -1.0, np.nan, np.inf, 1e-30, 1e30):
        sizes = np.stack([np.full_like(OWN, value), OWN])
        views = batch.render([DATA] * 2, model={"geom_size": sizes}).by_world()
        np.testing.assert_array_equal(views.depth.numpy()[1], batch.render(DATA).depth.numpy())
        assert not np.isnan(views.depth.numpy()).any()
