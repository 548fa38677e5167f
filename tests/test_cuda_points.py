# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of image points on CUDA: images of an emulated warp, and the sorting of points."""

import numpy as np
import pytest
import trimesh
import warp as wp
from corner_walls import wall
from cuda_emulator import Emulator, Variant, emulated_renderer
from reference_point_order import OUTSIDE_CELLS, cells_of, count_points, hilbert_curve, measure_blocks, sort_points

import warpvis as wv
from warpvis.kernels.casting.point_order import clear_unused
from warpvis.rendering.casters import CastOptions, ViewBatch, points_cuda
from warpvis.rendering.casters.points_cuda import guess_columns, list_points, packet_count, packet_size, takes_packets
from warpvis.scene.worlds import parse_worlds

import reference
from compare import wrong_depth
from support import (
    instances as instance_scenes,
    near_plane as near_plane_scenes,
    sizes as sized_scenes,
    solids as solid_scenes,
    table_packets as ray_tables,
    triangle_faces as face_scenes,
)
from support.worlds import ALL, assert_bits_equal, build, eyes, random_poses, view_of

CAMERA = wv.Camera.from_fov(45, 37, hfov=0.994837, near=0.05, far=100.0)
SIZE = (CAMERA.width, CAMERA.height)
PLAIN, MOVES = Variant(32, True, False, points=256), Variant(32, True, True, points=256)
SMALL, DEPTH = Variant(32, True, False, points=64), Variant(32, False, False, points=1024)
LISTED = Variant(32, True, False, points=256, used=True)
CLIPS = Variant(32, True, True, clip=True, points=64)
RESIZED = Variant(32, True, True, clip=True, resized=True, points=256)
RAYS = Variant(32, True, False, ray_table=True, points=256)
RAYS_MOVE = Variant(32, True, True, resized=True, ray_table=True, points=256)
RAYS_DEPTH = Variant(32, False, False, ray_table=True, points=256)


@pytest.fixture(scope="module")
def emulator(tmp_path_factory):
    """Return an emulator with sanitizers and line counts."""
    return Emulator(tmp_path_factory.mktemp("point_emulator"))


def renderer_of(emulator, scene, *, variant=None, camera=CAMERA, outputs=ALL, **options):
    variant = variant or (MOVES if scene.bvh().struct.drawn_count else PLAIN)
    return emulated_renderer(emulator, variant, scene, camera, outputs=outputs, **options)


def centers(camera=CAMERA):
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return np.stack([x, y], axis=-1).reshape(1, -1, 2).astype(np.float32)


def scattered(count, views=1, seed=0, beyond=3):
    low, high = (-beyond, -beyond), np.array(SIZE) + beyond
    return np.random.default_rng(seed).uniform(low, high, (views, count, 2)).astype(np.float32)


def assert_points_match(views, scene, camera, poses, pixels, **options):
    """Check every output against the float64 reference."""
    for view, pose in enumerate(poses):
        expected = reference.cast_rays_at(scene, camera, pose, pixels[view], **options)
        wrong = wrong_depth(views.depth.numpy()[view], expected.depth)
        assert wrong.sum() <= max(1, 3e-4 * wrong.size)
        same = ~wrong & (expected.gap > 1e-5)
        np.testing.assert_array_equal(views.segmentation.numpy()[view][same], expected.objects[same])
        np.testing.assert_array_equal(views.labels.numpy()[view][same], expected.labels[same])
        np.testing.assert_allclose(views.points.numpy()[view][same], expected.points[same], atol=1e-4)
        apart = np.abs(views.normals.numpy()[view][same] - expected.normals[same]).max(axis=-1) > 2e-4
        assert apart.mean() < 1e-2 if apart.size else True


