# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shapes, transforms and composition of USD stages; bounds are compared with those of usd-core."""

import numpy as np
import pytest
from PIL import Image

import warpvis as wv
from warpvis.errors import FileFormatError, SceneError

from support import usd_stages as stages
from support.usd_stages import bounds, usd_bounds

pytest.importorskip("pxr")
from pxr import Sdf, Usd, UsdSemantics, UsdUtils


def names(scene):
    return [item.name for item in scene]


SHAPES = {
    "Cube": "double size = 3",
    "Cube by default": "",
    "Sphere": "double radius = 0.5",
    "Cylinder": "double radius = 0.5\ndouble height = 3",
    "Cylinder by default": "",
    "Cylinder_1": "double radiusBottom = 0.5\ndouble radiusTop = 0.25\ndouble height = 3",
    "Cone": "double radius = 0.5\ndouble height = 3",
    "Capsule": "double radius = 0.5\ndouble height = 3",
    "Capsule by default": "",
    "Capsule_1": "double radiusBottom = 0.5\ndouble radiusTop = 0.25\ndouble height = 3",
    "Plane": "double width = 3\ndouble length = 5",
}


@pytest.mark.parametrize("axis", ["", "X", "Y", "Z"])
@pytest.mark.parametrize("shape", SHAPES)
def test_simple_shapes_have_the_bounds_of_usd(tmp_path, shape, axis):
    kind = shape.partition(" ")[0]
    chosen = f'uniform token axis = "{axis}"' if axis and kind not in ("Cube", "Sphere") else ""
    scene = stages.load(tmp_path, f'def {kind} "a"\n{{\n{SHAPES[shape]}\n{chosen}\n}}\n')
    np.testing.assert_allclose(bounds(scene), usd_bounds(tmp_path / "stage.usda"), atol=2e-3)
    item = scene["/a"]
    triangles = item.vertices[item.faces].astype(np.float64)
    if kind != "Plane":  # outward faces, and a closed surface
        volume = np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6
        assert volume > 0
        edges = np.concatenate([item.faces[:, [0, 1]], item.faces[:, [1, 2]], item.faces[:, [2, 0]]])
        assert set(map(tuple, edges)) == set(map(tuple, edges[:, ::-1]))
        outward = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
        if item.appearance is not None and item.appearance.normals is not None:
            assert (np.einsum("ikj,ij->ik", item.appearance.normals, outward) > 0).all()


def test_cones_point_along_their_axis(tmp_path):
    for axis, column in (("X", 0), ("Y", 1), ("Z", 2)):
        scene = stages.load(tmp_path, f'def Cone "a"\n{{\nuniform token axis = "{axis}"\n}}\n')
        tip = scene["/a"].vertices[np.argmax(scene["/a"].vertices[:, column])]
        np.testing.assert_allclose(np.delete(tip, column), 0, atol=1e-9)


def test_polygons_are_fans_without_holes(tmp_path):
    shape = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 2, 0), (9, 9, 9)]
    int[] faceVertexCounts = [4, 3, 2]
    int[] faceVertexIndices = [0, 1, 2, 3, 3, 2, 4, 0, 1]
    """
    assert stages.load(tmp_path, stages.mesh("a", "", shape))["/a"].faces.tolist() == [[0, 1, 2], [0, 2, 3], [3, 2, 4]]
    scene = stages.load(tmp_path, stages.mesh("b", "int[] holeIndices = [1]", shape))
    assert scene["/b"].faces.tolist() == [[0, 1, 2], [0, 2, 3]]
    scene = stages.load(tmp_path, stages.mesh("c", 'uniform token orientation = "leftHanded"', shape))
    assert scene["/c"].faces.tolist() == [[0, 2, 1], [0, 3, 2], [3, 4, 2]]


def test_double_sided_meshes_have_double_sided_materials(tmp_path):
    color = "color3f[] primvars:displayColor = [(1, 0, 0)]"
    scene = stages.load(
        tmp_path, stages.mesh("a", color) + stages.mesh("b", color + "\nuniform bool doubleSided = 1", stages.SQUARE)
    )
    assert [item.appearance.materials[0].double_sided for item in scene] == [False, True]


def test_subdivision_surfaces_are_their_smooth_cage(tmp_path):
    shape = stages.SQUARE.replace('"none"', '"catmullClark"').replace("(2, 1, 0)", "(2, 1, 1)")
    item = stages.load(tmp_path, stages.mesh("a", "", shape))["/a"]
    assert len(item.faces) == 2
    assert item.appearance.normals.shape == (4, 3)
    flat = stages.load(tmp_path, stages.mesh("b", "", stages.SQUARE))["/b"]
    assert flat.appearance is None or flat.appearance.normals is None


def test_surfaces_of_tetrahedra(tmp_path):
    text = """
