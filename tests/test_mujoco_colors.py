# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Colors of MuJoCo scenes belong to the geom in the segmentation; colors that differ from the model are followed."""

import copy
import pickle

import mujoco
import numpy as np
import pytest
import trimesh
import warp as wp

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import BatchRenderer, geom_poses, scene_from_mujoco

from support.coinciding import FLUSH, HEAD, TWICE, eye_of, model_of, renderer_of

SIZE = {"height": 60, "width": 80}
OUTPUTS = ("albedo", "color", "segmentation")


@pytest.mark.parametrize("moving", [False, True])
@pytest.mark.parametrize("kind", TWICE)
def test_colors_match_segmented_geom(kind, moving, device):
    if kind == "plane" and moving:
        pytest.skip("MuJoCo's planes do not move")
    joint = "<freejoint/>" if moving else ""
    pair = "".join(f'<geom {TWICE[kind]} rgba="{rgba}"/>' for rgba in ("1 0 0 1", "0 0 1 1"))
    model, data = model_of(f'{HEAD}<body pos="0 0 .1" euler="20 0 30">{joint}{pair}</body></worldbody></mujoco>')
    batch = BatchRenderer(model, **SIZE, outputs=OUTPUTS, device=device)
    views = batch.render(data)
    ids, albedo, color = batch.geom_ids(views).numpy()[0], views.albedo.numpy()[0], views.color.numpy()[0]
    assert (ids == 1).sum() > 80 and not (ids == 0).any()
    assert (albedo[ids == 1] == (0, 0, 255)).all()
    assert (color[ids == 1][:, 0] <= color[ids == 1][:, 2]).all() and color[ids == 1][:, 2].max() > 70


def test_textures_match_triangles_of_segmented_geom(device):
    """Both meshes have the same shape, but different triangles in different order."""
    corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
    faces = "0 1 3 0 3 2 4 6 7 4 7 5 0 4 5 0 5 1 2 3 7 2 7 6 0 2 6 0 6 4 1 5 7 1 7 3"
    turned = "1 5 7 1 7 3 0 2 6 0 6 4 2 3 7 2 7 6 0 4 5 0 5 1 4 6 7 4 7 5 0 1 3 0 3 2"
    vertex = " ".join(f"{x * 0.3} {y * 0.3} {z * 0.3}" for x, y, z in corners)
    text = f"""<mujoco><asset><texture name="noise" type="2d" builtin="checker" rgb1="1 0 0" rgb2="0 1 0" width="64"
        height="64" random="0.3" markrgb="1 1 1" mark="random"/><material name="noise" texture="noise"/>
      <mesh name="plain" vertex="{vertex}" face="{faces}"/>
      <mesh name="laid" vertex="{vertex}" face="{turned}" texcoord="0 0 1 0 0 1 1 1 .2 .1 .9 .3 .4 .7 .6 .5"/></asset>
      <worldbody><camera name="eye" pos="-.4 -.9 .8" xyaxes="1 -.4 0 .25 .6 .8" fovy="60"/><body euler="20 0 30">
      {{}}<geom type="mesh" mesh="laid" material="noise"/></body></worldbody></mujoco>"""
    images = []
    for first in ('<geom type="mesh" mesh="plain" rgba="0 0 1 1"/>', ""):
        model, data = model_of(text.format(first))
        images.append(BatchRenderer(model, **SIZE, outputs=("albedo",), device=device).render(data).albedo.numpy()[0])
    alone = images[1].astype(int)
    assert len(np.unique(alone.reshape(-1, 3), axis=0)) > 20
    assert (np.abs(images[0] - alone).max(axis=-1) <= 1).mean() > 0.999


