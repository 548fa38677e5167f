# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of time-of-flight depth against the float64 reference, Lange's formula, and closed forms of mixed pixels."""

import dataclasses
import re

import numpy as np
import pytest
import reference_time_of_flight as twin
import trimesh
import warp as wp
from gpu_code import gpu_code
from scipy import stats

import warpvis as wv
from warpvis.kernels.sensors.sub_rays import list_sub_rays
from warpvis.sensors import Reason, TimeOfFlight
from warpvis.sensors.depth import _time_of_flight

from support import stereo
from support.stereo import AHEAD, CAMERA, OUTPUTS, POSES, box, images

LIGHT = twin.LIGHT
FULL = TimeOfFlight(
    (100e6, 80e6),
    signal=20000.0,
    background=300.0,
    contrast=0.8,
    reflectivity={"ball": 0.3, "box": 0.8},
    offset=0.004,
    wiggle=0.01,
    wiggle_phase=0.5,
    min_coherence=0.75,
    min_signal=0.05,
    max_signal=4.0,
)


def make_scene(device="cpu"):
    """Return the scene of stereo cameras with a second post, far away."""
    scene = stereo.make_scene(device)
    box(scene, "far post", (0.05, 0.02, 2.0), (0.9, 3.0, 0.0))
    return scene


def plates(*given, device="cpu"):
    """Return upright plates in front of a camera that looks along y, given by distance, left and right end."""
    scene = wv.Scene(device=device)
    for number, (distance, left, right) in enumerate(given):
        box(scene, f"plate {number}", (right - left, 1e-6, 8.0), ((left + right) / 2, distance, 0))
    return scene


def shares_of(scene, sensor):
    shares = np.ones(len(scene.objects) + 1)  # including the sky
    if isinstance(sensor.reflectivity, dict):
        for place, part in enumerate(scene.objects):
            shares[place] = sensor.reflectivity.get(part.name, 1.0)
    return shares


def mix_by_twin(scene, sensor, camera, poses, seen):
    """Return the reference's mix of all pixels, with sub-rays cast one by one, and the margins of edge decisions."""
    shares, depth = shares_of(scene, sensor), seen["true_depth"]
    rays, normals = twin.pixel_rays(camera), twin.in_camera(poses, seen["normals"])
    whole = twin.mix_sub_rays(
        dataclasses.replace(sensor, frequencies=1e6),
        rays[..., None, :],
        normals[..., None, :],
        depth[..., None],
        shares[seen["segmentation"]][..., None],
    )
    mix = dataclasses.replace(whole, range=depth.astype(np.float64) * np.linalg.norm(rays, axis=-1))
    mix.margin = np.full(depth.shape, np.inf)
    if not sensor.mixing:
        return mix, np.full(depth.shape, np.inf)
    edges, margin = twin.find_edges(camera, poses, depth, seen["normals"], sensor.edge_step)
    ideal = dataclasses.replace(camera, near=0.0, far=np.inf)
    renderer = wv.Renderer(scene, ideal, outputs=("depth", "normals", "segmentation"), caster="rays")
    for view, pose in enumerate(poses):
        pixels = np.flatnonzero(edges[view])
        points = twin.place_sub_rays(pixels, camera.width)
        found = renderer.render_at(pose, points.reshape(1, -1, 2).astype(np.float32))
        depth, normals, hit = (
            getattr(found, name).numpy().reshape(len(pixels), 16, *last)
            for name, last in (("depth", ()), ("normals", (3,)), ("segmentation", ()))
        )
        local = twin.in_camera(pose[None], normals[None])[0]
        part = twin.mix_sub_rays(sensor, twin.rays_at(camera, points), local, depth, shares[hit])
        for field in dataclasses.fields(twin.Mix):
            getattr(mix, field.name)[view].reshape(-1)[pixels] = getattr(part, field.name)
    return mix, margin


