# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes, poses, files and models that the documentation pages assume."""

import shutil
import types
from pathlib import Path

import mujoco
import numpy as np
import rasterio
import trimesh
from PIL import Image

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scene.materials import Appearance
from warpvis.scenes import EXPERIMENTS

from support.bop_scene import write_identity
from support.figures import mixamo_arrays, write_glb
from support.habitat import make_dataset
from support.scans import write_scannet

ROOT = Path(__file__).parent.parent

_ARM = """
<mujoco>
  <worldbody>
    <geom name="floor" type="plane" size="2 2 .1"/>
    <body name="table" pos=".5 .5 .2">
      <geom name="table" type="box" size=".2 .2 .2"/>
      <body name="drawer" pos="0 -.2 0"><geom name="drawer" type="box" size=".1 .05 .05"/></body>
    </body>
    <camera name="head" pos="0 -1.5 1" xyaxes="1 0 0 0 .5 .9"/>
    <body name="arm" pos="0 0 .5">
      <joint name="shoulder" type="hinge" axis="0 1 0"/>
      <geom name="upper" type="capsule" size=".06" fromto="0 0 0 .3 0 .2"/>
      <camera name="wrist" pos=".3 0 .3"/>
      <site name="ahead" pos=".3 0 .2" zaxis="1 0 -.5"/>
    </body>
  </worldbody>
  <sensor><rangefinder site="ahead"/></sensor>
</mujoco>
"""

# The pages run on a machine with a GPU; the tests run smaller workloads on the CPU.
_SMALLER = {
    '"cuda:0"': '"cpu"',
    "nworld=4096": "nworld=16",
    "count=100000": "count=20",
    "--count 100000": "--count 10 --per-shard 10",
    "count=360": "count=8",
    "step=0.1": "step=0.5",
    "spacing=0.02": "spacing=0.2",
    "SituationGenerator, count=1000": "SituationGenerator, count=10",
    "SituationOptions(seed=0)": "SituationOptions(seed=0, per_shard=10)",
}


def made_smaller(code):
    """Return a page's code with a smaller workload."""
    for large, small in _SMALLER.items():
        code = code.replace(large, small)
    return code


def prepare(page, folder):
    """Return the names that a page's code uses; write the files that it reads to `folder`."""
    names = {"wv": wv, "np": np}
    make = globals().get(f"_{page}")
    if make is not None:
        names |= make(folder)
    return names


def _people(folder):
    write_glb(folder / "person.glb", mixamo_arrays())
    return {}


def _appearance(folder):
    box = trimesh.creation.box()
    header = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n"
    (folder / "field.hdr").write_bytes(header + bytes([90, 120, 200, 128]) * 8)
    arrays = {"rows": [0] * 12, "uv": np.zeros((12, 3, 2)), "points": np.zeros((4, 3))}
    seen = {"camera": wv.Camera.from_fov(16, 12, hfov=1.0), "camera_to_world": wv.look_at((3, 3, 3), (0, 0, 0))}
    return {"mesh": box, "cup": box, "table": box, "crate": box, **arrays, **seen}


def _habitat(folder):
    items = [{"template_name": "cup", "translation": [x, 0.7, 0]} for x in (0, 0.2)]
    lexicon = {"classes": [{"id": 7, "name": "mug"}]}
    scene = {"stage_instance": {"template_name": "room"}, "object_instances": [*items, {"template_name": "table"}]}
    more = {"semantics__lexicon.json": lexicon}
    make_dataset(folder / "hssd-hab", scene, objects={"cup": {"semantic_id": 7}}, **more)
    return {}


def _scans(folder):
    write_scannet(folder / "scene0000_00")
    return {}