def test_faces_contain_rendered_points(device, caster):
    model, data = model_of(FLUSH)
    outputs = ("segmentation", "faces", "points")
    geoms, renderer = renderer_of(model, device, outputs=outputs, caster=caster, cull_backfaces=True)
    rows = geom_poses(data, geoms)
    views = renderer.render(eye_of(model, data), object_poses=rows[None])
    plain = wv.Renderer(geoms.scene, renderer.camera, outputs=outputs, caster=caster, cull_backfaces=True)
    was = plain.render(eye_of(model, data), object_poses=rows[None]).segmentation.numpy()[0]
    objects, faces, points = (getattr(views, name).numpy()[0] for name in outputs)
    changed = 0
    for index, item in enumerate(geoms.scene.objects):
        mask = objects == index
        if item.solid is not None:
            assert (faces[mask] == -1).all()
            continue
        parent = index if item.parent is None else item.parent
        place = np.eye(4)
        if parent in geoms.scene.movable:
            place = poses_to_matrices(rows[geoms.scene.movable.index(parent)])
        local = (points[mask].astype(np.float64) - place[:3, 3]) @ place[:3, :3]
        vertices = item.vertices if item.mesh_vertices is None else item.mesh_vertices
        a, b, c = np.moveaxis(vertices[item.faces[faces[mask]]].astype(np.float64), 1, 0)
        normal = np.cross(b - a, c - a)
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        assert (np.abs(np.einsum("nk,nk->n", local - a, normal)) < 2e-5).all()
        for p, q in ((a, b), (b, c), (c, a)):
            inwards = np.cross(normal, q - p)
            assert (np.einsum("nk,nk->n", local - p, inwards) > -2e-5).all()
        changed += int((was[mask] != index).sum())
    assert changed > 50


WORLDS = """<mujoco><asset><material name="red" rgba="1 0 0 1"/><material name="blue" rgba="0 0 1 1"/></asset>
  <worldbody><camera pos="0 -2 .5" xyaxes="1 0 0 0 0 1"/><light name="lamp" pos="0 0 3"/>
  <geom name="own" type="box" size=".2 .2 .2" rgba="0 1 0 1"/>
  <geom name="red" type="box" size=".2 .2 .2" pos=".5 0 0" material="red"/>
  <geom name="unseen" type="box" size=".2 .2 .2" pos="0 0 .5" group="3"/></worldbody></mujoco>"""


def changed(name, geom, value):
    model, _ = model_of(WORLDS)
    rows = getattr(model, name)[None].repeat(2, axis=0)
    rows[1, geom] = value
    return {name: rows}


@pytest.mark.parametrize("outputs", [("color",), ("albedo", "depth")])
@pytest.mark.parametrize(
    ("given", "geom"),
    [
        (changed("geom_rgba", 0, (1, 0, 1, 1)), "own"),
        (changed("geom_rgba", 1, (1, 0, 1, 1)), "red"),
        (changed("geom_rgba", 1, (0.5, 0.5, 0.5, 0.9)), "red"),  # its geom color now overrides the material
        (changed("geom_matid", 1, 1), "red"),
        (changed("geom_matid", 0, 0), "own"),
        (changed("mat_rgba", 0, (1, 0, 1, 1)), "red"),
    ],
)
def test_colors_that_differ_from_model_are_shown(given, geom, outputs, device):
    """World 1 has the image of a model with its numbers, and world 0 that of the model."""
    model, data = model_of(WORLDS)
    batch = BatchRenderer(model, **SIZE, outputs=outputs, device=device)
    shared = {name: wp.array(rows, dtype=wp.vec4, device=device) for name, rows in given.items() if "rgba" in name}
    for rows in (given, shared or given):
        found = getattr(batch.render([data] * 2, model=rows), outputs[0]).numpy()
        own = copy.copy(model)
        for world in range(2):
            for name, values in given.items():
                getattr(own, name)[:] = values[world]
            expected = getattr(BatchRenderer(own, **SIZE, outputs=outputs, device=device).render(data), outputs[0])
            assert np.abs(found[world].astype(int) - expected.numpy()[0]).max() <= 1
        # A geom with a material and its own color keeps its color.
        assert (found[0] != found[1]).any() or ("geom_matid" in given and geom == "own")


