# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small USD stages for tests, as text."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import warpvis as wv

METERS = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'

TRIANGLE = """
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    uniform token subdivisionScheme = "none"
"""

SQUARE = """
    point3f[] points = [(0, 0, 0), (2, 0, 0), (2, 1, 0), (0, 1, 0)]
    int[] faceVertexCounts = [4]
    int[] faceVertexIndices = [0, 1, 2, 3]
    uniform token subdivisionScheme = "none"
"""


def mesh(name: str, more: str = "", shape: str = TRIANGLE) -> str:
    """Return the text of a mesh with further properties."""
    return f'def Mesh "{name}"\n{{{shape}{more}\n}}\n'


def write(folder: Path, text: str, name: str = "stage.usda", header: str = METERS) -> Path:
    """Write a stage, and return its path."""
    path = folder / name
    path.write_text(header + text)
    return path


def load(folder: Path, text: str, **options: object) -> wv.Scene:
    """Write and load a stage in meters with z up."""
    return wv.Scene.load(write(folder, text), **options)


def placed(name: str, *ops: tuple[str, str, str], inner: str) -> str:
    """Return the text of an Xform with operations: triples of a type, a name and a value."""
    lines = "".join(f"    {kind} xformOp:{op} = {value}\n" for kind, op, value in ops)
    order = ", ".join(f'"xformOp:{op}"' for _, op, _ in ops)
    return f'def Xform "{name}"\n{{\n{lines}    uniform token[] xformOpOrder = [{order}]\n{inner}}}\n'


def usd_bounds(path: Path) -> np.ndarray:
    """Return the bounds of a stage in usd-core, ``(2, 3)``."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    cache = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), ["default", "render"])
    box = cache.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    return np.array([box.GetMin(), box.GetMax()])


def bounds(scene: wv.Scene) -> np.ndarray:
    """Return the bounds of a scene's triangles, ``(2, 3)``."""
    vertices = np.concatenate([item.vertices[np.unique(item.faces)] for item in scene])
    return np.array([vertices.min(axis=0), vertices.max(axis=0)])


def textured(image: str, surface: str = "", texture: str = "", uv: str = "st") -> str:
    """Return the text of a square whose UsdPreviewSurface has an image as its color."""
    return f"""
def Mesh "square" (prepend apiSchemas = ["MaterialBindingAPI"])
{{{SQUARE}
    texCoord2f[] primvars:{uv} = [(0, 0), (1, 0), (1, 1), (0, 1)] (interpolation = "vertex")
    rel material:binding = </Wood>
}}
def Material "Wood"
{{
    token outputs:surface.connect = </Wood/Surface.outputs:surface>
    def Shader "Surface"
    {{
        uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </Wood/Image.outputs:rgb>
        {surface}
        token outputs:surface
    }}
    def Shader "Image"
    {{
        uniform token info:id = "UsdUVTexture"
        asset inputs:file = @{image}@
        float2 inputs:st.connect = </Wood/Coordinates.outputs:result>
        {texture}
        float3 outputs:rgb
        float outputs:a
    }}
    def Shader "Coordinates"
    {{
        uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "{uv}"
        float2 outputs:result
    }}
}}
"""


VARIED = f"""
def Xform "room" (prepend apiSchemas = ["SemanticsLabelsAPI:class"])
{{
    token[] semantics:labels:class = ["room"]
    double3 xformOp:translate = (0, 0, 1)
    float3 xformOp:rotateXYZ = (10, 20, 30)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateXYZ"]
    def Cube "box" (prepend apiSchemas = ["PhysicsRigidBodyAPI"])
    {{
        double size = 2
        color3f[] primvars:displayColor = [(1, 0, 0)]
    }}
    def Capsule "pill" {{
        uniform token axis = "X"
    }}
    def Cylinder "can" (prepend apiSchemas = ["PhysicsRigidBodyAPI"])
    {{
        double radius = 0.5
        double height = 1.5
        float3 xformOp:scale = (1, 2, 3)
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }}
    def PhysicsRevoluteJoint "hinge"
    {{
        rel physics:body1 = </room/box>
        float physics:lowerLimit = -10
        float physics:upperLimit = 10
    }}
    def PointInstancer "many"
    {{
        rel prototypes = [</room/many/leaf>]
        int[] protoIndices = [0, 0, 0]
        point3f[] positions = [(0, 0, 0), (1, 0, 0), (2, 0, 0)]
        quath[] orientations = [(1, 0, 0, 0), (0.7, 0, 0, 0.7), (1, 0, 0, 0)]
        int64[] invisibleIds = [2]
        {mesh("leaf")}
    }}
}}
def Xform "copy" (
    instanceable = true
    prepend references = </room>
)
{{
}}
def RectLight "lamp"
{{
    float inputs:intensity = 100
}}
def Camera "eye" {{
}}
"""
"""A stage with many elements."""
