# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Joints of Webots worlds: `Scene.joints` and movable links, compared with worlds saved at other positions.

The twin of Webots' kinematics is that of WbHingeJoint, WbHinge2Joint, WbBallJoint and WbSliderJoint: the saved pose of
an end point belongs to the saved positions.
"""

import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError, PoseError, SceneError
from warpvis.webots import load_webots

BOX = "Shape { geometry Box { size 0.1 0.2 0.3 } }"
AXES = {
    "HingeJoint": [(0, 1, 2)],
    "SliderJoint": [(1, 0, 1)],
    "Hinge2Joint": [(0, 1, 0), (1, 0, 0.5)],
    "BallJoint": [(0, 1, 0), (-1, 0, 0), (0, 0, 1)],  # the second is the third times the first
}


@pytest.fixture(autouse=True)
def no_webots(monkeypatch, tmp_path):
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(folder, text, version="R2023b", name="a.wbt", **options):
    """Load a world with a floor, without warnings."""
    (folder / name).write_text(f"#VRML_SIM {version} utf8\nWorldInfo {{ }}\nFloor {{ size 9 9 }}\n{text}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return load_webots(folder / name, **options)


def unit(axis):
    return np.asarray(axis) / np.linalg.norm(axis)


def motion(kind, axes, positions):
    """Return the twin's rotation about the anchor, and its translation."""
    if kind == "SliderJoint":
        return Rotation.identity(), positions[0] * unit(axes[0])
    turn = Rotation.identity()
    for axis, position in zip(axes, positions, strict=True):
        turn = turn * Rotation.from_rotvec(position * unit(axis))
    return turn, np.zeros(3)


def moved(kind, axes, anchor, pose, before, after):
    """Return the twin's pose of an end point: translation and rotation in its parent's frame."""
    (offset, rotation), anchor = pose, np.asarray(anchor)
    turn, shift = motion(kind, axes, before)
    zero, at_zero = turn.inv() * rotation, turn.inv().apply(offset - shift - anchor) + anchor
    turn, shift = motion(kind, axes, after)
    return turn.apply(at_zero - anchor) + anchor + shift, turn * zero


def numbers(values):
    return " ".join(f"{value:.17g}" for value in np.ravel(values))


def joint_text(kind, number, pose, axes, anchor, positions, content, device=True):
    """Return a joint whose end point is a Solid `link<number>`."""
    offset, rotation = pose
    vector = rotation.as_rotvec()
    angle = np.linalg.norm(vector)
    place = f"translation {numbers(offset)} rotation {numbers(unit(vector) if angle else (0, 0, 1))} {angle:.17g}"
    anchor = "" if kind == "SliderJoint" else f"anchor {numbers(anchor)}"
    fields = []
    for index, (axis, position) in enumerate(zip(axes, positions, strict=True)):
        suffix = "" if index == 0 else str(index + 1)
        name = "HingeJointParameters" if kind.startswith("Hinge") and index == 0 else "JointParameters"
        text = f"position {position:.17g} axis {numbers(axis)} {anchor * (index == 0)}"
        if kind == "BallJoint" and index == 0:
            name, text = "BallJointParameters", f"position {position:.17g} {anchor}"
        if kind == "BallJoint" and index > 0:  # the first and the third axis are those of the other parameters
            text = f"position {position:.17g} axis {numbers(axes[0] if index == 1 else axes[2])}"
        fields.append(f"jointParameters{suffix} {name} {{ {text} }}")
        if device:
            fields.append(f'device{suffix} [ Brake {{ }} RotationalMotor {{ name "j{number}{suffix}" }} ]')
    return f'{kind} {{ {" ".join(fields)} endPoint Solid {{ {place} name "link{number}" children [ {content} ] }} }}'


def chain(kinds, poses, anchors, positions, base="Solid", place="translation 1 2 3 rotation 1 1 0 0.5"):
    """Return a chain of joints, each inside of a Pose below the end point of the one before."""
    text = ""
    for number in reversed(range(len(kinds))):
        kind = kinds[number]
        inner = joint_text(kind, number, poses[number], AXES[kind], anchors[number], positions[number], f"{BOX} {text}")
        text = f"Pose {{ translation 0 0.5 0.25 rotation 0 1 0 0.3 children [ {inner} ] }}"
    return f'{base} {{ name "base" {place} children [ {BOX} {text} ] }}'


