# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Where surfaces of several geoms coincide, the later geom is shown, as in MuJoCo's image."""

import copy
import pickle

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.mujoco import BatchRenderer, Renderer, geom_poses, scene_from_mujoco
from warpvis.mujoco._coinciding import find_pairs
from warpvis.mujoco._geom_renderer import CoincidingGeoms, GeomRenderer

import reference
from support.coinciding import FLUSH, HEAD, TWICE, eye_of, model_of, renderer_of, twice
from support.mujoco_renderer import images


@pytest.mark.smoke("*-packets-*")
@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("kind", TWICE)
def test_later_of_two_equal_geoms_is_shown(kind, moving, device, caster):
    if kind == "plane" and moving:
        pytest.skip("MuJoCo's planes do not move")
    model, data = twice(kind, moving=moving)
    geoms, renderer = renderer_of(model, device, outputs=("segmentation", "depth"), caster=caster, cull_backfaces=True)
    given = {"object_poses": geom_poses(data, geoms)[None]} if geoms.scene.movable else {}
    seen = renderer.render(eye_of(model, data), **given).segmentation.numpy()
    assert (seen == geoms.scene.index("visual")).sum() > 300
    assert not (seen == geoms.scene.index("collision")).any()
    single = scene_from_mujoco(model, device=device, exclude=("visual",))
    given = {"object_poses": geom_poses(data, single)[None]} if single.scene.movable else {}
    options = {"outputs": ("segmentation",), "caster": caster, "cull_backfaces": True}
    alone = wv.render(single.scene, renderer.camera, eye_of(model, data), **options, **given).segmentation.numpy()
    assert np.array_equal(alone == single.scene.index("collision"), seen == geoms.scene.index("visual"))


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("kind", ["sphere", "ellipsoid", "capsule", "cylinder"])
def test_solids_coincide_beyond_their_triangles(kind, moving, device):
    """Viewed along the axes, where coarse triangles end before the exact surface."""
    joint = "<freejoint/>" if moving else ""
    pair = f"<geom {TWICE[kind]}/>" * 2
    model, data = model_of(f"{HEAD}<body>{joint}{pair}</body></worldbody></mujoco>")
    geoms = scene_from_mujoco(model, mesh_tolerance=5e-3, device=device)
    eyes = np.array([[0, 0, -1, 0, 0, 0, 1], [-1, 0, 0, 0.5, 0.5, 0.5, 0.5], [1, 0, 0, 0.5, -0.5, -0.5, 0.5]])
    sides = [[0, -1, 0, -np.sqrt(0.5), 0, 0, np.sqrt(0.5)], [0, 1, 0, np.sqrt(0.5), 0, 0, np.sqrt(0.5)]]
    coinciding = CoincidingGeoms(model, geoms.scene, geoms.geom_ids)
    camera = wv.Camera.from_fov(120, 90, hfov=0.6)
    renderer = GeomRenderer(geoms.scene, camera, coinciding, outputs=("segmentation",), cull_backfaces=True)
    views = renderer.render(np.concatenate([eyes, sides]), object_poses=geom_poses(data, geoms)[None])
    seen = views.segmentation.numpy()
    assert ((seen == 1).sum(axis=(1, 2)) > 500).all() and not (seen == 0).any()


