# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Textures on a scene's triangles match MuJoCo's pictures."""

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv

from support.lights import picture

SHAPES = """<mujoco><visual><headlight ambient="1 1 1" diffuse="0 0 0" specular="0 0 0"/>
<quality offsamples="0" numslices="64" numstacks="32" numquads="8"/></visual>
<asset><texture name="t" type="{kind}" builtin="flat" width="{width}" height="{width}"/>
<material name="m" texture="t" {more}/>
<mesh name="plain" vertex="-.6 -.4 -.3 .6 -.4 -.3 0 .5 -.3 0 0 .6"/>
<mesh name="own" vertex="-.6 -.4 -.3 .6 -.4 -.3 0 .5 -.3 0 0 .6" face="0 2 1 0 1 3 1 2 3 2 0 3"
texcoord="0 0 1 0 .5 1 .5 .3"/><hfield name="h" nrow="3" ncol="3" elevation="0 0 0 0 1 0 0 0 0" size=".7 .5 .4 .1"/>
</asset><default><geom material="m"/></default><worldbody>{geoms}</worldbody></mujoco>"""

GEOMS = {
    "box": 'type="box" size=".6 .4 .5"',
    "plane": 'type="plane" size=".8 .5 .1"',
    "sphere": 'type="sphere" size=".6"',
    "ellipsoid": 'type="ellipsoid" size=".7 .4 .5"',
    "cylinder": 'type="cylinder" size=".4 .5"',
    "capsule": 'type="capsule" size=".3 .4"',
    "plain": 'type="mesh" mesh="plain"',
    "own": 'type="mesh" mesh="own"',
    "field": 'type="hfield" hfield="h"',
}


def model(kind, image, more, names):
    """Return a model of geoms in a row."""
    rows = enumerate(names)
    geoms = "".join(f'<geom name="{name}" pos="{2 * place} 0 0" {GEOMS[name]}/>' for place, name in rows)
    made = mujoco.MjModel.from_xml_string(SHAPES.format(kind=kind, more=more, geoms=geoms, width=image.shape[1]))
    made.tex_data[:] = image.reshape(-1)
    return made


def pictures(made, distance, device):
    """Return MuJoCo's picture of a geom at the origin, and the image of a `BatchRenderer`, without shadows."""
    data, camera = mujoco.MjData(made), mujoco.MjvCamera()
    camera.lookat[:], camera.distance, camera.azimuth, camera.elevation = (0, 0, 0), distance, 160, -35
    mujoco.mj_forward(made, data)
    with mujoco.Renderer(made, 60, 80) as renderer:
        renderer.update_scene(data, camera)
        renderer.scene.flags[int(mujoco.mjtRndFlag.mjRND_SHADOW)] = 0
        shown = renderer.render().astype(int)
    batch = wv.mujoco.BatchRenderer(made, height=60, width=80, outputs=("color",), shadows=False, device=device)
    return shown, batch.render(data, cameras=[camera]).color.numpy()[0].astype(int)


def drawn(item, rays, eye):
    """Return the rays that hit an object, its colors there, and a mask of hits away from texture seams."""
    mesh = trimesh.Trimesh(item.vertices, item.faces, process=False)
    hits, which, faces = mesh.ray.intersects_location(np.tile(eye, (len(rays), 1)), rays, multiple_hits=False)
    look = item.appearance
    image = look.materials[0].texture.image
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[faces], hits)
    corners = look.corner_uv(item.faces)[faces]
    uv = np.einsum("nk,nkc->nc", weights, corners)
    u, down = uv[:, 0] % 1, (1 - uv[:, 1]) % 1
    height, width = image.shape[:2]
    colors = image[np.minimum(down * height, height - 1).astype(int), np.minimum(u * width, width - 1).astype(int)]
    clear = (np.minimum(u, 1 - u) > 0.06) & (np.minimum(down, 1 - down) > 0.06)
    return which, colors / 255, clear


@pytest.mark.slow
@pytest.mark.gl
@pytest.mark.parametrize("more", ['texrepeat="1.5 2.5"', 'texrepeat="1.5 2.5" texuniform="true"'])
@pytest.mark.parametrize("forward", [(0.4, 1, -0.7), (-0.5, -1, 0.6)])
def test_2d_textures_match_mujoco(more, forward):
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[..., 0], image[..., 1] = np.arange(64) * 4, np.arange(64)[:, None] * 4
    image[..., 2] = 200  # marks drawn pixels
    made = model("2d", image, more, GEOMS)
    scene = wv.mujoco.scene_from_mujoco(made).scene
    for place, name in enumerate(GEOMS):
        if name == "plane" and forward[2] > 0:  # from below, MuJoCo's plane is nearly transparent
            continue
        eye = np.array([2.0 * place, 0, 0.05]) - 4 * np.array(forward) / np.linalg.norm(forward)
        shown, rays = picture(made, eye, forward, (0, 0, 1), 0.2)
        which, colors, clear = drawn(scene[name], rays.reshape(-1, 3), eye)
        seen = shown.reshape(-1, 3)[which]
        clear &= seen[:, 2] > 0.5  # at silhouettes, MuJoCo's coarser shapes are smaller
        error = np.abs(colors - seen).max(axis=1)[clear]
        assert len(error) > 200, name
        assert np.median(error) < 8 / 255, name  # its shapes have fewer vertices
        assert np.quantile(error, 0.9) < 20 / 255, name


