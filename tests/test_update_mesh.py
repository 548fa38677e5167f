# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `Scene.update_mesh`: the new mesh is rendered, and nothing else changes."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.errors import SceneError
from warpvis.kernels.bvh.ranges_cuda import check_mesh
from warpvis.scene import _updates, solids
from warpvis.scene.acceleration import geometry, scene_trees, tree_cache
from warpvis.scene.acceleration.geometry import build_scene_bvh
from warpvis.scene.acceleration.scene_trees import splice_bvh

import reference
from support.refit import ALL, BALL, SMALL, assert_seen, eyes
from support.worlds import assert_bits_equal

BOX, CONE = trimesh.creation.box((0.5, 0.4, 0.3)), trimesh.creation.cone(radius=0.3, height=0.5)
POSES = np.array([[-0.6, 0.1, 0.4, 0, 0, 0.6, 0.8], [0.7, -0.2, 0.5, 0.6, 0, 0, 0.8]])
# Half a ball: open, so that its inner side is visible.
SLICE = BALL.submesh([np.flatnonzero(BALL.triangles_center[:, 0] < 0.05)], append=True)
HALF = (SLICE.vertices * 0.4, SLICE.faces)


def build(device, first, second, movable=True):
    """Return a floor and two objects; the meshes are pairs of vertices and faces, or anything `Scene.add` accepts."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((4, 4, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    for name, mesh, pose in zip(("first", "second"), (first, second), POSES, strict=True):
        scene.add(mesh, name=name, label="human", pose=pose, movable=movable)
    return scene


def in_world(mesh, pose):
    """Return a mesh's vertices in world coordinates."""
    scene = wv.Scene()
    scene.add(mesh, name="it", pose=pose)
    return scene["it"].vertices


def update(scene, name, mesh, **options):
    vertices, faces = (mesh.vertices, mesh.faces) if hasattr(mesh, "faces") else mesh
    if not scene[name].movable:
        vertices = in_world((vertices, faces), POSES[("first", "second").index(name)])
    scene.update_mesh(name, vertices, faces, **options)


@pytest.mark.parametrize("movable", [True, False])
def test_new_mesh_is_rendered(movable, device, caster):
    """Before and after the first render; larger and smaller, closed and open meshes."""
    scene = build(device, BOX, BOX, movable)
    for first, second in [(CONE, BOX), (HALF, BOX), (HALF, BALL), (BOX, HALF), (BOX, BOX)]:
        update(scene, "first", first)
        update(scene, "second", second)
        assert_seen(scene, build("cpu", first, second, movable=False), caster)
    item = scene["first"]
    assert (item.name, item.label, item.movable, scene.index("first")) == ("first", wv.Label.HUMAN, movable, 1)
    assert scene.movable == ((1, 2) if movable else ())


@pytest.mark.parametrize("movable", [True, False])
def test_next_call_of_a_renderer_uses_the_new_mesh(movable, device, caster):
    scene = build(device, BOX, BOX, movable)
    renderer = wv.Renderer(scene, SMALL, outputs=ALL, caster=caster)
    before = renderer.render(eyes(2))
    poses = np.tile(POSES, (2, 1, 1)) if movable else None
    update(scene, "first", HALF)
    after = renderer.render(eyes(2), object_poses=poses)
    assert_bits_equal(after, wv.render(build(device, HALF, BOX, movable), SMALL, eyes(2), outputs=ALL, caster=caster))
    update(scene, "first", BOX)
    assert_bits_equal(renderer.render(eyes(2), out=after), before)


def test_objects_sharing_the_mesh_keep_it(device):
    scene = wv.Scene(device=device)
    scene.add_instances(BOX, [*POSES, [0, 0.8, 0.4, 0, 0, 0, 1]], names="box")
    others = [scene[name].mesh_vertices for name in ("box_0", "box_2")]
    scene.update_mesh("box_1", CONE.vertices, CONE.faces)
    assert len(scene["box_1"].faces) == len(CONE.faces)
    assert [scene[name].mesh_vertices is kept for name, kept in zip(("box_0", "box_2"), others, strict=True)] == [1, 1]
    assert len(BOX.faces) == len(scene["box_0"].faces) == 12
    twin = wv.Scene()
    for name, mesh in zip(("box_0", "box_1", "box_2"), (BOX, CONE, BOX), strict=True):
        twin.add(mesh, name=name, pose=scene[name].pose)
    assert_seen(scene, twin, "packets")


