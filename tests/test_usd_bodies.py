# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies and joints of UsdPhysics, and cameras of USD stages."""

import warnings

import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.io import read_scene_cameras

from support import usd_stages as stages

pytest.importorskip("pxr")
from pxr import Gf, Usd, UsdGeom

BODY = '(prepend apiSchemas = ["PhysicsRigidBodyAPI"])'

ARM = f"""
def Mesh "floor" {{{stages.SQUARE}}}
def Xform "base" {BODY}
{{
    double3 xformOp:translate = (0, 0, 1)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {stages.mesh("shell")}
}}
def Xform "upper" {BODY}
{{
    double3 xformOp:translate = (0, 0, 2)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {stages.mesh("one")}
    {stages.mesh("two", "double3 xformOp:translate = (0, 0, 1)", stages.SQUARE)}
}}
def Xform "finger" {BODY}
{{
    double3 xformOp:translate = (1, 0, 2.25)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {stages.mesh("tip")}
}}
def Xform "mug" {BODY}
{{
    double3 xformOp:translate = (5, 0, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    {stages.mesh("cup")}
}}
def PhysicsFixedJoint "weld"
{{
    rel physics:body1 = </base>
    point3f physics:localPos0 = (0, 0, 1)
}}
def PhysicsRevoluteJoint "shoulder"
{{
    rel physics:body0 = </base>
    rel physics:body1 = </upper>
    uniform token physics:axis = "Z"
    point3f physics:localPos0 = (0, 0, 1)
    float physics:lowerLimit = -90
    float physics:upperLimit = 180
}}
def PhysicsPrismaticJoint "slide"
{{
    rel physics:body0 = </finger>
    rel physics:body1 = </upper>
    uniform token physics:axis = "X"
    point3f physics:localPos0 = (-1, 0, -0.25)
    float physics:lowerLimit = -1
    float physics:upperLimit = 1
}}
"""


def transformed(matrix, points):
    return points @ matrix[:3, :3].T + matrix[:3, 3]


def test_joints_move_their_bodies(tmp_path):
    scene = stages.load(tmp_path, ARM, movable=True)
    names = [scene.objects[index].name for index in scene.movable]
    assert names == ["/upper/one", "/finger/tip", "/mug/cup"]
    assert scene.joints.names == ("shoulder", "slide", "/mug")
    assert scene.joints["shoulder"].limits == pytest.approx((-np.pi / 2, np.pi))
    assert scene.joints["slide"].limits == (-1, 1)
    initial = scene.joints.poses()[0]
    np.testing.assert_allclose(initial[:, :3], [(0, 0, 2), (1, 0, 2.25), (5, 0, 0)], atol=1e-6)
    upper, finger, mug = poses_to_matrices(scene.joints.poses({"shoulder": np.pi / 2, "slide": 0.5})[0])
    np.testing.assert_allclose(transformed(upper, np.array([(1.0, 0, 0)])), [(0, 1, 2)], atol=1e-6)
    # The finger is the parent side: it moves by -0.5 along the upper arm, which points along y.
    np.testing.assert_allclose(finger[:3, 3], (0, 0.5, 2.25), atol=1e-6)
    np.testing.assert_allclose(mug[:3, 3], (5, 0, 0), atol=1e-6)
    lifted = scene.joints.poses({"/mug": (5, 0, 3, 0, 0, 0, 1)})[0, 2]
    np.testing.assert_allclose(lifted, (5, 0, 3, 0, 0, 0, 1), atol=1e-6)


