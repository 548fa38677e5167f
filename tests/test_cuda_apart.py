# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Packets of rays with distinct origins on CUDA: images of an emulated warp, and packet eyes."""

import numpy as np
import pytest
import trimesh
import warp as wp
from apart_checks import (
    check_box,
    check_no_leaks,
    check_plate,
    check_soup,
    check_worlds,
    outlets,
    same_ranges,
    spread_out,
)
from cuda_emulator import Emulator, Variant, emulated_renderer

import warpvis as wv
from warpvis.cameras import Rays
from warpvis.rendering.casters.ray_bundles_cuda import MAX_EYE_OFFSET, packet_side
from warpvis.rendering.casters.ray_origins_cuda import group_rows
from warpvis.rendering.casters.sorted_rays_cuda import prepare_packets
from warpvis.sensors import lidars

from support.ray_patterns import assert_matches_reference, few_origins, sphere_of_rays
from support.worlds import ALL, assert_bits_equal

SQUARES = Variant(16, True, False, ray_table=True, origins=True)
POINTS = Variant(32, True, False, ray_table=True, points=256, origins=True)
SQUARES_MOVE = Variant(16, True, True, ray_table=True, origins=True)
POINTS_MOVE = Variant(32, True, True, ray_table=True, points=256, origins=True)
DEPTH = Variant(16, False, False, ray_table=True, origins=True)
KINDS = {"squares": (SQUARES, SQUARES_MOVE), "points": (POINTS, POINTS_MOVE)}


@pytest.fixture(scope="module")
def emulator(tmp_path_factory):
    return Emulator(tmp_path_factory.mktemp("apart_emulator"))


@pytest.fixture(params=KINDS)
def render(request, emulator):
    """Return a function like `warpvis.render` that casts packets of one kind."""

    def call(scene, pattern, poses, *, variant=None, outputs=ALL, cull_backfaces=False, **options):
        variant = variant or KINDS[request.param][bool(scene.bvh().struct.drawn_count)]
        made = emulated_renderer(emulator, variant, scene, pattern, outputs=outputs, cull_backfaces=cull_backfaces)
        return made.render(poses, **options)

    return call


@pytest.mark.smoke("points-0.05")
@pytest.mark.cxx
@pytest.mark.parametrize("size", [0.05, 1.0, 40.0])
def test_ranges_inside_a_box(size, render):
    check_box(render, size, (outlets(20, 100), spread_out(700)))


@pytest.mark.slow
@pytest.mark.cxx
@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("near", [0.004, 0.05, 1.0])
def test_triangles_near_the_origins_match_the_reference(near, cull_backfaces, render):
    check_soup(render, near, cull_backfaces, 450)


@pytest.mark.cxx
def test_rays_start_on_either_side_of_a_plate(render):
    check_plate(render)


@pytest.mark.smoke("squares")
@pytest.mark.cxx
@pytest.mark.parametrize("render", KINDS, indirect=True)
def test_room_matches_the_reference(render):
    scene = wv.scenes.PRESETS["room"].build("cpu")
    poses = np.array([wv.look_at(eye, (0.5, 0.4, 0.3)) for eye in ((0.1, 0.2, 0.9), (-0.8, 1.2, 1.5))])
    pattern = Rays(*(part.reshape(16, 25, 3) for part in (sphere_of_rays(400), few_origins(400))), near=0.4, far=2.0)
    views = render(scene, pattern, poses)
    assert_matches_reference(views, scene, poses, pattern)
    assert np.isposinf(views.depth.numpy()).any()


@pytest.mark.slow
@pytest.mark.cxx
@pytest.mark.parametrize("render", KINDS, indirect=True)
def test_no_ray_passes_between_triangles(render):
    check_no_leaks(render, 2)


@pytest.mark.slow
@pytest.mark.cxx
@pytest.mark.parametrize("render", KINDS, indirect=True)
def test_closed_mesh_from_outside(render):
    """Its back faces are skipped: from every origin they are hidden."""
    ball, scene = trimesh.creation.icosphere(subdivisions=3, radius=0.7), wv.Scene(device="cpu")
    scene.add(ball, name="ball")
    for away in (0.704, 2.0):
        pattern = Rays(*outlets(12, 40, radius=0.01))
        views = render(scene, pattern, [away, 0, 0, 0, 0, 0, 1.0])
        assert_matches_reference(views, scene, np.array([[away, 0, 0, 0, 0, 0, 1.0]]), pattern)
        assert np.isfinite(views.depth.numpy()).mean() > 0.01


