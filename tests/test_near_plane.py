# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A near plane that cuts surfaces away, as OpenGL's does, beside one that lets them hide what is behind."""

import numpy as np
import pytest
import trimesh
from test_worlds import ALL

import warpvis as wv
from warpvis.scene import solids

from compare import assert_matches_reference, wrong_depth

CAMERA = wv.Camera.from_fov(48, 36, hfov=1.2, near=0.5, far=50.0)


def scene(device):
    """A room with a table, a box around one camera, a ball of triangles and a wall that one camera looks along."""
    made = wv.Scene(device=device)
    made.add(trimesh.creation.box((8, 6, 0.1)), name="floor", label="ground", pose=(0, 0, -1, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.1, 6, 4)), name="wall", pose=(4, 0, 0, 0, 0, 0, 1))
    made.add(trimesh.creation.box((0.6, 0.5, 0.4)), name="housing", label="object")
    made.add(trimesh.creation.icosphere(2, 0.4), name="ball", pose=(1.0, 0.2, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((0.3, 0.3, 0.3)), name="cube", pose=(2, -0.4, 0, 0, 0, 0.3, 0.954), movable=True)
    made.add(solids.capsule(0.2, 0.3), name="post", pose=(3, 1.5, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((0.02, 1, 1)), name="sheet", pose=(0.4, 0, 0, 0, 0, 0, 1))
    return made


def poses():
    """In the housing, before the ball so that the plane cuts it, in the ball, and above the floor, which it cuts."""
    eyes = [((0, 0, 0), (4, 0, 0)), ((0.45, 0.1, 0.05), (1, 0.2, 0)), ((1, 0.2, 0.1), (3, -0.5, 0))]
    eyes.append(((-1, 0, -0.7), (2, 0, -0.95)))
    return np.array([wv.look_at(eye, target) for eye, target in eyes], dtype=np.float32)


def assert_cut(views, scene, poses, cull_backfaces):
    """As the reference has it, with nothing that is too near, and every image saying the same of a pixel."""
    assert_matches_reference(views, scene, CAMERA, poses, cull_backfaces=cull_backfaces, near_plane="clip")
    depth = views.depth.numpy()
    assert not np.isneginf(depth).any() and depth.min() >= np.float32(CAMERA.near)


@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("outputs", [("depth",), ("depth", "points", "labels", "segmentation"), ALL])
def test_what_is_too_near_is_not_there(device, caster, outputs, cull_backfaces):
    options = {"outputs": outputs, "caster": caster, "cull_backfaces": cull_backfaces}
    made = scene(device)
    views = wv.Renderer(made, CAMERA, near_plane="clip", **options).render(poses())
    assert_cut(views, made, poses(), cull_backfaces)
    hidden = wv.Renderer(made, CAMERA, **options).render(poses()).depth.numpy()
    assert np.isneginf(hidden[:3]).mean() > 0.1
    assert (np.isfinite(views.depth.numpy()) & np.isneginf(hidden)).any(axis=(1, 2))[:2].all()


def test_a_camera_in_its_housing_sees_past_it(device, caster):
    """The first surface behind the plane, not the housing."""
    made = scene(device)
    views = wv.Renderer(made, CAMERA, near_plane="clip", caster=caster, outputs=("segmentation",)).render(poses()[:1])
    seen = {made.objects[index].name for index in np.unique(views.segmentation.numpy()) if index >= 0}
    assert {"ball", "wall"} <= seen and not {"housing", "sheet"} & seen


def test_where_nothing_is_near_nothing_changes(device, caster):
    made, far_off = scene(device), np.array([wv.look_at((-3, 1, 1.5), (2, 0, 0))], dtype=np.float32)
    for cull_backfaces in (False, True):
        options = {"outputs": ALL, "caster": caster, "cull_backfaces": cull_backfaces}
        hides, cuts = (
            wv.Renderer(made, CAMERA, near_plane=way, **options).render(far_off) for way in ("occlude", "clip")
        )
        for name in ALL:
            np.testing.assert_array_equal(getattr(hides, name).numpy(), getattr(cuts, name).numpy(), err_msg=name)


def test_no_near_plane_cuts_nothing(device, caster):
    camera = wv.Camera.from_fov(48, 36, hfov=1.2)
    made = scene(device)
    hides, cuts = (
        wv.Renderer(made, camera, near_plane=way, outputs=("depth",), caster=caster).render(poses()).depth.numpy()
        for way in ("occlude", "clip")
    )
    np.testing.assert_array_equal(hides, cuts)


SOLIDS = {"ball": solids.sphere(0.5), "cylinder": solids.cylinder(0.5, 0.5)}


def assert_solid_is_cut(kind, device, render):
    """A solid before the camera shows its inner side, within its triangles' tolerance; culled, what is behind it."""
    made = wv.Scene(device=device)
    made.add(SOLIDS[kind], name=kind, pose=(0.8, 0, 0, 0, 0, 0, 1), movable=True)
    made.add(trimesh.creation.box((0.1, 6, 6)), name="wall", pose=(3, 0, 0, 0, 0, 0, 1))
    pose = np.array([wv.look_at((0, 0, 0), (1, 0, 0))], dtype=np.float32)
    for cull_backfaces, expected in ((False, 1.3), (True, 2.95)):
        views = render(made, pose, cull_backfaces)
        depth, normals = views.depth.numpy()[0], views.normals.numpy()[0]
        assert abs(depth[18, 24] - expected) < 3e-3
        assert depth.min() >= np.float32(CAMERA.near)
        assert np.linalg.norm(normals[18, 24] - [-1, 0, 0]) < 0.1


@pytest.mark.parametrize("kind", SOLIDS)
def test_a_solid_that_is_cut_is_seen_by_its_triangles(kind, device, caster):
    def render(made, pose, cull_backfaces):
        options = {"near_plane": "clip", "cull_backfaces": cull_backfaces, "caster": caster, "outputs": ALL}
        return wv.Renderer(made, CAMERA, **options).render(pose)

    assert_solid_is_cut(kind, device, render)


def test_through_points_of_the_image(device, caster):
    made = scene(device)
    renderer = wv.Renderer(made, CAMERA, near_plane="clip", outputs=("depth",), caster=caster)
    y, x = np.mgrid[:36, :48]
    pixels = np.tile(np.stack([x + 0.5, y + 0.5], axis=-1).reshape(1, -1, 2), (len(poses()), 1, 1))
    at_points = renderer.render_at(poses(), pixels.astype(np.float32)).depth.numpy().reshape(-1, 36, 48)
    assert wrong_depth(at_points, renderer.render(poses()).depth.numpy().astype(np.float64)).mean() < 1e-3


def test_bad_input(device):
    with pytest.raises(wv.WarpvisError, match='near_plane must be "occlude" or "clip"'):
        wv.Renderer(scene(device), CAMERA, near_plane="cut")