@pytest.mark.smoke("*-packets-full", "*-rays-three")
@pytest.mark.parametrize(
    "sensor",
    [
        FULL,
        dataclasses.replace(FULL, frequencies=75e6, min_coherence=0.0, reflectivity=1.0),
        dataclasses.replace(FULL, frequencies=(120e6, 80e6, 16e6), signal=np.inf, background=0.0),
        dataclasses.replace(FULL, mixing=False),
    ],
    ids=["full", "one frequency", "three", "no mixing"],
)
@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_measurement_matches_reference(device, sensor, caster):
    """Reasons may differ only for decisions within rounding; depth is equal to rounding."""
    scene = make_scene(device)
    frames, numbers = [3, 4, 0], [0, 7, 2]
    views = wv.render(
        scene, CAMERA, POSES, outputs=OUTPUTS, sensor=sensor, seed=11, frame=frames, view_index=numbers, caster=caster
    )
    seen = images(views)
    mix, margin = mix_by_twin(scene, sensor, CAMERA, POSES, seen)
    depth, reasons, decided = twin.measure_time_of_flight(sensor, CAMERA, mix, np.stack([numbers, frames], axis=-1), 11)
    sure = (decided > 1e-3) & (margin > 1e-4)
    assert sure.mean() > 0.95
    # A sub-ray within rounding of an edge may hit the other surface.
    differ = sure & (seen["reasons"] != reasons)
    assert differ.mean() < 1e-4
    both = sure & np.isfinite(depth) & np.isfinite(seen["depth"])
    wrong = np.abs(seen["depth"][both] - depth[both]) > 2e-5
    assert wrong.mean() < 1e-4
    lost = sure & ~differ & ~np.isfinite(depth)
    np.testing.assert_array_equal(seen["depth"][lost], depth[lost])
    np.testing.assert_array_equal(np.isnan(seen["depth"]), seen["reasons"] > Reason.RANGE)
    if sensor is FULL:
        expected = {int(reason) for reason in Reason} - {Reason.SHADOW, Reason.BAND}
        assert set(np.unique(seen["reasons"])) == expected


@pytest.mark.parametrize("angle", [0, 30, 60, 80])
@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0, 5.0])
def test_wall_noise_matches_the_formula(device, distance, angle):
    """Mean, deviation and Kolmogorov-Smirnov test of ranges: sqrt(A + B) / A with each pixel's A."""
    scene = wv.Scene(device=device)
    tilt = np.radians(angle)
    pose = (0, distance, 0, 0, 0, np.sin(tilt / 2), np.cos(tilt / 2))
    scene.add(trimesh.creation.box((60, 1e-4, 60)), name="wall", pose=pose)
    camera = wv.Camera.from_fov(120, 100, hfov=0.15)
    sensor = TimeOfFlight(5e6, signal=1e6, background=5e3, contrast=0.5, reflectivity=0.6)
    seen = images(wv.render(scene, camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=sensor, seed=5))
    assert (seen["reasons"] == Reason.VALID).all()
    rays = twin.pixel_rays(camera)
    length = np.linalg.norm(rays, axis=-1)
    true_range = seen["true_depth"][0].astype(np.float64) * length
    cosine = np.abs(rays @ [-np.sin(tilt), 0, np.cos(tilt)]) / length
    electrons = 1e6 * 0.6 * cosine / true_range**2
    sigma = LIGHT / (4 * np.sqrt(2) * np.pi * 5e6) * np.sqrt(electrons + 5e3) / (0.5 * electrons)
    error = ((seen["depth"][0] * length - true_range) / sigma).ravel()
    count = error.size
    assert abs(error.mean()) < 4 / np.sqrt(count)
    assert abs(error.std() - 1) < 4 / np.sqrt(2 * count)
    assert stats.kstest(error, "norm").pvalue > 1e-4


def test_noise_is_white(device):
    scene = plates((2.0, -10, 10), device=device)
    sensor = TimeOfFlight(50e6, signal=1e4)
    first, second = (
        wv.render(scene, CAMERA, AHEAD, outputs=("depth",), sensor=sensor, frame=frame).depth.numpy()[0] - 2.0
        for frame in (0, 1)
    )
    most = 4 / np.sqrt(first.size)
    for other in (second, np.roll(first, 1, axis=0), np.roll(first, 1, axis=1)):
        assert abs(np.corrcoef(first.ravel(), other.ravel())[0, 1]) < most