def test_only_changed_trees_are_rebuilt(monkeypatch):
    """Neither other objects nor the updated one are tested for closedness again."""
    built, asked = [], []
    build_bvh, provably_closed = tree_cache.build_bvh, tree_cache.provably_closed
    monkeypatch.setattr(tree_cache, "build_bvh", lambda *a, **k: built.append(len(a[1])) or build_bvh(*a, **k))
    monkeypatch.setattr(tree_cache, "provably_closed", lambda v, f: asked.append(len(f)) or provably_closed(v, f))
    scene = build("cpu", CONE, BALL)
    update(scene, "second", HALF)
    scene.bvh()
    assert (built, asked) == ([12, len(CONE.faces), len(HALF[1])], [12, len(CONE.faces)])
    built.clear(), asked.clear()
    update(scene, "second", BALL)
    scene.bvh()
    assert (built, asked) == ([len(BALL.faces)], [])


def trees_of(built):
    """Return for each movable object its tree's leaves with owners, and nodes."""
    struct, found = built.struct, []
    lanes = 16 if struct.leaves.device.is_cpu else 32
    children, owners = (getattr(struct, name).numpy().reshape(-1, lanes) for name in ("children", "owners"))
    nodes, leaves = struct.nodes.numpy().reshape(-1, 10, lanes), struct.leaves.numpy().reshape(-1, 9, lanes)
    roots, first_leaves = struct.movable_root.numpy(), struct.movable_leaf.numpy()
    for root, first in zip(roots.tolist(), first_leaves.tolist(), strict=True):
        below, held = [root], []
        while below:
            node = below.pop()
            held.append(nodes[node].tobytes())
            for child in children[node][children[node] != 0].tolist():
                assert child > root or ~child >= first
                below += [child] if child > 0 else []
                held += [leaves[~child].tobytes() + owners[~child].tobytes()] if child < 0 else []
        found.append(held)
    return found


def test_update_after_render_builds_one_tree(device, monkeypatch):
    """The casters' data equals that of a scene built from scratch, in size and for each object."""
    scene = build(device, CONE, BALL)
    scene.add_instances(BOX, [*POSES], names="box")
    scene.bvh(), scene.triangles()
    built, meshes = [], []
    for name in ("build_bvh", "build_device_bvh"):
        make = getattr(tree_cache, name)
        monkeypatch.setattr(tree_cache, name, lambda *a, make=make, **k: built.append(1) or make(*a, **k))
    make_mesh = geometry.make_mesh
    for module in (geometry, scene_trees):
        monkeypatch.setattr(module, "make_mesh", lambda *a: meshes.append(1) or make_mesh(*a))
    for name, mesh in [("first", HALF), ("second", CONE), ("box_0", BALL), ("box_1", HALF), ("first", BOX)]:
        built.clear(), meshes.clear()
        update(scene, name, mesh, closed=mesh is not HALF)
        bvh = scene.bvh()
        scene.triangles()
        assert (len(built), len(meshes)) == (1, 1)
        fresh = scene.to(device).bvh()
        assert trees_of(bvh) == trees_of(fresh)
        assert bvh.depth >= fresh.depth
    for name in ("movable_first_id", "movable_closed", "movable_boxes", "movable_object", "movable_solid"):
        np.testing.assert_array_equal(getattr(bvh.struct, name).numpy(), getattr(fresh.struct, name).numpy())
    for name in ("leaves", "owners", "nodes", "children"):
        assert len(getattr(bvh.struct, name)) == len(getattr(fresh.struct, name))
    assert bvh.bytes_per_triangle == pytest.approx(fresh.bytes_per_triangle)


def test_deforming_objects_still_deform(device, caster):
    scene = build(device, BOX, BOX)
    scene.update_vertices("second", BOX.vertices * 1.1)
    scene.bvh(), scene.triangles()
    update(scene, "first", HALF)
    for factor in (0.7, 1.3):
        scene.update_vertices("second", BOX.vertices * factor)
        assert_seen(scene, build("cpu", HALF, (BOX.vertices * factor, BOX.faces), movable=False), caster)


def on_device(mesh, device="cpu"):
    """Return a mesh as arrays on a device, as accepted by `Scene.update_mesh`."""
    vertices, faces = (mesh.vertices, mesh.faces) if hasattr(mesh, "faces") else mesh
    return wp.array(np.float32(vertices), device=device), wp.array(np.int32(faces), device=device)


def exchanged(monkeypatch, vertices, faces):
    """Return the updated object, treating Warp's CPU arrays as GPU arrays."""
    monkeypatch.setattr(_updates, "on_gpu", lambda value: isinstance(value, wp.array))
    item = build("cpu", BOX, BOX)["first"]
    return _updates.with_mesh(item, vertices, faces, wp.get_device("cpu"))