@pytest.mark.parametrize(
    "given",
    [
        changed("geom_rgba", 0, (0, 1, 0, 1)),
        changed("geom_rgba", 0, (0, 1, 0, 0)),  # hidden
        changed("geom_rgba", 0, (1, 0, 1, 0)),  # hidden, so the color is irrelevant
        changed("geom_rgba", 2, (1, 0, 1, 1)),  # of an invisible group
        changed("mat_rgba", 1, (1, 1, 0, 1)),  # of an unused material
    ],
)
def test_irrelevant_color_differences_are_accepted(given, device):
    model, data = model_of(WORLDS)
    batch = BatchRenderer(model, **SIZE, outputs=("color", "segmentation"), device=device)
    views, plain = batch.render([data] * 2, model=given), batch.render([data] * 2)
    assert np.array_equal(views.color.numpy()[0], plain.color.numpy()[0])
    shown = views.segmentation.numpy()[1]
    assert np.array_equal(views.color.numpy()[1][shown >= 0], plain.color.numpy()[1][shown >= 0])
    hides = "geom_rgba" in given and given["geom_rgba"][1, 0, 3] == 0
    assert (shown == 0).any() != hides


def test_materials_on_gpu_are_rejected(cuda):
    model, data = model_of(WORLDS)
    batch = BatchRenderer(model, **SIZE, outputs=("color",), device=cuda)
    given = {"geom_matid": wp.array(model.geom_matid[None].repeat(2, 0), dtype=wp.int32, device=cuda)}
    with pytest.raises(wv.WarpvisError, match="geom_matid must be in host memory, or of one world, for the outputs"):
        batch.render([data] * 2, model=given)


def test_invalid_geom_matid_is_rejected(device):
    model, data = model_of(WORLDS)
    batch = BatchRenderer(model, **SIZE, device=device)
    for number in (-2, 2):
        with pytest.raises(
            wv.WarpvisError, match=f"geom_matid must be from -1 to 1, got {number} at index 1 in world 1"
        ):
            batch.render([data] * 2, model=changed("geom_matid", 1, number))


EDITS = {
    "geom_rgba": lambda model: model.geom_rgba[0].fill(1),
    "geom_matid": lambda model: model.geom_matid.fill(1),
    "mat_rgba": lambda model: model.mat_rgba[0].fill(0.5),
    "mat_texrepeat": lambda model: model.mat_texrepeat.fill(3),
    "light_diffuse": lambda model: model.light_diffuse.fill(1),
    "light_pos": lambda model: model.light_pos.fill(1),
    "vis.headlight.ambient": lambda model: model.vis.headlight.ambient.fill(1),
}


@pytest.mark.parametrize("name", EDITS)
def test_model_color_edits_after_creation_are_followed(name, device):
    model, data = model_of(WORLDS)
    batch = BatchRenderer(model, **SIZE, outputs=("color",), device=device)
    before = batch.render(data).color.numpy()
    copies = [copy.deepcopy(batch), pickle.loads(pickle.dumps(batch))]
    EDITS[name](model)
    anew = BatchRenderer(model, **SIZE, outputs=("color",), device=device).render(data).color.numpy()
    for edited in (copy.deepcopy(batch), pickle.loads(pickle.dumps(batch)), batch):
        for _ in range(2):
            assert np.abs(edited.render(data).color.numpy().astype(int) - anew).max() <= 1
    for again in copies:  # copies keep the original model
        assert np.array_equal(again.render(data).color.numpy(), before)
        EDITS[name](again.model)
        assert np.abs(again.render(data).color.numpy().astype(int) - anew).max() <= 1
    assert np.array_equal(anew, before) == (name == "mat_texrepeat")  # there is no texture


