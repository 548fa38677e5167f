# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of stereo depth against the float64 reference, and of shadows, bands and noise at plates and walls."""

import dataclasses
import re

import numpy as np
import pytest
import reference_stereo
import trimesh
import warp as wp
from gpu_code import gpu_code
from reference_stereo import StereoSight

import warpvis as wv
from warpvis.kernels.sensors import stereo
from warpvis.sensors import Reason, StereoDepth

from support.one_pixel import compute_one_pixel_at_a_time
from support.stereo import AHEAD, CAMERA, FULL, OUTPUTS, POSES, box, images, make_scene, wall_scene


def look(scene, sensor, camera, poses, clean):
    """Return the depth of the other eye at the reference's projected points, cast ray by ray, and the eyes' axes."""
    side = sensor.baseline if sensor.other_eye == "right" else -sensor.baseline
    others, place, axes = reference_stereo.place_other_eyes(poses, side)
    other = dataclasses.replace(camera, near=0.0, far=np.inf)
    if not sensor.band:
        other = dataclasses.replace(other, width=3 * camera.width, cx=camera.cx + camera.width)
    least = camera.fx * sensor.baseline / sensor.max_disparity
    points = reference_stereo.place_in_other_eyes(camera, other, place, clean, least)
    renderer = wv.Renderer(scene, other, outputs=("depth",), caster="rays")
    seen = renderer.render_at(others, points.reshape(len(poses), -1, 2).astype(np.float32)).depth.numpy()
    return seen.reshape(clean.shape), axes


def twin(scene, sensor, camera, poses, seen, draws, seed):
    """Return the reference's measurement from clean images."""
    other_depth, axes = look(scene, sensor, camera, poses, seen["true_depth"])
    cosine = reference_stereo.measure_cosine(camera, axes, seen["normals"]) if sensor.full_signal else 1.0
    shares = np.ones(len(scene.objects) + 1)  # including the sky
    if isinstance(sensor.reflectivity, dict):
        for place, part in enumerate(scene.objects):
            shares[place] = sensor.reflectivity.get(part.name, 1.0)
    sight = StereoSight(seen["true_depth"], other_depth, cosine, shares[seen["segmentation"]])
    return reference_stereo.measure_stereo(sensor, camera, sight, draws, seed)