@pytest.mark.smoke("True")
@pytest.mark.cxx
@pytest.mark.parametrize("cull_backfaces", [False, True])
def test_arbitrary_points_match_the_reference(emulator, cull_backfaces):
    """Unordered points, duplicates, points outside the image and non-finite points, for both packet sizes."""
    scene = build("cpu", random_poses(np.random.default_rng(1), 5), movable=False)
    inside = wv.look_at((0.2, 0.1, 0.5), (1, 0.3, 0.6))[None]
    poses = np.concatenate([eyes(1), inside]).astype(np.float32)
    pixels = scattered(1500, views=2)
    pixels[:, 0], pixels[0, 1:3], pixels[1, 5:300] = np.nan, (np.inf, -np.inf), pixels[1, 300:301]
    pixels[0, 3:5] = [(-0.0, 0.0), (45.0, 36.9999)]
    views = renderer_of(emulator, scene, cull_backfaces=cull_backfaces).render_at(poses, pixels)
    assert_points_match(views, scene, CAMERA, poses, pixels, cull_backfaces=cull_backfaces)
    small = renderer_of(emulator, scene, variant=SMALL, cull_backfaces=cull_backfaces).render_at(poses, pixels)
    assert_bits_equal(small, views)
    depth = renderer_of(emulator, scene, variant=DEPTH, cull_backfaces=cull_backfaces, outputs=("depth",))
    assert depth.render_at(poses, pixels).depth.numpy().tobytes() == views.depth.numpy().tobytes()


@pytest.mark.cxx
def test_points_do_not_depend_on_other_points(emulator):
    """Results do not depend on row order, permutation or number of points."""
    scene, pixels = build("cpu", random_poses(np.random.default_rng(4), 5), movable=True), centers()
    pixels += np.random.default_rng(5).uniform(-0.4, 0.4, pixels.shape).astype(np.float32)
    lists = list_points(wp.array(pixels[:, None], dtype=wp.vec2), CAMERA)
    assert lists.spread.numpy() <= 0
    renderer = renderer_of(emulator, scene)
    whole = renderer.render_at(eyes(1), pixels)
    for order in (np.random.default_rng(2).permutation(pixels.shape[1]), np.arange(700, 731), np.array([1400])):
        some = renderer.render_at(eyes(1), pixels[:, order])
        for name in ALL:
            expected = getattr(whole, name).numpy()[:, order]
            assert getattr(some, name).numpy().tobytes() == expected.tobytes(), name


@pytest.mark.cxx
@pytest.mark.parametrize("count", [1, 31, 33, 257])
def test_partially_filled_packets(emulator, count):
    scene = build("cpu", random_poses(np.random.default_rng(1), 5), movable=False)
    pixels = scattered(count, views=2, seed=count, beyond=0)
    views = renderer_of(emulator, scene).render_at(eyes(2), pixels)
    assert_points_match(views, scene, CAMERA, eyes(2), pixels)


@pytest.mark.cxx
def test_points_of_the_other_stereo_eye(emulator):
    """Points in image order shifted by disparity: one view in order, the other one shuffled."""
    preset = wv.scenes.PRESETS["room"]
    scene, camera = preset.build("cpu"), wv.Camera.from_fov(64, 48, hfov=1.0, near=0.3, far=20.0)
    poses = preset.poses(2)
    depth = wv.render(scene, camera, poses, outputs=("depth",)).depth.numpy().reshape(2, -1)
    pixels = np.tile(centers(camera), (2, 1, 1))
    pixels[..., 0] -= np.where(np.isfinite(depth), camera.fx * 0.1 / depth, 0)
    pixels[1] = pixels[1, np.random.default_rng(0).permutation(pixels.shape[1])]
    apart = list_points(wp.array(pixels[:, None], dtype=wp.vec2), camera).spread.numpy()
    assert apart[0] < 0 < apart[1]
    views = renderer_of(emulator, scene, camera=camera).render_at(poses, pixels)
    assert_points_match(views, scene, camera, poses, pixels)
    assert np.isfinite(views.depth.numpy()).mean() > 0.5


