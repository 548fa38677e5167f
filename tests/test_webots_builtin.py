# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots' best-known PROTOs without their files: extents and volumes of what stands for them, in both conventions."""

import math

import numpy as np
import pytest
import trimesh

from warpvis.errors import FileFormatError
from warpvis.webots.builtin import BUILTIN, expand
from warpvis.webots.geometry import tessellate
from warpvis.webots.grammar import parse_text

NEW, OLD = "R2023b", "R2021b"


def parse(text, version=NEW):
    (node,) = parse_text(f"#VRML_SIM {version} utf8\n\n{text}", "lab.wbt").nodes
    return node


def shapes_of(node, place=(0.0, 0.0, 0.0)):
    """Meshes of the shapes below a node, in its frame."""
    if node.type == "Shape":
        vertices, faces = tessellate(node.node("geometry"))
        return [trimesh.Trimesh(vertices + place, faces, process=False)]
    inner = [
        shapes_of(child, np.add(place, child.vector("translation", (0, 0, 0)))) for child in node.nodes("children")
    ]
    return [shape for shapes in inner for shape in shapes]


def extents(text, version=NEW):
    return trimesh.util.concatenate(shapes_of(expand(parse(text, version)))).bounds


def up_and_level(bounds, version):
    """Bounds with the axes along, across and up: y, x, z or x, z, y."""
    return np.asarray(bounds)[:, [1, 0, 2] if version == NEW else [0, 2, 1]]


# Along, across and up; least and most.
EXTENTS = {
    "Floor { }": [(-5, -5, 0), (5, 5, 0)],
    "RectangleArena { }": [(-0.51, -0.51, 0), (0.51, 0.51, 0.1)],
    "CircleArena { }": [(-1.01, -1.01, 0), (1.01, 1.01, 0.1)],
    "Wall { }": [(-0.5, -0.1, 0), (0.5, 0.1, 2.4)],
    "SolidBox { }": [(-1, -1, -1), (1, 1, 1)],
    "WoodenBox { }": [(-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)],
    "CardboardBox { }": [(-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)],
    "Table { }": [(-0.9, -0.5, 0), (0.9, 0.5, 0.74)],
    "Door { }": [(-0.5, -0.15, 0), (0.5, 0.15, 2.4)],
    "Window { }": [(-0.4, -0.12, 0), (0.4, 0.12, 2.4)],
    "Cabinet { }": [(-0.4, 0, 0), (0.4, 0.5, 1.5)],
}
NAMES = {
    "Floor": "floor",
    "RectangleArena": "rectangle arena",
    "CircleArena": "circle arena",
    "Wall": "wall",
    "SolidBox": "box",
    "WoodenBox": "wooden box",
    "CardboardBox": "cardboard box",
    "Table": "table",
    "Door": "door",
    "Window": "window",
    "Cabinet": "cabinet",
}


@pytest.mark.parametrize("version", [NEW, OLD])
@pytest.mark.parametrize("text", EXTENTS)
def test_extents_by_default(text, version):
    np.testing.assert_allclose(up_and_level(extents(text, version), version), EXTENTS[text], atol=1e-12)


@pytest.mark.parametrize("type", sorted(BUILTIN))
def test_solids_have_the_instance_s_place_and_name(type):
    node = parse(f'DEF IT {type} {{ translation 1 2 3 rotation 0 0 1 1.5 name "mine" recognitionColors [ 1 0 0 ] }}')
    solid = expand(node)
    assert (solid.type, solid.name, solid.text("name", "")) == ("Solid", "IT", "mine")
    assert solid.vector("translation", (0, 0, 0)).tolist() == [1, 2, 3]
    assert solid.vector("rotation", (0, 0, 1, 0)).tolist() == [0, 0, 1, 1.5]
    assert solid.numbers("recognitionColors").tolist() == [1, 0, 0]
    assert expand(parse(f"{type} {{ }}")).text("name", "") == NAMES[type]
    nodes = [solid]
    for part in nodes:
        assert (part.file, part.line, part.version) == ("lab.wbt", 3, node.version)
        values = [value if isinstance(value, list) else [value] for value in part.fields.values()]
        nodes += [item for value in values for item in value if hasattr(item, "fields")]
    assert solid.size == len(nodes) and solid.height >= 3


def test_every_expander_is_tested():
    assert set(NAMES) == BUILTIN
    assert expand(parse("Pioneer3dx { }")) is None and expand(parse("Solid { }")) is None


@pytest.mark.parametrize(
    "text, new, old",
    [
        ("SolidBox { }", [0, 0, 1], [0, 0, 0]),
        ("WoodenBox { }", [0, 0, 0.3], [0, 0.3, 0]),
        ("CardboardBox { }", [0, 0, 0.3], [0, 0.3, 0]),
        ("Wall { }", [0, 0, 0], [0, 0, 0]),
    ],
)
def test_default_translations(text, new, old):
    for version, expected in ((NEW, new), (OLD, old)):
        assert expand(parse(text, version)).vector("translation", (0, 0, 0)).tolist() == expected