def test_joints_follow_the_unit_and_the_axis_of_the_scene(tmp_path):
    header = '#usda 1.0\n(\n    metersPerUnit = 0.01\n    upAxis = "Y"\n)\n'
    path = stages.write(tmp_path, ARM, header=header)
    scene = wv.Scene.load(path, movable=True)
    assert scene.joints["slide"].limits == pytest.approx((-0.01, 0.01))
    _, finger, _ = poses_to_matrices(scene.joints.poses({"shoulder": np.pi / 2})[0])
    np.testing.assert_allclose(finger[:3, 3], (0, -0.0225, 0.01), atol=1e-7)
    larger = wv.Scene.load(path, movable=True, scale=100)
    _, finger, _ = poses_to_matrices(larger.joints.poses({"shoulder": np.pi / 2, "slide": 0.5})[0])
    np.testing.assert_allclose(finger[:3, 3], (0, -2.25, 0.5), atol=1e-6)


def test_static_bodies_are_static_by_default(tmp_path):
    assert not stages.load(tmp_path, ARM).movable


CASES = {
    "spherical": (
        'def PhysicsSphericalJoint "j" {\n    rel physics:body1 = </a>\n}',
        "a SphericalJoint is not supported",
    ),
    "two axes": (
        'def PhysicsJoint "j" {\n    rel physics:body1 = </a>\n    float limit:rotX:physics:low = 1\n'
        "    float limit:rotX:physics:high = -1\n}",
        "it has 5 degrees of freedom",
    ),
    "loop": (
        'def PhysicsFixedJoint "j" {\n    rel physics:body1 = </a>\n}\n'
        'def PhysicsRevoluteJoint "k" {\n    rel physics:body1 = </a>\n}',
        "joint 'k', which closes a loop",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_unsupported_joints_are_listed(tmp_path, case):
    text, message = CASES[case]
    body = f'def Xform "a" {BODY} {{\n{stages.mesh("m")}}}\n{text}'
    with pytest.warns(UserWarning, match=message):
        stages.load(tmp_path, body)


def test_bodies_of_unsupported_joints_float(tmp_path):
    text = "".join(f'def Xform "{name}" {BODY} {{\n{stages.mesh("m")}}}\n' for name in "ab")
    text += 'def PhysicsSphericalJoint "ball" {\n    rel physics:body1 = </a>\n}\n'
    text += 'def PhysicsDistanceJoint "rope" {\n    rel physics:body0 = </a>\n    rel physics:body1 = </b>\n}\n'
    with pytest.warns(
        UserWarning, match=r"joint </ball> \(a SphericalJoint is.*joint </rope> \(a DistanceJoint is not"
    ):
        joints = stages.load(tmp_path, text, movable=True).joints
    assert [(joint.name, joint.kind) for joint in joints] == [("/a", "floating"), ("/b", "floating")]


def test_loops_outside_of_articulations_are_left_out_without_a_warning(tmp_path):
    text = f'def Xform "a" {BODY} {{\n{stages.mesh("m")}}}\n'
    text += 'def PhysicsRevoluteJoint "j" {\n    rel physics:body1 = </a>\n}\n'
    text += 'def PhysicsFixedJoint "k" {\n    rel physics:body1 = </a>\n'
    text += "    uniform bool physics:excludeFromArticulation = 1\n}\n"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        joints = stages.load(tmp_path, text).joints
    assert [joint.name for joint in joints] == ["j"]


def test_generic_joints_without_a_free_axis_are_fixed(tmp_path):
    locked = "\n".join(
        f"    float limit:{name}:physics:low = 1\n    float limit:{name}:physics:high = -1"
        for name in ("transX", "transY", "transZ", "rotX", "rotY", "rotZ")
    )
    text = f'def Xform "a" {BODY} {{\n{stages.mesh("m")}}}\n'
    text += f'def PhysicsJoint "j"\n{{\n    rel physics:body1 = </a>\n{locked}\n}}\n'
    assert stages.load(tmp_path, text).joints["j"].kind == "fixed"


def test_disabled_bodies_and_joints_are_static(tmp_path):
    text = f'def Xform "a" {BODY} {{\n    bool physics:rigidBodyEnabled = 0\n{stages.mesh("m")}}}\n'
    with pytest.raises(wv.errors.SceneError, match="it defines no moving objects"):
        stages.load(tmp_path, text, movable=True)
    text = f'def Xform "a" {BODY} {{\n{stages.mesh("m")}}}\n'
    text += 'def PhysicsFixedJoint "j" {\n    rel physics:body1 = </a>\n    bool physics:jointEnabled = 0\n}\n'
    assert stages.load(tmp_path, text, movable=True).joints.names == ("/a",)


def test_generic_joints_with_one_free_axis_are_read(tmp_path):
    locked = "\n".join(
        f"    float limit:{name}:physics:low = 1\n    float limit:{name}:physics:high = -1"
        for name in ("transX", "transY", "transZ", "rotX", "rotZ")
    )
    limits = "    float limit:rotY:physics:low = -90\n    float limit:rotY:physics:high = 45"
    text = f'def Xform "a" {BODY} {{\n{stages.mesh("m")}}}\n'
    text += f'def PhysicsJoint "j"\n{{\n    rel physics:body1 = </a>\n{locked}\n{limits}\n}}\n'
    joint = stages.load(tmp_path, text).joints["j"]
    assert joint.kind == "revolute" and joint.limits == pytest.approx((-np.pi / 2, np.pi / 4))
    np.testing.assert_array_equal(joint.axis, (0, 1, 0))


def test_joints_follow_others(tmp_path):
    text = "".join(f'def Xform "{name}" {BODY} {{\n{stages.mesh("m")}}}\n' for name in "ab")
    text += 'def PhysicsRevoluteJoint "j" {\n    rel physics:body1 = </a>\n}\n'
    text += 'def PhysicsRevoluteJoint "k" {\n    rel physics:body1 = </b>\n    rel newton:mimicJoint = </j>\n'
    text += "    float newton:mimicCoef0 = 0.5\n    float newton:mimicCoef1 = -2\n}\n"
    joints = stages.load(tmp_path, text).joints
    assert joints.names == ("j",)
    assert joints["k"].mimic == ("j", -2.0, 0.5)


def test_joint_values_of_the_stage_are_initial(tmp_path):
    text = f'def Xform "a" {BODY} {{\n    float xformOp:rotateZ = 30\n'
    text += f'    uniform token[] xformOpOrder = ["xformOp:rotateZ"]\n{stages.mesh("m")}}}\n'
    text += 'def PhysicsRevoluteJoint "j" {\n    rel physics:body1 = </a>\n    uniform token physics:axis = "Z"\n}\n'
    scene = stages.load(tmp_path, text, movable=True)
    assert scene.joints["j"].kind == "continuous"
    np.testing.assert_allclose(scene.joints["j"].initial, [np.pi / 6], atol=1e-6)
    np.testing.assert_allclose(scene.joints.poses({"j": 0.0})[0, 0], (0, 0, 0, 0, 0, 0, 1), atol=1e-6)


CAMERA = """
def Xform "rig"
{
    double3 xformOp:translate = (100, 0, 200)
    float xformOp:rotateY = 90
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
    def Camera "eye"
    {
        float focalLength = 24
        float horizontalAperture = 36
        float verticalAperture = 24
        float horizontalApertureOffset = 3.6
        float verticalApertureOffset = 1.2
        float2 clippingRange = (10, 10000)
    }
}
"""
CENTIMETERS = '#usda 1.0\n(\n    metersPerUnit = 0.01\n    upAxis = "Y"\n)\n'


def test_cameras_equal_those_of_usd(tmp_path):
    path = stages.write(tmp_path, CAMERA, header=CENTIMETERS)
    found = read_scene_cameras(path, width=600, up="y")["/rig/eye"]
    camera = found.camera
    assert (camera.width, camera.height, camera.fx, camera.fy) == (600, 400, 400, 400)
    assert (camera.near, camera.far) == pytest.approx((0.1, 100))
    stage = Usd.Stage.Open(str(path))
    frustum = UsdGeom.Camera(stage.GetPrimAtPath("/rig/eye")).GetCamera(0).frustum
    points = np.array([(0.4, 0.3, 5), (-1, 0.2, 7), (0, 0, 3)])  # in the camera's frame, OpenCV's axes [m]
    matrix = poses_to_matrices(found.pose)
    world = transformed(matrix, points) * 100
    projected = np.array([frustum.ComputeViewMatrix().Transform(Gf.Vec3d(*point)) for point in world])
    np.testing.assert_allclose(projected, points * (100, -100, -100), atol=1e-3)
    clip = np.array([frustum.ComputeProjectionMatrix().Transform(Gf.Vec3d(*point)) for point in projected])
    u = camera.fx * points[:, 0] / points[:, 2] + camera.cx
    v = camera.fy * points[:, 1] / points[:, 2] + camera.cy
    np.testing.assert_allclose(u, (clip[:, 0] + 1) / 2 * 600, atol=1e-3)
    np.testing.assert_allclose(v, (1 - clip[:, 1]) / 2 * 400, atol=1e-3)


def test_lenses_of_cameras_are_ignored(tmp_path):
    lens = (
        'token cameraProjectionType = "fisheyePolynomial"\n        float fthetaWidth = 999\n        float focalLength'
    )
    plain, fisheye = (
        read_scene_cameras(stages.write(tmp_path, text, header=CENTIMETERS), width=60)["/rig/eye"].camera
        for text in (CAMERA, CAMERA.replace("float focalLength", lens))
    )
    assert fisheye == plain


def test_cameras_see_the_loaded_scene(tmp_path):
    """A camera rotated by 90 degrees about y looks along -x of the stage, which is -x of the scene."""
    found = read_scene_cameras(stages.write(tmp_path, CAMERA, header=CENTIMETERS), width=8, height=6)["/rig/eye"]
    matrix = poses_to_matrices(found.pose)
    np.testing.assert_allclose(matrix[:3, 2], (-1, 0, 0), atol=1e-6)
    np.testing.assert_allclose(matrix[:3, 1], (0, 0, -1), atol=1e-6)
    np.testing.assert_allclose(matrix[:3, 3], (1, -2, 0), atol=1e-6)


def test_render_products_and_orthographic_cameras(tmp_path):
    text = """
def Camera "top"
{
    token projection = "orthographic"
    float horizontalAperture = 40
    float verticalAperture = 20
    float2 clippingRange = (0.1, 1e38)
}
def RenderProduct "product"
{
    rel camera = </top>
    int2 resolution = (400, 100)
}
"""
    camera = read_scene_cameras(stages.write(tmp_path, text))["/top"].camera
    assert isinstance(camera, wv.cameras.OrthographicCamera)
    assert (camera.width, camera.height, camera.far) == (400, 100, np.inf)
    assert camera.fx == pytest.approx(400 / 4.0)  # apertures are in tenths of the stage's unit


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "width must be given for the camera '/rig/eye', which has no RenderProduct"),
        ({"height": 3}, "width must be given with height"),
        ({"width": 0}, "width must be"),
    ],
)
def test_invalid_camera_options_raise(tmp_path, options, message):
    with pytest.raises(wv.errors.CameraError, match=message):
        read_scene_cameras(stages.write(tmp_path, CAMERA), **options)


def test_invalid_cameras_raise(tmp_path):
    text = 'def Camera "c"\n{\n    float2 clippingRange = (5, 1)\n}\n'
    with pytest.raises(wv.errors.FileFormatError, match=r"stage.usda: camera </c>: "):
        read_scene_cameras(stages.write(tmp_path, text), width=4)
    with pytest.raises(wv.errors.FileFormatError, match=r"cameras are read from USD stages"):
        read_scene_cameras(tmp_path / "a.glb", width=4)
    with pytest.raises(wv.errors.FileFormatError, match=r"a.usd: no such file"):
        read_scene_cameras(tmp_path / "a.usd", width=4)
