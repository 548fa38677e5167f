# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of what occupancy maps are converted to: grids of the floor, ROS messages, and meshes."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import ArrayError, MessageError
from warpvis.maps import OccupancyGrid, OccupancyMap, Voxel

from support.voxels import build

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.0, near=0.2, far=4.0)
CELL = 0.05
BAND = {"min_height": 0.1, "max_height": 0.6}


def around(count, radius=1.9, height=1.1):
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False) + 0.3
    eyes = np.stack([radius * np.cos(angles), radius * np.sin(angles), np.full(count, height)], axis=1)
    return np.array([wv.look_at(eye, (0.05, 0.02, 0.3)) for eye in eyes])


def y_up(poses):
    """Return poses in the same world with x, y, z renamed z, x, y."""
    matrices = wv.core.poses.poses_to_matrices(np.asarray(poses, dtype=np.float64))
    return np.eye(4)[[1, 2, 0, 3]] @ matrices


@pytest.fixture(scope="module")
def depth():
    return wv.render(build(), CAMERA, around(6), outputs="depth").depth.numpy()


@pytest.fixture
def occupancy(device, depth):
    result = OccupancyMap(CELL, device=device)
    result.integrate(depth, CAMERA, around(6))
    return result


def expected_cells(occupancy, bounds, share):
    """Return the cells of a grid, column by column."""
    dense = occupancy.voxel_map(np.column_stack([bounds, (-1.0, 2.0)]))
    states, heights = dense.states.numpy(), dense.centers()[0, 0, :, 2]
    inside = (heights > BAND["min_height"]) & (heights < BAND["max_height"])
    cells = np.full(states.shape[1::-1], -1)
    for x, y in np.ndindex(states.shape[:2]):
        column = states[x, y, inside].tolist()
        if Voxel.SURFACE in column:
            cells[y, x] = 100
        elif Voxel.FREE in column and len(column) - column.count(Voxel.FREE) <= share * len(column):
            cells[y, x] = 0
    return cells


@pytest.mark.parametrize("share", [0.0, 0.3, 1.0])
def test_grid_has_the_columns_of_a_band(occupancy, share):
    bounds = [(-3.5, -3.2), (1.5, 1.0)]
    grid = occupancy.occupancy_grid(bounds, max_unknown=share, **BAND)
    assert grid.cells.dtype == np.int8
    assert grid.cells.shape == (84, 100)
    np.testing.assert_allclose(grid.origin, bounds[0])
    np.testing.assert_array_equal(grid.cells, expected_cells(occupancy, bounds, share))
    assert set(np.unique(grid.cells)) == {-1, 0, 100}


def test_grid_is_cut_to_what_is_known(occupancy):
    grid = occupancy.occupancy_grid(**BAND)
    rows, columns = grid.cells.shape
    for side in (grid.cells[0], grid.cells[-1], grid.cells[:, 0], grid.cells[:, -1]):
        assert (side != -1).any()
    x, y = grid.origin
    whole = occupancy.occupancy_grid([(x, y), (x + columns * CELL, y + rows * CELL)], **BAND)
    np.testing.assert_array_equal(grid.cells, whole.cells)
    outside = occupancy.occupancy_grid([(x - 1, y - 1), (x + 9, y + 9)], **BAND)
    assert (outside.cells != -1).sum() == (grid.cells != -1).sum()


def test_grid_shows_the_box_and_the_floor_beside_it(occupancy):
    grid = occupancy.occupancy_grid(**BAND)

    def at(x, y):
        column, row = np.floor((np.array([x, y]) - grid.origin) / CELL).astype(int)
        return grid.cells[row, column]

    assert at(0.21, 0.11) == at(0.48, -0.11) == 100  # front and back of the box
    assert at(-0.3, -0.3) == at(0.9, 0.6) == 0
    assert at(0.34, 0.02) in (-1, 100)  # in it
    assert at(*(np.array(grid.cells.shape[::-1]) * CELL + grid.origin - 0.01)) == -1  # out of all images


def test_y_up_grid_is_the_same(device, depth, occupancy):
    other = OccupancyMap(CELL, up="y", device=device)
    other.integrate(depth, CAMERA, y_up(around(6)))
    first, second = (one.occupancy_grid(**BAND) for one in (occupancy, other))
    assert (first.cells == second.cells).mean() > 0.99  # rounding decides in a few voxels
    np.testing.assert_allclose(first.origin, second.origin)
    assert second.up == "y"


