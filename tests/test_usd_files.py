# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""USD stages equal scenes built by hand; instances share their mesh."""

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scene import Y_UP_TO_Z_UP

from support import usd_stages as stages

pytest.importorskip("pxr")
from pxr import Gf, Usd, UsdGeom, UsdSemantics

BOX = trimesh.creation.box((1, 2, 3))
BALL = trimesh.creation.icosphere(subdivisions=2, radius=0.3)


def add_mesh(stage, path, mesh):
    prim = UsdGeom.Mesh.Define(stage, path)
    prim.CreatePointsAttr(np.asarray(mesh.vertices, dtype=np.float32))
    prim.CreateFaceVertexCountsAttr(np.full(len(mesh.faces), 3, dtype=np.int32))
    prim.CreateFaceVertexIndicesAttr(np.asarray(mesh.faces, dtype=np.int32).ravel())
    prim.CreateSubdivisionSchemeAttr("none")
    return prim


def new_stage(path, *, meters=1.0, up="Z"):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageMetersPerUnit(stage, meters)
    UsdGeom.SetStageUpAxis(stage, up)
    return stage


@pytest.mark.parametrize("suffix", ["usda", "usdc", "usd"])
def test_nested_stage_in_centimeters_equals_scene_built_by_hand(tmp_path, suffix):
    stage = new_stage(tmp_path / f"room.{suffix}", meters=0.01, up="Y")
    room = UsdGeom.Xform.Define(stage, "/Room")
    room.AddTranslateOp().Set(Gf.Vec3d(100, 20, -40))
    room.AddRotateYOp().Set(30.0)
    table = UsdGeom.Xform.Define(stage, "/Room/Table")
    table.AddTranslateOp().Set(Gf.Vec3d(0, 70, 0))
    table.AddRotateXYZOp().Set(Gf.Vec3f(10, 20, 30))
    UsdSemantics.LabelsAPI.Apply(table.GetPrim(), "class").CreateLabelsAttr(["table"])
    top = add_mesh(stage, "/Room/Table/Top", BOX)
    top.AddScaleOp().Set(Gf.Vec3f(100, 50, 25))
    ball = add_mesh(stage, "/Room/Table/Top/Ball", BALL)
    ball.AddTranslateOp().Set(Gf.Vec3d(0, 2, 0))
    UsdSemantics.LabelsAPI.Apply(ball.GetPrim(), "class").CreateLabelsAttr(["ball"])
    stage.GetRootLayer().Save()
    read = wv.Scene.load(tmp_path / f"room.{suffix}")
    names = ["/Room/Table/Top", "/Room/Table/Top/Ball"]
    assert [item.name for item in read] == names
    assert [item.category for item in read] == ["table", "ball"]
    assert [wv.Label(item.label) for item in read] == [wv.Label.OBSTACLE, wv.Label.OBJECT]
    places = [UsdGeom.Xformable(item).ComputeLocalToWorldTransform(0) for item in (top, ball)]
    expected = wv.Scene()
    for name, mesh, place in zip(names, (BOX, BALL), places, strict=True):
        matrix = np.diag([0.01, 0.01, 0.01, 1.0]) @ np.array(place).T
        vertices = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        expected.add((vertices @ Y_UP_TO_Z_UP[:3, :3].T, mesh.faces), name=name)
    for one, other in zip(read, expected, strict=True):
        np.testing.assert_allclose(one.vertices, other.vertices, atol=1e-6)
        np.testing.assert_array_equal(one.faces, other.faces)


def test_vertical_axis_can_be_that_of_the_stage(tmp_path):
    path = stages.write(tmp_path, stages.mesh("a"), header='#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Y"\n)\n')
    np.testing.assert_allclose(wv.Scene.load(path, up="y")["/a"].vertices[2], (0, 1, 0))
    np.testing.assert_allclose(wv.Scene.load(path)["/a"].vertices[2], (0, 0, 1), atol=1e-7)


def test_unit_defaults_to_centimeters_and_y_up(tmp_path):
    path = stages.write(tmp_path, stages.mesh("a"), header="#usda 1.0\n")
    np.testing.assert_allclose(wv.Scene.load(path)["/a"].vertices[2], (0, 0, 0.01), atol=1e-9)
    np.testing.assert_allclose(wv.Scene.load(path, scale=100, file_up="z")["/a"].vertices[2], (0, 1, 0), atol=1e-7)


