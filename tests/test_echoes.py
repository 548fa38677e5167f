# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Incidence, intensity and returns of lidar beams, against closed forms and kernel references."""

import math

import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis import cameras, sensors

import reference

OUTPUTS = ("depth", "points", "normals", "labels", "segmentation")
AT_ORIGIN = np.array([0.0, 0, 0, 0, 0, 0, 1])


def room(device):
    """Return a box of 8 x 6 x 4 m around the origin with a wall at x = 2 in its left half."""
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((8, 6, 4)), name="room", label=wv.Label.OBSTACLE)
    wall = trimesh.creation.box((0.1, 3, 4))
    scene.add(wall, name="wall", pose=(2.05, 1.5, 0, 0, 0, 0, 1), label=wv.Label.OBJECT)
    return scene


def turned(yaw, place=(0.0, 0.0, 0.0)):
    return np.array([*place, 0, 0, math.sin(yaw / 2), math.cos(yaw / 2)])


def test_ranges_in_a_box_match_the_closed_form(device):
    scene = wv.Scene(device=device)
    scene.add(trimesh.creation.box((8, 6, 4)), name="room")
    rays = sensors.lidars.even(16, (-0.5, 0.5))
    place = np.array([1.0, -0.5, 0.3])
    views = wv.render(scene, rays, turned(0.4, place), outputs=OUTPUTS)
    d = rays.directions @ np.array([[math.cos(0.4), math.sin(0.4), 0], [-math.sin(0.4), math.cos(0.4), 0], [0, 0, 1]])
    with np.errstate(divide="ignore"):
        to_walls = (np.sign(d) * [4, 3, 2] - place) / d
    expected = np.nanmin(to_walls, axis=-1)
    np.testing.assert_allclose(views.depth.numpy()[0], expected, atol=1e-5)
    incidence = sensors.measure_incidence(views, rays, turned(0.4, place)).numpy()[0]
    side = np.argmin(to_walls, axis=-1)
    np.testing.assert_allclose(incidence, np.abs(np.take_along_axis(d, side[..., None], -1)[..., 0]), atol=1e-5)


def test_points_in_a_sphere_have_its_radius(device):
    """Between the radii of the sphere inscribed in the triangles' planes and of the one through the vertices."""
    ball = trimesh.creation.icosphere(5, 3.0)
    least = np.abs((ball.face_normals * ball.triangles[:, 0]).sum(-1)).min()
    scene = wv.Scene(device=device)
    scene.add(ball, name="ball")
    for rays in (sensors.lidars.ouster("OS1-64", "512x10"), sensors.lidars.hdl64e(20.0)):
        views = wv.render(scene, rays, AT_ORIGIN, outputs="depth")
        cloud = sensors.point_clouds(views, rays, organized=True)[0]
        radius = np.sqrt(sum(cloud[axis].astype(np.float64) ** 2 for axis in "xyz"))
        assert radius.shape == rays.directions.shape[:2]
        assert least - 1e-5 < radius.min() and radius.max() < 3.0 + 1e-5
        assert 3.0 - least < 1.1e-3


def test_kernels_match_their_references(device):
    scene, rays = room(device), sensors.lidars.even(8, (-0.4, 0.4), increment=0.1)
    poses = np.stack([turned(0.0), turned(0.7, (-1, 0.5, 0.2))])
    views = wv.render(scene, rays, poses, outputs=OUTPUTS)
    incidence = sensors.measure_incidence(views, rays, poses)
    w_first = sensors.measure_incidence(views, rays, poses[:, [0, 1, 2, 6, 3, 4, 5]], quaternion="wxyz")
    np.testing.assert_array_equal(w_first.numpy(), incidence.numpy())
    twin = reference.measure_incidence(poses, rays.directions, views.normals.numpy())
    np.testing.assert_allclose(incidence.numpy(), twin, atol=1e-6)
    shares = np.array([0.3, 0.9])
    for falls_off in (False, True):
        found = sensors.reflect(scene, views, incidence, shares, falls_off=falls_off)
        images = [image.numpy() for image in (views.depth, incidence, views.segmentation)]
        twin = reference.reflect_rays(*images, shares, falls_off=falls_off)
        np.testing.assert_allclose(found.numpy(), twin, rtol=1e-5)


