# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Whatever a public function is given for a parameter, it takes it or says what is wrong with it: a `WarpvisError`."""

import inspect
import math
import types

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv

BAD = {
    "None": None,
    "a word": "big",
    "no word": "",
    "bytes": b"big",
    "NaN": math.nan,
    "inf": math.inf,
    "-inf": -math.inf,
    "minus one": -1,
    "half": 0.5,
    "zero": 0,
    "True": True,
    "a complex number": 1j,
    "a number beyond floats": 10**400,
    "nothing": [],
    "a list of one": [1],
    "ragged lists": [[1], [2, 3]],
    "words": ["big", "small"],
    "a mapping": {"big": None},
    "a set": {1, 2},
    "an object": object(),
    "a function": len,
    "a type": int,
    "an array": np.full((2, 3), np.nan),
    "an empty array": np.zeros((0, 7)),
    "an array of objects": np.array([None, {}]),
    "an array of words": np.array(["a", "b"]),
    "a Warp array": wp.zeros(3, dtype=wp.vec3, device="cpu"),
}

POSE = wv.look_at((0, 0, 0), (1, 0, 0))
CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0)
DEPTH = np.ones((1, 6, 8), dtype=np.float32)
WORLD = """#VRML_SIM R2023b utf8
RangeFinder { translation -2 0 0 width 8 height 6 }
Robot { name "robot" children [
  Camera { name "camera" width 8 height 6 recognition Recognition { segmentation TRUE } } ] }
Solid { name "box" recognitionColors [ 1 0 0 ] children [ Shape { geometry Box { } } ] }
"""
MODEL = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><camera name="eye" pos="0 0 3"/><geom name="floor" type="plane" size="1 1 1"/>'
    '<body><freejoint/><geom name="ball" size="0.1"/></body></worldbody></mujoco>'
)


class RangeFinder:
    """A device of a live simulation."""

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


MOVED = [[2, 0.5, 0, 0, 0, 0, 1]]
SEEN = wv.perspective(scene(), agents())
SPACE = {"bounds": [[0, -1, -1], [2, 1, 1]], "up": "z", "threads": 1}
VIEW = {"camera": CAMERA, "camera_to_world": POSE, "convention": "opencv"}
WORLDS = {"object_poses": MOVED, "world_index": [0], "exclude": ["floor"]}
RENDERED = wv.render(scene(), CAMERA, POSE, outputs=("depth", "points", "normals", "labels", "segmentation"))
MESH = ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


# What calls give back, made by hand for its own sake: nobody's input; and lists of constants.
RESULTS = {
    "BatchSummary",
    "BatchRenderer",
    "BatchViews",
    "BestViews",
    "Candidate",
    "Coverage",
    "Device",
    "Device.at_origin_of",
    "Experiment",
    "FloorMap",
    "Frames",
    "MujocoScene",
    "Node",
    "ObjectVisibility",
    "Perspective",
    "PlanVisibility",
    "Proposal",
    "Recognised",
    "Samples",
    "SceneObject",
    "ScenePreset",
    "Version",
    "Views",
    "VoxelMap",
    "WebotsWorld",
    "WorldPoses",
}

# Drawing takes its time: some of the bad values will do.
DRAWN = {"save_depth", "save_map", "save_overview", "save_perspective", "save_sightings", "view_from_outside"}
FEW = ("None", "a word", "NaN", "minus one", "an object", "an array")