def test_noise_free_image_without_edges_equals_render(device):
    """Bit for bit."""
    scene = make_scene(device)
    clean = wv.render(scene, CAMERA, POSES, outputs=("depth",)).depth.numpy()
    plain = TimeOfFlight(20e6, mixing=False)
    np.testing.assert_array_equal(
        wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=plain).depth.numpy(), clean
    )
    views = wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, frame=0, sensor=TimeOfFlight(20e6))
    edges, margin = twin.find_edges(CAMERA, POSES, views.true_depth.numpy(), views.normals.numpy(), 0.01)
    away = ~edges & (margin > 1e-4)
    assert away.mean() > 0.8
    np.testing.assert_array_equal(views.depth.numpy()[away], clean[away])


def test_results_are_independent_of_batches_threads_and_order(device):
    scene = make_scene(device)
    options = {"outputs": OUTPUTS, "sensor": FULL, "seed": 4}
    whole = images(wv.render(scene, CAMERA, POSES, threads=1, frame=0, **options))
    for threads in (2, 5):
        again = images(wv.render(scene, CAMERA, POSES, threads=threads, frame=0, **options))
        for name in OUTPUTS:
            np.testing.assert_array_equal(again[name], whole[name])
    renderer = wv.Renderer(scene, CAMERA, **options)
    for view in (2, 0, 1):
        alone = images(renderer.render(POSES[view], frame=0, view_index=[view]))
        for name in OUTPUTS:
            np.testing.assert_array_equal(alone[name][0], whole[name][view], err_msg=name)


def test_sub_rays_in_parts_give_equal_images(device, monkeypatch):
    """For any memory limit of sub-rays."""
    from warpvis.sensors.depth import _time_of_flight

    scene = make_scene(device)
    whole = images(wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, frame=0, sensor=FULL, seed=4))
    monkeypatch.setattr(_time_of_flight, "_PART_BYTES", 1)
    parts = images(wv.render(scene, CAMERA, POSES, outputs=OUTPUTS, frame=0, sensor=FULL, seed=4))
    for name in OUTPUTS:
        np.testing.assert_array_equal(parts[name], whole[name])


def test_sub_rays_of_all_pixels_give_equal_images(device, monkeypatch):
    """As on a GPU, where the host does not know the number of edge pixels: in lists of parts of all pixels."""
    scene = make_scene(device)
    options = {"outputs": OUTPUTS, "sensor": FULL, "seed": 4, "caster": "rays"}
    whole = images(wv.render(scene, CAMERA, POSES, frame=0, **options))
    monkeypatch.setattr(_time_of_flight, "_counts_on_host", lambda device: False)
    for size in (2**28, 1):
        monkeypatch.setattr(_time_of_flight, "_PART_BYTES", size)
        monkeypatch.setattr(_time_of_flight, "_GPU_PIXELS", 320)
        again = images(wv.render(scene, CAMERA, POSES, frame=0, **options))
        for name in OUTPUTS:
            np.testing.assert_array_equal(again[name], whole[name])


def test_noise_beyond_float_range_drops_out(device):
    sensor = TimeOfFlight(50e6, signal=1e-300)
    seen = images(wv.render(make_scene(device), CAMERA, POSES, outputs=OUTPUTS, frame=0, sensor=sensor))
    assert set(np.unique(seen["reasons"])) == {Reason.EMPTY, Reason.DROPOUT}
    np.testing.assert_array_equal(np.isnan(seen["depth"]), seen["reasons"] == Reason.DROPOUT)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (16, 8), (37, 60)])