@pytest.mark.parametrize("keep", ["strongest", "last", "dual"])
def test_returns_match_their_reference(device, keep):
    rng = np.random.default_rng(7)
    depth = rng.choice([1.0, 1.2, 1.6, 3.0, 3.3, 9.0, np.inf, -np.inf], (2, 5, 12 * 7)).astype(np.float32)
    depth += np.where(np.isfinite(depth), rng.uniform(0, 0.01, depth.shape), 0).astype(np.float32)
    depth[0, 0, :7], depth[0, 1, :7], depth[0, 2, :7] = -np.inf, np.inf, 2.0
    intensity = rng.uniform(0, 1, depth.shape).astype(np.float32)
    arrays = [wp.array(values, dtype=wp.float32, device=device) for values in (depth, intensity)]
    found = sensors.gather_returns(*arrays, 7, keep=keep, separation=0.45, min_intensity=0.05)
    ranges, strengths = reference.gather_returns(depth, intensity, 7, 0.45, 0.05, keeps_last=keep == "last")
    kept = 2 if keep == "dual" else 1
    np.testing.assert_allclose(found.range.numpy(), ranges[:, :kept], rtol=1e-5)
    np.testing.assert_allclose(found.intensity.numpy(), strengths[:, :kept], rtol=1e-5)
    again = sensors.gather_returns(*arrays, 7, keep=keep, separation=0.45, min_intensity=0.05, out=found)
    assert again is found


def test_beam_at_an_edge_returns_twice(device):
    """The wall's edge is at y = 0, 2 m ahead; the room's wall is 4 m ahead."""
    scene = room(device)
    ahead = cameras.Rays(np.array([[[1.0, 0, 0], [1.0, 0.2, 0], [1.0, -0.2, 0]]]) / [[[1], [1.04**0.5], [1.04**0.5]]])
    beams = sensors.spread_beams(ahead, 0.02, 64)
    assert beams.directions.shape == (1, 192, 3)
    cosines = (beams.directions.reshape(1, 3, 64, 3) * ahead.directions[:, :, None]).sum(-1)
    assert np.arccos(cosines.min()) <= 0.01 + 1e-9
    views = wv.render(scene, beams, AT_ORIGIN, outputs=OUTPUTS)
    incidence = sensors.measure_incidence(views, beams, AT_ORIGIN)
    strength = sensors.reflect(scene, views, incidence, {"wall": 0.5})
    dual = sensors.gather_returns(views.depth, strength, 64, keep="dual")
    ranges, strengths = dual.range.numpy()[0, :, 0], dual.intensity.numpy()[0, :, 0]
    np.testing.assert_allclose(ranges[:, 0], [4, 2], atol=2e-3)  # the room's wall has twice the reflectivity
    np.testing.assert_allclose(strengths[:, 0], [0.5, 0.25], atol=0.02)
    np.testing.assert_allclose(ranges[:, 1], [2 * 1.04**0.5, np.inf], atol=2e-3)
    np.testing.assert_allclose(ranges[:, 2], [4 * 1.04**0.5, np.inf], atol=2e-3)
    last = sensors.gather_returns(views.depth, strength, 64, keep="last").range.numpy()[0, 0, 0]
    np.testing.assert_allclose(last, [4, 2 * 1.04**0.5, 4 * 1.04**0.5], atol=2e-3)
    weak = sensors.gather_returns(views.depth, strength, 64, keep="dual", min_intensity=0.3).range.numpy()[0, :, 0, 0]
    np.testing.assert_allclose(weak, [4, np.inf], atol=2e-3)


def test_ray_list_equals_an_image_of_one_row(device):
    scene, pose = room(device), turned(0.3)
    image = sensors.lidars.even(1, (0.0, 0.0), increment=0.05)
    row = cameras.Rays(image.directions[0], axes="ros_body")
    found = []
    for rays in (image, row):
        beams = sensors.spread_beams(rays, 0.05, 5)
        views = wv.render(scene, beams, pose, outputs=OUTPUTS)
        incidence = sensors.measure_incidence(views, beams, pose)
        strength = sensors.reflect(scene, views, incidence, 0.5, falls_off=True)
        returns = sensors.gather_returns(views.depth, strength, 5, keep="dual", separation=0.1)
        assert returns.range.shape == (1, 2, *rays.shape) and incidence.shape == (1, *beams.shape)
        cloud = sensors.point_clouds(views, beams, intensity=strength, incidence=incidence)[0]
        found.append([incidence.numpy().ravel(), returns.range.numpy().ravel(), cloud["x"], cloud["intensity"]])
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_incidence_supports_pose_conventions(device):
    """A lidar pose, and a camera pose whose optical axis is the lidar's x axis."""
    scene, rays, pose = room(device), sensors.lidars.even(4, (-0.4, 0.4), increment=0.1), turned(0.3, (0.5, 0.2, 0.1))
    optical = wv.look_at(pose[:3], pose[:3] + [math.cos(0.3), math.sin(0.3), 0])
    views = wv.render(scene, rays, pose, outputs=OUTPUTS)
    own = sensors.measure_incidence(views, rays, pose).numpy()
    np.testing.assert_allclose(
        sensors.measure_incidence(views, rays, optical, convention="opencv").numpy(), own, atol=1e-5
    )
    other = wv.render(scene, rays, optical, convention="opencv", outputs="depth").depth.numpy()
    np.testing.assert_allclose(other, views.depth.numpy(), atol=1e-4)


