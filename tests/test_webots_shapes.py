# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of worlds with every node that creates triangles, in both axis conventions, against manual placement."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis import Label, Scene
from warpvis.webots import load_webots
from warpvis.webots._grammar import parse_text
from warpvis.webots.shapes._geometry import tessellate

WORLDS = Path(__file__).parent.parent / "scenes" / "webots"
ENGINES = {"R2021b": "lupa", "R2023b": "quickjs"}


def by_hand(version, text, *places):
    """Return a geometry node's triangles after placements ``(translation, rotation, scale)``, the outermost first."""
    node = parse_text(f"#VRML_SIM {version} utf8\n{text}", str(WORLDS / "by_hand.wbt")).nodes[0]
    vertices, faces = tessellate(node)
    for translation, rotation, scale in reversed(places):
        turn = trimesh.transformations.rotation_matrix(rotation[3], rotation[:3])[:3, :3]
        vertices = (turn @ (np.array(scale) * vertices).T).T + translation
    return vertices, faces


def at(*translation, turn=(0, 0, 1, 0), scale=(1, 1, 1)):
    return translation, turn, scale


HEIGHTS = "height [ 0 .1 .2 .1 .3 .1 0 .2 0 .1 .1 .3 ]"
HILLS = f"ElevationGrid {{{{ {HEIGHTS} xDimension 3 xSpacing .4 {{0}}Dimension 4 {{0}}Spacing .3 }}}}"
INDEX = "coordIndex [ 3 2 1 0 -1 0 1 4 -1 1 2 4 -1 2 3 4 -1 3 0 4 -1 ]"
SQUARE = "crossSection [ .1 .1 .1 -.1 -.1 -.1 -.1 .1 .1 .1 ]"
OLD_POINTS = "point [ 0 0 0 .4 0 0 .4 0 -.4 0 0 -.4 .2 .6 -.2 ]"
CUBE, LINK = "Box { size 0.4 0.6 0.8 }", "Box { size 0.1 0.1 0.4 }"
CAPSULE = at(2, -1.5, 0.4, turn=(1, 0, 0, np.pi / 2))
ARM = at(0, -2, 0.5, turn=(0, 0, 1, 0.4))
ELBOW, SLIDER = at(0.1, 0, 0.4, turn=(0, 1, 0, 0.5)), at(0, 0.15, 0.1)
STAIRS = at(-2.8, 0, 0, turn=(0, 0, 1, 1.2))
OLD_CUBE, OLD_LINK = "Box { size 0.4 0.8 0.6 }", "Box { size 0.1 0.4 0.1 }"
OLD_CAPSULE = at(2, 0.4, 1.5, turn=(1, 0, 0, np.pi / 2))
OLD_COLUMN = at(-2, 0.6, -1, turn=(0, 0, 1, -0.3))
OLD_ARM, OLD_STAIRS = at(0, 0.5, 2, turn=(0, 1, 0, 0.4)), at(-2.8, 0, 0, turn=(0, 1, 0, 1.2))

