# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of lidars of Webots worlds: rays, axes, corrections, and range images by version."""

import math
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import warpvis as wv
from warpvis.cli import main
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError, FileFormatError, SceneError
from warpvis.webots import find_lidar, load_webots, render_lidar, render_range

ROOM = "Solid { children Shape { geometry IndexedFaceSet { coord Coordinate { point [ %s ] } coordIndex [ %s ] } } }"
SIDES = ((0, 2, 6, 4), (1, 5, 7, 3), (0, 4, 5, 1), (2, 3, 7, 6), (0, 1, 3, 2), (4, 6, 7, 5))


def room(half):
    """Return a box that faces inward: bits of k are the signs of corner k."""
    corners = [[half * (1 if k >> axis & 1 else -1) for axis in range(3)] for k in range(8)]
    inwards = []
    for side in SIDES:
        points = np.array([corners[k] for k in side], dtype=float)
        normal = np.cross(points[1] - points[0], points[2] - points[0])
        inwards.append(side if normal @ points.mean(axis=0) < 0 else side[::-1])
    points = ", ".join(" ".join(map(str, corner)) for corner in corners)
    return ROOM % (points, " -1 ".join(" ".join(map(str, side)) for side in inwards))


def world_of(tmp_path, fields, version="R2023b", rest=None, strict=False):
    path = tmp_path / "world.wbt"
    robot = f'Robot {{ name "car" children [ Lidar {{ name "scan" {fields} }} ] }}'
    path.write_text(f"#VRML_SIM {version} utf8\n{robot} {room(2.0) if rest is None else rest}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_webots(path, strict=strict)


def lidar_of(tmp_path, fields, version="R2023b"):
    return world_of(tmp_path, fields, version).lidars["scan"]


def to_box(directions, half=2.0):
    """Return the length of rays from the center of a cube to its sides."""
    return half / np.abs(directions).max(axis=-1)


def fixed_directions(lidar):
    """Return the documented directions, computed one by one: x forward, y left, z up."""
    found = np.empty((lidar.layers, lidar.columns, 3))
    for i in range(lidar.layers):
        up = lidar.vertical_fov * (0.5 - i / (lidar.layers - 1)) if lidar.layers > 1 else 0.0
        for j in range(lidar.columns):
            left = lidar.fov * (0.5 - (j + 0.5) / lidar.columns)
            x, y, z = math.cos(up) * math.cos(left), math.cos(up) * math.sin(left), math.sin(up)
            c, s = math.cos(lidar.tilt), math.sin(lidar.tilt)
            found[i, j] = c * x - s * z, y, s * x + c * z
    return found


# ---------------------------------------------------------------------------------------------------------- reading


def test_defaults_equal_webots_defaults(tmp_path):
    lidar = lidar_of(tmp_path, "")
    assert (lidar.layers, lidar.columns, lidar.fov, lidar.vertical_fov) == (4, 512, 1.5708, 0.2)
    assert (lidar.near, lidar.min_range, lidar.max_range) == (0.01, 0.01, 1.0)
    assert (lidar.rotates, lidar.projection, lidar.frequency, lidar.robot) == (False, "cylindrical", 10.0, "car")
    assert lidar.describe() == "lidar, 4x512, fov 1.5708 x 0.2, cylindrical, 0.01 to 1 m"


def test_axes_are_forward_left_up_in_all_versions(tmp_path):
    new, old = (lidar_of(tmp_path, "translation 1 2 3", version) for version in ("R2022a", "R2021b"))
    np.testing.assert_allclose(poses_to_matrices(new.pose)[:3, :3], np.eye(3), atol=1e-12)
    # The old device looks along -z, with x to the right and y up.
    np.testing.assert_allclose(poses_to_matrices(old.pose)[:3, :3].T, [(0, 0, -1), (-1, 0, 0), (0, 1, 0)], atol=1e-12)
    np.testing.assert_allclose(old.pose[:3], [1, 2, 3])


@pytest.mark.parametrize(
    ("fields", "name", "value"),
    [
        ("horizontalResolution 0 numberOfLayers 1", "columns", 1),
        ("numberOfLayers -3", "layers", 1),
        ("verticalFieldOfView -1", "vertical_fov", 0.1),
        ("verticalFieldOfView 4", "vertical_fov", math.pi),
        ("fieldOfView 7", "fov", 2 * math.pi),
        ("fieldOfView 3.2 spherical FALSE", "fov", 0.785398),
        ("minRange 2 maxRange 1", "max_range", 3.0),
        ("near 0.5", "near", 0.01),
        ("resolution -2", "resolution", -1.0),
        ('type "spinning"', "rotates", False),
        ("defaultFrequency 50", "frequency", 25.0),
        # 64 layers in 0.1 rad, with columns of 1.5708 / 512 rad: the image has 34 rows.
        ("numberOfLayers 64 verticalFieldOfView 0.1", "columns", math.ceil(64 * 1.5708 / 0.1)),
    ],
)
def test_invalid_values_are_reset_as_in_webots(tmp_path, fields, name, value):
    lidar = lidar_of(tmp_path, fields)
    assert getattr(lidar, name) == value
    assert len(lidar.notes) == 1
    with pytest.raises(FileFormatError, match="expected values that are valid in Webots"):
        world_of(tmp_path, fields, strict=True)


@pytest.mark.parametrize("fields", ["fieldOfView 1e-300", "numberOfLayers 2000000000", 'horizontalResolution "a"'])
def test_lidars_without_an_image_are_skipped(tmp_path, fields):
    world = world_of(tmp_path, fields)
    assert not world.lidars
    assert len(world.refused) == 1
    assert "expected" in world.refused[0]


def test_too_many_rays_raise(tmp_path):
    world = world_of(tmp_path, "numberOfLayers 4000 verticalFieldOfView 3 horizontalResolution 40000")
    with pytest.raises(SceneError, match=r"'scan' must have at most [0-9]+ rays, got 4000 layers of 40000 points"):
        render_lidar(world, "scan")


# ------------------------------------------------------------------------------------------------------------- rays


@pytest.mark.parametrize("tilt", [0.0, 0.3])
@pytest.mark.parametrize("layers", [1, 5])
def test_rays_of_a_fixed_lidar(tmp_path, tilt, layers):
    fields = f"numberOfLayers {layers} horizontalResolution 90 fieldOfView 4 verticalFieldOfView 0.6 tiltAngle {tilt}"
    lidar = lidar_of(tmp_path, fields)
    np.testing.assert_allclose(lidar.rays.directions, fixed_directions(lidar), atol=1e-12)
    assert lidar.rays.times is None
    np.testing.assert_array_equal(lidar.rays.rings, np.repeat(np.arange(layers), 90).reshape(layers, 90))


def test_rendered_layers_are_image_rows(tmp_path):
    lidar = lidar_of(tmp_path, "numberOfLayers 6 horizontalResolution 90 fieldOfView 3 verticalFieldOfView 1")
    line = 3 / 90
    height = math.ceil((1 + line) / line)
    up = [((height - 1) / 2 - int(i * (height - 1) / 5)) * line for i in range(6)]
    np.testing.assert_allclose(np.arcsin(lidar.drawn_rays.directions[..., 2]), np.repeat(up, 90).reshape(6, 90))
    # Within one row of their nominal elevations.
    nominal = np.arcsin(lidar.rays.directions[:, 0, 2])
    assert (np.abs(np.array(up) - nominal) <= line).all()


@pytest.mark.parametrize(("version", "first"), [("R2024a", math.pi), ("R2023b", 0.0), ("R2019a", 0.0)])
def test_rotating_lidar_scans_clockwise(tmp_path, version, first):
    fields = 'type "rotating" horizontalResolution 360 numberOfLayers 3 tiltAngle 0.1 defaultFrequency 5'
    rays = lidar_of(tmp_path, fields, version).rays
    azimuth = np.arctan2(rays.directions[..., 1], rays.directions[..., 0])
    expected = first - (np.arange(360) + 0.5) * 2 * math.pi / 360
    np.testing.assert_allclose(np.exp(1j * azimuth), np.exp(1j * np.tile(expected, (3, 1))), atol=1e-12)
    np.testing.assert_allclose(np.arcsin(rays.directions[:, 0, 2]), [0.2, 0.1, 0.0], atol=1e-12)
    np.testing.assert_allclose(rays.times[0], np.arange(360) / 1800)


def test_planar_lidar_uses_rows_of_a_pinhole(tmp_path):
    fields = "spherical FALSE numberOfLayers 3 horizontalResolution 64 fieldOfView 1 verticalFieldOfView 0.5 maxRange 9"
    lidar = lidar_of(tmp_path, fields)
    assert lidar.projection == "planar"
    x, y, z = np.moveaxis(lidar.drawn_rays.directions, -1, 0)
    pitch = 2 * math.tan(0.5) / 64
    height = math.ceil((0.5 + 1 / 64) * 64)
    np.testing.assert_allclose(y / x, np.tile((32 - np.arange(64) - 0.5) * pitch, (3, 1)), atol=1e-12)
    lines = [(height - 1) / 2 - int(i * (height - 1) / 2) for i in range(3)]
    np.testing.assert_allclose(z / x, np.repeat(np.array(lines) * pitch, 64).reshape(3, 64), atol=1e-12)
    # Webots returns its planar depth: 2 m to the wall ahead. Exact ranges are distances.
    world = world_of(tmp_path, fields)
    np.testing.assert_allclose(render_lidar(world, "scan", webots_version="header"), 2.0, rtol=1e-6)
    np.testing.assert_allclose(render_lidar(world, "scan"), to_box(lidar.rays.directions), rtol=1e-6)


# ------------------------------------------------------------------------------------------------------- range images


@pytest.mark.parametrize("version", ["R2019a", "R2021b", "R2023b", "R2025a"])
@pytest.mark.parametrize("kind", ["fixed", "rotating"])
def test_ranges_in_a_box(tmp_path, version, kind):
    fields = f'type "{kind}" numberOfLayers 4 horizontalResolution 200 fieldOfView 3 maxRange 9 tiltAngle 0.2'
    world = world_of(tmp_path, fields, version)
    lidar = world.lidars["scan"]
    np.testing.assert_allclose(render_lidar(world, "scan"), to_box(lidar.rays.directions), rtol=1e-5)
    values = render_lidar(world, "scan", webots_version="header")
    np.testing.assert_allclose(values, to_box(lidar.drawn_rays.directions), rtol=1e-5)


@pytest.mark.parametrize("version", ["R2021b", "R2023b"])
def test_render_needs_only_rays_and_pose(tmp_path, version):
    fields = "numberOfLayers 3 horizontalResolution 64 maxRange 9 rotation 0 1 0 0.7 translation 0.5 0.2 -0.3"
    world = world_of(tmp_path, fields, version)
    lidar = world.lidars["scan"]
    views = wv.render(world.scene, lidar.rays, lidar.pose, outputs=("depth", "points"), cull_backfaces=True)
    np.testing.assert_array_equal(views.depth.numpy()[0], render_lidar(world, "scan"))
    points = views.points.numpy()
    assert np.abs(np.abs(points).max(axis=-1) - 2).max() < 1e-5  # on the walls
    cloud = wv.sensors.point_clouds(views, lidar.rays)[0]
    assert cloud.dtype.names == ("x", "y", "z", "ring", "range")


def test_values_beyond_limits_by_version(tmp_path):
    plate = "Solid { translation %s children Shape { geometry Box { size 0.1 9 9 } } }"
    fields = "minRange 1 maxRange 3 numberOfLayers 1 horizontalResolution 1 fieldOfView 0.01"
    for where, expected in (("0.5 0 0", (-np.inf, np.inf, 3.0)), ("4 0 0", (np.inf, np.inf, 3.0))):
        world = world_of(tmp_path, fields, rest=plate % where)
        got = [render_lidar(world, "scan", webots_version=name)[0, 0] for name in (None, "header", "R2020b")]
        np.testing.assert_array_equal(got, expected)
    # Surfaces before the near plane are not rendered, so they occlude nothing.
    near = world_of(tmp_path, fields + " near 0.9", rest=plate % "0.5 0 0" + plate % "2.05 0 0")
    np.testing.assert_allclose(render_lidar(near, "scan", webots_version="header"), 2.0, rtol=1e-6)
    assert np.isneginf(render_lidar(near, "scan")).all()


def test_noise_resolution_and_exclude_body(tmp_path):
    fields = "maxRange 9 noise 0.3 resolution 0.25 numberOfLayers 1 horizontalResolution 64"
    world = world_of(tmp_path, fields)
    plain = render_lidar(world, "scan", webots_version="header")
    np.testing.assert_array_equal(plain * 4, np.rint(plain * 4))
    noisy = [render_lidar(world, "scan", webots_version="header", seed=seed) for seed in (1, 1, 2)]
    np.testing.assert_array_equal(noisy[0], noisy[1])
    assert (noisy[0] != noisy[2]).any()
    body = (
        'Robot { name "car" children [ Lidar { name "scan" maxRange 9 } '
        "Pose { translation 1 0 0 children Shape { geometry Box { size 0.1 5 5 } } } ] }"
    )
    path = tmp_path / "own.wbt"
    path.write_text(f"#VRML_SIM R2023b utf8\n{body} {room(2.0)}")
    own = load_webots(path)
    assert render_lidar(own, "scan").max() < 1.5
    np.testing.assert_allclose(
        render_lidar(own, "scan", exclude_body=True), to_box(own.lidars["scan"].rays.directions), rtol=1e-5
    )


# ------------------------------------------------------------------------------------------------------- point clouds


@pytest.mark.parametrize("kind", ["fixed", "rotating"])
def test_points_are_near_their_rays_in_late_versions(tmp_path, kind):
    """Since R2024a, within half a row of the ray."""
    fields = f'type "{kind}" numberOfLayers 4 horizontalResolution 400 maxRange 9 fieldOfView 2'
    world = world_of(tmp_path, fields, "R2025a")
    lidar = world.lidars["scan"]
    ranges = render_lidar(world, "scan")
    points = lidar.points(ranges)
    np.testing.assert_allclose(np.linalg.norm(points, axis=-1), ranges, rtol=1e-6)
    step = 2 * math.pi / 400 if kind == "rotating" else 2 / 400
    aside = np.linalg.norm(points / ranges[..., None] - lidar.rays.directions, axis=-1)
    assert aside.max() < (0.51 * step if kind == "rotating" else 1e-6)


def test_points_of_earlier_versions(tmp_path):
    fields = "numberOfLayers 2 horizontalResolution 5 fieldOfView 2 verticalFieldOfView 0.5 tiltAngle 0.1"
    new, old = (lidar_of(tmp_path, fields, version) for version in ("R2022b", "R2021a"))
    image = np.full((new.layers, new.columns), 2.0)
    points = new.points(image)
    up, left = 0.25 + 0.1, 1 - 2 * 1 / (new.columns - 1)  # the second column of the first layer
    expected = 2 * np.array([math.cos(up) * math.cos(left), math.cos(up) * math.sin(left), math.sin(up)])
    np.testing.assert_allclose(points[0, 1], expected, rtol=1e-6)
    before = old.points(image)
    np.testing.assert_allclose(before, np.stack([-points[..., 1], points[..., 2], -points[..., 0]], axis=-1), rtol=1e-6)
    with pytest.raises(ArrayError, match=r"ranges must have shape \(2, "):
        new.points(image[0])


# --------------------------------------------------------------------------------------------- Webots' own tests

# Surroundings of the sensors in Webots' tests/api/worlds/lidar_*.wbt: a pole in front of a slope on the ground.
POLE_AND_SLOPE = """
Pose { translation 2 -1 0 rotation 0 1 0 -0.8 children [ Shape { geometry Plane { size 1 1 } } ] }
Pose { translation 1 0.5 0 children [ Shape { geometry Cylinder { height 3 radius 0.2 } } ] }
Pose { translation 0 0 -0.1 children [ Shape { geometry Plane { size 15 15 } } ] }
"""


def beside_pole_and_slope(tmp_path, devices, version="R2023b"):
    path = tmp_path / "world.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\nRobot {{ children [ {devices} ] }} {POLE_AND_SLOPE}")
    return load_webots(path)