def test_scenes_keep_materials_of_their_creation():
    model, _ = model_of(WORLDS)
    scene = scene_from_mujoco(model).scene
    model.mat_rgba[0] = (0, 1, 1, 1)
    assert scene["red"].appearance.materials[0].base_color == (1, 0, 0, 1)
    assert scene_from_mujoco(model).scene["red"].appearance.materials[0].base_color == (0, 1, 1, 1)


TEXTURED = """<mujoco><visual><headlight ambient=".9 .9 .9" diffuse="0 0 0" specular="0 0 0"/><quality offsamples="0"/>
  </visual><asset><texture name="image" type="{type}" builtin="flat" width="16" height="{height}" rgb1=".7 .4 .1"
  rgb2=".7 .4 .1" colorspace="{space}"/><material name="image" texture="image"/></asset><worldbody>
  <camera pos="0 -1 0" xyaxes="1 0 0 0 0 1"/><geom type="box" size=".2 .2 .2" material="image"/></worldbody></mujoco>"""


@pytest.mark.smoke("*-auto-cube", "*-linear-2d")
@pytest.mark.gl
@pytest.mark.parametrize("kind", ["2d", "cube"])
@pytest.mark.parametrize("space", ["auto", "linear", "sRGB"])
def test_texture_color_spaces_match_mujoco(kind, space, device):
    model, data = model_of(TEXTURED.format(type=kind, height=16 if kind == "2d" else 96, space=space))
    color = BatchRenderer(model, **SIZE, outputs=("color",), device=device).render(data).color.numpy()[0]
    with mujoco.Renderer(model, **SIZE) as renderer:
        renderer.update_scene(data, 0)
        expected = renderer.render()
    middle = (slice(25, 35), slice(35, 45))
    assert np.abs(color[middle].astype(int) - expected[middle]).max() <= 2
    assert (expected[middle].mean() < 60) == (space == "sRGB" and kind == "2d")


@pytest.mark.gl
@pytest.mark.parametrize("space", ["auto", "sRGB"])
def test_sky_color_spaces_match_mujoco(space):
    text = TEXTURED.format(type="skybox", height=96, space=space).replace(' material="image"', ' pos="0 9 9"')
    model, data = model_of(text)
    sky = scene_from_mujoco(model).scene.background.sky
    with mujoco.Renderer(model, **SIZE) as renderer:
        renderer.update_scene(data, 0)
        expected = renderer.render()
    assert np.abs(sky[0].image[0, 0, :3].astype(int) - expected[30, 40]).max() <= 2


CUBE = "-.3 -.3 -.3 .3 -.3 -.3 -.3 .3 -.3 .3 .3 -.3 -.3 -.3 .3 .3 -.3 .3 -.3 .3 .3 .3 .3 .3"
CUBE_FACES = "0 2 1 1 2 3 4 5 6 5 7 6 0 1 4 1 5 4 2 6 3 3 6 7 0 4 2 2 4 6 1 3 5 3 7 5"
COORDINATES = "0 0 1 0 0 1 1 1 0 0 1 0 0 1 1 1"


def normals_of(mesh):
    """Return normals that shade a model's mesh, its faces' normals, and the normals that the model stores."""
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><asset><mesh name='m' smoothnormal='true' {mesh}/></asset><worldbody><geom type='mesh' mesh='m'/>"
        "</worldbody></mujoco>"
    )
    item = scene_from_mujoco(model).scene.objects[0]
    corners = model.mesh_vert[model.mesh_face].astype(np.float64)
    flat = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    stored = model.mesh_normal[model.mesh_facenormal].astype(np.float64)
    return item.appearance.normals, flat / np.linalg.norm(flat, axis=1, keepdims=True), stored