@pytest.mark.smoke("*-packets-*")
@pytest.mark.parametrize(
    "sensor",
    [
        FULL,
        dataclasses.replace(FULL, other_eye="left", noise_spacing=1, subpixel=0, locking=-0.1, hole_spacing=5),
        dataclasses.replace(FULL, band=False, edge_window=1, min_support=0.0, reflectivity=1.0, hole_spacing=4),
        dataclasses.replace(FULL, focal_length=200.0, full_signal=0.0, min_signal=0.0, max_disparity=np.inf),
    ],
    ids=["full", "left", "no band", "focal length"],
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
    draws = np.stack([numbers, frames], axis=-1)
    depth, reasons, margin = twin(scene, sensor, CAMERA, POSES, seen, draws, 11)
    sure = margin > 1e-3
    assert sure.mean() > 0.9
    np.testing.assert_array_equal(seen["reasons"][sure], reasons[sure])
    assert (seen["reasons"] != reasons).mean() < 1e-3
    same = sure & np.isfinite(depth)
    # Normals are within 4e-5 of the reference's: 2e-5 px of disparities of 2 px and more.
    np.testing.assert_allclose(seen["depth"][same], depth[same], rtol=1e-5)
    np.testing.assert_array_equal(np.isnan(seen["depth"]), seen["reasons"] > Reason.RANGE)
    lost = sure & ~np.isfinite(depth)
    np.testing.assert_array_equal(seen["depth"][lost], depth[lost])
    if sensor is FULL:
        assert set(np.unique(seen["reasons"])) == {int(reason) for reason in Reason} - {Reason.SATURATED}


def test_other_eyes_match_reference(device):
    """Also 10 km from the origin, where poses are rounded to 1 mm: the eye's rounding is compensated."""
    rng = np.random.default_rng(0)
    poses = np.concatenate([rng.normal(size=(20, 3)) * [[1e4]], rng.normal(size=(20, 4))], axis=1)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    poses = poses.astype(np.float32)
    made = wp.empty(20, dtype=wp.transform, device=device), wp.empty(20, dtype=stereo.OtherEye, device=device)
    given = [wp.array(poses, dtype=wp.transform, device=device), wp.float64(-0.07), *made]
    wp.launch(stereo.place_other_eyes, dim=20, inputs=given, device=device)
    others, place, axes = reference_stereo.place_other_eyes(poses, -0.07)
    np.testing.assert_array_equal(made[0].numpy(), others)
    eyes = made[1].numpy()
    np.testing.assert_allclose(eyes["place"], place, atol=1e-11)
    np.testing.assert_allclose(eyes["axes"], axes, atol=1e-6)
    assert np.abs(place - [-0.07, 0, 0]).max() > 1e-4


def test_no_false_shadows_far_from_the_origin(device):
    """At 5 km, poses are rounded to 0.5 mm, a twentieth of the baseline: no surface may occlude itself."""
    poses = np.stack([wv.look_at((5000.3 + x, -4000.1, 0), (5000.3 + 2 * x, -3999.1, 0.3)) for x in (0.0, 0.11, 0.37)])
    scene = wv.Scene(device=device)
    box(scene, "wall", (30, 0.5, 30), (5000, -3997, 0))
    seen = images(wv.render(scene, CAMERA, poses, outputs=OUTPUTS, frame=0, sensor=StereoDepth(0.01)))
    assert (seen["reasons"] != Reason.SHADOW).all()
    assert (seen["reasons"] == Reason.VALID).mean() > 0.9


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize(("near_depth", "far_depth", "baseline"), [(1.0, 2.0, 0.05), (0.6, 3.0, 0.05), (1.5, 3.5, 0.2)])
def test_shadow_and_band_widths(device, side, near_depth, far_depth, baseline):
    """f b (1 / z1 - 1 / z2) and f b / z pixels, within 1 px, on the side opposite to the other eye."""
    scene = wall_scene((near_depth, -0.2, 0.2), (far_depth, -10, 10), device=device)
    sensor = StereoDepth(baseline, other_eye=side)
    camera = wv.Camera.from_fov(320, 24, hfov=1.2)
    reasons = wv.render(scene, camera, AHEAD, outputs=("reasons",), frame=0, sensor=sensor).reasons.numpy()[0]
    reasons = reasons if side == "right" else reasons[:, ::-1]
    plate = camera.fx * 0.2 / near_depth  # from the center to its edge
    for row in reasons:
        band, shadow = (np.flatnonzero(row == reason) for reason in (Reason.BAND, Reason.SHADOW))
        assert abs(len(band) - camera.fx * baseline / far_depth) <= 1
        np.testing.assert_array_equal(band, np.arange(len(band)))
        assert abs(len(shadow) - camera.fx * baseline * (1 / near_depth - 1 / far_depth)) <= 1
        assert abs(shadow[-1] + 1 - (camera.cx - plate)) <= 1
        np.testing.assert_array_equal(shadow, shadow[0] + np.arange(len(shadow)))
        assert set(np.unique(row)) == {Reason.VALID, Reason.BAND, Reason.SHADOW}


def test_tiny_baseline_has_no_shadow_or_band(device):
    scene = make_scene(device)
    reasons = wv.render(scene, CAMERA, POSES, outputs=("reasons",), frame=0, sensor=StereoDepth(1e-6)).reasons.numpy()
    assert set(np.unique(reasons)) == {Reason.VALID, Reason.EMPTY, Reason.RANGE}


def test_unbounded_projector_has_no_band(device):
    scene = wall_scene((2.0, -10, 10), (1.0, -2.0, -0.6), device=device)
    with_band, without = (
        wv.render(
            scene, CAMERA, AHEAD, outputs=("reasons",), frame=0, sensor=StereoDepth(0.1, band=band)
        ).reasons.numpy()
        for band in (True, False)
    )
    assert (with_band == Reason.BAND).any()
    assert not (without == Reason.BAND).any()
    beside = with_band == Reason.BAND
    np.testing.assert_array_equal(without[~beside], with_band[~beside])
    # The near plate's shadow falls outside of the image.
    wide = wv.Camera(480, CAMERA.height, CAMERA.fx, CAMERA.fy, 240, CAMERA.cy, CAMERA.near, CAMERA.far)
    whole = wv.render(scene, wide, AHEAD, outputs=("reasons",), frame=0, sensor=StereoDepth(0.1)).reasons.numpy()
    np.testing.assert_array_equal(without, whole[:, :, 160:320])


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_noise_free_image_equals_render(device, caster):
    """Bit for bit where both eyes see, with the camera's range."""
    scene = make_scene(device)
    views = wv.render(
        scene, CAMERA, POSES, outputs=("depth", "reasons"), frame=0, sensor=StereoDepth(0.06), caster=caster
    )
    clean = wv.render(scene, CAMERA, POSES, outputs=("depth",), caster=caster).depth.numpy()
    seen = np.isin(views.reasons.numpy(), (Reason.VALID, Reason.EMPTY, Reason.RANGE))
    assert 0.8 < seen.mean() < 1.0
    np.testing.assert_array_equal(views.depth.numpy()[seen], clean[seen])
    plain = StereoDepth(0.06, shadow=False, band=False)
    all_of_it = wv.render(scene, CAMERA, POSES, outputs=("depth",), frame=0, sensor=plain, caster=caster)
    np.testing.assert_array_equal(all_of_it.depth.numpy(), clean)


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


@pytest.mark.parametrize("width", [1, 15, 64, 65, 160])
def test_rows_equal_single_pixels(monkeypatch, width):
    """Bit for bit for rows of any length: formulas for 16 pixels at a time, and the same for one pixel, as on a GPU."""
    camera = dataclasses.replace(CAMERA, width=width, cx=width / 2)
    options = {"outputs": OUTPUTS, "seed": 4, "frame": 0}
    white = dataclasses.replace(FULL, noise_spacing=1, other_eye="left", edge_window=9, subpixel=0)
    for sensor in (FULL, white, dataclasses.replace(FULL, hole_spacing=4), dataclasses.replace(FULL, hole_spacing=5)):
        rows = images(wv.render(make_scene(), camera, POSES, sensor=sensor, **options))
        with monkeypatch.context() as patch:
            compute_one_pixel_at_a_time(patch, "stereo")
            single = images(wv.render(make_scene(), camera, POSES, sensor=sensor, **options))
        for name in OUTPUTS:
            np.testing.assert_array_equal(rows[name], single[name], err_msg=name)


def test_shadows_follow_object_poses(device):
    """The other eye sees each world's object poses, without excluded objects."""
    scene = wall_scene((3.0, -10, 10), device=device)
    scene.add(trimesh.creation.box((0.4, 0.02, 8.0)), name="plate", pose=(0, 1.01, 0, 0, 0, 0, 1), movable=True)
    worlds = {"object_poses": [[[x, 1.01, 0, 0, 0, 0, 1]] for x in (-0.3, 0.3)]}
    sensor = StereoDepth(0.05)
    poses = np.stack([AHEAD, AHEAD])
    reasons = wv.render(scene, CAMERA, poses, outputs=("reasons",), frame=0, sensor=sensor, **worlds).reasons.numpy()
    places = [np.flatnonzero(image[60] == Reason.SHADOW).mean() for image in reasons]
    assert abs(places[1] - places[0] - 0.6 * CAMERA.fx) < 1
    hidden = wv.render(scene, CAMERA, poses, outputs=("reasons",), frame=0, sensor=sensor, exclude=["plate"], **worlds)
    assert not (hidden.reasons.numpy() == Reason.SHADOW).any()


def test_clipped_surfaces_cast_no_shadow(device):
    scene = wall_scene((0.3, -0.05, 0.05), (2.0, -10, 10), device=device)
    sensor = StereoDepth(0.05)
    clipped = wv.render(
        scene, CAMERA, AHEAD, outputs=("reasons",), frame=0, sensor=sensor, near_plane="clip"
    ).reasons.numpy()
    assert set(np.unique(clipped)) == {Reason.VALID, Reason.BAND}
    kept = wv.render(scene, CAMERA, AHEAD, outputs=("reasons",), frame=0, sensor=sensor).reasons.numpy()
    assert set(np.unique(kept)) == {Reason.VALID, Reason.BAND, Reason.SHADOW, Reason.RANGE}


def test_native_camera_is_returned_or_missing():
    with pytest.raises(wv.errors.CameraError, match="the sensor has no native_camera"):
        StereoDepth(0.1).camera()
    assert dataclasses.replace(FULL, native_camera=CAMERA).camera() is CAMERA


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"baseline": 0.0}, "baseline must be above 0 m"),
        ({"baseline": np.nan}, "baseline must be a finite number"),
        ({"other_eye": "up"}, 'other_eye must be "right" or "left"'),
        ({"focal_length": 0.0}, "focal_length must be above 0 px"),
        ({"max_disparity": 0.0}, "max_disparity must be a number of pixels above 0"),
        ({"max_disparity": np.nan}, "max_disparity must be a number of pixels above 0"),
        ({"sigma": -0.1}, "sigma must be a finite number from 0 up"),
        ({"locking": np.inf}, "locking must be a finite number"),
        ({"noise_spacing": 0}, "noise_spacing must be a whole number from 1 up"),
        ({"noise_spacing": 65}, "noise_spacing must be at most 64 px"),
        ({"subpixel": 0.5}, "subpixel must be a whole number from 0 up"),
        ({"shadow": "yes"}, "shadow must be True or False"),
        ({"band": None}, "band must be True or False"),
        ({"edge_window": 4}, "edge_window must be odd, got 4"),
        ({"edge_window": 65}, "edge_window must be at most 63 px"),
        ({"edge_step": -1.0}, "edge_step must be a finite number from 0 up"),
        ({"min_support": 1.5}, "min_support must be a number from 0 to 1"),
        ({"min_signal": 0.2, "full_signal": 0.1}, "full_signal must be above min_signal, got 0.1 and 0.2"),
        ({"min_signal": 0.2}, "full_signal must be above min_signal"),
        ({"dropout": 2.0}, "dropout must be a number from 0 to 1"),
        ({"hole_spacing": 0}, "hole_spacing must be a whole number from 1 up"),
        ({"hole_spacing": 65}, "hole_spacing must be at most 64 px"),
        ({"native_camera": "kinect"}, "native_camera must be a warpvis.Camera"),
    ],
)
def test_invalid_arguments_raise(arguments, message):
    with pytest.raises(wv.errors.WarpvisError, match=message):
        StereoDepth(**{"baseline": 0.1, **arguments})