@pytest.mark.slow
@pytest.mark.cxx
@pytest.mark.parametrize("render", KINDS, indirect=True)
def test_worlds_and_exclude_match_single_rays(render):
    check_worlds(render, Rays(*outlets(16, 40)), 0.999)


@pytest.mark.slow
@pytest.mark.cxx
def test_depth_alone(emulator):
    """Depth alone uses a separate kernel."""
    scene, pose = wv.scenes.PRESETS["room"].build("cpu"), wv.look_at((0.1, 0.2, 0.9), (0.5, 0.4, 0.3))
    pattern = Rays(*outlets(16, 32))
    one = emulated_renderer(emulator, DEPTH, scene, pattern, outputs=("depth",)).render(pose).depth.numpy()
    other = emulated_renderer(emulator, SQUARES, scene, pattern, outputs=ALL).render(pose).depth.numpy()
    shown = np.isfinite(other)
    assert shown.mean() > 0.2
    np.testing.assert_allclose(one[shown], other[shown], rtol=2e-6)


@pytest.mark.cxx
@pytest.mark.parametrize("origins", [False, True])
def test_smaller_packets_of_an_image_have_the_same_bits(emulator, origins):
    """A launch of few packets cuts images into windows, some of whose pixels have no ray."""
    preset = wv.scenes.PRESETS["blobs_77k"]
    scene, poses = preset.build("cpu"), preset.poses(1)
    azimuth, up = np.meshgrid(np.linspace(-0.4, 0.4, 50), np.linspace(-0.3, 0.3, 40))
    rays = np.stack([np.sin(azimuth), np.tan(up), np.cos(azimuth)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    pattern = Rays(rays, origins=0.03 * rays[..., [2, 1, 0]] if origins else None)
    whole, *cut = (
        emulated_renderer(emulator, variant, scene, pattern, outputs=ALL).render(poses)
        for variant in (
            Variant(side, True, False, ray_table=True, origins=origins, image_side=32) for side in (32, 16, 8)
        )
    )
    assert np.isfinite(whole.depth.numpy()).mean() > 0.1
    for views in cut:
        assert_bits_equal(whole, views)


@pytest.mark.smoke("vlp16")
@pytest.mark.parametrize("name", ["vlp16", "hdl64e", "OS1-128", "OS0-128"])
def test_packet_eyes_of_lidars_are_close_to_their_rays(name):
    """Rays pass close to the packet's eye and start in front of it; slots map back to the rays of the bundle."""
    lidar = getattr(lidars, name)() if hasattr(lidars, name) else lidars.ouster(name)
    shape = (lidar.height, lidar.width, 3)
    rays, origins = lidar.rays.reshape(-1, 3), lidar.origins.reshape(-1, 3)
    prepared = prepare_packets(rays.reshape(shape), wp.get_device("cpu"), origins.reshape(shape))
    assert prepared.eye_offset <= MAX_EYE_OFFSET
    found = []
    for _, packets in prepared.packets(16):
        place, image = packets.place.numpy(), packets.windows.numpy()[:, 0]
        words, frame = packets.eyes.numpy()[image], packets.frame.numpy()[image, :9].reshape(-1, 3, 3)
        there = place >= 0
        assert (packets.begins.numpy()[there] >= -1e-9).all()
        exact = packets.points.numpy().astype(np.float64) + packets.rests.numpy()
        aside, begin = packets.asides.numpy().astype(np.float64), packets.begins.numpy().astype(np.float64)
        # The slot's ray origin, transformed back to the camera frame.
        at = np.concatenate([exact * begin[..., None] + aside, begin[..., None]], axis=-1)
        starts = np.einsum("prk,pik->pir", np.linalg.inv(frame), at) + words[:, None, :3]
        np.testing.assert_allclose(starts[there], origins[place[there]], atol=1e-8)
        assert (np.abs(aside).max(axis=(1, 2)) <= words[:, 3:5].max(axis=1)).all()
        found.append(place[there])
    assert len(np.unique(np.concatenate(found))) == len(rays)


def test_oblique_rays_pass_close_to_their_eye():
    """The eye moves back along a packet's rays, not along the axis of its image, which may be oblique to them."""
    lidar = lidars.hdl64e()
    shape = (lidar.height, lidar.width, 3)
    prepared = prepare_packets(lidar.rays.reshape(shape), wp.get_device("cpu"), lidar.origins.reshape(shape))
    for _, packets in prepared.packets(16):
        assert packets.eyes.numpy()[:, 3:5].max() < 1.0  # [px m]


def test_lasers_with_similar_origins_share_packets():
    """On an HDL-64E, half of the lasers are left of the axis and half are right."""
    lidar = lidars.hdl64e()
    shape = (lidar.height, lidar.width, 3)
    index = np.arange(lidar.height * lidar.width).reshape(shape[:2])
    grouped = group_rows(index, lidar.rays.reshape(-1, 3), lidar.origins.reshape(-1, 3), 16)
    rows = grouped[:, 0][grouped[:, 0] >= 0] // lidar.width
    np.testing.assert_array_equal(np.sort(rows), np.arange(lidar.height))
    assert len(grouped) % 16 == 0
    directions, origins = lidar.rays.reshape(shape)[:, 0], lidar.origins.reshape(shape)[:, 0]
    left = directions[:, 0] * origins[:, 1] - directions[:, 1] * origins[:, 0] > 0
    for first in range(0, len(grouped), 16):
        group = grouped[first : first + 16, 0]
        assert len(set(left[group[group >= 0] // lidar.width])) == 1
    ouster = lidars.ouster("OS1-128")
    index = np.arange(ouster.height * ouster.width).reshape(ouster.height, ouster.width)
    assert group_rows(index, ouster.rays.reshape(-1, 3), ouster.origins.reshape(-1, 3), 16) is index


def test_distant_rays_exceed_the_eye_offset_limit():
    directions, origins = spread_out(2000, 0.05)
    prepared = prepare_packets(directions[None], wp.get_device("cpu"), origins[None])
    assert prepared.eye_offset > MAX_EYE_OFFSET


@pytest.mark.parametrize("name", ["vlp32c", "hdl64e"])
def test_rays_are_either_single_or_in_packets(name):
    """If nothing moves, rays outside of squares, or far from the eye of their square, are cast one by one."""
    lidar = getattr(lidars, name)()
    shape = (lidar.height, lidar.width, 3)
    rays, origins = lidar.rays.reshape(shape), lidar.origins.reshape(shape)
    limit = 0.9 * prepare_packets(rays, wp.get_device("cpu"), origins).eye_offset
    prepared = prepare_packets(rays, wp.get_device("cpu"), origins, limit)
    assert prepared.points is None and len(prepared.single)
    places = [packets.place.numpy().ravel() for _, packets in prepared.packets(16)]
    found = np.concatenate([prepared.single, *places])
    np.testing.assert_array_equal(np.sort(found[found >= 0]), np.arange(lidar.height * lidar.width))
    for _, packets in prepared.packets(16):
        assert packets.eyes.numpy()[:, 3:5].max() <= limit


def test_rays_from_one_point_are_never_single():
    """Single rays may pass through a vertex of a closed surface."""
    directions = spread_out(2000, 0.05)[0][None]
    prepared = prepare_packets(directions, wp.get_device("cpu"), max_eye_offset=MAX_EYE_OFFSET)
    assert prepared.points is not None and not len(prepared.single)


def test_few_packets_are_cut_into_smaller_ones():
    lidar = lidars.vlp16()
    shape = (lidar.height, lidar.width, 3)
    prepared = prepare_packets(lidar.rays.reshape(shape), wp.get_device("cpu"), lidar.origins.reshape(shape))
    assert prepared.count(32) == prepared.count(16) == 113 and prepared.count(8) == 4 * 113
    assert packet_side(prepared, 1, 132) == 8 and packet_side(prepared, 16, 132) >= 16


@pytest.mark.parametrize("name", ["vlp16", "OS0-128"])
def test_lidars_on_a_gpu(name, cuda):
    lidar = getattr(lidars, name)() if hasattr(lidars, name) else lidars.ouster(name)
    for preset in ("room", "blobs_77k"):
        scene, poses = wv.scenes.PRESETS[preset].build(cuda), wv.scenes.PRESETS[preset].poses(3)
        one, other = (wv.render(scene, lidar, poses, outputs=ALL, caster=caster) for caster in ("auto", "rays"))
        depth = one.depth.numpy()
        assert same_ranges(depth, other.depth.numpy()).mean() >= 0.9999
        assert (one.segmentation.numpy() == other.segmentation.numpy()).mean() >= 0.9999
        alone = wv.render(scene, lidar, poses[1:2], outputs=ALL)
        np.testing.assert_array_equal(alone.depth.numpy()[0], depth[1])
