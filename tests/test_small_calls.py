# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of cached preparation of `Renderer` calls: no state leaks between calls, scenes, streams or threads."""

import copy
import gc
import pickle
import weakref
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core import arrays
from warpvis.core.arrays import aligned_empty, aligned_zeros
from warpvis.core.device_poses import parse_on_device
from warpvis.core.poses import host_poses, poses_to_matrices, poses_to_opencv
from warpvis.rendering._views import CheckedImages
from warpvis.rendering.casters.base import Pool
from warpvis.rendering.casters.packets_cpu import RayCosts

ALL = ("depth", "points", "normals", "labels", "segmentation")
CAMERA = wv.Camera.from_fov(40, 33, hfov=1.2, near=0.05, far=50.0)


def eyes(count, seed=0):
    places = np.random.default_rng(seed).uniform(-0.3, 0.3, (count, 3)) + (-3, 0, 0.5)
    return np.array([wv.look_at(place, (0, 0, 0)) for place in places], dtype=np.float32)


def build(device, *, movable=False):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -1, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(2, 0.6), name="ball", label="object", movable=movable)
    return scene


def assert_identical(one, other):
    for name in ALL:
        image, twin = getattr(one, name), getattr(other, name)
        assert (image is None) == (twin is None)
        assert image is None or image.numpy().tobytes() == twin.numpy().tobytes(), name


@pytest.fixture(params=["rows", "one row", "one wide row", "matrices", "one matrix", "warp", "device"])
def given(request, device):
    """Return two sets of poses in each accepted form."""

    def convert(rows):
        form = request.param
        if form in ("warp", "device"):
            return wp.array(rows, dtype=wp.transform, device=device if form == "device" else "cpu")
        rows = poses_to_matrices(rows) if "matri" in form else rows
        one = rows[:1].astype(np.float64) if "wide" in form else rows[0]
        return one if "one" in form else rows

    return [convert(eyes(2, seed)) for seed in (0, 1)]


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_calls_return_independent_images(device, caster, given):
    scene = build(device)
    renderer = wv.Renderer(scene, CAMERA, outputs=ALL, caster=caster)
    views = [renderer.render(poses) for poses in given]
    again = renderer.render(given[0])
    assert_identical(views[0], again)
    for poses, view in zip(given, views, strict=True):
        assert_identical(view, wv.render(scene, CAMERA, poses, outputs=ALL, caster=caster))
    assert views[0].depth.numpy().tobytes() != views[1].depth.numpy().tobytes()


def test_outputs_not_requested_are_not_written(device):
    scene = build(device)
    everything = wv.render(scene, CAMERA, eyes(1), outputs=ALL)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth",))
    labels = everything.labels.numpy().copy()
    for seed in (1, 2):
        renderer.render(eyes(1, seed), out=everything)
    assert (everything.labels.numpy() == labels).all()
    renderer.outputs = ("labels",)  # the same renderer with another kind of output
    depth = everything.depth.numpy().copy()
    renderer.render(eyes(1, 3), out=everything)
    assert (everything.depth.numpy() == depth).all()
    assert_identical(wv.Views(labels=everything.labels), wv.render(scene, CAMERA, eyes(1, 3), outputs=("labels",)))


def test_checked_images_are_found_only_if_the_same():
    checked, shape, outputs = CheckedImages(), (1, 2, 3), ("depth",)
    depth = wp.zeros(shape, device="cpu")
    checked.record({"depth": depth}, shape, outputs)
    found = checked.find(wv.Views(depth=depth), shape, outputs)
    assert found is not None and list(found) == ["depth"] and found["depth"] is depth
    assert checked.find(wv.Views(depth=wp.zeros_like(depth)), shape, outputs) is None