def _sdf(folder):
    box = "<visual name='v'><geometry><box><size>1 1 1</size></box></geometry></visual>"
    camera = (
        "<sensor name='c' type='camera'><camera><image><width>8</width><height>6</height></image></camera></sensor>"
    )
    joint = "<parent>base</parent><child>arm</child><axis><xyz>0 0 1</xyz></axis>"
    joint = f"<joint name='turn' type='revolute'>{joint}</joint>"
    robot = f"<link name='base'>{box}</link><link name='arm'><pose>0 0 1 0 0 0</pose>{box}{camera}</link>{joint}"
    (folder / "models").mkdir()
    table = "<include><uri>model://table</uri><pose>3 0 1 0 0 0</pose></include>"
    text = f"<sdf version='1.9'><world name='w'><model name='robot'>{robot}</model>{table}</world></sdf>"
    (folder / "cafe.world").write_text(text)
    (folder / "models" / "table").mkdir()
    model = f"<sdf version='1.9'><model name='table'><link name='l'>{box}</link></model></sdf>"
    (folder / "models" / "table" / "model.sdf").write_text(model)
    return {}


def _bop(folder):
    write_identity(folder / "ycbv")
    images = folder / "ycbv/test/000002/rgb"
    images.mkdir()
    Image.new("RGB", (64, 48)).save(images / "000003.png")
    return {}


def _terrain(folder):
    place = {"crs": "EPSG:32633", "transform": rasterio.transform.from_origin(500000, 5400000, 10, 10)}
    profile = {"driver": "GTiff", "width": 30, "height": 20, "count": 1, "dtype": "float32", **place}
    with rasterio.open(folder / "dem.tif", "w", **profile) as file:
        file.write(np.arange(600, dtype=np.float32).reshape(1, 20, 30))
    return {}


def _room():
    """Return a room with a floor, a table, a cup and a ball behind a wall, a robot and a person."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((8, 6, 0.02)), name="floor", label="ground", pose=(2, 0, -0.01, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 2, 1)), name="wall", pose=(2, 1.5, 0.5, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="cup", label="object", pose=(2, 0, 0.8, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(3, 0.4, 0.1, 0, 0, 0, 1))
    scene.add(trimesh.creation.cylinder(0.2, 1), name="robot", label="robot", pose=(0, 0, 0.5, 0, 0, 0, 1))
    scene.add(trimesh.creation.cylinder(0.2, 1.5), name="person", label="human", pose=(4, 0, 0.75, 0, 0, 0, 1))
    return scene


def _poses(count=3):
    return np.array([wv.look_at((-1, -0.3 * i, 1.2), (2, 0, 0.8)) for i in range(count)])


def _save_poses(path, count=6):
    np.savetxt(path, np.column_stack([np.arange(count), _poses(count)]))


def _rendering(folder):
    _room().export(folder / "lab.glb")
    K = wv.Camera.from_fov(640, 480, hfov=1.0).to_K(pixel_center=0.0)
    pixels = np.random.default_rng(1).uniform((0, 0), (640, 480), (3, 50, 2))
    return {"K": K, "poses": _poses(), "other_poses": _poses()[::-1], "pixels": pixels}


def _extending(folder):
    return {"scene": _room(), "pose": _poses(1)}


def _files(folder):
    from support.recordings import write_tum

    _room().export(folder / "lab.glb")
    write_tum(folder / "rgbd_dataset_freiburg1_desk", count=2)
    return {}


def _depth_cameras(folder):
    camera, sensor = wv.Camera.from_fov(320, 200, hfov=1.4), wv.sensors.StereoDepth(0.05, sigma=0.08, subpixel=32)
    wall = wv.Scene()
    wall.add(trimesh.creation.box((60, 0.02, 60)), pose=(0, 2.0, 0, 0, 0, 0.08, 0.9968))
    ahead = np.stack([wv.look_at((0, 0, 0), (0, 1, 0))] * 2)
    walls = wv.render(wall, camera, ahead, sensor=sensor, outputs="depth").depth.numpy()
    return {"walls": walls, "wall_camera": camera}


_ROBOT = """<robot name="arm">
  <link name="base"><visual><geometry><box size=".2 .2 .1"/></geometry></visual></link>
  <link name="upper"><visual><origin xyz="0 0 .3"/><geometry><box size=".1 .1 .6"/></geometry></visual></link>
  <link name="lower"><visual><origin xyz="0 0 .2"/><geometry><cylinder radius=".04" length=".4"/></geometry></visual>
  </link>
  <joint name="shoulder" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0 0 .6"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>"""


