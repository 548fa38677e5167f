# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A camera inside its housing: like MuJoCo, clip surfaces at the near plane."""

import mujoco
import numpy as np
import pytest

from warpvis.errors import ArrayError
from warpvis.mujoco import BatchRenderer, Renderer

from support.mujoco_renderer import images

# The near plane is at 2 cm, and only walls of the housing are nearer. The glass ends 1 cm before the lens, and the hood
# extends beyond the near plane.
HOUSING = """<mujoco><statistic extent="2"/><visual><map znear=".01" zfar="20"/><quality offsamples="0"/></visual>
  <worldbody>
  <geom name="floor" type="plane" size="3 3 .1" pos="0 0 -.4"/>
  <geom name="post" type="box" size=".1 .1 .3" pos=".1 -.6 -.1"/>
  <geom name="ball" type="sphere" size=".1" pos="-.2 .6 .3"/>
  <body name="head" pos="0 0 .3"><freejoint/>
    <geom name="glass" type="box" size=".03 .03 .001" pos="0 0 -.011"/>
    <geom name="bulge" type="sphere" size=".004" pos=".004 0 -.012"/>
    <geom name="hood" type="cylinder" size=".004 .04" pos=".015 .004 -.03"/>
    <camera name="lens" fovy="70"/>
  </body></worldbody></mujoco>"""
NAMES = ("glass", "bulge", "hood")


def model_and_data(tilt=0.6):
    model = mujoco.MjModel.from_xml_string(HOUSING)
    data = mujoco.MjData(model)
    data.qpos[3:7] = np.cos(tilt), np.sin(tilt), 0, 0
    mujoco.mj_forward(model, data)
    return model, data


def counts(model, ids):
    return {name: int((ids == model.geom(name).id).sum()) for name in NAMES}


@pytest.mark.gl
@pytest.mark.parametrize("tilt", [0.1, 0.6, 0.9])
def test_near_plane_clipping_matches_mujoco(tilt, device):
    model, data = model_and_data(tilt)
    with mujoco.Renderer(model, 120, 160) as renderer:
        expected, expected_segmentation = images(renderer, data, "lens")
    depth, segmentation = images(Renderer(model, 120, 160, device=device), data, "lens")
    assert (np.abs(depth - expected) < 0.01).mean() >= 0.99
    assert (segmentation == expected_segmentation).all(axis=-1).mean() >= 0.99
    seen = counts(model, segmentation[..., 0])
    assert seen["glass"] == seen["bulge"] == 0 < seen["hood"]  # the visible part of the hood is beyond the near plane


def test_near_plane_occlude_keeps_near_surfaces(device):
    model, data = model_and_data()
    depth, segmentation = images(Renderer(model, 120, 160, device=device, near_plane="occlude"), data, "lens")
    seen = counts(model, segmentation[..., 0])
    assert seen["glass"] > 10000
    assert np.isfinite(depth).all()  # depths nearer than the near plane are reported
    glass = segmentation[..., 0] == model.geom("glass").id
    assert np.allclose(depth[glass], 0.01, atol=1e-5)
    cut, _ = images(Renderer(model, 120, 160, device=device), data, "lens")
    assert cut.min() >= 0.02 > depth.min()


def test_near_plane_clipping_in_batch(device):
    model, data = model_and_data()
    given = {"height": 60, "width": 80, "outputs": ("depth", "segmentation"), "device": device}
    clips, occludes = BatchRenderer(model, **given), BatchRenderer(model, **given, near_plane="occlude")
    qpos = np.stack([data.qpos, model_and_data(0.1)[1].qpos])
    cut, hidden = clips.render(qpos), occludes.render(qpos)
    ids = clips.geom_ids(cut).numpy()
    assert counts(model, ids)["glass"] == 0 < counts(model, ids)["hood"]
    assert (cut.depth.numpy() >= 0.02).all()
    near = np.isneginf(hidden.depth.numpy())
    assert near.mean() > 0.9
    renderer = Renderer(model, 60, 80, device=device)
    assert np.array_equal(cut.segmentation.numpy()[0], images(renderer, data, "lens")[1][..., 0])


@pytest.mark.parametrize("kind", [Renderer, BatchRenderer])
def test_invalid_near_plane_is_rejected(kind):
    with pytest.raises(ArrayError, match="near_plane must be"):
        kind(model_and_data()[0], near_plane="cut")
