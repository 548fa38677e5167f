# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The CUDA packet caster without a GPU: images of an emulated warp with lanes in several orders.

Every launch runs once for each order of lanes, must write the same bytes in all orders, and aborts on divergence,
memory errors or undefined behavior.
"""

import numpy as np
import pytest
import trimesh
import warp as wp
from cuda_emulator import Variant, emulated_renderer

import warpvis as wv
from warpvis import cameras
from warpvis.rendering.casters.base import ViewBatch
from warpvis.scene import solids
from warpvis.scene.worlds import parse_worlds

from compare import assert_matches_reference
from support import (
    attached as attached_scenes,
    emulated,
    instances as instance_scenes,
    near_plane as near_plane_scenes,
    sizes as sized_scenes,
    solids as solid_scenes,
    table_packets as ray_tables,
    triangle_faces as face_scenes,
)
from support.emulated import CAMERA, render
from support.ray_patterns import sphere_of_rays
from support.worlds import ALL, MESHES, STILL, assert_bits_equal, build, eyes, far_away, random_poses, view_of

pytestmark = pytest.mark.cxx

SIDES = (4, 8, 16, 32)
SOME_SIDES = (4, pytest.param(8, marks=pytest.mark.slow), pytest.param(16, marks=pytest.mark.slow), 32)
VARIANTS = tuple(Variant(side, with_id, movable) for side in SIDES[1:] for with_id in (0, 1) for movable in (0, 1))
VARIANTS += tuple(Variant(4, 1, movable) for movable in (0, 1))
VARIANTS += tuple(Variant(side, 1, False) for side in (1, 2))  # only for static objects
OLD = Variant(16, True, True, arch=700)  # before warp reduction instructions
CLIPS = Variant(16, True, True, clip=True)
RESIZED = Variant(16, True, True, clip=True, resized=True)
FINDS = Variant(16, True, True, found=True)
LARGE = Variant(32, False, False, large=True)
TABLES = (Variant(16, False, False, ray_table=True), Variant(32, True, False, ray_table=True))
TABLES += (Variant(16, True, True, resized=True, ray_table=True),)

emulator = emulated.emulator  # a fixture
few_share = instance_scenes.shared  # a fixture


def moved(count=5, seed=1):
    return random_poses(np.random.default_rng(seed), count)


@pytest.mark.smoke("32-False", "4-True")
@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("side", [pytest.param(1, marks=pytest.mark.slow), 2, *SOME_SIDES])
def test_static_objects(emulator, side, cull_backfaces):
    """Cameras are outside all closed objects and inside one."""
    scene = build("cpu", moved(), movable=False)
    inside = wv.look_at((0.2, 0.1, 0.5), (1, 0.3, 0.6))[None]
    poses = np.concatenate([eyes(2), inside]).astype(np.float32)
    views = render(emulator, scene, poses, side=side, cull_backfaces=cull_backfaces)
    assert_matches_reference(views, scene, CAMERA, poses, cull_backfaces=cull_backfaces)


@pytest.mark.smoke("32-True", "4-False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("side", SOME_SIDES)
def test_movable_objects(emulator, side, cull_backfaces):
    """Several worlds, one of them shared by two views."""
    rows, world = random_poses(np.random.default_rng(2), 2, 5), np.array([1, 0, 1])
    scene = build("cpu", np.tile(STILL, (5, 1)), movable=True)
    poses = eyes(3)
    options = {"object_poses": rows, "world_index": world}
    views = render(emulator, scene, poses, side=side, cull_backfaces=cull_backfaces, **options)
    for index, row in enumerate(rows[world]):
        twin, one = build("cpu", row, movable=False), slice(index, index + 1)
        assert_matches_reference(view_of(views, index), twin, CAMERA, poses[one], cull_backfaces=cull_backfaces)


@pytest.mark.smoke("False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_static_instances(emulator, few_share, cull_backfaces):
    scene, poses = instance_scenes.build(), eyes(2)
    assert instance_scenes.instances_of(scene) == instance_scenes.COUNT
    views = render(emulator, scene, poses, cull_backfaces=cull_backfaces)
    twin = instance_scenes.twin(scene)
    assert_matches_reference(views, twin, CAMERA, poses, cull_backfaces=cull_backfaces)


@pytest.mark.smoke("True")
@pytest.mark.parametrize("scaled", [False, True])
def test_instances_among_movable_objects(emulator, few_share, scaled):
    """One world index is out of range; scaling applies to movable objects only."""
    scene, poses, rows = instance_scenes.build(movable=2), eyes(3), random_poses(np.random.default_rng(2), 2, 2)
    twin = instance_scenes.twin(scene)
    given = {"object_poses": rows, "world_index": np.array([1, 0, 1]), "exclude": ["early_2", "late_3"]}
    given |= {"object_scales": np.full((2, 2, 3), 1.5, dtype=np.float32)} if scaled else {}
    options = {"outputs": ALL, "near_plane": "clip"}
    variant = RESIZED if scaled else CLIPS
    views = emulated_renderer(emulator, variant, scene, CAMERA, **options).render(poses, **given)
    instance_scenes.assert_alike(views, wv.render(twin, CAMERA, poses, **options, **given))
    if not scaled:
        renderer = emulated_renderer(emulator, Variant(16, True, True), scene, CAMERA, outputs=ALL)
        instance_scenes.assert_missing_world_is_empty(renderer, rows)


@pytest.mark.smoke("True")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_near_plane_clips_meshes(emulator, cull_backfaces):
    """Boxes and balls are clipped, viewed from outside and inside."""
    scene, poses, camera = near_plane_scenes.scene("cpu"), near_plane_scenes.poses(), near_plane_scenes.CAMERA
    options = {"outputs": ALL, "cull_backfaces": cull_backfaces, "near_plane": "clip"}
    views = emulated_renderer(emulator, CLIPS, scene, camera, **options).render(poses)
    near_plane_scenes.assert_cut(views, scene, poses, cull_backfaces)


@pytest.mark.parametrize("kind", near_plane_scenes.SOLIDS)
def test_near_plane_clips_solids(emulator, kind):
    def render(made, pose, cull_backfaces):
        options = {"outputs": ALL, "cull_backfaces": cull_backfaces, "near_plane": "clip"}
        return emulated_renderer(emulator, CLIPS, made, near_plane_scenes.CAMERA, **options).render(pose)

    near_plane_scenes.assert_solid_is_cut(kind, "cpu", render)


@pytest.mark.smoke("False")
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_scaled_objects(emulator, cull_backfaces):
    """Scaled objects match objects built at that size; scales of 1 change no bit."""
    rng, count = np.random.default_rng(0), len(sized_scenes.SHAPES)
    rows, scales = random_poses(rng, 2, count), sized_scenes.random_scales(rng, 2, count)
    scene = sized_scenes.build("cpu", rows[0])
    options = {"outputs": ALL, "cull_backfaces": cull_backfaces, "near_plane": "clip"}
    renderer, plain = (emulated_renderer(emulator, kind, scene, CAMERA, **options) for kind in (RESIZED, CLIPS))
    views = renderer.render(eyes(2), object_poses=rows, object_scales=scales)
    checks = {"cull_backfaces": cull_backfaces, "near_plane": "clip"}
    for view in range(2):
        twin, one = sized_scenes.build("cpu", rows[view], scales[view]), slice(view, view + 1)
        assert_matches_reference(view_of(views, view), twin, CAMERA, eyes(2)[one], **checks)
    same = renderer.render(eyes(2), object_poses=rows, object_scales=np.ones((count, 3)))
    assert_bits_equal(same, plain.render(eyes(2), object_poses=rows))


@pytest.mark.smoke("4")
@pytest.mark.parametrize("kind", [1, 3, 4])
def test_scaled_objects_from_inside_and_clipped(emulator, kind):
    shapes, row, scales = [sized_scenes.SHAPES[kind]], [sized_scenes.TURNED], [(1.5, 0.8, 1.2)]
    scene, twin = (sized_scenes.build("cpu", row, some, shapes=shapes) for some in (None, scales))
    options = {"outputs": ALL, "near_plane": "clip"}
    resized, built = (
        emulated_renderer(emulator, variant, one, near_plane_scenes.CAMERA, **options)
        for variant, one in ((RESIZED, scene), (CLIPS, twin))
    )
    sized_scenes.assert_alike(resized.render(sized_scenes.NEAR, object_scales=scales), built.render(sized_scenes.NEAR))


@pytest.mark.parametrize(("kind", "factor", "x"), sized_scenes.SURROUNDED)
def test_camera_inside_a_scaled_object(emulator, kind, factor, x):
    scales, pose = sized_scenes.surrounded(factor, x)
    scene = sized_scenes.build("cpu", [(0, 0, 2, 0, 0, 0, 1)], shapes=[sized_scenes.SHAPES[kind]])
    renderer = emulated_renderer(emulator, RESIZED, scene, CAMERA, outputs=ALL, near_plane="clip")
    views = renderer.render(pose, object_scales=scales)
    assert (views.segmentation.numpy() == 1).mean() > 0.9


@pytest.mark.slow
def test_all_variants_render_the_same(emulator):
    """Images do not depend on the packet size or the other outputs."""
    for movable in (False, True):
        scene = build("cpu", moved(), movable=movable)
        expected = render(emulator, scene, eyes(1))
        for variant in (*VARIANTS, OLD):
            if variant.movable != movable:
                continue
            outputs = ALL if variant.with_id else ("depth", "points")
            images = emulated_renderer(emulator, variant, scene, CAMERA, outputs=outputs).render(eyes(1))
            assert_bits_equal(images, expected)


@pytest.mark.slow
def test_trees_built_on_a_gpu(emulator, monkeypatch):
    """Images are bit-identical for a single tree and for joined trees."""
    built = []
    for movable in (False, True):
        scene = build("cpu", moved(), movable=movable)
        expected = render(emulator, scene, eyes(2))
        with monkeypatch.context() as patch:
            patch.setattr(
                "warpvis.scene.acceleration.tree_cache.builds_on", lambda device, count: built.append(count) or True
            )
            assert_bits_equal(render(emulator, scene, eyes(2)), expected)
    assert len(built) == 1 + 5


@pytest.mark.smoke("normals", "depth")
@pytest.mark.parametrize("output", ALL)
def test_single_output_is_the_same(emulator, output):
    scene = build("cpu", moved(), movable=True)
    assert_bits_equal(render(emulator, scene, eyes(1), outputs=(output,)), render(emulator, scene, eyes(1)))


@pytest.mark.smoke("size0", "size3")
@pytest.mark.parametrize("size", [(1, 1), (7, 3), (33, 31), (70, 1)])
def test_image_sizes_that_are_no_multiple_of_packets(emulator, size):
    scene = build("cpu", moved(), movable=True)
    camera = wv.Camera.from_fov(*size, hfov=0.9, near=0.05, far=100.0)
    for side in SIDES:
        views = render(emulator, scene, eyes(2), side=side, camera=camera)
        assert_matches_reference(views, scene, camera, eyes(2))


@pytest.mark.smoke("stretched capsule-32", "disc-32", "short capsule-32")
@pytest.mark.parametrize("side", [*(pytest.param(side, marks=pytest.mark.slow) for side in SIDES[:-1]), SIDES[-1]])
@pytest.mark.parametrize("name", solid_scenes.SHAPES)
def test_solids_of_every_kind(emulator, name, side):
    """From the side, above, inside, and so close that the alternative root formula is used."""
    scene = solid_scenes.build("cpu", [(0, 0, 2, 0, 0, 0, 1)], names=[name])
    reach = scene.objects[1].solid.extent
    places = [(1.4, -0.5, 2.3), (0.2, 0.1, 3.6), (0.3, 1.6, 0.8), (reach[0] + 1e-3, 0, 2), (0.01, 0.02, 2.01)]
    targets = [(0, 0, 2), (0, 0, 2), (0, 0, 2), (0, 1, 2), (1, 0.1, 2.4)]
    poses = np.array([wv.look_at(*both) for both in zip(places, targets, strict=True)]).astype(np.float32)
    camera = wv.Camera.from_fov(45, 37, hfov=1.2, near=1e-6, far=100.0)
    views = render(emulator, scene, poses[:4], side=side, camera=camera)
    assert (views.segmentation.numpy() == 1).any(axis=(1, 2)).all()
    assert_matches_reference(views, scene, camera, poses[:4])
    # From inside, the triangles are rendered.
    twin = solid_scenes.build("cpu", [(0, 0, 2, 0, 0, 0, 1)], names=[name])
    twin.update_vertices(name, twin[name].mesh_vertices)
    inside = [render(emulator, one, poses[4:], side=side, camera=camera) for one in (scene, twin)]
    assert_bits_equal(*inside)
    assert np.isfinite(inside[0].depth.numpy()).any()


def test_solids_among_meshes(emulator):
    """More solids than are set up at once, intersecting each other, some around the camera."""
    rng = np.random.default_rng(0)
    names = [*solid_scenes.SHAPES, *solid_scenes.SHAPES]
    scene = wv.Scene()
    for index, (name, pose) in enumerate(zip(names, random_poses(rng, 16), strict=True)):
        shape, scale = solid_scenes.SHAPES[name]
        scene.add(shape, name=f"{name}_{index}", scale=scale, pose=pose, movable=True)
    for pose in random_poses(rng, 3):
        scene.add(MESHES[0], pose=pose, movable=True)
    middle = wv.look_at((0.1, 0, 0.6), (1, 0, 0.5))[None].astype(np.float32)
    poses = np.concatenate([eyes(1), middle])
    assert_matches_reference(render(emulator, scene, poses), scene, CAMERA, poses)


@pytest.mark.parametrize("gone", [(), ("lamp",), ("table", "ball")])
def test_attached_objects(emulator, gone):
    table, ball = random_poses(np.random.default_rng(2), 2)
    scene, twin = (attached_scenes.build("cpu", table, ball, attached=flag) for flag in (True, False))
    views = render(emulator, scene, eyes(2), exclude=list(gone))
    shown = wv.Scene()
    for item in twin.objects:
        vertices = item.vertices - ([0, 0, 1e4] if item.name in gone else [0, 0, 0])
        shown.add((vertices, item.faces), name=item.name, label=item.label)
    assert_matches_reference(views, shown, CAMERA, eyes(2))


def test_excluded_objects(emulator):
    """Static and movable objects, different ones in each view."""
    rows = moved()
    for movable in (False, True):
        scene = build("cpu", rows, movable=movable)
        flags = np.zeros((3, len(scene)), dtype=np.uint8)
        gone = [(0, 3), (1,), ()]
        for view, numbers in enumerate(gone):
            flags[view, [scene.index(f"moved_{number}") for number in numbers]] = 1
        views = render(emulator, scene, eyes(3), exclude=flags)
        for view, numbers in enumerate(gone):
            twin = build("cpu", far_away(rows, *numbers), movable=False)
            assert_matches_reference(view_of(views, view), twin, CAMERA, eyes(3)[view : view + 1])


def test_camera_inside_an_excluded_body(emulator):
    rows = np.array([(2.0, 0, 1.0, 0, 0, 0, 1), (0, 0, 0.5, 0, 0, 0, 1)])
    meshes = [trimesh.creation.box((1, 1, 1)), MESHES[1]]
    pose = wv.look_at((2.1, 0, 1.1), (0, 0, 0.5))[None].astype(np.float32)
    for movable in (False, True):
        scene = build("cpu", rows, movable=movable, meshes=meshes)
        inside = render(emulator, scene, pose)
        assert (inside.segmentation.numpy() == scene.index("moved_0")).all()
        twin = build("cpu", far_away(rows, 0), movable=False, meshes=meshes)
        assert_matches_reference(render(emulator, scene, pose, exclude=["moved_0"]), twin, CAMERA, pose)


def test_world_index_out_of_range_renders_nothing(emulator):
    rows = random_poses(np.random.default_rng(7), 2, 5)
    scene = build("cpu", rows[0], movable=True)
    renderer = emulated_renderer(emulator, Variant(16, True, True), scene, CAMERA, outputs=ALL)
    worlds = parse_worlds(scene, 3, rows, np.zeros(3, dtype=np.int32), None)
    worlds.world = wp.array([1, 2, -1], dtype=wp.int32, device="cpu")
    views = renderer.render(eyes(3), object_poses=rows, world_index=[1, 0, 0])
    seen = render(emulator, scene, eyes(1), object_poses=rows[1:])
    poses = renderer._caster.parse_poses(eyes(3), "opencv")
    renderer._caster.cast(ViewBatch(poses, worlds), renderer._images_of(views))
    assert_bits_equal(view_of(views, 0), seen)
    assert np.isposinf(views.depth.numpy()[1:]).all()
    assert np.isnan(views.points.numpy()[1:]).all() and np.isnan(views.normals.numpy()[1:]).all()
    assert (views.segmentation.numpy()[1:] == -1).all() and (views.labels.numpy()[1:] == 0).all()


def test_invalid_poses_render_nothing(emulator):
    poses = eyes(4)
    poses[1], poses[2, 3:], poses[3, 0] = np.nan, 0.0, np.inf
    for movable in (False, True):
        scene = build("cpu", moved(), movable=movable)
        renderer = emulated_renderer(emulator, Variant(16, True, movable), scene, CAMERA, outputs=ALL)
        views = renderer.render(eyes(4))
        array = wp.array(poses, dtype=wp.transform, device="cpu")
        worlds = parse_worlds(scene, 4, None, None, None)
        renderer._caster.cast(ViewBatch(array, worlds), renderer._images_of(views))
        assert np.isfinite(views.depth.numpy()[0]).any()
        assert np.isinf(views.depth.numpy()[1:]).all()
        assert (views.segmentation.numpy()[1:] == -1).all()


@pytest.mark.slow
@pytest.mark.parametrize("solid", [False, True])
def test_more_objects_than_one_list_holds(emulator, solid):
    """Without static objects; the movable objects fill two lists and part of a third."""
    rows = random_poses(np.random.default_rng(15), 520, spread=1.5)
    shapes = [solids.sphere(0.06, mesh_tolerance=0.01), trimesh.creation.box((0.1, 0.06, 0.08))]
    scene, twin = wv.Scene(), wv.Scene()
    for index, row in enumerate(rows):
        shape = shapes[0] if solid and index % 7 else shapes[1]
        scene.add(shape, name=f"object_{index}", pose=row, movable=True)
        twin.add(shape, name=f"object_{index}", pose=row, movable=shape is not shapes[1])
    views = render(emulator, scene, eyes(1), side=32)
    assert_matches_reference(views, twin, CAMERA, eyes(1))


@pytest.mark.slow
def test_found_objects_do_not_change_images(emulator):
    """Bit-identical to testing all objects in every packet: far, near, behind, around the camera, and excluded."""
    rng = np.random.default_rng(4)
    rows = np.stack([random_poses(rng, 90, spread=spread) for spread in (1.5, 6.0)])
    scene = wv.Scene()
    shapes = [solids.sphere(0.06, mesh_tolerance=0.01), trimesh.creation.box((0.1, 0.06, 0.08))]
    for index in range(90):
        scene.add(shapes[index % 2] if index else MESHES[0], scale=20 if index == 1 else 1, movable=True)
    camera = wv.Camera.from_fov(90, 70, hfov=1.2, near=0.05, far=9.0)
    poses = np.concatenate([eyes(2), random_poses(rng, 1)]).astype(np.float32)
    rows[1, 1, :3] = poses[2, :3]
    options = {"object_poses": rows, "world_index": [0, 1, 1], "exclude": [3, 4]}
    renderers = [
        emulated_renderer(emulator, kind, scene, camera, outputs=ALL) for kind in (FINDS, Variant(16, True, True))
    ]
    found, expected = (renderer.render(poses, **options) for renderer in renderers)
    assert len(np.unique(expected.segmentation.numpy())) > 30
    assert_bits_equal(found, expected)


def test_many_small_triangles_in_a_deep_tree(emulator):
    """More than two thousand triangles, most smaller than a pixel, and one behind them that fills the image."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.4)
    for movable in (False, True):
        scene = wv.Scene()
        scene.add(trimesh.creation.box((6, 6, 0.02)), name="floor", label="ground")
        scene.add(ball, name="ball", pose=(0, 0, 0.6, 0, 0, 0, 1), movable=movable)
        poses = np.concatenate([eyes(1), eyes(1, radius=7.0)])
        outputs = ("depth", "points", "segmentation")  # between adjacent triangles, either normal is correct
        views = render(emulator, scene, poses, side=32, outputs=outputs)
        assert_matches_reference(views, scene, CAMERA, poses)
        if not movable:  # leaves are prefetched in a tree treated as large
            asked = emulated_renderer(emulator, LARGE, scene, CAMERA, outputs=("depth",)).render(poses)
            assert asked.depth.numpy().tobytes() == views.depth.numpy().tobytes()


