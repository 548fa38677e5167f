# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of `DepthEye` in a Webots controller, with stand-ins for Webots' devices and nodes."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from webots_library import Simulation, ctypes_library, swig_library

import warpvis as wv
from warpvis.errors import ArrayError, PoseError, WarpvisError
from warpvis.webots import DepthEye, load_webots, render_range

WORLDS = Path(__file__).parent.parent / "scenes" / "webots"
BOUNDS = ((-2, -2), (2, 2))


class RangeFinder:
    """Stand-in for the device returned by `Robot.getDevice`, with a rendered image."""

    def __init__(self, device, image, kind="pointer"):
        self._device, self._image, self._kind = device, image, kind

    def getWidth(self):
        return self._device.width

    def getHeight(self):
        return self._device.height

    def getFov(self):
        return self._device.fov

    def getMinRange(self):
        return self._device.min_range

    def getMaxRange(self):
        return self._device.max_range

    def getRangeImage(self, data_type="list"):
        if self._image is None or self._kind == "null":
            return None if self._image is None else ctypes.POINTER(ctypes.c_float)()
        flat = np.ascontiguousarray(self._image, dtype=np.float32).ravel()
        if data_type == "list" or self._kind == "list":
            return flat.tolist()
        if self._kind == "bytes":
            return flat.tobytes()
        self._kept = flat
        return flat.ctypes.data_as(ctypes.POINTER(ctypes.c_float))


class OldRangeFinder(RangeFinder):
    """Range finder of a release whose images are lists."""

    def getRangeImage(self):
        return super().getRangeImage("list")


class Node:
    """Stand-in for a Supervisor's node."""

    def __init__(self, position, orientation):
        self._position, self._orientation = position, orientation

    def getPosition(self):
        return list(self._position)

    def getOrientation(self):
        return np.asarray(self._orientation).ravel().tolist()


@pytest.fixture(scope="module")
def worlds():
    return {version: load_webots(WORLDS / f"experiment_3_{version}.wbt") for version in ("R2021b", "R2023b")}


def eye_of(world, kind="pointer", **options):
    device = world.devices["range-finder"]
    image = render_range(world, "range-finder", webots_version="header")
    return DepthEye(RangeFinder(device, image, kind), version=world.version, **options)


# The robot's frame in the world, and the range finder's fields, as in the two files.
PLACES = {
    "R2023b": ((-1.8, 0, 0), np.eye(3), (0.03, 0, 0.7), (0, 1, 0, 0.17453292519943295)),
    "R2021b": (
        (-1.8, 0, 0),
        [[0, 0, -1], [0, 1, 0], [1, 0, 0]],
        (0, 0.7, -0.03),
        (-1, 0, 0, 0.17453292519943295),
    ),
}


@pytest.mark.parametrize("version", PLACES)
def test_pose_of_robot_and_device(worlds, version):
    position, orientation, translation, rotation = PLACES[version]
    mount = {"translation": translation, "rotation": rotation}
    wanted = wv.core.poses.poses_to_matrices(worlds[version].devices["range-finder"].pose)
    robot = Node(position, orientation)
    asked = eye_of(worlds[version], node=robot, **mount)
    np.testing.assert_allclose(wv.core.poses.poses_to_matrices(asked.pose()), wanted, atol=1e-9)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = orientation, position
    given = eye_of(worlds[version], **mount)
    np.testing.assert_allclose(wv.core.poses.poses_to_matrices(given.pose(matrix)), wanted, atol=1e-9)
    np.testing.assert_allclose(
        wv.core.poses.poses_to_matrices(given.pose(wv.core.poses.poses_to_opencv(matrix)[0])), wanted, atol=1e-9
    )


@pytest.mark.parametrize("kind", ["pointer", "list", "bytes", "old"])
@pytest.mark.parametrize("version", PLACES)
def test_image_types_give_exact_depth(worlds, version, kind):
    """Also for R2021b, whose range finders are wrong by millimeters."""
    world = worlds[version]
    eye = eye_of(world, kind)
    if kind == "old":
        image = render_range(world, "range-finder", webots_version="header")
        eye = DepthEye(OldRangeFinder(world.devices["range-finder"], image), version=str(world.version))
    true = render_range(world, "range-finder")
    depth = eye.depth()
    assert depth.shape == (240, 320) and depth.dtype == np.float32
    np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(true))
    np.testing.assert_allclose(depth, true, atol=2e-6)


def test_labels_and_floor_map(worlds):
    world = worlds["R2023b"]
    device = world.devices["range-finder"]
    eye = eye_of(world, node=Node(*PLACES["R2023b"][:2]), translation=PLACES["R2023b"][2], rotation=PLACES["R2023b"][3])
    true = render_range(world, "range-finder")
    spheres = [wv.maps.Sphere((1.1, -0.8, 0.1), 0.25)]
    labels = eye.classify(spheres=spheres)
    wanted = wv.classify(true, device.camera, device.pose, spheres=spheres)
    assert (labels.numpy() == wanted.numpy()).mean() > 0.9999
    assert (labels.numpy() == wv.Label.OBJECT).sum() > 300
    floor = eye.floor_map(bounds=BOUNDS, spheres=spheres)
    points = wv.back_project(true, device.camera, device.pose)
    same = wv.floor_map(points, wanted, bounds=BOUNDS)
    assert (floor.cells.numpy() == same.cells.numpy()).mean() > 0.999
    assert floor.area(wv.Label.OBJECT)[0] > 0.001 and floor.area(wv.Label.GROUND)[0] > 1
    np.testing.assert_allclose(np.nan_to_num(eye.points().numpy()), np.nan_to_num(points.numpy()), atol=1e-5)


