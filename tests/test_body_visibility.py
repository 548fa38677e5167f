# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Visible fractions of bodies of several geoms in many worlds, compared with counted pixels."""

from concurrent.futures import ThreadPoolExecutor

import mujoco
import numpy as np
import pytest
import warp as wp
from gymnasium_environments import MJCF

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError, SceneError
from warpvis.kernels.mujoco import body_visibility as kernels
from warpvis.mujoco import BatchRenderer, camera_poses

import reference

# A tray carries a mug of three overlapping geoms; a board may hide it.
NESTED = """
<mujoco>
  <visual><map znear="0.05" zfar="8"/></visual><statistic extent="1"/>
  <worldbody>
    <geom name="floor" type="plane" size="3 3 .1"/>
    <body name="tray" pos="0 1.5 .3"><freejoint/>
      <geom name="plate" type="box" size=".2 .15 .02"/>
      <body name="mug" pos="0 0 .1">
        <geom type="cylinder" size=".06 .08"/><geom type="sphere" size=".07" pos="0 0 .05"/>
        <geom type="capsule" size=".015" fromto="0 0 .05 .12 0 .05"/>
        <body name="spoon" pos="0 0 .12"><geom type="box" size=".01 .01 .08"/></body>
      </body>
    </body>
    <body name="board" mocap="true" pos="0 .8 .4"><geom name="panel" type="box" size=".15 .02 .2"/></body>
    <body name="empty" pos="0 0 2"/>
    <camera name="eye" pos="0 0 .5" xyaxes="1 0 0 0 .1 1" fovy="50"/>
    <camera name="side" pos="1.6 1.4 .6" xyaxes="0 1 0 -.2 0 1" fovy="40"/>
  </worldbody>
</mujoco>
"""
WIDTH, HEIGHT = 32, 24
BODIES = ["tray", "mug", "spoon", "board"]


def worlds_of(model, count, seed=0):
    """Return data in which a tray and a board are at random places, some of them out of view."""
    rng, worlds = np.random.default_rng(seed), []
    for _ in range(count):
        data = mujoco.MjData(model)
        data.qpos[:3] += rng.uniform([-1, -0.5, -0.1], [1, 0.5, 0.4])
        data.qpos[3:7] = rng.normal(size=4)
        data.mocap_pos[0, 0] = rng.uniform(-0.4, 0.4)
        mujoco.mj_forward(model, data)
        worlds.append(data)
    return worlds


def alone(model, geoms):
    """Return a copy of a model that shows some geoms only."""
    other = mujoco.MjModel.from_xml_string(NESTED)
    other.geom_rgba[~np.isin(np.arange(model.ngeom), geoms), 3] = 0
    return other


def descendants(model, body):
    """Return a body and all bodies below it."""
    found = [body]
    found += [k for k in range(body + 1, model.nbody) if model.body_parentid[k] in found]
    return [k for k in range(model.nbody) if k == body or _is_below(model, k, body)]


def _is_below(model, body, ancestor):
    while body > 0:
        body = model.body_parentid[body]
        if body == ancestor:
            return True
    return False


@pytest.mark.parametrize("subtree", [False, True])
def test_a_body_is_the_union_of_its_geoms(device, subtree):
    model = mujoco.MjModel.from_xml_string(NESTED)
    worlds = worlds_of(model, 6)
    batch = BatchRenderer(model, width=WIDTH, height=HEIGHT, outputs=("segmentation", "depth"), device=device)
    found = batch.visibility(worlds, bodies=BODIES, subtree=subtree, min_samples=1)
    geoms = batch.geom_ids(batch.render(worlds)).numpy().reshape(2, 6, HEIGHT, WIDTH).transpose(1, 0, 2, 3)
    counted = {"partly": 0, "none": 0}
    for k, body in enumerate(found.bodies):
        assert model.body(body).name == found.names[k] == BODIES[k]
        mine = np.isin(model.geom_bodyid, descendants(model, body) if subtree else [body])
        shows = np.append(mine, False)[geoms]
        assert np.array_equal(found.visible_pixels.numpy()[..., k], shows.sum(axis=(2, 3)))

        # The silhouette: the same cameras with three times as many pixels of the same size see the body alone.
        isolated = alone(model, np.flatnonzero(mine))
        isolated.cam_fovy[:] = np.degrees(2 * np.arctan(3 * np.tan(np.radians(model.cam_fovy) / 2)))
        wide = BatchRenderer(isolated, width=3 * WIDTH, height=3 * HEIGHT, device=device)
        silhouette = np.isfinite(wide.render(worlds).depth.numpy()).reshape(2, 6, 3 * HEIGHT, 3 * WIDTH)
        silhouette = silhouette.transpose(1, 0, 2, 3)
        inside = silhouette[..., HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH]
        assert np.array_equal(found.silhouette_pixels.numpy()[..., k], silhouette.sum(axis=(2, 3)))
        assert np.allclose(found.image_share.numpy()[..., k], shows.mean(axis=(2, 3)))
        expected = shows.sum(axis=(2, 3)) / np.maximum(silhouette.sum(axis=(2, 3)), 1)
        assert np.allclose(found.fraction.numpy()[..., k], expected, atol=1e-7)
        for world, camera in np.ndindex(6, 2):
            reason = found.status.numpy()[world, camera, k]
            hidden = inside[world, camera] & ~shows[world, camera]
            occluder = found.occluders.numpy()[world, camera, k, 0]
            if shows[world, camera].any():
                assert reason == wv.Visibility.VISIBLE
            else:
                assert reason == (wv.Visibility.OCCLUDED if hidden.any() else wv.Visibility.OUT_OF_VIEW)
            if hidden.any():
                by = np.bincount(geoms[world, camera][hidden])
                assert by[batch.mujoco_scene.geom_ids[occluder]] == by.max()
            else:
                assert occluder == -1
            counted["partly"] += 0 < expected[world, camera] < 1
            counted["none"] += reason == wv.Visibility.OCCLUDED
    assert min(counted.values()) > 0


