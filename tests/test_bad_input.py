# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Invalid input to public functions raises one sentence with the value and the expectation."""

import math

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import Camera, Label, Scene
from warpvis.maps import Sphere

KINECT = Camera.kinect()
POSE = np.array([0.0, 0, 1, 0, 0, 0, 1])
BOX = trimesh.creation.box()
K = [[500.0, 0, 320], [0, 500, 240], [0, 0, 1]]
VERTICES, FACES = np.eye(3), np.array([[0, 1, 2]])
DEPTH = np.ones((1, 240, 320), dtype=np.float32)
POINTS = np.zeros((1, 2, 2, 3), dtype=np.float32)
LABELS = np.ones((1, 2, 2), dtype=np.uint8)
SQUARE = ((0, 0), (1, 1))


def box_scene():
    scene = Scene()
    scene.add(BOX, name="box")
    return scene


def moving_scene(*, movable=True):
    """Return a scene with a static floor and two movable boxes."""
    scene = box_scene()
    for name in ("left", "right"):
        scene.add(BOX, name=name, movable=movable)
    return scene


def render_moved(views=2, *, movable=True, **arguments):
    return wv.render(moving_scene(movable=movable), KINECT, np.tile(POSE, (views, 1)), **arguments)


def moved(worlds, *, bad=(), value=np.nan):
    """Return poses of two objects in worlds, some with an invalid rotation."""
    rows = np.tile(POSE, (worlds, 2, 1))
    for world, movable in bad:
        rows[world, movable, 3:] = value
    return rows


def poses_with(value, *views):
    poses = np.tile(POSE, (8, 1))
    poses[list(views), 3:] = value
    return poses


def scaled_matrix(factor):
    return np.diag([factor, factor, factor, 1.0])


