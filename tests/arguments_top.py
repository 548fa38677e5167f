# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of the functions of the top-level package: ``name: (function, arguments)``."""

import dataclasses
import types

import numpy as np
from arguments_shared import (
    CAMERA,
    DEPTH,
    LOOKS,
    MESH,
    MESSAGE,
    MOVED,
    POSE,
    RENDERED,
    SCALES,
    SEEN,
    SPACE,
    VIEW,
    WORLDS,
    agents,
    scene,
)

import warpvis as wv
from warpvis.scene.lights import AmbientOcclusion

RAW_INFO = types.SimpleNamespace(
    width=8, height=6, k=[9, 0, 4, 0, 9, 3, 0, 0, 1], d=[0.01, 0, 0, 0, 0], distortion_model="plumb_bob"
)
NEAR_CAMERA = wv.Camera.from_fov(8, 6, hfov=1.0, near=0.1, far=3.0)
POSE_ABOVE = wv.look_at((0, 0, 1), (1, 0, 0.5))
FLOOR_POINTS = np.stack([*np.meshgrid(np.arange(0.5, 2.5, 0.02), np.arange(-1, 1, 0.02)), np.zeros((100, 100))], -1)
FLOOR = wv.fit_floor(FLOOR_POINTS, camera_to_world=POSE_ABOVE, up=(0, 0, 1))
COMPARED = wv.compare_depth(scene(), CAMERA, POSE, DEPTH, sigma=0.01)


