# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the ROS 2 node example without ROS: stand-ins for a node, tf and messages."""

import importlib.util
import json
import sys
import types
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

pytest.importorskip("rosbags.typesys")

import ros_messages

import warpvis as wv
from warpvis.rendering import ColorOptions
from warpvis.scene.lights import HEADLIGHT, AmbientOcclusion

from support.ros_nodes import Buffer, Missing, Node, Time

PATH = Path(__file__).parent.parent / "examples" / "ros2_node.py"
EYE_FRAME = "camera_depth_optical_frame"

URDF = """
<robot name="arm">
  <material name="gray"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="base">
    <visual><origin xyz="0 0 0.1"/><geometry><box size="0.2 0.2 0.2"/></geometry><material name="gray"/></visual>
    <visual><origin xyz="0 0 0.25" rpy="0 0 0"/><geometry><box size="0.1 0.1 0.1"/></geometry></visual>
    <collision><geometry><box size="9 9 9"/></geometry></collision>
  </link>
  <link name="hand">
    <inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>
    <visual>
      <origin xyz="0.3 0 0" rpy="0 0 1.5707963267948966"/><geometry><box size="0.6 0.02 0.04"/></geometry>
      <material name="red"><color rgba="1 0 0 1"/></material>
    </visual>
  </link>
  <link name="tool"><visual><geometry><mesh filename="package://somewhere/tool.stl"/></geometry></visual></link>
  <link name="guard"><collision><geometry><box size="9 9 9"/></geometry></collision></link>
  <link name="tip"/>
  <joint name="lift" type="prismatic">
    <parent link="base"/><child link="hand"/><origin xyz="0 0 5"/><axis xyz="0 0 1"/><limit lower="0" upper="1"/>
  </joint>
  <joint name="grip" type="fixed"><parent link="hand"/><child link="tool"/></joint>
  <joint name="cage" type="fixed"><parent link="hand"/><child link="guard"/></joint>
  <joint name="end" type="fixed"><parent link="hand"/><child link="tip"/></joint>
</robot>
"""


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("ros2_node", PATH)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """Return the file of a floor with a ball, and write a file of a cup in its own frame."""
    monkeypatch.chdir(tmp_path)
    scene = wv.Scene()
    scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="bowl", label="object", pose=(2, 0.7, 0.5, 0, 0, 0, 1))
    scene.export("lab.glb")
    cup = wv.Scene()
    for name, z in (("body", 0.0), ("rim", 0.12)):
        cup.add(trimesh.creation.box((0.2, 0.2, 0.1)), name=name, pose=(0, 0, z, 0, 0, 0, 1))
    cup.export("cup.glb")
    return "lab.glb"


def lab_with(**places):
    """Return the lab with cups, built without ROS."""
    scene = wv.Scene.load("lab.glb")
    boxes = [trimesh.creation.box((0.2, 0.2, 0.1)).apply_translation((0, 0, z)) for z in (0.0, 0.12)]
    for name, place in places.items():
        scene.add(trimesh.util.concatenate(boxes), name=name, label="object", pose=moved(place))
    return scene


@pytest.fixture
def start(example, monkeypatch):
    """Return a function that starts a viewer with given parameters and returns its node and tf buffer."""
    messages = ros_messages.install(monkeypatch)

    def start(**parameters):
        node, buffer = Node(messages, parameters), Buffer(messages)
        kinds = (messages[f"sensor_msgs/msg/{kind}"] for kind in ("Image", "CameraInfo", "PointCloud2"))
        ros = example.Ros(*kinds, messages["std_msgs/msg/String"], Time, buffer, Missing, "sensor", "latched")
        example.Viewer(node, ros)
        return node, buffer

    return start


def moved(place):
    return (*map(float, place), 0.0, 0.0, 0.0, 1.0)


EYE = tuple(map(float, wv.look_at((0, 0, 0.6), (2, 0, 0.5))))
SMALL = {"width": 64, "height": 48, "hfov": 1.0}


def test_links_are_read_in_their_frames(example):
    """Joints are ignored; collision elements are used only if a robot has no visual elements."""
    with pytest.warns(UserWarning, match=r"link tool is not shown: .*skipped package://somewhere/tool\.stl"):
        links = example.read_links(URDF)
    assert set(links) == {"base", "hand"}
    bounds = {name: (link.vertices.min(axis=0), link.vertices.max(axis=0)) for name, link in links.items()}
    np.testing.assert_allclose(bounds["base"], [(-0.1, -0.1, 0), (0.1, 0.1, 0.3)], atol=1e-6)
    np.testing.assert_allclose(bounds["hand"], [(0.29, -0.3, -0.02), (0.31, 0.3, 0.02)], atol=1e-6)
    base = links["base"]
    assert trimesh.Trimesh(base.vertices, base.faces, process=False).body_count == 2 and len(base.faces) == 24
    bare = (
        '<robot name="r"><link name="a"><collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>'
    )
    assert set(example.read_links(bare)) == {"a"}