# Geometry nodes and placements for each object. Robots come last.
OBJECTS = {
    "R2023b": {
        "GROUND_PLANE": [("Plane { size 8 6 }",)],
        "BOX_PLACE": [
            (
                CUBE,
                at(1, 0, 0.25, turn=(0, 0, 1, 0.5), scale=(1, 2, 0.5)),
                at(0.5, 0.25, 0.5),
                at(0, 0, 0, turn=(0.5**0.5, 0.5**0.5, 0, 0.7), scale=(0.5, 0.25, 1)),
            )
        ],
        "shape": [("Sphere { radius 0.2 subdivision 2 }",)],
        "BALL": [("Sphere { radius 0.25 subdivision 12 ico FALSE }", at(-1, -1, 1))],
        "column": [
            ("Cylinder { height 1.2 radius 0.15 bottom FALSE }", at(-2, 1, 0.6, turn=(0, 1, 0, 0.3))),
            ("Cone { bottomRadius 0.2 height 0.6 }", at(-2, 1, 0.6, turn=(0, 1, 0, 0.3)), at(0, 0, 0.9)),
        ],
        "capsule": [("Capsule { height 0.5 radius 0.1 }", CAPSULE)],
        "cube on a capsule": [(CUBE, CAPSULE, at(0, 0, 0.7))],
        "hills": [(HILLS.format("y"), at(-1.5, -2, 0))],
        "pyramid": [
            (
                f"IndexedFaceSet {{ coord Coordinate {{ point [ 0 0 0 .4 0 0 .4 .4 0 0 .4 0 .2 .2 .6 ] }} {INDEX} }}",
                at(2.5, 1.5, 0.1, turn=(0, 0, 1, -0.8)),
            )
        ],
        "MIRRORED": [('Mesh { url "tetrahedron.obj" }', at(0, 2, 0.3, scale=(-1, 1, 1)))],
        "cad": [('Mesh { url "tetrahedron.obj" }', at(0.8, 2, 0.3))],
        "chimney": [
            (
                f"Extrusion {{ {SQUARE} spine [ 0 0 0 0 0 .4 .2 0 .7 ] scale [ 1 1 .8 .8 .5 .5 ] }}",
                at(2.5, -0.5, 0),
            )
        ],
        "STAIRS": [(f"Box {{ size .2 .5 {0.1 * k} }}", STAIRS, at(0.2 * (k - 0.5), 0, 0.05 * k)) for k in (1, 2, 3, 4)],
        "arm": [
            (LINK, ARM),
            # The name LINK is defined twice: the last one counts.
            ("Box { size .02 .02 .02 }", ARM),
            ("Box { size .02 .02 .02 }", ARM, at(0, 0, 1)),
        ],
        "solid": [(LINK, ARM, ELBOW)],
        "slider": [(LINK, ARM, ELBOW, SLIDER)],
        "solid (2)": [(LINK, ARM, ELBOW, SLIDER, at(0, 0, 0.45, turn=(1, 0, 0, 0.25)))],
        "hinge 2": [(LINK, ARM, at(-0.2, 0, -0.2))],
        "tool": [(LINK, ARM, at(0, 0, -0.4))],
        "track": [(LINK, ARM, at(0, -0.3, 0))],
        "head": [("Cylinder { height 0.04 radius 0.03 }", ARM, at(0, 0, 0.25), at(0, 0, 0.05))],
        "slow helix": [(LINK, ARM, at(0, 0.2, 0.2))],
    },
    "R2021b": {
        "GROUND_PLANE": [("Plane { size 8 6 }",)],
        "BOX_PLACE": [
            (
                OLD_CUBE,
                at(1, 0.25, 0, turn=(0, 1, 0, 0.5), scale=(1, 0.5, 2)),
                at(0.5, 0.5, -0.25, turn=(0.5**0.5, 0, 0.5**0.5, 0.7), scale=(0.5, 1, 0.25)),
            )
        ],
        "BALL": [("Sphere { radius 0.25 subdivision 12 ico FALSE }",)],
        "column": [
            ("Cylinder { height 1.2 radius 0.15 bottom FALSE subdivision 24 }", OLD_COLUMN),
            ("Cone { bottomRadius 0.2 height 0.6 }", OLD_COLUMN, at(0, 0.9, 0)),
        ],
        "capsule": [("Capsule { height 0.5 radius 0.1 }", OLD_CAPSULE), (OLD_CUBE, OLD_CAPSULE)],
        "hills": [(HILLS.format("z"), at(-1.5, 0, 1))],
        "pyramid": [
            (
                f"IndexedFaceSet {{ coord Coordinate {{ {OLD_POINTS} }} {INDEX} }}",
                at(2.5, 0.1, -1.5, turn=(0, 1, 0, -0.8)),
            )
        ],
        "chimney": [(f"Extrusion {{ {SQUARE} spine [ 0 0 0 0 .4 0 .2 .7 0 ] }}", at(2.5, 0, 0.5))],
        "TETRAHEDRON": [('Mesh { url "tetrahedron.obj" }', at(0, 0.3, -2, scale=(1.5, 1.5, 1.5)))],
        "STAIRS": [
            (f"Box {{ size .2 {0.1 * k} .5 }}", OLD_STAIRS, at(0.2 * (k - 0.5), 0.05 * k, 0)) for k in (1, 2, 3, 4)
        ],
        "arm": [(OLD_LINK, OLD_ARM)],
        "hand": [(OLD_LINK, OLD_ARM, at(0.1, 0.4, 0, turn=(0, 0, 1, -0.5)))],
    },
}
EVERY = [(version, name) for version, objects in OBJECTS.items() for name in objects]