def test_edge_pixels_are_numbered_and_listed_in_parts(device, height, width):
    """Views with none, some and all pixels at edges."""
    count, capacity = height * width, 64
    places = np.arange(count)
    some = np.where(np.random.default_rng(0).random(count) < 0.2, places, -1)
    edges = np.stack([some, np.full(count, -1), places, some]).astype(np.int32).reshape(4, height, width)
    slots = wp.array(edges, dtype=wp.int32, device=device)
    pixels, counts, _ = _time_of_flight._number_edges(Scratches(device), slots)
    expected = twin.number_edges(edges, slots.numpy())
    np.testing.assert_array_equal(counts.numpy(), [len(numbers) for numbers in expected])
    for view, numbers in enumerate(expected):
        np.testing.assert_array_equal(pixels.numpy()[view, : len(numbers)], numbers)
    in_tiles = twin.count_edges(edges, 8)
    for view, row, column in np.ndindex(*in_tiles.shape):
        numbers = slots.numpy()[view, 8 * row : 8 * row + 8, 8 * column : 8 * column + 8]
        numbers = numbers[numbers >= 0]
        assert len(numbers) == in_tiles[view, row, column]
        assert not len(numbers) or numbers.max() - numbers.min() == len(numbers) - 1
    points, used = (wp.empty(shape, dtype=kind, device=device) for shape, kind in [((4, 1024), wp.vec2), (4, wp.int32)])
    for first in range(0, count, capacity):
        given = [pixels, counts, first, width, 100, points, used]
        wp.launch(list_sub_rays, (4, 100), inputs=given, device=device)
        for view, listed in enumerate(twin.list_sub_rays(expected, first, width, capacity)):
            assert used.numpy()[view] == len(listed)
            np.testing.assert_array_equal(points.numpy()[view, : len(listed)], listed)


class Scratches:
    """The memory of an `Exposure`."""

    def __init__(self, device):
        self.device = device

    def scratch(self, name, shape, dtype):
        return wp.empty(shape, dtype=dtype, device=self.device)


@pytest.mark.parametrize("part", range(1, 16))
def test_flying_pixels_at_a_step(device, part):
    """`part` sixteenths of a column see the front plate: the phase is that of the sum of two phasors."""
    near, far = 1.0, 1.3
    camera = wv.Camera(32, 24, 200.0, 200.0, 16.0, 12.0)
    edge = (part / 16 - 16 + 10) * near / 200  # the plate ends within the eleventh column
    scene = plates((near, -5, edge), (far, -10, 10), device=device)
    sensor = TimeOfFlight(60e6)
    seen = images(wv.render(scene, camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=sensor))
    column = seen["depth"][0, 12, :]
    np.testing.assert_allclose(np.delete(column, 10)[[0, 8, 10, 20]], [near, near, far, far], atol=5e-6)
    places = twin.place_sub_rays(np.array(12 * 32 + 10), 32)
    rays = twin.rays_at(camera, places)
    in_front = places[:, 0] < 10 + part / 16
    assert in_front.sum() == part
    r = np.where(in_front, near, far) * np.linalg.norm(rays, axis=-1)
    weight = 1 / np.linalg.norm(rays, axis=-1) / r**2
    phasor = (weight * np.exp(4j * np.pi * 60e6 * r / LIGHT)).sum()
    expected = np.angle(phasor) % (2 * np.pi) * LIGHT / (4 * np.pi * 60e6)
    length = np.linalg.norm(twin.pixel_rays(camera)[12, 10])
    assert near < column[10] < far
    assert column[10] * length == pytest.approx(expected, abs=2e-6)


def test_half_covered_pixel_measures_the_mean(device):
    """If both surfaces return equal light, the angle of the sum is the mean of the angles."""
    near, far = 1.0, 1.3
    camera = wv.Camera(32, 24, 2000.0, 2000.0, 16.0, 12.0)
    scene = plates((near, -5, -5.5 * near / 2000), (far, -10, 10), device=device)
    sensor = TimeOfFlight(60e6, reflectivity=[(near / far) ** 2, 1.0])
    depth = wv.render(scene, camera, AHEAD, outputs=("depth",), frame=0, sensor=sensor).depth.numpy()[0]
    np.testing.assert_allclose(depth[:, 10], (near + far) / 2, atol=1e-4)


