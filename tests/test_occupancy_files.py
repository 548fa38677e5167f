# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of files of occupancy maps: NumPy's, and OctoMap's octrees beside a recursive reader and octomap-python."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import FileFormatError
from warpvis.maps import OccupancyMap, Voxel

from support.voxels import build

CAMERA = wv.Camera.from_fov(160, 120, hfov=1.0, near=0.2, far=4.0)
POSES = np.array([wv.look_at((1.9, 0.3, 1.1), (0, 0, 0.3)), wv.look_at((-1.2, -1.5, 1.2), (0.1, 0, 0.2))])
OPTIONS = {"bounds": [(-1.5, -1.2, -0.2), (1.5, 1.2, 1.3)], "hit": 0.8, "miss": 0.3, "minimum": 0.1, "maximum": 0.9}
HEADER = b"# Octomap OcTree binary file\n# a comment\nid OcTree\nsize %d\nres 0.05\ndata\n"


@pytest.fixture(scope="module")
def depth():
    return wv.render(build(), CAMERA, POSES, outputs="depth").depth.numpy()


def measured(depth, device, cell=0.05, **options):
    result = OccupancyMap(cell, device=device, **options)
    result.integrate(depth, CAMERA, POSES)
    return result


def centers(occupancy):
    """Return the centers of all voxels of a map."""
    return occupancy.voxel_map().centers().reshape(-1, 3)


def read_tree(data):
    """Return side of a voxel, and the lower corner [voxels], side [voxels] and state of all leaves, recursively."""
    header, _, body = data.partition(b"\ndata\n")
    lines = dict(line.split() for line in header.decode().splitlines() if not line.startswith("#"))
    leaves, position, count = [], 0, 1

    def visit(corner, side):
        nonlocal position, count
        bits = int.from_bytes(body[position : position + 2], "little")
        position += 2
        half, inner = side // 2, []
        for child in range(8):
            code = bits >> 2 * child & 3
            place = corner[0] + half * (child & 1), corner[1] + half * (child >> 1 & 1), corner[2] + half * (child >> 2)
            count += code > 0
            if code == 3:
                inner.append(place)
            elif code:
                leaves.append((place, half, Voxel.FREE if code == 1 else Voxel.SURFACE))
        for place in inner:
            visit(place, half)

    visit((-32768,) * 3, 65536)
    assert position == len(body)
    assert count == int(lines["size"])
    return float(lines["res"]), leaves


def test_map_is_saved_whole(device, depth, tmp_path):
    occupancy = measured(depth, device, up="z", **OPTIONS)
    occupancy.save(tmp_path / "map.npz")
    loaded = OccupancyMap.load(tmp_path / "map.npz", device=device)
    assert (loaded.cell_size, loaded.up, loaded.device) == (occupancy.cell_size, occupancy.up, occupancy.device)
    assert (loaded.bounds[0] <= occupancy.voxel_map(OPTIONS["bounds"]).bounds[0]).all()
    for _ in range(2):  # as they were saved, and after another image, which depends on options and stored values
        points = centers(occupancy)
        assert (loaded.states(points).numpy() == occupancy.states(points).numpy()).all()
        np.testing.assert_array_equal(loaded.probabilities(points).numpy(), occupancy.probabilities(points).numpy())
        for one in (occupancy, loaded):
            one.integrate(0.9 * depth[:1], CAMERA, POSES[:1])
    assert set(np.unique(loaded.states(points).numpy())) == set(Voxel)
    assert loaded._blocks.used_slots == occupancy._blocks.used_slots


@pytest.mark.parametrize("suffix", [".npz", ".bt"])
def test_part_of_a_map_is_loaded(device, depth, tmp_path, suffix):
    path = tmp_path / f"map{suffix}"
    measured(depth, device).save(path)
    bounds = [(-0.8, -0.8, 0.0), (0.8, 0.8, 0.8)]
    part, whole = OccupancyMap.load(path, bounds=bounds, device=device), OccupancyMap.load(path, device=device)
    assert (part.voxel_map(bounds).states.numpy() == whole.voxel_map(bounds).states.numpy()).all()
    outside = np.array([(1.3, 0.0, 0.02)])
    assert part.states(outside).numpy() == [Voxel.UNKNOWN] != whole.states(outside).numpy()
    part.integrate(depth, CAMERA, POSES)
    assert part.states(outside).numpy() == [Voxel.UNKNOWN]


def test_empty_maps_are_saved(device, tmp_path):
    for name in ("map.npz", "map.bt"):
        OccupancyMap(0.25, device=device).save(tmp_path / name)
        loaded = OccupancyMap.load(tmp_path / name, device=device)
        assert loaded.cell_size == 0.25
        assert (loaded.bounds == 0).all()


