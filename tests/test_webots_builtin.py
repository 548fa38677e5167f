# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of built-in replacements for common Webots PROTOs: extents, volumes, messages, in both axis conventions."""

import math
import re

import numpy as np
import pytest
import trimesh

from warpvis.errors import FileFormatError
from warpvis.webots._grammar import parse_text
from warpvis.webots.protos._builtin import BUILTIN, expand
from warpvis.webots.protos._standins import expand_depth_camera
from warpvis.webots.shapes._geometry import tessellate

NEW, OLD = "R2023b", "R2021b"


def parse(text, version=NEW):
    (node,) = parse_text(f"#VRML_SIM {version} utf8\n\n{text}", "lab.wbt").nodes
    return node


def shapes_of(node, place=(0.0, 0.0, 0.0)):
    """Return meshes of the shapes below a node, in its frame."""
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
    """Return bounds with the axes along, across and up: y, x, z or x, z, y."""
    return np.asarray(bounds)[:, [1, 0, 2] if version == NEW else [0, 2, 1]]


# Minimum and maximum along, across and up, measured on the output of Webots' PROTO files of both conventions.
EXTENTS = {
    "Floor { }": [(-5, -5, 0), (5, 5, 0)],
    "RectangleArena { }": [(-0.51, -0.51, 0), (0.51, 0.51, 0.1)],
    "CircleArena { }": [(-1.01, -1.01, 0), (1.01, 1.01, 0.1)],
    "Wall { }": [(-0.5, -0.1, 0), (0.5, 0.1, 2.4)],
    "SolidBox { }": [(-1, -1, -1), (1, 1, 1)],
    "WoodenBox { }": [(-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)],
    "CardboardBox { }": [(-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)],
    "Table { }": [(-0.9, -0.5, 0), (0.9, 0.5, 0.74)],
    "Door { }": [(-0.5, -0.15, 0), (0.5, 0.201, 2.4)],
    "Window { }": [(-0.4, -0.25, 0), (0.4, 0.25, 2.4)],
    "Cabinet { }": [(-0.4, 0, 0), (0.4, 0.5, 1.5)],
}
OLD_EXTENTS = {
    "CardboardBox { }": [(-0.29898, -0.29898, -0.29898), (0.29898, 0.29898, 0.29898)],
    "Window { }": [(-0.4, -0.22, 0), (0.4, 0.22, 2.4)],
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
def test_default_extents(text, version):
    expected = EXTENTS | (OLD_EXTENTS if version == OLD else {})
    np.testing.assert_allclose(up_and_level(extents(text, version), version), expected[text], atol=1e-12)


@pytest.mark.parametrize("type", sorted(BUILTIN))
def test_solids_have_the_pose_and_name_of_the_instance(type):
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


def test_all_builtin_types_are_tested():
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
    assert "translation" not in expand(parse("Wall { }")).fields
    assert expand(parse("SolidBox { }", "R2023a")).vector("translation", (9, 9, 9)).tolist() == [0, 0, 0]


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
        # Walls of equal height around the floor: their volume is that of the ring between two rectangles.
        assert sum(wall.volume for wall in walls) == pytest.approx((4.2 * 6.2 - 4 * 6) * 0.5)


@pytest.mark.parametrize("version", [NEW, OLD])
def test_circle_arenas_are_a_disc_and_a_pipe(version):
    text = "CircleArena { radius 2 wallThickness 0.5 wallHeight 0.25 subdivision 10 }"
    disc, pipe = shapes_of(expand(parse(text, version)))
    (up, other), area = (2, 1) if version == NEW else (1, 2), 5 * math.sin(math.pi / 5)
    assert disc.area == pytest.approx(area * 2.25**2) and (disc.face_normals[:, up] > 0.99).all()
    assert pipe.is_watertight and pipe.euler_number == 0
    inner = 2 + 2.5 * (1 - math.cos(math.pi / 10))  # the pipe is 0.5 thick where its sides are nearest to the center
    assert pipe.volume == pytest.approx(area * (2.5**2 - inner**2) * 0.25)
    # The disc has a corner on x, the pipe on the other horizontal axis.
    assert disc.vertices[:, 0].max() == pytest.approx(2.25) and disc.vertices[:, other].max() < 2.2
    assert pipe.vertices[:, other].min() == pytest.approx(-2.5) and pipe.vertices[:, 0].max() < 2.45
    assert len(shapes_of(expand(parse("CircleArena { }", version)))[0].faces) == 48


def test_size_follows_the_order_of_axes():
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
    # feetSize: first along x, then along the other horizontal axis.
    assert feet[0].extents[0] == pytest.approx(0.2)


def inside(shapes, points):
    """Return whether each point lies inside one of the boxes."""
    return [any(((shape.bounds[0] < point) & (point < shape.bounds[1])).all() for shape in shapes) for point in points]


def points_of(version, *rows):
    """Return points given along, across and up in the axes of a version."""
    along, across, up = np.array(rows).T
    return np.stack([across, along, up] if version == NEW else [along, up, across], axis=1)


@pytest.mark.parametrize("version, size", [(NEW, "0.2 1 2.4"), (OLD, "1 2.4 0.2")])
def test_doors_are_closed(version, size):
    doors = shapes_of(expand(parse(f"Door {{ size {size} position 1 }}", version)))
    assert len(doors) == 5 and all(shape.is_watertight for shape in doors)
    points = points_of(
        version,
        (0, 0, 1),  # the opening
        (0, 0.176, 1),  # the door, 5 cm thick, in front of the frame
        (0.474, 0.176, 1.974),  # it covers half of the posts and of the lintel, with a gap of 12.5 mm below
        (0, 0.176, 0.01),
        (0.48, 0.14, 1),  # a post, which protrudes from the wall
        (0, 0.14, 1.97),  # the lintel
        (0, 0.09, 2.2),  # the wall above
        (0, 0.14, 2.2),  # in front of the wall above
    )
    assert inside(doors, points) == [False, True, True, False, True, True, True, False]
    frame = 1 * 2 - 0.9 * 1.95
    assert sum(shape.volume for shape in doors) == pytest.approx(0.95 * 1.975 * 0.05 + frame * 0.3 + 0.4 * 0.2)
    assert len(shapes_of(expand(parse(f"Door {{ size {size} frameHeight 2.4 }}", version)))) == 4


@pytest.mark.parametrize(
    "version, size, frame", [(NEW, "0.2 1 2.4", "0.02 0.05 0.05"), (OLD, "1 2.4 0.2", "0.05 0.05 0.02")]
)
def test_windows_have_a_pane_and_a_sill(version, size, frame):
    windows = shapes_of(expand(parse(f"Window {{ size {size} frameSize {frame} }}", version)))
    assert len(windows) == 8
    points = points_of(
        version,
        *((0, 0, 1.4), (0, 0.03, 1.4), (0, 0.09, 0.3), (0, 0, 2.3), (0.48, 0.11, 1.4)),  # pane, its front, walls, post
        *((0, 0.21, 0.72), (0.49, 0.21, 0.72), (0, 0.11, 0.77), (0, 0.11, 2.08)),  # sill, and the bars of the frame
    )
    assert inside(windows, points) == [True, False] + [True] * 7
    parts = [(0.7 + 0.3) * 0.2, 2 * 0.05 * 1.4 * 0.24, 2 * 0.9 * 0.05 * 0.24, 0.9 * 1.3 * 0.05, 1 * 0.05 * 0.44]
    assert sum(shape.volume for shape in windows) == pytest.approx(sum(parts))
    full = f"Window {{ size {size} bottomWallHeight 1 windowHeight 1.4 windowSillSize 0 1 }}"
    assert len(shapes_of(expand(parse(full, version)))) == 6
    assert len(shapes_of(expand(parse("Window { bottomWallHeight 0 }", version)))) == 7


@pytest.mark.parametrize("version", [NEW, OLD])
def test_cabinets_follow_their_layout(version):
    text = "Cabinet { depth 0.6 outerThickness 0.1 rowsHeights [ 0.5 0.5 ] columnsWidths [ 1, 1 ] layout [ %s ] }"
    panels = shapes_of(expand(parse(text % "", version)))
    np.testing.assert_allclose(
        up_and_level(extents(text % "", version), version), [(-1.1, 0, 0), (1.1, 0.6, 1.2)], atol=1e-12
    )
    points = points_of(
        version, (0, 0.3, 0.6), (0, 0.59, 0.6), (0, 0.05, 0.6), (1.05, 0.3, 0.6), (0, 0.3, 0.05), (0, 0.3, 1.15)
    )
    assert inside(panels, points) == [False, False, True, True, True, True]
    assert sum(panel.volume for panel in panels) == pytest.approx(2.2 * 1.2 * 0.6 - 2 * 1 * 0.5)
    layout = '"RightSidedDoor (1, 1, 1, 2, 1.5)" "Drawer (2, 1, 1, 1)" "Shelf (1, 2, 2, 0)" "Shelf (1, 1, 0, 1)"'
    filled = shapes_of(expand(parse(text % layout, version)))
    points = points_of(
        version,
        *((-0.5, 0.59, 0.8), (-0.5, 0.57, 0.4), (-0.5, 0.3, 0.605), (0.005, 0.3, 0.3)),  # door, behind it, the shelves
        *((0.5, 0.59, 0.2), (0.5, 0.115, 0.4), (0.5, 0.3, 0.12), (0.98, 0.3, 0.3), (0.5, 0.3, 0.4)),  # drawer
        (0.5, 0.59, 0.9),  # above the drawer
    )
    assert inside(filled, points) == [True, False, True, True, True, True, True, True, False, False]
    assert len(filled) == len(panels) + 1 + 5 + 2


@pytest.mark.parametrize("angle, end", [(0, (0.25, 0.15)), (math.pi / 2, (-0.25, 0.15 + 0.5))])
def test_cardboard_boxes_have_a_lid(angle, end):
    solid = expand(parse(f"CardboardBox {{ size 0.5 0.4 0.3 lidAngle {angle} }}"))
    shapes = [*shapes_of(solid)]
    area = 0.5 * 0.4 + 2 * (0.5 + 0.4) * 0.3  # without the lid
    assert len(shapes) == 6 and sum(shape.volume for shape in shapes[:5]) == pytest.approx(area * 0.0005, rel=0.001)
    lid = solid.nodes("children")[-1]
    x, _, z = lid.vector("translation", (0, 0, 0))
    turn = lid.vector("rotation", (0, 0, 1, 0))[3]
    far = x + 0.25 * math.cos(turn), z - 0.25 * math.sin(turn)
    np.testing.assert_allclose(far, np.add(end, (0, -0.00025)), atol=1e-12)


REPLACED = {
    "WoodenBox { size 0.2 4 0.1 }": ("size 4 of WoodenBox, Webots uses 3", [0.2, 3, 0.1]),
    "WoodenBox { size 0.2 1 0.001 }": ("size 0.001 of WoodenBox, Webots uses 0.01", [0.2, 1, 0.01]),
    "CardboardBox { size 2 2 2 }": ("size 2 2 2 of CardboardBox, Webots uses 0.6 0.6 0.6", [0.6, 0.6, 0.6]),
    "CardboardBox { size 0.1 4 0.1 }": ("size 4 of CardboardBox, Webots uses 2.5", [0.1, 2.5, 0.1]),
    "Door { frameHeight 3 }": ("frameHeight 3 of Door, Webots uses 2.4", [0.351, 1, 2.4]),
    "Window { windowHeight 2 }": ("inconsistent sizes of Window, Webots uses the defaults", [0.5, 0.8, 2.4]),
    "Window { size 0.1 2 2.4 }": ("inconsistent sizes of Window", [0.5, 0.8, 2.4]),
    "CircleArena { subdivision 4 }": ("subdivision 4 of CircleArena, Webots uses 8", [2.02, 2.02, 0.1]),
    "Cabinet { depth 0.01 }": ("depth 0.01 of Cabinet, Webots uses 0.12", [0.12, 0.8, 1.5]),
    "Cabinet { columnsWidths 0.01 layout [ ] }": (
        "columnsWidths 0.01 of Cabinet, Webots uses 0.06",
        [0.5, 0.12, 1.5],
    ),
    "Cabinet { outerThickness 0.01 layout [ ] }": (
        "outerThickness 0.01 of Cabinet, Webots uses 0.0102",
        [0.5, 0.7604, 1.4604],
    ),
    'Cabinet { layout [ "Desk (1, 1, 1, 1)" ] }': (
        "layout 'Desk (1, 1, 1, 1)' of Cabinet, Webots uses nothing",
        [0.5, 0.8, 1.5],
    ),
    'Cabinet { layout "Drawer (1, 1, 0, 1)" }': (
        "layout 'Drawer (1, 1, 0, 1)' of Cabinet, Webots uses nothing",
        [0.5, 0.8, 1.5],
    ),
    'Cabinet { layout "Shelf (4, 1, 0, 1)" }': (
        "layout 'Shelf (4, 1, 0, 1)' of Cabinet, Webots uses nothing",
        [0.5, 0.8, 1.5],
    ),
}


@pytest.mark.parametrize("text", REPLACED)
def test_invalid_sizes_are_replaced_with_a_warning(text):
    message, size = REPLACED[text]
    with pytest.warns(UserWarning, match=re.escape(f"lab.wbt:3: instead of {message}")):
        np.testing.assert_allclose(np.ptp(extents(text), axis=0), size, atol=1e-9)


BAD = {
    "Floor { size 0 1 }": "a positive size [m] of at most 1e+18 in Floor, got 0 1",
    "RectangleArena { floorSize 1 }": "2 numbers in 'floorSize' of RectangleArena, got 1",
    "RectangleArena { wallHeight -1 }": "a positive wallHeight [m] of at most 1e+18 in RectangleArena, got -1",
    "CircleArena { subdivision 2000 }": "subdivision from -1000 to 1000 in CircleArena, got 2000",
    "CircleArena { radius 0 }": "a positive radius",
    "Wall { size 1 2 }": "3 numbers in 'size' of Wall, got 2",
    "WoodenBox { size 1 -1 1 }": "a positive size [m] of at most 1e+18 in WoodenBox, got 1 -1 1",
    "WoodenBox { size 0 0 0 }": "a positive size [m] of at most 1e+18 in WoodenBox, got 0 0 0",
    "CardboardBox { name 7 }": "a string in 'name' of CardboardBox",
    "Table { frameThickness 2 }": "frameThickness below the table's height in Table, got 2",
    "Table { feetSize -1 1 }": "a feetSize that is not negative in Table, got -1 1",
    "Door { frameSize 1 1 1 }": "a frame with an opening in Door, got frameSize 1 1",
    "Window { bottomWallHeight -1 }": "a bottomWallHeight [m] that is not negative in Window, got -1",
    "Window { windowSillSize 0.1 -1 }": "a windowSillSize [m] that is not negative in Window, got 0.1 -1",
    "Window { frameSize 0.01 0.5 0.05 }": "a frame with an opening in Window, got frameSize 0.5 along",
    "Cabinet { rowsHeights [ ] }": "at least one number in rowsHeights in Cabinet, got none",
    "Cabinet { columnsWidths [ 1 -1 ] }": "a positive columnsWidths [m] of at most 1e+18 in Cabinet, got 1 -1",
    "Cabinet { depth 0 }": "a positive depth [m] of at most 1e+18 in Cabinet, got 0",
}


@pytest.mark.parametrize("text", BAD)
def test_invalid_sizes_raise_with_file_and_line(text):
    with pytest.raises(FileFormatError) as caught:
        expand(parse(text))
    message = str(caught.value)
    assert message.startswith("lab.wbt:3: expected ") and BAD[text] in message and "\n" not in message


def test_default_circle_arenas_are_nearly_round():
    _, pipe = shapes_of(expand(parse("CircleArena { }")))
    inner = 1 + 1.01 * (1 - math.cos(math.pi / 48))
    assert pipe.volume == pytest.approx(math.pi * (1.01**2 - inner**2) * 0.1, rel=0.01)


# Positions of a depth camera's range finder and camera, and their viewing direction, in the version's axes.
SENSORS = {
    "Kinect { }": ((0.0127, 0, 0.05), (0.0127, 0, 0.05), (1, 0, 0)),
    "Kinect { foot FALSE }": ((0, 0, -0.0127), (0, 0, -0.0127), (0, 0, -1)),
    "Astra { }": ((0.027, 0.037, 0.034), (0.027, 0.011, 0.034), (1, 0, 0)),
}
OLD_SENSORS = {
    "Kinect { }": ((-0.0127, 0.05, 0), (0.0127, 0.05, 0), (0, 0, -1)),
    "Kinect { foot FALSE }": ((-0.0127, 0, 0), (0.0127, 0, 0), (0, 0, -1)),
    "Astra { }": ((-0.037, 0.007, -0.02), (-0.011, 0.007, -0.02), (0, 0, -1)),
}


def sensors_of(node, linear=None, offset=(0.0, 0.0, 0.0)):
    """Return node, position and axes of each device below a node, by type."""
    linear = np.eye(3) if linear is None else linear
    *axis, angle = node.vector("rotation", (0, 0, 1, 0))
    offset = offset + linear @ node.vector("translation", (0, 0, 0))
    linear = linear @ trimesh.transformations.rotation_matrix(angle, axis)[:3, :3]
    if node.type in ("RangeFinder", "Camera"):
        return {node.type: (node, offset, linear)}
    inner = [sensors_of(child, linear, offset) for child in node.nodes("children")]
    return {kind: sensor for sensors in inner for kind, sensor in sensors.items()}


@pytest.mark.parametrize("version", [NEW, OLD])
@pytest.mark.parametrize("text", SENSORS)
def test_depth_cameras_are_placed_as_in_webots(text, version):
    solid = expand_depth_camera(parse(text, version))
    ranges, color, forward = (SENSORS if version == NEW else OLD_SENSORS)[text]
    sensors = sensors_of(solid)
    for kind, place in (("RangeFinder", ranges), ("Camera", color)):
        _, offset, linear = sensors[kind]
        np.testing.assert_allclose(offset, place, atol=2e-6)
        np.testing.assert_allclose(linear[:, 0] if version == NEW else -linear[:, 2], forward, atol=2e-4)
    assert (solid.size, solid.height) == ((7, 4) if text[0] == "K" else (11, 4))
    assert expand_depth_camera(parse("Solid { }")) is None


def test_fields_of_depth_cameras():
    text = 'width 150 height 100 maxRange 4 rangeNoise 0.1 cameraName "k" name "it" rotation 0 0 1 1 }'
    finder, camera = (
        sensors_of(expand_depth_camera(parse(f"Kinect {{ {text}")))[kind][0] for kind in ("RangeFinder", "Camera")
    )
    assert (finder.text("name", ""), camera.text("name", "")) == ("k range", "k color")
    assert [finder.number(name, 0) for name in ("width", "height", "maxRange", "noise", "fieldOfView")] == [
        150,
        100,
        4,
        0.1,
        1,
    ]
    solid = expand_depth_camera(parse('DEF A Astra { rangeNoise 0.2 name "eye" translation 1 2 3 }', "R2022b"))
    (finder, place, _), (camera, *_) = sensors_of(solid)["RangeFinder"], sensors_of(solid)["Camera"]
    assert (finder.text("name", ""), camera.text("name", "")) == ("eye depth", "eye rgb")
    assert [finder.number(name, 0) for name in ("minRange", "maxRange", "noise")] == [0.6, 8, 0.2]
    np.testing.assert_allclose(place, [1.02, 2.037, 3.007])  # R2023a moved the origin to the foot
    assert (solid.name, solid.text("name", "")) == ("A", "eye")
