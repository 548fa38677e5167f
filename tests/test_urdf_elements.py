# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of docs/scene_files/urdf.md that `test_urdf` does not cover."""

import zipfile

import numpy as np
import pytest
import trimesh
from PIL import Image

from warpvis import Scene

BOX = '<geometry><box size="1 2 3"/></geometry>'


def load(folder, *visuals, more="", **options):
    path = folder / "robot.urdf"
    shown = "".join(f"<visual>{visual}</visual>" for visual in visuals)
    path.write_text(f'<robot name="r"><link name="a">{shown}</link>{more}</robot>')
    return Scene.load(path, **options)


def mesh(name):
    return f'<geometry><mesh filename="{name}"/></geometry>'


def test_boxes_have_12_triangles(tmp_path):
    assert load(tmp_path, BOX).triangle_count == 12


@pytest.mark.parametrize("radius", [0.01, 0.3, 5.0])
def test_static_round_shapes_are_within_half_a_millimeter(tmp_path, radius):
    """The distances of the centers of triangles and edges to the exact shape."""
    for shape in (f'<sphere radius="{radius}"/>', f'<cylinder radius="{radius}" length="1"/>'):
        item = load(tmp_path, f"<geometry>{shape}</geometry>")["a"]
        assert item.solid is None
        corners = item.vertices[item.faces].astype(np.float64)
        points = np.concatenate([corners.mean(axis=1), corners[:, :2].mean(axis=1)])
        if shape.startswith("<cyl"):
            sides = np.ptp(np.sign(corners[..., 2]), axis=1) > 0
            points = np.concatenate([corners.mean(axis=1)[sides], corners[sides][:, :2].mean(axis=1)])[:, :2]
        distances = radius - np.linalg.norm(points, axis=1)
        assert np.abs(distances).max() < 5e-4


@pytest.mark.parametrize("axis", ["Y_UP", "Z_UP"])
def test_unit_and_axes_of_collada(tmp_path, axis):
    pytest.importorskip("collada")
    text = trimesh.exchange.dae.export_collada(trimesh.creation.box((100, 200, 300))).decode()
    start, end = text.index("<asset"), text.index("</asset>") + len("</asset>")
    asset = f'<asset><unit name="cm" meter="0.01"/><up_axis>{axis}</up_axis></asset>'
    (tmp_path / "box.dae").write_text(text[:start] + asset + text[end:])
    np.testing.assert_allclose(load(tmp_path, mesh("box.dae")).bounds, [(-0.5, -1, -1.5), (0.5, 1, 1.5)], atol=1e-6)


def test_unit_of_3mf(tmp_path):
    pytest.importorskip("lxml")
    pytest.importorskip("networkx")
    corners = "".join(f'<vertex x="{x}" y="{y}" z="{z}"/>' for x, y, z in [(0, 0, 0), (100, 0, 0), (0, 200, 0)])
    body = f'<vertices>{corners}</vertices><triangles><triangle v1="0" v2="1" v3="2"/></triangles>'
    model = '<model unit="centimeter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources>'
    model += f'<object id="1" type="model"><mesh>{body}</mesh></object></resources><build><item objectid="1"/></build>'
    with zipfile.ZipFile(tmp_path / "a.3mf", "w") as archive:
        archive.writestr("3D/3dmodel.model", f'<?xml version="1.0"?>{model}</model>')
    np.testing.assert_allclose(load(tmp_path, mesh("a.3mf")).bounds, [(0, 0, 0), (1, 2, 0)], atol=1e-6)


def test_stl_is_in_meters(tmp_path):
    trimesh.creation.box((100, 200, 300)).export(tmp_path / "a.stl")
    np.testing.assert_allclose(load(tmp_path, mesh("a.stl")).bounds, [(-50, -100, -150), (50, 100, 150)])


def test_textures_are_multiplied_by_colors(tmp_path):
    Image.new("RGB", (2, 2), (255, 200, 100)).save(tmp_path / "photo.png")
    (tmp_path / "a.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n")
    look = '<material name="t"><color rgba="0.5 0.5 1 1"/><texture filename="photo.png"/></material>'
    (material,) = load(tmp_path, mesh("a.obj") + look)["a"].appearance.materials
    assert material.base_color == (0.5, 0.5, 1, 1)
    assert (material.texture.image[..., :3] == (255, 200, 100)).all()


def test_materials_of_the_robot_precede_those_of_links(tmp_path):
    """A visual element that defines a color has that; others have the first of the robot, else of any link."""
    red, green, blue = (
        f'<material name="m"><color rgba="{color} 1"/></material>' for color in ("1 0 0", "0 1 0", "0 0 1")
    )
    visuals = [BOX + red, BOX + blue, BOX + '<material name="m"/>']

    def colors(more):
        return [item.appearance.materials[0].base_color[:3] for item in load(tmp_path, *visuals, more=more)]

    assert colors(green + blue) == [(1, 0, 0), (0, 0, 1), (0, 1, 0)]
    assert colors("") == [(1, 0, 0), (0, 0, 1), (1, 0, 0)]


@pytest.mark.parametrize(
    "element",
    [
        '<calibration rising="x"/>',
        '<safety_controller k_velocity="x"/>',
        '<dynamics damping="x"/>',
    ],
)
def test_other_elements_of_joints_are_ignored(tmp_path, element):
    ends = f'<parent link="a"/><child link="b"/><axis xyz="0 0 1"/>{element}'
    found = load(tmp_path, BOX, more=f'<link name="b"/><joint name="j" type="continuous">{ends}</joint>').joints
    assert found.names == ("j",) and found["j"].limits is None


def test_elements_of_simulators_are_ignored(tmp_path):
    more = '<mujoco><compiler meshdir="x"/></mujoco><drake:joint name="j" type="planar"/><sensor name="s" type="x"/>'
    scene = load(tmp_path, BOX, more=more)
    assert [item.name for item in scene] == ["a"] and not scene.joints.names