@pytest.fixture(scope="module")
def worlds():
    missing = [engine for engine in ENGINES.values() if importlib.util.find_spec(engine) is None]
    if missing:
        pytest.skip(f"no {missing[0]} for the template of stairs")
    return {version: load_webots(WORLDS / f"shapes_{version}.wbt", strict=True) for version in OBJECTS}


def volume(scene, name):
    item = scene[name]
    return trimesh.Trimesh(item.vertices.astype(np.float64), item.faces).volume


@pytest.mark.parametrize("version", OBJECTS)
def test_all_objects_are_loaded(worlds, version):
    world, names = worlds[version], list(OBJECTS[version])
    assert {item.name for item in world.scene} == set(names)
    assert world.robots["arm"] == tuple(names[names.index("arm") :])
    assert {item.name for item in world.scene if item.label == Label.GROUND} == {"GROUND_PLANE"}
    assert world.scene.up == ("y" if version == "R2021b" else "z") and not world.skipped and not world.notes


@pytest.mark.parametrize(("version", "name"), EVERY)
def test_each_node_has_its_position(worlds, version, name):
    parts = [by_hand(version, *part) for part in OBJECTS[version][name]]
    starts = np.cumsum([0] + [len(vertices) for vertices, _ in parts])
    faces = np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)])
    item = worlds[version].scene[name]
    np.testing.assert_array_equal(item.faces, faces[:, ::-1] if name == "MIRRORED" else faces)
    np.testing.assert_allclose(item.vertices, np.concatenate([vertices for vertices, _ in parts]), atol=1e-6)


def test_shapes_face_outward(worlds):
    new, old = worlds["R2023b"].scene, worlds["R2021b"].scene
    assert volume(new, "cad") == pytest.approx(0.3**3 / 6, rel=1e-5)
    assert volume(new, "MIRRORED") == pytest.approx(0.3**3 / 6, rel=1e-5)
    assert volume(old, "TETRAHEDRON") == pytest.approx(1.5**3 * 0.3**3 / 6, rel=1e-5)
    box = 0.4 * 0.6 * 0.8 * (1 * 2 * 0.5) * (0.5 * 0.25)
    stairs = 0.2 * 0.5 * 0.1 * (1 + 2 + 3 + 4)
    for scene in (new, old):
        assert volume(scene, "BOX_PLACE") == pytest.approx(box, rel=1e-5)
        assert volume(scene, "STAIRS") == pytest.approx(stairs, rel=1e-5)
        assert volume(scene, "pyramid") == pytest.approx(0.4 * 0.4 * 0.6 / 3, rel=1e-5)
        assert volume(scene, "chimney") > 0.004


@pytest.mark.parametrize("version", OBJECTS)
def test_image_equals_manually_placed_scene(worlds, version, device):
    world, scene = worlds[version], Scene(device=device)
    for name, parts in OBJECTS[version].items():
        for k, part in enumerate(parts):
            vertices, faces = by_hand(version, *part)
            scene.add((vertices, faces[:, ::-1] if name == "MIRRORED" else faces), name=f"{name} {k}")
    finder = world.devices["range-finder"]
    given = wv.render(world.scene.to(device), finder.camera, finder.pose, cull_backfaces=True).depth.numpy()
    wanted = wv.render(scene, finder.camera, finder.pose, cull_backfaces=True).depth.numpy()
    assert 0.3 < np.isfinite(given).mean() < 1
    np.testing.assert_allclose(given, wanted, atol=1e-5)