@pytest.mark.cxx
def test_points_in_the_order_of_the_list(emulator):
    """They equal those that are sorted. The emulator requires that all points are used."""
    scene = build("cpu", random_poses(np.random.default_rng(1), 5), movable=False)
    pixels = scattered(600, views=2, beyond=0)
    renderer = renderer_of(emulator, scene, outputs=("depth",))
    whole = renderer.render_at(eyes(2), pixels).depth.numpy()
    renderer = renderer_of(emulator, scene, outputs=("depth",), variant=LISTED)
    seen = cast_points(renderer, eyes(2), pixels, used=wp.array([600, 600], dtype=wp.int32, device="cpu"))
    np.testing.assert_array_equal(seen, whole)


def test_unused_points_of_single_rays_hit_nothing(device):
    points, used = scattered(50, views=3), np.array([0, 20, 50], dtype=np.int32)
    cleared = wp.array(points, dtype=wp.vec2, device=device)
    wp.launch(clear_unused, (3, 50), inputs=[wp.array(used, device=device), cleared], device=device)
    np.testing.assert_array_equal(cleared.numpy(), reference.clear_unused(used, points))


def cast_points(renderer, poses, pixels, **options):
    """Return the depth of points with options of `ViewBatch`."""
    points, caster = wp.array(pixels[:, None], dtype=wp.vec2, device="cpu"), renderer._caster
    worlds = parse_worlds(renderer.scene, len(poses), None, None, None)
    depth = wp.zeros(points.shape, dtype=wp.float32, device="cpu")
    caster.cast(
        ViewBatch(caster.parse_poses(poses, renderer.camera.axes), worlds, pixels=points, **options), {"depth": depth}
    )
    return depth.numpy()[:, 0]


@pytest.mark.cxx
def test_two_dimensional_pixel_arrays(emulator):
    """Rows of any length, with points that are close to each other or not."""
    scene = build("cpu", random_poses(np.random.default_rng(4), 5), movable=False)
    y, x = np.mgrid[:19, :50]
    pixels = np.stack([0.6 * x + 0.2 * y + 5, 1.5 * y - 0.1 * x + 6], axis=-1)[None].repeat(2, 0).astype(np.float32)
    pixels[1] = np.random.default_rng(0).permutation(pixels[1].reshape(-1, 2)).reshape(19, 50, 2)
    lists = list_points(wp.array(pixels, dtype=wp.vec2), CAMERA)
    assert lists.columns == 50 and lists.spread.numpy()[0] <= 0
    views = renderer_of(emulator, scene).render_at(eyes(2), pixels)
    assert views.depth.shape == (2, 19, 50)
    expected = renderer_of(emulator, scene).render_at(eyes(2), pixels.reshape(2, -1, 2))
    assert_bits_equal(views, expected)
    assert_points_match(expected, scene, CAMERA, eyes(2), pixels.reshape(2, -1, 2))


@pytest.mark.cxx
def test_small_triangles(emulator):
    """Most triangles contain no point."""
    preset = wv.scenes.PRESETS["blobs_77k"]
    scene, poses = preset.build("cpu"), preset.poses(1)
    pixels = scattered(400, seed=3, beyond=0)
    views = renderer_of(emulator, scene).render_at(poses, pixels)
    assert_points_match(views, scene, CAMERA, poses, pixels)


@pytest.mark.cxx
def test_worlds_and_exclusion(emulator):
    rows = random_poses(np.random.default_rng(11), 2, 5)
    scene = build("cpu", rows[0], movable=True)
    pixels, flags = scattered(400, views=3, seed=2), np.zeros((3, len(scene)), dtype=bool)
    flags[0, [1, 3]], flags[1, 0] = True, True
    given = {"object_poses": rows, "world_index": [1, 0, 1], "exclude": flags}
    views = renderer_of(emulator, scene).render_at(eyes(3), pixels, **given)
    expected = wv.Renderer(scene, CAMERA, outputs=ALL, caster="rays").render_at(eyes(3), pixels, **given)
    assert len(np.unique(views.segmentation.numpy())) > 3
    instance_scenes.assert_alike(views, expected)


