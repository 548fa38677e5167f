# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of Webots' geometry nodes: triangles in both axis conventions, and errors."""

import math

import numpy as np
import pytest
import trimesh

from warpvis.errors import FileFormatError
from warpvis.webots._grammar import parse_text
from warpvis.webots.shapes._geometry import MissingMeshError, tessellate

NEW, OLD = "R2023b", "R2019a"


def parse(text, version=NEW, file="lab.wbt"):
    (node,) = parse_text(f"#VRML_SIM {version} utf8\n{text}", str(file)).nodes
    return node


def mesh_of(text, version=NEW):
    vertices, faces = tessellate(parse(text, version))
    assert vertices.dtype == np.float64 and faces.dtype == np.int32
    assert set(faces.ravel()) == set(range(len(vertices)))
    return trimesh.Trimesh(vertices, faces, process=False)


def as_set(points):
    return {tuple(point) for point in np.round(points, 9) + 0.0}


def polygon_area(corners):
    return math.sin(2 * math.pi / corners) * corners / 2


SOLIDS = {
    "Box { size 1 2 3 }": (12, 6),
    "Cylinder { radius 0.5 height 3 }": (4 * 36, polygon_area(36) * 0.75),
    "Cylinder { subdivision 3 }": (12, 2 * polygon_area(3)),
    "Cone { bottomRadius 2 height 3 }": (24, 12),  # polygon_area(12) is 3
    "Cone { subdivision 5 }": (10, polygon_area(5) * 2 / 3),
    "Capsule { }": (144, None),
    "Capsule { subdivision 7 radius 0.1 height 1 }": (28, None),
    "Sphere { }": (80, None),
    "Sphere { radius 2 subdivision 3 }": (1280, None),
    "Sphere { ico FALSE }": (24 * 23 * 2, None),
    "Sphere { ico FALSE subdivision 3 }": (12, None),
}


@pytest.mark.parametrize("version", [NEW, OLD])
@pytest.mark.parametrize("text", SOLIDS)
def test_solids_are_closed_and_face_outward(text, version):
    mesh = mesh_of(text, version)
    faces, volume = SOLIDS[text]
    assert len(mesh.faces) == faces
    assert mesh.is_watertight and mesh.is_winding_consistent
    assert mesh.volume > 0 if volume is None else mesh.volume == pytest.approx(volume)
    centers = mesh.triangles_center
    assert (np.einsum("nx,nx->n", mesh.face_normals, centers) > 0).all()  # all are convex


@pytest.mark.parametrize(
    "text", ["Cylinder { top FALSE }", "Cone { }", "Capsule { }", "Plane { size 2 3 }", "Sphere { }"]
)
def test_shapes_rotate_with_the_axis_convention(text):
    (new, new_faces), (old, old_faces) = (tessellate(parse(text, version)) for version in (NEW, OLD))
    np.testing.assert_array_equal(new_faces, old_faces)
    np.testing.assert_array_equal(new[:, [0, 2, 1]] * [1, 1, -1], old)
    np.testing.assert_allclose(
        old, new @ trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0))[:3, :3].T, atol=1e-12
    )


def test_boxes_are_not_rotated():
    assert as_set(mesh_of("Box { size 2 4 6 }", OLD).vertices) == {
        (x, y, z) for x in (-1, 1) for y in (-2, 2) for z in (-3, 3)
    }


def test_negative_old_boxes_face_inward():
    assert mesh_of("Box { size -1 -2 -3 }", "R2018b").volume == pytest.approx(-6)
    with pytest.raises(FileFormatError, match="positive size"):
        tessellate(parse("Box { size -1 -2 3 }", "R2018b"))


def test_cylinders_start_at_their_second_axis():
    low = {(0, 2, -1), (2, 0, -1), (0, -2, -1), (-2, 0, -1)}
    assert as_set(mesh_of("Cylinder { radius 2 subdivision 4 top FALSE bottom FALSE }").vertices) == low | {
        (x, y, -z) for x, y, z in low
    }
    triangle = mesh_of("Cylinder { subdivision 3 }").vertices
    assert as_set(triangle) >= as_set([(math.sin(a), math.cos(a), 1) for a in (0, 2 * math.pi / 3, 4 * math.pi / 3)])
    assert (0, 1, -1) in as_set(mesh_of("Cylinder { subdivision 3 }", OLD).vertices)  # center of the top: y
    assert (0, 1, -1) in as_set(triangle)