def test_grid_becomes_a_message(occupancy, monkeypatch):
    ros_messages = pytest.importorskip("ros_messages")
    classes = ros_messages.install(monkeypatch)
    grid = occupancy.occupancy_grid(**BAND)
    made = wv.io.to_occupancy_grid(grid, frame_id="map", stamp=12.5, height=0.25)
    assert type(made) is classes["nav_msgs/msg/OccupancyGrid"]
    of_rosbags = wv.io.to_occupancy_grid(grid, frame_id="map", stamp=12.5, height=0.25, types=ros_messages.STORE)
    for message in (ros_messages.as_rosbags(made), of_rosbags):
        data = ros_messages.STORE.serialize_cdr(message, message.__msgtype__)
        read = ros_messages.STORE.deserialize_cdr(data, message.__msgtype__)
        assert (read.header.frame_id, read.header.stamp.sec, read.info.map_load_time.sec) == ("map", 12, 12)
        assert (read.info.height, read.info.width) == grid.cells.shape
        assert read.info.resolution == np.float32(CELL)
        place = read.info.origin.position
        np.testing.assert_allclose((place.x, place.y, place.z), (*grid.origin, 0.25))
        assert read.info.origin.orientation.w == 1.0
        np.testing.assert_array_equal(np.reshape(read.data, grid.cells.shape), grid.cells)


def room(device):
    """Return a room of 4 x 4 x 2.5 m with a box and a ball in it."""
    scene = wv.Scene(device=device)
    walls = trimesh.creation.box(bounds=[(-2.013, -2.021, -0.007), (1.987, 2.017, 2.509)])
    scene.add(walls, name="walls")
    scene.add(trimesh.creation.box((0.6, 0.5, 0.8)), name="box", pose=(0.9, 0.3, 0.4, 0, 0, 0.2, 0.98))
    scene.add(trimesh.creation.icosphere(radius=0.35), name="ball", pose=(-0.8, -0.6, 0.5, 0, 0, 0, 1))
    return scene


def test_rendered_mesh_is_where_the_surfaces_are(device):
    camera = wv.Camera.from_fov(200, 150, hfov=1.2, near=0.1, far=6.0)
    scene, side = room(device), 0.04
    eyes = [(-1.5, 1.5, 1.4), (1.6, -1.6, 1.2), (1.6, 1.6, 1.7), (-1.6, -1.7, 1.0)]
    poses = np.array([wv.look_at(eye, (0.1 * eye[1], 0, 0.7)) for eye in eyes])
    depth = wv.render(scene, camera, poses, outputs="depth").depth
    occupancy = OccupancyMap(side, device=device)
    occupancy.integrate(depth, camera, poses)
    mesh = occupancy.mesh()
    copy = wv.Scene(device=device)
    copy.add(mesh, name="map")
    views = wv.render(copy, camera, poses, outputs=("depth", "normals"))
    error = views.depth.numpy() - depth.numpy()
    assert np.isfinite(error).mean() > 0.97
    close = np.abs(error[np.isfinite(error)])
    assert np.median(close) < 0.5 * side
    assert (close < side).mean() > 0.8
    assert (close < 2 * side).mean() > 0.95
    # Fronts are on the free side.
    centers, normals = mesh.triangles_center, mesh.face_normals
    assert (occupancy.states((centers + 1.5 * side * normals).astype(np.float32)).numpy() == Voxel.FREE).mean() > 0.9
    # Distance from the surfaces themselves, by trimesh.
    random = np.random.default_rng(0)
    chosen = mesh.vertices[random.choice(len(mesh.vertices), 2000)]
    walls = np.abs(chosen - [(-0.013, -0.002, 1.251)]) - [2.0, 2.019, 1.258]
    ball = np.abs(np.linalg.norm(chosen - [-0.8, -0.6, 0.5], axis=1) - 0.35)
    turned = wv.core.poses.poses_to_matrices(np.array([0.9, 0.3, 0.4, 0, 0, 0.2, 0.98]))
    local = np.abs((chosen - turned[:3, 3]) @ turned[:3, :3]) - [0.3, 0.25, 0.4]
    box = np.abs(np.linalg.norm(np.maximum(local, 0), axis=1) + np.minimum(local.max(axis=1), 0))
    distance = np.minimum(np.minimum(np.abs(walls.max(axis=1)), ball), box)
    assert np.median(distance) < 0.4 * side
    assert np.quantile(distance, 0.99) < 1.5 * side


def test_mesh_of_one_voxel_is_closed(device):
    occupancy = OccupancyMap(1.0, device=device)
    camera = wv.Camera.from_fov(64, 64, hfov=1.6, near=0.1, far=20.0)
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((0.9, 0.9, 0.9)), name="cube", pose=(0.5, 0.5, 0.5, 0, 0, 0, 1))
    eyes = [(8, 1, 1), (-7, 1, 1.1), (1, 8, 1), (1, -7, 1), (1, 1.1, 8), (1, 1.2, -7)]
    poses = np.array([wv.look_at(eye, (0.5, 0.5, 0.5)) for eye in eyes])
    for _ in range(2):
        occupancy.integrate(wv.render(scene, camera, poses, outputs="depth").depth, camera, poses, max_range=12)
    mesh = occupancy.mesh()
    assert mesh.is_watertight
    assert mesh.volume > 0
    np.testing.assert_allclose(mesh.center_mass, 0.5, atol=1e-6)