def test_sharp_edges_of_meshes_are_shaded_flat():
    """Unless a mesh has texture coordinates; the faces of a coarse ball are within 37 degrees of its normals."""
    shaded, flat, stored = normals_of(f'vertex="{CUBE}" face="{CUBE_FACES}"')
    assert (np.abs((stored * flat[:, None]).sum(axis=-1)) < 0.75).all()
    np.testing.assert_allclose(shaded, np.repeat(flat[:, None], 3, axis=1), atol=1e-6)
    shaded, flat, stored = normals_of(f'vertex="{CUBE}" face="{CUBE_FACES}" texcoord="{COORDINATES}"')
    np.testing.assert_allclose(shaded, stored, atol=1e-6)
    assert (np.abs(shaded - flat[:, None]).max(axis=(1, 2)) > 0.2).all()
    ball = trimesh.creation.icosphere(2, 0.3)
    shaded, flat, stored = normals_of(f'vertex="{" ".join(map(str, ball.vertices.ravel()))}"')
    np.testing.assert_allclose(shaded, stored, atol=1e-6)


@pytest.mark.gl
def test_meshes_with_edges_match_mujoco_pictures():
    model = mujoco.MjModel.from_xml_string(f"""<mujoco><visual><headlight ambient=".2 .2 .2" diffuse=".4 .4 .4"
      specular="0 0 0"/><quality offsamples="0"/></visual><asset><material name="m" specular="0" rgba=".9 .6 .5 1"/>
      <mesh name="m" smoothnormal="true" vertex="{CUBE}" face="{CUBE_FACES}"/></asset><worldbody>
      <light pos="0 0 3" dir="0.3 -0.2 -1" type="directional" castshadow="false" diffuse=".3 .3 .5"/>
      <camera name="c" pos=".8 -.9 .7" xyaxes="1 1 0 -.4 .4 1"/>
      <geom type="mesh" mesh="m" material="m"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, **SIZE) as renderer:
        renderer.update_scene(data, "c")
        picture = renderer.render().astype(int)
    views = BatchRenderer(model, **SIZE, outputs=("color", "segmentation"), device="cpu").render(data)
    seen = (views.segmentation.numpy()[0] == 0) & (picture.sum(axis=-1) > 0)
    error = np.abs(views.color.numpy()[0] - picture)[seen]
    assert seen.sum() > 500 and error.mean() < 0.5


@pytest.mark.gl
@pytest.mark.parametrize("shadows", [True, False])
def test_bright_lights_match_mujoco_pictures(shadows, device):
    """Each light with shadows is clamped before the texture multiplies it, and its ambient part is blocked."""
    model = mujoco.MjModel.from_xml_string("""<mujoco><visual><headlight ambient=".1 .2 .1" diffuse=".5 .2 .3"
      specular="0 0 0"/><quality offsamples="0" shadowsize="1024"/></visual><asset><texture name="t" type="2d"
      builtin="flat" width="16" height="16" rgb1=".4 .3 .5"/><material name="m" texture="t" specular="0"/></asset>
      <worldbody><light dir="0 .3 -1" pos="0 0 3" type="directional" diffuse=".9 .8 .3" specular="0 0 0"/>
      <light dir=".4 0 -1" pos="0 0 3" type="directional" diffuse=".9 .3 .5" ambient=".1 0 .3" specular="0 0 0"/>
      <camera name="c" pos="0 0 3"/><geom type="plane" size="2 2 .1" material="m"/>
      <geom type="box" pos="0 0 1.2" size=".3 .3 .02" rgba=".5 .3 .2 1"/></worldbody></mujoco>""")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, **SIZE) as renderer:
        renderer.update_scene(data, "c")
        renderer.scene.flags[int(mujoco.mjtRndFlag.mjRND_SHADOW)] = shadows
        picture = renderer.render().astype(int)
    batch = BatchRenderer(model, **SIZE, outputs=("color",), shadows=shadows, device=device)
    error = np.abs(batch.render(data).color.numpy()[0] - picture).max(axis=-1)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) >= (4 if shadows else 2)
    assert (error <= 2).mean() > 0.95  # the rest are edges of shadow maps and of the box
