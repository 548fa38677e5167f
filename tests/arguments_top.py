# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of top-level functions except cameras and maps: ``name: (function, arguments)``."""

import dataclasses

import numpy as np
from arguments_shared import CAMERA, DEPTH, LOOKS, MESH, MOVED, POSE, SCALES, SEEN, VIEW, WORLDS, agents, scene

import warpvis as wv
from warpvis.scene.lights import AmbientOcclusion


def top_cases(folder):
    """Return the cases; write their files to `folder`."""
    seen = scene()
    path = folder / "out"
    occupancy = wv.OccupancyMap(0.1, bounds=[(-2, -2, -1), (2, 2, 1)])
    occupancy.integrate(DEPTH, CAMERA, POSE)
    return {
        "Agent": (
            wv.Agent,
            {"name": "a", "camera": CAMERA, "pose": POSE, "body": "box", "attention": None, "head": ()},
        ),
        "Agent.kinect": (
            wv.Agent.kinect,
            {"name": "a", "pose": POSE, "body": "box", "head": "box", "convention": "opencv"},
        ),
        "Agent.human": (wv.Agent.human, {"name": "a", "pose": POSE, "near": 0.1, "far": 9.0, "resolution": 10.0}),
        "FieldOfView": (wv.FieldOfView, {"hfov": 1.0, "up": 0.5, "down": 0.5, "near": 0.1, "far": 9, "resolution": 9}),
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
        "Scene.read_parts": (
            wv.Scene.read_parts,
            {"path": folder / "box.ply", "search_path": (), "strict": False},
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
    }
