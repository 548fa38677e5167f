# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Layers, instances, skeletons and skipped prims of USD stages, compared with usd-core."""

import warnings

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import FileFormatError

from support import usd_stages as stages
from support.usd_stages import bounds, usd_bounds

pytest.importorskip("pxr")
from pxr import Usd, UsdGeom, UsdSkel

UP = ("double3", "translate", "(0, 0, 5)")


def names(scene):
    return [item.name for item in scene]


def test_sublayers_are_composed(tmp_path):
    """The stronger layer moves the mesh of the weaker one, and adds another."""
    stages.write(tmp_path, stages.placed("room", UP, inner=stages.mesh("walls")), "weak.usda")
    strong = (
        'over "room"\n{\n    double3 xformOp:translate = (0, 0, 7)\n' + stages.mesh("door", "", stages.SQUARE) + "}\n"
    )
    header = stages.METERS.replace("(\n", "(\n    subLayers = [@./weak.usda@]\n", 1)
    path = stages.write(tmp_path, strong, header=header)
    scene = wv.Scene.load(path)
    assert sorted(names(scene)) == ["/room/door", "/room/walls"]
    np.testing.assert_allclose(bounds(scene), usd_bounds(path), atol=1e-6)
    assert bounds(scene)[0, 2] == 7


def test_meshes_are_stored_once_per_size(tmp_path):
    (tmp_path / "parts").mkdir()
    stages.write(tmp_path / "parts", stages.mesh("body"), "mug.usda")
    text = ""
    for number, size in enumerate((1, 2, 2, 1)):
        ops = ("double3", "translate", f"({number}, 0, 0)"), ("float3", "scale", f"({size}, {size}, {size})")
        inner = 'def "mug" (\n    prepend references = @parts/mug.usda@</body>\n)\n{\n}\n'
        text += stages.placed(f"x{number}", *ops, inner=inner)
    scene = stages.load(tmp_path, text)
    meshes = {name: scene[f"/x{name}/mug"].mesh for name in range(4)}
    assert meshes[0] is meshes[3] and meshes[1] is meshes[2] and meshes[0] is not meshes[1]
    np.testing.assert_allclose(bounds(scene), usd_bounds(tmp_path / "stage.usda"), atol=1e-6)


RED = "color3f[] primvars:displayColor = [(1, 0, 0)]"


def test_equal_meshes_and_instances_share_mesh_and_appearance(tmp_path):
    """Meshes `a` and `b` are equal without instancing; `c` has another color; `d` and `e` are instances."""
    text = stages.mesh("a", RED) + stages.mesh("b", RED) + stages.mesh("c", RED.replace("1, 0", "0, 1"))
    text += 'class Xform "chair"\n{\n' + stages.mesh("seat", RED, stages.SQUARE) + "}\n"
    for name in "de":
        text += f'def "{name}" (\n    instanceable = true\n    prepend references = </chair>\n)\n{{\n}}\n'
    scene = stages.load(tmp_path, text)
    assert scene["/a"].mesh is scene["/b"].mesh and scene["/a"].appearance is scene["/b"].appearance
    assert scene["/a"].appearance.materials[0].base_color != scene["/c"].appearance.materials[0].base_color
    one, other = scene["/d/seat"], scene["/e/seat"]
    assert one.mesh is other.mesh and one.appearance is other.appearance and one.shares_mesh


INSTANCER = f"""
def PointInstancer "trees"
{{
    rel prototypes = [</trees/Trunk>]
    int[] protoIndices = [0, 0, 0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (3, 0, 0)]
    int64[] ids = [7, 8, 9, 10]
    {stages.mesh("Trunk")}
}}
"""