def test_mixed_pixels_are_lost_by_coherence(device):
    """|sum| / sum for two phasors of equal light is the cosine of half the angle between them."""
    near, far, frequency = 1.0, 1.3, 60e6
    camera = wv.Camera(32, 24, 2000.0, 2000.0, 16.0, 12.0)
    scene = plates((near, -5, -5.5 * near / 2000), (far, -10, 10), device=device)
    coherence = np.cos(2 * np.pi * frequency * (far - near) / LIGHT)
    for threshold, reason in ((coherence - 1e-3, Reason.VALID), (coherence + 1e-3, Reason.EDGE)):
        sensor = TimeOfFlight(frequency, reflectivity=[(near / far) ** 2, 1.0], min_coherence=threshold)
        views = wv.render(scene, camera, AHEAD, outputs=("depth", "reasons"), frame=0, sensor=sensor)
        reasons = views.reasons.numpy()[0]
        assert (reasons[:, 10] == reason).all()
        assert (np.delete(reasons, 10, axis=1) == Reason.VALID).all()


def test_thin_objects_blend_at_pixel_centers(device):
    """Objects between pixel centers are missed, as documented."""
    camera = wv.Camera(32, 24, 200.0, 200.0, 16.0, 12.0)
    for middle, found in ((10.5, True), (10.95, False)):
        at = (middle - 16) / 200
        scene = plates((1.0, at - 0.001, at + 0.001), (1.3, -10, 10), device=device)
        views = wv.render(scene, camera, AHEAD, outputs=("depth", "true_depth"), frame=0, sensor=TimeOfFlight(60e6))
        column = views.depth.numpy()[0, 12, 10]
        assert (column < 1.29) == found
        assert column > 1.05


@pytest.mark.parametrize("start", [0.0, 1.0])
def test_wiggling_is_a_sine_of_range(device, start):
    """The error has the given amplitude and four periods per revolution of the phase: c / 8 f of range."""
    frequency, amplitude = 50e6, 0.02
    sensor = TimeOfFlight(frequency, wiggle=amplitude, wiggle_phase=start, offset=0.003)
    camera = wv.Camera(4, 4, 1e5, 1e5, 2.0, 2.0)
    scene = plates((0.0, -1, 1), device=device)
    distance = np.linspace(0.5, 2.5, 200)
    poses = np.stack([wv.look_at((0, -at, 0), (0, 1, 0)) for at in distance])
    views = wv.render(scene, camera, poses, outputs=("depth", "true_depth"), frame=0, sensor=sensor)
    true_depth = views.true_depth.numpy()[:, 2, 2].astype(np.float64)
    error = views.depth.numpy()[:, 2, 2] - true_depth
    period = LIGHT / (8 * frequency)
    expected = 0.003 + amplitude * np.sin(2 * np.pi * true_depth / period + start)
    np.testing.assert_allclose(error, expected, atol=1e-6)
    assert np.ptp(error) == pytest.approx(2 * amplitude, rel=1e-2)


@pytest.mark.parametrize(("frequencies", "wrap"), [(100e6, 1.499), ((120e6, 80e6), 3.747), ((100e6, 90e6), 14.99)])
def test_depth_wraps_at_the_unambiguous_range(device, frequencies, wrap):
    sensor = TimeOfFlight(frequencies)
    assert sensor.unambiguous_range == pytest.approx(wrap, abs=1e-3)
    camera = wv.Camera(4, 4, 1e5, 1e5, 2.0, 2.0)
    for distance in (1.2, 2.0, 5.0):
        depth = wv.render(plates((distance, -1, 1), device=device), camera, AHEAD, frame=0, sensor=sensor).depth.numpy()
        np.testing.assert_allclose(depth, distance % sensor.unambiguous_range, atol=1e-5)


def test_mixed_pixels_of_distant_surfaces_are_unwrapped(device):
    """With one frequency, flying pixels wrap; with several, a pixel dominated by one surface measures that surface."""
    camera = wv.Camera(32, 24, 200.0, 200.0, 16.0, 12.0)
    scene = plates((1.0, -5, (-5.03125) / 200), (3.4, -10, 10), device=device)
    seen = wv.render(scene, camera, AHEAD, outputs=("depth",), frame=0, sensor=TimeOfFlight((100e6, 80e6, 20e6)))
    depth = seen.depth.numpy()[0, :, 10]
    assert (np.abs(depth - 1.0) < 0.05).all()