@pytest.mark.parametrize("version, segments", [("V8.6", 12), ("R2018b", 12), (OLD, 36), ("R2021b", 36), (NEW, 36)])
def test_cylinder_segments_by_version(version, segments):
    assert len(mesh_of("Cylinder { top FALSE bottom FALSE }", version).faces) == 2 * segments


@pytest.mark.parametrize(
    "flags, faces", [("", 80), ("top FALSE", 60), ("side FALSE", 40), ("bottom FALSE side FALSE", 20)]
)
def test_cylinder_flags_omit_parts(flags, faces):
    mesh = mesh_of(f"Cylinder {{ subdivision 20 {flags} }}")
    assert len(mesh.faces) == faces
    if "bottom FALSE" in flags:
        assert (mesh.vertices[:, 2] == 1).all() and (mesh.face_normals[:, 2] > 0).all()


def test_cone_and_capsule_flags_omit_parts():
    assert len(mesh_of("Cone { side FALSE }").faces) == len(mesh_of("Cone { bottom FALSE }").faces) == 12
    assert (mesh_of("Cone { side FALSE }").face_normals[:, 2] == -1).all()
    capsule = mesh_of("Capsule { bottom FALSE side FALSE radius 0.5 }")
    assert capsule.bounds[:, 2] == pytest.approx((1, 1.5)) and len(capsule.faces) == 12 * 5
    for text in ("Cone { side FALSE bottom FALSE }", "Cylinder { side FALSE bottom FALSE top FALSE }"):
        assert tessellate(parse(text)) is None
    assert tessellate(parse("Capsule { side FALSE bottom FALSE top FALSE }")) is None


def test_capsules_have_a_quarter_of_the_segments_as_rows():
    heights = np.unique(np.round(mesh_of("Capsule { subdivision 12 }").vertices[:, 2], 9))
    rows = np.sin(np.array([0, 30, 60, 90]) * np.pi / 180) + 1
    np.testing.assert_allclose(heights, np.concatenate([-rows[::-1], rows]), atol=1e-9)


@pytest.mark.parametrize("subdivision, least", [(1, 0.934), (2, 0.982), (3, 0.9955), (4, 0.9989), (5, 0.9997)])
def test_icosphere_subdivisions(subdivision, least):
    mesh = mesh_of(f"Sphere {{ radius 3 subdivision {subdivision} }}")
    assert len(mesh.faces) == 20 * 4**subdivision
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices, axis=1), 3)
    distances = np.einsum("nx,nx->n", mesh.face_normals, mesh.triangles[:, 0])
    assert distances.min() / 3 == pytest.approx(least, abs=5e-4)


def test_icosphere_orientation_matches_webots():
    short, long = 0.525731112119, 0.850650808352
    corners = {
        (-short, -long, 0),
        (short, long, 0),
        (0, -short, long),
        (0, short, -long),
        (long, 0, short),
        (-long, 0, short),
    }
    assert as_set(mesh_of("Sphere { }").vertices) >= as_set(list(corners))
    assert as_set(mesh_of("Sphere { }", OLD).vertices) >= as_set(
        [(-short, 0, long), (0, long, short), (long, short, 0)]
    )


def test_uv_spheres_have_rings():
    mesh = mesh_of("Sphere { ico FALSE subdivision 4 }")
    ring = math.sqrt(0.5)
    assert as_set(mesh.vertices) >= as_set([(0, 0, 1), (0, ring, ring), (ring, 0, ring), (0, 1, 0), (0, 0, -1)])
    assert len(mesh.vertices) == 2 + 3 * 4


def test_planes_face_up():
    mesh = mesh_of("Plane { size 2 4 }")
    assert as_set(mesh.vertices) == {(-1, -2, 0), (1, -2, 0), (1, 2, 0), (-1, 2, 0)}
    assert (mesh.face_normals == (0, 0, 1)).all()
    old = mesh_of("Plane { size 2 4 }", OLD)
    assert old.extents.tolist() == [2, 0, 4] and (old.face_normals == (0, 1, 0)).all()