@pytest.mark.cxx
def test_exact_surfaces_of_solids(emulator):
    """From outside and inside."""
    scene = solid_scenes.build("cpu", random_poses(np.random.default_rng(5), len(solid_scenes.SHAPES)))
    pixels = scattered(1200, views=2, seed=1)
    views = renderer_of(emulator, scene).render_at(eyes(2), pixels)
    assert_points_match(views, scene, CAMERA, eyes(2), pixels)


@pytest.mark.cxx
def test_solids_next_to_the_camera(emulator):
    """Their projections are unbounded, but must stay within the packet's blocks."""
    rng, shapes = np.random.default_rng(0), [sized_scenes.SHAPES[kind] for kind in (0, 1, 3, 4)]
    rows, scales = random_poses(rng, 4, spread=2.0), sized_scenes.random_scales(rng, 1, 4)[0]
    scene, poses = sized_scenes.build("cpu", rows, scales, shapes=shapes), random_poses(rng, 6, spread=0.3)
    pixels = scattered(600, views=6)
    views = renderer_of(emulator, scene, camera=CAMERA).render_at(poses, pixels)
    assert_points_match(views, scene, CAMERA, poses, pixels)


@pytest.mark.cxx
def test_scaled_objects(emulator):
    rng = np.random.default_rng(3)
    rows = random_poses(rng, 2, len(sized_scenes.SHAPES))
    scales = sized_scenes.random_scales(rng, 2, len(sized_scenes.SHAPES))
    pixels = scattered(400, views=2)
    scene = sized_scenes.build("cpu", rows[0])
    views = renderer_of(emulator, scene, variant=RESIZED, near_plane="clip").render_at(
        eyes(2), pixels, object_poses=rows, object_scales=scales
    )
    for view in range(2):
        twin, one = sized_scenes.build("cpu", rows[view], scales[view]), slice(view, view + 1)
        assert_points_match(view_of(views, view), twin, CAMERA, eyes(2)[one], pixels[one])


@pytest.mark.slow
@pytest.mark.cxx
def test_near_plane_clips_meshes(emulator):
    scene, poses, camera = near_plane_scenes.scene("cpu"), near_plane_scenes.poses(), near_plane_scenes.CAMERA
    pixels = np.tile(centers(camera), (len(poses), 1, 1))
    options = {"near_plane": "clip", "outputs": ("depth",)}
    depth = renderer_of(emulator, scene, variant=CLIPS, camera=camera, **options).render_at(poses, pixels).depth.numpy()
    image = wv.Renderer(scene, camera, **options).render(poses).depth.numpy().astype(np.float64)
    assert wrong_depth(depth, image.reshape(depth.shape)).mean() < 1e-3


@pytest.mark.slow
@pytest.mark.cxx
@pytest.mark.parametrize(("movable", "seed"), [(False, 0), (True, 1)])
def test_no_ray_passes_through_a_vertex(emulator, movable, seed):
    """Walls with a vertex at every pixel center, up to rounding; in rows and unordered."""
    camera, pose, vertices, faces = wall(seed)
    scene, pixels = wv.Scene(), centers(camera)
    scene.add((vertices, faces), movable=movable)
    renderer = renderer_of(emulator, scene, camera=camera, outputs=("depth",))
    for order in (np.arange(pixels.shape[1]), np.random.default_rng(0).permutation(pixels.shape[1])[:700]):
        assert np.isfinite(renderer.render_at(pose[None], pixels[:, order]).depth.numpy()).all()


@pytest.mark.cxx
def test_principal_point_outside_the_image_and_wide_images(emulator):
    scene = build("cpu", random_poses(np.random.default_rng(1), 5), movable=False)
    for camera in (
        wv.Camera(45, 37, 60.0, 20.0, -30.25, 60.1, near=0.05, far=100.0),
        wv.Camera(20_000, 10, 9000.0, 40.0, 9000.0, 5.0, near=0.05, far=100.0),
    ):
        pixels = np.random.default_rng(6).uniform(0, (camera.width, camera.height), (1, 500, 2)).astype(np.float32)
        views = renderer_of(emulator, scene, camera=camera).render_at(eyes(1), pixels)
        assert_points_match(views, scene, camera, eyes(1), pixels)


