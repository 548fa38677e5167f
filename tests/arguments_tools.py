# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of public functions of the packages `planning` to `webots`: ``name: (function, arguments)``."""

import mujoco
from arguments_shared import (
    CAMERA,
    DEPTH,
    MESSAGE,
    MODEL,
    MOVED,
    POSE,
    RENDERED,
    SEEN,
    VIEW,
    WORLDS,
    RangeFinder,
    agents,
    scene,
)

import warpvis as wv
from warpvis.scene.lights import AmbientOcclusion

_ARM = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint name="turn" axis="0 0 1"/><geom size="0.1"/></body></worldbody></mujoco>'
)
LENS = wv.cameras.LensCamera(wv.cameras.lenses.OpenCVPinhole(9, 9, 4, 3, (0.01, 0, 0, 0)), 8, 6)


def tools_cases(folder):
    """Return the cases; write their files to `folder`."""
    world = wv.webots.load_webots(folder / "lab.wbt")
    planned = wv.planning
    generated = wv.pose_generators
    seen = scene()
    path = folder / "out"
    found = SEEN.candidates("human", "robot", labels=None)
    room = {"radius": 0.1, "floor": -1.0, "step": 0.1}
    one = {"object_poses": MOVED, "exclude": ["floor"], "threads": 1}
    floor_map = wv.floor_map(RENDERED.points, RENDERED.labels, bounds=[[-1, -1], [1, 1]])
    best = planned.best_views(seen, CAMERA, POSE, objects=["box"])
    covered = planned.coverage(seen, CAMERA, POSE)
    eye = wv.webots.DepthEye(RangeFinder())
    state = wv.viewer.ViewerState(seen, agents(), points=100)
    arm = wv.viewer.ViewerState(wv.viewer.MujocoStage(_ARM), agents(), points=100)
    played = wv.viewer.ViewerState(seen, agents(), frames=wv.Frames.from_poses([POSE]), points=100)
    page = {"port": 8471, "dark": False}
    watcher = wv.visibility.DepthWatcher(CAMERA, places={"mug": (2.0, 0.0, 1.0, 0.2)}, floor=-1.0, cell_size=0.1)
    watched = watcher.update(DEPTH, POSE, time=0.0)
    return {
        # warpvis.visibility, watching
        "DepthWatcher": (
            wv.visibility.DepthWatcher,
            {
                "camera": CAMERA,
                "places": {"mug": (2.0, 0.0, 1.0, 0.2)},
                "floor": -1.0,
                "up": (0.0, 0.0, 1.0),
                "camera_height": 1.0,
                "cell_size": 0.1,
                "max_range": 3.0,
                "sigma": 0.01,
                "person_radius": 0.3,
                "robot": "robot",
                "model": wv.visibility.ReferenceModel(),
                "device": "cpu",
            },
        ),
        "DepthWatcher.update": (
            watcher.update,
            {"depth": DEPTH, "camera_to_world": POSE, "people": agents()[1:], "time": 1.0}
            | {"convention": "opencv", "quaternion": "xyzw"},
        ),
        "DepthWatcher.lines_of_sight": (watcher.lines_of_sight, {"point": (1.0, 0.0, 0.2)}),
        "DepthWatcher.turn_eyes": (watcher.turn_eyes, {"name": "human", "angles": (0.2, -0.1)}),
        "line_of_sight": (
            wv.visibility.line_of_sight,
            {"scene": seen, "agent": agents()[0], "point": (1.0, 0.0, 0.2), "tolerance": 0.001}
            | {"occupancy": None, "object_poses": MOVED},
        ),
        "Watched.floor_map": (watched.floor_map, {"cell_size": 0.1, "max_range": 3.0}),
        # warpvis.viewer
        "WatchPage": (
            lambda **given: wv.viewer.WatchPage(**given).close(),
            {"watcher": watcher, "port": 8471, "dark": False, "speed": 1.0},
        ),
        "view": (
            lambda **given: wv.view(**given).close(),
            {"scene": seen, "agents": agents(), "camera": None, "movable": ["box"], "objects": ["box"], **page},
        ),
        "Viewer": (lambda **given: wv.viewer.Viewer(**given).close(), {"state": state, **page}),
        "Viewer.save_html": (
            lambda **given: _with_page(state, lambda page: page.save_html(**given)),
            {"path": path.with_suffix(".html"), "title": "a scene"},
        ),
        "ViewerState.set_joint": (arm.set_joint, {"name": "turn", "value": 0.5}),
        "MujocoStage": (wv.viewer.MujocoStage, {"model": MODEL, "data": None, "labels": {"ball": "object"}}),
        "MujocoStage.agent": (wv.viewer.MujocoStage(MODEL).agent, {"name": "robot", "camera": "eye"}),
        "ViewerState.show_frame": (played.show_frame, {"number": 0}),
        "save_rerun": (wv.viewer.save_rerun, {"state": state, "path": path.with_suffix(".rrd")}),
        "framing_agent": (wv.viewer.framing_agent, {"scene": seen, "camera": CAMERA}),
        "ViewerState": (
            wv.viewer.ViewerState,
            {"scene": seen, "agents": agents(), "movable": ["box"], "objects": ["box"], "points": 100},
        ),
        "ViewerState.move_agent": (state.move_agent, {"name": "robot", "pose": POSE, "quaternion": "xyzw"}),
        "ViewerState.raise_agent": (state.raise_agent, {"name": "robot", "height": 0.5}),
        "ViewerState.height": (state.height, {"name": "robot"}),
        "ViewerState.set_camera": (state.set_camera, {"name": "robot", "camera": CAMERA}),
        "ViewerState.set_sensor": (state.set_sensor, {"sensor": None}),
        "ViewerState.move_object": (state.move_object, {"name": "cart", "pose": MOVED[0], "quaternion": "xyzw"}),
        "ViewerState.object_pose": (state.object_pose, {"name": "cart"}),
        "ViewerState.pick": (state.pick, {"point": (1.0, 0.0, 0.2)}),
        "ViewerState.pick_along": (state.pick_along, {"origin": (0, 0, 0), "direction": (1, 0, 0)}),
        "ViewerState.turn_eyes": (state.turn_eyes, {"name": "human", "right": 0.2, "up": -0.1}),
        "ViewerState.release_eyes": (state.release_eyes, {"name": "human"}),
        # warpvis.planning
        "BestViews.pose": (best.pose, {"rank": 0}),
        "Coverage.best": (covered.best, {"count": 1}),
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
            {"scene": seen, **VIEW, "samples": None, "weights": None, "count": 1, "tolerance": 0.1, **one},
        ),
        "minimum_height": (
            planned.minimum_height,
            {
                "scene": seen,
                "eyes": [[0, 0, 0]],
                "targets": [[3, 0, 0]],
                "raises": "eye",
                "max_height": 9.0,
                "end_tolerance": 0.1,
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
        "framing": (
            generated.framing,
            {"scene": seen, "camera": CAMERA, "azimuth": 0.0, "elevation": 0.5},
        ),
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
        "OrthographicCamera": (
            wv.cameras.OrthographicCamera,
            dict(
                zip(
                    ("width", "height", "fx", "fy", "cx", "cy", "near", "far"),
                    (8, 6, 9, 9, 4, 3, 0.1, 4.0),
                    strict=True,
                )
            ),
        ),
        "OrthographicCamera.from_extent": (
            wv.cameras.OrthographicCamera.from_extent,
            {"width": 8, "height": 6, "across": 2.0, "near": 0.1, "far": 4.0},
        ),
        # warpvis.sensors
        "LensCamera": (
            wv.cameras.LensCamera,
            {"lens": LENS.lens, "width": 8, "height": 6, "near": 0.1, "far": 4.0, "kind": "z"},
        ),
        "Rays": (
            wv.cameras.Rays,
            {
                "directions": [[0, 0, 1]],
                "origins": [[0, 0, 0]],
                "times": [0],
                "rings": [0],
                "near": 0.1,
                "far": 4.0,
                "kind": "z",
                "axes": "opencv",
            },
        ),
        "LensCamera.project": (LENS.project, {"points": [[0, 0, 1]]}),
        "LensCamera.unproject": (LENS.unproject, {"pixels": [[1, 1]]}),
        "LensCamera.to_camera_info": (LENS.to_camera_info, MESSAGE),
        "LensCamera.canvas_rays": (LENS.canvas_rays, {"canvas": (1, 0, 0, 1)}),
        "LensCamera.has_pixels_of": (LENS.has_pixels_of, {"other": LENS}),
        "LensCamera.depth_rays": (LENS.depth_rays, {"pixels": [[1, 1]]}),
        "LensCamera.rays_at": (LENS.rays_at, {"pixels": [[1, 1]]}),
        "LensCamera of OpenCV": (
            wv.cameras.lenses.OpenCVPinhole,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "coefficients": (0.01, 0, 0, 0)},
        ),
        "LensCamera of fisheyes": (
            wv.cameras.lenses.KannalaBrandt,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "coefficients": (0.01, 0, 0, 0)},
        ),
        "LensCamera of two spheres": (
            wv.cameras.lenses.DoubleSphere,
            {"fx": 9, "fy": 9, "cx": 4, "cy": 3, "xi": -0.2, "alpha": 0.6},
        ),
        "LensCamera of F-theta": (
            wv.cameras.lenses.FTheta,
            {"cx": 4, "cy": 3, "coefficients": (0.1,), "maps": "radius_to_angle", "max_view_angle": 2.0},
        ),
        "LensCamera of panoramas": (wv.cameras.lenses.Equirectangular, {"width": 8, "height": 6}),
        "WideCamera": (
            wv.cameras.WideCamera,
            {"width": 8, "height": 6, "hfov": 3.0, "projection": "spherical", "near": 0.1, "far": 9.0},
        ),
        "WideCamera.rays_at": (wv.cameras.WideCamera(8, 6, 3.0).rays_at, {"pixels": [[1, 1]]}),
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
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
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
        "save_labels": (
            wv.viz.save_labels,
            {
                "labels": RENDERED.labels.numpy()[0],
                "path": path / "labels.png",
                "label_names": {9: "shelf"},
                "title": "a",
            },
        ),
        "save_map": (
            wv.viz.save_map,
            {
                "floor": floor_map,
                "path": path / "b.png",
                "view": 0,
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
        "save_point_sightings": (
            wv.viz.save_point_sightings,
            {
                "scene": seen,
                **VIEW,
                "points": [[0.0, 0.0, 0.0]],
                "path": path / "f.png",
                "tolerance": 1e-4,
                "title": "f",
                "object_poses": MOVED,
                "exclude": None,
            },
        ),
        "save_preview": (
            wv.viz.save_preview,
            {"depth": RENDERED.depth.numpy()[0], "path": path / "g.png", "depth_range": (0.0, 4.0)},
        ),
        "save_contact_sheet": (
            wv.viz.save_contact_sheet,
            {"depth": RENDERED.depth.numpy(), "names": ["h"], "path": path / "h.png", "depth_range": (0.0, 4.0)},
        ),
        "agent_colors": (wv.viz.agent_colors, {"count": 3}),
        "depth_colors": (wv.viz.depth_colors, {"depth": RENDERED.depth.numpy(), "depth_range": (0.0, 4.0)}),
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
        "Lidar.points": (wv.webots.find_lidar(world, "lidar").points, {"ranges": [[1.0] * 8]}),
        "find_device": (wv.webots.find_device, {"world": world, "name": "range-finder"}),
        "find_lidar": (wv.webots.find_lidar, {"world": world, "name": "lidar"}),
        "load_webots": (
            wv.webots.load_webots,
            {
                "path": folder / "lab.wbt",
                "device": "cpu",
                "labels": {"box": "human"},
                "label_names": {9: "shelf"},
                "search_path": [folder],
                "strict": False,
            },
        ),
        "quantize": (wv.webots.quantize, {"values": DEPTH[0], "resolution": 0.1}),
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
        "recognize": (wv.webots.recognize, {"world": world, "camera_name": "camera", "threads": 1}),
        "render_color": (
            wv.webots.render_color,
            {
                "world": world,
                "device_name": "camera",
                "exclude_body": False,
                "shadows": True,
                "reflections": True,
                "ambient_occlusion": AmbientOcclusion(0.5),
                "samples": 1,
                "threads": 1,
            },
        ),
        "render_lidar": (
            wv.webots.render_lidar,
            {
                "world": world,
                "lidar_name": "lidar",
                "webots_version": "header",
                "exclude_body": False,
                "seed": 0,
                "threads": 1,
            },
        ),
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
        "robot_agent": (wv.webots.robot_agent, {"world": world, "device_name": "range-finder", "name": "robot"}),
        "segmentation_image": (
            wv.webots.segmentation_image,
            {"world": world, "camera_name": "camera", "threads": 1},
        ),
    }


def _with_page(state, use):
    """Call a function that needs an open viewer page."""
    with wv.viewer.Viewer(state, port=8471) as page:
        use(page)
