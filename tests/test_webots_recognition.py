# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a camera recognises, by Webots' rules: bounds, frustum, range and the three kinds of occlusion."""

import math

import numpy as np
import pytest

from warpvis.webots import load_webots, recognise

SLOPE = math.tan(0.5)  # half of the field of view


def world_of(folder, text, fields="", robot="", version="R2023b"):
    """Make a world with a camera at the origin that looks along x."""
    camera = f'Camera {{ name "eye" width 80 height 60 fieldOfView 1 recognition Recognition {{ {fields} }} }}'
    path = folder / "world.wbt"
    path.write_text(
        f'#VRML_SIM {version} utf8\nRobot {{ name "car" children [ {camera} {robot} ] '
        f"boundingObject Box {{ size 0.4 0.4 0.4 }} }}\n"
        'Solid { name "shape" translation 0 0 -9 children Shape { geometry Box { size 1 1 1 } } }\n' + text
    )
    return load_webots(path)


def found(folder, text, fields="", **options):
    return recognise(world_of(folder, text, fields, **options), "eye")


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


def test_half_of_the_size_counts_in_the_range(tmp_path):
    """A train of 2 m whose middle is 10 m away begins 9 m away."""
    train = target((10, 0, 0), "Box { size 2 1 1 }", "Box { size 2 1 1 }")
    assert names(tmp_path, train, "maxRange 9.01") == ["it"] and names(tmp_path, train, "maxRange 8.99") == []


def test_the_range_is_ahead(tmp_path):
    """And not along the ray, but for a sphere about the shapes, which may not be beyond it altogether."""
    aside = target((4, 1.8, 0), "Box { size 0.1 0.1 0.1 }", "Box { size 0.1 0.1 0.1 }")
    assert names(tmp_path, aside, "maxRange 4.3") == ["it"]
    assert names(tmp_path, aside, "maxRange 4.2") == []  # 4.39 m away, and the sphere's radius is 0.09 m


def test_what_is_reset(tmp_path):
    with pytest.warns(UserWarning, match="maxRange 0 of Recognition is 100"):
        assert names(tmp_path, target((40, 0, 0)), "maxRange 0") == ["it"]
    with pytest.warns(UserWarning, match="occlusion 3 of Recognition is 1"):
        assert names(tmp_path, target((4, 0, 0)) + block(2), "occlusion 3") == []


# ----------------------------------------------------------------------------------------------------------- frustum


def test_a_wall_across_the_image_is_cut_at_its_sides(tmp_path):
    """None of its corners is in the image; each moves to the nearest place on the side."""
    (wall,) = found(tmp_path, target((5, 0, 0), "Box { size 1 20 0.2 }", "Box { size 1 20 0.2 }"))
    reach = SLOPE * (5.5 + 10 * SLOPE) / (1 + SLOPE**2)
    assert wall.size[0] == pytest.approx(2 * reach) and wall.size[1] == pytest.approx(0.2)
    assert wall.position[0] == pytest.approx(0) and wall.image_size[0] == 79
    assert names(tmp_path, target((5, 15, 0), "Box { size 1 20 0.2 }", "Box { size 1 20 0.2 }")) == []


def test_a_ball_on_a_side_is_cut_by_its_distance(tmp_path):
    (ball,) = found(tmp_path, target((4, 4 * SLOPE, 0)))
    np.testing.assert_allclose(ball.size, [0.5, 1, 1], atol=1e-3)
    np.testing.assert_allclose(ball.position, [-(4 * SLOPE - 0.25), 0, 4], atol=1e-3)
    assert names(tmp_path, target((4, 4 * SLOPE + 0.7, 0))) == []


def test_behind_is_not_seen(tmp_path):
    assert names(tmp_path, target((-4, 0, 0)) + target((-4, 0, 0), "Box { }", "Box { }", "box")) == []


CYLINDER = "Cylinder { radius 0.5 height 2 }"


def test_boxes_are_about_bounding_objects(tmp_path):
    """Not about shapes; about the sphere of the shapes where there is none."""
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


def test_solids_in_a_solid_belong_to_it(tmp_path):
    """Their bounding objects too, and then no sphere about the rest."""
    hand = "Solid { translation 0 2 0 boundingObject Box { size 1 1 1 } }"
    (item,) = found(tmp_path, target((9, 0, 0), more=hand))
    np.testing.assert_allclose(item.size, [1, 1, 1])
    np.testing.assert_allclose(item.position, [-2, 0, 9], atol=1e-9)


