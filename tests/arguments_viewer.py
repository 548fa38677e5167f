# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Valid arguments of public functions of `viewer` and `viz`: ``name: (function, arguments)``."""

import mujoco
from arguments_shared import CAMERA, DEPTH, MODEL, MOVED, POSE, RENDERED, SEEN, VIEW, agents, scene

import warpvis as wv

_ARM = mujoco.MjModel.from_xml_string(
    '<mujoco><worldbody><body><joint name="turn" axis="0 0 1"/><geom size="0.1"/></body></worldbody></mujoco>'
)


def viewer_cases(folder):
    """Return the cases; write their files to `folder`."""
    seen = scene()
    path = folder / "out"
    floor_map = wv.floor_map(RENDERED.points, RENDERED.labels, bounds=[[-1, -1], [1, 1]])
    state = wv.viewer.ViewerState(seen, agents(), points=100)
    arm = wv.viewer.ViewerState(wv.viewer.MujocoStage(_ARM), agents(), points=100)
    played = wv.viewer.ViewerState(seen, agents(), frames=wv.Frames.from_poses([POSE]), points=100)
    page = {"port": 8471, "dark": False}
    watcher = wv.visibility.DepthWatcher(CAMERA, places={"mug": (2.0, 0.0, 1.0, 0.2)}, floor=-1.0, cell_size=0.1)
    return {
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
    }


def _with_page(state, use):
    """Call a function that needs an open viewer page."""
    with wv.viewer.Viewer(state, port=8471) as page:
        use(page)
