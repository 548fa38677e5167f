# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""`Renderer` with any sensor: exact images, view and frame numbers, outputs and errors."""

import copy
import pickle
import subprocess
import sys

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.threads import launch_images
from warpvis.kernels.native_source import pixel_options
from warpvis.kernels.pinhole import Window
from warpvis.kernels.sensors import random_numbers
from warpvis.rendering import DepthSensor
from warpvis.sensors import Reason

wp.set_module_options(pixel_options("shared/random.h"))

CAMERA = wv.Camera.from_fov(45, 30, hfov=1.2, near=0.5, far=3.0)
EXACT = ("depth", "points", "normals", "labels", "segmentation")
ALL = (*EXACT, "reasons", "true_depth")


@wp.kernel
def measure_noisily(
    window: Window,
    true_depth: wp.array3d[float],
    normals: wp.array3d[wp.vec3],
    segmentation: wp.array3d[wp.int32],
    draws: wp.array[wp.vec2ui],
    seed: wp.uint32,
    depth_out: wp.array3d[float],
    reasons_out: wp.array3d[wp.uint8],
):
    view, y, x = wp.tid()
    view, y = view + window.first_view, y + window.first_row
    number = draws[view]
    word = random_numbers.random_word(seed, wp.uint32(3), number[0], number[1], y, x)
    reason = int(0)
    depth = float(true_depth[view, y, x])
    if not wp.isfinite(depth):
        reason = 1
    else:
        depth = depth + 0.01 * random_numbers.to_normal(word)
        if depth > 3.0:
            depth = wp.inf
            reason = 2
        elif depth < 0.5:
            depth = -wp.inf
            reason = 2
        elif segmentation[view, y, x] == 1 and normals[view, y, x][2] > 0.5:
            depth = wp.nan
            reason = 7
    depth_out[view, y, x] = depth
    if reasons_out:
        reasons_out[view, y, x] = wp.uint8(reason)


class Noisy(DepthSensor):
    """Adds 1 cm of noise, and drops pixels of the second object that face up."""

    @property
    def needs(self):
        return "normals", "segmentation"

    def measure(self, exposure):
        given = [exposure.true_depth, exposure.normals, exposure.segmentation, exposure.draws]
        given += [wp.uint32(exposure.seed), exposure.depth_out, exposure.reasons_out]
        launch_images(
            measure_noisily,
            exposure.depth_out.shape,
            lambda window: [window, *given],
            device=exposure.scene.device,
            threads=exposure.threads,
        )


class SecondEye(DepthSensor):
    """Returns depth from an eye 0.1 m to the right at the first eye's pixels."""

    def measure(self, exposure):
        depth = exposure.depth_out
        views, height, width = depth.shape
        y, x = np.mgrid[:height, :width]
        pixels = np.tile(np.stack([x, y], axis=-1).reshape(1, 1, -1, 2) + 0.5, (views, 1, 1, 1)).astype(np.float32)
        poses = exposure.poses.numpy()
        axes = wv.core.poses.poses_to_matrices(poses)[:, :3, 0]
        poses[:, :3] += 0.1 * axes
        device = exposure.scene.device
        eyes, points = (
            wp.array(poses, dtype=wp.transform, device=device),
            wp.array(pixels, dtype=wp.vec2, device=device),
        )
        seen = exposure.cast_at(exposure.camera, eyes, points)
        wp.copy(depth, seen.reshape(depth.shape))


def make_scene(device="cpu"):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="box", label="object", pose=(0, 0, 0.25, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.5, 0.5, 0.5)), name="cart", pose=(0, 0.7, 0.25, 0, 0, 0, 1), movable=True)
    return scene


POSES = np.stack([wv.look_at((x, 1.5, 1.2), (0, 0, 0.2)) for x in (-1.0, 0.0, 0.5, 1.0)])


def images(views, names=ALL):
    return {name: getattr(views, name).numpy() for name in names}


def assert_same(first, second, names=ALL):
    for name in names:
        np.testing.assert_array_equal(first[name], second[name], err_msg=name)


