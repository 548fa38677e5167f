# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Materials on the live page, and color images of agents."""

import io

import mujoco
import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.scene.lights import HEADLIGHT
from warpvis.scene.materials import Appearance, Material, Texture
from warpvis.viewer import Viewer, ViewerState
from warpvis.viewer._materials import MAX_TEXELS, Shelf
from warpvis.viewer._state import MujocoStage
from warpvis.visibility import Agent, FieldOfView

PORT = 8471
CAMERA = wv.Camera.from_fov(32, 24, hfov=1.2, near=0.1, far=20.0)
EYE = (0.0, -3.0, 0.5, *wv.look_at((0, -3, 0.5), (0, 0, 0.3))[3:])
SQUARE = (np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]], dtype=float), np.array([[0, 1, 2], [0, 2, 3]]))
UV = np.array([[0, 0], [2, 0], [2, 1], [0, 1]], dtype=np.float32)
MODEL = """<mujoco><asset><texture name="t" type="2d" builtin="flat" rgb1="0 1 0" width="8" height="8"/>
  <material name="m" texture="t"/></asset><worldbody><light pos="0 -2 3"/>
  <geom type="plane" size="2 2 .1" material="m"/>
  <body name="arm" pos="0 0 .5"><joint type="hinge" axis="0 0 1"/><geom type="box" size=".2 .2 .2" rgba="1 0 0 1"/>
  <geom type="box" size=".1 .1 .1" pos=".4 0 0" rgba="0 0 1 1"/></body></worldbody></mujoco>"""


def board(shade=200, size=4):
    image = np.full((size, size, 3), shade, dtype=np.uint8)
    image[0, 0] = 255, 0, 0
    return Texture(image)


def scene_of(**objects):
    scene = wv.Scene()
    for name, (place, look) in objects.items():
        scene.add(SQUARE, name=name, pose=(*place, 0, 0, 0, 1), label="object", appearance=look)
    scene.lights = HEADLIGHT
    return scene


def read(data):
    """Return the geometries of a binary glTF file with their materials."""
    return list(trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False).geometry.values())


def as_linear(color):
    values = np.asarray(color, dtype=np.float64)
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def test_files_have_linear_colors_textures_and_opacity():
    wood, glass = Material("wood", texture=board(size=32)), Material("glass", (0.2, 0.5, 0.8, 0.3), alpha_mode="blend")
    look = Appearance((wood, glass), face_materials=np.array([0, 1]), uv=UV)
    scene = scene_of(a=((0, 0, 0), look))
    plain, pane = sorted(read(Shelf([look]).glb([scene["a"]])), key=lambda part: part.visual.material.name == "glass")
    texture = np.asarray(plain.visual.material.baseColorTexture.convert("RGB"))
    assert texture.shape == (32, 32, 3) and np.abs(texture[16:].astype(int) - 200).max() < 6
    np.testing.assert_allclose(np.sort(plain.visual.uv[:, 0]), [0, 2, 2], atol=1e-6)
    factor = np.asarray(pane.visual.material.baseColorFactor) / 255
    np.testing.assert_allclose(factor, [*as_linear([0.2, 0.5, 0.8]), 0.3], atol=1 / 255)
    assert pane.visual.material.alphaMode == "BLEND" and plain.visual.material.alphaMode in (None, "OPAQUE")
    for part in (plain, pane):
        assert len(part.faces) == 1
        corners = part.vertices[part.faces[0]]
        assert any(np.allclose(corners, SQUARE[0][row], atol=1e-6) for row in SQUARE[1])


def test_colors_of_faces_and_textures_of_directions_become_colors():
    colors = np.array([[255, 0, 0, 255], [0, 0, 255, 255]], dtype=np.uint8)
    parts = read(Shelf([]).glb([scene_of(a=((0, 0, 0), Appearance(face_colors=colors)))["a"]]))
    assert sorted(tuple(part.visual.material.baseColorFactor[:3]) for part in parts) == [(0, 0, 255), (255, 0, 0)]
    sides = np.zeros((24, 4, 3), dtype=np.uint8)
    sides[:12] = 100
    cube = Appearance((Material(texture=Texture(sides), projection="cube"),))
    (part,) = read(Shelf([cube]).glb([scene_of(a=((0, 0, 0), cube))["a"]]))
    expected = as_linear(100 / 255) / 2
    np.testing.assert_allclose(np.asarray(part.visual.material.baseColorFactor)[:3] / 255, expected, atol=1 / 255)


def test_textures_fit_into_the_limit():
    looks = [Appearance((Material(texture=board(size=2000)),), uv=UV) for _ in range(12)]
    shelf, texels = Shelf(looks), 0
    for look in looks:
        (part,) = read(shelf.glb([scene_of(a=((0, 0, 0), look))["a"]]))
        texels += np.prod(part.visual.material.baseColorTexture.size)
    assert 0.9 * MAX_TEXELS < texels < 1.02 * MAX_TEXELS
    (part,) = read(Shelf(looks[:1]).glb([scene_of(a=((0, 0, 0), looks[0]))["a"]]))
    assert part.visual.material.baseColorTexture.size == (1024, 1024)