def test_reasons_by_amount_of_light(device):
    """Too much light, too little, and too little because of the angle."""
    scene = wv.Scene(device=device)
    names = ("bright", "white", "black", "steep")
    for number, name in enumerate(names):
        tilt = np.radians(37 if name == "steep" else 0)
        pose = (1.5 * (number - 1.5), 2.0, 0, 0, 0, np.sin(tilt / 2), np.cos(tilt / 2))
        scene.add(trimesh.creation.box((1.0, 0.001, 4.0)), name=name, pose=pose)
    sensor = TimeOfFlight(
        20e6, reflectivity={"bright": 40.0, "black": 0.05}, min_signal=0.03, max_signal=1.0, mixing=False
    )
    camera = wv.Camera.from_fov(320, 24, hfov=2.0)
    seen = images(wv.render(scene, camera, AHEAD, outputs=OUTPUTS, frame=0, sensor=sensor))
    reasons = (Reason.SATURATED, Reason.VALID, Reason.DROPOUT, Reason.GRAZING)
    for number, reason in enumerate(reasons):
        of_it = seen["segmentation"] == number
        assert of_it.sum() > 20
        assert (seen["reasons"][of_it] == reason).mean() > 0.8, names[number]
    assert (seen["reasons"][seen["segmentation"] < 0] == Reason.EMPTY).all()
    assert np.isnan(seen["depth"][seen["reasons"] > Reason.RANGE]).all()


def test_sub_rays_follow_object_poses_and_exclude(device):
    """Sub-rays see each world's object poses."""
    scene = plates((3.0, -10, 10), device=device)
    scene.add(trimesh.creation.box((0.4, 0.02, 8.0)), name="plate", pose=(0, 2.81, 0, 0, 0, 0, 1), movable=True)
    worlds = {"object_poses": [[[x, 2.81, 0, 0, 0, 0, 1]] for x in (-0.3137, 0.3137)]}
    poses, options = np.stack([AHEAD, AHEAD]), {"outputs": ("depth",), "sensor": TimeOfFlight(20e6)}
    depth = wv.render(scene, CAMERA, poses, frame=0, **options, **worlds).depth.numpy()
    flying = (depth > 2.81) & (depth < 2.99)
    assert flying.any(axis=(1, 2)).all()
    np.testing.assert_allclose(depth[0], depth[1][:, ::-1], atol=0.02)
    hidden = wv.render(scene, CAMERA, poses, exclude=["plate"], frame=0, **options, **worlds).depth.numpy()
    np.testing.assert_allclose(hidden, 3.0, atol=1e-6)


@pytest.mark.parametrize("mode", ["nfov", "nfov_binned", "wfov", "wfov_binned"])
def test_azure_kinect_has_the_specified_noise(device, mode):
    """At most 17 mm for a frontal surface of 15 % reflectivity within the range, and 11 mm + 0.1 % of systematic error
    (Tolgyessy 2021)."""
    whole = wv.sensors.azure_kinect(mode).camera()
    # Without the range: noise exceeds it.
    sensor = dataclasses.replace(wv.sensors.azure_kinect(mode), reflectivity=0.15, native_camera=None)
    camera = wv.Camera(60, 60, whole.fx * 10, whole.fy * 10, 30, 30)
    for distance in np.linspace(whole.near, whole.far, 5):
        scene = plates((distance, -10, 10), device=device)
        error = wv.render(scene, camera, AHEAD, outputs=("depth",), frame=0, sensor=sensor).depth.numpy() - distance
        sigma = 0.017 * distance / whole.far
        assert error.std() == pytest.approx(sigma, rel=0.05)
        assert abs(error.mean()) < 0.011 + 0.001 * distance + 4 * sigma / 60