def test_shaped_values(device):
    model = mujoco.MjModel.from_xml_string(NESTED)
    worlds = worlds_of(model, 50, seed=1)
    batch = BatchRenderer(model, width=WIDTH, height=HEIGHT, outputs=("depth",), device=device)
    found = batch.visibility(worlds, bodies=BODIES[:2], cameras="eye", subtree=True, shaped=True)
    fraction, reason, shaped = (getattr(found, name).numpy()[:, 0] for name in ("fraction", "status", "shaped"))
    depth, camera, seen = batch.render(worlds, cameras="eye").depth.numpy(), batch.camera("eye"), set()
    for k, body in enumerate(found.bodies):
        geoms = np.flatnonzero(np.isin(model.geom_bodyid, descendants(model, body)))
        other = BatchRenderer(alone(model, geoms), width=WIDTH, height=HEIGHT, device=device)
        isolated = other.render(worlds, cameras="eye").depth.numpy()
        for world, data in enumerate(worlds):
            eye = poses_to_matrices(camera_poses(data, model, [0])[0])
            center = data.geom_xpos[geoms].mean(axis=0)
            distance = reference.distance_to_free(depth[world], isolated[world])
            angle = reference.angle_to_image(camera, eye[:3, :3].T @ (center - eye[:3, 3]))
            given = fraction[world, k], reason[world, k], found.box.numpy()[world, 0, k]
            expected = reference.shape_values(camera, *given, distance, angle)
            assert abs(shaped[world, k] - expected) < 1e-4
            seen.add((int(reason[world, k]), float(fraction[world, k]) == 1))
    assert len(seen) == 4, seen  # out of view, occluded, partly visible, and visible


def test_worlds_that_hide_geoms_or_see_wider(device):
    model = mujoco.MjModel.from_xml_string(NESTED)
    worlds = worlds_of(model, 3)
    batch = BatchRenderer(model, width=WIDTH, height=HEIGHT, device=device)
    colors, fovy = np.stack([model.geom_rgba] * 3), np.stack([model.cam_fovy] * 3)
    colors[1, model.geom("panel").id, 3] = 0
    fovy[2] = 90
    query = {"bodies": ["mug", "board"], "cameras": ["side", "eye"], "canvas": (3, 2, 1, 0)}
    found = batch.visibility(worlds, **query, model={"geom_rgba": colors, "cam_fovy": fovy})
    for world in range(3):
        other = mujoco.MjModel.from_xml_string(NESTED)
        other.cam_fovy[:] = fovy[world]
        single = BatchRenderer(other, width=WIDTH, height=HEIGHT, device=device)
        expected = single.visibility(worlds[world], **query, model={"geom_rgba": colors[world : world + 1]})
        for name in ("fraction", "status", "occluders", "silhouette_pixels", "box"):
            assert np.array_equal(getattr(found, name).numpy()[world], getattr(expected, name).numpy()[0]), name
    assert found.status.numpy()[1, :, 1].tolist() == [wv.Visibility.OUT_OF_VIEW] * 2
    chosen = batch.visibility(worlds, bodies=["mug"], worlds=[2, 0]).fraction.numpy()
    assert np.array_equal(chosen, batch.visibility(worlds, bodies=["mug"]).fraction.numpy()[[2, 0]])
    assert np.array_equal(chosen, batch.visibility([worlds[2], worlds[0]], bodies=["mug"]).fraction.numpy())