def test_old_worlds_have_maps_with_y_up(worlds):
    """Areas are equal, though the map's axes differ."""
    areas = []
    for version, up in (("R2023b", "z"), ("R2021b", "y")):
        position, orientation, translation, rotation = PLACES[version]
        eye = eye_of(worlds[version], node=Node(position, orientation), translation=translation, rotation=rotation)
        areas.append(eye.floor_map(bounds=BOUNDS, up=up).area(wv.Label.GROUND)[0])
    assert areas[0] == pytest.approx(areas[1], rel=0.01)


def test_image_of_zeros_is_unknown(worlds):
    """Webots returns zeros before the first measurement."""
    device = worlds["R2023b"].devices["range-finder"]
    eye = DepthEye(RangeFinder(device, np.zeros((240, 320))))
    assert np.isnan(eye.depth()).all()
    assert not eye.classify([0, 0, 0, 0, 0, 0, 1]).numpy().any()
    space = wv.voxel_map(eye.depth(), eye.camera, eye.pose([0, 0, 0, 0, 0, 0, 1]), bounds=[[-1, -1, -1], [1, 1, 1]])
    assert not space.states.numpy().any()  # UNKNOWN: nothing is known to be free


LIBRARIES = {"R2021b": swig_library, "R2023b": ctypes_library}


def simulated(worlds, version, **options):
    """Return the library of a release, and its simulation of a robot in the middle of the world."""
    device = worlds[version].devices["range-finder"]
    image = render_range(worlds[version], "range-finder", webots_version="header")
    matrix = wv.core.poses.poses_to_matrices(device.pose)
    axes = {"R2023b": [[0, -1, 0], [0, 0, -1], [1, 0, 0]], "R2021b": [[1, 0, 0], [0, -1, 0], [0, 0, -1]]}[version]
    simulation = Simulation(device, image, matrix[:3, 3], matrix[:3, :3] @ axes, **options)
    return LIBRARIES[version](simulation), simulation


@pytest.mark.parametrize("version", LIBRARIES)
def test_node_is_found_in_every_release(worlds, version):
    """Each library rejects the other's argument."""
    library, _ = simulated(worlds, version)
    robot = library.Supervisor()
    device = robot.getDevice("range-finder")
    device.enable(32)
    other = 7 if version == "R2021b" else device
    with pytest.raises(TypeError if version == "R2021b" else ctypes.ArgumentError):
        robot.getFromDevice(other)
    eye = DepthEye(device, robot=robot, version=version)
    wanted = wv.core.poses.poses_to_matrices(worlds[version].devices["range-finder"].pose)
    np.testing.assert_allclose(wv.core.poses.poses_to_matrices(eye.pose()), wanted, atol=1e-9)
    np.testing.assert_allclose(eye.depth(), render_range(worlds[version], "range-finder"), atol=2e-6)


@pytest.mark.parametrize("version", LIBRARIES)
def test_disabled_device_raises(worlds, version):
    library, _ = simulated(worlds, version)
    robot = library.Supervisor()
    eye = DepthEye(robot.getDevice("range-finder"), robot=robot, version=version)
    with pytest.raises(ArrayError, match="has no image: enable"):
        eye.depth()


@pytest.mark.parametrize("version", LIBRARIES)
def test_robot_must_be_a_supervisor(worlds, version):
    library, _ = simulated(worlds, version, supervisor=False)
    for robot, message in ((library.Supervisor(), "field supervisor must be TRUE"), (library.Robot(), "getFromDevice")):
        with pytest.raises(PoseError, match=message):
            DepthEye(robot.getDevice("range-finder"), robot=robot, version=version)
    with pytest.raises(PoseError, match="give robot or node, not both"):
        DepthEye(robot.getDevice("range-finder"), robot=robot, node=Node(*PLACES[version][:2]), version=version)


def bad_eye(worlds, image, kind="pointer"):
    return DepthEye(RangeFinder(worlds["R2023b"].devices["range-finder"], image, kind))


BAD = {
    "no image": (lambda worlds: bad_eye(worlds, None).depth(), ArrayError, "has no image: enable"),
    "null": (lambda worlds: bad_eye(worlds, 0, "null").depth(), ArrayError, "has no image: enable"),
    "another size": (
        lambda worlds: bad_eye(worlds, np.ones(7), "list").depth(),
        ArrayError,
        "must have 320 x 240 values, got 7",
    ),
    "no node": (
        lambda worlds: eye_of(worlds["R2023b"]).pose(),
        PoseError,
        "node_pose must be given, or the DepthEye needs a node",
    ),
    "two poses": (
        lambda worlds: eye_of(worlds["R2023b"]).pose(np.eye(7)[[6, 6]]),
        PoseError,
        "must be one pose, got 2",
    ),
    "pose of six": (lambda worlds: eye_of(worlds["R2023b"]).pose(np.ones(6)), PoseError, r"node_pose must have shape"),
    "rotation of three": (
        lambda worlds: eye_of(worlds["R2023b"], rotation=(0, 0, 1)),
        PoseError,
        "translation and rotation must be three and four finite numbers",
    ),
    "version": (
        lambda worlds: DepthEye(RangeFinder(worlds["R2023b"].devices["range-finder"], None), version="7"),
        WarpvisError,
        "expected a Webots version",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_invalid_input_raises_one_line_message(case, worlds):
    act, kind, message = BAD[case]
    with pytest.raises(kind, match=message):
        act(worlds)
