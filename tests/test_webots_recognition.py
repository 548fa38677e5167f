# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of recognition by Webots' rules: bounds, frustum, range and the three kinds of occlusion."""

import math

import numpy as np
import pytest

from warpvis.webots import load_webots, recognize, segmentation_image

SLOPE = math.tan(0.5)  # half of the field of view


def world_of(folder, text, fields="", robot="", version="R2023b", camera="width 80 height 60 fieldOfView 1"):
    """Return a world with a camera at the origin that looks along x."""
    camera = f'Camera {{ name "eye" {camera} recognition Recognition {{ {fields} }} }}'
    path = folder / "world.wbt"
    path.write_text(
        f'#VRML_SIM {version} utf8\nRobot {{ name "car" children [ {camera} {robot} ] '
        f"boundingObject Box {{ size 0.4 0.4 0.4 }} }}\n"
        'Solid { name "shape" translation 0 0 -9 children Shape { geometry Box { size 1 1 1 } } }\n' + text
    )
    return load_webots(path)


def found(folder, text, fields="", **options):
    return recognize(world_of(folder, text, fields, **options), "eye")


def names(*arguments, **options):
    return [item.name for item in found(*arguments, **options)]


def target(place, shape="Sphere { radius 0.5 subdivision 4 }", bounds="", name="it", more=""):
    x, y, z = place
    bounds = f"boundingObject {bounds}" if bounds else ""
    return (
        f'Solid {{ translation {x} {y} {z} name "{name}" recognitionColors 1 0 0 {bounds} '
        f"children [ Shape {{ geometry {shape} }} {more} ] }}"
    )


def block(x, size="0.02 2 2", y=0, kind="boundingObject"):
    box = f"Box {{ size {size} }}"
    inside = f"boundingObject {box}" if kind == "boundingObject" else f"children Shape {{ geometry {box} }}"
    return f"Solid {{ translation {x} {y} 0 {inside} }}"


# ------------------------------------------------------------------------------------------------------------- range


def test_range_includes_half_of_the_size(tmp_path):
    """A train of 2 m whose center is 10 m away begins 9 m away."""
    train = target((10, 0, 0), "Box { size 2 1 1 }", "Box { size 2 1 1 }")
    assert names(tmp_path, train, "maxRange 9.01") == ["it"] and names(tmp_path, train, "maxRange 8.99") == []


def test_range_is_measured_along_the_axis(tmp_path):
    """Not along the ray; but the bounding sphere of the shapes must reach into the range."""
    aside = target((4, 1.8, 0), "Box { size 0.1 0.1 0.1 }", "Box { size 0.1 0.1 0.1 }")
    assert names(tmp_path, aside, "maxRange 4.3") == ["it"]
    assert names(tmp_path, aside, "maxRange 4.2") == []  # 4.39 m away, and the sphere's radius is 0.09 m


def test_invalid_fields_are_reset(tmp_path):
    with pytest.warns(UserWarning, match="maxRange 0 of Recognition is replaced by 100"):
        assert names(tmp_path, target((40, 0, 0)), "maxRange 0") == ["it"]
    with pytest.warns(UserWarning, match="occlusion 3 of Recognition is replaced by 1"):
        assert names(tmp_path, target((4, 0, 0)) + block(2), "occlusion 3") == []


# ----------------------------------------------------------------------------------------------------------- frustum


def test_wall_across_the_image_is_clipped_at_its_sides(tmp_path):
    """No corner is in the image; each moves to the nearest point on the side."""
    (wall,) = found(tmp_path, target((5, 0, 0), "Box { size 1 20 0.2 }", "Box { size 1 20 0.2 }"))
    reach = SLOPE * (5.5 + 10 * SLOPE) / (1 + SLOPE**2)
    assert wall.size[0] == pytest.approx(2 * reach) and wall.size[1] == pytest.approx(0.2)
    assert wall.position[0] == pytest.approx(0) and wall.image_size[0] == 79
    assert names(tmp_path, target((5, 15, 0), "Box { size 1 20 0.2 }", "Box { size 1 20 0.2 }")) == []