@pytest.mark.slow
def test_ray_bundle_in_the_room(emulator):
    """Depth alone in small packets, all outputs in large ones."""
    scene, pose = wv.scenes.PRESETS["room"].build(), wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    for name in ("lidar", "planar, wide"):
        camera = ray_tables.PATTERNS[name]
        depth, views = (
            emulated_renderer(emulator, variant, scene, camera, outputs=outputs).render(pose)
            for variant, outputs in zip(TABLES, (("depth",), ALL), strict=False)
        )
        ray_tables.assert_views_match(views, scene, camera, [pose])
        shown = np.isfinite(views.depth.numpy())
        np.testing.assert_allclose(depth.depth.numpy()[shown], views.depth.numpy()[shown], rtol=2e-6)


def test_ray_bundle_with_movable_objects(emulator):
    """Scaled meshes and solids."""
    rng = np.random.default_rng(0)
    shapes = [sized_scenes.SHAPES[kind] for kind in (0, 1, 3, 4)]
    rows, scales = random_poses(rng, 4, spread=2.0), sized_scenes.random_scales(rng, 1, 4)[0]
    scene, twin = (sized_scenes.build("cpu", rows, some, shapes=shapes) for some in (None, scales))
    camera = ray_tables.Table(ray_tables.PATTERNS["gaps"].table, near=0.5, far=4.0)
    poses = random_poses(rng, 2, spread=0.3)
    views = emulated_renderer(emulator, TABLES[2], scene, camera, outputs=ALL).render(poses, object_scales=scales)
    ray_tables.assert_views_match(views, twin, camera, poses)
    assert len(np.unique(views.segmentation.numpy())) >= 4


