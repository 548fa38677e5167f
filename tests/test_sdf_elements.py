# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of docs/scene_files/sdf.md that no other test of SDF covers."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.io import read_parts
from warpvis.scene.solids import Solid

from support.sdf_files import BOX, BOX_LINK, image, load, model, model_folder, only, read, visual, world, write


def bounds(part):
    return np.stack([part.mesh[0].min(axis=0), part.mesh[0].max(axis=0)])


def test_first_of_several_worlds(tmp_path):
    worlds = "".join(f'<world name="{name}"><model name="{name}">{BOX_LINK}</model></world>' for name in "ab")
    assert only(read(tmp_path, f'<sdf version="1.9">{worlds}</sdf>')).name == "a::l::v"


def test_placement_frame_and_plugins_of_an_include(tmp_path):
    model_folder(tmp_path, "table", model(f'<frame name="top"><pose>0 0 2 0 0 0</pose></frame>{BOX_LINK}', "table"))
    label = '<plugin filename="gz-sim-label-system" name="gz::sim::systems::Label"><label>40</label></plugin>'
    include = f"<placement_frame>top</placement_frame><pose>5 0 0 0 0 0</pose>{label}"
    part = only(read(tmp_path, world(f"<include><uri>model://table</uri>{include}</include>")))
    assert np.allclose(part.pose[:3], (5, 0, -2)) and part.label == 40


def test_included_actors_and_lights(tmp_path):
    trimesh.creation.box((0.5, 0.5, 2)).export(tmp_path / "skin.stl")
    actor = f"<actor name='ann'><skin><filename>{tmp_path}/skin.stl</filename></skin></actor>"
    model_folder(tmp_path, "person", f'<sdf version="1.9">{actor}</sdf>')
    model_folder(tmp_path, "lamp", '<sdf version="1.9"><light name="lamp" type="point"/></sdf>')
    placed = "<include><uri>model://{}</uri><name>{}</name><pose>1 2 3 0 0 0</pose></include>"
    path = write(tmp_path, world(placed.format("person", "bob") + placed.format("lamp", "bulb")))
    found = read_parts(path)
    part = only(found)
    assert (part.name, part.label) == ("bob", wv.Label.HUMAN) and np.allclose(part.pose[:3], (1, 2, 3))
    light = next(light for light in found.lights if light.kind == "point")
    assert (light.name, light.position) == ("bulb", (1, 2, 3))


def test_parameters_of_an_include_are_ignored(tmp_path):
    model_folder(tmp_path, "table", model(BOX_LINK, "table"))
    changed = f'<visual element_id="l::v" action="remove"/><link element_id="k" action="add">{visual(BOX)}</link>'
    params = f"<experimental:params>{changed}</experimental:params>"
    found = read(tmp_path, world(f"<include><uri>model://table</uri>{params}</include>"))
    assert only(found).name == "table::l::v"


@pytest.mark.parametrize("kind", ["sphere", "cylinder", "capsule", "ellipsoid"])
def test_round_shapes_are_solids_if_movable_and_alone(tmp_path, kind):
    sizes = "<radii>1 2 3</radii>" if kind == "ellipsoid" else "<radius>1</radius><length>2</length>"
    shape = f"<{kind}>{sizes}</{kind}>"
    alone, static = f'<link name="l">{visual(shape)}</link>', "<static>1</static>"
    assert isinstance(only(read(tmp_path, model(alone))).mesh, Solid)
    assert isinstance(only(read(tmp_path, model(static + alone))).mesh, tuple)
    pair = f'<link name="l">{visual(shape)}{visual(BOX, "w")}</link>'
    assert all(isinstance(part.mesh, tuple) for part in read(tmp_path, model(pair)).parts)


@pytest.mark.parametrize("axis", ["Y_UP", "Z_UP"])
def test_unit_and_axes_of_mesh_files(tmp_path, axis):
    """Gazebo applies the unit of COLLADA, and ignores its vertical axis."""
    pytest.importorskip("collada")
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box((100, 200, 300))).decode()
    start, end = text.index("<asset"), text.index("</asset>") + len("</asset>")
    asset = f'<asset><unit name="cm" meter="0.01"/><up_axis>{axis}</up_axis></asset>'
    write(tmp_path, text[:start] + asset + text[end:], "box.dae")
    part = only(read(tmp_path, model(f'<link name="l">{visual("<mesh><uri>box.dae</uri></mesh>")}</link>')))
    assert np.allclose(bounds(part), [(-0.5, -1, -1.5), (0.5, 1, 1.5)])


