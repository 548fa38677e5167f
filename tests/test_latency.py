# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Delayed depth: the source frame of every view, and images that must not be delayed."""

import numpy as np
import pytest
import reference_latency
import warp as wp

import warpvis as wv
from warpvis.sensors import Corruptions, Latency

from support.kinect_noise import CAMERA, make_scene
from support.stereo import POSES

DELAYED = ("depth", "points", "reasons")
OUTPUTS = (*DELAYED, "true_depth", "labels")
MODEL = Corruptions(multiplied=0.01, dropout=0.1)


def moved(frame):
    """Return poses of rising cameras at `frame`."""
    return POSES + np.array([0, 0, 0.05 * frame, 0, 0, 0, 0], dtype=np.float32)


def images(views, names=OUTPUTS):
    return {name: getattr(views, name).numpy().copy() for name in names}


def play(device, frames, latency, numbers=None, outputs=OUTPUTS):
    """Return rendered images and delayed images of calls with frames of shape (calls, V)."""
    renderer = wv.Renderer(make_scene(device), CAMERA, outputs=outputs, sensor=MODEL, seed=5)
    exact, old = [], []
    for call, row in enumerate(frames):
        views = renderer.render(moved(call), frame=row)
        exact.append(images(views, outputs))
        old.append(images(latency(views, frame=None if numbers is None else numbers[call]), outputs))
    return [{name: np.stack([one[name] for one in many]) for name in outputs} for many in (exact, old)]


@pytest.mark.filterwarnings("error::warpvis.errors.IntrinsicsWarning")
def test_depth_is_delayed_by_given_frames(device):
    """Delayed depth keeps its original noise; exact outputs are current."""
    frames = np.arange(6)[:, None].repeat(3, axis=1)
    exact, old = play(device, frames, Latency(2))
    for name in DELAYED:
        np.testing.assert_array_equal(old[name][2:], exact[name][:-2])
        np.testing.assert_array_equal(old[name][:2], exact[name][[0, 0]])
        assert (old[name] != exact[name])[2:].any()
    for name in ("true_depth", "labels"):
        np.testing.assert_array_equal(old[name], exact[name])


@pytest.mark.parametrize("delays", [0, 1, 3, (0, 2, 5)], ids=str)
def test_delays_match_reference(device, delays):
    """Frame counters of views restart, or skip frames, at different calls."""
    frames = np.array([[0, 7, 5], [1, 8, 6], [2, 0, 7], [3, 1, 9], [4, 2, 10], [0, 3, 11], [1, 3, 12], [2, 4, 13]])
    exact, old = play(device, frames, Latency(delays), frames)
    for name in DELAYED:
        expected = reference_latency.delay_images(exact[name], frames, np.broadcast_to(delays, 3))
        np.testing.assert_array_equal(old[name], expected)


def test_frame_defaults_to_call_count(device):
    frames = np.array([4, 5, 6, 0, 1])[:, None].repeat(3, axis=1)
    counted = play(device, frames[:3], Latency(2))[1]
    said = play(device, frames, Latency(2), [4, 5, 6, 0, 1])
    np.testing.assert_array_equal(said[1]["depth"][:3], counted["depth"])
    np.testing.assert_array_equal(said[1]["depth"][3:], said[0]["depth"][[3, 3]])


def test_reset_clears_selected_views(device):
    renderer = wv.Renderer(make_scene(device), CAMERA, outputs="depth", sensor=MODEL)
    latency = Latency(3)
    said = []
    for call in range(7):
        if call == 3:
            latency.reset([1])
        if call == 5:
            latency.reset(np.array([True, False, False]))
        views = renderer.render(moved(call))
        said.append((views.depth.numpy().copy(), latency(views).depth.numpy().copy()))
    exact, old = (np.stack(many) for many in zip(*said, strict=True))
    for view, ages in enumerate([(0, 0, 0, 0, 1, 5, 5), (0, 0, 0, 3, 3, 3, 3), (0, 0, 0, 0, 1, 2, 3)]):
        for call, age in enumerate(ages):
            np.testing.assert_array_equal(old[call, view], exact[age, view])
    latency.reset()
    views = renderer.render(moved(9))
    np.testing.assert_array_equal(latency(views).depth.numpy(), views.depth.numpy())