def test_sphere_on_a_side_is_clipped_by_its_distance(tmp_path):
    (ball,) = found(tmp_path, target((4, 4 * SLOPE, 0)))
    np.testing.assert_allclose(ball.size, [0.5, 1, 1], atol=1e-3)
    np.testing.assert_allclose(ball.position, [-(4 * SLOPE - 0.25), 0, 4], atol=1e-3)
    assert names(tmp_path, target((4, 4 * SLOPE + 0.7, 0))) == []


def test_objects_behind_the_camera_are_not_recognized(tmp_path):
    assert names(tmp_path, target((-4, 0, 0)) + target((-4, 0, 0), "Box { }", "Box { }", "box")) == []


CYLINDER = "Cylinder { radius 0.5 height 2 }"


def test_bounds_enclose_bounding_objects(tmp_path):
    """Not the shapes; without a bounding object, the bounding sphere of the shapes."""
    group = (
        "Group { children [ Pose { translation 0 1 0 children Shape { geometry Box { size 1 1 1 } } } Sphere { } ] }"
    )
    text = target((9, 0, 0), "Box { size 4 4 4 }", group, "group")
    (item,) = found(tmp_path, text)
    np.testing.assert_allclose(item.size, [2.5, 2, 2])
    np.testing.assert_allclose(item.position, [-0.25, 0, 9])
    (item,) = found(tmp_path, target((9, 0, 0), CYLINDER, CYLINDER))
    np.testing.assert_allclose(item.size, [1, 2, 1])
    (item,) = found(tmp_path, target((9, 0, 0), CYLINDER, "Capsule { radius 0.5 height 1 }"))
    np.testing.assert_allclose(item.size, [1, 2, 1])
    (item,) = found(tmp_path, target((9, 0, 0), CYLINDER))
    np.testing.assert_allclose(item.size, [2 * math.hypot(0.5, 1)] * 3, atol=2e-3)


def test_child_solids_belong_to_their_parent(tmp_path):
    """Their bounding objects replace the sphere of the shapes."""
    hand = "Solid { translation 0 2 0 boundingObject Box { size 1 1 1 } }"
    (item,) = found(tmp_path, target((9, 0, 0), more=hand))
    np.testing.assert_allclose(item.size, [1, 1, 1])
    np.testing.assert_allclose(item.position, [-2, 0, 9], atol=1e-9)


def test_position_and_size_in_the_image(tmp_path):
    (item,) = found(tmp_path, target((5, 0.5, 0), "Box { size 1 1 1 }", "Box { size 1 1 1 }"))
    u = [int(79 * (0.5 - 0.5 * y / 4.5 / SLOPE)) for y in (1, 0)]
    v = [int(59 * (0.5 - 0.5 * z / 4.5 / (SLOPE * 0.75))) for z in (0.5, -0.5)]
    assert item.image_size == (u[1] - u[0], v[1] - v[0])
    assert item.image_position == (math.floor((u[0] + u[1]) / 2 + 0.5), math.floor((v[0] + v[1]) / 2 + 0.5))


def test_objects_below_one_pixel_are_not_recognized(tmp_path):
    assert names(tmp_path, target((40, 0.3, 0.3), "Box { size 0.01 0.01 0.01 }", "Box { size 0.01 0.01 0.01 }")) == []


def test_old_worlds_look_along_minus_z(tmp_path):
    (item,) = found(tmp_path, target((0.5, 0, -9), CYLINDER, CYLINDER), version="R2021b")
    np.testing.assert_allclose(item.size, [1, 2, 1])
    np.testing.assert_allclose(item.position, [0.5, 0, 9], atol=1e-9)


# --------------------------------------------------------------------------------------------------------- occlusion


def test_surfaces_near_the_target_do_not_occlude_it(tmp_path):
    """Within half of its size in front of its origin."""
    assert names(tmp_path, target((4, 0, 0)) + block(3.6)) == ["it"]
    assert names(tmp_path, target((4, 0, 0)) + block(3.4)) == []
    assert names(tmp_path, target((4, 0, 0)) + block(3.4), "occlusion 0") == ["it"]


