# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of ray bundles cast in packets: the float64 reference, borders of cube faces, independence of order."""

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.rendering.casters.sorted_rays_cpu import prepare_rays
from warpvis.rendering.casters.sorted_rays_cuda import prepare_packets

from support.prepared_packets import prepare_all
from support.solids import build as build_solids
from support.table_packets import PATTERNS, Table, assert_views_match, scan, unit, with_gaps
from support.worlds import ALL, random_poses

STRAIGHT = np.array([0, 0, 0, 0, 0, 0, 1.0])


def assert_matches_reference(scene, camera, poses, **options):
    views = wv.render(scene, camera, poses, outputs=ALL, **options)
    assert_views_match(views, scene, camera, poses, **options)
    return views


@pytest.mark.smoke("*-gaps", "*-few rows", "*-borders", "*-column", "*-one")
@pytest.mark.parametrize("name", PATTERNS)
def test_room_matches_reference(name, device):
    scene = wv.scenes.PRESETS["room"].build(device)
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    assert_matches_reference(scene, PATTERNS[name], poses)


@pytest.mark.smoke("*-no order-clip", "*-lidar-occlude")
@pytest.mark.parametrize(
    ("name", "near_plane"),
    [
        ("lidar", "occlude"),
        ("lidar", "clip"),
        ("no order", "occlude"),
        ("no order", "clip"),
        ("planar", "clip"),
        ("planar, wide", "occlude"),
    ],
)
def test_solids_meshes_and_range_match_reference(name, near_plane, device):
    rng = np.random.default_rng(0)
    meshes = [trimesh.creation.box((0.5, 0.3, 0.7)), trimesh.creation.icosphere(subdivisions=1, radius=0.3)]
    scene = build_solids(device, random_poses(rng, 10, spread=2.0), extra=meshes)
    camera = Table(PATTERNS[name].table, PATTERNS[name].kind, near=0.5, far=2.0)
    poses = random_poses(rng, 2, spread=0.3)
    if near_plane == "clip" and device != "cpu":
        # On a GPU, rays are cast one by one: of a clipped solid they hit the triangles, packets the exact surface.
        views = wv.render(scene, camera, poses, outputs=ALL, near_plane="clip")
        twin = build_solids("cpu", random_poses(np.random.default_rng(0), 10, spread=2.0), extra=meshes)
        expected = wv.render(twin, camera, poses, outputs=ALL, near_plane="clip", caster="rays")
        np.testing.assert_array_equal(views.segmentation.numpy(), expected.segmentation.numpy())
        np.testing.assert_allclose(views.depth.numpy(), expected.depth.numpy(), rtol=1e-5)
    else:
        views = assert_matches_reference(scene, camera, poses, near_plane=near_plane)
    assert len(np.unique(views.segmentation.numpy())) >= 4
    assert np.isneginf(views.depth.numpy()).any() == (near_plane == "occlude")


def test_rays_on_face_borders_are_cast_once(device):
    """Inside a box, every ray hits a wall at a known distance."""
    half = np.array([2.0, 1.5, 2.5])
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box(2 * half), name="box")
    for camera in PATTERNS.values():
        known = np.isfinite(camera.rays).all(axis=-1)
        with np.errstate(divide="ignore"):
            expected = (half / np.abs(camera.rays)).min(axis=-1)
        depth = wv.render(scene, camera, STRAIGHT, outputs="depth").depth.numpy()[0]
        np.testing.assert_allclose(depth[known], expected[known], rtol=2e-6)
        assert np.isposinf(depth[~known]).all()


