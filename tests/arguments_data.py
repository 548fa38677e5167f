# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of public functions of `batch`, `io`, `maps` and `mujoco`: ``name: (function, arguments)``."""

from functools import partial

import gymnasium as gym
import mujoco
import numpy as np
from arguments_shared import CAMERA, COLOR, DEPTH, MESSAGE, MODEL, MOVED, POSE, RENDERED, VIEW, rendered_once, scene
from gymnasium_environments import Cup, make_cup

import warpvis as wv
import warpvis.mujoco.gymnasium as wrappers
from warpvis.scene.lights import AmbientOcclusion


def data_cases(folder):
    """Return the cases; write their files to `folder`."""
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    seen = scene()
    path = folder / "out"
    grid = wv.maps.OccupancyGrid(np.zeros((2, 3), dtype=np.int8), (0.0, 0.0), 0.05, "z")
    mujoco_scene = wv.mujoco.scene_from_mujoco(MODEL)
    cup = make_cup("DepthObservation")
    cup.reset(seed=0)
    look = {
        "camera": "front",
        "width": 8,
        "height": 6,
        "outputs": ["depth", "rgbd"],
        "channels": "first",
        "depth_range": (0.5, 3.0),
        "objects": ["cup"],
        "segmentation": "body",
        "fill": "far",
        "sensor": wv.sensors.StereoDepth(0.05, sigma=0.1),
        "shadows": True,
        "reflections": True,
        "ambient_occlusion": AmbientOcclusion(0.5),
        "samples": 1,
        "scene_option": mujoco.MjvOption(),
        "device": "cpu",
    }
    watch = {"bodies": ["cup"], "camera": "front", "width": 8, "height": 6, "subtree": True}
    watch |= {"movable": "bodies", "scene_option": mujoco.MjvOption(), "device": "cpu"}
    reward = {"weight": 0.5, "mode": "constraint", "target": (0.5, 1.0), "shaped": True, "discount": 0.9}
    reward["replace"] = True
    model = {
        "mesh_tolerance": 5e-4,
        "labels": {"ball": "object"},
        "label_names": {9: "shelf"},
        "exclude": ("floor",),
        "device": "cpu",
    }
    sensor = wv.sensors.StereoDepth(0.05, sigma=0.1)
    return {
        # warpvis.batch
        "FrameRenderer": (
            wv.batch.FrameRenderer,
            {
                "scene": seen,
                "camera": CAMERA,
                "outputs": ["depth", "visibility"],
                "objects": ["box"],
                "exclude": ["floor"],
                "delta": 0.1,
                "device": "cpu",
                "threads": 1,
                "caster": "auto",
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
            },
        ),
        "FrameRenderer, sensor": (
            wv.batch.FrameRenderer,
            {"scene": seen, "camera": CAMERA, "outputs": ["reasons"], "sensor": sensor, "seed": 1},
        ),
        "FrameRenderer of frames": (
            lambda **batch: wv.batch.FrameRenderer(seen, CAMERA, sensor=sensor)(batch),
            {"camera_to_world": [POSE], "frame": [3]},
        ),
        "FrameRenderer.__call__": (wv.batch.FrameRenderer(seen, CAMERA), {"batch": {"camera_to_world": [POSE]}}),
        "FrameRenderer of poses": (
            lambda **batch: wv.batch.FrameRenderer(seen, CAMERA)(batch),
            {"camera_to_world": [POSE], "object_poses": [MOVED], "world_index": [0]},
        ),
        "verify": (wv.batch.verify, {"out": folder / "set", "repair": False}),
        "open_dataset": (wv.open_dataset, {"path": folder / "set", "outputs": ["depth"]}),
        "FrameDataset.read": (wv.open_dataset(folder / "set").read, {"name": "depth", "frames": [0]}),
        "FrameDataset.read of one": (wv.open_dataset(folder / "set").read, {"name": "depth", "frames": 0}),
        "warmup": (wv.batch.warmup, {"device": "cpu", "outputs": ["depth"], "casters": ["rays"]}),
        # warpvis.io
        "from_image_msg": (wv.io.from_image_msg, {"message": wv.io.to_image_msg(DEPTH, **MESSAGE)}),
        "to_image_msg": (wv.io.to_image_msg, {"depth": DEPTH, "encoding": "16UC1", **MESSAGE}),
        "from_color_msg": (wv.io.from_color_msg, {"message": wv.io.to_color_msg(COLOR, **MESSAGE)}),
        "to_color_msg": (wv.io.to_color_msg, {"color": COLOR, "encoding": "bgr8", **MESSAGE}),
        "to_compressed_msg": (
            wv.io.to_compressed_msg,
            {"color": COLOR, "compression": "jpeg", "quality": 90, **MESSAGE},
        ),
        "to_pointcloud2": (wv.io.to_pointcloud2, {"points": DEPTH, "camera": CAMERA, "colors": COLOR, **MESSAGE}),
        "to_occupancy_grid": (wv.io.to_occupancy_grid, {"grid": grid, "height": 0.0, **MESSAGE}),
        "load_bop_scene": (
            wv.io.load_bop_scene,
            {"path": folder / "bop/test/000002", "image": 3, "frame": "camera", "models": folder / "bop/models"}
            | {"device": "cpu", "movable": True},
        ),
        "load_camera": (wv.io.load_camera, {"name_or_path": "kinect", "distortion": True}),
        "read_points": (wv.io.read_points, {"path": folder / "points.txt"}),
        "read_poses": (wv.io.read_poses, {"path": folder / "walk.txt"}),
        "read_scene_cameras": (
            wv.io.read_scene_cameras,
            {"path": folder / "stage.usda", "width": 8, "height": 6, "up": "y", "search_path": folder},
        ),
        "read_sensors": (wv.io.read_sensors, {"path": folder / "robot.sdf", "search_path": folder}),
        "read_tracks": (wv.io.read_tracks, {"path": folder / "walk.txt", "convention": "opencv", "quaternion": "xyzw"}),
        "Track.pose_at": (
            wv.io.read_tracks(folder / "walk.txt")["walk"].pose_at,
            {"time": 0.0, "max_gap": 1.0},
        ),
        "save_depth_png": (wv.io.save_depth_png, {"depth": DEPTH[0], "path": path / "depth.png"}),
        # warpvis.maps
        "Sphere": (wv.maps.Sphere, {"center": (0, 0, 0), "diameter": 1.0, "label": "object"}),
        "Voxel.parse": (wv.maps.Voxel.parse, {"value": "free"}),
        "classify_rendered": (
            wv.maps.classify_rendered,
            {
                "depth": RENDERED.depth,
                "objects": RENDERED.segmentation,
                "scene": seen,
                "max_range": 3.0,
                "threads": 1,
                "out": None,
            },
        ),
        "plan_visibility": (wv.maps.plan_visibility, {"scene": seen, **VIEW, "exclude": ["box"]}),
        # warpvis.mujoco.gymnasium
        "gymnasium.DepthObservation": (wrappers.DepthObservation, {"env": Cup(), **look, "threads": 1}),
        "gymnasium.DepthObservation.observation": (cup.observation, {"observation": {}}),
        "gymnasium.PoseObservation": (wrappers.PoseObservation, {"env": Cup()}),
        "gymnasium.PoseObservation.observation": (make_cup("PoseObservation").observation, {"observation": {}}),
        "gymnasium.RenderFrames": (
            wrappers.RenderFrames,
            {
                "env": Cup(),
                "camera": "front",
                "width": 8,
                "height": 6,
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
                "scene_option": None,
                "threads": 1,
            },
        ),
        "gymnasium.VectorDepthObservation": (
            wrappers.VectorDepthObservation,
            {
                "env": gym.vector.SyncVectorEnv([partial(make_cup, "PoseObservation")]),
                **look,
                "movable": "bodies",
                "threads": 1,
            },
        ),
        "gymnasium.VisibilityReward": (
            wrappers.VisibilityReward,
            {"env": Cup(), **watch, **reward, "threads": 1},
        ),
        "gymnasium.VisibleFractions": (wrappers.VisibleFractions, {"env": Cup(), **watch, "threads": 1}),
        "gymnasium.VectorVisibilityReward": (
            wrappers.VectorVisibilityReward,
            {
                "env": gym.vector.SyncVectorEnv([partial(make_cup, "PoseObservation")]),
                **watch,
                **reward,
                "keep_poses": True,
                "threads": 1,
            },
        ),
        "gymnasium.VectorVisibleFractions": (
            wrappers.VectorVisibleFractions,
            {
                "env": gym.vector.SyncVectorEnv([partial(make_cup, "PoseObservation")]),
                **watch,
                "keep_poses": True,
                "threads": 1,
            },
        ),
        # warpvis.mujoco
        "BatchRenderer": (
            wv.mujoco.BatchRenderer,
            {
                "model": MODEL,
                "nworld": 1,
                "height": 6,
                "width": 8,
                "outputs": ["depth"],
                "geom_groups": (0,),
                "site_groups": (0,),
                "scene_option": None,
                "movable": "all",
                "resizable": ["ball"],
                "cull_backfaces": True,
                "near_plane": "clip",
                "fill": "far",
                "shadows": True,
                "reflections": True,
                "lighting": "vertex",
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
                "sensor": wv.sensors.StereoDepth(0.05, sigma=0.1),
                "seed": 1,
                "threads": 1,
                **model,
            },
        ),
        "BatchRenderer.render": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8).render,
            {"poses": data, "cameras": ["eye"], "worlds": None, "model": {"cam_fovy": [[50]]}, "out": None},
        ),
        "BatchRenderer.visibility": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8).visibility,
            {
                "poses": data,
                "bodies": [1],
                "cameras": ["eye"],
                "subtree": True,
                "shaped": True,
                "canvas": (8, 6, 8, 6),
                "worlds": None,
                "model": {"cam_fovy": [[50]]},
            },
        ),
        "BatchRenderer.render, sensor": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8, sensor=wv.sensors.StereoDepth(0.05, sigma=0.1)).render,
            {"poses": data, "cameras": ["eye"], "frame": [2], "view_index": [7]},
        ),
        "BatchRenderer.element_ids": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8, outputs=["segmentation"]).element_ids,
            {"views": RENDERED, "out": None},
        ),
        "BatchRenderer.body_ids": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8, outputs=["segmentation"]).body_ids,
            {"views": RENDERED, "out": None},
        ),
        "BatchRenderer.semantic_ids": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8, outputs=["segmentation"]).semantic_ids,
            {"views": RENDERED, "classes": {"ball": 1}, "out": None},
        ),
        "BatchRenderer.geom_ids": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8, outputs=["segmentation"]).geom_ids,
            {"views": RENDERED, "out": None},
        ),
        "BatchRenderer.camera": (wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8).camera, {"camera": "eye"}),
        "Kinematics": (wv.mujoco.Kinematics, {"model": MODEL, "threads": 1}),
        "Kinematics.from_qpos": (
            wv.mujoco.Kinematics(MODEL).from_qpos,
            {"qpos": [MODEL.qpos0], "mocap_pos": None, "mocap_quat": None, "model": {"body_pos": MODEL.body_pos[None]}},
        ),
        "Kinematics.from_states": (
            wv.mujoco.Kinematics(MODEL).from_states,
            {"states": [np.r_[MODEL.qpos0, np.zeros(6)]], "spec": int(mujoco.mjtState.mjSTATE_PHYSICS)},
        ),
        "MujocoScene.to": (mujoco_scene.to, {"device": "cpu"}),
        "mujoco.Renderer": (
            wv.mujoco.Renderer,
            {
                "model": MODEL,
                "height": 6,
                "width": 8,
                "max_geom": 9,
                "font_scale": None,
                "cull_backfaces": True,
                "near_plane": "clip",
                "lighting": "pixel",
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
                "fill": "far",
                "sensor": sensor,
                "seed": 1,
                "threads": 1,
                **model,
            },
        ),
        "mujoco.Renderer.update_scene": (
            wv.mujoco.Renderer(MODEL, 6, 8).update_scene,
            {"data": data, "camera": "eye", "scene_option": None},
        ),
        "mujoco.Renderer.render": (rendered_once(data).render, {"out": None}),
        "Rangefinders": (wv.mujoco.Rangefinders, {"model": MODEL, "threads": 1, "device": "cpu"}),
        "Rangefinders.read": (
            wv.mujoco.Rangefinders(MODEL, threads=1).read,
            {"poses": [MODEL.qpos0], "out": None},
        ),
        "WorldPoses.of": (wv.mujoco.WorldPoses.of, {"worlds": [data]}),
        "camera_from_mujoco": (
            wv.mujoco.camera_from_mujoco,
            {"model": MODEL, "camera": "eye", "width": 8, "height": 6},
        ),
        "camera_poses": (wv.mujoco.camera_poses, {"source": data, "model": MODEL, "cameras": [0]}),
        "lights_from_mujoco": (wv.mujoco.lights_from_mujoco, {"model": MODEL, "data": data}),
        "geom_poses": (wv.mujoco.geom_poses, {"source": data, "scene": mujoco_scene}),
        "read_model": (
            wv.mujoco.read_model,
            {"path": folder / "box.xml", "search_path": [folder], "strict": False},
        ),
        "scene_from_mujoco": (
            wv.mujoco.scene_from_mujoco,
            {"model": MODEL, "geom_groups": (0,), "site_groups": (0,), "movable": "bodies", "static": True, **model},
        ),
    }