def TetMesh "a"
{
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
    int4[] tetVertexIndices = [(0, 1, 2, 3), (1, 2, 3, 4)]
}
"""
    item = stages.load(tmp_path, text)["/a"]
    assert len(item.faces) == 6  # the common side is inside


NORMALS = {
    "vertex": ("[(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, 2)]", (4, 3)),
    "faceVarying": ("[(0, 0, 1), (0, 1, 0), (1, 0, 0), (0, 0, 2)]", (2, 3, 3)),
    "constant": ("[(0, 0, 5)]", (4, 3)),
}


@pytest.mark.parametrize("interpolation", NORMALS)
@pytest.mark.parametrize("attribute", ["normals", "primvars:normals"])
def test_normals_are_read(tmp_path, interpolation, attribute):
    values, shape = NORMALS[interpolation]
    text = f'normal3f[] {attribute} = {values} (\n    interpolation = "{interpolation}"\n)'
    found = stages.load(tmp_path, stages.mesh("a", text, stages.SQUARE))["/a"].appearance.normals
    assert found.shape == shape
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, atol=1e-6)
    np.testing.assert_allclose(found.reshape(-1, 3)[0], (0, 0, 1))


def test_invalid_normals_are_replaced_by_those_of_faces(tmp_path):
    text = 'normal3f[] normals = [(0, 0, 0), (0, 1, 0), (nan, 0, 0), (0, 1, 0)] (\n    interpolation = "vertex"\n)'
    found = stages.load(tmp_path, stages.mesh("a", text, stages.SQUARE))["/a"].appearance.normals
    np.testing.assert_allclose(found[0], [(0, 0, 1), (0, 1, 0), (0, 0, 1)])


PURPOSES = {
    "inherited": (
        f'def Xform "r" {{\n    uniform token purpose = "guide"\n    {stages.mesh("a")}\n'
        f"    {stages.mesh('b', 'uniform token purpose = ' + chr(34) + 'render' + chr(34))}\n}}\n",
        ["/r/b", "/z"],
    ),
    "proxy": (stages.mesh("a", 'uniform token purpose = "proxy"'), ["/z"]),
    "invisible": (
        f'def Xform "r" {{\n    token visibility = "invisible"\n'
        f"    {stages.mesh('a', 'token visibility = ' + chr(34) + 'inherited' + chr(34))}\n}}\n",
        ["/z"],
    ),
    "inactive": ('def Xform "r" (\n    active = false\n)\n{\n' + stages.mesh("a") + "}\n", ["/z"]),
    "abstract": ('class Xform "r"\n{\n' + stages.mesh("a") + "}\n", ["/z"]),
    "over": ('over "r"\n{\n' + stages.mesh("a") + "}\n", ["/z"]),
    "collider": (
        'def Mesh "a" (\n    prepend apiSchemas = ["PhysicsCollisionAPI"]\n)\n{'
        + stages.TRIANGLE
        + 'uniform token purpose = "guide"\n}\n',
        ["/z"],
    ),
}


@pytest.mark.parametrize("case", PURPOSES)
def test_hidden_prims_are_not_read(tmp_path, case):
    text, expected = PURPOSES[case]
    assert names(stages.load(tmp_path, text + stages.mesh("z"))) == expected


def test_selected_variants_are_read(tmp_path):
    text = f"""