@pytest.mark.smoke("lidar", "gaps")
@pytest.mark.cxx
@pytest.mark.parametrize("name", ["no order", "lidar", "gaps"])
def test_ray_bundles_as_points(emulator, name):
    """Unordered rays, and rows treated as unordered."""
    scene, pose = wv.scenes.PRESETS["room"].build(), wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    camera = ray_tables.PATTERNS[name]
    views = emulated_renderer(emulator, RAYS, scene, camera, outputs=ALL).render(pose)
    ray_tables.assert_views_match(views, scene, camera, [pose])
    depth = emulated_renderer(emulator, RAYS_DEPTH, scene, camera, outputs=("depth",)).render(pose).depth.numpy()
    shown = np.isfinite(views.depth.numpy())
    np.testing.assert_allclose(depth[shown], views.depth.numpy()[shown], rtol=2e-6)


@pytest.mark.cxx
def test_unordered_rays_and_small_triangles(emulator):
    preset = wv.scenes.PRESETS["blobs_77k"]
    scene, camera = preset.build("cpu"), ray_tables.PATTERNS["no order"]
    views = emulated_renderer(emulator, RAYS, scene, camera, outputs=ALL).render(preset.poses(1))
    ray_tables.assert_views_match(views, scene, camera, preset.poses(1))


@pytest.mark.cxx
def test_unordered_rays_through_mesh_vertices(emulator):
    """Double precision decides which triangle is hit, and every ray hits one."""
    ball, scene = trimesh.creation.icosphere(subdivisions=2, radius=0.7), wv.Scene(device="cpu")
    scene.add(ball, name="ball")
    corners = np.concatenate([ball.vertices, ball.vertices[ball.edges_unique].mean(axis=1)]).astype(np.float32)
    targets = np.random.default_rng(0).permutation(corners.astype(np.float64))
    lengths = np.linalg.norm(targets, axis=1)
    camera = ray_tables.Table((targets / lengths[:, None])[None])
    depth = emulated_renderer(emulator, RAYS, scene, camera, outputs=ALL).render([0, 0, 0, 0, 0, 0, 1.0]).depth
    np.testing.assert_allclose(depth.numpy()[0, 0], lengths, atol=2e-6)


@pytest.mark.cxx
def test_unordered_rays_and_movable_objects(emulator):
    """Scaled meshes and solids."""
    rng = np.random.default_rng(0)
    shapes = [sized_scenes.SHAPES[kind] for kind in (0, 1, 3, 4)]
    rows, scales = random_poses(rng, 4, spread=2.0), sized_scenes.random_scales(rng, 1, 4)[0]
    scene, twin = (sized_scenes.build("cpu", rows, some, shapes=shapes) for some in (None, scales))
    camera = ray_tables.Table(ray_tables.PATTERNS["no order"].table, near=0.5, far=4.0)
    poses = random_poses(rng, 2, spread=0.3)
    views = emulated_renderer(emulator, RAYS_MOVE, scene, camera, outputs=ALL).render(poses, object_scales=scales)
    ray_tables.assert_views_match(views, twin, camera, poses)
    assert len(np.unique(views.segmentation.numpy())) >= 4


@pytest.mark.cxx
def test_faces(emulator):
    scene, given = face_scenes.build()
    worlds, pixels = face_scenes.worlds_of(scene, 1), scattered(700)
    views = renderer_of(emulator, scene, outputs=face_scenes.FACES).render_at(eyes(1), pixels, object_poses=worlds)
    assert len(face_scenes.assert_faces_hold(views, scene, given, worlds)) > 5