@pytest.mark.smoke("*-packets-True", "*-rays-False")
@pytest.mark.parametrize("cull_backfaces", [True, False])
def test_flush_surfaces_match_the_reference(cull_backfaces, device, caster):
    model, data = model_of(FLUSH)
    geoms, renderer = renderer_of(
        model, device, outputs=("segmentation", "depth"), caster=caster, cull_backfaces=cull_backfaces
    )
    plain = wv.Renderer(geoms.scene, renderer.camera, caster=caster, cull_backfaces=cull_backfaces)
    changed, shown = 0, set()
    for turn in range(3):
        data.qpos[3:7] = np.array([1, 0.2 + turn, 0.3, 0.1 - turn]) / np.linalg.norm([1, 0.2 + turn, 0.3, 0.1 - turn])
        mujoco.mj_forward(model, data)
        places, eye = geom_poses(data, geoms), eye_of(model, data)
        for excluded in ((), ("mat", "knob")):
            given = {"object_poses": places[None], "exclude": excluded}
            seen, before = renderer.render(eye, **given), plain.render(eye, **given)
            was, depth = before.segmentation.numpy()[0], before.depth.numpy()[0]
            indices = {geoms.scene.index(name) for name in excluded}
            expected = reference.show_later(
                geoms.scene,
                renderer.camera,
                eye[0],
                was,
                depth,
                object_poses=places,
                excluded=indices,
                cull_backfaces=cull_backfaces,
            )
            now = seen.segmentation.numpy()[0]
            assert np.array_equal(seen.depth.numpy()[0], depth)
            # At the border of a surface, single and double precision may differ in a pixel.
            assert (now != expected).sum() <= 2
            assert not set(np.unique(now)) & indices
            changed += int((now != was).sum())
            shown |= set(np.unique(now).tolist())
    assert changed > 1000  # corrections were needed
    names = ("mat", "spot", "spot2", "brick", "paper", "plate", "knob", "tube", "hoof")
    assert {geoms.scene.index(name) for name in names} <= shown


def test_only_segmentation_and_labels_change(device, caster):
    model, data = model_of(FLUSH)
    geoms = scene_from_mujoco(model, device=device, labels={"mat": "object", "plate": "robot"})
    camera, coinciding = wv.mujoco.camera_from_mujoco(model, "eye", 160, 120), CoincidingGeoms(model, geoms.scene)
    coinciding.follow(geoms.geom_ids)
    given = {"object_poses": geom_poses(data, geoms)[None]}
    names = ("depth", "points", "normals", "labels", "segmentation")
    options = {"outputs": names, "caster": caster, "cull_backfaces": True}
    plain = wv.Renderer(geoms.scene, camera, **options).render(eye_of(model, data), **given)
    seen = GeomRenderer(geoms.scene, camera, coinciding, **options).render(eye_of(model, data), **given)
    for name in ("depth", "points", "normals"):
        assert np.array_equal(getattr(seen, name).numpy(), getattr(plain, name).numpy(), equal_nan=True)
    objects = seen.segmentation.numpy()
    assert (objects != plain.segmentation.numpy()).any()
    of_object = np.array([int(item.label) for item in geoms.scene.objects] + [0])
    assert np.array_equal(seen.labels.numpy(), of_object[objects])
    for name in ("labels", "segmentation"):  # depth is rendered internally
        single = GeomRenderer(geoms.scene, camera, coinciding, **(options | {"outputs": (name,)}))
        again = single.render(eye_of(model, data), **given)
        assert np.array_equal(getattr(again, name).numpy(), getattr(seen, name).numpy())
        assert again.depth is None
        repeated = single.render(eye_of(model, data), **given, out=again)
        assert np.array_equal(getattr(repeated, name).numpy(), getattr(seen, name).numpy())


