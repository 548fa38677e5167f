# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects that valid arguments are built from: a scene, agents, images and models."""

import mujoco
import numpy as np
import trimesh
from rosbags.typesys import Stores, get_typestore

import warpvis as wv
from warpvis.scene.world_appearances import WorldAppearances

POSE = wv.look_at((0, 0, 0), (1, 0, 0))
CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0)
DEPTH = np.ones((1, 6, 8), dtype=np.float32)
COLOR = np.zeros((1, 6, 8, 3), dtype=np.uint8)
WORLD = """#VRML_SIM R2023b utf8
RangeFinder { translation -2 0 0 width 8 height 6 }
Lidar { translation -2 0 0 numberOfLayers 1 horizontalResolution 8 }
Robot { name "robot" children [
  Camera { name "camera" width 8 height 6 recognition Recognition { segmentation TRUE } } ] }
Solid { name "box" recognitionColors [ 1 0 0 ] children [ Shape { geometry Box { } } ] }
"""
MODEL = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><camera name="eye" pos="0 0 3"/><geom name="floor" type="plane" size="1 1 1"/>'
    '<body><freejoint/><geom name="ball" size="0.1"/><site name="down" zaxis="0 0 -1"/></body></worldbody>'
    '<sensor><rangefinder site="down"/></sensor></mujoco>'
)


class RangeFinder:
    """Stand-in for a range finder of a running simulation."""

    getWidth, getHeight, getFov = lambda self: 8, lambda self: 6, lambda self: 1.0
    getMinRange, getMaxRange = lambda self: 0.1, lambda self: 4.0

    def getRangeImage(self):
        return [1.0] * 48


def scene():
    made = wv.Scene()
    made.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="box", label="object", pose=(1, 0, 0, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="cart", pose=(2, 0, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((4, 4, 0.1)), name="floor", label="ground", pose=(0, 0, -1, 0, 0, 0, 1))
    return made


def agents():
    return [wv.Agent("robot", CAMERA, POSE), wv.Agent("human", wv.FieldOfView(1.5, 0.5, 0.5, resolution=10), POSE)]


STORE = get_typestore(Stores.ROS2_JAZZY)
wv.io.register_livox_types(STORE)
MESSAGE = {"frame_id": "camera", "stamp": 1.5, "types": STORE}
MOVED = [[2, 0.5, 0, 0, 0, 0, 1]]
SEEN = wv.perspective(scene(), agents())
SPACE = {"bounds": [[0, -1, -1], [2, 1, 1]], "up": "z", "threads": 1}
VIEW = {"camera": CAMERA, "camera_to_world": POSE, "convention": "opencv"}
WORLDS = {"object_poses": MOVED, "world_index": [0], "exclude": ["floor"]}
SCALES = {"object_scales": [[1.0, 2.0, 0.5]]}
LOOKS = {"appearances": WorldAppearances(backgrounds=[[0.1, 0.2, 0.3]])}
RENDERED = wv.render(scene(), CAMERA, POSE, outputs=("depth", "points", "normals", "labels", "segmentation"))
MESH = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def rendered_once(data):
    renderer = wv.mujoco.Renderer(MODEL, 6, 8)
    renderer.enable_depth_rendering()
    renderer.update_scene(data, camera="eye")
    return renderer