def test_measured_and_exact_outputs(device):
    scene = make_scene(device)
    seen = images(wv.render(scene, CAMERA, POSES, outputs=ALL, frame=0, sensor=Noisy(), seed=5))
    endless = wv.Camera.from_fov(45, 30, hfov=1.2)
    exact = images(wv.render(scene, endless, POSES, outputs=EXACT), EXACT)
    assert_same(seen | {"depth": seen["true_depth"]}, exact, ("depth", "normals", "labels", "segmentation"))
    assert {int(reason) for reason in np.unique(seen["reasons"])} == {0, 1, 2, 7}
    valid = seen["reasons"] == Reason.VALID
    np.testing.assert_array_equal(valid, np.isfinite(seen["depth"]))
    np.testing.assert_array_equal(np.isnan(seen["depth"]), seen["reasons"] == Reason.DROPOUT)
    error = seen["depth"][valid] - seen["true_depth"][valid]
    assert 0.009 < error.std() < 0.011
    points = wv.back_project(seen["depth"], CAMERA, POSES).numpy()
    np.testing.assert_array_equal(seen["points"], points)
    assert np.isnan(seen["points"][~valid]).all()


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_images_depend_on_the_view_number_only(device, caster):
    """Images of a view depend only on its number: alone, reordered, in chunks, and for any threads."""
    scene = make_scene(device)
    options = {"outputs": ALL, "sensor": Noisy(), "seed": 9, "caster": caster}
    whole = images(wv.render(scene, CAMERA, POSES, frame=4, **options))
    order = [2, 0, 3]
    some = images(wv.render(scene, CAMERA, POSES[order], frame=[4, 4, 4], view_index=order, threads=1, **options))
    assert_same(some, {name: image[order] for name, image in whole.items()})
    alone = images(wv.render(scene, CAMERA, POSES[3], frame=4, view_index=np.uint32([3]), threads=2, **options))
    assert_same(alone, {name: image[3:] for name, image in whole.items()})
    other = images(wv.render(scene, CAMERA, POSES, frame=5, **options))
    assert_same(other, whole, ("normals", "labels", "segmentation", "true_depth"))
    assert (other["depth"] != whole["depth"]).mean() > 0.3


def test_images_rendered_in_chunks(cuda):
    scene = make_scene(cuda)
    options = {"outputs": ALL, "sensor": Noisy(), "seed": 9}
    whole = images(wv.render(scene, CAMERA, POSES, frame=0, **options))
    parts = wv.render(scene, CAMERA, POSES, device_bytes=200_000, frame=0, **options)
    assert parts.depth.device.is_cpu
    assert_same(images(parts), whole)


def test_frame_counter(device):
    scene = make_scene(device)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth",), sensor=Noisy(), seed=1)
    found = [renderer.render(POSES).depth.numpy() for _ in range(3)]
    assert renderer.frame == 3
    for frame, depth in enumerate(found):
        again = wv.render(scene, CAMERA, POSES, outputs=("depth",), sensor=Noisy(), seed=1, frame=frame)
        np.testing.assert_array_equal(again.depth.numpy(), depth)
    renderer.render(POSES, frame=7)
    assert renderer.frame == 3
    renderer.frame = 1
    np.testing.assert_array_equal(renderer.render(POSES).depth.numpy(), found[1])
    mixed = renderer.render(POSES, frame=[0, 1, 2, 0]).depth.numpy()
    for view, frame in enumerate([0, 1, 2, 0]):
        np.testing.assert_array_equal(mixed[view], found[frame][view])
    assert not np.array_equal(found[0], wv.render(scene, CAMERA, POSES, frame=0, sensor=Noisy(), seed=2).depth.numpy())


@pytest.mark.parametrize("outputs", [("reasons",), ("points",), ("labels", "true_depth"), ("depth", "normals")])
def test_any_outputs_and_out_arrays(device, outputs):
    """Inputs of the model that were not requested are rendered internally."""
    scene = make_scene(device)
    whole = images(wv.render(scene, CAMERA, POSES, outputs=ALL, frame=0, sensor=Noisy()))
    renderer = wv.Renderer(scene, CAMERA, outputs=outputs, sensor=Noisy())
    views = renderer.render(POSES)
    assert {name for name in ALL if getattr(views, name) is not None} == set(outputs)
    assert_same(images(views, outputs), whole, outputs)
    for _ in range(2):
        for name in outputs:
            getattr(views, name).zero_()
        assert renderer.render(POSES, frame=0, out=views) is views
        assert_same(images(views, outputs), whole, outputs)