def test_material_replaces_that_of_a_mesh_file(tmp_path):
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl red\nf 1 2 3\n"
    write(tmp_path, text, "m.obj")
    write(tmp_path, "newmtl red\nKd 1 0 0\n", "m.mtl")
    shape = "<mesh><uri>m.obj</uri></mesh>"
    blue = "<material><diffuse>0 0 1 1</diffuse></material>"
    links = f'<link name="l">{visual(shape, "a")}{visual(shape, "b", blue)}</link>'
    parts = read(tmp_path, model(links)).parts
    assert [part.appearance.get().materials[0].base_color[:3] for part in parts] == [(1, 0, 0), (0, 0, 1)]


def test_textures_of_a_heightmap_are_ignored(tmp_path):
    image(tmp_path / "h.png", np.eye(3) * 200)
    more = "<texture><diffuse>h.png</diffuse><normal>gone.png</normal><size>1</size></texture>"
    more += "<blend><min_height>1</min_height><fade_dist>1</fade_dist></blend>"
    shape = f"<heightmap><uri>h.png</uri><size>2 2 1</size>{more}</heightmap>"
    part = only(read(tmp_path, model(f'<link name="l">{visual(shape)}</link>')))
    (material,) = part.appearance.get().materials
    assert material.texture is None and material.base_color == (0.7, 0.7, 0.7, 1)


@pytest.mark.parametrize("transparency", [0, 0.75, 1])
def test_depth_does_not_depend_on_transparency(tmp_path, transparency):
    more = f"<transparency>{transparency}</transparency>"
    scene = load(tmp_path, model(f'<link name="l">{visual(BOX, more=more)}</link>'))
    depth = wv.render(scene, wv.Camera.from_fov(3, 3, hfov=0.1), wv.look_at((5, 0, 0), (0, 0, 0))).depth.numpy()
    assert np.allclose(depth, 4.5)


def test_laser_retro_is_metadata(tmp_path):
    part = only(read(tmp_path, model(f'<link name="l">{visual(BOX, more="<laser_retro>7</laser_retro>")}</link>')))
    assert part.extras == {"laser_retro": 7}


def test_revolute2_is_two_revolute_joints(tmp_path):
    axes = (
        "<axis><xyz>0 0 1</xyz><limit><lower>-1</lower><upper>1</upper></limit></axis><axis2><xyz>1 0 0</xyz></axis2>"
    )
    joint = f'<joint name="j" type="revolute2"><parent>l</parent><child>k</child>{axes}</joint>'
    found = load(tmp_path, model(f'{BOX_LINK}<link name="k">{visual(BOX)}</link>{joint}')).joints
    assert [(found[name].kind, found[name].limits) for name in ("m::j", "m::j::2")] == [
        ("revolute", (-1, 1)),
        ("continuous", None),
    ]
    pose = found.link_poses({"m::j": 0.5, "m::j::2": np.pi / 2})["m::k"][0, :3, :3]
    assert np.allclose(pose, trimesh.transformations.euler_matrix(np.pi / 2, 0, 0.5)[:3, :3])


@pytest.mark.parametrize("tag", ["road", "population"])
def test_roads_and_populations_are_a_warning(tmp_path, tag):
    path = write(tmp_path, world(f'<{tag} name="r"/><model name="m">{BOX_LINK}</model>'))
    with pytest.warns(UserWarning, match=tag):
        assert [item.name for item in wv.Scene.load(path)] == ["m::l::v"]


def test_simulation_and_effects_are_ignored(tmp_path):
    link = (
        f"<inertial><mass>x</mass></inertial>{visual(BOX)}<projector name='p'><texture>gone.png</texture></projector>"
    )
    link += (
        f"<collision name='c'><geometry>{BOX}</geometry><surface><friction><ode><mu>x</mu></ode></friction></surface>"
    )
    link += "</collision><particle_emitter name='e' type='point'/>"
    plugin = "<plugin name='p' filename='gone.so'><pose>9</pose></plugin>"
    body = f"<physics type='x'/><gui/><wind/>{plugin}<model name='m'>{plugin}<link name='l'>{link}</link></model>"
    assert only(read(tmp_path, world(body))).name == "m::l::v"