def test_rotating_and_fixed_lidars_agree(tmp_path):
    fields = "fieldOfView 1.5707963 verticalFieldOfView 0.1 numberOfLayers 1 maxRange 5"
    world = beside_pole_and_slope(
        tmp_path,
        f'Lidar {{ name "fixed" horizontalResolution 256 {fields} }} '
        # A rotating lidar starts straight ahead and scans to the right: rotate it by an eighth of a revolution to the
        # left.
        f'Lidar {{ name "turning" rotation 0 0 1 0.7853982 type "rotating" horizontalResolution 1024 {fields} }}',
    )
    fixed, turning = (render_lidar(world, name)[0] for name in ("fixed", "turning"))
    part = turning[: len(fixed)]
    np.testing.assert_array_equal(np.isfinite(part), np.isfinite(fixed))
    assert 100 < np.isfinite(fixed).sum() < 200
    seen = np.isfinite(fixed)
    np.testing.assert_allclose(part[seen], fixed[seen], atol=1e-5)
    assert fixed[seen].min() < 1 < fixed[seen].max()


def test_lidar_equals_cylindrical_range_finder(tmp_path):
    world = beside_pole_and_slope(
        tmp_path,
        'RangeFinder { name "finder" fieldOfView 3.14159 width 128 height 1 projection "cylindrical" maxRange 5 } '
        'Lidar { name "scan" horizontalResolution 128 fieldOfView 3.14159 numberOfLayers 1 maxRange 5 }',
    )
    scan, finder = render_lidar(world, "scan"), render_range(world, "finder")
    assert 20 < np.isfinite(scan).sum() < 100
    np.testing.assert_allclose(scan, finder, atol=1e-5)