def test_elevation_grids():
    text = "ElevationGrid {{ xDimension 3 {0}Dimension 2 xSpacing 2 {0}Spacing 0.5 height [ 0 1 2, 3 4 5 ] }}"
    vertices, faces = tessellate(parse(text.format("y")))
    expected = [(0, 0, 0), (2, 0, 1), (4, 0, 2), (0, 0.5, 3), (2, 0.5, 4), (4, 0.5, 5)]
    np.testing.assert_array_equal(vertices, expected)
    assert faces.tolist() == [[3, 0, 4], [4, 0, 1], [4, 1, 5], [5, 1, 2]]
    old, faces = tessellate(parse(text.format("z"), OLD))
    np.testing.assert_array_equal(old, [(x, z, y) for x, y, z in expected])
    assert faces.tolist() == [[0, 3, 1], [1, 3, 4], [1, 4, 2], [2, 4, 5]]
    for mesh, up in ((mesh_of(text.format("y")), 2), (mesh_of(text.format("z"), OLD), 1)):
        assert (mesh.face_normals[:, up] > 0).all()


def test_elevation_grids_pad_with_zeros_and_ignore_extra_heights():
    grid = "ElevationGrid { xDimension 11 yDimension 11 height [ %s ] }"
    flat = mesh_of(grid % "")
    assert flat.extents.tolist() == [10, 10, 0] and len(flat.faces) == 200
    assert mesh_of(grid % "7").vertices[:, 2].tolist() == [7] + [0] * 120
    assert mesh_of(grid % ("1 " * 500)).vertices[:, 2].tolist() == [1] * 121
    assert tessellate(parse("ElevationGrid { }")) is None
    assert tessellate(parse("ElevationGrid { xDimension 1 yDimension 9 }")) is None


CUBE = "point [ 0 0 0, 1 0 0, 1 1 0, 0 1 0, 0 0 1, 1 0 1, 1 1 1, 0 1 1 ]"
SIDES = "3 2 1 0 -1 4 5 6 7 -1 0 1 5 4 -1 1 2 6 5 -1 2 3 7 6 -1 3 0 4 7"


@pytest.mark.parametrize("end", ["", " -1", ", -1 -1"])
@pytest.mark.parametrize("version", [NEW, OLD])
def test_face_sets(end, version):
    text = f"IndexedFaceSet {{ coord Coordinate {{ {CUBE} }} coordIndex [ {SIDES}{end} ] %s }}"
    mesh = mesh_of(text % "", version)
    assert mesh.is_watertight and mesh.volume == pytest.approx(1) and len(mesh.faces) == 12
    assert mesh_of(text % "ccw FALSE", version).volume == pytest.approx(-1)


def face_set(points, index):
    listed = ", ".join(" ".join(f"{x:g}" for x in point) for point in points)
    return f"IndexedFaceSet {{ coord Coordinate {{ point [ {listed} ] }} coordIndex [ {index} ] }}"


# Counterclockwise polygons: an L, a comb, a star, an arrowhead, a point on an edge, and a ring with a slit.
CONCAVE = {
    "L": [(0, 0), (3, 0), (3, 1), (1, 1), (1, 3), (0, 3)],
    "comb": [(0, 0), (7, 0), (7, 3), (6, 3), (6, 1), (5, 1), (5, 3), (4, 3), (4, 1), (3, 1), (3, 3), (0, 3)],
    "star": [((1 + k % 2) * math.cos(k * math.pi / 7), (1 + k % 2) * math.sin(k * math.pi / 7)) for k in range(14)],
    "arrowhead": [(0, 0), (2, 1), (0, 2), (0.5, 1)],
    "collinear": [(0, 0), (1, 0), (2, 0), (2, 2), (1, 0.5), (0, 2)],
    "ring": [(0, 0), (4, 0), (4, 4), (0, 4), (0, 0), (1, 1), (1, 3), (3, 3), (3, 1), (1, 1)],
}


@pytest.mark.parametrize("reverse", [False, True])
@pytest.mark.parametrize("name", CONCAVE)
def test_concave_polygons(name, reverse):
    flat = np.array(CONCAVE[name], dtype=float)[:: -1 if reverse else 1]
    ahead = np.roll(flat, -1, axis=0)
    area = (flat[:, 0] * ahead[:, 1] - flat[:, 1] * ahead[:, 0]).sum() / 2
    tilted = np.c_[flat, 2 * flat[:, 0] - flat[:, 1]]
    corners = " ".join(map(str, range(len(flat))))
    vertices, faces = tessellate(parse(face_set(tilted, corners)))
    (a, b, c) = (vertices[faces[:, k], :2] for k in range(3))
    areas = ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]) / 2
    # All areas have the polygon's sign: the triangles cover it exactly once.
    assert (areas * np.sign(area) > -1e-12).all()
    assert areas.sum() == pytest.approx(area)


