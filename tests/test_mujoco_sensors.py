# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth camera models in MuJoCo scenes: single renderers and batches."""

import pickle

import mujoco
import numpy as np
import pytest

import warpvis as wv
from warpvis.mujoco import BatchRenderer, Renderer
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


def test_noiseless_sensor_matches_clean_depth(device):
    sensor = StereoDepth(0.06, shadow=False, band=False)
    clean = BatchRenderer(MODEL, **SIZE, outputs=("depth", "segmentation"), device=device).render(QPOS)
    sensed = BatchRenderer(MODEL, **SIZE, outputs=OUTPUTS, sensor=sensor, device=device).render(QPOS)
    np.testing.assert_array_equal(sensed.depth.numpy(), clean.depth.numpy())
    np.testing.assert_array_equal(sensed.segmentation.numpy(), clean.segmentation.numpy())
    assert set(np.unique(sensed.reasons.numpy())) <= {Reason.VALID, Reason.EMPTY, Reason.RANGE}


def test_noise_is_independent_of_selected_worlds(device):
    """Selected worlds, two cameras with different fields of view, and reused outputs."""
    batch = BatchRenderer(MODEL, **SIZE, outputs=OUTPUTS, sensor=NOISY, seed=3, device=device)
    views = batch.render(QPOS, frame=7)
    depth = views.by_world().depth.numpy()
    assert depth.shape == (5, 2, 48, 64) and np.isnan(depth).mean() > 0.03
    some = batch.render(QPOS, worlds=[4, 1], frame=7).by_world()
    np.testing.assert_array_equal(some.depth.numpy(), depth[[4, 1]])
    np.testing.assert_array_equal(some.reasons.numpy(), views.by_world().reasons.numpy()[[4, 1]])
    again = batch.render(QPOS, frame=7, out=batch.render(QPOS, frame=8))
    np.testing.assert_array_equal(again.depth.numpy(), views.depth.numpy())


def test_noise_depends_on_frame_and_seed(device):
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
    # Noise is independent between worlds and between cameras.
    true = BatchRenderer(MODEL, **SIZE, device=device).render(QPOS).depth.numpy()
    with np.errstate(invalid="ignore"):
        errors = 1 / frames[0] - 1 / true
    errors = np.where(np.isfinite(errors), errors, 0).reshape(len(errors), -1)
    alike = np.corrcoef(errors)
    assert np.abs(alike[~np.eye(len(alike), dtype=bool)]).max() < 0.1


def test_disparity_noise_matches_model(device):
    views = BatchRenderer(MODEL, **SIZE, outputs=OUTPUTS, sensor=NOISY, device=device).render(QPOS, cameras=["left"])
    depth, true = views.depth.numpy(), views.true_depth.numpy()
    camera = BatchRenderer(MODEL, **SIZE).camera("left")
    seen = np.isfinite(depth)
    disparities = camera.fx * NOISY.baseline * (1 / depth[seen] - 1 / true[seen])
    assert disparities.std() == pytest.approx(np.hypot(NOISY.sigma, 1 / 16 / 12**0.5), rel=0.1)
    assert np.isnan(views.points.numpy()[~seen]).all()


def test_invalid_batch_arguments_are_rejected():
    with pytest.raises(wv.WarpvisError, match="outputs must not contain reasons without a sensor"):
        BatchRenderer(MODEL, **SIZE, outputs=("depth", "reasons"))
    with pytest.raises(wv.WarpvisError, match="frame and view_index require a sensor: pass sensor= to Batch"):
        BatchRenderer(MODEL, **SIZE).render(QPOS, frame=1)
    with pytest.raises(wv.WarpvisError, match="sensor must be a model of"):
        BatchRenderer(MODEL, **SIZE, sensor="d435").render(QPOS)
    with pytest.raises(wv.WarpvisError, match="seed must be"):
        BatchRenderer(MODEL, **SIZE, sensor=NOISY, seed=-1).render(QPOS)
    with pytest.raises(wv.WarpvisError, match="frame must be"):
        BatchRenderer(MODEL, **SIZE, sensor=NOISY).render(QPOS, frame=-1)
    with pytest.raises(wv.WarpvisError, match="view_index must be whole numbers, one for each of 10 views"):
        BatchRenderer(MODEL, **SIZE, sensor=NOISY).render(QPOS, view_index=np.arange(5))


def test_frame_and_view_index_per_view(device):
    """Numbers follow the order of images, across cameras of different fields of view."""
    batch = BatchRenderer(MODEL, **SIZE, sensor=NOISY, seed=3, device=device)
    frames = [batch.render(QPOS, frame=frame).depth.numpy() for frame in (4, 5)]
    mixed = batch.render(QPOS, frame=[4, 5] * 5).depth.numpy()
    np.testing.assert_array_equal(mixed[::2], frames[0][::2])
    np.testing.assert_array_equal(mixed[1::2], frames[1][1::2])
    numbers = (2 * np.arange(5) + np.arange(2)[:, None]).ravel()  # ordered by world, two cameras each
    np.testing.assert_array_equal(batch.render(QPOS, frame=4, view_index=numbers).depth.numpy(), frames[0])
    apart = batch.render(QPOS[[0, 0]], frame=4, view_index=[0, 7, 1, 9]).depth.numpy()
    np.testing.assert_array_equal(apart[[0, 2]], frames[0][[0, 5]])
    assert (apart[0] != apart[1]).mean() > 0.5
    assert batch.frame == 0