def test_inactive_and_invisible_instances_are_those_of_usd(tmp_path):
    path = stages.write(tmp_path, INSTANCER)
    stage = Usd.Stage.Open(str(path))
    instancer = UsdGeom.PointInstancer(stage.GetPrimAtPath("/trees"))
    instancer.DeactivateId(9)
    instancer.InvisId(7, Usd.TimeCode.Default())
    stage.Export(str(tmp_path / "other.usda"))
    scene = wv.Scene.load(tmp_path / "other.usda")
    shown = np.flatnonzero(instancer.ComputeMaskAtTime(Usd.TimeCode.EarliestTime())).tolist()
    assert names(scene) == [f"/trees/{number}/Trunk" for number in shown] == ["/trees/1/Trunk", "/trees/3/Trunk"]
    np.testing.assert_allclose(bounds(scene), usd_bounds(tmp_path / "other.usda"), atol=1e-6)


def test_instancers_whose_arrays_do_not_fit_are_left_out(tmp_path):
    path = stages.write(tmp_path, INSTANCER.replace("(0, 0, 0), ", "") + stages.mesh("a"))
    with pytest.warns(UserWarning, match=r"left out instances: </trees> must have one of positions for each of its 4"):
        assert names(wv.Scene.load(path)) == ["/a"]
    with pytest.raises(FileFormatError, match="left out instances: </trees>"):
        wv.Scene.load(path, strict=True)


IDENTITY = "((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))"
PERSON = f"""
def SkelRoot "person"
{{
    def Mesh "skin" (prepend apiSchemas = ["SkelBindingAPI"])
    {{{stages.TRIANGLE}
        int[] primvars:skel:jointIndices = [0, 0, 1] (interpolation = "vertex"
            elementSize = 1)
        float[] primvars:skel:jointWeights = [1, 1, 1] (interpolation = "vertex"
            elementSize = 1)
        rel skel:skeleton = </person/bones>
        uniform token[] skel:blendShapes = ["smile"]
        rel skel:blendShapeTargets = </person/skin/smile>
        def BlendShape "smile"
        {{
            uniform vector3f[] offsets = [(0, 0, 0), (0.5, 0, 0), (0, 0.25, 0)]
        }}
    }}
    def Skeleton "bones" (prepend apiSchemas = ["SkelBindingAPI"])
    {{
        uniform token[] joints = ["hip", "hip/knee"]
        uniform matrix4d[] bindTransforms = [{IDENTITY}, {IDENTITY}]
        uniform matrix4d[] restTransforms = [{IDENTITY}, {IDENTITY}]
        rel skel:animationSource = </person/walk>
    }}
    def SkelAnimation "walk"
    {{
        uniform token[] joints = ["hip", "hip/knee"]
        uniform token[] blendShapes = ["smile"]
        float[] blendShapeWeights.timeSamples = {{ 10: [0.5], 20: [1] }}
        float3[] translations.timeSamples = {{ 10: [(0, 0, 1), (0, 0, 2)], 20: [(0, 0, 9), (0, 0, 9)] }}
        quatf[] rotations = [(1, 0, 0, 0), (1, 0, 0, 0)]
        half3[] scales = [(1, 1, 1), (1, 1, 1)]
    }}
}}
"""
FRAMES = stages.METERS.replace("(\n", "(\n    startTimeCode = 10\n    endTimeCode = 20\n", 1)


def test_skinned_meshes_have_the_pose_and_shape_of_the_first_frame(tmp_path):
    path = stages.write(tmp_path, PERSON, header=FRAMES)
    found = wv.Scene.load(path)["/person/skin"].vertices
    stage = Usd.Stage.Open(str(path))
    skin, root = stage.GetPrimAtPath("/person/skin"), UsdSkel.Root(stage.GetPrimAtPath("/person"))
    cache = UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    skinning = cache.GetSkinningQuery(skin)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(stage.GetPrimAtPath("/person/bones")))
    points = UsdGeom.Mesh(skin).GetPointsAttr().Get()
    query = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(skin))
    weights = skeleton.GetAnimQuery().ComputeBlendShapeWeights(10)
    shaped = query.ComputeSubShapeWeights(weights)
    assert query.ComputeDeformedPoints(
        *shaped, query.ComputeBlendShapePointIndices(), query.ComputeSubShapePointOffsets(), points
    )
    assert skinning.ComputeSkinnedPoints(skeleton.ComputeSkinningTransforms(10), points, 10)
    np.testing.assert_allclose(found, np.array(points), atol=1e-6)
    np.testing.assert_allclose(found, [(0, 0, 1), (1.25, 0, 1), (0, 1.125, 3)], atol=1e-6)