def test_worlds_of_a_batch(device):
    """Movable geoms have a pose in each world; geoms that have moved apart do not coincide."""
    text = f"""{HEAD}<geom name="floor" type="plane" size="2 2 .1"/><body name="cube"><freejoint/>
      <geom name="collision" type="box" size=".1 .1 .1"/><geom name="visual" type="box" size=".1 .1 .1"/></body>
      </worldbody></mujoco>"""
    model, _ = model_of(text)
    batch = BatchRenderer(model, 3, height=60, width=80, outputs=("segmentation", "labels"), device=device)
    qpos = np.array([[x, 0.1, 0.1, 1, 0, 0, x] for x in (-0.2, 0.1, 0.3)])
    seen = batch.render(qpos)
    ids = batch.geom_ids(seen).numpy()
    assert ((ids == 2).sum(axis=(1, 2)) > 50).all()
    assert not (ids == 1).any()
    for again in (copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))):
        assert np.array_equal(again.geom_ids(again.render(qpos)).numpy(), ids)
    apart = scene_from_mujoco(model, movable="all", device=device)
    poses = geom_poses(batch.kinematics.from_qpos(qpos), apart)
    column = [apart.scene.objects[index].name for index in apart.scene.movable].index("visual")
    poses[:, column, 2] += 0.5
    coinciding = CoincidingGeoms(model, apart.scene, apart.geom_ids)
    camera = wv.mujoco.camera_from_mujoco(model, "eye", 80, 60)
    renderer = GeomRenderer(apart.scene, camera, coinciding, outputs=("segmentation",), cull_backfaces=True)
    eye = eye_of(*model_of(text))
    objects = renderer.render(np.repeat(eye, 3, axis=0), object_poses=poses).segmentation.numpy()
    plain = wv.Renderer(apart.scene, camera, outputs=("segmentation",), cull_backfaces=True)
    assert np.array_equal(objects, plain.render(np.repeat(eye, 3, axis=0), object_poses=poses).segmentation.numpy())
    assert ((objects == apart.scene.index("collision")).sum(axis=(1, 2)) > 50).all()


def test_each_view_has_its_own_exclusions(device, caster):
    model, data = twice("sphere", moving=True)
    geoms, renderer = renderer_of(model, device, outputs=("segmentation",), caster=caster, cull_backfaces=True)
    eye = np.repeat(eye_of(model, data), 2, axis=0)
    flags = np.zeros((2, len(geoms.scene)), dtype=np.uint8)
    flags[1, geoms.scene.index("visual")] = 1
    seen = renderer.render(eye, object_poses=geom_poses(data, geoms)[None], exclude=flags).segmentation.numpy()
    collision, visual = (seen == geoms.scene.index(name) for name in ("collision", "visual"))
    assert visual[0].sum() > 500
    assert not visual[1].any()
    assert np.array_equal(collision[1], visual[0])


def test_renderer_follows_changes_of_opacity_and_size(device):
    model, data = twice("box", moving=False)
    renderer = Renderer(model, 60, 80, device=device)
    collision, visual = (model.geom(name).id for name in ("collision", "visual"))

    def shown():
        ids = images(renderer, data, "eye")[1][..., 0]
        return (ids == collision).sum(), (ids == visual).sum()

    assert shown()[0] == 0 < shown()[1]
    model.geom_rgba[visual, 3] = 0
    assert shown()[1] == 0 < shown()[0]
    model.geom_rgba[visual, 3] = 1
    model.geom_size[visual] *= 0.9  # inside the other one
    assert shown()[1] == 0 < shown()[0]
    model.geom_size[collision] *= 0.9
    assert shown()[0] == 0 < shown()[1]
    model.geom_size[visual] *= 1.2
    model.geom_size[collision] *= 1.2
    assert shown()[0] == 0 < shown()[1]


def test_no_pairs_without_coinciding_geoms(device):
    text = f"""{HEAD}<geom name="floor" type="plane" size="2 2 .1"/><geom type="box" size=".1 .1 .1" pos="0 0 .1"/>
      <body pos="0 0 .5"><freejoint/><geom type="capsule" size=".1 .2"/><geom type="sphere" size=".15"/></body>
      </worldbody></mujoco>"""
    model, _ = model_of(text)
    geoms = scene_from_mujoco(model, device=device)
    assert CoincidingGeoms(model, geoms.scene, geoms.geom_ids).find() is None


def names_of(pairs, scene):
    objects = scene.objects
    rows = zip(pairs.earlier, pairs.later, strict=True)
    return {(objects[earlier].name, objects[later].name) for earlier, later in rows}


def scene_of(*meshes):
    scene = wv.Scene()
    for name, mesh in meshes:
        scene.add(mesh, name=name)
    return scene