def cases(folder):
    """Valid arguments of all that is public and can be called, by name: ``name: (function, arguments)``."""
    world = wv.webots.load_webots(folder / "lab.wbt")
    data = mujoco.MjData(MODEL)
    mujoco.mj_forward(MODEL, data)
    planned, generated, seen = wv.planning, wv.pose_generators, scene()
    path = folder / "out"
    found = SEEN.candidates("human", "robot", labels=None)
    room = {"radius": 0.1, "floor": -1.0, "step": 0.1}
    one = {"object_poses": MOVED, "exclude": ["floor"], "threads": 1}
    floor_map = wv.floor_map(RENDERED.points, RENDERED.labels, bounds=[[-1, -1], [1, 1]])
    voxels = wv.voxel_map(DEPTH, CAMERA, POSE, bounds=SPACE["bounds"])
    mujoco_scene = wv.mujoco.scene_from_mujoco(MODEL)
    model = {"tolerance": 5e-4, "labels": {"ball": "object"}, "exclude": ("floor",), "device": "cpu"}
    best = planned.best_views(seen, CAMERA, POSE, objects=["box"])
    covered = planned.coverage(seen, CAMERA, POSE)
    eye = wv.webots.DepthEye(RangeFinder())
    found_cases = {
        # The top of the package.
        "Agent": (wv.Agent, {"name": "a", "camera": CAMERA, "pose": POSE, "body": (), "attention": None}),
        "Agent.kinect": (wv.Agent.kinect, {"name": "a", "pose": POSE, "body": "box", "convention": "opencv"}),
        "Agent.human": (wv.Agent.human, {"name": "a", "pose": POSE, "near": 0.1, "far": 9.0, "resolution": 10.0}),
        "Camera": (wv.Camera, dict(zip(("width", "height", "fx", "fy", "cx", "cy"), (8, 6, 9, 9, 4, 3), strict=True))),
        "Camera.range": (lambda near, far: wv.Camera(8, 6, 9, 9, 4, 3, near, far), {"near": 0.1, "far": 4.0}),
        "Camera.from_fov": (wv.Camera.from_fov, {"width": 8, "height": 6, "hfov": 1.0, "near": 0.1, "far": 9.0}),
        "Camera.from_fov, vertical": (wv.Camera.from_fov, {"width": 8, "height": 6, "vfov": 1.0}),
        "Camera.from_fov, linear": (wv.Camera.from_fov, {"width": 8, "height": 6, "hfov": 1.0, "vertical": "linear"}),
        "Camera.from_K": (wv.Camera.from_K, {"K": CAMERA.to_K(), "width": 8, "height": 6, "pixel_center": 0.5}),
        "Camera.from_mujoco": (wv.Camera.from_mujoco, {"model": MODEL, "camera": "eye", "width": 8, "height": 6}),
        "Camera.kinect": (wv.Camera.kinect, {"vertical": "square"}),
        "Camera.to_K": (CAMERA.to_K, {"pixel_center": 0.5}),
        "Camera.project": (CAMERA.project, {"points": [[0, 0, 1]]}),
        "Camera.back_project": (CAMERA.back_project, {"pixels": [[1, 1]], "depth": [1.0]}),
        "FieldOfView": (wv.FieldOfView, {"hfov": 1.0, "up": 0.5, "down": 0.5, "near": 0.1, "far": 9, "resolution": 9}),
        "FloorMap.area": (floor_map.area, {"label": "ground"}),
        "FloorMap.save": (floor_map.save, {"path": path / "map.png", "view": 0}),
        "Frames.from_poses": (
            wv.Frames.from_poses,
            {"poses": [POSE], "timestamps": [0], "object_poses": [MOVED], "world_index": [0], "source": {}},
        ),
        "Label.parse": (wv.Label.parse, {"value": "ground"}),
        "Perspective.states": (SEEN.states, {"first": "robot", "second": "human"}),
        "Perspective.candidates": (SEEN.candidates, {"human": "human", "robot": "robot", "view": 0, "labels": None}),
        "Perspective.to_see": (SEEN.to_see, {"robot": "robot", "human": "human", "view": 0, "labels": ["object"]}),
        "Perspective.objects_at": (SEEN.objects_at, {"view": 0}),
        "Perspective.report": (SEEN.report, {"view": 0}),
        "Perspective.table": (SEEN.table, {"view": 0}),
        "Renderer": (
            wv.Renderer,
            {
                "scene": seen,
                "camera": CAMERA,
                "outputs": ("depth",),
                "caster": "rays",
                "fill": 0.0,
                "threads": 1,
                "device_bytes": 9,
            },
        ),
        "Renderer.render": (
            wv.Renderer(seen, CAMERA).render,
            {"camera_to_world": POSE, "convention": "opencv", "out": None, **WORLDS},
        ),
        "Renderer.render_at": (
            wv.Renderer(seen, CAMERA).render_at,
            {"camera_to_world": POSE, "pixels": [[[1, 1]]], "convention": "opencv", "out": None, **WORLDS},
        ),
        "Scene": (wv.Scene, {"device": "cpu", "up": "z"}),
        "Scene.load": (
            wv.Scene.load,
            {
                "path": folder / "box.ply",
                "device": "cpu",
                "up": "z",
                "file_up": "y",
                "scale": 2.0,
                "labels": {"box": 2},
                "search_path": [],
                "strict": False,
                "movable": None,
            },
        ),
        "Scene.add": (
            lambda **given: scene().add(**given),
            {"mesh": MESH, "name": "new", "label": "human", "pose": POSE, "scale": 2.0, "movable": False},
        ),
        "Scene.add, attached": (lambda **given: scene().add(MESH, **given), {"attach_to": "cart"}),
        "Scene.update_vertices": (
            lambda **given: scene().update_vertices(**given),
            {"name": "cart", "vertices": np.zeros((8, 3))},
        ),
        "Scene.index": (seen.index, {"name": "box"}),
        "Scene.to": (seen.to, {"device": "cpu"}),
        "Scene.export": (seen.export, {"path": path / "scene.glb"}),
        "VoxelMap.volume": (voxels.volume, {"state": "free"}),
        "VoxelMap.floor_map": (voxels.floor_map, {"robots": [(0, 0, 0.1)]}),
        "VoxelMap.merge": (voxels.merge, {"other": voxels}),
        "VoxelMap.save": (voxels.save, {"path": path / "voxels.npz"}),
        "back_project": (wv.back_project, {"depth": DEPTH, **VIEW, "device": "cpu", "threads": 1, "out": None}),
        "classify": (
            wv.classify,
            {
                "depth": DEPTH,
                **VIEW,
                "spheres": [wv.maps.Sphere((1, 0, 0), 0.1)],
                "ground_tolerance": 0.01,
                "ground_height": -1.0,
                "up": "z",
                "max_range": 3.0,
                "device": "cpu",
                "threads": 1,
                "out": None,
                "spheres_out": None,
            },
        ),
        "floor_map": (
            wv.floor_map,
            {
                "points": RENDERED.points,
                "labels": RENDERED.labels,
                "bounds": [[-1, -1], [1, 1]],
                "cell_size": 0.1,
                "up": "z",
                "level_tolerance": 0.01,
                "robots": [(0, 0, 0.1)],
                "threads": 1,
            },
        ),
        "look_at": (wv.look_at, {"eye": (0, 0, 0), "target": (1, 0, 0), "up": "z"}),
        "object_visibility": (
            wv.object_visibility,
            {
                "scene": seen,
                **VIEW,
                **WORLDS,
                "objects": ["box"],
                "delta": 0.01,
                "canvas": (1, 1, 1, 1),
                "min_pixels": 1,
                "skip_unseen": False,
                "masks": False,
                "caster": "auto",
                "threads": 1,
            },
        ),
        "perspective": (
            wv.perspective,
            {
                "scene": seen,
                "agents": agents(),
                "objects": ["box"],
                "min_pixels": 1,
                "min_fraction": 0.1,
                "delta": 0.01,
                "object_poses": MOVED,
                "world_index": [0],
                "threads": 1,
            },
        ),
        "point_visibility": (
            wv.point_visibility,
            {"scene": seen, **VIEW, **WORLDS, "points": [[1, 0, 0]], "tolerance": 0.1, "caster": "auto", "threads": 1},
        ),
        "point_visibility_from_depth": (
            wv.point_visibility_from_depth,
            {"depth": DEPTH, **VIEW, "points": [[1, 0, 0]], "tolerance": 0.1, "device": "cpu", "threads": 1},
        ),
        "read_frames": (
            wv.read_frames,
            {"path": folder / "walk.txt", "convention": "opencv", "file_format": "tum", "topic": None},
        ),
        "render": (
            wv.render,
            {
                "scene": seen,
                **VIEW,
                **WORLDS,
                "outputs": "depth",
                "caster": "auto",
                "cull_backfaces": False,
                "fill": "inf",
                "threads": 1,
                "device_bytes": 1,
                "out": None,
            },
        ),
        "render_batch": (
            lambda **given: wv.render_batch(**{"threads": 1, "resume": False, **given}),
            {
                "scene": seen,
                "camera": CAMERA,
                "frames": wv.Frames.from_poses([POSE]),
                "out": path / "batch",
                "format": "npz",
                "outputs": ["depth"],
                "objects": None,
                "exclude": None,
                "shard_frames": 1,
                "options": {},
                "device": "cpu",
                "threads": 1,
                "caster": "auto",
                "engine": "local",
                "workers": None,
                "address": None,
                "source": "x",
            },
        ),
        "voxel_map": (
            wv.voxel_map,
            {"depth": DEPTH, **VIEW, **SPACE, "cell_size": 0.5, "labels": None, "device": "cpu", "out": None},
        ),
        "voxel_map_from_scene": (
            wv.voxel_map_from_scene,
            {"scene": seen, **VIEW, **WORLDS, "bounds": SPACE["bounds"], "cell_size": 0.5, "threads": 1, "out": None},
        ),
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
            },
        ),
        "FrameRenderer.__call__": (wv.batch.FrameRenderer(seen, CAMERA), {"batch": {"camera_to_world": [POSE]}}),
        "FrameRenderer of poses": (
            lambda **batch: wv.batch.FrameRenderer(seen, CAMERA)(batch),
            {"camera_to_world": [POSE], "object_poses": [MOVED], "world_index": [0]},
        ),
        "verify": (wv.batch.verify, {"out": folder / "set"}),
        "warmup": (wv.batch.warmup, {"device": "cpu", "outputs": ["depth"], "casters": ["rays"]}),
        # warpvis.io
        "load_camera": (wv.io.load_camera, {"name_or_path": "kinect"}),
        "read_points": (wv.io.read_points, {"path": folder / "points.txt"}),
        "read_poses": (wv.io.read_poses, {"path": folder / "walk.txt"}),
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
                "scene_option": None,
                "movable": "all",
                "cull_backfaces": True,
                "near_plane": "clip",
                "fill": "far",
                "threads": 1,
                **model,
            },
        ),
        "BatchRenderer.render": (
            wv.mujoco.BatchRenderer(MODEL, 1, height=6, width=8).render,
            {"poses": data, "cameras": ["eye"], "worlds": None, "model": {"cam_fovy": [[50]]}, "out": None},
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
                "fallback": False,
                "threads": 1,
                **model,
            },
        ),
        "mujoco.Renderer.update_scene": (
            wv.mujoco.Renderer(MODEL, 6, 8).update_scene,
            {"data": data, "camera": "eye", "scene_option": None},
        ),
        "mujoco.Renderer.render": (rendered_once(data).render, {"out": None}),
        "WorldPoses.of": (wv.mujoco.WorldPoses.of, {"worlds": [data]}),
        "camera_from_mujoco": (
            wv.mujoco.camera_from_mujoco,
            {"model": MODEL, "camera": "eye", "width": 8, "height": 6},
        ),
        "camera_poses": (wv.mujoco.camera_poses, {"source": data, "model": MODEL, "cameras": [0]}),
        "geom_poses": (wv.mujoco.geom_poses, {"source": data, "scene": mujoco_scene}),
        "read_model": (
            wv.mujoco.read_model,
            {"path": folder / "box.xml", "search_path": [folder], "strict": False},
        ),
        "scene_from_mujoco": (
            wv.mujoco.scene_from_mujoco,
            {"model": MODEL, "geom_groups": (0,), "movable": "bodies", "static": True, **model},
        ),
        # warpvis.planning
        "BestViews.pose": (best.pose, {"rank": 0}),
        "Coverage.best": (covered.best, {"k": 1}),
        "best_views": (
            planned.best_views,
            {
                "scene": seen,
                "camera": CAMERA,
                "candidates": [POSE],
                "objects": ["box"],
                "weights": [1.0],
                "measure": "fraction",
                "count": 1,
                "start": (0, 0, 0),
                "path_lengths": None,
                "tie": 0.1,
                "radius": 0.1,
                "floor": -2.0,
                "delta": 0.1,
                "convention": "opencv",
                **one,
            },
        ),
        "clearance": (
            planned.clearance,
            {"scene": seen, "points": [[0, 0, 0]], "max_distance": 9.0, "objects": ["box"], **one},
        ),
        "coverage": (
            planned.coverage,
            {"scene": seen, **VIEW, "samples": None, "weights": None, "k": 1, "tolerance": 0.1, **one},
        ),
        "minimum_height": (
            planned.minimum_height,
            {
                "scene": seen,
                "eyes": [[0, 0, 0]],
                "targets": [[3, 0, 0]],
                "raises": "eye",
                "max_height": 9.0,
                "tolerance": 0.1,
                **one,
            },
        ),
        "pose_grid": (
            planned.pose_grid,
            {"center": (0, 0, 0), "radius": 1.0, "step": 1.0, "height": 1.0, "look_at": (0, 0, 0), "up": "z"},
        ),
        "pose_grid of headings": (
            planned.pose_grid,
            {"center": (0, 0, 0), "radius": 1.0, "step": 1.0, "height": 1.0, "headings": 2, "pitch": 0.1},
        ),
        "propose_view": (
            planned.propose_view,
            {
                "scene": seen,
                "robot": agents()[0],
                "candidates": found,
                "max_distance": 1.0,
                "object_poses": MOVED,
                **room,
            },
        ),
        "standing_room": (planned.standing_room, {"scene": seen, "camera_to_world": POSE, **room, **one}),
        "surface_samples": (
            planned.surface_samples,
            {
                "scene": seen,
                "spacing": 0.5,
                "objects": ["box"],
                "object_poses": MOVED,
                "seed": 0,
            },
        ),
        "surface_samples of labels": (planned.surface_samples, {"scene": seen, "spacing": 0.5, "labels": ["object"]}),
        # warpvis.pose_generators
        "along": (generated.along, {"path": [[0, 0, 0], [1, 0, 0]], "count": 2, "look": "forward", "up": "z"}),
        "frames_from_spec": (
            generated.frames_from_spec,
            {"text": "orbit target=0,0,0 radius=1 height=1 count=2", "scene": seen, "up": "z"},
        ),
        "grid": (
            generated.grid,
            {
                "bounds": [[0, 0, 0], [1, 1, 1]],
                "step": 1.0,
                "headings": 2,
                "pitch": 0.1,
                "look_at": (9, 9, 9),
                "up": "z",
            },
        ),
        "looks_like_spec": (generated.looks_like_spec, {"text": "orbit:"}),
        "orbit": (
            generated.orbit,
            {"target": (0, 0, 0), "radius": 1.0, "height": 1.0, "count": 2, "up": "z", "start": 0.0},
        ),
        "random_poses": (
            generated.random_poses,
            {
                "scene_or_bounds": seen,
                "count": 2,
                "seed": 0,
                "bounds": [[-1, -1, 0], [1, 1, 1]],
                "clearance": 0.01,
                "look": "level",
                "up": None,
                "exclude": ["box"],
                "threads": 1,
            },
        ),
        "sphere": (
            generated.sphere,
            {
                "target": (0, 0, 0),
                "radius": 1.0,
                "count": 2,
                "up": "z",
                "min_elevation": -1.0,
                "max_elevation": 1.0,
            },
        ),
        # warpvis.rendering
        "render_wide": (
            wv.rendering.render_wide,
            {
                "scene": seen,
                "width": 8,
                "height": 6,
                "hfov": 3.0,
                "camera_to_world": POSE,
                "projection": "spherical",
                "near": 0.1,
                "far": 9.0,
                "outputs": ["depth"],
                "cull_backfaces": False,
                "convention": "opencv",
                "threads": 1,
                **WORLDS,
            },
        ),
        # warpvis.viz
        "save_depth": (
            wv.viz.save_depth,
            {"depth": DEPTH[0], "path": path / "a.png", "title": "a", "depth_range": (0, 1)},
        ),
        "save_map": (
            wv.viz.save_map,
            {
                "cells": floor_map.cells.numpy()[0],
                "path": path / "b.png",
                "bounds": floor_map.bounds,
                "legend": floor_map.legend,
                "axes": ("x", "y"),
                "title": "b",
            },
        ),
        "save_overview": (
            wv.viz.save_overview,
            {
                "scene": seen,
                "camera": CAMERA,
                "camera_to_world": POSE,
                "views": RENDERED,
                "floor_map": floor_map,
                "path": path / "c.png",
                "title": "c",
                "eye": (-3, -3, 3),
                "target": (0, 0, 0),
            },
        ),
        "save_perspective": (
            wv.viz.save_perspective,
            {
                "scene": seen,
                "agents": agents(),
                "seen": SEEN,
                "path": path / "d.png",
                "view": 0,
                "title": "d",
                "labels": None,
                "eye": (-3, -3, 3),
                "target": (0, 0, 0),
                "proposed": POSE,
                "object_poses": MOVED,
            },
        ),
        "save_sightings": (
            wv.viz.save_sightings,
            {
                "scene": seen,
                **VIEW,
                "path": path / "e.png",
                "objects": ["box"],
                "title": "e",
                "object_poses": MOVED,
                "exclude": None,
            },
        ),
        "view_from_outside": (
            wv.viz.view_from_outside,
            {
                "scene": seen,
                "outside": CAMERA,
                "outside_to_world": POSE,
                "camera": CAMERA,
                "camera_to_world": POSE,
                "depth": RENDERED.depth.numpy()[0],
                "segmentation": RENDERED.segmentation.numpy()[0],
            },
        ),
        # warpvis.webots
        "DepthEye": (
            wv.webots.DepthEye,
            {
                "range_finder": RangeFinder(),
                "node": None,
                "translation": (0, 0, 0),
                "rotation": (0, 0, 1, 0),
                "version": "R2023b",
                "near": 0.01,
            },
        ),
        "DepthEye.pose": (eye.pose, {"node_pose": POSE}),
        "DepthEye.points": (eye.points, {"node_pose": POSE}),
        "DepthEye.classify": (eye.classify, {"node_pose": POSE, "up": "z"}),
        "DepthEye.floor_map": (
            eye.floor_map,
            {"node_pose": POSE, "bounds": [[0, 0], [1, 1]], "cell_size": 0.1, "up": "z"},
        ),
        "Lens": (wv.webots.Lens, {"center": (0.5, 0.5), "radial": (0, 0), "tangential": (0, 0)}),
        "Version.parse": (wv.webots.Version.parse, {"text": "R2023b"}),
        "add_noise": (
            wv.webots.add_noise,
            {"values": DEPTH[0], "noise": 0.1, "max_range": 3.0, "version": world.version, "seed": 0},
        ),
        "distort_pixels": (
            wv.webots.distort_pixels,
            {"width": 8, "height": 6, "center": (0.5, 0.5), "radial": (0, 0), "tangential": (0, 0)},
        ),
        "find_device": (wv.webots.find_device, {"world": world, "name": "range-finder"}),
        "load_webots": (
            wv.webots.load_webots,
            {
                "path": folder / "lab.wbt",
                "device": "cpu",
                "labels": {"box": "human"},
                "search_path": [folder],
                "strict": False,
            },
        ),
        "quantise": (wv.webots.quantise, {"values": DEPTH[0], "resolution": 0.1}),
        "range_values": (
            wv.webots.range_values,
            {
                "depth": DEPTH,
                "near": 0.1,
                "min_range": 0.1,
                "max_range": 3.0,
                "version": world.version,
                "projection": "planar",
                "near_bias": False,
            },
        ),
        "recognise": (wv.webots.recognise, {"world": world, "camera_name": "camera", "threads": 1}),
        "render_range": (
            wv.webots.render_range,
            {
                "world": world,
                "device_name": "range-finder",
                "webots_version": "header",
                "exclude_body": False,
                "seed": 0,
                "threads": 1,
            },
        ),
        "segmentation_image": (
            wv.webots.segmentation_image,
            {"world": world, "camera_name": "camera", "threads": 1},
        ),
    }
    return found_cases