def test_point_cloud_distances_equal_the_image(tmp_path):
    fields = "fieldOfView 1.8 verticalFieldOfView 0.1 numberOfLayers 3 maxRange 5"
    world = beside_pole_and_slope(tmp_path, f'Lidar {{ name "scan" {fields} }}', "R2025a")
    lidar = world.lidars["scan"]
    assert (lidar.layers, lidar.columns) == (3, 512)
    image = render_lidar(world, "scan")
    seen = np.isfinite(image)
    np.testing.assert_allclose(np.linalg.norm(lidar.points(image), axis=-1)[seen], image[seen], rtol=1e-5)
    # The lowest layer (0.05 rad down) meets the ground 0.1 m below; the highest looks above it.
    assert seen[2].sum() > seen[0].sum()


# ----------------------------------------------------------------------------------------- errors, command line


def test_unknown_lidars_raise(tmp_path):
    world = world_of(tmp_path, "")
    with pytest.raises(SceneError, match="the world has no lidar 'other'; it has 'scan'"):
        find_lidar(world, "other")
    with pytest.raises(SceneError, match="world must be a WebotsWorld from load_webots"):
        render_lidar("world.wbt", "scan")
    with pytest.raises(FileFormatError):
        render_lidar(world, "scan", webots_version="R1")


@pytest.mark.parametrize("exact", [(), ("--version-exact",)])
def test_command_line_writes_scans(tmp_path, monkeypatch, capsys, exact):
    world = world_of(tmp_path, "maxRange 9 spherical FALSE fieldOfView 1")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["warpvis", "info", "world.wbt"])
    main()
    assert "lidar  'scan' of 'car': lidar, 4x512, fov 1 x 0.2, planar, 0.01 to 9 m" in capsys.readouterr().out
    monkeypatch.setattr(sys, "argv", ["warpvis", "render", "world.wbt", "--out", "out", *exact])
    main()
    assert "scan: " in capsys.readouterr().out
    held = np.load("out/scan/ranges.npz")
    version = "header" if exact else None
    np.testing.assert_array_equal(held["ranges"], render_lidar(world, "scan", webots_version=version))
    text = Path("out/scan/pcd/000000.pcd").read_bytes()
    header, data = text.split(b"DATA binary\n")
    assert b"POINTS 2048" in header
    points = np.frombuffer(data, dtype="<f4,<f4,<f4,<u2,<f4")
    assert np.abs(points["f0"] - 2).max() < 1e-5  # on the wall ahead