def brick(extents, middle):
    return trimesh.creation.box(extents, trimesh.transformations.translation_matrix(middle))


def test_pairs_share_a_plane_and_overlap():
    scene = scene_of(
        ("table", brick((1, 1, 0.1), (0, 0, 0))),
        ("flush", brick((0.2, 0.2, 0.04), (0.3, 0.2, 0.03))),
        ("nearly", brick((0.2, 0.2, 0.04), (-0.3, 0.2, 0.03 + 3e-8))),
        ("lower", brick((0.2, 0.2, 0.04), (0.3, -0.2, 0.0299))),
        ("on_top", brick((0.2, 0.2, 0.04), (-0.3, -0.2, 0.07))),
        ("beside", brick((0.2, 0.2, 0.1), (0.7, 0, 0))),
        ("far", brick((0.2, 0.2, 0.1), (9, 0, 0))),
    )
    pairs = find_pairs(scene.objects, np.zeros(7, dtype=int))
    assert names_of(pairs, scene) >= {("table", "flush"), ("table", "nearly")}
    assert {name for pair in names_of(pairs, scene) for name in pair} <= {"table", "flush", "nearly", "beside"}
    flush = scene["flush"]
    corners = flush.vertices[flush.faces[pairs.faces[scene.index("flush")]]]
    assert len(corners) == 2
    assert np.allclose(corners[..., 2], 0.05)
    others = find_pairs(scene.objects, np.arange(7))
    assert names_of(others, scene) == names_of(pairs, scene)
    top = np.array([[0.2, 0.1, 0.05], [0.4, 0.3, 0.05]])  # of the whole mesh, which may move
    assert np.abs(others.boxes[others.later == scene.index("flush")] - top).max() < 1e-6
    resized = find_pairs(scene.objects, np.arange(7), resizable=[scene.index("flush")])
    assert np.isinf(resized.boxes[resized.later == scene.index("flush")]).all()


LINK = """<body pos="0 0 .2"><joint name="{0}" axis="0 1 0"/>
  <geom name="{0}" type="capsule" size=".05 .15"/></body>"""
ACROSS = {
    "links": LINK.format("left") + LINK.format("right"),
    "drawer": """<geom name="floor" type="box" size=".3 .2 .02"/><body><joint type="slide" axis="1 0 0"/>
      <geom name="tray" type="box" size=".2 .1 .01" pos="0 0 .01"/></body>""",
    "meshes": """<geom name="still" type="mesh" mesh="wedge"/><body><joint type="slide" axis="1 0 0"/>
      <geom name="moves" type="mesh" mesh="wedge"/></body>""",
}


@pytest.mark.gl
@pytest.mark.parametrize("name", ACROSS)
def test_coinciding_geoms_of_moving_bodies_match_mujoco(name, device):
    model, data = model_of(f"{HEAD}{ACROSS[name]}</worldbody></mujoco>")
    batch = BatchRenderer(model, height=120, width=160, outputs=("segmentation",), device=device)
    with mujoco.Renderer(model, 120, 160) as theirs, Renderer(model, 120, 160, device=device) as renderer:
        expected, seen = (images(which, data, "eye")[1] for which in (theirs, renderer))
    assert (seen == expected).all(axis=-1).mean() > 0.99 and (seen[..., 0] == 1).sum() > 200
    assert np.array_equal(batch.geom_ids(batch.render(data)).numpy()[0], seen[..., 0])