def names_of(kinds):
    return [f"j{n}{suffix}" for n, kind in enumerate(kinds) for suffix in ("", "2", "3")[: len(AXES[kind])]]


def transformed(item, row):
    """Return vertices of a movable object at a pose."""
    return Rotation.from_quat(row[3:]).apply(item.vertices) + row[:3]


def expect_moved(scene, rows, expected):
    """Check the movable objects at poses against the same objects of a world saved there."""
    for index, row in zip(scene.movable, rows, strict=True):
        item = list(scene)[index]
        initial = scene.joints.poses()[0][list(scene.movable).index(index)]
        np.testing.assert_allclose(initial, [0, 0, 0, 0, 0, 0, 1], atol=1e-6)
        np.testing.assert_allclose(transformed(item, row), expected[item.name].vertices, atol=2e-6)


@pytest.mark.parametrize("version", ["R2023b", "R2021b"])
@pytest.mark.parametrize("kinds", [[kind] for kind in AXES] + [list(AXES), list(AXES)[::-1]])
def test_moved_links_equal_a_world_saved_there(tmp_path, kinds, version):
    rng = np.random.default_rng(len(kinds))
    poses = [(rng.uniform(-1, 1, 3), Rotation.random(random_state=rng)) for _ in kinds]
    anchors = rng.uniform(-1, 1, (len(kinds), 3))
    before, after = ([rng.uniform(-1, 1, len(AXES[kind])) for kind in kinds] for _ in range(2))
    world = load(tmp_path, chain(kinds, poses, anchors, before), version, movable=True)
    scene, names = world.scene, names_of(kinds)
    assert scene.joints.names == tuple(names)
    assert [item.name for item in scene][-len(kinds) :] == [f"link{n}" for n in range(len(kinds))]
    np.testing.assert_allclose([float(scene.joints[name].initial[0]) for name in names], np.concatenate(before))
    static = load(tmp_path, chain(kinds, poses, anchors, before), version)
    for one, other in zip(scene, static.scene, strict=True):
        np.testing.assert_array_equal(one.vertices, other.vertices)
    assert len(static.scene.movable) == 0
    rows = scene.joints.poses(dict(zip(names, np.concatenate(after), strict=True)))
    places = zip(kinds, anchors, poses, before, after, strict=True)
    others = [moved(kind, AXES[kind], *place) for kind, *place in places]
    saved = load(tmp_path, chain(kinds, others, anchors, after), version)
    expect_moved(scene, rows[0], saved.scene)
    links = saved.scene.joints.link_poses()
    for name, pose in scene.joints.link_poses(dict(zip(names, np.concatenate(after), strict=True))).items():
        np.testing.assert_allclose(pose, links[name], atol=1e-9)


def test_many_positions_at_once(tmp_path):
    pose = np.array([1.0, 0, 0]), Rotation.identity()
    hinge = joint_text("HingeJoint", 0, pose, [(0, 0, 1)], (0, 0, 0), [0], BOX)
    scene = load(tmp_path, f"Solid {{ children [ {hinge} ] }}", movable=True).scene
    angles = np.linspace(-3, 3, 7)
    places = [transformed(scene["link0"], row).mean(axis=0) for row in scene.joints.poses({"j0": angles})[:, 0]]
    np.testing.assert_allclose(places, np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1), atol=1e-6)
    poses = [wv.look_at((0, 0, 5), (0, 0, 0), up="y")] * 7
    depth = wv.render(
        scene, wv.Camera.from_fov(65, 65, hfov=0.6), poses, object_poses=scene.joints.poses({"j0": angles})
    )
    assert len({image.tobytes() for image in depth.depth.numpy()}) == 7


def one(folder, kind, fields, more="", **options):
    end = f'endPoint DEF END Solid {{ translation 0 0 1 name "tip" children [ {BOX} ] }}'
    return load(folder, f"Solid {{ children [ {kind} {{ {fields} {end} }} {more} ] }}", **options).scene.joints


@pytest.mark.parametrize(
    ("kind", "axes"),
    [
        ("HingeJoint", [(1, 0, 0)]),
        ("SliderJoint", [(0, 0, 1)]),
        ("Hinge2Joint", [(1, 0, 0), (0, 0, 1)]),
        ("BallJoint", [(1, 0, 0), (0, 1, 0), (0, 0, 1)]),
    ],
)
def test_default_axes_and_names(tmp_path, kind, axes):
    found = one(tmp_path, kind, "")
    assert found.names == ("tip", "tip::2", "tip::3")[: len(axes)]
    np.testing.assert_allclose([found[name].axis for name in found.names], axes, atol=1e-12)
    np.testing.assert_allclose(found.link_poses()["tip"][0], [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]])