@pytest.mark.parametrize("name", PATTERNS)
def test_each_ray_has_one_lane(name):
    rays = PATTERNS[name].rays
    known = np.isfinite(rays).all(axis=-1)
    struct = prepare_rays(rays).struct
    place = struct.place.numpy()
    np.testing.assert_array_equal(np.sort(place[place >= 0]), np.flatnonzero(known))
    np.testing.assert_array_equal(struct.without_ray.numpy(), np.flatnonzero(~known))
    focal, lanes = float(struct.focal), np.flatnonzero(place >= 0)
    # Rounding errors are stored: the coordinates are those of the rays in the pinhole of their bundle.
    bundle = struct.bundle.numpy()
    which = np.searchsorted(bundle[:, 0], lanes // 4096, side="right") - 1
    shown = rays.reshape(-1, 3)[place[lanes]]
    along = [
        np.where(axis < 0, -1, 1) * shown[np.arange(len(lanes)), np.where(axis < 0, ~axis, axis)]
        for axis in bundle[which][:, 2:5].T
    ]
    for number, direction in (("u", along[0]), ("v", along[1])):
        value, rest = getattr(struct, number).numpy(), getattr(struct, f"rest_{number}").numpy()
        exact = value[lanes].astype(np.float64) + rest[lanes]
        np.testing.assert_allclose(exact, direction / along[2] * focal, rtol=1e-13, atol=1e-12)


@pytest.mark.parametrize("name", PATTERNS)
def test_bounds_contain_rays(name):
    """Rows of bounds are the least u and v and the greatest u and v of sixteen children."""
    struct = prepare_rays(PATTERNS[name].rays).struct
    has_ray = struct.place.numpy().reshape(-1, 16, 16) >= 0
    of_packets = struct.packet_bounds.numpy().reshape(-1, 4, 16)
    of_tiles, of_groups = (bounds.numpy().reshape(-1, 4, 16) for bounds in (struct.tile_bounds, struct.group_bounds))
    for axis, number in enumerate("uv"):
        positions = getattr(struct, number).numpy().reshape(has_ray.shape)
        low, high = of_packets[:, axis], of_packets[:, 2 + axis]
        assert ((low[..., None] <= positions) & (positions <= high[..., None]))[has_ray].all()
        for children, parents in ((of_packets, of_tiles), (of_tiles, of_groups)):
            low, high = parents[:, axis].ravel(), parents[:, 2 + axis].ravel()
            if len(low) == len(children):  # otherwise, groups of several bundles are padded
                assert (low <= children[:, axis].min(axis=1)).all() and (
                    high >= children[:, 2 + axis].max(axis=1)
                ).all()


@pytest.mark.parametrize("side", [0, 16, 32])
@pytest.mark.parametrize("name", PATTERNS)
def test_each_ray_has_one_pixel_of_a_packet(name, side):
    """On a GPU: near the pixel's center, with the exact position in the packet's image."""
    rays = PATTERNS[name].rays
    packets = prepare_all(rays, side, wp.get_device("cpu"))
    place, scale = packets.place.numpy(), packets.scale.numpy()
    np.testing.assert_array_equal(np.sort(place[place >= 0]), np.arange(rays.shape[0] * rays.shape[1]))
    there = scale > 0
    np.testing.assert_array_equal(np.sort(place[there]), np.flatnonzero(np.isfinite(rays).all(axis=-1)))
    frame = packets.frame.numpy()
    rows, inverse = frame[:, :9].reshape(-1, 3, 3), frame[:, 9:18].reshape(-1, 3, 3).transpose(0, 2, 1)
    np.testing.assert_allclose(rows @ inverse, np.broadcast_to(np.eye(3), rows.shape), atol=1e-9)
    assert (np.linalg.det(rows) > 0).all()
    packet, _ = np.nonzero(there)
    shown = np.einsum("nij,nj->ni", rows[packet], rays.reshape(-1, 3)[place[there]])
    points = packets.points.numpy().astype(np.float64)
    exact = points[there] + packets.rests.numpy()[there]
    np.testing.assert_allclose(exact, shown[:, :2] / shown[:, 2:], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(scale[there], 1 / shown[:, 2], rtol=1e-6)
    if side:
        centers = frame[:, None, 18:20] + pixels_of(side)
        assert (np.abs(points - centers).max(axis=1) <= frame[:, 20:22]).all()
    else:
        assert_anywhere_in_images(packets, there, points - frame[:, None, 18:20])


def assert_anywhere_in_images(packets, there, places):
    """Assert that points lie in images of 32x32 pixels, fill one axis, and match the bounds of each block."""
    assert ((places >= 0) & (places < 31)).all()
    many = there.sum(axis=1) > 2
    size = np.where(there[..., None], places, -1).max(axis=1) - np.where(there[..., None], places, 99).min(axis=1)
    np.testing.assert_allclose(size.max(axis=1)[many], 31, atol=0.01)
    bounds, points = packets.bounds.numpy(), packets.points.numpy().reshape(-1, 8, 32, 2)
    for block, rays, some in zip(bounds.reshape(-1, 4), points.reshape(-1, 32, 2), there.reshape(-1, 32), strict=True):
        if some.any():
            least, most = rays[some].min(axis=0), rays[some].max(axis=0)
            np.testing.assert_array_equal(block, [least[0], most[0], least[1], most[1]])
        else:
            assert block[0] > block[1]


def pixels_of(side):
    """Return the z-buffer's pixel positions: `Packet::index` of kernels/native/cuda/image.h, in blocks of 8 x 4."""
    at = np.zeros((side * side, 2))
    columns = side // 8
    for y, x in np.ndindex(side, side):
        block, pixel = y // 4 * columns + x // 8, y % 4 * 8 + x % 8
        at[block * 32 + (pixel + block % columns * (32 // columns)) % 32] = x, y
    return at


def test_lidar_scans_use_grid_packets():
    """Packets of lidars are squares of adjacent rays near their pixels' centers, though beams have azimuth offsets."""
    for lidar in (wv.sensors.lidars.ouster("OS1-128"), wv.sensors.lidars.vlp16()):
        prepared = prepare_packets(lidar.rays.reshape(lidar.height, lidar.width, 3), wp.get_device("cpu"))
        assert prepared.points is None
        assert all(packets.frame.numpy()[:, 20:22].max() < 0.3 for _, packets in prepared.packets(32))
    scattered = prepare_packets(PATTERNS["no order"].rays, wp.get_device("cpu"))
    assert not scattered.packets(32) and scattered.points.frame.shape[0] < 1.3 * 1500 / 256  # points per packet


@pytest.mark.slow
def test_large_lens_packets_match_single_rays(device):
    """Most of a lens's rays are in packets of 32x32, the rest in smaller ones."""
    matrix = [[330, 0, 319.5], [0, 330, 239.5], [0, 0, 1]]
    camera = wv.Camera.from_opencv(matrix, [-0.28, 0.06, 0, 0], 640, 480, far=50.0)
    prepared = prepare_packets(camera.rays, wp.get_device("cpu"))
    assert [[side for side, _ in prepared.packets(largest)] for largest in (32, 16, 8)] == [[32, 16], [16], [8]]
    for side in (32, 16, 8):
        groups = prepared.packets(side)
        assert prepared.count(side) == sum(packets.windows.shape[0] for _, packets in groups)
        places = np.concatenate([packets.place.numpy().ravel() for _, packets in groups])
        np.testing.assert_array_equal(np.sort(places[places >= 0]), np.arange(640 * 480))
    scene = wv.scenes.PRESETS["room"].build(device)
    pose = wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    fast, slow = (wv.render(scene, camera, pose, outputs=ALL, caster=caster) for caster in ("packets", "rays"))
    same = fast.segmentation.numpy() == slow.segmentation.numpy()
    assert same.mean() > 0.9999
    np.testing.assert_allclose(fast.depth.numpy()[same], slow.depth.numpy()[same], rtol=1e-5)


def lens_table():
    """Return a lens of 70 x 50 pixels, neither of which is a multiple of the tile size."""
    K = [[60.0, 0, 34.5], [0, 60.0, 24.5], [0, 0, 1]]
    camera = wv.Camera.from_opencv(K, [-0.28, 0.09, 0.001, -0.0005, 0.01], 70, 50)
    return Table(camera.rays.reshape(50, 70, 3), kind="z")


FINE = {
    "lens": lens_table(),
    "lens with gaps": Table(with_gaps(lens_table().table), kind="z"),
    "lidar": Table(scan(24, 200, 0.4)),  # blocks of two rows
    "few rows": Table(scan(4, 300, 0.3)),  # blocks of one row
}


@pytest.mark.parametrize("name", FINE)
def test_fits_bound_the_positions_of_rays(name):
    """Within the fit's error bounds; rows hold the coordinates of the rays."""
    camera = FINE[name]
    struct = prepare_rays(camera.rays).struct
    fits = struct.fit.numpy().astype(np.float64)
    place = struct.place.numpy().reshape(len(fits), 256)
    u, v = (getattr(struct, number).numpy().reshape(len(fits), 256) for number in "uv")
    in_rows_u, in_rows_v = (getattr(struct, number).numpy().reshape(len(fits), 256) for number in ("row_u", "row_v"))
    fitted = np.flatnonzero(fits[:, 9] > 0)
    assert len(fitted) >= 0.5 * ((place >= 0).sum(axis=1) >= 128).sum()
    packet, lane = np.divmod(np.arange(256), 16)
    for tile in fitted:
        (u0, v0, column_u, column_v, row_u, row_v, off_column, off_row, shift, spacing) = fits[tile]
        there, across = place[tile] >= 0, 2 ** int(shift)
        column, row = packet % 4 * across + lane % across, packet // 4 * (16 // across) + lane // across
        np.testing.assert_array_equal(in_rows_u[tile][row * 4 * across + column], u[tile])
        np.testing.assert_array_equal(in_rows_v[tile][row * 4 * across + column], v[tile])
        assert (np.abs(column_u * (u[tile] - u0) + column_v * (v[tile] - v0) - column) <= off_column)[there].all()
        assert (np.abs(row_u * (u[tile] - u0) + row_v * (v[tile] - v0) - row) <= off_row)[there].all()
        assert 0 < off_column < 1 and 0 < off_row < 1
        # The spacing is the longest step to the next column or row along u or v.
        steps = np.abs(np.linalg.inv([[column_u, column_v], [row_u, row_v]]))
        np.testing.assert_allclose(steps.max(), spacing, rtol=1e-4)
        # Fitted rows and columns are those of the table.
        y, x = np.divmod(place[tile][there], camera.width)
        assert len(np.unique(x - column[there])) == 1 and len(np.unique(y - row[there])) == 1


def fine_scene():
    """Return a scene of triangles smaller than the ray spacing, in front of and behind large ones."""
    scene, rng = wv.Scene(), np.random.default_rng(5)
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.8)
    ball.vertices *= 1 + 0.1 * rng.random((len(ball.vertices), 1))
    scene.add(ball, name="ball", pose=(0.1, 0.2, 2.0, 0, 0, 0, 1))
    scene.add(trimesh.creation.icosphere(subdivisions=4, radius=6.0), name="sky")
    scene.add(trimesh.creation.box((4, 0.1, 4)), name="floor", pose=(0, 1.2, 1, 0, 0, 0, 1))
    return scene


@pytest.mark.smoke("few rows")
@pytest.mark.parametrize("name", FINE)
def test_triangles_smaller_than_ray_spacing_match_reference(name):
    views = assert_matches_reference(fine_scene(), FINE[name], STRAIGHT[None])
    assert len(np.unique(views.segmentation.numpy())) >= 2


@pytest.mark.parametrize("culled", [True, False], ids=["culled", "excluded"])
def test_tiny_triangles_do_not_reveal_invisible_ones(culled, device):
    """A tetrahedron smaller than the ray spacing, in one leaf with a box around it: back faces, or excluded.

    Invisible triangles have an empty rectangle at the corner of a cube face, to which some rays are close.
    """
    camera = Table(scan(121, 240, 1.2))
    middle = camera.rays[60, 120]
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)]) * 0.005 + 1.5 * middle + (0.002, 0.001, 0)
    dot = corners.astype(np.float32), np.array([(0, 1, 2), (0, 2, 3), (0, 3, 1), (1, 3, 2)])
    scene, alone = wv.Scene(device=device), wv.Scene(device=device)
    for one in (scene, alone):
        one.add(dot, name="dot")
    scene.add(trimesh.creation.box((9, 9, 9)), name="around")
    options = {"cull_backfaces": True} if culled else {"exclude": np.array([[0, 1]], dtype=np.uint8)}
    views = wv.render(scene, camera, STRAIGHT[None], outputs=ALL, **options)
    assert set(np.unique(views.segmentation.numpy())) == {-1, 0}
    assert_views_match(views, alone, camera, STRAIGHT[None])


@pytest.mark.parametrize("name", FINE)
def test_results_are_independent_of_ray_order(name):
    """Rays that are not adjacent in the table have no fits, and separate packets."""
    scene, camera = fine_scene(), FINE[name]
    order = np.random.default_rng(4).permutation(camera.height * camera.width)
    mixed = Table(camera.rays.reshape(1, -1, 3)[:, order], camera.kind)
    assert not prepare_rays(mixed.rays).struct.fit.numpy().any()
    outputs = ("depth", "segmentation", "normals")
    one, other = (wv.render(scene, table, STRAIGHT, outputs=outputs) for table in (camera, mixed))
    for field in outputs:
        there = getattr(other, field).numpy()[0, 0]
        here = getattr(one, field).numpy()[0].reshape(there.shape)[order]
        if field == "depth":
            np.testing.assert_allclose(here, there, rtol=2e-6)
        else:
            np.testing.assert_array_equal(here, there)


def test_no_ray_passes_through_a_closed_ball(device):
    """Through all vertices and edge midpoints."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    middles = ball.vertices[ball.edges_unique].mean(axis=1)
    scene = wv.Scene(device=device)
    scene.add(ball, name="ball")
    rays = unit(np.concatenate([ball.vertices, middles]))[None]
    for offset in ((0, 0, 0), (0.3, -0.2, 0.1)):
        from_there = unit(np.concatenate([ball.vertices, middles]) - offset)[None]
        depth = wv.render(scene, Table(from_there), [*offset, 0, 0, 0, 1], outputs="depth").depth.numpy()
        assert np.isfinite(depth).all() and depth.max() < 2.5
    assert rays.shape[1] > 10000


def test_floor_at_grazing_angles(device):
    """Distances are the height over the sine, though 1 / z is a small difference."""
    scene, height = wv.Scene(device=device), 0.7
    scene.add(trimesh.creation.box((8000, 8000, 0.1)), name="floor", pose=(0, 0, -0.05, 0, 0, 0, 1))
    down = np.radians(np.geomspace(0.02, 30, 64))
    azimuth = np.linspace(-np.pi, np.pi, 80)
    a, d = np.meshgrid(azimuth, down)
    rays = np.stack([np.cos(d) * np.cos(a), np.cos(d) * np.sin(a), -np.sin(d)], axis=-1)
    depth = wv.render(scene, Table(rays), [0, 0, height, 0, 0, 0, 1], outputs="depth").depth.numpy()[0]
    np.testing.assert_allclose(depth, np.float32(height) / np.sin(d), rtol=1e-5)


@pytest.mark.parametrize("name", ["lidar", "no order", "planar"])
def test_images_are_independent_of_threads_and_batches(name, device):
    scene, camera = wv.scenes.PRESETS["room"].build(device), PATTERNS[name]
    poses = random_poses(np.random.default_rng(3), 5, spread=0.4)
    together = wv.render(scene, camera, poses, outputs=ALL, threads=1)
    shared = wv.Renderer(scene, camera, outputs=ALL, threads=3)
    for _ in range(2):
        again = shared.render(poses)
        for output in ALL:
            np.testing.assert_array_equal(getattr(again, output).numpy(), getattr(together, output).numpy())
    for view, pose in enumerate(poses):
        alone = shared.render(pose)
        for output in ALL:
            np.testing.assert_array_equal(getattr(alone, output).numpy()[0], getattr(together, output).numpy()[view])
    for output in ALL:  # one output does not depend on the others
        one = wv.render(scene, camera, poses, outputs=output)
        np.testing.assert_array_equal(getattr(one, output).numpy(), getattr(together, output).numpy())


def test_worlds_scales_instances_and_exclude_match_single_rays(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.icosphere(subdivisions=2, radius=0.4), name="ball", movable=True)
    scene.add(trimesh.creation.box((0.4, 0.5, 0.6)), name="cart", movable=True)
    scene.add_instances(
        trimesh.creation.cone(0.3, 0.8), random_poses(np.random.default_rng(5), 30, spread=3.0), movable=False
    )
    scene.add(trimesh.creation.box((9, 9, 9)), name="walls")
    rng = np.random.default_rng(6)
    arguments = {
        "object_poses": np.stack([random_poses(rng, 2, spread=1.5) for _ in range(3)]),
        "object_scales": rng.uniform(0.5, 2.0, (3, 2, 3)),
        "world_index": np.array([2, 0, 1, 2]),
        "exclude": rng.random((4, len(scene))) < 0.2,
    }
    poses = random_poses(rng, 4, spread=0.2)
    for camera in (PATTERNS["lidar"], PATTERNS["no order"]):
        fast, slow = (wv.render(scene, camera, poses, outputs=ALL, caster=c, **arguments) for c in ("packets", "rays"))
        same = fast.segmentation.numpy() == slow.segmentation.numpy()
        assert same.mean() > 0.999
        depth, expected = fast.depth.numpy()[same], slow.depth.numpy()[same]
        hit = np.isfinite(expected)
        assert (np.isfinite(depth) == hit).all() and 0.5 < hit.mean()
        assert (np.abs(depth[hit] - expected[hit]) > 1e-5 * np.maximum(1, expected[hit])).mean() < 1e-3


def test_table_without_rays_is_empty(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    views = wv.render(scene, Table(np.full((3, 4, 3), np.nan)), STRAIGHT, outputs=ALL)
    assert np.isposinf(views.depth.numpy()).all() and (views.segmentation.numpy() == -1).all()
    none = wv.render(scene, PATTERNS["lidar"], np.zeros((0, 7)), outputs=ALL)
    assert none.depth.shape == (0, 20, 72)


def test_caster_is_selected(device):
    scene = wv.scenes.PRESETS["room"].build(device)
    assert wv.Renderer(scene, PATTERNS["lidar"]).caster == "packets"
    assert wv.Renderer(scene, PATTERNS["lidar"], caster="rays").caster == "rays"