def test_changed_out_images_are_validated_again(device):
    """Replace an image in `out` by one of another array, size, type or device."""
    scene = build(device)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth", "labels"))
    expected = renderer.render(eyes(2))
    out = renderer.render(eyes(2))
    for _ in range(3):
        out.depth.fill_(0.0)
        assert renderer.render(eyes(2), out=out) is out
        assert_identical(out, expected)
    first, out.depth = out.depth, wp.zeros_like(out.depth)
    first.fill_(0.0)
    renderer.render(eyes(2), out=out)
    assert_identical(out, expected)
    assert not first.numpy().any()
    for wrong in (wp.zeros((2, 33, 41), device=device), wp.zeros((2, 33, 40), dtype=wp.int32, device=device), None):
        out.depth = wrong
        with pytest.raises(wv.errors.ArrayError, match=r"out\.depth must"):
            renderer.render(eyes(2), out=out)
    out.depth = first
    with pytest.raises(wv.errors.ArrayError, match=r"out\.depth must"):
        renderer.render(eyes(1), out=out)
    with pytest.raises(wv.errors.ArrayError, match="out must be"):
        renderer.render(eyes(2), out={"depth": first})
    renderer.outputs = ("depth", "segmentation")
    with pytest.raises(wv.errors.ArrayError, match=r"out\.segmentation must"):
        renderer.render(eyes(2), out=out)


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_scene_changes_are_rendered(device, caster):
    """Objects are added, excluded, deformed, scaled and moved between calls of one renderer."""
    scene = build(device, movable=True)
    renderer = wv.Renderer(scene, CAMERA, outputs=ALL, caster=caster)
    images = []

    def check(**options):
        images.append(renderer.render(eyes(1), **options))
        assert_identical(images[-1], wv.render(scene, CAMERA, eyes(1), outputs=ALL, caster=caster, **options))

    check()
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), pose=(0, 1, 0, 0, 0, 0, 1))
    check()
    scene.update_vertices("ball", scene["ball"].mesh_vertices * 0.5)
    check()
    check(object_poses=np.array([[[0, -0.5, 0.3, 0, 0, 0, 1]]]))
    check(object_scales=np.full((1, 1, 3), 1.5))
    check(exclude="ball")
    check()
    scene.add(trimesh.creation.icosphere(1, 0.2), movable=True, pose=(0, 0, 1, 0, 0, 0, 1))
    check()
    different = {image.depth.numpy().tobytes() for image in images}
    assert len(different) == len(images) - 1  # the calls without options on one scene are equal


def test_dropped_arrays_are_released(device):
    scene = build(device, movable=True)
    renderer = wv.Renderer(scene, CAMERA, outputs=ALL)
    poses = wp.array(eyes(2), dtype=wp.transform, device=device)
    objects = wp.array(np.tile(np.float32([0, 0, 0, 0, 0, 0, 1]), (2, 1, 1)), dtype=wp.transform, device=device)
    excluded = wp.zeros((2, 2), dtype=wp.uint8, device=device)
    views = renderer.render(poses, object_poses=objects, exclude=excluded)
    renderer.render(poses, object_poses=objects, exclude=excluded, out=views)
    watched = [weakref.ref(array) for array in (poses, objects, excluded, *(getattr(views, name) for name in ALL))]
    del views, poses, objects, excluded
    gc.collect()
    assert not [ref for ref in watched if ref() is not None]


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_concurrent_callers_get_their_own_images(device, caster):
    """With host poses, which are copied; one view and several."""
    scene = build(device, movable=True)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth", "segmentation"), caster=caster)
    calls = [(eyes(1 + seed % 2, seed), np.float32([[[0, 0, 0.1 * seed, 0, 0, 0, 1]]])) for seed in range(6)]
    options = {"outputs": renderer.outputs, "caster": caster}
    expected = [wv.render(scene, CAMERA, poses, object_poses=rows, **options) for poses, rows in calls]

    def render(i):
        poses, rows = calls[i % 6]
        views = renderer.render(poses, object_poses=rows)
        return views.depth.numpy(), views.segmentation.numpy()

    with ThreadPoolExecutor(6) as callers:
        for i, (depth, segmentation) in enumerate(callers.map(render, range(60))):
            assert depth.tobytes() == expected[i % 6].depth.numpy().tobytes()
            assert segmentation.tobytes() == expected[i % 6].segmentation.numpy().tobytes()