OPEN = mujoco.MjModel.from_xml_string(XML.replace('size=".05 2 1"', 'size=".05 2 .2"'))  # with sky above the wall


def depth_renderer(**options):
    data = mujoco.MjData(OPEN)
    data.qpos[0] = 0.1
    mujoco.mj_forward(OPEN, data)
    renderer = Renderer(OPEN, **SIZE, **options)
    renderer.enable_depth_rendering()
    renderer.update_scene(data, "left")
    return renderer


def test_renderer_matches_batch_of_one_world(device):
    batch = BatchRenderer(OPEN, **SIZE, outputs=OUTPUTS, sensor=NOISY, seed=3, device=device)
    with depth_renderer(sensor=NOISY, seed=3, fill="inf", device=device) as renderer:
        for frame in range(2):
            depth, views = renderer.render(), batch.render([0.1], cameras="left")
            assert renderer.frame == frame + 1
            for found, name in ((depth, "depth"), (renderer.reasons, "reasons"), (renderer.true_depth, "true_depth")):
                wanted = getattr(views, name).numpy()[0]
                # Rounding of the ball's pose differs in the last digits.
                assert found.dtype == wanted.dtype
                assert np.isclose(found, wanted, rtol=1e-5, equal_nan=True).mean() > 0.999, name
        assert np.isnan(depth).any() and (depth == np.inf).any() and set(np.unique(renderer.reasons)) == {0, 1, 3, 7}


def test_fill_replaces_invalid_pixels():
    near = StereoDepth(0.06, max_disparity=1.5, dropout=0.1)  # distances below about 1.8 m are too near
    infinite, far, zero = (depth_renderer(sensor=near, fill=fill) for fill in ("inf", "far", 0.0))
    said = infinite.render()
    too_near, none = said == -np.inf, ~np.isfinite(said)
    assert too_near.any() and np.isnan(said).any() and (said == np.inf).any() and not none.all()
    clean = depth_renderer().render()
    shown = far.render()
    np.testing.assert_array_equal(shown[~none], said[~none])
    np.testing.assert_allclose(shown[too_near], 0.01 * OPEN.stat.extent, rtol=1e-6)
    empty = infinite.reasons == Reason.EMPTY
    assert (shown[none & ~too_near] == clean[empty][0]).all() and clean[empty].min() == clean.max()
    assert (zero.render(out=np.ones((48, 64)))[none] == 0).all()


def test_segmentation_has_no_noise():
    sensed, clean = depth_renderer(sensor=NOISY), depth_renderer()
    for renderer in (sensed, clean):
        renderer.enable_segmentation_rendering()
    np.testing.assert_array_equal(sensed.render(), clean.render())
    assert sensed.frame == 0  # only depth images are counted
    with pytest.raises(wv.WarpvisError, match="reasons requires depth of a sensor: render depth first"):
        sensed.reasons  # noqa: B018
    with pytest.raises(wv.WarpvisError, match="true_depth requires depth of a sensor: pass sensor= to Renderer"):
        clean.true_depth  # noqa: B018


def test_copied_renderer_continues_frames():
    renderer = depth_renderer(sensor=NOISY, seed=2)
    first = renderer.render()
    copied = pickle.loads(pickle.dumps(renderer))
    second = copied.render()
    np.testing.assert_array_equal(second, renderer.render())
    renderer.frame = 0
    np.testing.assert_array_equal(renderer.render(), first)
    assert (first != second).mean() > 0.5


def test_empty_scene_reports_empty_pixels():
    renderer = depth_renderer(sensor=NOISY, exclude=["*"])
    depth = renderer.render()
    assert (depth == depth[0, 0]).all() and depth[0, 0] > 10
    assert (renderer.reasons == Reason.EMPTY).all() and (renderer.true_depth == np.inf).all() and renderer.frame == 1


def test_invalid_renderer_arguments_are_rejected():
    flat = XML.replace('fovy="60"', 'fovy="2" projection="orthographic"')
    model = mujoco.MjModel.from_xml_string(flat)
    renderer = Renderer(model, **SIZE, sensor=NOISY)
    renderer.enable_depth_rendering()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    renderer.update_scene(data, "right")
    with pytest.raises(wv.errors.CameraError, match=r"must be a warpvis\.Camera, got OrthographicCamera"):
        renderer.render()
    for wrong, said in (
        ({"sensor": "d435"}, "sensor must be a model of"),
        ({"seed": -1}, "seed must be"),
        ({"fill": "near"}, "fill must be"),
    ):
        with pytest.raises(wv.WarpvisError, match=said):
            Renderer(MODEL, **({"sensor": NOISY} | wrong))