def test_bounding_objects_occlude_and_shapes_do_not(tmp_path):
    (item,) = found(tmp_path, target((4, 0, 0)) + block(2, "0.02 9 9", kind="shape"))
    assert item.name == "it" and item.visible_pixels == 0
    assert names(tmp_path, target((4, 0, 0)) + block(2, "0.02 9 9")) == []


def test_target_parts_and_robot_do_not_occlude(tmp_path):
    """The camera is inside its robot's bounding object."""
    shield = "Solid { translation -1 0 0 boundingObject Box { size 0.1 2 2 } }"
    text = target((4, 0, 0), bounds="Sphere { radius 0.5 }", more=shield)
    assert names(tmp_path, text, robot="Solid { translation 1 0 0 boundingObject Box { size 0.1 9 9 } }") == ["it"]
    other = "Robot { translation 1 0 0 boundingObject Box { size 0.1 9 9 } }"
    assert names(tmp_path, text + other) == []


def test_occlusion_with_one_ray_or_one_per_corner(tmp_path):
    """A post in front of the center blocks the single ray, but not the corners; a wall blocks all."""
    box = target((6, 0, 0), "Box { size 1 1 1 }", "Box { size 1 1 1 }")
    for obstacle, one, many in (("0.02 0.2 2", [], ["it"]), ("0.02 2 2", [], [])):
        text = box + block(3, obstacle)
        assert names(tmp_path, text, "occlusion 1") == one and names(tmp_path, text, "occlusion 2") == many
    aside = box + block(3, "0.02 0.2 2", y=0.25)
    assert names(tmp_path, aside, "occlusion 1") == ["it"]


def test_spheres_use_six_occlusion_rays(tmp_path):
    ball = target((6, 0, 0))
    assert names(tmp_path, ball + block(3, "0.02 0.4 0.4"), "occlusion 2") == ["it"]
    assert names(tmp_path, ball + block(3, "0.02 0.8 0.8"), "occlusion 2") == []


def test_planes_occlude_objects_below(tmp_path):
    floor = "Solid { translation 0 0 -0.6 boundingObject Plane { } }"
    assert names(tmp_path, target((4, 0, -1.5)) + floor, "occlusion 1") == []
    assert names(tmp_path, target((4, 0, 0)) + floor, "occlusion 1") == ["it"]


def test_solids_of_the_robot_are_not_listed(tmp_path):
    """Except recognizable solids inside those."""
    inner = target((1, 0, 0), "Sphere { radius 0.1 }", name="inner")
    arm = target((3, 0.5, 0), "Sphere { radius 0.1 }", name="arm", more=inner)
    assert names(tmp_path, "", "occlusion 0", robot=arm) == ["inner"]


# ------------------------------------------------------------------------------------------------------- wide images

SPHERICAL = 'width 256 height 256 fieldOfView 6.28 projection "spherical"'
CYLINDRICAL = 'width 256 height 256 fieldOfView 3 projection "cylindrical"'
LONG_BOX, POST = "Box { size 0.1 0.9 0.1 }", "Capsule { radius 0.05 height 1 }"


def test_wide_images_match_webots_own_test(tmp_path):
    """Two Solids placed as in Webots' tests/api/controllers/camera_recognition, and its values, within 1 px."""
    text = target((-0.55, 0, 0.429), LONG_BOX, LONG_BOX, "box") + target((0.369, 1.65, 0.899), POST, POST, "post")
    known = {item.name: item for item in found(tmp_path, text, "maxRange 5", camera=SPHERICAL)}
    np.testing.assert_allclose(known["box"].position, [0, -0.429, -0.55], atol=1e-9)
    np.testing.assert_allclose(known["box"].size, [0.9, 0.1, 0.1], atol=1e-9)
    np.testing.assert_allclose(known["post"].size, [0.1, 1.1, 0.1], atol=1e-9)
    for name, place, size in (("box", (128, 47), (146, 42)), ("post", (79, 102), (14, 28))):
        np.testing.assert_allclose(known[name].image_position, place, atol=1)
        np.testing.assert_allclose(known[name].image_size, size, atol=1)
    (post,) = found(tmp_path, text, "maxRange 5", camera=CYLINDRICAL)  # the box is behind
    assert post.name == "post"
    np.testing.assert_allclose(post.image_position, (12, 88), atol=1)
    np.testing.assert_allclose(post.image_size, (6, 45), atol=1)