def test_agents_see_colors_beside_depth():
    look = Appearance((Material(texture=board()),), uv=UV)
    scene = scene_of(a=((0, 0, 0.5), look), b=((0, 1, 0.5), (0, 0.6, 0)))
    human = Agent("human", FieldOfView(hfov=2.5, up=0.8, down=1.0), EYE)
    state = ViewerState(scene, [Agent("robot", CAMERA, EYE), human], points=500)
    assert state.picture_kind == "both"
    snapshot = state.snapshot()
    robot, human = snapshot.views
    expected = wv.render(scene, CAMERA, EYE, outputs="color").color.numpy()[0]
    assert np.abs(robot.color.astype(int) - expected).max() <= 1 and expected.std() > 20
    picture = snapshot.pictures[0]
    assert picture.shape == (24, 2 * 32 + 4, 3)
    np.testing.assert_array_equal(picture[:, :32], robot.color)
    assert human.color.shape == (*human.depth.shape, 3)
    seen = np.isfinite(human.depth)
    assert human.color[seen].mean() > 50 and (human.color[~seen] == 0).all()
    state.picture_kind = "depth"
    plain = state.snapshot()
    assert plain.views[0].color is None
    np.testing.assert_array_equal(plain.pictures[0], picture[:, 36:])
    state.picture_kind = "color"
    np.testing.assert_array_equal(state.snapshot().pictures[0], robot.color)
    without = wv.Scene()
    without.add(SQUARE, name="a")
    assert ViewerState(without, [Agent("robot", CAMERA, EYE)], points=500).picture_kind == "depth"


def test_colors_of_models_are_those_of_their_geoms():
    """The geoms of a body form one object of the page; its color image shows each."""
    model = mujoco.MjModel.from_xml_string(MODEL)
    stage = MujocoStage(model)
    state = ViewerState(stage, [Agent("robot", CAMERA, (0, -2, 0.6, *wv.look_at((0, -2, 0.6), (0, 0, 0.5))[3:]))])
    state.set_joint("joint 0", 0.4)
    (seen,) = state.snapshot().views
    loaded = wv.mujoco.scene_from_mujoco(model)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.4
    mujoco.mj_forward(model, data)
    poses = wv.mujoco.geom_poses(data, loaded)
    agent = state.agents["robot"]
    expected = wv.render(loaded.scene, CAMERA, agent.poses, outputs="color", object_poses=poses).color.numpy()[0]
    assert np.abs(seen.color.astype(int) - expected).max() <= 1
    for channel in range(3):  # green floor, red and blue boxes
        assert (expected[..., channel] > 2 * np.delete(expected, channel, axis=-1).max(axis=-1)).sum() > 5
    parts = read(Shelf([]).glb(stage.stage.parts_of("arm")))
    assert sorted(tuple(part.visual.material.baseColorFactor[:3]) for part in parts) == [(0, 0, 255), (255, 0, 0)]


@pytest.fixture(scope="module")
def viewer():
    look = Appearance((Material(texture=board(size=1500)),), uv=UV)
    scene = scene_of(a=((0, 0, 0.5), look), b=((0, 1, 0.5), None))
    with Viewer(ViewerState(scene, [Agent("robot", CAMERA, EYE)], points=500), port=PORT) as found:
        yield found


def test_page_shows_materials_and_on_request_who_sees_objects(viewer):
    meshes, state = viewer.page.meshes, viewer.state
    assert meshes.kind == "materials" and meshes.visible
    (painted, plain) = meshes._shown["materials"]
    assert read(painted.glb_data)[0].visual.material.baseColorTexture.size == (1024, 1024)
    state.move_object("b", (0, -1.5, 0.5, 0, 0, 0, 1))
    viewer.update()
    assert tuple(plain.color) == wv.viz.STATE_COLORS[wv.visibility.State.FIRST]
    meshes.kind = "visibility"
    assert not painted.visible and plain.visible and len(meshes._shown["visibility"]) == 2
    assert tuple(meshes._meshes[0].color) in wv.viz.STATE_COLORS.values()
    meshes.visible = False
    meshes.kind = "materials"
    assert not painted.visible and not meshes._meshes[0].visible
    meshes.visible = True
    assert painted.visible and not meshes._meshes[0].visible
    state.reset()
    viewer.update()


def test_exported_page_is_small(viewer, tmp_path):
    viewer.save_html(tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text()
    assert len(text) < 6e6 and "what robot sees" in text


def test_instances_share_one_file():
    scene, looks = wv.Scene(), [Material("a", (1, 0, 0)), Material("b", texture=board())]
    mesh = trimesh.creation.box(extents=(0.2, 0.2, 0.2))
    for index in range(300):
        look = looks[index % 2] if index else None
        place = (index % 20, index // 20, 0, 0, 0, 0, 1)
        scene.add(mesh, name=f"box {index}", pose=place, appearance=look)
    with Viewer(
        ViewerState(scene, [Agent("robot", CAMERA, (5, 5, 20, 1, 0, 0, 0))], points=500), port=PORT + 1
    ) as page:
        shown = page.page.meshes._shown["materials"]
        assert len(shown) < 10