def test_skinned_meshes_inside_of_instances_have_the_bind_pose(tmp_path):
    text = PERSON.replace('def SkelRoot "person"', 'class SkelRoot "person"')
    text += 'def "copy" (\n    instanceable = true\n    prepend references = </person>\n)\n{\n}\n'
    path = stages.write(tmp_path, text, header=FRAMES)
    with pytest.warns(UserWarning, match=r"not read: the skeleton of </copy>, whose meshes are in the bind pose"):
        found = wv.Scene.load(path)["/copy/skin"].vertices
    np.testing.assert_allclose(found, [(0, 0, 0), (1, 0, 0), (0, 1, 0)], atol=1e-6)


SKIPPED = {
    "BasisCurves": "curves",
    "HermiteCurves": "curves",
    "NurbsCurves": "curves",
    "NurbsPatch": "NURBS patches",
    "Points": "points",
    "Volume": "volumes",
    "ParticleField": "particle fields",
    "ParticleField3DGaussianSplat": "Gaussian splats",
}


@pytest.mark.parametrize("kind", SKIPPED)
def test_prims_without_triangles_are_left_out(tmp_path, kind):
    path = stages.write(tmp_path, f'def {kind} "x" {{}}\n' + stages.mesh("a"))
    with pytest.warns(UserWarning, match=rf"left out prims without triangles \(1 of {SKIPPED[kind]}\); Blender or"):
        assert names(wv.Scene.load(path)) == ["/a"]


def test_labels_of_other_taxonomies_are_categories(tmp_path):
    """The nearest label of the taxonomy `class` is preferred, also to nearer ones of others."""
    text = f"""
def Xform "room" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])
{{
    token[] semantics:labels:class = ["table"]
    def Xform "inner" (prepend apiSchemas = ["SemanticsLabelsAPI:wikidata"])
    {{
        token[] semantics:labels:wikidata = ["Q14748"]
        {stages.mesh("one")}
    }}
}}
def Xform "other" (prepend apiSchemas = ["SemanticsLabelsAPI:wikidata"])
{{
    token[] semantics:labels:wikidata = ["Q81881"]
    {stages.mesh("two")}
}}
def Xform "old" (prepend apiSchemas = ["SemanticsAPI:s"])
{{
    string semantic:s:params:semanticType = "wikidata"
    string semantic:s:params:semanticData = "Q3"
    {stages.mesh("three")}
}}
"""
    assert [item.category for item in stages.load(tmp_path, text)] == ["table", "Q81881", "Q3"]


PHYSICS = f"""
def PhysicsScene "physics" {{ }}
def Material "rubber" (prepend apiSchemas = ["PhysicsMaterialAPI"])
{{
    float physics:dynamicFriction = 0.9
}}
def PhysicsCollisionGroup "group" {{ }}
def Mesh "a" (prepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI", "PhysicsMassAPI"])
{{{stages.TRIANGLE}
    uniform token physics:approximation = "convexHull"
    float physics:mass = 5
    point3f physics:centerOfMass = (9, 9, 9)
}}
def SpatialAudio "noise" {{
    uniform asset filePath = @noise.wav@
}}
def Backdrop "note" {{ }}
def Scope "ui" (prepend apiSchemas = ["NodeGraphNodeAPI"]) {{ }}
"""


def test_physics_audio_and_ui_are_ignored(tmp_path):
    path = stages.write(tmp_path, PHYSICS)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        scene = wv.Scene.load(path, strict=True)
    (item,) = scene
    assert item.name == "/a" and item.appearance is None and len(scene.joints) == 0
    np.testing.assert_allclose(bounds(scene), usd_bounds(path), atol=1e-6)