def rendered_once(data):
    renderer = wv.mujoco.Renderer(MODEL, 6, 8)
    renderer.enable_depth_rendering()
    renderer.update_scene(data, camera="eye")
    return renderer


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    folder = tmp_path_factory.mktemp("files")
    (folder / "out").mkdir()
    (folder / "lab.wbt").write_text(WORLD)
    (folder / "walk.txt").write_text("0 0 0 0 0 0 0 1\n")
    (folder / "box.xml").write_text('<mujoco><worldbody><geom name="ball" size="0.1"/></worldbody></mujoco>')
    (folder / "points.txt").write_text("1 2 3\n")
    trimesh.creation.box().export(folder / "box.ply")
    wv.render_batch(scene(), CAMERA, wv.Frames.from_poses([POSE]), folder / "set", threads=1)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder / "out")  # a path that is but a word must not leave a file in the checkout
        patch.setattr("matplotlib.figure.Figure.savefig", lambda figure, path: None)  # drawn it is; that suffices
        yield cases(folder)


def public_callables():
    """Names of the public functions and classes with parameters, and of their methods: ``Scene.add``."""
    modules = [getattr(wv, name) for name in wv.__all__ if isinstance(getattr(wv, name), types.ModuleType)]
    found = {}
    for module in [wv, *modules]:
        for name in getattr(module, "__all__", ()):
            item = getattr(module, name)
            if inspect.isclass(item) and not issubclass(item, Exception | Warning):
                methods = {key: getattr(item, key) for key in vars(item) if not key.startswith("_")}
                if "EnumType" not in type(item).__name__:
                    found[name] = item
                for key, method in methods.items():
                    if callable(method) and not inspect.isclass(method):
                        found[f"{name}.{key}"] = method
            elif inspect.isfunction(item):
                found[name] = item
    return {
        name: item
        for name, item in found.items()
        if {"self", "cls"} | set(inspect.signature(item).parameters) > {"self", "cls"}
    }