def test_degenerate_polygons_are_skipped():
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    _, faces = tessellate(parse(face_set(points, "-1 0 1 -1 0 0 0 -1 2 -1 0 1 2 -1")))
    assert faces.tolist() == [[0, 1, 2]]
    for index in ("", "-1", "0 1 -1"):
        assert tessellate(parse(face_set(points, index))) is None
    assert tessellate(parse("IndexedFaceSet { }")) is None
    assert tessellate(parse("IndexedFaceSet { coord NULL coordIndex [ ] }")) is None


def test_self_intersecting_polygons_terminate():
    bow = [(0, 0, 0), (2, 2, 0), (2, 0, 0), (0, 2, 0), (-1, 1, 0)]
    triangles = tessellate(parse(face_set(bow, "0 1 2 3 4 -1")))
    assert triangles is None or len(triangles[1]) <= 3


@pytest.mark.parametrize("spline", ["", "splineSubdivision 0", "splineSubdivision 9"])
def test_extruded_square_is_a_box(spline):
    mesh = mesh_of(f"Extrusion {{ spine [ 1 2 3, 1 2 7 ] {spline} }}")
    assert mesh.is_watertight and mesh.volume == pytest.approx(16)
    np.testing.assert_allclose(mesh.bounds, [(0, 1, 3), (2, 3, 7)], atol=1e-12)
    np.testing.assert_allclose(mesh_of("Extrusion { }", OLD).bounds, [(-1, 0, -1), (1, 1, 1)], atol=1e-12)
    assert mesh_of(f"Extrusion {{ ccw FALSE {spline} }}").volume == pytest.approx(-4)


def test_extrusions_in_any_direction_keep_their_volume():
    section = "crossSection [ 0 0, 0 3, 1 3, 1 1, 3 1, 3 0, 0 0 ]"  # an L of area 5
    for end in ("1 0 0", "-1 0 0", "0 1 0", "0 -1 0", "0 0 1", "0 0 -1", "0.6 0 0.8", "-0.48 0.6 0.64"):
        for version in (NEW, OLD):
            mesh = mesh_of(f"Extrusion {{ {section} spine [ 0 0 0, {end} ] }}", version)
            assert mesh.is_watertight and mesh.volume == pytest.approx(5)


def test_extrusions_bend_scale_and_rotate():
    bent = "Extrusion { crossSection [ 1 1, 1 -1, -1 -1, -1 1, 1 1 ] spine [ 0 0 0, 0 0 4, 0 4 6, 4 6 6 ] %s }"
    for options, rings in (("splineSubdivision 0", 4), ("", 13)):
        mesh = mesh_of(bent % options)
        assert mesh.is_watertight and mesh.volume > 0 and len(mesh.vertices) == 4 * rings
    pyramid = mesh_of("Extrusion { scale [ 1 1, 0.5 0.5 ] }")  # a frustum
    assert pyramid.volume == pytest.approx((4 + 2 + 1) / 3)
    quarter = mesh_of("Extrusion { crossSection [ 1 2, 1 -2, -1 -2, -1 2, 1 2 ] orientation 0 0 1 1.5707963267948966 }")
    np.testing.assert_allclose(quarter.extents, (4, 2, 1), atol=1e-9)
    tube = mesh_of("Extrusion { beginCap FALSE endCap FALSE splineSubdivision 0 }")
    assert len(tube.faces) == 8 and not tube.is_watertight
    turns = " ".join(f"{5 * math.cos(a)} {5 * math.sin(a)} 0" for a in np.arange(12) * math.pi / 6) + " 5 0 0"
    ring = f"Extrusion {{ spine [ {turns} ] splineSubdivision 0 beginCap FALSE endCap FALSE }}"
    torus = mesh_of(ring)
    torus.merge_vertices()
    assert torus.is_watertight and torus.euler_number == 0 and torus.volume > 0
    assert torus.extents[2] == pytest.approx(2) and torus.extents[0] == pytest.approx(12, rel=1e-9)