def test_kernels_equal_their_references(device):
    rng, members = np.random.default_rng(0), np.array([0, 1, 1, 0, 0], dtype=np.uint8)

    def on_device(array, **dtype):
        return wp.array(array, device=device, **dtype)

    hidden = rng.integers(0, 2, (2, 5)).astype(np.uint8)
    for given in (None, hidden):
        excluded = wp.zeros((2, 5), dtype=wp.uint8, device=device)
        inputs = [on_device(members), None if given is None else on_device(given), excluded]
        wp.launch(kernels.exclude_others, dim=(2, 5), inputs=inputs, device=device)
        assert np.array_equal(excluded.numpy(), reference.exclude_others(members, given, 2))

    poses = rng.normal(size=(2, 3, 7)).astype(np.float32)
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=-1, keepdims=True)
    local, columns = rng.normal(size=(5, 3)).astype(np.float32), np.array([0, -1, 2, 2, 1], dtype=np.int32)
    groups, worlds = np.stack([members, 1 - members]), np.array([1, 0, 1], dtype=np.int32)
    centers = wp.zeros((3, 2), dtype=wp.vec3, device=device)
    inputs = [
        on_device(local, dtype=wp.vec3),
        on_device(columns),
        on_device(poses, dtype=wp.transform),
        on_device(worlds),
    ]
    inputs += [on_device(groups), centers]
    wp.launch(kernels.body_centers, dim=(3, 2), inputs=inputs, device=device)
    for view, world in enumerate(worlds):
        frames = np.where(columns[:, None, None] < 0, np.eye(4), poses_to_matrices(poses[world])[columns])
        placed = (frames[:, :3, :3] @ local[..., None])[..., 0] + frames[:, :3, 3]
        assert np.allclose(centers.numpy()[view], reference.body_centers(placed, groups), atol=1e-5)


def test_no_occluders_through_cameras_with_different_lenses(device):
    model = mujoco.MjModel.from_xml_string(NESTED)
    batch, worlds = BatchRenderer(model, width=WIDTH, height=HEIGHT, device=device), worlds_of(model, 3)
    found = batch.visibility(worlds, bodies=BODIES, occluders=0)
    assert found.occluders.shape == found.occluder_shares.shape == (3, 2, 4, 0)
    assert np.array_equal(found.fraction.numpy(), batch.visibility(worlds, bodies=BODIES).fraction.numpy())


def test_concurrent_callers_get_their_own_fractions(device):
    model = mujoco.MjModel.from_xml_string(NESTED)
    batch = BatchRenderer(model, width=WIDTH, height=HEIGHT, device=device, threads=1)
    calls = [worlds_of(model, 4, seed) for seed in range(6)]

    def measure(i):
        found = batch.visibility(calls[i % 6], bodies=BODIES, shaped=True)
        return found.fraction.numpy().tobytes(), found.shaped.numpy().tobytes()

    expected = [measure(i) for i in range(6)]
    with ThreadPoolExecutor(6) as callers:
        for i, found in enumerate(callers.map(measure, range(90))):
            assert found == expected[i % 6], i


def test_bodies_without_geoms_and_other_bad_input():
    model = mujoco.MjModel.from_xml_string(NESTED)
    batch = BatchRenderer(model, width=8, height=6)
    data = worlds_of(model, 1)[0]
    for bodies, message in (
        (["cup"], "bodies must be names or ids of the model's bodies, such as 'world', 'tray', .*, got 'cup'"),
        ([99], "bodies must be names, or ids from 0 to 5, got 99"),
        ([1.5], "bodies must be names, or ids from 0 to 5, got 1.5"),
        ([], r"bodies must be one or more distinct bodies of the model, got \[\]"),
        ([1, "tray"], "bodies must be one or more distinct bodies"),
        (["empty"], "bodies must have rendered geoms, got 'empty' without any; subtree=True"),
    ):
        with pytest.raises(SceneError, match=message):
            batch.visibility(data, bodies=bodies)
    with pytest.raises(ArrayError, match="canvas must be four whole numbers"):
        batch.visibility(data, bodies=["mug"], canvas=(1, 2, 3))
    assert batch.visibility(data, bodies=["world"]).names == ("world",)


def test_other_environments_have_the_same_fractions():
    from gymnasium_environments import make_cup

    env = make_cup("DepthObservation", camera="front", objects=["cup"], width=40, height=30)
    model, batch = mujoco.MjModel.from_xml_string(MJCF), None
    batch = BatchRenderer(model, width=40, height=30)
    for seed in range(4):
        expected = env.reset(seed=seed)[0]["visible_fraction"]
        found = batch.visibility(env.unwrapped.data, bodies=["cup"], cameras="front")
        assert np.allclose(found.fraction.numpy()[0, 0], expected, atol=1e-6)