def test_views_can_be_copied(device):
    views = wv.render(make_scene(device), CAMERA, POSES, outputs=ALL, frame=0, sensor=Noisy())
    for copied in (copy.deepcopy(views), pickle.loads(pickle.dumps(views))):
        assert_same(images(copied), images(views))


def test_renderer_can_be_pickled():
    renderer = wv.Renderer(make_scene(), CAMERA, sensor=Noisy(), seed=3)
    renderer.render(POSES)
    copied = pickle.loads(pickle.dumps(renderer))
    assert copied.frame == 1
    np.testing.assert_array_equal(copied.render(POSES).depth.numpy(), renderer.render(POSES).depth.numpy())


def test_fill_replaces_lost_pixels(device):
    scene = make_scene(device)
    plain = wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=Noisy()).depth.numpy()
    assert np.isnan(plain).any()
    for fill, empty, near in ((0.0, 0.0, 0.0), ("far", CAMERA.far, CAMERA.near)):
        filled = wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=Noisy(), fill=fill).depth.numpy()
        expected = np.where(np.isfinite(plain), plain, np.where(plain == -np.inf, near, empty))
        np.testing.assert_array_equal(filled, expected.astype(np.float32))


def test_near_surfaces_can_be_clipped(device):
    """With `near_plane="clip"` the model receives the surfaces behind, as in images without a sensor."""
    scene = make_scene(device)
    camera = wv.Camera.from_fov(45, 30, hfov=1.2, near=1.4, far=3.0)
    seen = wv.render(scene, camera, POSES, outputs=ALL, frame=0, sensor=Noisy(), near_plane="clip")
    clean = wv.render(scene, camera, POSES, outputs=EXACT, near_plane="clip").depth.numpy()
    there = np.isfinite(clean)
    assert there.any()
    np.testing.assert_array_equal(seen.true_depth.numpy()[there], clean[there])


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_second_eye_sees_the_same_worlds(device, caster):
    scene = make_scene(device)
    moved = {"object_poses": [[[0.3, 0.7, 0.25, 0, 0, 0, 1]], [[0.1, 0.4, 0.9, 0, 0, 0, 1]]], "exclude": ["box"]}
    moved["world_index"] = np.int32([0, 1, 1, 0])
    seen = wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=SecondEye(), caster=caster, **moved)
    eyes = POSES.copy()
    eyes[:, :3] += 0.1 * wv.core.poses.poses_to_matrices(POSES)[:, :3, 0]
    expected = wv.render(scene, CAMERA, eyes, outputs=("depth",), caster=caster, **moved).depth.numpy()
    np.testing.assert_allclose(seen.depth.numpy(), expected, rtol=1e-6)


def test_render_parsed_counts_frames():
    """In `mujoco.Renderer` and other callers of `render_parsed`, each call is a frame."""
    renderer = wv.Renderer(make_scene(), CAMERA, outputs=("depth",), sensor=Noisy())
    poses = wp.array(POSES, dtype=wp.transform, device="cpu")
    worlds = wv.scene.worlds.parse_worlds(renderer.scene, len(POSES), None, None, None)
    first, second = (renderer.render_parsed(poses, worlds).depth.numpy() for _ in range(2))
    expected = [renderer.render(POSES, frame=frame).depth.numpy() for frame in (0, 1)]
    np.testing.assert_array_equal([first, second], expected)