# Lines that no scene reaches, with reasons.
UNREACHED: dict[str, str] = {}


@pytest.mark.slow
def test_faces(emulator, few_share):
    """Faces are indices of each object's mesh, for static objects, instances and movable objects; -1 for solids."""
    for moving in (False, True):
        scene, given = face_scenes.build(moving=moving)
        worlds = face_scenes.worlds_of(scene)
        options = {"object_poses": worlds} if moving else {}
        poses = eyes(2)
        views = render(emulator, scene, poses, outputs=face_scenes.FACES, **options)
        assert len(face_scenes.assert_faces_hold(views, scene, given, worlds)) > 10
        assert_bits_equal(views, render(emulator, scene, poses, outputs=ALL, **options))
        alone = render(emulator, scene, poses, outputs=("faces",), **options)
        np.testing.assert_array_equal(alone.faces.numpy(), views.faces.numpy())
    camera = cameras.Rays(sphere_of_rays(400))
    options["object_scales"] = np.ones((len(scene.movable), 3), dtype=np.float32)
    renderer = emulated_renderer(emulator, TABLES[2], scene, camera, outputs=face_scenes.FACES)
    face_scenes.assert_faces_hold(renderer.render(poses, **options), scene, given, worlds)


@pytest.mark.slow
def test_every_line_runs(emulator, request):
    """Together, all tests of this file run every line of the headers."""
    chosen = {item.function for item in request.session.items if item.path == request.path}
    if not all(value in chosen for name, value in globals().items() if name.startswith("test_") and callable(value)):
        pytest.skip("only some of this file's tests ran")
    counts = emulator.line_counts()
    missed = [f"{name}:{number}: {text}" for (name, number, text), count in sorted(counts.items()) if count == 0]
    assert [line for line in missed if line not in UNREACHED] == []