@pytest.mark.parametrize("name", ACROSS)
def test_coinciding_geoms_of_moved_bodies_match_the_reference(name, device):
    """The drawer stays flush with the floor, and the moving mesh with the static one."""
    model, data = model_of(f"{HEAD}{ACROSS[name]}</worldbody></mujoco>")
    geoms, renderer = renderer_of(model, device, outputs=("segmentation", "depth"), cull_backfaces=True)
    plain, changed = wv.Renderer(geoms.scene, renderer.camera, cull_backfaces=True), 0
    for place in (0.0, 0.05, 0.17, -0.13):
        data.qpos[0] = place
        mujoco.mj_forward(model, data)
        rows, eye = geom_poses(data, geoms), eye_of(model, data)
        seen, before = (one.render(eye, object_poses=rows[None]) for one in (renderer, plain))
        was, depth = before.segmentation.numpy()[0], before.depth.numpy()[0]
        expected = reference.show_later(geoms.scene, renderer.camera, eye[0], was, depth, object_poses=rows)
        now = seen.segmentation.numpy()[0]
        assert (now != expected).sum() <= 2
        changed += int((now != was).sum())
    assert changed > 200


def test_equal_meshes_store_no_triangles():
    ball = trimesh.creation.icosphere(subdivisions=3)
    mixed = trimesh.Trimesh(ball.vertices, ball.faces[::-1], process=False)
    inside_out = trimesh.Trimesh(ball.vertices, ball.faces[:, ::-1], process=False)
    scene = scene_of(("one", ball), ("equal", ball.copy()), ("mixed", mixed), ("inside_out", inside_out))
    pairs = find_pairs(scene.objects, np.zeros(4, dtype=int))
    assert names_of(pairs, scene) == {("one", "equal"), ("one", "mixed"), ("equal", "mixed")}
    assert pairs.same.tolist() == [True, False, False]
    assert set(pairs.faces) == {2}
    assert len(pairs.faces[2]) == len(ball.faces)


def test_pairs_include_slivers_of_coinciding_meshes():
    """Another exporter rounded the vertices differently: normals of thin triangles are arbitrary."""
    bowl = trimesh.creation.capsule(height=0.2, radius=0.1, count=[64, 64])
    rounded = trimesh.Trimesh(np.round(bowl.vertices, 6), bowl.faces[::-1], process=False)
    scene = scene_of(("one", bowl), ("other", rounded))
    pairs = find_pairs(scene.objects, np.zeros(2, dtype=int))
    assert names_of(pairs, scene) == {("one", "other")}
    assert len(pairs.faces[1]) == len(bowl.faces)


def test_solids_are_paired_by_their_exact_surfaces():
    text = f"""{HEAD}<body><freejoint/>
      <geom name="rod" type="capsule" size=".1 .3"/>
      <geom name="end" type="sphere" size=".1" pos="0 0 .3"/>
      <geom name="sleeve" type="cylinder" size=".1 .2"/>
      <geom name="wide" type="cylinder" size=".12 .2"/>
      <geom name="crossing" type="capsule" size=".1 .3" euler="90 0 0"/>
      <geom name="block" type="box" size=".2 .2 .1" pos=".25 0 .1"/></body></worldbody></mujoco>"""
    model, _ = model_of(text)
    scene = scene_from_mujoco(model).scene
    pairs = find_pairs(scene.objects, np.zeros(len(scene), dtype=int))
    flat = {("sleeve", "wide"), ("sleeve", "block"), ("wide", "block")}  # their upper ends
    assert names_of(pairs, scene) == {("rod", "end"), ("rod", "sleeve")} | flat


@pytest.mark.smoke("*-cylinder", "*-sphere")
@pytest.mark.gl
@pytest.mark.parametrize("kind", TWICE)
def test_segmentation_matches_mujoco(kind, device):
    model, data = twice(kind, moving=kind != "plane")
    renderer = Renderer(model, 120, 160, device=device, mesh_tolerance=1e-4)
    with mujoco.Renderer(model, 120, 160) as theirs:
        expected, seen = (images(which, data, "eye")[1] for which in (theirs, renderer))
    assert (expected[..., 0] == model.geom("visual").id).sum() > 300
    assert not (seen[..., 0] == model.geom("collision").id).any()
    assert (seen == expected).all(axis=-1).mean() > 0.99