def test_splines_keep_ends_and_round_corners():
    vertices = mesh_of("Extrusion { crossSection [ 0 0, 0 1 ] spine [ 0 0 0, 3 0 0, 3 3 0 ] }").vertices
    line = vertices[vertices[:, 2] == 0]
    assert as_set(line) >= {(0, 0, 0), (3, 3, 0)} and len(line) == 9
    assert as_set(line) >= as_set([(2.5, 0.5, 0)])  # (p0 + 4 p1 + p2) / 6


PYRAMID = trimesh.creation.cone(1.0, 2.0, sections=4)


@pytest.mark.parametrize("kind", ["obj", "stl", "ply"])
@pytest.mark.parametrize("type", ["Mesh", "CadShape"])
def test_mesh_files_next_to_the_world(tmp_path, kind, type):
    (tmp_path / "meshes").mkdir()
    PYRAMID.export(tmp_path / "meshes" / f"cone.{kind}")
    text = f'{type} {{ url "meshes/cone.{kind}" %s }}'
    for options, sign in (("", 1), ("ccw FALSE", -1)):
        vertices, faces = tessellate(parse(text % options, file=tmp_path / "lab.wbt"))
        mesh = trimesh.Trimesh(vertices, faces)
        assert mesh.volume == pytest.approx(sign * PYRAMID.volume, rel=1e-5)
        np.testing.assert_allclose(mesh.bounds, PYRAMID.bounds, atol=1e-6)
    # Meshes are not rotated by the axis convention.
    old, _ = tessellate(parse(text % "", OLD, file=tmp_path / "lab.wbt"))
    np.testing.assert_allclose(np.ptp(old, axis=0), PYRAMID.extents, atol=1e-6)


def test_parts_of_a_mesh_file_by_name(tmp_path):
    (tmp_path / "two.obj").write_text(
        "o one\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no two\nv 0 0 5\nv 1 0 5\nv 0 1 5\nf 4 5 6\n"
    )
    world = tmp_path / "lab.wbt"
    assert len(tessellate(parse('Mesh { url "two.obj" }', OLD, file=world))[1]) == 2
    vertices, faces = tessellate(parse('Mesh { url "two.obj" name "two" }', OLD, file=world))
    assert len(faces) == 1 and (vertices[:, 2] == 5).all()
    with pytest.raises(FileFormatError, match=r"name of a part of .*two.obj, one of 'one', 'two' in Mesh, got 'three'"):
        tessellate(parse('Mesh { url "two.obj" name "three" }', OLD, file=world))
    # Since R2022b, names select parts of COLLADA files only.
    assert len(tessellate(parse('Mesh { url "two.obj" name "two" }', file=world))[1]) == 2


# Two instances of a tetrahedron with edges 1, 2 and 3 along x, y and z in the file's unit, one 10 farther along x.
COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
  <asset>{}</asset>
  <library_geometries><geometry id="corner"><mesh>
    <source id="points"><float_array id="numbers" count="12">0 0 0 1 0 0 0 2 0 0 0 3</float_array>
      <technique_common><accessor source="#numbers" count="4" stride="3">
        <param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
      </accessor></technique_common></source>
    <vertices id="corners"><input semantic="POSITION" source="#points"/></vertices>
    <triangles count="4"><input semantic="VERTEX" source="#corners" offset="0"/>
      <p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles>
  </mesh></geometry></library_geometries>
  <library_visual_scenes><visual_scene id="scene">
    <node><instance_geometry url="#corner"/></node>
    <node><translate>10 0 0</translate><instance_geometry url="#corner"/></node>
  </visual_scene></library_visual_scenes>
  <scene><instance_visual_scene url="#scene"/></scene>