def test_place_and_size_on_the_image(tmp_path):
    (item,) = found(tmp_path, target((5, 0.5, 0), "Box { size 1 1 1 }", "Box { size 1 1 1 }"))
    u = [int(79 * (0.5 - 0.5 * y / 4.5 / SLOPE)) for y in (1, 0)]
    v = [int(59 * (0.5 - 0.5 * z / 4.5 / (SLOPE * 0.75))) for z in (0.5, -0.5)]
    assert item.image_size == (u[1] - u[0], v[1] - v[0])
    assert item.image_position == (math.floor((u[0] + u[1]) / 2 + 0.5), math.floor((v[0] + v[1]) / 2 + 0.5))


def test_what_is_smaller_than_a_pixel_is_not_seen(tmp_path):
    assert names(tmp_path, target((40, 0.3, 0.3), "Box { size 0.01 0.01 0.01 }", "Box { size 0.01 0.01 0.01 }")) == []


def test_old_worlds_look_along_minus_z(tmp_path):
    (item,) = found(tmp_path, target((0.5, 0, -9), CYLINDER, CYLINDER), version="R2021b")
    np.testing.assert_allclose(item.size, [1, 2, 1])
    np.testing.assert_allclose(item.position, [0.5, 0, 9], atol=1e-9)


# --------------------------------------------------------------------------------------------------------- occlusion


def test_what_is_near_the_target_does_not_hide_it(tmp_path):
    """Within half of its size before its origin."""
    assert names(tmp_path, target((4, 0, 0)) + block(3.6)) == ["it"]
    assert names(tmp_path, target((4, 0, 0)) + block(3.4)) == []
    assert names(tmp_path, target((4, 0, 0)) + block(3.4), "occlusion 0") == ["it"]


def test_bounding_objects_hide_and_shapes_do_not(tmp_path):
    (item,) = found(tmp_path, target((4, 0, 0)) + block(2, "0.02 9 9", kind="shape"))
    assert item.name == "it" and item.visible_pixels == 0
    assert names(tmp_path, target((4, 0, 0)) + block(2, "0.02 9 9")) == []


def test_its_own_parts_and_the_robot_hide_nothing(tmp_path):
    """The camera is within its robot's bounding object."""
    shield = "Solid { translation -1 0 0 boundingObject Box { size 0.1 2 2 } }"
    text = target((4, 0, 0), bounds="Sphere { radius 0.5 }", more=shield)
    assert names(tmp_path, text, robot="Solid { translation 1 0 0 boundingObject Box { size 0.1 9 9 } }") == ["it"]
    other = "Robot { translation 1 0 0 boundingObject Box { size 0.1 9 9 } }"
    assert names(tmp_path, text + other) == []


def test_one_ray_or_one_for_every_corner(tmp_path):
    """A post before the middle hides it from one ray, and not the corners; a wall hides all."""
    box = target((6, 0, 0), "Box { size 1 1 1 }", "Box { size 1 1 1 }")
    for obstacle, one, many in (("0.02 0.2 2", [], ["it"]), ("0.02 2 2", [], [])):
        text = box + block(3, obstacle)
        assert names(tmp_path, text, "occlusion 1") == one and names(tmp_path, text, "occlusion 2") == many
    aside = box + block(3, "0.02 0.2 2", y=0.25)
    assert names(tmp_path, aside, "occlusion 1") == ["it"]


def test_occlusion_of_spheres_has_six_rays(tmp_path):
    ball = target((6, 0, 0))
    assert names(tmp_path, ball + block(3, "0.02 0.4 0.4"), "occlusion 2") == ["it"]
    assert names(tmp_path, ball + block(3, "0.02 0.8 0.8"), "occlusion 2") == []


def test_planes_hide_what_is_below(tmp_path):
    floor = "Solid { translation 0 0 -0.6 boundingObject Plane { } }"
    assert names(tmp_path, target((4, 0, -1.5)) + floor, "occlusion 1") == []
    assert names(tmp_path, target((4, 0, 0)) + floor, "occlusion 1") == ["it"]


def test_the_robots_own_solids_are_not_listed(tmp_path):
    """But for those within those."""
    inner = target((1, 0, 0), "Sphere { radius 0.1 }", name="inner")
    arm = target((3, 0.5, 0), "Sphere { radius 0.1 }", name="arm", more=inner)
    assert names(tmp_path, "", "occlusion 0", robot=arm) == ["inner"]