def test_tsdf_becomes_a_map(device):
    """Distances from a ball that was measured from above, in float64."""
    side, low, radius = 0.05, np.array([-0.9, -0.85, -1.0]), 0.6
    centers = low + side * (np.moveaxis(np.indices((37, 35, 41)), 0, -1) + 0.5)
    exact = np.linalg.norm(centers, axis=-1) - radius
    weight = np.where((exact > -0.3) & (centers[..., 2] > -0.2), 3, 0).astype(np.uint8)
    distance = np.clip(exact, -0.2, 0.2).astype(np.float32)
    occupancy = OccupancyMap.from_tsdf(distance, weight, side, origin=low, device=device)
    expected = np.where(exact > 0.025, Voxel.FREE, np.where(exact < -0.025, Voxel.HIDDEN, Voxel.SURFACE))
    expected[weight == 0] = Voxel.UNKNOWN
    states = occupancy.states(centers.reshape(-1, 3).astype(np.float32)).numpy().reshape(exact.shape)
    np.testing.assert_array_equal(states, expected)
    assert set(np.unique(states)) == set(Voxel)
    assert (occupancy.voxel_map().states.numpy() != Voxel.UNKNOWN).sum() == (weight > 0).sum()
    chances = np.unique(occupancy.probabilities(centers.reshape(-1, 3).astype(np.float32)).numpy())
    np.testing.assert_allclose(chances[np.isfinite(chances)], [0.12, 0.97], atol=2e-4)
    assert occupancy._blocks.used_slots < 0.7 * len(np.unique(np.floor(centers.reshape(-1, 3) / (8 * side)), axis=0))
    distances = np.abs(np.linalg.norm(occupancy.mesh().vertices, axis=1) - radius)
    assert distances.max() < side


INVALID_TSDF = {
    r"distance must be floats of shape \(nx, ny, nz\), got int64 of \(2, 2, 2\)": {
        "distance": np.zeros((2, 2, 2), int)
    },
    r"weight must be numbers of shape \(2, 2, 2\), got float64 of \(2, 2\)": {"weight": np.ones((2, 2))},
    r"origin must be a multiple of the voxels' side, 0.1 m, along each axis": {"origin": (0.05, 0.0, 0.0)},
    r"origin must be a finite point x, y, z \[m\], got \[0.0\]": {"origin": [0.0]},
    r"origin must be at most 1073741824 voxels": {"origin": (1e9, 0, 0)},
    r"cell_size must be a positive number of meters, got -0.1": {"cell_size": -0.1},
}


@pytest.mark.parametrize("message", INVALID_TSDF)
def test_invalid_tsdf_raises(message):
    valid = {"distance": np.zeros((2, 2, 2)), "weight": np.ones((2, 2, 2)), "cell_size": 0.1}
    OccupancyMap.from_tsdf(**valid, device="cpu")
    with pytest.raises(ArrayError, match=message):
        OccupancyMap.from_tsdf(**{**valid, **INVALID_TSDF[message]}, device="cpu")


def test_invalid_conversions_raise(device, occupancy):
    with pytest.raises(ArrayError, match=r"max_height must be at least a voxel above min_height, 0.5 m, got 0.5"):
        occupancy.occupancy_grid(min_height=0.5, max_height=0.5)
    with pytest.raises(ArrayError, match="max_unknown must be a number from 0 to 1, got 2"):
        occupancy.occupancy_grid(max_unknown=2)
    with pytest.raises(ArrayError, match="bounds must be the lower and upper corner"):
        occupancy.occupancy_grid([(0, 0), (0, 1)])
    empty = OccupancyMap(CELL, device=device)
    with pytest.raises(ArrayError, match="bounds must be given for a map without images"):
        empty.occupancy_grid()
    assert (empty.occupancy_grid([(0, 0), (1, 1)]).cells == -1).all()
    with pytest.raises(ArrayError, match="the map must contain a surface"):
        empty.mesh()
    with pytest.raises(MessageError, match=r"grid must be a warpvis.maps.OccupancyGrid, got ndarray"):
        wv.io.to_occupancy_grid(np.zeros((2, 2)), frame_id="map")
    assert isinstance(occupancy.occupancy_grid(), OccupancyGrid)