@pytest.mark.parametrize(
    ("fields", "axes"),
    [
        ("jointParameters2 JointParameters { axis 0 1 0 }", [(0, 1, 0), (1, 0, 0), (0, 0, -1)]),
        ("jointParameters2 JointParameters { axis 1 0 0 }", [(1, 0, 0), (0, 0, 1), (0, -1, 0)]),
        ("jointParameters3 JointParameters { axis 0 1 0 }", [(1, 0, 0), (0, 0, -1), (0, 1, 0)]),
        ("jointParameters3 JointParameters { }", [(0, 1, 0), (-1, 0, 0), (0, 0, 1)]),
    ],
)
def test_axes_of_ball_joints(tmp_path, fields, axes):
    """As WbBallJoint::axis, axis2 and axis3 compute them."""
    found = one(tmp_path, "BallJoint", fields)
    np.testing.assert_allclose([found[name].axis for name in found.names], axes, atol=1e-12)


@pytest.mark.parametrize(
    ("device", "name"),
    [
        ('[ PositionSensor { name "angle" } RotationalMotor { name "elbow" } ]', "elbow"),
        ("[ Brake { } RotationalMotor { } ]", "rotational motor"),
        ('PositionSensor { name "angle" }', "angle"),
        ("PositionSensor { }", "position sensor"),
        ("[ ]", "tip"),
    ],
)
def test_names_of_devices(tmp_path, device, name):
    assert one(tmp_path, "HingeJoint", f"device {device}").names == (name,)


def test_motors_may_be_protos(tmp_path):
    (tmp_path / "protos").mkdir()
    (tmp_path / "worlds").mkdir()
    body = 'PROTO Servo7 [ field SFString name "servo" ] { RotationalMotor { name IS name maxPosition 2 } }'
    (tmp_path / "protos" / "Servo7.proto").write_text(f"#VRML_SIM R2023b utf8\n{body}\n")
    found = one(tmp_path / "worlds", "HingeJoint", "device [ Servo7 { } ]")
    assert found.names == ("servo",) and found["servo"].limits == (0, 2)


def test_names_are_unique(tmp_path):
    joint = (
        f'HingeJoint {{ device RotationalMotor {{ name "wheel" }} endPoint Solid {{ name "w" children [ {BOX} ] }} }}'
    )
    scene = load(
        tmp_path, f'Solid {{ children [ {joint} {joint} Solid {{ name "world" children [ {joint} ] }} ] }}'
    ).scene
    assert scene.joints.names == ("wheel", "wheel (2)", "wheel (3)")
    assert scene.joints.links[0] == "world" and scene.joints["wheel (3)"].child == "w (3)"


@pytest.mark.parametrize(
    ("stops", "motor", "limits"),
    [
        ("", "", None),
        ("minStop -1 maxStop 2", "", (-1, 2)),
        ("minStop -1 maxStop 2", "minPosition -0.5 maxPosition 0.5", (-1, 2)),
        ("", "minPosition -0.5 maxPosition 0.5", (-0.5, 0.5)),
        ("minStop 1 maxStop -1", "", None),
    ],
)
@pytest.mark.parametrize("kind", ["HingeJoint", "SliderJoint"])
def test_limits(tmp_path, kind, stops, motor, limits):
    parameters = "HingeJointParameters" if kind == "HingeJoint" else "JointParameters"
    device = "RotationalMotor" if kind == "HingeJoint" else "LinearMotor"
    fields = f'jointParameters {parameters} {{ {stops} }} device {device} {{ name "m" {motor} }}'
    found = one(tmp_path, kind, fields)
    assert found["m"].limits == limits
    assert found["m"].kind == {"HingeJoint": "revolute" if limits else "continuous"}.get(kind, "prismatic")
    if limits:
        with pytest.raises(PoseError, match="must be from"):
            found.poses({"m": 9})


def test_second_axis_of_a_driven_ball_joint_is_limited_as_in_webots(tmp_path):
    found = one(tmp_path, "BallJoint", 'device2 RotationalMotor { name "m" maxPosition 9 minPosition -1 }')
    assert found["m"].limits == (-1, np.pi / 2)