@pytest.mark.parametrize("uniform", [False, True])
@pytest.mark.parametrize("name", GEOMS)
def test_2d_textures_are_projected_as_before_mujoco_3_12(name, uniform, monkeypatch):
    """The formulas are those of glTexGen with GL_OBJECT_LINEAR in `settexture` of MuJoCo 3.8's render_gl3.c."""
    monkeypatch.setattr("warpvis.mujoco._texture_coordinates._PROJECTS", True)
    more = f'texrepeat="1.5 2.5" texuniform="{str(uniform).lower()}"'
    made = model("2d", np.zeros((64, 64, 3), dtype=np.uint8), more, [name])
    item = wv.mujoco.scene_from_mujoco(made).scene[name]
    uv = item.appearance.corner_uv(item.faces)
    if name == "own":  # the coordinates of the file, whose v is downward
        assert np.allclose(np.unique(uv.reshape(-1, 2), axis=0), [(0, 1), (0.5, 0), (0.5, 0.7), (1, 1)])
        return
    corners = item.vertices[item.faces]
    if name == "plain":  # in the frame of its inertia
        corners = made.mesh_vert[made.mesh_face[: made.mesh_facenum[0]]]
    size = made.geom_size[0, [0, 0]] if name in ("sphere", "cylinder", "capsule") else made.geom_size[0, :2]
    scale = np.array([1.5, 2.5]) / (1.0 if uniform else size) / 2
    s, t = np.moveaxis(corners[..., :2] * scale * [1, -1] - 0.5, -1, 0)
    assert np.abs(uv - np.stack([s, 1 - t], axis=-1)).max() < 1e-5


@pytest.mark.gl
@pytest.mark.parametrize("forward", [(0.4, 1, -0.7), (-0.5, -1, 0.6)])
def test_cube_textures_on_boxes_match_mujoco(forward):
    image = np.random.default_rng(2).integers(60, 255, (12, 2, 3), dtype=np.uint8).repeat(32, 0).repeat(32, 1)
    made = model("cube", image, "", ["box"])
    eye = -4 * np.array(forward) / np.linalg.norm(forward)
    shown, rays = picture(made, eye, forward, (0, 0, 1), 0.2)
    which, colors, _ = drawn(wv.mujoco.scene_from_mujoco(made).scene["box"], rays.reshape(-1, 3), eye)
    error = np.abs(colors - shown.reshape(-1, 3)[which]).max(axis=1)
    assert np.mean(error < 2 / 255) > 0.7  # a quarter is about a dozen pixels wide, and interpolated at its edges


@pytest.mark.gl
def test_small_cube_textures_on_boxes_match_mujoco(device):
    """Mip levels of a side have texels of this side only, also where its size is not a power of two."""
    image = np.zeros((6, 250, 250, 3), dtype=np.uint8)
    image[:, 40:-40, 40:-40] = np.random.default_rng(2).integers(60, 255, (6, 1, 1, 3))
    shown, color = pictures(model("cube", image, "", ["box"]), 8, device)
    seen = (shown.max(axis=-1) > 0) & (color.max(axis=-1) > 0)
    assert seen.sum() > 50
    assert np.abs(color - shown)[seen].mean() < 3


@pytest.mark.gl
@pytest.mark.parametrize("more", ["", 'texuniform="true"'])
@pytest.mark.parametrize("name", ["plain", "own", "sphere", "ellipsoid", "box", "cylinder", "capsule"])
def test_cube_textures_match_mujoco(name, more, device):
    """MuJoCo does not scale meshes, and shows no cube map on meshes with texture coordinates."""
    image = np.random.default_rng(2).integers(60, 255, (12, 2, 3), dtype=np.uint8).repeat(32, 0).repeat(32, 1)
    shown, color = pictures(model("cube", image, more, [name]), 2.5, device)
    seen = (shown.max(axis=-1) > 0) & (color.max(axis=-1) > 0)
    assert seen.sum() > 500
    assert (len(np.unique(shown[seen], axis=0)) > 20) == (name != "own")
    error = np.abs(color - shown).max(axis=-1)[seen]
    assert np.mean(error <= 3) > 0.7  # as for boxes
    if name == "own":
        assert error.max() <= 3