def Xform "a" (
    variants = {{
        string look = "second"
    }}
    prepend variantSets = "look"
)
{{
    variantSet "look" = {{
        "first" {{
            {stages.mesh("one")}
        }}
        "second" {{
            {stages.mesh("two")}
        }}
    }}
}}
"""
    assert names(stages.load(tmp_path, text)) == ["/a/two"]


def test_first_frame_is_read(tmp_path):
    header = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n    startTimeCode = 10\n    endTimeCode = 20\n)\n'
    text = "double3 xformOp:translate.timeSamples = {\n 0: (5, 0, 0),\n 10: (7, 0, 0),\n 20: (9, 0, 0)\n}\n"
    text += 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    path = stages.write(tmp_path, stages.mesh("a", text), header=header)
    np.testing.assert_allclose(wv.Scene.load(path)["/a"].vertices[0], (7, 0, 0))
    without = header.replace("    startTimeCode = 10\n    endTimeCode = 20\n", "")
    path = stages.write(tmp_path, stages.mesh("a", text), "other.usda", header=without)
    np.testing.assert_allclose(wv.Scene.load(path)["/a"].vertices[0], (5, 0, 0))


def test_transforms_with_shear_flattening_and_reset_are_exact(tmp_path):
    matrix = "( (1, 0, 0, 0), (0.5, 1, 0, 0), (0, 0, 1, 0), (4, 0, 0, 1) )"
    sheared = f'matrix4d xformOp:transform = {matrix}\nuniform token[] xformOpOrder = ["xformOp:transform"]'
    flat = 'float3 xformOp:scale = (1, -2, 0)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    reset = 'uniform token[] xformOpOrder = ["!resetXformStack!"]'
    inner = stages.mesh("s", sheared) + stages.mesh("f", flat) + stages.mesh("r", reset)
    text = 'def Xform "x"\n{\n    double3 xformOp:translate = (0, 0, 1)\n'
    scene = stages.load(tmp_path, text + f'    uniform token[] xformOpOrder = ["xformOp:translate"]\n{inner}}}\n')
    np.testing.assert_allclose(scene["/x/s"].vertices, [(4, 0, 1), (5, 0, 1), (4.5, 1, 1)], atol=1e-9)
    np.testing.assert_allclose(scene["/x/f"].vertices, [(0, 0, 1), (1, 0, 1), (0, -2, 1)], atol=1e-9)
    np.testing.assert_allclose(scene["/x/r"].vertices, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], atol=1e-9)


def test_homogeneous_matrices_are_divided(tmp_path):
    matrix = "( (2, 0, 0, 0), (0, 4, 0, 0), (0, 0, 2, 0), (6, 0, 0, 2) )"
    text = f'matrix4d xformOp:transform = {matrix}\nuniform token[] xformOpOrder = ["xformOp:transform"]'
    item = stages.load(tmp_path, stages.mesh("a", text))["/a"]
    np.testing.assert_allclose(item.vertices, [(3, 0, 0), (4, 0, 0), (3, 2, 0)], atol=1e-9)


SKIN = f"""
def SkelRoot "person"
{{
    def Mesh "skin" (prepend apiSchemas = ["SkelBindingAPI"])
    {{{stages.TRIANGLE}
        int[] primvars:skel:jointIndices = [0, 0, 1] (interpolation = "vertex"
            elementSize = 1)
        float[] primvars:skel:jointWeights = [1, 1, 1] (interpolation = "vertex"
            elementSize = 1)
        rel skel:skeleton = </person/bones>
    }}
    def Skeleton "bones" (prepend apiSchemas = ["SkelBindingAPI"])
    {{
        uniform token[] joints = ["hip", "hip/knee"]
        uniform matrix4d[] bindTransforms = [
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
        uniform matrix4d[] restTransforms = [
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
            ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))]
        rel skel:animationSource = </person/walk>
    }}
    def SkelAnimation "walk"
    {{
        uniform token[] joints = ["hip", "hip/knee"]
        float3[] translations = [(0, 0, 1), (0, 0, 2)]
        quatf[] rotations = [(1, 0, 0, 0), (1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1), (1, 1, 1)]
    }}
}}
"""


def test_skinned_meshes_are_posed(tmp_path):
    item = stages.load(tmp_path, SKIN)["/person/skin"]
    np.testing.assert_allclose(item.vertices, [(0, 0, 1), (1, 0, 1), (0, 1, 3)], atol=1e-6)


def test_mirrored_meshes_keep_their_front(tmp_path):
    text = 'float3 xformOp:scale = (-1, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'
    item = stages.load(tmp_path, stages.mesh("a", text))["/a"]
    a, b, c = item.vertices[item.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0


def test_references_and_payloads_are_read(tmp_path):
    (tmp_path / "parts").mkdir()
    stages.write(tmp_path / "parts", 'def Xform "mug"\n{\n' + stages.mesh("body") + "}\n", "mug.usda")
    text = 'def "one" (\n    prepend references = @parts/mug.usda@</mug>\n)\n{\n}\n'
    text += 'def "two" (\n    prepend payload = @parts/mug.usda@</mug>\n)\n{\n}\n'
    scene = stages.load(tmp_path, text)
    assert names(scene) == ["/one/body", "/two/body"]
    assert scene["/one/body"].mesh is scene["/two/body"].mesh


def test_search_path_finds_references(tmp_path):
    (tmp_path / "library").mkdir()
    stages.write(tmp_path / "library", 'def Xform "mug"\n{\n' + stages.mesh("body") + "}\n", "mug.usda")
    text = 'def "one" (\n    prepend references = @mug.usda@</mug>\n)\n{\n}\n'
    assert names(stages.load(tmp_path, text, search_path=tmp_path / "library")) == ["/one/body"]


LABELED = f"""
def Xform "kitchen" (
    prepend apiSchemas = ["SemanticsLabelsAPI:class", "SemanticsLabelsAPI:wikidata"]
)
{{
    token[] semantics:labels:class = ["room"]
    token[] semantics:labels:wikidata = ["Q43164"]
    {stages.mesh("walls")}
    def Xform "mug" (
        prepend apiSchemas = ["SemanticsLabelsAPI:class"]
    )
    {{
        token[] semantics:labels:class = ["mug", "cup"]
        {stages.mesh("body")}
    }}
}}
def Xform "old" (
    prepend apiSchemas = ["SemanticsAPI:Semantics_a"]
)
{{
    string semantic:Semantics_a:params:semanticType = "class"
    string semantic:Semantics_a:params:semanticData = "person"
    {stages.mesh("skin")}
}}
"""


def test_semantic_labels_are_categories(tmp_path):
    scene = stages.load(tmp_path, LABELED, labels={"Q43164": "ground", "cup": "robot"})
    assert [item.category for item in scene] == ["room", "mug", "person"]
    assert [wv.Label(item.label) for item in scene] == [wv.Label.GROUND, wv.Label.ROBOT, wv.Label.HUMAN]
    stage = Usd.Stage.Open(str(tmp_path / "stage.usda"))
    query = UsdSemantics.LabelsQuery("class", 0.0)
    body = query.ComputeUniqueInheritedLabels(stage.GetPrimAtPath("/kitchen/mug/body"))
    assert scene["/kitchen/mug/body"].category in body and set(body) == {"room", "mug", "cup"}


def test_patterns_match_prims_above(tmp_path):
    scene = stages.load(tmp_path, LABELED, labels={"kitchen": "ground", "/kitchen/mug": "object"})
    assert [wv.Label(item.label) for item in scene] == [wv.Label.GROUND, wv.Label.OBJECT, wv.Label.HUMAN]


def test_other_prims_are_listed(tmp_path):
    text = 'def BasisCurves "hair" {}\ndef Points "dust" {}\ndef Points "mist" {}\ndef NurbsPatch "sheet" {}\n'
    with pytest.warns(UserWarning, match=r"1 of NURBS patches, 1 of curves, 2 of points.*can convert them to meshes"):
        stages.load(tmp_path, text + stages.mesh("a"))
    with pytest.raises(FileFormatError, match="left out prims without triangles"):
        wv.Scene.load(tmp_path / "stage.usda", strict=True)
    with pytest.raises(SceneError, match=r"curves.*; nothing is left"):
        stages.load(tmp_path, 'def BasisCurves "hair" {}\n')


def test_archives_contain_textures(tmp_path):
    Image.new("RGB", (4, 4), (200, 100, 50)).save(tmp_path / "wood.png")
    stages.write(tmp_path, stages.textured("wood.png"))
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "stage.usda")), str(tmp_path / "a.usdz"))
    (tmp_path / "wood.png").unlink()
    (tmp_path / "stage.usda").unlink()
    texture = next(iter(wv.Scene.load(tmp_path / "a.usdz"))).appearance.materials[0].texture
    assert texture.image.shape == (4, 4, 3) and texture.image[0, 0].tolist() == [200, 100, 50]