@pytest.mark.parametrize("kind", ["HingeJoint", "Hinge2Joint"])
def test_joints_with_backlash_without_their_files(tmp_path, kind):
    """Start point and end point move together."""
    fields = 'jointParameters HingeJointParameters { axis 0 0 1 position 0.5 } device RotationalMotor { name "m" }'
    start = f"startPoint Pose {{ translation 2 0 0 children [ {BOX} ] }}"
    end = f'endPoint Solid {{ name "tip" translation 1 0 0 children [ {BOX} ] }}'
    text = f"Solid {{ children [ {BOX} {kind}WithBacklash {{ {fields} {start} {end} }} ] }}"
    static, scene = load(tmp_path, text).scene, load(tmp_path, text, movable=True).scene
    assert [item.name for item in static] == ["floor", "solid", "tip"] and "m" in scene.joints
    assert [(item.name, item.parent) for item in scene] == [
        ("floor", None),
        ("solid", None),
        ("tip (2)", None),
        ("tip", 2),
    ]
    (row,) = scene.joints.poses({"m": 0.5 + np.pi / 2})[0]
    for name, place in (("tip", (0, 1, 0)), ("tip (2)", (0, 2, 0))):
        np.testing.assert_allclose(transformed(scene[name], row).mean(axis=0), place, atol=1e-6)


ARM = """PROTO Arm [ field SFVec3f translation 0 0 0 field SFString name "arm" ] { Robot { translation IS translation
name IS name children [ %s HingeJoint { jointParameters HingeJointParameters { axis 0 0 1 anchor 1 0 0 }
device RotationalMotor { name "elbow" } endPoint Solid { translation 1 0 0 name "hand" children [ %s
DEF FINGER SliderJoint { device LinearMotor { name "grip" } endPoint Solid { name "finger" translation 0 1 0
children [ %s ] } } ] } } ] } }"""


def write_arm(folder):
    (folder / "Arm.proto").write_text(f"#VRML_SIM R2023b utf8\n{ARM % (BOX, BOX, BOX)}\n")
    return "Arm { translation 0 0 2 }"


def test_instances_of_protos_are_split_into_links_if_movable(tmp_path):
    text = write_arm(tmp_path)
    options = {"search_path": [tmp_path]}
    static, world = load(tmp_path, text, **options), load(tmp_path, text, movable=True, **options)
    assert [item.name for item in static.scene] == ["floor", "arm"] and static.robots == {"arm": ("arm",)}
    assert [item.name for item in world.scene] == ["floor", "arm", "hand", "finger"]
    assert world.robots == {"arm": ("arm", "hand", "finger")}
    assert [item.label for item in world.scene][1:] == [wv.Label.ROBOT] * 3
    assert world.scene.joints.names == ("arm", "elbow", "grip") == static.scene.joints.names
    np.testing.assert_allclose(
        np.sort(np.concatenate([item.vertices for item in world.scene][1:]), axis=0),
        np.sort(static.scene["arm"].vertices, axis=0),
    )
    rows = world.scene.joints.poses({"elbow": np.pi / 2, "grip": 0.5})[0]
    items = [list(world.scene)[index] for index in world.scene.movable]
    places = {item.name: transformed(item, row).mean(axis=0) for item, row in zip(items, rows, strict=True)}
    np.testing.assert_allclose(places["arm"], (0, 0, 2), atol=1e-6)
    np.testing.assert_allclose(places["hand"], (1, 0, 2), atol=1e-6)
    np.testing.assert_allclose(places["finger"], (0, 0, 2.5), atol=1e-6)


def test_labels_and_names_of_split_instances(tmp_path):
    text = write_arm(tmp_path) + ' Solid { name "hand" translation 3 3 3 children [ ' + BOX + " ] }"
    options = {"search_path": [tmp_path], "labels": {"arm": "obstacle"}}
    static, world = load(tmp_path, text, **options), load(tmp_path, text, movable=True, **options)
    assert [item.name for item in static.scene] == ["floor", "arm", "hand"]
    assert [item.name for item in world.scene] == ["floor", "arm", "hand (2)", "finger", "hand"]
    assert {item.label for item in world.scene} == {wv.Label.GROUND, wv.Label.OBSTACLE}