def test_octree_has_the_measured_voxels(device, depth, tmp_path):
    occupancy, path = measured(depth, device), tmp_path / "map.bt"
    occupancy.save(path)
    side, leaves = read_tree(path.read_bytes())
    assert side == occupancy.cell_size
    dense = occupancy.voxel_map()
    states, low = dense.states.numpy(), np.round(np.array(dense.origin) / side).astype(int)
    found = np.zeros_like(states)
    for corner, size, state in leaves:
        x, y, z = np.array(corner) - low
        assert not found[x : x + size, y : y + size, z : z + size].any()
        found[x : x + size, y : y + size, z : z + size] = state
    np.testing.assert_array_equal(found, np.where(states == Voxel.HIDDEN, Voxel.UNKNOWN, states))
    # Cubes of one state are one leaf.
    assert len(leaves) < 0.25 * (found > 0).sum()
    assert max(size for _, size, _ in leaves) >= 8

    loaded = OccupancyMap.load(path, device=device)
    points = centers(occupancy)
    assert (loaded.states(points).numpy() == found.ravel()).all()
    chances = loaded.probabilities(points).numpy()
    np.testing.assert_allclose(np.unique(chances[np.isfinite(chances)]), [0.1192, 0.971], atol=2e-4)
    loaded.save(tmp_path / "again.bt")
    assert (tmp_path / "again.bt").read_bytes() == path.read_bytes()


def tree(*nodes, size):
    return HEADER % size + b"".join(node.to_bytes(2, "little") for node in nodes)


def chain(last, length):
    """Return the first nodes of an octree: `length` of them, each the first child of its parent, and a last one."""
    return [*(3 for _ in range(length)), last]


def test_large_leaves_need_no_voxels(device, tmp_path):
    path = tmp_path / "map.bt"
    # A free leaf of 2048 voxels a side and an occupied one beside it, at the lower end of the octree.
    path.write_bytes(tree(*chain(0b1001, 4), size=7))
    loaded = OccupancyMap.load(path, device=device)
    assert loaded._blocks.used_slots == 0
    inside = np.array([(0.5, 0.5, 0.5), (2047.5, 2047.5, 2047.5), (2048.5, 0.5, 0.5), (0.5, 2048.5, 0.5)])
    states = loaded.states((0.05 * (inside - 32768)).astype(np.float32)).numpy()
    assert states.tolist() == [Voxel.FREE, Voxel.FREE, Voxel.SURFACE, Voxel.UNKNOWN]
    # One octant of all space: too many blocks, unless bounds cut them.
    path.write_bytes(tree(0b01, size=2))
    with pytest.raises(FileFormatError, match=r"map\.bt: cannot be read as an occupancy map: .*; give it bounds"):
        OccupancyMap.load(path, device=device)
    part = OccupancyMap.load(path, bounds=[(-3, -3, -3), (3, 3, 3)], device=device)
    assert part.states([(-0.1, -0.1, -0.1), (0.1, -0.1, -0.1)]).numpy().tolist() == [Voxel.FREE, Voxel.UNKNOWN]


def test_octomap_reads_the_same(device, depth, tmp_path):
    octomap = pytest.importorskip("octomap")
    occupancy, path = measured(depth, device), tmp_path / "map.bt"
    occupancy.save(path)
    octree = octomap.OcTree(1.0)
    assert octree.readBinary(str(path).encode())
    assert octree.getResolution() == occupancy.cell_size
    points = np.random.default_rng(0).uniform(*occupancy.bounds, size=(20_000, 3))
    expected = occupancy.states(points.astype(np.float32)).numpy()
    assert (look_up(octomap, octree, points) == np.where(expected == Voxel.HIDDEN, Voxel.UNKNOWN, expected)).all()
    assert octree.writeBinary(str(tmp_path / "again.bt").encode())
    assert (tmp_path / "again.bt").read_bytes() == path.read_bytes()


def test_maps_of_octomap_are_read(device, tmp_path):
    octomap = pytest.importorskip("octomap")
    random, path = np.random.default_rng(0), tmp_path / "map.bt"
    points = random.normal(size=(3000, 3))
    points *= 2.0 / np.linalg.norm(points, axis=1, keepdims=True)
    octree = octomap.OcTree(0.1)
    octree.insertPointCloud(points, np.array([0.1, 0.2, 0.05]))
    assert octree.writeBinary(str(path).encode())
    loaded = OccupancyMap.load(path, device=device)
    points = random.uniform(-2.5, 2.5, size=(20_000, 3))
    states = loaded.states(points.astype(np.float32)).numpy()
    assert (states == look_up(octomap, octree, points)).all()
    assert {Voxel.UNKNOWN, Voxel.FREE, Voxel.SURFACE} == set(np.unique(states))
    loaded.save(tmp_path / "again.bt")
    assert (tmp_path / "again.bt").read_bytes() == path.read_bytes()