@pytest.mark.parametrize("projection", ["spherical", "cylindrical"])
def test_wide_image_pixels_match_the_boxes(tmp_path, projection):
    """Balls around the camera, also slightly behind, above and below it."""
    angles = [(azimuth, (azimuth % 3 - 1) * 0.3) for azimuth in np.arange(-1.8, 1.9, 0.6)]
    balls = [
        target(3 * np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]), name=f"ball{index}")
        for index, (a, e) in enumerate(angles)
    ]
    camera = f'width 300 height 150 fieldOfView 4.4 projection "{projection}"'
    world = world_of(tmp_path, "".join(balls), camera=camera)
    items, image = recognize(world, "eye"), segmentation_image(world, "eye")
    assert {item.name for item in items} == {f"ball{index}" for index in range(len(angles))}
    for item in items:
        rows, columns = np.nonzero(image == world.scene.index(item.objects[0]))
        assert item.visible_pixels == len(rows) > 20
        left, top, width, height = item.box
        assert (left, left + width) == (columns.min(), columns.max() + 1)
        assert (top, top + height) == (rows.min(), rows.max() + 1)
        # The box of a ball, or the ends of its axes, in the wide image.
        np.testing.assert_allclose(item.image_position, (left + width / 2, top + height / 2), atol=3)
        np.testing.assert_allclose(item.image_size, (width, height), atol=6)


@pytest.mark.slow
def test_wide_images_include_objects_behind_within_the_fov(tmp_path):
    """Round shapes are not clipped; a box is omitted if all its corners are outside."""
    wide = 'width 200 height 100 projection "cylindrical" fieldOfView '

    def seen(azimuth, fov, shape="Sphere { radius 0.3 }"):
        place = (3 * math.cos(azimuth), 3 * math.sin(azimuth), 0)
        return names(tmp_path, target(place, shape, shape), camera=wide + str(fov)) == ["it"]

    box = "Box { size 0.2 0.2 0.2 }"
    for shape in ("Sphere { radius 0.1 }", box):
        assert seen(1.9, 4.4, shape) and seen(-1.9, 4.4, shape)
        assert not seen(2.6, 4.4, shape) and not seen(-2.6, 4.4, shape) and not seen(math.pi, 4.4, shape)
        assert seen(1.2, 2.9, shape) and not seen(1.7, 2.9, shape)


def test_narrow_wide_images_are_stretched(tmp_path):
    """Below 90 degrees, Webots uses the azimuth step of 90 degrees."""
    for projection in ("cylindrical", "spherical"):
        camera = f'width 101 height 101 fieldOfView 1 projection "{projection}"'
        (item,) = found(tmp_path, target((4, 0.4, 0), "Sphere { radius 0.05 }"), camera=camera)
        middle = 50 - 100 * math.atan(0.1) * math.pi / 2
        assert item.image_position[0] == pytest.approx(middle, abs=1)
        (item,) = found(tmp_path, target((4, 0, 0.4), "Sphere { radius 0.05 }"), camera=camera)
        assert item.image_position[1] == pytest.approx(50 - 100 * math.atan(0.1), abs=1)


def test_old_spherical_cameras_are_cylindrical(tmp_path):
    """They look along -z."""
    camera = "width 200 height 100 fieldOfView 3 spherical TRUE"
    (item,) = found(tmp_path, target((4, 0, -2)), camera=camera, version="R2021b")
    assert item.image_position[0] == pytest.approx(199 * (0.5 + math.atan(2) / 3), abs=2)
    np.testing.assert_allclose(item.position, [4, 0, 2], atol=1e-9)