def test_instances_of_a_large_mesh_share_it(tmp_path):
    grid = trimesh.creation.icosphere(subdivisions=7)
    assert len(grid.faces) > 200_000
    stage = new_stage(tmp_path / "many.usdc")
    stage.CreateClassPrim("/Chair")
    add_mesh(stage, "/Chair/Seat", grid)
    add_mesh(stage, "/Chair/Back", BOX)
    for number in range(100):
        form = UsdGeom.Xform.Define(stage, f"/World/chair_{number}")
        form.AddTranslateOp().Set(Gf.Vec3d(number, 0, 0))
        form.AddRotateZOp().Set(7.0 * number)
        form.GetPrim().GetReferences().AddInternalReference("/Chair")
        form.GetPrim().SetInstanceable(True)
    stage.GetRootLayer().Save()
    scene = wv.Scene.load(tmp_path / "many.usdc")
    assert len(scene) == 200
    seats = [scene[f"/World/chair_{number}/Seat"] for number in range(100)]
    assert len({id(item.mesh) for item in scene}) == 2
    assert all(item.shares_mesh for item in seats)
    expected = np.array(UsdGeom.Xformable(stage.GetPrimAtPath("/World/chair_9/Seat")).ComputeLocalToWorldTransform(0)).T
    np.testing.assert_allclose(poses_to_matrices(seats[9].place), expected, atol=1e-9)


def test_point_instancers_are_expanded(tmp_path):
    prototypes = stages.mesh("small") + 'over Xform "group"\n{\n    double3 xformOp:translate = (0, 0, 5)\n'
    prototypes += '    uniform token[] xformOpOrder = ["xformOp:translate"]\n' + stages.mesh("inner") + "}\n"
    text = f"""
def Xform "World"
{{
    double3 xformOp:translate = (0, 10, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def PointInstancer "Many"
    {{
        rel prototypes = [</World/Many/small>, </World/Many/group>]
        int[] protoIndices = [0, 1, 0, 1]
        point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
        quath[] orientations = [(1, 0, 0, 0), (0.7071, 0, 0, 0.7071), (1, 0, 0, 0), (1, 0, 0, 0)]
        float3[] scales = [(1, 1, 1), (1, 2, 3), (1, 1, 1), (1, 1, 1)]
        int64[] ids = [10, 11, 12, 13]
        int64[] invisibleIds = [13]
        {prototypes}
    }}
}}
"""
    scene = stages.load(tmp_path, text)
    assert [item.name for item in scene] == [
        "/World/Many/0/small",
        "/World/Many/2/small",
        "/World/Many/1/group/inner",
    ]
    assert scene["/World/Many/0/small"].mesh is scene["/World/Many/2/small"].mesh
    stage = Usd.Stage.Open(str(tmp_path / "stage.usda"))
    matrices = UsdGeom.PointInstancer(stage.GetPrimAtPath("/World/Many")).ComputeInstanceTransformsAtTime(0, 0)
    place = np.array(matrices[1]).T
    points = np.array([(0.0, 0, 0), (1, 0, 0), (0, 1, 0)])
    expected = points @ place[:3, :3].T + place[:3, 3] + (0, 10, 0)
    np.testing.assert_allclose(scene["/World/Many/1/group/inner"].vertices, expected, atol=1e-6)


def test_nested_point_instancers_multiply(tmp_path):
    text = """
def PointInstancer "Outer"
{
    rel prototypes = [</Outer/Inner>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (10, 0, 0)]
    def PointInstancer "Inner"
    {
        rel prototypes = [</Outer/Inner/Leaf>]
        int[] protoIndices = [0, 0, 0]
        point3f[] positions = [(0, 0, 0), (0, 1, 0), (0, 2, 0)]
        LEAF
    }
}
"""
    scene = stages.load(tmp_path, text.replace("LEAF", stages.mesh("Leaf")))
    assert len(scene) == 6 and len({id(item.mesh) for item in scene}) == 1
    np.testing.assert_allclose(scene["/Outer/1/Inner/2/Leaf"].vertices[0], (10, 2, 0), atol=1e-6)