BAD = {
    "no rays": (lambda scan: sensors.spread_beams(wv.Camera.kinect(), 0.1), "rays must be warpvis.cameras.Rays"),
    "a cone too wide": (lambda scan: sensors.spread_beams(scan[1], 7.0), "divergence must be from 0 to 3.14"),
    "no images": (
        lambda scan: sensors.measure_incidence(wv.Views(), scan[1], AT_ORIGIN),
        "views must have normals. Add it to outputs.",
    ),
    "other poses": (
        lambda scan: sensors.measure_incidence(scan[0], scan[1], np.tile(AT_ORIGIN, (3, 1))),
        r"normals must have shape \(3, 2, 63\), got \(1, 2, 63\)",
    ),
    "an unknown object": (
        lambda scan: sensors.reflect(scan[2], scan[0], scan[0].depth, {"door": 0.5}),
        "the scene has no object 'door', given in reflectivity",
    ),
    "a reflectivity too few": (
        lambda scan: sensors.reflect(scan[2], scan[0], scan[0].depth, [0.5]),
        "reflectivity must be 2 numbers from 0 up, one for each object",
    ),
    "beams of another number": (
        lambda scan: sensors.gather_returns(scan[0].depth, scan[0].depth, 5),
        "depth must have 5 columns for each beam, got 63 columns",
    ),
    "unknown returns": (
        lambda scan: sensors.gather_returns(scan[0].depth, scan[0].depth, 7, keep="first"),
        'keep must be "strongest", "last" or "dual", got .first.',
    ),
}


@pytest.mark.parametrize("name", BAD)
def test_invalid_arguments_raise_one_sentence(name):
    call, message = BAD[name]
    scene, rays = room("cpu"), sensors.lidars.even(2, (-0.1, 0.1), increment=0.1)
    with pytest.raises(wv.WarpvisError, match=message) as found:
        call((wv.render(scene, rays, AT_ORIGIN, outputs=OUTPUTS), rays, scene))
    assert "\n" not in str(found.value)


def test_rays_are_evenly_distributed_in_the_cone(device):
    middle = sensors.lidars.laser_scan(0.0, 3.0, 1.0)
    beams = sensors.spread_beams(middle, 0.1, 400)
    angle = np.arccos((beams.directions.reshape(4, 400, 3) * middle.directions.reshape(4, 1, 3)).sum(-1))
    for share in (0.25, 0.5, 0.75):
        inside = (np.tan(angle) < math.tan(0.05) * math.sqrt(share)).mean(axis=1)
        np.testing.assert_allclose(inside, share, atol=0.01)
    one = sensors.spread_beams(middle, 0.1, 1)
    np.testing.assert_allclose(one.directions, middle.directions, atol=1e-15)


def test_beams_keep_origins_times_and_rings():
    rays = sensors.lidars.vlp16(20.0)
    beams = sensors.spread_beams(rays, 0.003, 3)
    for name in ("origins", "times", "rings"):
        np.testing.assert_array_equal(getattr(beams, name)[:, 1::3], getattr(rays, name))
    assert (beams.near, beams.far) == (rays.near, rays.far)


def test_ranges_match_mujoco_rays(device):
    import mujoco

    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><geom name="floor" type="plane" size="9 9 1"/><geom name="box" type="box" size="1 .5 .5" '
        'pos="3 1 .5" euler="0 0 30"/><geom name="ball" size=".7" pos="-2 1 .9"/><geom name="post" type="capsule" '
        'size=".1 1" pos="0 -2 1"/></worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene = wv.mujoco.scene_from_mujoco(model, device=device).scene
    rays, pose = sensors.lidars.vlp32c(20.0, far=50.0), turned(0.3, (0.2, 0.1, 0.8))
    depth = wv.render(scene, rays, pose, outputs="depth").depth.numpy()[0]
    c, s = math.cos(0.3), math.sin(0.3)
    rotation = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    geom, differences = np.zeros(1, dtype=np.int32), []
    for row in range(32):
        for column in range(0, depth.shape[1], 37):
            start = rotation @ rays.origins[row, column] + pose[:3]
            along = rotation @ rays.directions[row, column]
            found = mujoco.mj_ray(model, data, start, along, None, 1, -1, geom)
            expected = found if 0 <= found <= 50 else np.inf
            differences.append(0.0 if expected == depth[row, column] else abs(expected - depth[row, column]))
    assert np.median(differences) < 1e-6
    # Rounded geoms have the silhouettes of their triangles: a ray may just miss one.
    assert np.mean(np.array(differences) < 1e-4) > 0.99