@pytest.mark.parametrize("bad", ["nan", "inf", "length", "zero"])
@pytest.mark.parametrize("form", ["row", "rows", "float64", "matrix", "warp", "many"])
def test_invalid_poses_after_valid_ones_raise(device, form, bad):
    renderer = wv.Renderer(build(device), CAMERA, outputs=("depth",))
    count = 3 if form == "many" else 1
    rows = eyes(count)
    out = renderer.render(rows)
    before = out.depth.numpy().copy()
    wrong = rows.copy()
    if bad in ("nan", "inf"):
        wrong[-1, 1] = float(bad)
    else:
        wrong[-1, 3:] *= 1.01 if bad == "length" else 0
    if form == "row":
        wrong = wrong[0]
    elif form == "float64":
        wrong = wrong.astype(np.float64)
    elif form == "matrix":
        wrong = poses_to_matrices(rows)[0]
        wrong[0, 3 if bad in ("nan", "inf") else 0] = float(bad) if bad in ("nan", "inf") else 1.2
    elif form == "warp":
        wrong = wp.array(wrong, dtype=wp.transform, device="cpu")
    with pytest.raises(wv.errors.PoseError, match="camera_to_world must"):
        renderer.render(wrong, out=out)
    np.testing.assert_array_equal(out.depth.numpy(), before)


def test_single_poses_equal_batches():
    """Rows and matrices of all rotations and magnitudes, to the last bit of single precision."""
    rng = np.random.default_rng(0)
    quaternions = np.concatenate([rng.normal(size=(300, 4)), rng.integers(-1, 2, (100, 4)) + [0, 0, 0, 1e-9]])
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    rows = np.c_[rng.normal(size=(400, 3)) * 10.0 ** rng.integers(-3, 6, (400, 1)), quaternions]
    for row, matrix in zip(rows, poses_to_matrices(rows), strict=True):
        for given in (row, row[None], matrix, matrix[None]):
            expected = poses_to_opencv(given).astype(np.float32)
            np.testing.assert_allclose(host_poses(given), expected, rtol=1.2e-7, atol=1e-30)
        np.testing.assert_array_equal(host_poses(row.astype(np.float32)), row[None].astype(np.float32))
        for convention in ("opengl", "ros_body"):
            given = host_poses(row, convention=convention)
            np.testing.assert_array_equal(given, poses_to_opencv(row, convention).astype(np.float32))


@pytest.mark.parametrize(
    "change",
    [
        lambda m: m.__setitem__((0, 0), np.nan),
        lambda m: m.__setitem__((3, 3), 2),
        lambda m: m.__setitem__((3, 0), 1e-3),
        lambda m: m.__setitem__((slice(0, 3), 0), -m[:3, 0]),
        lambda m: m.__setitem__((slice(0, 3), slice(0, 3)), 1.01 * m[:3, :3]),
        lambda m: m.__setitem__((slice(0, 3), 1), m[:3, 1] + 0.01 * m[:3, 0]),
        lambda m: m.__setitem__((slice(0, 3), slice(0, 3)), 0),
    ],
    ids=["nan", "last", "row", "mirror", "scale", "shear", "zero"],
)
def test_invalid_matrices_raise_alone_and_in_batches(change):
    matrix = poses_to_matrices(eyes(1)[0])
    change(matrix)
    for given in (matrix, matrix.astype(np.float32)[None], np.stack([matrix, matrix])):
        with pytest.raises(wv.errors.PoseError, match="camera_to_world must"):
            host_poses(given)


def test_coordinates_beyond_single_precision_become_infinite():
    """Warp's casters hit nothing from there."""
    row = np.array([1e300, 0, 0, 0, 0, 0, 1.0])
    with np.errstate(over="ignore"):
        assert host_poses(row)[0, 0] == np.inf


def test_images_are_independent_of_thread_count(monkeypatch):
    scene = wv.scenes.PRESETS["room"].build()
    poses = wv.scenes.PRESETS["room"].poses(3)
    camera = wv.Camera.from_fov(150, 95, hfov=1.0)
    pixels = np.random.default_rng(0).uniform(0, 90, (3, 500, 2))
    expected = wv.Renderer(scene, camera, outputs=ALL, threads=1)
    renderer = wv.Renderer(scene, camera, outputs=ALL, threads=8)
    for count in (1, 2, 4, 8, 1):
        monkeypatch.setattr(RayCosts, "threads_for", lambda *_, count=count: count)
        for views in (1, 3):
            assert_identical(renderer.render(poses[:views]), expected.render(poses[:views]))
        assert_identical(renderer.render_at(poses, pixels), expected.render_at(poses, pixels))


