# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras' models in batches of MuJoCo's worlds."""

import mujoco
import numpy as np
import pytest

import warpvis as wv
from warpvis.mujoco import BatchRenderer
from warpvis.sensors import Reason, StereoDepth

XML = """
<mujoco>
  <visual><map znear=".01"/></visual>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <geom name="wall" type="box" size=".05 2 1" pos="2 0 1"/>
    <body name="ball" pos="1 0 .4"><joint type="slide" axis="0 1 0"/><geom size=".2"/></body>
    <camera name="left" pos="-.5 .3 .6" xyaxes="0 -1 0 .2 0 1"/>
    <camera name="right" pos="-.5 -.3 .6" xyaxes="0 -1 0 .2 0 1" fovy="60"/>
  </worldbody>
</mujoco>
"""
MODEL = mujoco.MjModel.from_xml_string(XML)
QPOS = np.linspace(-0.5, 0.5, 5)[:, None]
SIZE = {"height": 48, "width": 64}
OUTPUTS = ("depth", "reasons", "true_depth", "segmentation", "points")
NOISY = StereoDepth(0.06, sigma=0.2, noise_spacing=2, subpixel=16, dropout=0.05, band=False, max_disparity=200.0)


def test_a_sensor_without_noise_sees_what_is_there(device):
    sensor = StereoDepth(0.06, shadow=False, band=False)
    clean = BatchRenderer(MODEL, **SIZE, outputs=("depth", "segmentation"), device=device).render(QPOS)
    sensed = BatchRenderer(MODEL, **SIZE, outputs=OUTPUTS, sensor=sensor, device=device).render(QPOS)
    np.testing.assert_array_equal(sensed.depth.numpy(), clean.depth.numpy())
    np.testing.assert_array_equal(sensed.segmentation.numpy(), clean.segmentation.numpy())
    assert set(np.unique(sensed.reasons.numpy())) <= {Reason.VALID, Reason.EMPTY, Reason.RANGE}


def test_a_camera_in_a_world_sees_the_same_whoever_else_is_rendered(device):
    """Worlds that are chosen, one by one or by flags; two cameras of different fields of view; and a renderer alone."""
    batch = BatchRenderer(MODEL, **SIZE, outputs=OUTPUTS, sensor=NOISY, seed=3, device=device)
    views = batch.render(QPOS, frame=7)
    depth = views.by_world().depth.numpy()
    assert depth.shape == (5, 2, 48, 64) and np.isnan(depth).mean() > 0.03
    some = batch.render(QPOS, worlds=[4, 1], frame=7).by_world()
    np.testing.assert_array_equal(some.depth.numpy(), depth[[4, 1]])
    np.testing.assert_array_equal(some.reasons.numpy(), views.by_world().reasons.numpy()[[4, 1]])
    again = batch.render(QPOS, frame=7, out=batch.render(QPOS, frame=8))
    np.testing.assert_array_equal(again.depth.numpy(), views.depth.numpy())


def test_frames_go_on_and_seeds_differ(device):
    def batch(seed):
        return BatchRenderer(MODEL, **SIZE, sensor=NOISY, seed=seed, device=device)

    first, other = batch(0), batch(1)
    frames = [first.render(QPOS).depth.numpy() for _ in range(3)]
    assert first.frame == 3
    np.testing.assert_array_equal(first.render(QPOS, frame=1).depth.numpy(), frames[1])
    assert first.frame == 3
    seen = np.isfinite(frames[0]) & np.isfinite(frames[1]) & np.isfinite(other.render(QPOS).depth.numpy())
    assert (frames[0] != frames[1])[seen].mean() > 0.5
    assert (frames[0] != other.render(QPOS, frame=0).depth.numpy())[seen].mean() > 0.5
    # Neither two worlds nor two cameras have the same noise.
    true = BatchRenderer(MODEL, **SIZE, device=device).render(QPOS).depth.numpy()
    with np.errstate(invalid="ignore"):
        errors = 1 / frames[0] - 1 / true
    errors = np.where(np.isfinite(errors), errors, 0).reshape(len(errors), -1)
    alike = np.corrcoef(errors)
    assert np.abs(alike[~np.eye(len(alike), dtype=bool)]).max() < 0.1


def test_the_noise_is_that_of_the_model(device):
    views = BatchRenderer(MODEL, **SIZE, outputs=OUTPUTS, sensor=NOISY, device=device).render(QPOS, cameras=["left"])
    depth, true = views.depth.numpy(), views.true_depth.numpy()
    camera = BatchRenderer(MODEL, **SIZE).camera("left")
    seen = np.isfinite(depth)
    disparities = camera.fx * NOISY.baseline * (1 / depth[seen] - 1 / true[seen])
    assert disparities.std() == pytest.approx(np.hypot(NOISY.sigma, 1 / 16 / 12**0.5), rel=0.1)
    assert np.isnan(views.points.numpy()[~seen]).all()


def test_what_is_refused():
    with pytest.raises(wv.WarpvisError, match="outputs must be without reasons where there is no sensor"):
        BatchRenderer(MODEL, **SIZE, outputs=("depth", "reasons"))
    with pytest.raises(wv.WarpvisError, match="frame is of a sensor's random numbers: give BatchRenderer a sensor"):
        BatchRenderer(MODEL, **SIZE).render(QPOS, frame=1)
    with pytest.raises(wv.WarpvisError, match="sensor must be a model of"):
        BatchRenderer(MODEL, **SIZE, sensor="d435").render(QPOS)
    with pytest.raises(wv.WarpvisError, match="seed must be"):
        BatchRenderer(MODEL, **SIZE, sensor=NOISY, seed=-1).render(QPOS)
    with pytest.raises(wv.WarpvisError, match="frame must be"):
        BatchRenderer(MODEL, **SIZE, sensor=NOISY).render(QPOS, frame=-1)