def test_incompatible_camera_or_scene_raises():
    scene, endless = make_scene(), wv.Camera.from_fov(160, 120, hfov=1.2)
    with pytest.raises(
        wv.errors.CameraError, match="near of the camera, or max_disparity, must limit disparities to 8192 px"
    ):
        wv.Renderer(scene, endless, sensor=StereoDepth(0.1, band=False))
    with pytest.raises(wv.errors.SceneError, match="no object 'cup', given in reflectivity"):
        wv.Renderer(scene, CAMERA, sensor=dataclasses.replace(FULL, reflectivity={"cup": 0.1}))
    with pytest.raises(wv.errors.ArrayError, match="reflectivity must be 5 numbers"):
        wv.Renderer(scene, CAMERA, sensor=dataclasses.replace(FULL, reflectivity=[0.1, 0.2]))


@pytest.mark.slow
def test_gpu_code_has_no_fused_multiply_add(tmp_path):
    """The PTX code of NVRTC contains no fused multiply-add and no approximate instruction."""
    text = gpu_code("warpvis.kernels.sensors.stereo", tmp_path)
    assert len(re.findall(r"\bmul\.(?:rn\.)?f32", text)) > 10
    assert not re.findall(r"\bfma\.\w+\.f32|\.approx\.|\.ftz\.", text)


