# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Near planes that clip surfaces, as in OpenGL, or let near surfaces occlude."""

import numpy as np
import pytest

import warpvis as wv

from compare import wrong_depth
from support.near_plane import CAMERA, SOLIDS, assert_cut, assert_solid_is_cut, poses, scene
from support.worlds import ALL


@pytest.mark.smoke("*-packets-*", "*-rays-outputs1-True")
@pytest.mark.parametrize("cull_backfaces", [False, True])
@pytest.mark.parametrize("outputs", [("depth",), ("depth", "points", "labels", "segmentation"), ALL])
def test_clipped_surfaces_are_invisible(device, caster, outputs, cull_backfaces):
    options = {"outputs": outputs, "caster": caster, "cull_backfaces": cull_backfaces}
    made = scene(device)
    views = wv.Renderer(made, CAMERA, near_plane="clip", **options).render(poses())
    assert_cut(views, made, poses(), cull_backfaces)
    hidden = wv.Renderer(made, CAMERA, **options).render(poses()).depth.numpy()
    assert np.isneginf(hidden[:3]).mean() > 0.1
    assert (np.isfinite(views.depth.numpy()) & np.isneginf(hidden)).any(axis=(1, 2))[:2].all()


def test_camera_sees_past_clipped_housing(device, caster):
    """The first surface beyond the near plane is visible instead of the housing."""
    made = scene(device)
    views = wv.Renderer(made, CAMERA, near_plane="clip", caster=caster, outputs=("segmentation",)).render(poses()[:1])
    seen = {made.objects[index].name for index in np.unique(views.segmentation.numpy()) if index >= 0}
    assert {"ball", "wall"} <= seen and not {"housing", "sheet"} & seen


def test_modes_match_without_near_surfaces(device, caster):
    made, far_off = scene(device), np.array([wv.look_at((-3, 1, 1.5), (2, 0, 0))], dtype=np.float32)
    for cull_backfaces in (False, True):
        options = {"outputs": ALL, "caster": caster, "cull_backfaces": cull_backfaces}
        hides, cuts = (
            wv.Renderer(made, CAMERA, near_plane=way, **options).render(far_off) for way in ("occlude", "clip")
        )
        for name in ALL:
            np.testing.assert_array_equal(getattr(hides, name).numpy(), getattr(cuts, name).numpy(), err_msg=name)


def test_modes_match_without_near_plane(device, caster):
    camera = wv.Camera.from_fov(48, 36, hfov=1.2)
    made = scene(device)
    hides, cuts = (
        wv.Renderer(made, camera, near_plane=way, outputs=("depth",), caster=caster).render(poses()).depth.numpy()
        for way in ("occlude", "clip")
    )
    np.testing.assert_array_equal(hides, cuts)


@pytest.mark.parametrize("kind", SOLIDS)
def test_clipped_solids_match_their_triangles(kind, device, caster):
    def render(made, pose, cull_backfaces):
        options = {"near_plane": "clip", "cull_backfaces": cull_backfaces, "caster": caster, "outputs": ALL}
        return wv.Renderer(made, CAMERA, **options).render(pose)

    assert_solid_is_cut(kind, device, render)


def test_clipping_in_render_at(device, caster):
    made = scene(device)
    renderer = wv.Renderer(made, CAMERA, near_plane="clip", outputs=("depth",), caster=caster)
    y, x = np.mgrid[:36, :48]
    pixels = np.tile(np.stack([x + 0.5, y + 0.5], axis=-1).reshape(1, -1, 2), (len(poses()), 1, 1))
    at_points = renderer.render_at(poses(), pixels.astype(np.float32)).depth.numpy().reshape(-1, 36, 48)
    assert wrong_depth(at_points, renderer.render(poses()).depth.numpy().astype(np.float64)).mean() < 1e-3


def test_invalid_near_plane_is_rejected(device):
    with pytest.raises(wv.WarpvisError, match='near_plane must be "occlude" or "clip"'):
        wv.Renderer(scene(device), CAMERA, near_plane="cut")