@pytest.mark.parametrize("profile", ["azure_kinect", "realsense_l515", "kinect_v2", "pmd_flexx2"])
def test_profiles_measure_a_room(profile):
    sensor = getattr(wv.sensors, profile)()
    camera = sensor.camera()
    assert sensor.unambiguous_range > camera.far
    whole = wv.Camera(
        camera.width // 4, camera.height // 4, camera.fx / 4, camera.fy / 4, camera.cx / 4, camera.cy / 4, 0.1, 7.0
    )
    seen = images(wv.render(make_scene(), whole, POSES, outputs=OUTPUTS, frame=0, sensor=sensor))
    valid = seen["reasons"] == Reason.VALID
    assert valid.mean() > 0.5
    error = np.abs(seen["depth"][valid] - seen["true_depth"][valid])
    assert 0.001 < np.median(error) < 0.02


def test_native_camera_is_returned_or_missing():
    with pytest.raises(wv.errors.CameraError, match="the sensor has no native_camera"):
        TimeOfFlight(1e8).camera()
    assert dataclasses.replace(FULL, native_camera=CAMERA).camera() is CAMERA


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frequencies": 0}, "frequencies must be 1 to 3 whole numbers of Hz"),
        ({"frequencies": 1.5e6 + 0.5}, "frequencies must be 1 to 3 whole numbers of Hz"),
        ({"frequencies": ()}, "frequencies must be 1 to 3 whole numbers of Hz"),
        ({"frequencies": (1e6, 2e6, 3e6, 4e6)}, "frequencies must be 1 to 3 whole numbers of Hz"),
        ({"frequencies": "fast"}, "frequencies must be 1 to 3 whole numbers of Hz"),
        ({"frequencies": np.nan}, "frequencies must be 1 to 3 whole numbers of Hz"),
        ({"frequencies": (100e6, 100e6 - 1)}, "frequencies must have a common divisor of at least 1/1000"),
        ({"signal": 0.0}, "signal must be a number above 0"),
        ({"background": -1.0}, "background must be a finite number from 0 up"),
        ({"contrast": 0.0}, "contrast must be above 0"),
        ({"contrast": 1.5}, "contrast must be a number from 0 to 1"),
        ({"offset": np.inf}, "offset must be a finite number"),
        ({"wiggle": np.nan}, "wiggle must be a finite number"),
        ({"wiggle_phase": "half"}, "wiggle_phase must be a finite number"),
        ({"mixing": "yes"}, "mixing must be True or False"),
        ({"edge_step": 0.0}, "edge_step must be above 0 m"),
        ({"min_coherence": 1.5}, "min_coherence must be a number from 0 to 1"),
        ({"min_signal": -1.0}, "min_signal must be a finite number from 0 up"),
        ({"max_signal": np.nan}, "max_signal must be a number above 0"),
        ({"min_signal": 2.0, "max_signal": 1.0}, "max_signal must be above min_signal, got 1 and 2"),
        ({"native_camera": "azure"}, "native_camera must be a warpvis.Camera"),
    ],
)
def test_invalid_arguments_raise(arguments, message):
    with pytest.raises(wv.errors.WarpvisError, match=message):
        TimeOfFlight(**{"frequencies": 1e8, **arguments})


def test_invalid_reflectivity_and_mode_raise():
    with pytest.raises(wv.errors.SceneError, match="no object 'cup', given in reflectivity"):
        wv.Renderer(make_scene(), CAMERA, sensor=dataclasses.replace(FULL, reflectivity={"cup": 0.1}))
    with pytest.raises(wv.errors.ArrayError, match='mode must be "nfov", "nfov_binned", "wfov" or "wfov_binned"'):
        wv.sensors.azure_kinect("wide")


@pytest.mark.slow
@pytest.mark.parametrize("module", ["sub_rays", "time_of_flight"])
def test_gpu_code_has_no_fused_multiply_add(module, tmp_path):
    """The PTX code of NVRTC contains no fused multiply-add and no approximate instruction."""
    text = gpu_code(f"warpvis.kernels.sensors.{module}", tmp_path)
    body = text[text.index(".entry") :]
    assert re.search(r"\bmul\.(?:rn\.)?f64", body)
    assert not re.findall(r"\bfma\.|\.approx\.|\.ftz\.", body)