@pytest.mark.cxx
@pytest.mark.slow
def test_every_line_of_points_runs(emulator, request):
    chosen = {item.function for item in request.session.items if item.path == request.path}
    if not all(value in chosen for name, value in globals().items() if name.startswith("test_") and callable(value)):
        pytest.skip("only some of this file's tests ran")
    counts = emulator.line_counts()
    counts = {line: count for line, count in counts.items() if "point" in line[0]}
    assert len(counts) > 60
    assert [f"{name}:{number}: {text}" for (name, number, text), count in counts.items() if count == 0] == []


def test_hilbert_curve_visits_all_cells_in_unit_steps():
    for bits in range(5):
        curve = hilbert_curve(bits)
        assert len(np.unique(curve, axis=0)) == 4**bits
        assert (np.abs(np.diff(curve, axis=0)).sum(axis=1) == 1).all()


def test_points_are_sorted_by_their_cells(device):
    """Compared with references; points outside the image come last."""
    pixels = np.concatenate([scattered(1665, seed=1), centers()]).astype(np.float32)
    pixels[0, 7] = np.nan
    lists = list_points(wp.array(pixels[:, None], dtype=wp.vec2, device=device), CAMERA)
    assert lists.columns == 45
    bits = 4  # 256 cells for 1665 points
    assert lists.cells == 4**bits + OUTSIDE_CELLS
    spacing = np.sqrt(np.prod(SIZE) / 1665)
    most = points_cuda._MAX_STRETCH * 12 * spacing
    apart = measure_blocks(pixels, 45, SIZE, points_cuda._MEASURED_STEP, most)
    np.testing.assert_allclose(lists.spread.numpy(), 8 * apart, atol=20)
    assert apart[1] < 0 < apart[0]
    ends = lists.ends.numpy().reshape(2, -1)
    np.testing.assert_array_equal(ends[0], count_points(pixels[:1], SIZE, bits)[0].cumsum())
    assert (ends[1] == ends[0, -1]).all() and (lists.counts.numpy() == 0).all()
    order, cells = lists.order.numpy()[: ends[1, -1]], cells_of(pixels, SIZE, bits)[0]
    assert len(order) == 1665 and len(np.unique(order)) == 1665
    np.testing.assert_array_equal(cells[order], cells[sort_points(pixels, SIZE, bits)[0]])


def test_guessed_columns():
    kinect = wv.Camera.kinect()
    assert [guess_columns(count, kinect) for count in (76_800, 4_800, 19_200, 10_000, 1)] == [320, 80, 160, 0, 1]
    for count in (76_800, 10_000, 33):
        lists = list_points(wp.zeros((1, 1, count), dtype=wp.vec2, device="cpu"), kinect)
        assert packet_count(lists, 256) >= count / 256


def test_packet_size_by_number_of_points():
    assert [packet_size(views * 76_800, 132) for views in (1, 10, 11, 512)] == [64, 64, 256, 256]


def test_packets_are_used_by_number_of_points():
    assert [takes_packets(count) for count in (1000, 1 << 14, 1 << 15, 1 << 26, 1 << 27)] == [0, 0, 1, 1, 0]


def test_launches_are_split_to_fit_memory(monkeypatch):
    """Views, their worlds and their outputs are split together."""
    scene, launched = build("cpu", random_poses(np.random.default_rng(1), 5), movable=True), []
    scene.bvh()
    monkeypatch.setattr(points_cuda, "_MAX_POINTS", 5000)
    monkeypatch.setattr(points_cuda, "_cast", lambda *given: launched.append(given[3:]))
    pixels, depth = wp.zeros((5, 1, 2000), dtype=wp.vec2), wp.zeros((5, 1, 2000), dtype=float)
    worlds = wv.scene.worlds.parse_worlds(scene, 5, None, np.zeros(5, dtype=np.int32), None)
    views = ViewBatch(wp.zeros(5, dtype=wp.transform), worlds, pixels=pixels)
    points_cuda.cast_point_packets(scene.bvh().struct, CAMERA, CastOptions(), views, {"depth": depth})
    assert [(p.count, p.worlds.world.size, p.pixels.shape, rows["depth"].shape) for p, rows in launched] == [
        (count, count, (count, 1, 2000), (count, 1, 2000)) for count in (2, 2, 1)
    ]