def look_up(octomap, octree, points):
    def state(point):
        try:
            return Voxel.SURFACE if octree.isNodeOccupied(octree.search(point)) else Voxel.FREE
        except octomap.NullPointerException:
            return Voxel.UNKNOWN

    return np.array([state(point) for point in points])


DAMAGED = {
    "it does not begin with '# Octomap OcTree binary file'": b"# Octomap OcTree file\nid OcTree\n",
    "its header has no line 'data'": b"# Octomap OcTree binary file\nid OcTree\nsize 9\nres 0.1\n",
    "its header must have lines 'size' and 'res'": b"# Octomap OcTree binary file\nsize 9\nres big\ndata\n",
    "must be positive, got 9 and -0.1": b"# Octomap OcTree binary file\nsize 9\nres -0.1\ndata\n",
    "its octree is incomplete": tree(*chain(0b01, 5)[:-1], size=7),
    "must have 8 nodes, as in its header, got 7": tree(*chain(0b01, 5), size=8),
    "more than 16 levels": tree(*chain(0b01, 16), size=18),
    "is a git-lfs pointer": b"version https://git-lfs.github.com/spec/v1\n",
}


@pytest.mark.parametrize("message", DAMAGED)
def test_damaged_octrees_raise(message, tmp_path):
    path = tmp_path / "map.bt"
    path.write_bytes(DAMAGED[message])
    with pytest.raises(FileFormatError, match=message) as caught:
        OccupancyMap.load(path, device="cpu")
    assert str(caught.value).startswith(f"{path}: ")


CHANGES = {
    "cell_size must be a positive number": {"cell_size": np.float64(np.nan)},
    "up must be": {"up": np.array("x")},
    "bounds must be the lower and upper corner": {"bounds": np.ones((2, 3))},
    "its array voxels must be int16 in rows of": {"voxels": np.zeros((1, 8, 8), dtype=np.int16)},
    "its arrays must have the same length": {"values": np.zeros(0, dtype=np.int16)},
    "its array values must be int16 in rows": {"values": np.zeros(3)},
    "it has a block twice": {"mixed_blocks": np.zeros((2, 3), np.int32), "voxels": np.zeros((2, 8, 8, 8), np.int16)},
    "the map must have at most": {"mixed_blocks": np.full((1, 3), 2**20, np.int32)},
    "its blocks must be at most 134217728 from the origin": {"mixed_blocks": np.full((1, 3), -(2**31), np.int32)},
    "expected an array mixed_blocks": {"mixed_blocks": None},
}


@pytest.mark.parametrize("message", CHANGES)
def test_damaged_archives_raise(message, tmp_path):
    path = tmp_path / "map.npz"
    occupancy = OccupancyMap(0.05, device="cpu")
    for _ in range(9):  # until some blocks are entirely free
        occupancy.integrate(np.full((1, 120, 160), 1.5, np.float32), CAMERA, POSES[:1])
    occupancy.save(path)
    with np.load(path) as archive:
        arrays = dict(archive) | {"mixed_blocks": archive["mixed_blocks"][:1], "voxels": archive["voxels"][:1]}
    arrays |= CHANGES[message]
    np.savez(path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(FileFormatError, match=message) as caught:
        OccupancyMap.load(path, device="cpu")
    assert str(caught.value).startswith(f"{path}: ")


def test_names_and_sizes_that_do_not_fit_raise(depth, tmp_path):
    occupancy = measured(depth, "cpu")
    for call in (occupancy.save, OccupancyMap.load):
        with pytest.raises(FileFormatError, match=r"must end in .npz or .bt, got '.ot'"):
            call(tmp_path / "map.ot")
    with pytest.raises(FileFormatError, match="cannot be written: No such file"):
        occupancy.save(tmp_path / "nowhere" / "map.npz")
    with pytest.raises(FileFormatError, match="cannot be read: No such file"):
        OccupancyMap.load(tmp_path / "map.bt")
    away = OccupancyMap(0.05, device="cpu")
    far = POSES.copy()
    far[:, 0] += 1700.0
    away.integrate(depth, CAMERA, far)
    with pytest.raises(FileFormatError, match=r"an OctoMap must end 1638.4 m from the origin"):
        away.save(tmp_path / "map.bt")