# Our own modules' ways in, of what was checked before.
OURS = {
    "Camera.device_struct",
    "Scene.replace_objects",
    "Renderer.render_parsed",
    "FieldOfView.faces",
    "FrameRenderer.render",
    "Agent.face_poses",
    "Agent.angles_to",
}


def test_all_that_is_public_is_here(table):
    """A new function, class or method needs a line above."""
    names = {name.partition(",")[0].partition(" of ")[0].removeprefix("mujoco.") for name in table}
    missing = {name for name in public_callables() if name not in names} - RESULTS - OURS
    assert not {name for name in missing if name.partition(".")[0] not in {"Node", "ScenePreset", "Experiment"}}


def test_the_arguments_are_well(table):
    """Else the others would not be looked at."""
    for function, arguments in table.values():
        function(**arguments)


NAMES = (
    "Agent Camera Field Floor Frames Label Perspective Renderer Scene Voxel back_ classify floor_ look_ object_ "
    "persp point_ read_frames render voxel Frame verify warmup load_ read_po read_model save_ Sphere plan_ Batch "
    "Kinematics Mujoco mujoco World camera_ geom_ scene_ Best Coverage best_ clearance coverage minimum pose_ "
    "propose standing surface along frames_ grid looks orbit random sphere view_ Depth Lens Version add_ distort "
    "find_ quanti range_ recog segm "
).split()


@pytest.mark.parametrize("begin", NAMES)
@pytest.mark.filterwarnings("ignore")
def test_what_is_wrong_is_said(table, begin):
    """Names that begin so: every parameter is given every bad value, and either takes it or says a sentence."""
    chosen = [name for name in table if name.startswith(begin)]
    assert chosen
    failures = []
    for name in chosen:
        function, arguments = table[name]
        for parameter in arguments:
            for what in FEW if name in DRAWN else BAD:
                try:
                    function(**{**arguments, parameter: BAD[what]})
                except wv.WarpvisError as error:
                    if not str(error):
                        failures.append(f"{name}({parameter}={what}) says nothing")
                except Exception as error:
                    failures.append(f"{name}({parameter}={what}): {type(error).__name__}: {error}")
    assert not failures, "\n".join(failures)


def test_every_name_is_tried(table):
    assert not [name for name in table if not name.startswith(tuple(NAMES))]