</COLLADA>"""


@pytest.mark.parametrize("type", ["Mesh", "CadShape"])
@pytest.mark.parametrize(
    "asset, high, new_high",
    [
        ("<up_axis>Z_UP</up_axis>", (11, 3, 0), (11, 2, 3)),
        ("<up_axis>Y_UP</up_axis>", (11, 2, 3), (11, 0, 2)),
        ("<up_axis>X_UP</up_axis>", (0, 11, 3), (0, 0, 11)),
        ("", (11, 2, 3), (11, 0, 2)),
        ('<unit name="cm" meter="0.01"/> <up_axis>Z_UP</up_axis>', (0.11, 0.03, 0), (0.11, 0.02, 0.03)),
        ("<unit meter='2.5'/>", (27.5, 5, 7.5), (27.5, 0, 5)),
    ],
)
def test_collada_units_and_axes(tmp_path, type, asset, high, new_high):
    pytest.importorskip("collada")
    (tmp_path / "a.dae").write_text(COLLADA.format(asset))
    for version, expected in (("R2022a", high), ("R2022b", new_high)):
        vertices, faces = tessellate(parse(f'{type} {{ url "a.dae" }}', version, file=tmp_path / "lab.wbt"))
        np.testing.assert_allclose(vertices.max(axis=0), expected, atol=1e-9)
        mesh = trimesh.Trimesh(vertices, faces)
        unit = np.ptp(vertices, axis=0).max() / 11
        assert mesh.volume == pytest.approx(2 * unit**3) and mesh.is_watertight  # rotated, not mirrored


def test_mirrored_collada_nodes_face_outward(tmp_path):
    pytest.importorskip("collada")
    moved, mirrored = "<translate>10 0 0</translate>", "<scale>-1 1 1</scale><translate>10 0 0</translate>"
    (tmp_path / "a.dae").write_text(COLLADA.format("").replace(moved, mirrored))
    vertices, faces = tessellate(parse('Mesh { url "a.dae" }', file=tmp_path / "lab.wbt"))
    parts = trimesh.Trimesh(vertices, faces, process=False).split()
    assert [part.volume for part in parts] == pytest.approx([1, 1])


def test_invalid_collada_units_raise(tmp_path):
    pytest.importorskip("collada")
    for unit in ("0", "-1", "nan", "meter"):
        (tmp_path / f"a{unit}.dae").write_text(COLLADA.format(f'<unit meter="{unit}"/>'))
        with pytest.raises(FileFormatError, match=r"a.*\.dae: cannot be read as DAE: "):
            tessellate(parse(f'Mesh {{ url "a{unit}.dae" }}', file=tmp_path / "lab.wbt"))


def test_resolve_finds_mesh_files(tmp_path):
    PYRAMID.export(tmp_path / "cone.stl")
    node = parse('Mesh { url [ "webots://projects/cone.stl" ] }')
    with pytest.raises(MissingMeshError, match=r"the file 'webots://projects/cone.stl' of Mesh is missing"):
        tessellate(node)
    found = []

    def resolve(url, asking):
        found.append((url, asking))
        return tmp_path / "cone.stl"

    assert len(tessellate(node, resolve=resolve)[1]) == len(PYRAMID.faces)
    assert found == [("webots://projects/cone.stl", node)]
    assert tessellate(parse("Mesh { }")) is None and tessellate(parse('CadShape { url "" }')) is None


def test_unreadable_mesh_files_raise(tmp_path):
    world = tmp_path / "lab.wbt"
    (tmp_path / "a.fbx").write_bytes(b"x")
    (tmp_path / "a.stl").write_bytes(b"nothing of the kind")
    with pytest.raises(MissingMeshError, match=r"lab.wbt:2: the file 'b.obj' of Mesh is missing"):
        tessellate(parse('Mesh { url "b.obj" }', file=world))
    with pytest.raises(MissingMeshError, match=r"lab.wbt:2: .*a.fbx: no reader of .fbx is installed"):
        tessellate(parse('Mesh { url "a.fbx" }', file=world))
    with pytest.raises(FileFormatError, match=r"lab.wbt:2: .*a.stl: holds no triangles") as caught:
        tessellate(parse('CadShape { url "a.stl" }', file=world))
    assert not isinstance(caught.value, MissingMeshError)


def test_collada_without_pycollada_raises(tmp_path):
    if "dae" in trimesh.available_formats():
        pytest.skip("pycollada is installed")
    (tmp_path / "a.dae").write_text("<COLLADA/>")
    with pytest.raises(MissingMeshError, match="reading it needs pycollada"):
        tessellate(parse('Mesh { url "a.dae" }', file=tmp_path / "lab.wbt"))


GRID = "ElevationGrid {{ xDimension 2 yDimension 2 {} }}"
BAD = {
    "Sphere { radius 0 }": "a positive radius [m] of at most 1e+18 in Sphere, got 0",
    "Sphere { radius -1 }": "a positive radius [m] of at most 1e+18 in Sphere, got -1",
    "Sphere { subdivision 0 }": "subdivision from 1 to 5 in Sphere, got 0",
    "Sphere { subdivision 6 }": "subdivision from 1 to 5 in Sphere, got 6",
    "Sphere { ico FALSE subdivision 33 }": "subdivision from 3 to 32 in Sphere, got 33",
    "Cylinder { subdivision 2 }": "subdivision from 3 to 1000 in Cylinder, got 2",
    "Cylinder { subdivision 1e9 }": "subdivision from 3 to 1000 in Cylinder, got 1000000000",
    "Cylinder { height -2 }": "a positive height [m] of at most 1e+18 in Cylinder, got -2",
    "Cone { bottomRadius 1e300 }": "a positive bottomRadius [m] of at most 1e+18 in Cone, got 1e+300",
    "Capsule { subdivision 3 }": "subdivision from 4 to 1000 in Capsule, got 3",
    "Box { size 1 0 1 }": "a positive size [m] of at most 1e+18 in Box, got 1 0 1",
    "Box { size 1 1 }": "3 numbers in 'size' of Box, got 2",
    "Plane { size -1 1 }": "a positive size [m] of at most 1e+18 in Plane, got -1 1",
    "ElevationGrid { xDimension 1e9 yDimension 1e9 }": "a grid of at most 4194304 points in ElevationGrid",
    "ElevationGrid { xDimension -1 }": "xDimension of at least 0 in ElevationGrid, got -1",
    GRID.format("xSpacing 0"): "a positive xSpacing [m] of at most 1e+18 in ElevationGrid, got 0",
    GRID.format('height "high"'): "numbers in 'height' of ElevationGrid",
    "IndexedFaceSet { coord Coordinate { point [ 1 2 3 4 ] } }": "groups of 3 numbers in point in Coordinate, got 4",
    face_set(
        [(0, 0, 0)] * 3, "0 1 3 -1"
    ): "-1 or an index below 3, the number of points, at every position of coordIndex",
    face_set([(0, 0, 0)] * 3, "0 1 -2"): "in IndexedFaceSet, got -2 at position 2",
    face_set([(0, 0, 0)] * 3, "0 1 0.5"): "in IndexedFaceSet, got 0.5 at position 2",
    face_set([(0, 0, 0)] * 3, "0 1 1e300"): "in IndexedFaceSet, got 1e+300 at position 2",
    "Extrusion { spine [ 0 0 0 ] }": "at least two points in crossSection and spine in Extrusion, got 5 and 1",
    "Extrusion { spine [ 1 1 1, 1 1 1 ] }": "a spine with a tangent at every point in Extrusion, got none at",
    "Extrusion { scale [ 1 1, 2 2, 3 3 ] }": "1 or 2 values in scale, one for all or each point of the spine",
    "Extrusion { splineSubdivision 1e8 }": "at most 4194304 points in Extrusion, got 100000001 x 5",
    "Extrusion { crossSection [ 1 2 3 ] }": "groups of 2 numbers in crossSection in Extrusion, got 3 numbers",
    "Teapot { }": "one of Box, CadShape, Capsule, Cone, Cylinder, ElevationGrid, Extrusion, IndexedFaceSet",
}


@pytest.mark.parametrize("text", BAD)
def test_invalid_geometry_raises_with_file_and_line(text):
    with pytest.raises(FileFormatError) as caught:
        tessellate(parse(text))
    message = str(caught.value)
    assert message.startswith("lab.wbt:2: expected ") and BAD[text] in message and "\n" not in message


def test_large_concave_polygons_raise():
    angles = np.linspace(0, 2 * math.pi, 3000, endpoint=False)
    radii = 1 + np.arange(3000) % 2
    points = np.c_[radii * np.cos(angles), radii * np.sin(angles), np.zeros(3000)]
    with pytest.raises(FileFormatError, match="at most 2000 corners of a polygon that is not convex"):
        tessellate(parse(face_set(points, " ".join(map(str, range(3000))))))


def test_all_geometries_are_tested():
    names = "Box, CadShape, Capsule, Cone, Cylinder, ElevationGrid, Extrusion, IndexedFaceSet, Mesh, Plane, Sphere"
    with pytest.raises(FileFormatError, match=f"expected one of {names} as geometry in "):
        tessellate(parse("Group { }"))
