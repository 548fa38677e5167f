# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Surfaces of USD stages: distances to the true shapes, sides and normals of meshes, and tetrahedra."""

import itertools

import numpy as np
import pytest

import warpvis as wv

from support import usd_stages as stages

pytest.importorskip("pxr")
from pxr import Usd, UsdGeom

TOLERANCE = 5e-4
"""Largest distance to the true surface, as a fraction of the radius."""


def points_on(item):
    """Return corners, centers of edges and centers of the triangles of an object."""
    corners = item.vertices[item.faces].astype(np.float64)
    edges = (corners + np.roll(corners, 1, axis=1)) / 2
    return np.concatenate([corners.reshape(-1, 3), edges.reshape(-1, 3), corners.mean(axis=1)])


def to_cone(points, bottom, top, height):
    """Return the distances of points from the surface of a frustum about z, which is closed by disks."""
    profile = np.stack([np.hypot(points[:, 0], points[:, 1]), points[:, 2]], axis=-1)
    ring = np.array([(0, -height / 2), (bottom, -height / 2), (top, height / 2), (0, height / 2)])
    distances = []
    for start, end in itertools.pairwise(ring):
        along = end - start
        share = np.clip((profile - start) @ along / max(along @ along, 1e-12), 0, 1)
        distances.append(np.linalg.norm(profile - start - share[:, None] * along, axis=-1))
    return np.min(distances, axis=0)


def to_capsule(points, radius, height):
    axis = np.zeros_like(points)
    axis[:, 2] = np.clip(points[:, 2], -height / 2, height / 2)
    return np.abs(np.linalg.norm(points - axis, axis=-1) - radius)


SIZES = "double radius = 0.5\ndouble height = 3\n"
ROUND = {
    "Sphere": (SIZES.splitlines()[0], lambda points: np.abs(np.linalg.norm(points, axis=-1) - 0.5)),
    "Cylinder": (SIZES, lambda points: to_cone(points, 0.5, 0.5, 3)),
    "Cone": (SIZES, lambda points: to_cone(points, 0.5, 0.0, 3)),
    "Capsule": (SIZES, lambda points: to_capsule(points, 0.5, 3)),
    "Cylinder_1": (
        "double radiusBottom = 0.5\ndouble radiusTop = 0.25\ndouble height = 3",
        lambda points: to_cone(points, 0.5, 0.25, 3),
    ),
    "Capsule_1": (
        "double radiusBottom = 0.5\ndouble radiusTop = 0.5\ndouble height = 3",
        lambda points: to_capsule(points, 0.5, 3),
    ),
}


@pytest.mark.parametrize("kind", ROUND)
def test_triangles_of_round_shapes_are_close_to_them(tmp_path, kind):
    sizes, distance = ROUND[kind]
    axis = "" if kind == "Sphere" else 'uniform token axis = "Z"'
    (item,) = stages.load(tmp_path, f'def {kind} "a"\n{{\n{sizes}\n{axis}\n}}\n')
    assert distance(points_on(item)).max() <= 1.001 * TOLERANCE * 0.5


def test_depth_has_no_culling(tmp_path):
    """Both sides of a single-sided mesh are seen, from the front and from behind."""
    scene = stages.load(tmp_path, stages.mesh("a", "", stages.SQUARE))
    camera = wv.Camera.from_fov(8, 8, hfov=0.3)
    for height in (3, -3):
        pose = wv.look_at((1, 0.5, height), (1, 0.5, 0), up=(0, 1, 0))
        assert wv.render(scene, camera, pose, outputs=("depth",)).depth.numpy()[0, 4, 4] == pytest.approx(3)


@pytest.mark.parametrize("orientation", ["rightHanded", "leftHanded"])
def test_surfaces_of_tetrahedra_are_those_of_usd(tmp_path, orientation):
    text = f"""
def TetMesh "a"
{{
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]
    int4[] tetVertexIndices = [(0, 2, 1, 3), (1, 2, 3, 4)]
    uniform token orientation = "{orientation}"
}}
"""
    found = stages.load(tmp_path, text)["/a"].faces
    stage = Usd.Stage.Open(str(tmp_path / "stage.usda"))
    mesh = UsdGeom.TetMesh(stage.GetPrimAtPath("/a"))
    expected = np.array(UsdGeom.TetMesh.ComputeSurfaceFaces(mesh, Usd.TimeCode.EarliestTime()))

    def loops(faces):
        return sorted(tuple(np.roll(face, -int(np.argmin(face))).tolist()) for face in faces)

    assert loops(found) == loops(expected if orientation == "rightHanded" else expected[:, ::-1])


def test_normals_of_the_primvar_come_first(tmp_path):
    vertex = '(interpolation = "vertex")'
    text = f"normal3f[] normals = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)] {vertex}\n"
    text += f"normal3f[] primvars:normals = [(0, 1, 0), (0, 1, 0), (0, 1, 0), (0, 1, 0)] {vertex}\n"
    (item,) = stages.load(tmp_path, stages.mesh("a", text, stages.SQUARE))
    np.testing.assert_array_equal(item.appearance.normals, np.tile((0, 1, 0), (4, 1)))


def test_cages_keep_their_own_normals(tmp_path):
    normals = 'normal3f[] normals = [(1, 0, 0), (1, 0, 0), (1, 0, 0), (1, 0, 0)] (interpolation = "vertex")'
    cage = stages.SQUARE.replace('"none"', '"catmullClark"')
    (item,) = stages.load(tmp_path, stages.mesh("a", normals, cage))
    np.testing.assert_array_equal(item.appearance.normals, np.tile((1, 0, 0), (4, 1)))
    (item,) = stages.load(tmp_path, stages.mesh("b", "", cage))
    np.testing.assert_allclose(item.appearance.normals, np.tile((0, 0, 1), (4, 1)), atol=1e-6)