def _urdf(folder):
    (folder / "arm.urdf").write_text(_ROBOT)
    return {}


def _worlds(folder):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    return _urdf(folder) | {
        "table": trimesh.creation.box((1, 1, 0.1)),
        "gripper": trimesh.creation.box((0.2, 0.1, 0.1)),
        "finger": trimesh.creation.box((0.02, 0.02, 0.1)),
        "finger_pose": (0, 0, 0.1, 0, 0, 0, 1),
        "cube_poses": np.random.default_rng(0).uniform(size=(20, 7)) * [1, 1, 1, 0, 0, 0, 0] + [0, 0, 0, 0, 0, 0, 1],
        "cube": box,
        "chair_poses": np.random.default_rng(1).uniform(size=(20, 7)) * [1, 1, 1, 0, 0, 0, 0] + [0, 0, 0, 0, 0, 0, 1],
        "chair": box,
    }


def _real_cameras(folder):
    scene, camera = _room(), wv.Camera.from_fov(640, 480, hfov=1.0, near=0.3, far=5.0)
    depth = wv.render(scene, camera, wv.look_at((0, -1.0, 1.2), (2, 0.5, 0.3)), outputs="depth").depth.numpy()[0]
    raw = np.where(np.isfinite(depth), depth * 1000, 0).astype(np.uint16)
    return {"raw": raw, "K": camera.to_K(pixel_center=0.0)}


def _registration(folder):
    _urdf(folder)
    scene, camera = _tabletop(), wv.Camera.from_fov(160, 120, hfov=1.0, near=0.3, far=6.0)
    scene.add(trimesh.creation.box((9, 9, 0.1)), name="floor", label="ground", pose=(2, 0, -0.05, 0, 0, 0, 1))
    truth = wv.look_at((0.5, -1.0, 1.5), (2, 0, 0.7))
    depth = wv.render(scene, camera, truth, outputs="depth").depth.numpy()[0]
    initial = np.array([wv.look_at((0.5 + x, -1.03, 1.52), (2, 0.03, 0.7)) for x in (0.0, 0.04, 0.08)])
    mug = np.array([[[2.32, 0.02, 0.76, 0, 0, 0, 1]]])
    given = {"scene": scene, "camera": camera, "depth": depth, "initial": initial, "truth": truth, "mug": mug}
    robot = wv.Scene.load(folder / "arm.urdf", movable=True)
    view, estimate = wv.look_at((0.4, -1.4, 1.0), (0.1, 0, 0.6)), wv.look_at((0.42, -1.38, 1.0), (0.12, 0, 0.6))
    postures = {"shoulder": [0.4, 0.0, 0.6, 1.2], "elbow": [0.75, 0.5, 1.0, -0.8]}
    images = wv.render(robot, camera, [view] * 4, outputs="depth", object_poses=robot.joints.poses(postures)).depth
    arm = {"arm_depth": images.numpy()[0], "posture_depth": images.numpy()[1:]}
    hands = poses_to_matrices([wv.look_at(eye, (2, 0, 0.7)) for eye in [(0.5, -1, 1.5), (1, -1, 1.2), (0, 0, 1.8)]])
    guesses = np.tile(np.eye(4), (2, 1, 1))
    guesses[:, 0, 3] = 0.02, 0.05
    hand = {"hands": hands, "guesses": guesses, "hand_depth": wv.render(scene, camera, hands, outputs="depth").depth}
    return given | arm | hand | {"arm_view": view, "arm_estimate": estimate}


def _calibration_files(folder):
    from support.calibration_files import FISHEYE, RADTAN, F, kalibr

    text = kalibr("pinhole", F, "radtan", RADTAN) + kalibr("pinhole", F, "equidistant", FISHEYE, "cam1")
    (folder / "camchain.yaml").write_text(text)
    _room().export(folder / "room.glb")
    return {"scene": _room(), "camera_to_world": _poses()}