def top_cases(folder):
    """Return the cases; write their files to `folder`."""
    seen = scene()
    path = folder / "out"
    floor_map = wv.floor_map(RENDERED.points, RENDERED.labels, bounds=[[-1, -1], [1, 1]])
    voxels = wv.voxel_map(DEPTH, CAMERA, POSE, bounds=SPACE["bounds"])
    occupancy = wv.OccupancyMap(0.1, bounds=[(-2, -2, -1), (2, 2, 1)])
    occupancy.integrate(DEPTH, CAMERA, POSE)
    occupancy.save(folder / "occupancy.npz")
    return {
        # Top-level package.
        "Agent": (
            wv.Agent,
            {"name": "a", "camera": CAMERA, "pose": POSE, "body": "box", "attention": None, "head": ()},
        ),
        "Agent.kinect": (
            wv.Agent.kinect,
            {"name": "a", "pose": POSE, "body": "box", "head": "box", "convention": "opencv"},
        ),
        "Agent.human": (wv.Agent.human, {"name": "a", "pose": POSE, "near": 0.1, "far": 9.0, "resolution": 10.0}),
        "Camera": (wv.Camera, dict(zip(("width", "height", "fx", "fy", "cx", "cy"), (8, 6, 9, 9, 4, 3), strict=True))),
        "Camera.range": (lambda near, far: wv.Camera(8, 6, 9, 9, 4, 3, near, far), {"near": 0.1, "far": 4.0}),
        "Camera.from_fov": (wv.Camera.from_fov, {"width": 8, "height": 6, "hfov": 1.0, "near": 0.1, "far": 9.0}),
        "Camera.from_fov, vertical": (wv.Camera.from_fov, {"width": 8, "height": 6, "vfov": 1.0}),
        "Camera.from_fov, linear": (wv.Camera.from_fov, {"width": 8, "height": 6, "hfov": 1.0, "vertical": "linear"}),
        "Camera.from_K": (wv.Camera.from_K, {"K": CAMERA.to_K(), "width": 8, "height": 6, "pixel_center": 0.5}),
        "Camera.from_opencv": (
            wv.Camera.from_opencv,
            {"K": CAMERA.to_K(), "D": [0.01, 0, 0, 0], "width": 8, "height": 6, "model": "fisheye", "kind": "range"},
        ),
        "Camera.from_opencv, range": (
            lambda near, far: wv.Camera.from_opencv(CAMERA.to_K(), None, 8, 6, near=near, far=far),
            {"near": 0.1, "far": 4.0},
        ),
        "Camera.from_raw_camera_info": (
            wv.Camera.from_raw_camera_info,
            {"message": RAW_INFO, "near": 0.1, "far": 4.0, "kind": "z"},
        ),
        "Camera.from_lens": (
            wv.Camera.from_lens,
            {"lens": CAMERA.lens, "width": 8, "height": 6, "near": 0.1, "far": 4.0, "kind": "range"},
        ),
        "Camera.from_colmap": (
            wv.Camera.from_colmap,
            {"model": "SIMPLE_RADIAL", "params": (9, 4, 3, 0.01), "width": 8, "height": 6, "kind": "z"},
        ),
        "Camera.from_kalibr": (
            wv.Camera.from_kalibr,
            {"camera": {"intrinsics": [9, 9, 4, 3], "resolution": [8, 6]}, "near": 0.1, "far": 4.0, "kind": "z"},
        ),
        "Camera.from_nerfstudio": (
            wv.Camera.from_nerfstudio,
            {"fields": {"fl_x": 9, "fl_y": 9, "cx": 4, "cy": 3, "w": 8, "h": 6, "k1": 0.01}, "near": 0.1, "far": 4.0},
        ),
        "Camera.unproject": (CAMERA.unproject, {"pixels": [[1, 1]]}),
        "Camera.kinect": (wv.Camera.kinect, {"vertical": "square"}),
        "Camera.from_camera_info": (
            wv.Camera.from_camera_info,
            {"message": CAMERA.to_camera_info(**MESSAGE), "rectified": True, "near": 0.1, "far": 9.0},
        ),
        "Camera.to_camera_info": (CAMERA.to_camera_info, MESSAGE),
        "Camera.to_K": (CAMERA.to_K, {"pixel_center": 0.5}),
        "Camera.depth_rays": (CAMERA.depth_rays, {"pixels": [[1, 1]]}),
        "Camera.rays_at": (CAMERA.rays_at, {"pixels": [[1, 1]]}),
        "Camera.has_pixels_of": (CAMERA.has_pixels_of, {"other": CAMERA}),
        "Camera.project": (CAMERA.project, {"points": [[0, 0, 1]]}),
        "Camera.back_project": (CAMERA.back_project, {"pixels": [[1, 1]], "depth": [1.0]}),
        "FieldOfView": (wv.FieldOfView, {"hfov": 1.0, "up": 0.5, "down": 0.5, "near": 0.1, "far": 9, "resolution": 9}),
        "FloorMap.area": (floor_map.area, {"label": "ground"}),
        "Frames": (
            wv.Frames,
            {
                "camera_to_world": POSE[None],
                "timestamps": np.zeros(1),
                "object_poses": np.array([MOVED]),
                "world_index": np.zeros(1, np.int32),
                "source": {},
            },
        ),
        "Frames.from_poses": (
            wv.Frames.from_poses,
            {
                "poses": [POSE],
                "timestamps": [0],
                "object_poses": [MOVED],
                "world_index": [0],
                "camera": CAMERA,
                "source": {},
            },
        ),
        "Frames.choose_camera": (wv.Frames.from_poses([POSE], camera=CAMERA).choose_camera, {"camera": CAMERA}),
        "Label.parse": (wv.Label.parse, {"value": "ground"}),
        "Perspective.states": (SEEN.states, {"first": "robot", "second": "human"}),
        "ReferenceModel": (wv.visibility.ReferenceModel, dataclasses.asdict(wv.visibility.ReferenceModel())),
        "MeasuredSpace": (
            wv.visibility.MeasuredSpace,
            {"occupancy": occupancy, "eye_clearance": 0.3, "margin": 0.1, "max_unknown": 0.1},
        ),
        "Perspective.candidates": (
            SEEN.candidates,
            {
                "human": "human",
                "robot": "robot",
                "view": 0,
                "labels": None,
                "exclude": ["floor"],
                "gaze": SEEN._parts[1].axis(0)[1],
                "pointing": [0, 0, 0, 1, 0, 0],
                "others": [SEEN.candidates("robot", labels=None)],
                "previous": SEEN.candidates("human", labels=None),
                "elapsed": 0.1,
                "model": wv.visibility.ReferenceModel(),
            },
        ),
        "Perspective.track": (
            SEEN.track,
            {
                "human": "human",
                "robot": "robot",
                "times": [0.0],
                "labels": None,
                "exclude": ["floor"],
                "gaze": [SEEN._parts[1].axis(0)[1]],
                "pointing": [[0, 0, 0, 1, 0, 0]],
                "others": [SEEN.track("robot", times=[0.0], labels=None)],
                "model": wv.visibility.ReferenceModel(),
            },
        ),
        "Perspective.to_see": (
            SEEN.to_see,
            {
                "robot": "robot",
                "human": "human",
                "view": 0,
                "labels": ["object"],
                "gaze": SEEN._parts[1].axis(0)[1],
                "pointing": [0, 0, 0, 1, 0, 0],
                "model": wv.visibility.ReferenceModel(),
            },
        ),
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
                "seed": 1,
                "threads": 1,
                "device_bytes": 9,
            },
        ),
        "Renderer.render": (
            wv.Renderer(seen, CAMERA).render,
            {"camera_to_world": POSE, "convention": "opencv", "out": None, **WORLDS, **SCALES, **LOOKS},
        ),
        "Renderer.render_at": (
            wv.Renderer(seen, CAMERA).render_at,
            {
                "camera_to_world": POSE,
                "pixels": [[[1, 1]]],
                "convention": "opencv",
                "out": None,
                **WORLDS,
                **SCALES,
                **LOOKS,
            },
        ),
        "Scene": (
            wv.Scene,
            {"device": "cpu", "up": "z", "label_names": {9: "shelf"}, "ground_labels": ["ground"]},
        ),
        "Scene.load": (
            wv.Scene.load,
            {
                "path": folder / "box.ply",
                "device": "cpu",
                "up": "z",
                "file_up": "y",
                "scale": 2.0,
                "labels": {"box": 2},
                "label_names": {9: "shelf"},
                "search_path": [],
                "strict": False,
                "show_environment": True,
                "movable": None,
            },
        ),
        "Scene.add": (
            lambda **given: scene().add(**given),
            {"mesh": MESH, "name": "new", "label": "human", "pose": POSE, "scale": 2.0, "movable": False},
        ),
        "Scene.add, with a color": (lambda **given: scene().add(MESH, **given), {"appearance": (1.0, 0.5, 0.0)}),
        "Scene.add, attached": (lambda **given: scene().add(MESH, **given), {"attach_to": "cart"}),
        "Scene.add_instances": (
            lambda **given: scene().add_instances(**given),
            {"mesh": MESH, "poses": [POSE], "names": "new", "label": "human", "scale": 2.0, "movable": False}
            | {"appearance": (1.0, 0.5, 0.0, 0.5)},
        ),
        "Scene.update_vertices": (
            lambda **given: scene().update_vertices(**given),
            {"name": "cart", "vertices": np.zeros((8, 3)), "normals": np.ones((8, 3))},
        ),
        "Scene.set_appearance": (
            lambda **given: scene().set_appearance(**given),
            {"name": "box", "appearance": (1.0, 0.5, 0.0)},
        ),
        "Scene.update_mesh": (
            lambda **given: scene().update_mesh(**given),
            {"name": "cart", "vertices": MESH[0], "faces": MESH[1], "closed": False},
        ),
        "Scene.index": (seen.index, {"name": "box"}),
        "Scene.to": (seen.to, {"device": "cpu"}),
        "Scene.export": (seen.export, {"path": path / "scene.glb"}),
        "OccupancyMap": (
            wv.OccupancyMap,
            {
                "cell_size": 0.1,
                "bounds": [(0, 0, 0), (1, 1, 1)],
                "hit": 0.7,
                "miss": 0.4,
                "minimum": 0.1,
                "maximum": 0.9,
                "up": "z",
                "device": "cpu",
            },
        ),
        "OccupancyMap.integrate": (
            occupancy.integrate,
            {"depth": DEPTH, **VIEW, "sigma": 0.01, "max_range": 2.0, "threads": 1},
        ),
        "OccupancyMap.decay": (occupancy.decay, {"factor": 0.5}),
        "OccupancyMap.states": (occupancy.states, {"points": [(0.0, 0.0, 0.0)], "threads": 1}),
        "OccupancyMap.probabilities": (occupancy.probabilities, {"points": [(0.0, 0.0, 0.0)], "threads": 1}),
        "OccupancyMap.render_depth": (
            occupancy.render_depth,
            {**VIEW, "camera": NEAR_CAMERA, "threads": 1},
        ),
        "OccupancyMap.voxel_map": (
            occupancy.voxel_map,
            {"bounds": [(0, 0, 0), (1, 1, 1)], "ground_height": 0.0, "ground_tolerance": 0.03, "threads": 1},
        ),
        "OccupancyMap.occupancy_grid": (
            occupancy.occupancy_grid,
            {
                "bounds": [(0, 0), (1, 1)],
                "ground_height": 0.0,
                "min_height": 0.1,
                "max_height": 1.0,
                "max_unknown": 0.5,
                "threads": 1,
            },
        ),
        "OccupancyMap.mesh": (occupancy.mesh, {}),
        "OccupancyMap.from_tsdf": (
            wv.OccupancyMap.from_tsdf,
            {
                "distance": np.linspace(-0.1, 0.1, 27).reshape(3, 3, 3),
                "weight": np.ones((3, 3, 3)),
                "cell_size": 0.05,
                "origin": (0.1, 0.0, -0.05),
                "up": "z",
                "device": "cpu",
            },
        ),
        "OccupancyMap.save": (occupancy.save, {"path": path.with_suffix(".bt")}),
        "OccupancyMap.load": (
            wv.OccupancyMap.load,
            {"path": folder / "occupancy.npz", "bounds": [(0, 0, 0), (1, 1, 1)], "device": "cpu"},
        ),
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
                "floor": None,
                "sigma": 0.002,
                "threshold": 2.0,
                "below_label": 9,
                "max_range": 3.0,
                "device": "cpu",
                "threads": 1,
                "out": None,
                "spheres_out": None,
            },
        ),
        "DepthComparison.changes": (
            COMPARED.changes,
            {"objects": ["box"], "min_pixels": 2, "gap": 0.1, "min_displacement": 0.02, "max_displacement": 1.0},
        ),
        "compare_depth with a map": (
            wv.compare_depth,
            {"scene": occupancy, **VIEW, "camera": NEAR_CAMERA, "depth": DEPTH, "sigma": 0.01, "tolerance": 0.1},
        ),
        "compare_depth": (
            wv.compare_depth,
            {
                "scene": seen,
                **VIEW,
                "depth": DEPTH,
                "sigma": 0.01,
                "threshold": 3.0,
                "tolerance": 0.01,
                "edge": 1,
                "complete": True,
                **WORLDS,
                "quaternion": "xyzw",
                "threads": 1,
            },
        ),
        "FloorFit.heights": (FLOOR.heights, {"points": [[0.0, 0.0, 1.0]]}),
        "fit_floor": (
            wv.fit_floor,
            {
                "measured": FLOOR_POINTS,
                "camera_to_world": POSE_ABOVE,
                "up": (0, 0, 1),
                "up_tolerance": 0.3,
                "camera_height": 1.0,
                "height_tolerance": 0.2,
                "noise": 0.003,
                "convention": "opencv",
                "quaternion": "xyzw",
                "seed": 0,
            },
        ),
        "floor_map": (
            wv.floor_map,
            {
                "points": RENDERED.points,
                "labels": RENDERED.labels,
                "bounds": [[-1, -1], [1, 1]],
                "label_names": {9: "shelf"},
                "ground_labels": ["ground"],
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
                "occupancy": occupancy,
                "caster": "auto",
                "threads": 1,
            },
        ),
        "open_recording": (
            wv.open_recording,
            {
                "path": folder / "recording",
                "file_format": "images",
                "camera": CAMERA,
                "unit": 0.001,
                "poses": folder / "walk.txt",
                "topic": None,
                "world_frame": None,
                "episode": None,
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
                "occupancy": occupancy,
                "object_poses": MOVED,
                "world_index": [0],
                "threads": 1,
            },
        ),
        "point_visibility": (
            wv.point_visibility,
            {"scene": seen, **VIEW, **WORLDS, "points": [[1, 0, 0]], "tolerance": 0.1, "caster": "auto", "threads": 1},
        ),
        "point_visibility in a map": (
            wv.point_visibility,
            {"scene": seen, **VIEW, "points": [[1, 0, 0]], "occluders": True, "occupancy": occupancy, "unknown": True},
        ),
        "point_visibility_from_depth": (
            wv.point_visibility_from_depth,
            {"depth": DEPTH, **VIEW, "points": [[1, 0, 0]], "tolerance": 0.1, "device": "cpu", "threads": 1},
        ),
        "read_frames": (
            wv.read_frames,
            {
                "path": folder / "walk.txt",
                "convention": "opencv",
                "file_format": "tum",
                "topic": None,
                "distortion": True,
            },
        ),
        "render": (
            wv.render,
            {
                "scene": seen,
                **VIEW,
                **WORLDS,
                **SCALES,
                **LOOKS,
                "outputs": "depth",
                "caster": "auto",
                "cull_backfaces": False,
                "fill": "inf",
                "shadows": True,
                "reflections": True,
                "lighting": "pixel",
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
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
                "sensor": wv.sensors.StereoDepth(0.05, sigma=0.1),
                "seed": 1,
                "device": "cpu",
                "threads": 1,
                "caster": "auto",
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
                "engine": "local",
                "workers": None,
                "address": None,
                "source": "x",
                "repair": False,
            },
        ),
        "voxel_map": (
            wv.voxel_map,
            {"depth": DEPTH, **VIEW, **SPACE, "cell_size": 0.5, "labels": None, "device": "cpu", "out": None},
        ),
        "voxel_map of classes": (
            wv.voxel_map,
            {"depth": DEPTH, **VIEW, **SPACE, "label_names": {9: "shelf"}, "ground_labels": ["ground"]},
        ),
        "voxel_map_from_scene": (
            wv.voxel_map_from_scene,
            {"scene": seen, **VIEW, **WORLDS, "bounds": SPACE["bounds"], "cell_size": 0.5, "threads": 1, "out": None},
        ),
    }