def test_gpu_mesh_is_copied_and_fetched_lazily(monkeypatch):
    """Later changes of the given arrays have no effect."""
    given = on_device(HALF)
    item = exchanged(monkeypatch, *given)
    assert isinstance(item.mesh.source, wp.array) and not item.mesh.deforms
    assert (item.triangle_count, item.movable, item.name, item.label) == (len(HALF[1]), True, "first", 4)
    for array in given:
        array.zero_()
    expected = build("cpu", HALF, BOX)["first"]
    for one in (item, pickle.loads(pickle.dumps(item))):
        for name in ("mesh_vertices", "faces", "vertices", "pose", "bounds"):
            np.testing.assert_array_equal(getattr(one, name), getattr(expected, name))
    with pytest.raises(AttributeError, match="no attribute 'color'"):
        _ = item.color
    mesh = geometry.make_mesh(item.mesh, wp.get_device("cpu"))
    np.testing.assert_array_equal(mesh.points.numpy(), expected.mesh_vertices)


@pytest.mark.parametrize("closed", [False, True])
def test_gpu_mesh_tree_is_built_and_spliced(monkeypatch, closed):
    item = exchanged(monkeypatch, *on_device(BALL))
    scene = build("cpu", BOX, CONE)
    built = build_scene_bvh(scene.objects, scene.device, lanes=32)
    tree = tree_cache.build_object_tree(item, closed, 32, scene.device)
    assert (tree.lanes, tree.triangle_count) == (32, len(BALL.faces))
    assert (tree.nodes.numpy().reshape(-1, 10, 32)[:, 9].min() < 2) == closed
    spliced = splice_bvh(built, 0, tree, closed=closed, old_count=12).struct
    np.testing.assert_array_equal(spliced.leaves[-len(tree.leaves) :].numpy(), tree.leaves.numpy())
    np.testing.assert_array_equal(spliced.owners[-len(tree.owners) :].numpy(), -1 if closed else 0)
    box = spliced.movable_boxes.numpy()[:6]
    np.testing.assert_array_equal(box, np.concatenate([item.mesh_vertices.min(axis=0), item.mesh_vertices.max(axis=0)]))


BAD_ON_DEVICE = {
    "NaN": (np.where(np.arange(24).reshape(8, 3) > 5, np.nan, BOX.vertices), BOX.faces, "6 are not, the first at 2$"),
    "far away": (
        BOX.vertices * 1e19,
        BOX.faces,
        "within 1e18 m of the origin of its frame: 8 are not, the first at 0$",
    ),
    "no such corner": (BOX.vertices[:7], BOX.faces, "must index its 7 vertices, got indices from 0 to 7$"),
    "negative": (BOX.vertices, BOX.faces - 1, "must index its 8 vertices, got indices from -1 to 6$"),
    "no triangles": (BOX.vertices, BOX.faces[:0], "must have triangles, got none$"),
    "flat": (BOX.vertices.ravel(), BOX.faces, "vertices of 'first' must have dtype wp.vec3, got float32$"),
}


@pytest.mark.parametrize("case", BAD_ON_DEVICE)
def test_invalid_gpu_mesh_raises(monkeypatch, case):
    vertices, faces, message = BAD_ON_DEVICE[case]
    with pytest.raises(SceneError, match=message):
        exchanged(monkeypatch, *on_device((vertices, faces)))


def test_check_kernel_matches_reference(device):
    rng = np.random.default_rng(0)
    vertices, faces = rng.normal(size=(5000, 3)), rng.integers(-4, 6000, (700, 3))
    vertices[rng.integers(0, 5000, 9), 1] = [np.nan, np.inf, -np.inf, 2, -2, 8, 9, 1e30, 3]
    vertices = np.float32(vertices)
    found = wp.array([0, 2**31 - 1, 2**31 - 1, -(2**31)], dtype=wp.int32, device=device)
    arrays = wp.array(vertices, dtype=wp.vec3, device=device), wp.array(faces, dtype=wp.int32, device=device)
    wp.launch(check_mesh, dim=5000, inputs=[*arrays, 2.5, found], device=device)
    assert found.numpy().tolist() == reference.check_mesh(vertices, faces, 2.5)


@pytest.mark.parametrize("movable", [True, False])
def test_closed_option_culls_back_faces(movable, device):
    """Closed meshes look unchanged; for half a ball, only the flag is checked."""
    scene, flags = build(device, BALL, BOX, movable), []
    for mesh, closed in [(CONE, False), (CONE, True), (HALF, False), (HALF, True)]:
        update(scene, "first", mesh, closed=closed)
        struct = scene.bvh().struct
        flags.append(bool(struct.movable_closed.numpy()[0]) if movable else 1 in struct.closed_object.numpy())
        if mesh is CONE or not closed:
            assert_seen(scene, build("cpu", mesh, BOX, movable=False), "packets")
    assert flags == [False, True, False, True]