def test_scene_load_and_movable_names(tmp_path):
    text = write_arm(tmp_path)
    load(tmp_path, text, search_path=[tmp_path])
    scene = wv.Scene.load(tmp_path / "a.wbt", search_path=[tmp_path], movable=True)
    assert len(scene.movable) == 3 and scene.joints.poses({"elbow": [0, 1]}).shape == (2, 3, 7)
    scene = wv.Scene.load(tmp_path / "a.wbt", search_path=[tmp_path], movable=["arm"])
    assert len(scene) == 2 and len(scene.movable) == 1
    np.testing.assert_allclose(scene.joints.poses({"elbow": 1.0})[0, 0], [0, 0, 0, 0, 0, 0, 1])


def test_robots_with_joints_float(tmp_path):
    pose = np.array([1.0, 0, 0]), Rotation.identity()
    hinge = joint_text("HingeJoint", 0, pose, [(0, 0, 1)], (0, 0, 0), [0], BOX)
    text = f'Robot {{ name "rover" translation 0 0 1 children [ {BOX} {hinge} ] }}'
    text += f' Robot {{ name "still" children [ {BOX} ] }}'
    scene = load(tmp_path, text, movable=True).scene
    assert scene.joints.names == ("rover", "j0") and scene.joints["rover"].kind == "floating"
    assert [list(scene)[index].name for index in scene.movable] == ["rover", "link0"]
    rows = scene.joints.poses({"rover": (5, 0, 1, 0, 0, np.sin(np.pi / 4), np.cos(np.pi / 4)), "j0": np.pi / 2})[0]
    places = [transformed(scene[name], row).mean(axis=0) for name, row in zip(("rover", "link0"), rows, strict=True)]
    np.testing.assert_allclose(places, [(5, 0, 1), (4, 0, 1)], atol=1e-6)


def test_devices_move_with_their_links(tmp_path):
    """The images of a camera on a moved link are those of the world saved there."""
    pose = np.array([1.0, 0, 0.5]), Rotation.from_rotvec((0.1, 0.2, 0.3))
    inside = 'Camera { name "eye" translation 0.2 0 0 width 8 height 6 } Lidar { name "lidar" translation 0 0 0.1 }'

    def text(pose, position):
        hinge = joint_text("HingeJoint", 0, pose, [(0, 0, 1)], (0.5, 0, 0), [position], inside)
        return f"Robot {{ translation 0 0 1 children [ RangeFinder {{ }} {hinge} ] }}"

    world = load(tmp_path, text(pose, 0.25))
    assert [world.devices[name].link for name in ("eye", "range-finder")] == ["link0", "robot"]
    assert world.lidars["lidar"].link == "link0"
    other = load(tmp_path, text(moved("HingeJoint", [(0, 0, 1)], (0.5, 0, 0), pose, [0.25], [1.0]), 1.0))
    for name, expected in (("eye", other.devices["eye"].pose), ("lidar", other.lidars["lidar"].pose)):
        rows = world.device_poses(name, {"j0": [0.25, 1.0]})
        saved = (world.devices | world.lidars)[name].pose
        for row, place in zip(rows, (saved, expected), strict=True):
            np.testing.assert_allclose(row[:3], place[:3], atol=1e-9)
            turn = Rotation.from_quat(row[3:]).inv() * Rotation.from_quat(place[3:])
            assert turn.magnitude() < 1e-6
    saved = world.devices["range-finder"].pose
    np.testing.assert_allclose(
        poses_to_matrices(world.device_poses("range-finder")[0]), poses_to_matrices(saved), atol=1e-9
    )
    assert world.device_poses("range-finder", {"j0": [0.25, 1.0]}).shape == (2, 7)
    with pytest.raises(SceneError, match="no device or lidar 'nose'; it has 'lidar', 'range-finder', 'eye'"):
        world.device_poses("nose")


def test_devices_of_static_solids(tmp_path):
    world = load(tmp_path, f'Robot {{ translation 0 0 1 children [ {BOX} Camera {{ name "eye" }} ] }}')
    assert world.devices["eye"].link == ""
    (found,) = world.device_poses("eye")
    np.testing.assert_allclose(poses_to_matrices(found), poses_to_matrices(world.devices["eye"].pose), atol=1e-12)


def test_scaled_sliders_move_meters_of_the_world(tmp_path):
    fields = "jointParameters JointParameters { position 1 minStop 0 maxStop 2 }"
    end = f'endPoint Solid {{ name "tip" translation 0 0 1 children [ {BOX} ] }}'
    text = f"Transform {{ scale 2 2 2 children [ Solid {{ children [ SliderJoint {{ {fields} {end} }} ] }} ] }}"
    scene = load(tmp_path, text, "R2021b", movable=True).scene
    found = scene.joints["tip"]
    assert found.limits == (0, 4) and float(found.initial[0]) == 2