LENS = wv.Camera.from_opencv(CAMERA.to_K(), [0.1, 0, 0, 0], 45, 30)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda scene: wv.Renderer(scene, CAMERA, sensor="d435"), "ArrayError", "sensor must be a model of"),
        (
            lambda scene: wv.Renderer(scene, LENS, sensor=Noisy()),
            "CameraError",
            "must be a warpvis.Camera, got LensCamera",
        ),
        (
            lambda scene: wv.Renderer(scene, CAMERA, sensor=Noisy(), seed=-1),
            "ArrayError",
            "seed must be a whole number",
        ),
        (lambda scene: wv.Renderer(scene, CAMERA, sensor=Noisy(), seed=2**32), "ArrayError", "seed must be below 2"),
        (
            lambda scene: wv.render(scene, CAMERA, POSES, outputs=("reasons",)),
            "ArrayError",
            "outputs must not contain reasons without a sensor",
        ),
        (
            lambda scene: wv.render(scene, CAMERA, POSES, frame=1),
            "ArrayError",
            "frame and view_index must be None without a sensor",
        ),
        (
            lambda scene: wv.render(scene, CAMERA, POSES, view_index=[0, 1, 2, 3]),
            "ArrayError",
            "frame and view_index must be None without a sensor",
        ),
        (lambda scene: noisy(scene, frame=-1), "ArrayError", "frame must be a whole number from 0 up"),
        (lambda scene: noisy(scene, frame=1.5), "ArrayError", "frame must be a whole number from 0 up"),
        (
            lambda scene: noisy(scene, frame=[1, 2]),
            "ArrayError",
            "frame must be whole numbers, one for each of 4 views",
        ),
        (lambda scene: noisy(scene, frame=[0, 1, -2, 0]), "ArrayError", "frame must be from 0 to 2\\^32 - 1, got -2"),
        (lambda scene: noisy(scene, view_index=[0.0, 1, 2, 3]), "ArrayError", "view_index must be whole numbers"),
        (lambda scene: noisy(scene, view_index=2), "ArrayError", "view_index must be whole numbers"),
        (
            lambda scene: noisy(scene, view_index=[0, 1, 2, 2**32]),
            "ArrayError",
            "view_index must be from 0 to 2\\^32 - 1",
        ),
        (
            lambda scene: wv.Renderer(scene, CAMERA, sensor=Noisy()).render_at(POSES, np.ones((4, 2, 2))),
            "CameraError",
            "render_at requires a Renderer without a sensor",
        ),
        (
            lambda scene: wv.render(
                scene, CAMERA, wv.sensors.Motion.from_twist(POSES, (0, 0, 1), (0, 0, 0)), frame=0, sensor=Noisy()
            ),
            "CameraError",
            "sensor must be a LidarNoise or None for a Motion",
        ),
    ],
)
def test_invalid_arguments_raise(make, error, message):
    with pytest.raises(getattr(wv.errors, error), match=message):
        make(make_scene())


def noisy(scene, **arguments):
    return wv.render(scene, CAMERA, POSES, sensor=Noisy(), **arguments)


_THREE_CALLS = """
import numpy as np, warpvis as wv
scene, camera = wv.scenes.PRESETS["room"].build(), wv.Camera.from_fov(64, 48, hfov=1.0)
for seed in (0, 1, 0):
    sensor = wv.sensors.NguyenNoise()
    views = wv.render(scene, camera, wv.look_at((0, 0, 1), (1, 0, 1)), outputs=("depth",), sensor=sensor, seed=seed)
    print("depth", views.depth.numpy().view(np.uint32).sum(dtype=np.uint64))
"""


def test_calls_have_uncorrelated_noise():
    """The noise of two calls is uncorrelated for any scenes and sensors."""
    exact = wv.render(make_scene(), CAMERA, POSES, outputs=("depth",)).depth.numpy()
    first, second = (
        wv.render(make_scene(), CAMERA, POSES, outputs=("depth",), sensor=Noisy(), seed=11).depth.numpy() - exact
        for _ in range(2)
    )
    noisy = np.isfinite(first) & np.isfinite(second)
    assert noisy.sum() > 1000
    assert abs(np.corrcoef(first[noisy], second[noisy])[0, 1]) < 5 / np.sqrt(noisy.sum())


@pytest.mark.slow
def test_noise_is_reproducible_between_runs():
    runs = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", _THREE_CALLS], capture_output=True, text=True, check=True)
        runs.append([line for line in done.stdout.splitlines() if line.startswith("depth")])
    assert runs[0] == runs[1] and len(set(runs[0])) == 3


def test_render_counts_frames_by_seed(device):
    """`wv.render` counts the calls of each seed from 0; calls with an explicit frame do not count."""
    scene, seed = make_scene(device), {"cpu": 4_000_000_001}.get(str(device), 4_000_000_003)
    renderer = wv.Renderer(scene, CAMERA, outputs=("depth",), sensor=Noisy(), seed=seed)
    for _ in range(3):
        wv.render(scene, CAMERA, POSES, sensor=Noisy(), seed=seed, frame=9)
        wv.render(scene, CAMERA, POSES, sensor=Noisy(), seed=seed - 1)
        found = wv.render(scene, CAMERA, POSES, outputs=("depth",), sensor=Noisy(), seed=seed)
        np.testing.assert_array_equal(found.depth.numpy(), renderer.render(POSES).depth.numpy())