def test_vertex_and_mesh_updates_alternate(device, caster):
    scene = build(device, BOX, BOX)
    scene.update_mesh("first", BOX.vertices * 1.3)
    assert_seen(scene, build("cpu", (BOX.vertices * 1.3, BOX.faces), BOX, movable=False), caster)
    scene.update_vertices("first", BOX.vertices * 0.7)
    assert_seen(scene, build("cpu", (BOX.vertices * 0.7, BOX.faces), BOX, movable=False), caster)
    update(scene, "first", CONE)
    assert_seen(scene, build("cpu", CONE, BOX, movable=False), caster)
    scene.update_vertices("first", CONE.vertices * 0.8)
    assert_seen(scene, build("cpu", (CONE.vertices * 0.8, CONE.faces), BOX, movable=False), caster)


def test_solid_is_replaced_by_the_mesh(device, caster):
    scene = build(device, solids.sphere(0.4), BOX)
    update(scene, "first", HALF)
    assert scene["first"].solid is None
    assert_seen(scene, build("cpu", HALF, BOX, movable=False), caster)


def test_copies_of_the_scene_have_the_new_mesh(device):
    scene = build(device, BOX, BOX)
    update(scene, "second", HALF)
    expected = wv.render(scene, SMALL, eyes(1), outputs=ALL)
    for copy in (scene.to(device), pickle.loads(pickle.dumps(scene))):
        assert_bits_equal(wv.render(copy, SMALL, eyes(1), outputs=ALL), expected)
    assert len(scene.to_trimesh().geometry["second"].faces) == len(HALF[1])
    assert scene.triangle_count == 24 + len(HALF[1])


@pytest.mark.parametrize("form", ["list", "double", "vec3", "floats", "torch"])
def test_mesh_arrays_accept_several_forms(form, device):
    """Faces of any integer type, on the CPU and a GPU."""
    vertices, faces = np.float32(CONE.vertices), np.int32(CONE.faces)
    forms = {
        "list": lambda: (vertices.tolist(), faces.tolist()),
        "double": lambda: (vertices.astype(np.float64), faces.astype(np.uint16)),
        "vec3": lambda: (
            wp.array(vertices, dtype=wp.vec3, device=device),
            wp.array(faces, dtype=wp.vec3i, device=device),
        ),
        "floats": lambda: (wp.array(vertices, device=device), wp.array(faces, device=device)),
        "torch": lambda: tuple(pytest.importorskip("torch").tensor(part, device=device) for part in (vertices, faces)),
    }
    scene = build(device, BOX, BOX)
    scene.update_mesh("first", *forms[form]())
    np.testing.assert_array_equal(scene["first"].mesh_vertices, vertices)
    np.testing.assert_array_equal(scene["first"].faces, faces)


BAD = {
    "no object": ("cat", CONE.vertices, CONE.faces, "no object 'cat'"),
    "no triangles": ("first", CONE.vertices, CONE.faces[:0], "'first' must have triangles, got none"),
    "no such corner": ("first", CONE.vertices[:9], CONE.faces, "must index its 9 vertices, got indices from 0 to"),
    "fewer corners": ("first", BOX.vertices[:7], None, "must index its 7 vertices, got indices from 0 to 7"),
    "negative": ("first", CONE.vertices, CONE.faces - 1, "got indices from -1 to"),
    "no indices": ("first", CONE.vertices, CONE.faces / 2, r"integers of shape \(m, 3\), got float64"),
    "flat": ("first", CONE.vertices.ravel(), CONE.faces, r"shape \(n, 3\), got \("),
    "NaN": ("first", CONE.vertices * np.nan, CONE.faces, "must be finite: 34 are not, the first at 0"),
    "beyond floats": ("first", [[10**400, 0, 0]], [[0, 0, 0]], "'first' must hold arrays of numbers: int too large"),
    "far away": ("second", CONE.vertices * 1e19, CONE.faces, "within 1e18 m of the origin of its frame"),
    "far away, what stays": ("floor", CONE.vertices * 1e19, CONE.faces, "within 1e18 m of the origin$"),
    "attached": (
        "hat",
        CONE.vertices,
        CONE.faces,
        "'hat' is rigidly attached to 'second', so its mesh cannot be updated",
    ),
    "parent": (
        "second",
        CONE.vertices,
        CONE.faces,
        "'second' is rigidly attached to 'hat', so its mesh cannot be updated",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_meshes_change_nothing(case):
    name, vertices, faces, message = BAD[case]
    scene = build("cpu", BOX, BOX)
    if case in ("attached", "parent"):
        scene.add(CONE, name="hat", attach_to="second")
    built, objects = scene.bvh(), scene.objects
    with pytest.raises(SceneError, match=message):
        scene.update_mesh(name, vertices, faces)
    assert scene.bvh() is built
    assert scene.objects is objects
