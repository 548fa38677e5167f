# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Checks of visibility with MolmoSpaces' methods, compared with segmentation images of `mujoco.Renderer`."""

from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

from warpvis.errors import WarpvisError
from warpvis.mujoco import VisibilityChecker

MODEL = """<mujoco><statistic extent="4" center="0 0 0"/><visual><quality offsamples="0"/></visual><worldbody>
  <camera name="front" pos="0 -3 1" xyaxes="1 0 0 0 .3 1" fovy="50"/>
  <camera name="flat" pos="0 -3 1" xyaxes="1 0 0 0 .3 1" projection="orthographic" fovy="2"/>
  <geom type="plane" size="3 3 .1"/>
  <body name="table" pos="0 0 .3"><geom type="box" size=".6 .4 .02"/>
    <body name="leg" pos=".5 0 -.15"><geom type="cylinder" size=".03 .15"/></body></body>
  <body name="mug" pos="0 0 .42"><freejoint/><geom type="cylinder" size=".05 .08"/>
    <geom type="capsule" fromto=".05 0 -.04 .05 0 .04" size=".015"/></body>
  <body name="box" pos=".06 -.2 .42"><freejoint/><geom type="box" size=".05 .02 .1"/></body>
  <body name="ghost" pos="0 0 3"/>
  <body name="behind" pos="0 -5 .5"><geom size=".1"/></body>
</worldbody></mujoco>"""


@pytest.fixture
def state():
    model = mujoco.MjModel.from_xml_string(MODEL)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return model, data


@pytest.mark.gl
def test_shares_are_those_of_segmentation_images(state):
    model, data = state
    checker = VisibilityChecker(model, data, width=320, height=240)
    bodies = ("table", "mug", "box")
    with mujoco.Renderer(model, 240, 320) as renderer:
        renderer.enable_segmentation_rendering()
        for shift in (0.0, 0.1):
            data.joint(1).qpos[0] += shift
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "front")
            ids = renderer.render()[..., 0]
            shares = checker.check_visibility("front", *bodies)
            for body, geoms in zip(bodies, ([1, 2], [3, 4], [5]), strict=True):
                assert abs(shares[body] - np.isin(ids, geoms).mean()) < 10 / (320 * 240), body
    assert checker.check_visibility("front", "mug") == shares["mug"]


def test_fractions_are_of_bodies(state):
    model, data = state
    checker = VisibilityChecker(model, data, width=320, height=240)
    fractions = checker.visible_fractions("front", "mug", "box", "behind")
    assert 0.1 < fractions["mug"] < 0.9 and fractions["box"] == 1.0 and fractions["behind"] == 0.0
    data.joint(1).qpos[0] = 1.0  # the box no longer hides the mug
    mujoco.mj_forward(model, data)
    assert checker.visible_fractions("front", "mug") == {"mug": 1.0}


def test_cameras_see_through_their_housings():
    """MuJoCo cuts away what is nearer than its near plane; a camera within a mesh sees the rest."""
    housed = MODEL.replace('<body name="ghost" pos="0 0 3"/>', '<body pos="0 -3 1"><geom size=".02"/></body>')
    shares = []
    for text in (MODEL, housed):
        model = mujoco.MjModel.from_xml_string(text)
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        checker = VisibilityChecker(model, data, width=160, height=120)
        shares.append(checker.check_visibility("front", "table", "mug"))
        assert 0.1 < checker.visible_fractions("front", "mug")["mug"] < 0.9
    assert shares[0] == shares[1] and shares[0]["mug"] > 0


def test_visible_objects_and_constraints(state):
    model, data = state
    checker = VisibilityChecker(model, data, width=160, height=120)
    assert checker.get_visible_objects("front") == ["table", "box", "mug"]
    shares = checker.check_visibility("front", "table", "mug")
    met, found = checker.check_camera_visibility_constraints({"front": {"table": 0.01, "mug": 0.0001}})
    assert met and found == {"front": shares}
    assert not checker.check_camera_visibility_constraints({"front": {"table": 0.01, "behind": 0.0001}})[0]


def test_bodies_without_a_name_are_not_listed():
    model = mujoco.MjModel.from_xml_string(MODEL.replace('body name="box"', "body"))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    checker = VisibilityChecker(model, data, width=160, height=120)
    assert checker.get_visible_objects("front") == ["table", "mug"]
    with pytest.raises(WarpvisError, match="such as 'world', 'table', 'leg', 'mug', 'ghost', 'behind', got 'box'"):
        checker.check_visibility("front", "box")


def test_cameras_that_are_not_in_the_model(state):
    model, data = state
    checker = VisibilityChecker(model, data, width=320, height=240)
    axes = data.camera("front").xmat.reshape(3, 3)
    camera = SimpleNamespace(pos=data.camera("front").xpos, forward=-axes[:, 2], up=axes[:, 1], fov=50.0)
    expected = checker.check_visibility("front", "mug", "box")
    for body, share in checker.check_visibility(camera, "mug", "box").items():
        assert abs(share - expected[body]) < 5 / (320 * 240)


@pytest.mark.parametrize("constraints", [None, {"front": 0.1}, {"front": {"mug": 10}}, {"front": {"mug": "half"}}])
def test_invalid_constraints_raise(state, constraints):
    checker = VisibilityChecker(*state, width=32, height=24)
    with pytest.raises(WarpvisError, match="constraints must be a dict of cameras with dicts of bodies and shares"):
        checker.check_camera_visibility_constraints(constraints)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("side", "mug"), "camera 'side' is not in the model, which has 'front'"),
        (("front", "cup"), "bodies must be names or ids of the model's bodies"),
        (("front", "ghost"), "bodies must have rendered geoms, got 'ghost' without any"),
        (("front",), "bodies must be one or more distinct bodies"),
        (("flat", "mug"), "camera must be perspective, got 'flat', which is orthographic"),
        ((object(), "mug"), "camera_name must be a name or id of a camera of the model, or have pos, forward, up"),
        ((SimpleNamespace(pos=(0, 0, 0), forward=(1, 0, 0), up=(0, 0, 1), fov=200), "mug"), "fov must be a number"),
    ],
)
def test_invalid_input_is_one_sentence(state, arguments, message):
    with pytest.raises(WarpvisError, match=message):
        VisibilityChecker(*state, width=32, height=24).check_visibility(*arguments)