def test_baseline_in_millimeters_warns():
    with pytest.warns(
        UserWarning,
        match=r"baseline is 55 m, longer than that of any depth camera. If it is in millimeters, pass 0.055\.",
    ):
        StereoDepth(55)


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize(
    "make", [wv.sensors.realsense_d435, wv.sensors.kinect_v1, lambda *size: StereoDepth(0.3, max_disparity=500.0)]
)
def test_limits_of_the_other_eye_change_no_pixel(make, side, monkeypatch):
    """Surfaces beyond the limits cannot hide a pixel's point."""
    sensor = dataclasses.replace(make(150, 101), other_eye=side)
    camera = wv.Camera.from_fov(150, 101, hfov=1.4, near=0.3, far=8.0)
    limited, cast_at = [], wv.rendering.Exposure.cast_at

    def cast(exposure, eye, poses, points, limits=None):
        limited.append(limits is not None)
        seen = cast_at(exposure, eye, poses, points, limits if len(limited) == 1 else None)
        depths.append(seen.numpy().copy())
        return seen

    monkeypatch.setattr(wv.rendering.Exposure, "cast_at", cast)
    preset = wv.scenes.PRESETS["room"]
    scene, poses = preset.build(), np.asarray(preset.poses(4), dtype=np.float32)
    depths, measured = [], []
    for _ in range(2):  # only the first one with limits
        views = wv.render(scene, camera, poses, outputs=("depth", "reasons"), sensor=sensor, seed=1, frame=2)
        measured.append((views.depth.numpy(), views.reasons.numpy()))
    for mine, theirs in zip(*measured, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    assert all(limited) and (measured[0][1] == Reason.SHADOW).any()
    assert (depths[0] <= depths[1]).all() and (depths[0] < depths[1]).any()
