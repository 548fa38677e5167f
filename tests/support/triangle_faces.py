# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes for face outputs, and their checks."""

import numpy as np
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.scene import solids

from support.worlds import ALL, random_poses

FACES = (*ALL, "faces")
COUNT = 20
# `odd` adds invisible degenerate triangles and duplicates to each mesh.
BOX = trimesh.creation.box((0.5, 0.3, 0.7))
TORUS = trimesh.creation.torus(0.5, 0.15, major_sections=12, minor_sections=8)
BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.25)


def odd(mesh):
    """Return a mesh with degenerate, duplicated and flipped duplicated triangles, in random order."""
    faces = np.concatenate([[[0, 0, 0], [1, 2, 1]], mesh.faces, mesh.faces[:5], mesh.faces[5:9, ::-1]])
    return np.array(mesh.vertices), np.random.default_rng(3).permutation(faces)


def build(device="cpu", *, moving=True, rounded=True):
    """Return static objects, static instances, and movable objects: two of one mesh, one with a child, and solids.

    Returns:
        The scene, and the mesh of each object; None for a solid.
    """
    scene, given = wv.Scene(device=device), []

    def add(mesh, **options):
        scene.add(mesh, **options)
        given.append(None if isinstance(mesh, solids.Solid) else mesh)

    add(odd(trimesh.creation.box((5, 5, 0.02))), label="ground")
    ball, places = odd(BALL), random_poses(np.random.default_rng(0), COUNT, spread=2.0)
    scene.add_instances(ball, places, names="ball", movable=False)
    given += [ball] * COUNT
    add(odd(TORUS), name="torus", pose=(0.2, 0.1, 0.9, 0.6, 0, 0, 0.8))
    if moving:
        add(odd(BOX), name="table", movable=True)
        add(odd(BALL), name="lamp", pose=(0.4, 0.1, 0.3, 0, 0, 0, 1), attach_to="table")
        add(odd(BOX), name="twin", movable=True)
        add(odd(TORUS), name="ring", movable=True)
    if moving and rounded:
        add(solids.sphere(0.4), name="sphere", movable=True)
        add(solids.cylinder(0.3, 0.8), name="post", movable=True)
    return scene, given


def worlds_of(scene, count=2):
    return random_poses(np.random.default_rng(0), count, len(scene.movable), spread=1.0)


def corners_in(scene, given, poses):
    """Return vertices of each object's triangles in one world, None for a solid."""
    places = {index: np.asarray(scene.objects[index].place) for index in range(len(scene))}
    column = {index: number for number, index in enumerate(scene.movable)}
    result = []
    for index, mesh in enumerate(given):
        item = scene.objects[index]
        if mesh is None:
            result.append(None)
            continue
        if item.parent is not None:  # attached to an object that was at the origin
            place = poses_to_matrices(np.asarray(poses[column[item.parent]], dtype=float))
            vertices = item.mesh_vertices
        else:
            row = poses[column[index]] if index in column else places[index]
            place, vertices = poses_to_matrices(np.asarray(row, dtype=float)), mesh[0]
            if index not in column and item.shared_mesh is None:
                place, vertices = np.eye(4), item.vertices
        corners = np.asarray(vertices, dtype=float) @ place[:3, :3].T + place[:3, 3]
        result.append(corners[mesh[1]])
    return result


def assert_faces_hold(views, scene, given, worlds):
    """Check that hit points lie in the reported triangles; solids and background have face -1."""
    seen = []
    for view in range(len(views.faces.numpy())):
        corners = corners_in(scene, given, worlds[min(view, len(worlds) - 1)])
        faces, objects = views.faces.numpy()[view], views.segmentation.numpy()[view]
        points = views.points.numpy()[view].astype(np.float64)
        np.testing.assert_array_equal(faces[objects < 0], -1)
        for index in np.unique(objects[objects >= 0]):
            of, at = faces[objects == index], points[objects == index]
            seen.append(index)
            if corners[index] is None:
                np.testing.assert_array_equal(of, -1)
                continue
            assert of.min() >= 0
            a, b, c = corners[index][of].swapaxes(0, 1)
            normal = np.cross(b - a, c - a)
            area = np.linalg.norm(normal, axis=-1)
            assert (np.abs(((at - a) * normal).sum(axis=-1)) <= 1e-5 * area).all()
            for p, q in ((a, b), (b, c), (c, a)):
                assert ((np.cross(q - p, at - p) * normal).sum(axis=-1) >= -1e-4 * area**2).all()
    return set(seen)