def test_outputs_are_new_arrays_or_out(device):
    renderer = wv.Renderer(make_scene(device), CAMERA, outputs=("depth", "reasons"), sensor=MODEL)
    latency = Latency(1)
    first = latency(renderer.render(moved(0)))
    kept = first.depth.numpy().copy()
    second = latency(renderer.render(moved(1)))
    np.testing.assert_array_equal(first.depth.numpy(), kept)
    np.testing.assert_array_equal(second.depth.numpy(), kept)
    now = renderer.render(moved(2))
    shown = now.depth.numpy().copy()
    third = latency(now, out=first)
    assert third.depth is first.depth and third.reasons is first.reasons
    assert (first.depth.numpy() != kept).any()
    # Outputs may alias inputs.
    views = renderer.render(moved(3))
    assert latency(views, out=views).depth is views.depth
    np.testing.assert_array_equal(views.depth.numpy(), shown)


def test_ray_scans_and_empty_batches(device):
    """Ray scans, zero views, and frame numbers in a device array."""
    pattern = wv.cameras.Rays(np.eye(3), near=0.0, far=100.0)
    renderer = wv.Renderer(make_scene(device), pattern, outputs="depth")
    latency = Latency(1)
    scans = [renderer.render(moved(k)).depth.numpy() for k in range(3)]
    old = [latency(renderer.render(moved(k)), frame=wp.array([k] * 3, dtype=wp.int32, device=device)) for k in range(3)]
    np.testing.assert_array_equal([views.depth.numpy() for views in old], [scans[0], scans[0], scans[1]])
    none = wv.render(make_scene(device), CAMERA, np.zeros((0, 7), dtype=np.float32), outputs="depth")
    assert Latency(2)(none).depth.shape == (0, 72, 96)
    assert Latency(2).frames == 2 and Latency(np.array([1, 2])).frames.tolist() == [1, 2]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda views: Latency(-1), "frames must be a whole number from 0 up"),
        (lambda views: Latency(1.5), "frames must be a whole number from 0 up"),
        (lambda views: Latency([1, -1]), "frames must be whole numbers from 0 up"),
        (lambda views: Latency([1.0]), "frames must be whole numbers from 0 up"),
        (lambda views: Latency("two"), "frames must be an array of numbers"),
        (lambda views: Latency(1025), "frames must be at most 1024, got 1025"),
        (lambda views: Latency([1, 2])(views, frame=0), "frames must be one for each of the 3 views, got 2"),
        (lambda views: Latency(1)(views.depth), "views must be warpvis.Views, got array"),
        (lambda views: Latency(1)(wv.Views(labels=views.labels)), "views must have depth"),
        (lambda views: Latency(1)(views, frame=-1), "frame must be a whole number from 0 up"),
        (lambda views: Latency(1)(views, frame=[1, 2]), "frame must be whole numbers, one for each of 3 views"),
        (lambda views: Latency(1)(views, out=wv.Views()), "out.depth"),
        (lambda views: Latency(1).reset([0]), "views must be indices of the 0 views"),
    ],
)
def test_invalid_arguments_are_rejected(call, message):
    views = wv.render(make_scene(), CAMERA, POSES, outputs=("depth", "labels"))
    with pytest.raises(wv.errors.ArrayError, match=message):
        call(views)


def test_changed_views_are_rejected():
    latency, scene = Latency(1), make_scene()
    latency(wv.render(scene, CAMERA, POSES, outputs="depth"))
    for poses, outputs in ((POSES[:2], ("depth",)), (POSES, ("depth", "points"))):
        with pytest.raises(wv.errors.ArrayError, match="views must be as in earlier calls, depth of shape"):
            latency(wv.render(scene, CAMERA, poses, outputs=outputs))
    with pytest.raises(wv.errors.ArrayError, match="views must be indices of the 3 views"):
        latency.reset([3])