CUDA_CASES = [("room", False), ("blobs_77k", False), ("room", True)]
LARGE = wv.Camera.from_fov(240, 180, hfov=0.994837, near=0.05, far=100.0)
"""Has enough pixels for packets."""


def test_points_of_another_eye_with_many_triangles(cuda):
    """One view of many triangles from another eye, which once caused an out-of-bounds read on an H200."""
    preset, camera = wv.scenes.PRESETS["blobs_1m"], wv.Camera.from_fov(320, 240, hfov=0.994837, near=0.05, far=100.0)
    scene, pose = preset.build(cuda), preset.poses(512)[19:20]
    depth = wv.render(scene, camera, pose).depth.numpy().reshape(1, -1)
    pixels = centers(camera)
    pixels[..., 0] -= camera.fx * 0.075 / np.maximum(np.where(np.isfinite(depth), depth, np.inf), camera.near)
    packets, rays = (wv.Renderer(scene, camera, outputs=ALL, caster=caster) for caster in ("packets", "rays"))
    instance_scenes.assert_alike(packets.render_at(pose, pixels), rays.render_at(pose, pixels))


@pytest.mark.parametrize(("name", "in_rows"), CUDA_CASES)
def test_gpu_points_match_single_rays(name, in_rows, cuda):
    """Equal to single rays; bit-identical for any order and packet size."""
    preset = wv.scenes.PRESETS[name]
    scene, poses = preset.build(cuda), preset.poses(3)
    camera = LARGE
    pixels = np.tile(centers(camera), (3, 1, 1))
    if not in_rows:
        pixels = np.random.default_rng(0).uniform(-3, (243, 183), pixels.shape).astype(np.float32)
        pixels[:, :3] = np.nan
    packets = wv.Renderer(scene, camera, outputs=ALL)
    assert takes_packets(pixels.shape[1])
    views = packets.render_at(poses, pixels)
    instance_scenes.assert_alike(views, wv.Renderer(scene, camera, outputs=ALL, caster="rays").render_at(poses, pixels))
    order = np.random.default_rng(1).permutation(pixels.shape[1])
    again = packets.render_at(poses, pixels[:, order])
    for output in ALL:
        assert getattr(again, output).numpy().tobytes() == getattr(views, output).numpy()[:, order].tobytes()


def test_gpu_results_do_not_depend_on_the_packet_size(cuda, monkeypatch):
    preset = wv.scenes.PRESETS["room"]
    camera = LARGE
    renderer, images = wv.Renderer(preset.build(cuda), camera, outputs=ALL), []
    for size in (64, 256, 1024):
        monkeypatch.setattr(points_cuda, "_PACKETS", ((size, 0),))
        images.append(renderer.render_at(preset.poses(2), np.tile(centers(camera), (2, 1, 1))))
    assert_bits_equal(images[1], images[0])
    assert_bits_equal(images[2], images[0])


def test_captured_graph_sorts_points_at_launch(cuda):
    """Each launch sorts the current points."""
    preset = wv.scenes.PRESETS["room"]
    camera = LARGE
    renderer = wv.Renderer(preset.build(cuda), camera, outputs=("depth",))
    some = np.random.default_rng(0).uniform(0, (240, 180), (2, 1, 40_000, 2)).astype(np.float32)
    expected = [renderer.render_at(preset.poses(1), pixels).depth.numpy() for pixels in some]
    poses = wp.array(preset.poses(1), dtype=wp.transform, device=cuda)
    pixels = wp.array(some[0], dtype=wp.vec2, device=cuda)
    out = renderer.render_at(poses, pixels)
    with wp.ScopedCapture(cuda) as capture:
        renderer.render_at(poses, pixels, out=out)
    for given, depth in zip(some, expected, strict=True):
        pixels.assign(given)
        wp.capture_launch(capture.graph)
        np.testing.assert_array_equal(out.depth.numpy(), depth)