def _tabletop():
    """Return a table with a screen and a mug, a robot and a person."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1.6, 0.7)), name="table", pose=(2, 0, 0.35, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.05, 0.5, 0.4)), name="screen", pose=(2, 0, 0.9, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 0.1, 0.1)), name="mug", pose=(2.3, 0, 0.75, 0, 0, 0, 1), movable=True)
    scene.add(trimesh.creation.cylinder(0.2, 1), name="robot", label="robot", pose=(0, 0, 0.5, 0, 0, 0, 1))
    scene.add(trimesh.creation.cylinder(0.2, 1.5), name="person", label="human", pose=(4, 0, 0.75, 0, 0, 0, 1))
    return scene


def _visibility(folder):
    from support.recordings import write_tum

    scene = _room()
    scene.export(folder / "room.glb")
    occupancy = wv.OccupancyMap(cell_size=0.1)
    camera = wv.Camera.from_fov(64, 48, hfov=1.0)
    occupancy.integrate(wv.render(_room(), camera, _poses(1)).depth, camera, _poses(1))
    _save_poses(folder / "poses.txt")
    write_tum(folder / "rgbd_dataset_freiburg1_desk", count=2)
    return {
        "scene": scene,
        "camera": wv.Camera.from_fov(64, 48, hfov=1.0),
        "tabletop": _tabletop(),
        "robot_at": (0.0, -1.5, 0.0),
        "cup_at": (2, 0, 0.8),
        "eyes": _poses()[:, :3],
        "person_at": _poses(1),
        "targets": np.array([[3, 0.4, 0.1], [2.5, 1.5, 0.2]]),
        "points": np.array([[0.5, 0.4, 0.1], [1.0, 0.5, 0.2]]),
        "bounds": ((0, 0, 0), (0.4, 0.4, 0.4)),
        "visitor": trimesh.creation.cylinder(0.2, 1.7),
        "walks": np.array([[(x, 1, 0.85, 0, 0, 0, 1)] for x in (0.5, 1.0, 1.5)]),
        "occupancy": occupancy,
    }


def _learning(folder):
    camera = wv.Camera.from_fov(64, 48, hfov=1.0, far=10)
    poses = _poses()
    renderer = wv.Renderer(_room(), camera, fill="far")
    arrays = types.SimpleNamespace(from_dlpack=np.from_dlpack)
    arm = mujoco.MjModel.from_xml_string(_ARM)
    state = mujoco.MjData(arm)
    mujoco.mj_forward(arm, state)
    mjx = {"mjx_model": types.SimpleNamespace(geom_rgba=arm.geom_rgba), "states": wv.mujoco.WorldPoses.of([state] * 2)}
    given = {"renderer": renderer, "scene": renderer.scene, "camera": camera, "poses": poses}
    return {**given, "torch": arrays, "jnp": arrays, "arm": arm, **mjx}


def _gradients(folder):
    import torch

    given = _registration(folder)
    scene, camera = given["scene"], given["camera"]
    corners, coordinates = [(4, -1, 0), (4, 1, 0), (4, 1, 2), (4, -1, 2)], np.float32([[0, 0], [1, 0], [1, 1], [0, 1]])
    scene.add((corners, [(0, 1, 2), (0, 2, 3)]), name="poster", appearance=Appearance(uv=coordinates))
    depth = wv.render(scene, camera, given["truth"], outputs="depth").depth.numpy()[0]
    poses = torch.tensor(_poses(2), dtype=torch.float32)
    pictures = torch.from_dlpack(wv.render(scene, camera, poses, outputs="albedo").albedo) / 255
    return given | {"depth": depth, "poses": poses, "pictures": pictures}


def _mujoco(folder):
    import mujoco_warp

    model = mujoco.MjModel.from_xml_string(_ARM)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    warp_data = mujoco_warp.put_data(model, data, nworld=16)
    every = {name: np.tile(getattr(model, name), (16, 1, 1)) for name in ("body_pos", "geom_rgba", "geom_size")}
    return {
        "model": model,
        "data": data,
        "warp_data": warp_data,
        "warp_model": mujoco_warp.put_model(model),
        "qpos": np.tile(data.qpos, (16, 1)),
        "places": every["body_pos"],
        "colors": every["geom_rgba"],
        "sizes": every["geom_size"],
        "fovy": np.linspace(40, 60, 16)[:, None].repeat(model.ncam, axis=1),
        "cup": trimesh.creation.cylinder(0.04, 0.1),
        "camera": wv.Camera.kinect(),
        "camera_to_world": _poses(1),
    }


def _viewer(folder):
    from support.recordings import write_tum

    write_tum(folder / "rgbd_dataset_freiburg1_desk", count=2)
    experiment = EXPERIMENTS[0]
    robot, human = experiment.agents()
    return {"scene": experiment.build(), "robot": robot, "human": human}


def _webots(folder):
    shutil.copy(ROOT / "scenes" / "webots" / "experiment_3_R2023b.wbt", folder / "lab.wbt")
    (folder / "webots" / "projects").mkdir(parents=True)
    lidar = "Robot { children [ Lidar { numberOfLayers 2 horizontalResolution 64 maxRange 9 } ] }"
    wall = "Solid { translation 2 0 0 children [ Shape { geometry Box { size 0.1 9 9 } } ] }"
    (folder / "scanned.wbt").write_text(f"#VRML_SIM R2023b utf8\n{lidar} {wall}")
    box = "Shape { geometry Box { size 0.2 0.2 0.8 } }"
    slide = f'SliderJoint {{ device LinearMotor {{ name "slide" }} endPoint Solid {{ children [ {box} ] }} }}'
    motor = 'RotationalMotor { name "elbow" minPosition -2 maxPosition 2 }'
    elbow = f"HingeJoint {{ device {motor} endPoint Solid {{ translation 0 0 0.8 children [ {box} {slide} ] }} }}"
    (folder / "arm.wbt").write_text(f"#VRML_SIM R2023b utf8\nRobot {{ children [ {box} {elbow} ] }}")
    return {"scanned": wv.webots.load_webots(folder / "scanned.wbt")}


def _ros(folder):
    from ros_messages import STORE

    camera = wv.Camera.from_fov(64, 48, hfov=1.0)
    frame = {"frame_id": "camera_depth_optical_frame", "types": STORE}
    scene, pose = _room(), _poses(1)
    depth = wv.render(scene, camera, pose).depth
    samples = np.linspace((0, -180, 50), (0.1, 180, 97), 20_000)
    np.savetxt(folder / "mid360.csv", samples, "%.5f", ",", header="Time/s,Azimuth/deg,Zenith/deg", comments="")
    return {
        "info_msg": camera.to_camera_info(**frame),
        "image_msg": wv.io.to_image_msg(depth, **frame),
        "scene": scene,
        "camera_to_world": pose,
        "points": np.array([[3, 0.4, 0.1], [2.5, 1.5, 0.2]]),
    }


def _usd(folder):
    body = '(prepend apiSchemas = ["PhysicsRigidBodyAPI"])'
    mug = 'def Sphere "Body" {\n double radius = 0.05\n double3 xformOp:translate = (0, 0, -2)\n'
    mug += ' uniform token[] xformOpOrder = ["xformOp:translate"]\n}'
    door = f'def Cube "Door" {body} {{\n double size = 0.5\n}}'
    hinge = 'def PhysicsRevoluteJoint "door_hinge" {\n rel physics:body1 = </Kitchen/Door>\n}'
    content = f'def Camera "Eye" {{\n}}\ndef Xform "Mug" {{\n{mug}\n}}\n{door}\n{hinge}'
    (folder / "kitchen.usda").write_text(
        f'#usda 1.0\n(\n metersPerUnit = 1\n upAxis = "Z"\n)\ndef Xform "Kitchen" {{\n{content}\n}}\n'
    )
    return {}


def _batch(folder):
    _room().export(folder / "room.glb")
    _save_poses(folder / "walk.txt")
    return {}