def test_packages_are_found_on_the_search_path(example, tmp_path):
    (tmp_path / "somewhere").mkdir()
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "somewhere" / "tool.stl")
    tool = example.read_links(URDF, [str(tmp_path)])["tool"]
    np.testing.assert_allclose(np.ptp(tool.vertices, axis=0), (0.1, 0.2, 0.3), atol=1e-6)


@pytest.mark.filterwarnings("ignore:link tool")
def test_links_follow_tf(example):
    """A link is hidden until tf knows it, and keeps its last pose when tf loses it."""
    scene, links = example.build_scene(urdf=URDF)
    eye = example.Eye(scene, wv.Camera.from_fov(64, 48, hfov=1.0), links=links)
    frames = {}
    eye.follow(frames.get)
    assert eye.lost == {"base", "hand"} and np.isposinf(eye.look(EYE)[0].depth.numpy()).all()
    frames["hand"] = moved((1, 0, 0.6))
    eye.follow(frames.get)
    views, seen = eye.look(EYE)
    assert eye.lost == {"base"} and views.depth.numpy().min() == pytest.approx(1.29, abs=0.02)
    assert seen["hand"]["status"] == "visible" and seen["base"]["status"] == "out_of_view"
    frames.clear()
    eye.follow(frames.get)
    assert eye.look(EYE)[1] == seen


@pytest.mark.filterwarnings("ignore:link tool")
def test_node_publishes_rendered_images_and_visibility(start, lab):
    node, buffer = start(scene=lab, movable="cup=cup.glb", exclude="base", near=0.2, far=3.0, **SMALL)
    (period, tick), (kind, take, qos) = node.timers[0], node.takes["robot_description"]
    assert period == 0.1 and qos == "latched"
    tick()
    assert node.published["visibility"] == [] and node.warned == [f"tf does not know {EYE_FRAME} in map yet"]
    take(kind(data=URDF))
    buffer.tell(EYE_FRAME, EYE, 3.5)
    buffer.tell("cup", moved((2.0, 0.0, 0.5)), 3.5)
    buffer.tell("hand", moved((1.0, 0.0, 0.5)), 3.5)
    tick()
    tick()
    assert node.warned[1:] == ["tf does not know base yet, so it is not shown"]
    assert {topic: len(sent) for topic, sent in node.published.items()} == {
        "depth/image_rect": 2,
        "color/image_rect": 2,
        "camera_info": 2,
        "points": 2,
        "visibility": 2,
    }
    image, colors, info, cloud, text = (sent[0] for sent in node.published.values())

    scene = lab_with(cup=(2, 0, 0.5))
    hand = trimesh.creation.box((0.02, 0.6, 0.04))
    scene.add(hand, name="hand", label="robot", pose=(1.3, 0, 0.5, 0, 0, 0, 1))
    scene.lights = (HEADLIGHT,)  # that of a mesh file without lights
    camera = wv.Camera.from_fov(64, 48, hfov=1.0, near=0.2, far=3.0)
    expected = wv.render(scene, camera, EYE, outputs=("depth",)).depth.numpy()[0]
    np.testing.assert_allclose(wv.io.from_image_msg(image), expected, atol=1e-5)
    assert np.isposinf(expected).any() and np.isfinite(expected).any()
    assert wv.Camera.from_camera_info(info, near=0.2, far=3.0) == camera
    points = np.frombuffer(cloud.data, dtype=[("xyz", "<f4", 3), ("bgr", "u1", 3), ("zero", "u1")]).reshape(48, 64)
    assert (np.isfinite(points["xyz"][..., 2]) == np.isfinite(expected)).all()
    color = wv.io.from_color_msg(colors)
    views = wv.render(scene, camera, EYE, outputs=("color", "segmentation"))
    is_hand = views.segmentation.numpy()[0] == scene.index("hand")
    np.testing.assert_array_equal(color[~is_hand], views.color.numpy()[0][~is_hand])
    assert (color[is_hand][:, 0] == 255).all() and (color[is_hand][:, 1:] < 128).all()  # red, with MuJoCo's highlight
    np.testing.assert_array_equal(points["bgr"][..., ::-1], color)
    for message in (image, colors, info, cloud):
        assert (message.header.frame_id, message.header.stamp.sec) == (EYE_FRAME, 3)
        assert message.header.stamp.nanosec == 500_000_000
    told = json.loads(text.data)
    assert told["header"] == {"stamp": {"sec": 3, "nanosec": 500_000_000}, "frame_id": EYE_FRAME}
    report = wv.object_visibility(scene, camera, EYE, objects=["floor", "bowl", "cup"])
    assert list(told["objects"]) == list(report.names)
    for place, (name, seen) in enumerate(told["objects"].items()):
        assert seen["pixels"] == report.visible_pixels.numpy()[0, place], name
        assert seen["fraction"] == pytest.approx(report.fraction.numpy()[0, place], abs=1e-4)
    assert told["objects"]["cup"]["hidden_by"] == "hand" and told["objects"]["bowl"]["hidden_by"] is None