def test_floors_face_up():
    for version, up in ((NEW, 2), (OLD, 1)):
        (floor,) = shapes_of(expand(parse("Floor { size 3 7 }", version)))
        assert (floor.face_normals[:, up] == 1).all()
        assert floor.extents.tolist() == ([3, 7, 0] if version == NEW else [3, 0, 7])


def test_rectangle_arenas_are_a_floor_and_four_walls():
    for version, bounds in ((NEW, [(-2.1, -3.1, 0), (2.1, 3.1, 0.5)]), (OLD, [(-2.1, 0, -3.1), (2.1, 0.5, 3.1)])):
        text = "RectangleArena { floorSize 4 6 wallThickness 0.1 wallHeight 0.5 }"
        floor, *walls = shapes_of(expand(parse(text, version)))
        np.testing.assert_allclose(extents(text, version), bounds, atol=1e-12)
        assert sorted(floor.extents) == [0, 4, 6] and len(walls) == 4
        assert all(wall.is_watertight for wall in walls)
        # Of one height, side by side around the floor: their volume is that of the ring between two rectangles.
        assert sum(wall.volume for wall in walls) == pytest.approx((4.2 * 6.2 - 4 * 6) * 0.5)


@pytest.mark.parametrize("version", [NEW, OLD])
def test_circle_arenas_are_a_disc_and_a_pipe(version):
    text = "CircleArena { radius 2 wallThickness 0.5 wallHeight 0.25 subdivision 12 }"
    disc, pipe = shapes_of(expand(parse(text, version)))
    up = 2 if version == NEW else 1
    assert disc.area == pytest.approx(3 * 2.25**2) and (disc.face_normals[:, up] > 0.99).all()
    assert pipe.is_watertight and pipe.euler_number == 0
    assert pipe.volume == pytest.approx(3 * (2.5**2 - 2**2) * 0.25)
    assert len(shapes_of(expand(parse("CircleArena { }", version)))[0].faces) == 48


def test_walls_and_boxes_take_their_size_in_the_order_of_their_axes():
    assert extents("Wall { size 0.3 5 2 }").tolist() == [[-0.15, -2.5, 0], [0.15, 2.5, 2]]
    assert extents("Wall { size 5 2 0.3 }", "R2021c").tolist() == [[-2.5, 0, -0.15], [2.5, 2, 0.15]]
    for version in (NEW, OLD):
        assert extents("SolidBox { size 1 2 3 }", version).tolist() == [[-0.5, -1, -1.5], [0.5, 1, 1.5]]
        assert extents("WoodenBox { size 1 2 3 }", version).tolist() == [[-0.5, -1, -1.5], [0.5, 1, 1.5]]


@pytest.mark.parametrize("version, size", [(NEW, "1 2 0.8"), (OLD, "2 0.8 1")])
def test_tables_stand_on_four_feet(version, size):
    text = f"Table {{ size {size} feetSize 0.2 0.1 feetPadding 0.05 frameThickness 0.1 }}"
    tray, *feet = shapes_of(expand(parse(text, version)))
    low, high = up_and_level(tray.bounds, version)
    np.testing.assert_allclose([low, high], [(-1, -0.5, 0.7), (1, 0.5, 0.8)], atol=1e-12)
    assert len(feet) == 4 and sum(foot.volume for foot in feet) == pytest.approx(4 * 0.2 * 0.1 * 0.7)
    low, high = up_and_level(trimesh.util.concatenate(feet).bounds, version)
    np.testing.assert_allclose([low, high], [(-0.95, -0.45, 0), (0.95, 0.45, 0.7)], atol=1e-12)
    # feetSize: first along x, then along the other level axis.
    assert feet[0].extents[0] == pytest.approx(0.2)


def inside(shapes, points):
    """Whether each point lies within a box of those given."""
    return [any(((shape.bounds[0] < point) & (point < shape.bounds[1])).all() for shape in shapes) for point in points]


def points_of(version, *rows):
    """Points along, across, up in the axes of a version."""
    along, across, up = np.array(rows).T
    return np.stack([across, along, up] if version == NEW else [along, up, across], axis=1)


@pytest.mark.parametrize("version, size", [(NEW, "0.2 1 2.4"), (OLD, "1 2.4 0.2")])
def test_doors_are_closed(version, size):
    doors = shapes_of(expand(parse(f"Door {{ size {size} }}", version)))
    assert len(doors) == 5 and all(shape.is_watertight for shape in doors)
    points = points_of(
        version,
        (0, 0, 1),  # the leaf, 5 cm thick
        (0, 0.09, 1),  # before the leaf
        (0.48, 0.14, 1),  # a post, which sticks out of the wall
        (0, 0.14, 1.97),  # the lintel
        (0, 0.09, 2.2),  # the wall above
        (0, 0.14, 2.2),  # before the wall above
    )
    assert inside(doors, points) == [True, False, True, True, True, False]
    # The leaf, the frame and the wall touch each other, and none is within another.
    opening, frame = (0.9 * 1.95, 1 * 2 - 0.9 * 1.95)
    assert sum(shape.volume for shape in doors) == pytest.approx(opening * 0.05 + frame * 0.3 + 0.4 * 0.2)
    assert len(shapes_of(expand(parse(f"Door {{ size {size} frameHeight 2.4 }}", version)))) == 4