def test_small_work_uses_one_thread():
    costs = RayCosts(16)
    assert costs.threads_for(64) == 1
    costs.note(64 * 64, 1, 30_000)
    costs.note(64 * 64, 1, 30_000)
    assert costs.threads_for(64 * 64) == 1
    assert [costs.threads_for(2**k) for k in (14, 20, 30)] == [4, 16, 16]
    assert RayCosts(1).threads_for(2**30) == 1
    assert RayCosts(2).threads_for(2**30) == 2


def test_one_slow_call_does_not_add_threads():
    costs = RayCosts(4)
    for nanoseconds in (30_000, 30_000, 9_000_000, 30_000, 30_000):
        costs.note(4096, 1, nanoseconds)
        assert costs.threads_for(4096) == 1


def test_unprofitable_threads_are_dropped():
    """Waking threads costs more than the work: probe calls with one thread reveal that."""
    costs = RayCosts(4)
    for _ in range(2):
        costs.note(4096, 1, 9_000_000)
    chosen = []
    for _ in range(40):
        chosen.append(costs.threads_for(4096))
        costs.note(4096, chosen[-1], 30_000)
    assert chosen[0] == 4
    assert chosen[-20:] == [1] * 20


@pytest.mark.parametrize(("shared", "least", "most"), [(250_000, 1, 4), (120_000, 35, 38)])
def test_threads_are_used_if_faster(shared, least, most):
    """They are not if another process occupies the other core; regular probes detect a change."""
    costs = RayCosts(2)
    for _ in range(2):
        costs.note(4096, 1, 200_000)
    chosen = []
    for _ in range(40):
        chosen.append(costs.threads_for(4096))
        costs.note(4096, chosen[-1], 200_000 if chosen[-1] == 1 else shared)
    assert least <= chosen.count(2) <= most


def test_arrays_from_template_equal_warp_arrays():
    for shape, dtype in (((2, 3, 4), wp.float32), ((1, 200, 300), wp.vec3), ((0, 5), wp.uint8), ((7,), wp.transform)):
        array = aligned_empty(shape, dtype)
        plain = wp.array(ptr=array.ptr, dtype=dtype, shape=shape, device="cpu")
        mine, its = vars(array), vars(plain)
        assert mine.pop("_ref") is not None
        assert its.pop("_ref") is None
        assert mine == its
        assert array.ptr % 64 == 0
        assert array.numpy().shape[: len(shape)] == shape


@pytest.mark.parametrize("size", [8, 1 << 22])
def test_aligned_zeros_are_zero(size):
    for _ in range(3):  # also in reused memory
        array = aligned_zeros((size,), wp.int32)
        assert array.ptr % 64 == 0
        assert not array.numpy().any()
        array.fill_(7)


def test_arrays_of_unknown_warp_layout_fall_back_to_warp(monkeypatch):
    monkeypatch.setattr(arrays, "_pattern", lambda shape, dtype: (None, 24))
    array = aligned_empty((2, 3), wp.float32)
    array.fill_(3.0)
    assert array.numpy().tolist() == [[3.0] * 3] * 2


def test_array_memory_outlives_the_array():
    image = wv.render(build("cpu"), CAMERA, eyes(1), outputs=("depth",)).depth
    expected, view = image.numpy().copy(), image.numpy()
    del image
    gc.collect()
    others = [aligned_empty((1, 33, 40), wp.float32) for _ in range(50)]
    for other in others:
        other.fill_(-1.0)
    np.testing.assert_array_equal(view, expected)


@pytest.mark.parametrize("caster", ["packets", "rays"])
@pytest.mark.parametrize("convert", [copy.deepcopy, lambda renderer: pickle.loads(pickle.dumps(renderer))])
def test_copied_renderer_renders_alike(device, caster, convert):
    renderer = wv.Renderer(build(device), CAMERA, outputs=ALL, caster=caster)
    out = renderer.render(eyes(2))
    renderer.render(eyes(2), out=out)
    assert_identical(convert(renderer).render(eyes(2)), out)