def test_colors_have_the_options_of_the_renderer(start, lab):
    """Parameters for colors are the options of `warpvis.rendering.ColorOptions`."""
    options = {"shadows": False, "reflections": False, "samples": 4}
    for distance, expected in ((0.5, AmbientOcclusion(0.5)), (0.0, None)):
        node, _ = start(scene=lab, ambient_occlusion=distance, **options)
        renderer = node.timers[0][1].__self__._eye._renderer
        found = {name: getattr(renderer, name) for name in ColorOptions.__annotations__}
        assert found == options | {"ambient_occlusion": expected}


def test_poses_are_of_the_image_time(start, lab):
    """Or the latest ones, if tf has none for that time; a static camera has the clock's time."""
    node, buffer = start(scene=lab, movable="cup=cup.glb mug=cup.glb", **SMALL)
    tick = node.timers[0][1]
    buffer.tell(EYE_FRAME, EYE, 3.0)
    buffer.tell("cup", moved((2, 0, 0.5)), 3.0)
    buffer.tell("cup", moved((-2, 0, 0.5)), 4.0)  # after the image
    buffer.tell("mug", moved((-2, 0, 0.5)), 1.0)
    tick()
    objects = json.loads(node.published["visibility"][0].data)["objects"]
    assert (objects["cup"]["status"], objects["mug"]["status"]) == ("visible", "out_of_view")
    buffer.tell(EYE_FRAME, EYE, 0.0)
    buffer._poses[EYE_FRAME].pop(3.0)
    tick()
    header = node.published["camera_info"][1].header
    assert (header.stamp.sec, header.stamp.nanosec) == (77, 5)


def test_camera_info_topic_defines_the_camera(start, lab):
    node, buffer = start(scene=lab, camera_info="/head/camera_info", encoding="16UC1", far=3.0)
    buffer.tell(EYE_FRAME, EYE, 3.0)
    node.timers[0][1]()
    assert node.published["camera_info"] == []
    kind, take, qos = node.takes["/head/camera_info"]
    assert qos == "sensor"
    camera = wv.Camera(40, 30, 38.0, 37.0, 19.3, 15.6)
    for _ in range(2):
        take(camera.to_camera_info(frame_id="head"))
        node.timers[0][1]()
    image, info = (node.published[topic][1] for topic in ("depth/image_rect", "camera_info"))
    assert isinstance(info, kind) and wv.Camera.from_camera_info(info) == camera
    assert (image.encoding, image.width, image.height, image.step) == ("16UC1", 40, 30, 80)
    assert not node.published["color/image_rect"]  # the scene has no colors
    depth = wv.render(wv.Scene.load(lab), wv.Camera(40, 30, 38.0, 37.0, 19.3, 15.6, 0.3, 3.0), EYE).depth.numpy()[0]
    expected = np.where(np.isfinite(depth), np.rint(depth * 1000.0), 0)
    assert np.abs(np.frombuffer(image.data, dtype="<u2").reshape(30, 40) - expected).max() <= 1


def test_object_names_of_links_may_precede_the_robot(start, lab):
    node, buffer = start(scene=lab, objects="bowl hand", exclude="base", **SMALL)
    buffer.tell(EYE_FRAME, EYE, 3.0)
    node.timers[0][1]()
    kind, take, _ = node.takes["robot_description"]
    with pytest.warns(UserWarning, match="link tool"):
        take(kind(data=URDF))
    node.timers[0][1]()
    told = [list(json.loads(text.data)["objects"]) for text in node.published["visibility"]]
    assert told == [["bowl"], ["bowl", "hand"]]


def test_node_runs_and_stops(example, lab, monkeypatch, tmp_path):
    """Run `main` with stand-ins for the modules that it imports."""
    messages = ros_messages.install(monkeypatch)
    node, buffer = Node(messages, {"scene": lab, **SMALL}), Buffer(messages)
    buffer.tell(EYE_FRAME, EYE, 3.0)
    calls = []

    def spin(spun):
        assert spun is node
        node.timers[0][1]()
        raise KeyboardInterrupt

    def module(name, **members):
        made = types.ModuleType(name)
        vars(made).update(members)
        monkeypatch.setitem(sys.modules, name, made)

    module(
        "rclpy",
        init=lambda: calls.append("init"),
        create_node=lambda name: node,
        spin=spin,
        try_shutdown=lambda: calls.append("shutdown"),
    )
    policy = SimpleNamespace(TRANSIENT_LOCAL="transient local")
    module("rclpy.qos", DurabilityPolicy=policy, QoSProfile=lambda **of: of, qos_profile_sensor_data="sensor")
    module("rclpy.time", Time=Time)
    listened = []
    module(
        "tf2_ros",
        Buffer=lambda: buffer,
        TransformException=Missing,
        TransformListener=lambda *given: listened.append(given),
    )
    monkeypatch.setenv("AMENT_PREFIX_PATH", f"{tmp_path}:/nowhere")
    example.main()
    assert calls == ["init", "shutdown"] and node.destroyed and listened == [(buffer, node)]
    assert node.takes["robot_description"][2] == {"depth": 1, "durability": "transient local"}
    assert len(node.published["visibility"]) == 1