@pytest.mark.parametrize("version, size", [(NEW, "0.2 1 2.4"), (OLD, "1 2.4 0.2")])
def test_windows_are_open(version, size):
    windows = shapes_of(expand(parse(f"Window {{ size {size} }}", version)))
    assert len(windows) == 6
    points = points_of(
        version, (0, 0, 1.4), (0, 0.09, 0.3), (0, 0, 2.3), (0.48, 0.11, 1.4), (0, 0.11, 0.72), (0, 0.11, 2.08)
    )
    assert inside(windows, points) == [False, True, True, True, True, True]
    frame = 1.4 * 1 - 1.3 * 0.9
    assert sum(shape.volume for shape in windows) == pytest.approx((0.7 + 0.3) * 0.2 + frame * 0.24)
    full = f"Window {{ size {size} bottomWallHeight 1 windowHeight 1.4 }}"
    assert len(shapes_of(expand(parse(full, version)))) == 5


@pytest.mark.parametrize("version", [NEW, OLD])
def test_cabinets_are_open_in_front(version):
    text = "Cabinet { depth 0.6 outerThickness 0.1 rowsHeights [ 0.5 0.5 ] columnsWidths [ 1, 1 ] }"
    panels = shapes_of(expand(parse(text, version)))
    np.testing.assert_allclose(
        up_and_level(extents(text, version), version), [(-1.1, 0, 0), (1.1, 0.6, 1.2)], atol=1e-12
    )
    points = points_of(
        version, (0, 0.3, 0.6), (0, 0.59, 0.6), (0, 0.05, 0.6), (1.05, 0.3, 0.6), (0, 0.3, 0.05), (0, 0.3, 1.15)
    )
    assert inside(panels, points) == [False, False, True, True, True, True]
    assert sum(panel.volume for panel in panels) == pytest.approx(2.2 * 1.2 * 0.6 - 2 * 1 * 0.5)


BAD = {
    "Floor { size 0 1 }": "a positive size [m] of at most 1e+18 in Floor, got 0 1",
    "RectangleArena { floorSize 1 }": "2 numbers in 'floorSize' of RectangleArena, got 1",
    "RectangleArena { wallHeight -1 }": "a positive wallHeight [m] of at most 1e+18 in RectangleArena, got -1",
    "CircleArena { subdivision 2 }": "subdivision from 3 to 1000 in CircleArena, got 2",
    "CircleArena { radius 0 }": "a positive radius",
    "Wall { size 1 2 }": "3 numbers in 'size' of Wall, got 2",
    "SolidBox { size 1 -1 1 }": "a positive size [m] of at most 1e+18 in SolidBox, got 1 -1 1",
    "WoodenBox { size 0 0 0 }": "a positive size [m] of at most 1e+18 in WoodenBox, got 0 0 0",
    "CardboardBox { name 7 }": "a string in 'name' of CardboardBox",
    "Table { frameThickness 2 }": "frameThickness below the table's height in Table, got 2",
    "Door { frameHeight 3 }": "frameHeight at most the door's height in Door, got 3",
    "Door { frameSize 1 1 1 }": "a frame with an opening in Door, got frameSize 1 1",
    "Window { windowHeight 2 }": "bottomWallHeight and windowHeight within the height in Window, got 0.7 and 2",
    "Window { frameSize 1 1 1 }": "a frame with an opening in Window, got frameSize 1 1",
    "Cabinet { rowsHeights [ ] }": "at least one number in rowsHeights in Cabinet, got none",
    "Cabinet { columnsWidths [ 1 -1 ] }": "a positive columnsWidths [m] of at most 1e+18 in Cabinet, got 1 -1",
    "Cabinet { depth 0.01 }": "outerThickness below the depth in Cabinet, got 0.03",
}


@pytest.mark.parametrize("text", BAD)
def test_bad_sizes_are_named_with_file_and_line(text):
    with pytest.raises(FileFormatError) as caught:
        expand(parse(text))
    message = str(caught.value)
    assert message.startswith("lab.wbt:3: expected ") and BAD[text] in message and "\n" not in message


def test_default_circle_arenas_are_near_round():
    _, pipe = shapes_of(expand(parse("CircleArena { }")))
    assert pipe.volume == pytest.approx(math.pi * (1.01**2 - 1) * 0.1, rel=0.01)