@pytest.mark.parametrize(
    "end",
    ['SolidReference { solidName "base" }', "NULL", f'Slot {{ endPoint Solid {{ name "tip" children [ {BOX} ] }} }}'],
)
def test_end_points_of_other_types(tmp_path, end):
    found = load(tmp_path, f'Solid {{ name "base" children [ {BOX} HingeJoint {{ endPoint {end} }} ] }}').scene.joints
    assert found.names == (("tip",) if end.startswith("Slot") else ())


def test_tracks_propellers_and_worlds_without_joints(tmp_path):
    text = f"Track {{ children [ TrackWheel {{ children [ {BOX} ] }} ] }}"
    text += f" Propeller {{ slowHelix Solid {{ children [ {BOX} ] }} }}"
    assert len(load(tmp_path, text).scene.joints) == 0
    with pytest.raises(SceneError, match="defines no moving objects"):
        load(tmp_path, text, movable=True)


@pytest.mark.parametrize(
    ("kind", "fields", "message"),
    [
        ("HingeJoint", "jointParameters HingeJointParameters { axis 1 0 }", "3 numbers in 'axis'"),
        ("HingeJoint", 'jointParameters HingeJointParameters { position "x" }', "a number in 'position'"),
        (
            "BallJoint",
            "jointParameters2 JointParameters { axis 0 0 1 } jointParameters3 JointParameters { axis 0 0 1 }",
            "an axis that differs from that of 'jointParameters2'",
        ),
        ("HingeJoint", "jointParameters HingeJointParameters { anchor 1e30 0 0 }", "HingeJoint is fixed"),
    ],
)
def test_invalid_joints_are_fixed(tmp_path, kind, fields, message):
    end = f'endPoint Solid {{ translation 0 0 1 name "tip" children [ {BOX} ] }}'
    text = f"#VRML_SIM R2023b utf8\nSolid {{ children [ {kind} {{ {fields} {end} }} ] }}\n"
    (tmp_path / "a.wbt").write_text(text)
    with pytest.warns(UserWarning, match=message):
        scene = wv.Scene.load(tmp_path / "a.wbt")
    assert [item.name for item in scene] == ["tip"] and len(scene.joints) == 0
    with pytest.raises(FileFormatError, match=message):
        wv.Scene.load(tmp_path / "a.wbt", strict=True)


@pytest.mark.parametrize("factor", ["e200", "e-200", ""])
def test_axes_of_any_length(tmp_path, factor):
    parameters = f"jointParameters2 JointParameters {{ axis 3{factor} 4{factor} 0 }}"
    found = one(tmp_path, "BallJoint", parameters)
    np.testing.assert_allclose(found["tip"].axis, (0.6, 0.8, 0))
    np.testing.assert_allclose(found["tip::3"].axis, (0, 0, -1), atol=1e-12)


def test_axes_of_zero_are_replaced_as_in_webots(tmp_path):
    end = f'endPoint Solid {{ name "tip" children [ {BOX} ] }}'
    text = f"Solid {{ children [ HingeJoint {{ jointParameters HingeJointParameters {{ axis 0 0 0 }} {end} }} ] }}"
    (tmp_path / "a.wbt").write_text(f"#VRML_SIM R2023b utf8\n{text}\n")
    with pytest.warns(UserWarning, match="axis 0 0 0 of HingeJointParameters is replaced by 0 0 1"):
        scene = wv.Scene.load(tmp_path / "a.wbt")
    np.testing.assert_array_equal(scene.joints["tip"].axis, (0, 0, 1))


def test_many_joints_are_fixed_beyond_a_limit(tmp_path, monkeypatch):
    monkeypatch.setattr("warpvis.webots._joints.MAX_JOINTS", 3)
    joint = f'HingeJoint {{ endPoint Solid {{ name "w" children [ {BOX} ] }} }}'
    (tmp_path / "a.wbt").write_text(f"#VRML_SIM R2023b utf8\nSolid {{ children [ {joint * 5} ] }}\n")
    with pytest.warns(UserWarning, match="expected at most 3 joints, got more; they are fixed"):
        scene = wv.Scene.load(tmp_path / "a.wbt")
    assert len(scene) == 5 and len(scene.joints) == 3