CASES = {
    # Cameras
    "zero width": (lambda: Camera.from_fov(0, 240, hfov=1), "width must be a whole number of pixels"),
    "half a pixel": (lambda: Camera(1.5, 2, 1, 1, 1, 1), "width must be a whole number of pixels from 1 up, got 1.5"),
    "no field of view": (lambda: Camera.from_fov(320, 240), "give either hfov or vfov"),
    "two fields of view": (lambda: Camera.from_fov(320, 240, hfov=1, vfov=1), "give either hfov or vfov"),
    "degrees": (
        lambda: Camera.from_fov(320, 240, hfov=57),
        "radians, got 57; angles are in radians: pass math.radians.57.",
    ),
    "NaN field of view": (lambda: Camera.from_fov(320, 240, hfov=math.nan), "hfov must be between 0 and pi"),
    "unknown vertical": (lambda: Camera.from_fov(3, 2, hfov=1, vertical="x"), "vertical must be"),
    "linear from vfov": (lambda: Camera.from_fov(3, 2, vfov=1, vertical="linear"), "so give hfov"),
    "far before near": (lambda: Camera.from_fov(3, 2, hfov=1, near=2, far=1), "0 <= near < far, got near=2.0, far=1.0"),
    "negative near": (lambda: Camera.from_fov(3, 2, hfov=1, near=-1), "0 <= near < far"),
    "infinite focal length": (lambda: Camera(3, 2, math.inf, 1, 1, 1), "fx must be a finite number"),
    "negative focal length": (lambda: Camera(3, 2, -5, 1, 1, 1), "focal lengths must be positive"),
    "K of another shape": (lambda: Camera.from_K(np.eye(4), 3, 2), r"K must have shape \(3, 3\), got \(4, 4\)"),
    "K with skew": (lambda: Camera.from_K([[1, 0.1, 0], [0, 1, 0], [0, 0, 1]], 3, 2), "without skew"),
    "K of words": (lambda: Camera.from_K("K", 3, 2), "K must be an array of numbers"),
    "unknown pixel center": (lambda: Camera.from_K(K, 3, 2, pixel_center=1), "pixel_center must be 0.5 or 0.0, got 1"),
    "points of two": (lambda: KINECT.project([1, 2]), r"points must have shape \(..., 3\), got \(2,\)"),
    "image points of three": (lambda: KINECT.back_project([1, 2, 3], 1), r"pixels must have shape \(..., 2\)"),
    # Poses
    "poses of six": (lambda: wv.core.poses.parse_poses(np.zeros((5, 6))), r"\(V, 7\).*got \(5, 6\)"),
    "poses of words": (lambda: wv.core.poses.parse_poses([["a"] * 7]), "camera_to_world must be an array of numbers"),
    "no poses": (lambda: wv.core.poses.parse_poses(None), "camera_to_world must be an array of numbers"),
    "ragged poses": (lambda: wv.core.poses.parse_poses([[1, 2], [3]]), "camera_to_world must be an array of numbers"),
    "NaN poses": (
        lambda: wv.core.poses.parse_poses(poses_with(np.nan, 1, 5)),
        "must be finite: wrong in 2 of 8, at index 1, 5",
    ),
    "zero quaternions": (
        lambda: wv.core.poses.parse_poses(poses_with(0, *range(7))),
        "length 1, got 0: .* 7 of 8, at index 0, .*4, ...",
    ),
    "scaled matrices": (lambda: wv.core.poses.parse_poses(scaled_matrix(2)), "rotations without scale"),
    "mirroring matrices": (lambda: wv.core.poses.parse_poses(np.diag([1, 1, -1, 1])), "rotations, not mirrors"),
    "projective matrices": (lambda: wv.core.poses.parse_poses(np.ones((4, 4))), "last row 0 0 0 1"),
    "unknown convention": (
        lambda: wv.core.poses.parse_poses(POSE, convention="blender"),
        "'opencv', 'opengl', 'ros_body', 'ros_optical', got 'blender'",
    ),
    "unknown device": (lambda: wv.core.poses.parse_poses(POSE, device="gpu"), "device 'gpu' is not on this machine"),
    "look at itself": (lambda: wv.look_at((1, 2, 3), (1, 2, 3)), "must differ, and not along up"),
    "look straight down": (lambda: wv.look_at((0, 0, 1), (0, 0, 0)), "Pass another up"),
    "look at NaN": (lambda: wv.look_at((0, 0, 0), (1, 0, np.nan)), "target must be three finite numbers"),
    "up is x": (lambda: wv.look_at((0, 0, 0), (1, 0, 0), up="x"), 'up must be "z" or "y", got \'x\''),
    # Scenes
    "scene on no device": (lambda: Scene(device="cuda:99"), "device 'cuda:99' is not on this machine, which has: cpu"),
    "scene up x": (lambda: Scene(up="x"), 'up must be "z" or "y"'),
    "not a mesh": (lambda: Scene().add("box"), "must be a trimesh.Trimesh or a pair"),
    "vertices of two": (
        lambda: Scene().add((np.zeros((3, 2)), FACES)),
        r"vertices of 'object_0' must have shape \(n, 3\)",
    ),
    "no triangles": (
        lambda: Scene().add((VERTICES, np.zeros((0, 3), int)), name="ball"),
        "mesh of 'ball' must have tri",
    ),
    "float faces": (lambda: Scene().add((VERTICES, FACES * 1.0)), "faces of 'object_0' must be integers"),
    "faces out of range": (lambda: Scene().add((VERTICES, FACES + 1)), "index its 3 vertices, got indices from 1 to 3"),
    "negative faces": (lambda: Scene().add((VERTICES, FACES - 1)), "got indices from -1 to 1"),
    "NaN vertices": (
        lambda: Scene().add((VERTICES * np.nan, FACES)),
        "vertices of 'object_0' must be finite: 3 are not",
    ),
    "vast vertices": (lambda: Scene().add((VERTICES * 1e30, FACES)), "within 1e18 m"),
    "vertices of words": (lambda: Scene().add(([["a"] * 3], FACES)), "must hold arrays of numbers"),
    "taken name": (lambda: box_scene().add(BOX, name="box"), "already has an object named 'box'"),
    "unknown label": (lambda: Scene().add(BOX, label="cat"), r"empty \(0\).*got 'cat'"),
    "label out of range": (lambda: Scene().add(BOX, label=256), "got 256"),
    "two poses": (lambda: Scene().add(BOX, pose=np.tile(POSE, (2, 1))), "must be one pose, got 2"),
    "object pose NaN": (lambda: Scene().add(BOX, name="b", pose=POSE * np.nan), "pose of 'b' must be finite"),
    "negative scale": (lambda: Scene().add(BOX, scale=-1), "scale of 'object_0' must be one or three positive"),
    "unknown object": (lambda: box_scene()["ball"], "no object 'ball'; it has 'box'"),
    "bounds of nothing": (lambda: Scene().bounds, "the scene has no objects"),
    "export of nothing": (lambda: Scene().export("x.glb"), "the scene has no objects"),
    "export as OBJ": (lambda: box_scene().export("x.obj"), "must end in .glb"),
    "export to nowhere": (lambda: box_scene().export("/nonexistent/x.glb"), "cannot be written: No such file"),
    # Rendering
    "render nothing": (lambda: wv.render(Scene(), KINECT, POSE), "the scene has no objects"),
    "render a mesh": (lambda: wv.render(BOX, KINECT, POSE), "scene must be a warpvis.Scene, got Trimesh"),
    "render through K": (lambda: wv.render(box_scene(), K, POSE), "camera must be a warpvis.Camera, got list"),
    "unknown output": (lambda: wv.render(box_scene(), KINECT, POSE, outputs=("rgb",)), "depth, points, .*got rgb"),
    "no device_bytes": (
        lambda: wv.render(box_scene(), KINECT, POSE, device_bytes=0),
        "device_bytes .*from 1 up, got 0",
    ),
    "true device_bytes": (lambda: wv.render(box_scene(), KINECT, POSE, device_bytes=True), "device_bytes .*got True"),
    "device_bytes in words": (
        lambda: wv.render(box_scene(), KINECT, POSE, device_bytes="all"),
        "device_bytes must be a whole number from 1 up, got 'all'",
    ),
    "no outputs": (lambda: wv.render(box_scene(), KINECT, POSE, outputs=()), "got none"),
    "no threads": (lambda: wv.render(box_scene(), KINECT, POSE, threads=0), "threads must be .* got 0"),
    "half a thread": (lambda: wv.render(box_scene(), KINECT, POSE, threads=0.5), "threads must be .* got 0.5"),
    "out of another kind": (lambda: wv.render(box_scene(), KINECT, POSE, out=DEPTH), "out must be warpvis.Views"),
    "out of another size": (
        lambda: wv.render(box_scene(), KINECT, [POSE] * 2, out=wv.render(box_scene(), KINECT, POSE)),
        r"out.depth must have shape \(2, 240, 320\), got \(1, 240, 320\)",
    ),
    "out lacks an output": (
        lambda: wv.render(box_scene(), KINECT, POSE, out=wv.render(box_scene(), KINECT, POSE, outputs="depth")),
        "out.points must be a wp.array",
    ),
    "unknown caster": (
        lambda: wv.render(box_scene(), KINECT, POSE, caster="fast"),
        '"auto", "packets" or "rays", got \'fast\'',
    ),
    "out with gaps": (
        lambda: wv.render(
            box_scene(), KINECT, POSE, outputs="depth", out=wv.Views(wp.zeros((1, 240, 640), device="cpu")[:, :, ::2])
        ),
        "out.depth must be contiguous, got strides",
    ),
    "pixels of three": (
        lambda: wv.Renderer(box_scene(), KINECT).render_at(POSE, np.zeros((1, 5, 3))),
        r"pixels must have shape \(1, N, 2\), got \(1, 5, 3\)",
    ),
    "pixels of more views": (
        lambda: wv.Renderer(box_scene(), KINECT).render_at(POSE, np.zeros((2, 5, 2))),
        r"pixels must have shape \(1, N, 2\), got \(2, 5, 2\)",
    ),
    "more than memory": (
        lambda: wv.render(box_scene(), Camera.from_fov(20000, 20000, hfov=1), np.tile(POSE, (100_000, 1))),
        "depth of shape .* needs 160000.0 GB on cpu, .*Render fewer views at a time",
    ),
    # Worlds
    "poses of what stays": (
        lambda: render_moved(movable=False, object_poses=moved(1)),
        "no object of the scene is movable; add one with movable=True",
    ),
    "poses of three objects": (
        lambda: render_moved(object_poses=np.zeros((2, 3, 7))),
        r"object_poses must have shape \(W, 2, 7\), rows .* of the movable objects in W worlds, got \(2, 3, 7\)",
    ),
    "object matrices": (lambda: render_moved(object_poses=np.zeros((2, 2, 4, 4))), r"got \(2, 2, 4, 4\)"),
    "object poses of one": (lambda: render_moved(object_poses=POSE), r"shape \(W, 2, 7\), .*got \(7,\)"),
    "no worlds": (lambda: render_moved(object_poses=np.zeros((0, 2, 7))), r"got \(0, 2, 7\)"),
    "object poses of words": (lambda: render_moved(object_poses="home"), "object_poses must be an array of numbers"),
    "NaN object poses": (
        lambda: render_moved(object_poses=moved(2, bad=[(0, 0), (1, 1)])),
        "must be finite: wrong in 2, of 'left' in world 0, 'right' in world 1$",
    ),
    "infinite object places": (
        lambda: render_moved(object_poses=moved(1) + [np.inf, 0, 0, 0, 0, 0, 0]),
        "must be finite: wrong in 2, of 'left' in world 0, 'right' in world 0",
    ),
    "zero object quaternions": (
        lambda: render_moved(object_poses=moved(3, bad=[(2, 0)], value=0), world_index=[0, 0]),
        "length 1, got 0: wrong in 1, of 'left' in world 2",
    ),
    "worlds and views": (
        lambda: render_moved(object_poses=moved(3)),
        "object_poses have 3 worlds for 2 views; give world_index= for each view",
    ),
    "world out of range": (
        lambda: render_moved(object_poses=moved(3), world_index=[0, 3]),
        "world_index must be from 0 to 2, the worlds of object_poses, got 3 for view 1",
    ),
    "negative world": (
        lambda: render_moved(world_index=[-1, 0]),
        "from 0 to 0, the worlds of object_poses, got -1 for view 0",
    ),
    "worlds of three views": (
        lambda: render_moved(world_index=[0, 0, 0]),
        r"world_index must have shape \(2,\), got \(3,\)",
    ),
    "half a world": (lambda: render_moved(world_index=[0.5, 0]), "world_index must be int32, got float64"),
    "exclude a stranger": (lambda: render_moved(exclude=["ball"]), "no object 'ball'; it has 'box', 'left', 'right'"),
    "exclude a number too great": (lambda: render_moved(exclude=[3]), "objects from 0 to 2, got 3"),
    "exclude a negative number": (lambda: render_moved(exclude=[-1]), "objects from 0 to 2, got -1"),
    "exclude flags of two": (
        lambda: render_moved(exclude=np.zeros((2, 2), dtype=bool)),
        r"flags of shape \(2, 3\) or \(1, 3\), got shape \(2, 2\)",
    ),
    "exclude flags without views": (
        lambda: render_moved(exclude=[True, False, False]),
        r"flags of shape \(2, 3\) or \(1, 3\), got shape \(3,\)",
    ),
    "exclude a number alone": (lambda: render_moved(exclude=2), r"exclude must be names or indices .*got shape \(\)"),
    "exclude an unknown name": (lambda: render_moved(exclude="ball"), "no object 'ball'"),
    "points of the image in no world": (
        lambda: wv.Renderer(moving_scene(), KINECT).render_at(POSE, np.zeros((1, 5, 2)), world_index=[1]),
        "world_index must be from 0 to 0",
    ),
    # Classification
    "depth of millimeters": (lambda: wv.classify(DEPTH.astype(np.uint16), KINECT, POSE), "in meters.*divide"),
    "depth of another size": (lambda: wv.classify(DEPTH[:, :9], KINECT, POSE), r"\(V, 240, 320\), got \(1, 9, 320\)"),
    "depth of no image": (lambda: wv.classify(None, KINECT, POSE), "depth must be an array of numbers"),
    "more poses than depth": (
        lambda: wv.classify(DEPTH, KINECT, [POSE] * 3),
        "camera_to_world must have one pose for each view of depth, 1, got 3",
    ),
    "spheres of three": (lambda: wv.classify(DEPTH, KINECT, POSE, spheres=[[1, 2, 3]]), r"shape \(S, 4\)"),
    "negative sigma": (
        lambda: wv.classify(DEPTH, KINECT, POSE, ground_tolerance=-1),
        "ground_tolerance must be a number of meters from 0 up, got -1",
    ),
    "NaN ground": (lambda: wv.classify(DEPTH, KINECT, POSE, ground_height=np.nan), "ground_height must be a finite"),
    "floor of three": (lambda: wv.classify(DEPTH, KINECT, POSE, floor=[0, 0, 1]), "floor must be a FloorFit or four"),
    "floor without normal": (lambda: wv.classify(DEPTH, KINECT, POSE, floor=[0, 0, 0, 1]), "normal a b c that is not"),
    "floor and height": (
        lambda: wv.classify(DEPTH, KINECT, POSE, floor=[0, 0, 1, 0], ground_height=1.0),
        'up and ground_height must be "z" and 0 if floor is given',
    ),
    "noise of a word": (lambda: wv.classify(DEPTH, KINECT, POSE, sigma="d435"), "sigma must be a number of meters, a"),
    "noise with a step": (
        lambda: wv.classify(DEPTH, KINECT, POSE, sigma=lambda z: np.where(z > 2, 0.1, 0.001)),
        "sigma must be close to a quadratic polynomial of depth from 0.3 to 4.5 m",
    ),
    "negative threshold": (lambda: wv.classify(DEPTH, KINECT, POSE, threshold=-1), "threshold must be"),
    "label below of no class": (lambda: wv.classify(DEPTH, KINECT, POSE, below_label=256), "label must be one of"),
    "negative range": (
        lambda: wv.classify(DEPTH, KINECT, POSE, max_range=-1),
        "max_range must be a number of meters from 0 up",
    ),
    "NumPy out": (lambda: wv.classify(DEPTH, KINECT, POSE, out=LABELS), "out must be a wp.array .* got ndarray"),
    "out of another dtype": (
        lambda: wv.classify(DEPTH, KINECT, POSE, out=wp.zeros(DEPTH.shape, dtype=wp.int32, device="cpu")),
        "out must have dtype uint8, got int32",
    ),
    "camera of no kind": (lambda: wv.back_project(DEPTH, None, POSE), "camera must be a warpvis.Camera"),
    "sphere without size": (lambda: Sphere((0, 0, 0), 0), "diameter of a sphere must be a positive number"),
    "sphere at NaN": (lambda: Sphere((0, np.nan, 0), 1), "center of a sphere must be three finite numbers"),
    "objects of floats": (
        lambda: wv.maps.classify_rendered(DEPTH, DEPTH, box_scene()),
        "objects must be int32, got float32",
    ),
    "objects of another size": (
        lambda: wv.maps.classify_rendered(DEPTH, np.zeros((1, 2, 2), int), box_scene()),
        r"objects must have shape \(1, 240, 320\), got \(1, 2, 2\)",
    ),
    "classified strangers": (
        lambda: wv.maps.classify_rendered(DEPTH, np.full(DEPTH.shape, 1), box_scene()),
        "objects must be from -1 to 0, indices of the scene's objects, got -1 to 1",
    ),
    "classified scene": (lambda: wv.maps.classify_rendered(DEPTH, DEPTH, None), "scene must be a warpvis.Scene"),
    # Maps
    "map of depth": (lambda: wv.floor_map(DEPTH, LABELS, bounds=SQUARE), r"points must have shape \(V, H, W, 3\)"),
    "labels of another size": (
        lambda: wv.floor_map(POINTS, np.ones((1, 3, 2), int), bounds=SQUARE),
        r"labels must have shape \(1, 2, 2\), got \(1, 3, 2\)",
    ),
    "labels beyond bytes": (lambda: wv.floor_map(POINTS, LABELS + 300.0, bounds=SQUARE), "labels must be uint8"),
    "large labels": (lambda: wv.floor_map(POINTS, LABELS * np.int64(300), bounds=SQUARE), "must fit uint8"),
    "ground of no class": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=SQUARE, ground_labels=["road"]),
        "label must be one of empty .*, got 'road'",
    ),
    "names of no classes": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=SQUARE, label_names={300: "road"}),
        "label_names must have numbers from 0 to 255, got 300",
    ),
    "empty bounds": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=((0, 0), (0, 1))),
        r"bounds must be the lower and upper corner of the map, shape \(2, 2\) or \(2, 3\)",
    ),
    "bounds of one": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=(1, 2)),
        r"bounds must be the lower and upper corner of the map, shape \(2, 2\) or \(2, 3\)",
    ),
    "no cell": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=SQUARE, cell_size=0),
        "cell_size must be a positive number",
    ),
    "tiny cells": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=SQUARE, cell_size=1e-9),
        "a map must have at most 2147483647 cells, .*; use a cell_size greater than",
    ),
    "robots of two": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=SQUARE, robots=[(0, 1)]),
        "robots must be finite",
    ),
    "map sigma": (
        lambda: wv.floor_map(POINTS, LABELS, bounds=SQUARE, level_tolerance=-1),
        "level_tolerance must be a number of meters from 0 up",
    ),
    "picture of no kind": (
        lambda: wv.viz.save_map(wv.floor_map(POINTS, LABELS, bounds=SQUARE), "map.xyz"),
        "map.xyz: Format 'xyz' is not supported",
    ),
    "picture in no folder": (
        lambda: wv.viz.save_map(wv.floor_map(POINTS, LABELS, bounds=SQUARE), "/nonexistent/map.png"),
        "/nonexistent/map.png: cannot be written",
    ),
    "picture of no view": (
        lambda: wv.viz.save_map(wv.floor_map(POINTS, LABELS, bounds=SQUARE), "map.png", view=1),
        "view must be from 0 to 0, got 1",
    ),
    # The floor plan
    "plan of a mesh": (lambda: wv.maps.plan_visibility(BOX, KINECT, POSE), "scene must be a warpvis.Scene"),
    "plan through K": (lambda: wv.maps.plan_visibility(box_scene(), K, POSE), "camera must be a warpvis.Camera"),
    "plan from above": (
        lambda: wv.maps.plan_visibility(box_scene(), KINECT, wv.look_at((0, 0, 1), (0, 0, 0), up=(1, 0, 0))),
        "must not look straight up or down on a floor plan: view 0 does",
    ),
    "plan without nobody": (
        lambda: wv.maps.plan_visibility(box_scene(), KINECT, POSE, exclude=("me",)),
        "no object 'me'",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_invalid_arguments_raise_one_sentence(case):
    call, message = CASES[case]
    with pytest.raises(wv.WarpvisError, match=message) as caught:
        call()
    assert isinstance(caught.value, ValueError)
    assert "\n" not in str(caught.value)


def test_arrays_on_another_device_raise(device):
    if device == "cpu":
        pytest.skip("needs two devices")
    with pytest.raises(wv.WarpvisError, match=r"camera_to_world must be on device cpu, got cuda:0"):
        wv.render(box_scene(), KINECT, wp.array([POSE], dtype=wp.transform, device=device))
    with pytest.raises(wv.WarpvisError, match="objects must be on device cpu, got cuda:0"):
        wv.maps.classify_rendered(DEPTH, wp.zeros(DEPTH.shape, dtype=wp.int32, device=device), box_scene())
    with pytest.raises(wv.WarpvisError, match=r"contiguous float32 of shape \(V, 7\)"):
        wv.core.poses.parse_poses(wp.zeros((3, 6), dtype=wp.float32, device=device), device=device)


def test_label_parse_accepts_names_numbers_and_labels():
    assert Label.parse("human") is Label.parse(4) is Label.parse(Label.HUMAN) is Label.HUMAN