@pytest.mark.smoke("*-auto")
@pytest.mark.parametrize("caster", ["auto", "rays"])
@pytest.mark.parametrize("convert", [copy.deepcopy, lambda renderer: pickle.loads(pickle.dumps(renderer))])
def test_copied_ray_renderer_renders_alike(device, caster, convert):
    """Device data prepared from rays is not copied with the renderer."""
    lens = wv.cameras.LensCamera(wv.cameras.lenses.OpenCVPinhole(30, 30, 20, 16, (-0.1, 0.02, 0, 0)), 40, 33)
    rays = wv.cameras.Rays(lens.directions, origins=0 * lens.directions + 0.01)
    for camera in (lens, rays):
        renderer = wv.Renderer(build(device), camera, outputs=ALL, caster=caster)
        out = renderer.render(eyes(2))
        assert_identical(convert(renderer).render(eyes(2)), out)


def test_pool_forgets_least_recent_kinds():
    pool, used = Pool(2), []

    def use(kind, name="made"):
        pool.use(kind, lambda: used.append("made") or [name], lambda item: used.append(item[0]))

    for kind in (1, 2, 3):
        use(kind, f"first of {kind}")
    # Two calls at once use distinct objects.
    pool.use(3, lambda: ["another"], lambda outer: use(3, "second of 3"))
    used.clear()
    use(2)
    pool.use(3, list, lambda outer: pool.use(3, list, lambda inner: used.append({outer[0], inner[0]})))
    use(1)
    assert used == ["first of 2", {"first of 3", "second of 3"}, "made", "made"]


def test_strided_device_poses_are_gathered():
    rows = wp.array(np.arange(42, dtype=np.float32).reshape(6, 7), dtype=wp.transform, device="cpu")
    poses = parse_on_device(rows[::2], None, rows.device, "poses")
    assert poses.dtype == wp.transform
    assert poses.is_contiguous
    np.testing.assert_array_equal(poses.numpy(), rows.numpy()[::2])


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_captured_graph_keeps_its_poses(cuda, caster):
    """Later calls with other host poses do not affect a captured graph."""
    scene = build(cuda)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth",), caster=caster)
    poses = wp.array(eyes(2), dtype=wp.transform, device=cuda)
    out = renderer.render(poses)
    expected = out.depth.numpy()
    with wp.ScopedCapture(cuda) as capture:
        renderer.render(poses, out=out)
    other = renderer.render(eyes(2, 5))
    out.depth.zero_()
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(out.depth.numpy(), expected)
    assert not np.array_equal(other.depth.numpy(), expected)


def test_streams_do_not_share_poses(cuda):
    """A call queued behind much work on one stream keeps its poses when another stream renders."""
    scene = wv.scenes.PRESETS["blobs_77k"].build(cuda)
    camera = wv.Camera.from_fov(64, 64, hfov=1.0)
    renderer, rows = wv.Renderer(scene, camera, outputs=("depth",)), wv.scenes.PRESETS["blobs_77k"].poses(8)
    busy = wv.Renderer(scene, wv.Camera.from_fov(640, 480, hfov=1.0), outputs=("depth",))
    expected = [renderer.render(row[None]).depth.numpy() for row in rows]
    many = wp.array(np.tile(rows, (16, 1)), dtype=wp.transform, device=cuda)
    out = busy.render(many)
    streams = [wp.Stream(cuda) for _ in range(2)]
    images = []
    for i, row in enumerate(rows):
        with wp.ScopedStream(streams[i % 2], sync_enter=False):
            busy.render(many, out=out)
            images.append(renderer.render(row[None]))
    wp.synchronize_device(cuda)
    for image, right in zip(images, expected, strict=True):
        np.testing.assert_array_equal(image.depth.numpy(), right)


def test_strided_gpu_poses(cuda):
    scene = build(cuda)
    poses = wp.array(eyes(6), dtype=wp.transform, device=cuda)
    strided = wv.render(scene, CAMERA, poses[::2], outputs=("depth",))
    assert_identical(strided, wv.render(scene, CAMERA, eyes(6)[::2], outputs=("depth",)))
