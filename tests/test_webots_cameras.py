# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of color images of cameras in Webots worlds."""

import math
import warnings

import numpy as np
import pytest
from PIL import Image

import warpvis as wv
from warpvis.cli import main
from warpvis.errors import SceneError
from warpvis.webots import load_webots, render_color, render_range, robot_agent

from support.recorded_warnings import recorded_warnings

SKY = "Background { skyColor [ 0 0 1 ] }"
BRIGHT = round(255 * (1 - math.exp(-1)) ** (1 / 2.2))  # light of 1, tone-mapped as in Webots
RED, GREEN, YELLOW, BLUE = (BRIGHT, 0, 0), (0, BRIGHT, 0), (BRIGHT, BRIGHT, 0), (0, 0, 255)


def shape(geometry, color="1 0 0"):
    """Return a shape that is bright without light."""
    look = f"PBRAppearance {{ baseColor 0 0 0 IBLStrength 0 emissiveColor {color} }}"
    return f"Shape {{ appearance {look} geometry {geometry} }}"


def solid(name, place, geometry, color="1 0 0"):
    return f'Solid {{ name "{name}" translation {place} children {shape(geometry, color)} }}\n'


def load(folder, fields, content, version="R2023b", extra="", sky=SKY):
    path = folder / "world.wbt"
    robot = f'Robot {{ name "car" children [ Camera {{ name "eye" {fields} }} {extra} ] }}\n'
    path.write_text(f"#VRML_SIM {version} utf8\n{sky}\n{robot}{content}")
    return load_webots(path)


def rays(width, height, hfov):
    """Return the directions of pixel centers in Webots' frame, x forward, y left and z up, in double precision."""
    x = (2 * (np.arange(width) + 0.5) / width - 1) * math.tan(hfov / 2)
    y = (1 - 2 * (np.arange(height) + 0.5) / height) * math.tan(hfov / 2) * height / width
    grid = np.stack(np.broadcast_arrays(1.0, -x[None, :], y[:, None]), axis=-1)
    return grid / np.linalg.norm(grid, axis=-1, keepdims=True)


def sees_sphere(directions, center, radius):
    """Return where rays from the origin meet a sphere, and the distance from its silhouette."""
    along = directions @ center
    distance = np.sqrt(np.maximum(center @ center - along**2, 0))
    return (along > 0) & (distance < radius), np.abs(distance - radius)


@pytest.mark.parametrize(("width", "height", "hfov"), [(80, 60, 1.047), (33, 64, 0.4), (50, 20, 2.5)])
def test_colors_are_where_double_precision_sees_them(tmp_path, width, height, hfov):
    """The camera looks along x, with square pixels; the sky is behind all."""
    centers = {"a": (2.0, 0.1, 0.05), "b": (3.0, -0.6, -0.2)}
    content = "".join(
        solid(name, "{} {} {}".format(*center), "Sphere { radius 0.3 subdivision 5 }", color)
        for (name, center), color in zip(centers.items(), ("1 0 0", "0 1 0"), strict=True)
    )
    world = load(tmp_path, f"fieldOfView {hfov} width {width} height {height}", content)
    device = world.devices["eye"]
    assert (device.kind, device.width, device.height, device.fov) == ("camera", width, height, hfov)
    image = render_color(world, "eye")
    assert image.shape == (height, width, 3) and image.dtype == np.uint8
    red, near_red = sees_sphere(rays(width, height, hfov), np.array(centers["a"]), 0.3)
    green, near_green = sees_sphere(rays(width, height, hfov), np.array(centers["b"]), 0.3)
    expected = np.where(red[..., None], RED, np.where(green[..., None], GREEN, BLUE))
    clear = (near_red > 0.003) & (near_green > 0.003)  # spheres of Webots are icosahedra, subdivided
    assert red.any() and clear.mean() > 0.9
    np.testing.assert_array_equal(image[clear], expected[clear])
    # Depth of the same device, and the agent that the robot becomes with this camera.
    depth = render_range(world, "eye")
    np.testing.assert_array_equal(np.isfinite(depth), (image != BLUE).any(axis=-1))
    agent = robot_agent(world, "eye")
    views = wv.render(world.scene, agent.camera, agent.poses, outputs="color", cull_backfaces=True)
    np.testing.assert_array_equal(views.color.numpy()[0], image)


def test_samples_of_cameras(tmp_path):
    content = solid("a", "2 0.1 0.05", "Sphere { radius 0.3 subdivision 5 }", "1 0 0")
    world = load(tmp_path, "fieldOfView 0.6 width 40 height 30", content)
    plain, smooth = render_color(world, "eye"), render_color(world, "eye", samples=4)
    edges = (plain != smooth).any(axis=-1)
    assert 10 < edges.sum() < 200 and (smooth[edges] != RED).any(axis=-1).all() and (smooth[edges] != BLUE).any()
    bent = load(tmp_path, "fieldOfView 0.6 width 40 height 30 lens Lens { radialCoefficients 0.1 0 }", content)
    wide = load(tmp_path, 'fieldOfView 2 width 40 height 30 projection "spherical"', content)
    for other, kind in ((bent, "distorted by a lens"), (wide, "spherical")):
        with pytest.raises(wv.WarpvisError, match=f"samples must be 1 for 'eye', whose image is {kind}, got 4"):
            render_color(other, "eye", samples=4)


@pytest.mark.parametrize("version", ["R2023b", "R2021b"])
def test_axes_by_version(tmp_path, version):
    """A camera looks along x from R2022a on, and along -z before, with y up."""
    ahead, left, up = ("2 0 0", "2 0.5 0", "2 0 0.5") if version == "R2023b" else ("0 0 -2", "-0.5 0 -2", "0 0.5 -2")
    cubes = zip(("ahead", "left", "up"), (ahead, left, up), ("1 0 0", "0 1 0", "1 1 0"), strict=True)
    content = "".join(solid(name, place, "Box { size 0.2 0.2 0.2 }", color) for name, place, color in cubes)
    image = render_color(load(tmp_path, "width 41 height 41 fieldOfView 1", content, version), "eye")
    assert tuple(image[20, 20]) == RED
    assert tuple(image[20, 9]) == GREEN and tuple(image[9, 20]) == YELLOW
    assert tuple(image[20, 31]) == tuple(image[31, 20]) == BLUE


def test_near_cuts_away_and_far_ends(tmp_path):
    content = solid("a", "1 0 0", "Box { size 0.02 9 9 }") + solid("b", "5 0 0", "Box { size 0.02 9 9 }", "0 1 0")
    for fields, color in (
        ("", RED),
        ("near 1.5", GREEN),
        ("near 1.5 far 4", BLUE),
        ("far 0.5", BLUE),
        ("near 0.995", RED),  # the back of the first box is culled, but its front is at 0.99
    ):
        image = render_color(load(tmp_path, f"fieldOfView 0.5 {fields}", content), "eye")
        expected = GREEN if fields == "near 0.995" else color
        assert (image == expected).all(), fields


def test_housing_of_the_camera_is_not_seen_from_inside(tmp_path):
    content = solid("a", "2 0 0", "Box { size 0.1 9 9 }")
    world = load(tmp_path, "", content, extra=shape("Box { size 0.3 0.3 0.3 }", "0 1 0"))
    assert (render_color(world, "eye") == RED).all()
    bumper = f"Pose {{ translation 1 0 0 children {shape('Box { size 0.1 9 9 }', '0 1 0')} }}"
    world = load(tmp_path, "", content, extra=bumper)
    assert (render_color(world, "eye") == GREEN).all()
    assert (render_color(world, "eye", exclude_body=True) == RED).all()


@pytest.mark.parametrize("fields", ['projection "cylindrical"', "spherical TRUE"])
def test_cylindrical_images_see_all_around(tmp_path, fields):
    """Columns are azimuths from left to right; a whole turn begins and ends behind the camera."""
    content = solid("ahead", "2 0 0", "Sphere { radius 0.4 subdivision 4 }")
    content += solid("left", "0 2 0", "Sphere { radius 0.4 subdivision 4 }", "0 1 0")
    content += solid("back", "-2 0 0", "Sphere { radius 0.4 subdivision 4 }", "1 1 0")
    world = load(tmp_path, f"{fields} fieldOfView 6.283185 width 64 height 16", content)
    image = render_color(world, "eye")
    middle = [tuple(image[8, column]) for column in (32, 16, 0, 63, 48)]
    assert middle == [RED, GREEN, YELLOW, YELLOW, BLUE]
    with pytest.raises(SceneError, match="cylindrical projection"):
        _ = world.devices["eye"].camera


def test_spherical_images_are_fisheye(tmp_path):
    """A direction is at a distance from the middle of the image that is proportional to its angle from the axis."""
    angle = 0.6
    place = f"{2 * math.cos(angle)} {2 * math.sin(angle)} 0"
    content = solid("a", place, "Sphere { radius 0.1 subdivision 4 }")
    image = render_color(load(tmp_path, 'projection "spherical" fieldOfView 3 width 61 height 61', content), "eye")
    columns = np.flatnonzero((image[30] == RED).all(axis=-1))
    assert columns.mean() == pytest.approx(30 - 61 * angle / 3, abs=0.75)


def test_lens_distorts_colors_like_depth(tmp_path):
    content = solid("a", "2 0 0", "Sphere { radius 0.4 subdivision 5 }")
    lens = "lens Lens { radialCoefficients 0.3 0.1 }"
    fields = "width 64 height 48 fieldOfView 0.6"
    flat, bent = (render_color(load(tmp_path, f"{fields} {more}", content), "eye") for more in ("", lens))
    (tmp_path / "ranges.wbt").write_text(
        f'#VRML_SIM R2023b utf8\nRobot {{ children RangeFinder {{ name "eye" {fields} {lens} maxRange 9 }} }}{content}'
    )
    depth = render_range(load_webots(tmp_path / "ranges.wbt"), "eye", webots_version="header")
    seen = np.isfinite(depth) & (depth > 0)
    np.testing.assert_array_equal((bent == RED).all(axis=-1), seen)
    assert (bent == RED).all(axis=-1).sum() != (flat == RED).all(axis=-1).sum()
    assert (bent[depth == 0] == 0).all()


def test_lights_and_shadows_of_the_world(tmp_path):
    content = 'Solid { name "floor" translation 2 0 -1 children Shape { appearance PBRAppearance { roughness 1 '
    content += "metalness 0 } geometry Box { size 4 4 0.02 } } }\n" + solid(
        "roof", "3.2 0 1", "Box { size 0.6 0.6 0.1 }"
    )
    sun, dark = "DirectionalLight { direction 0 0 -1 castShadows %s }\n", "DirectionalLight { direction 0 0 1 }\n"
    lit, shadowed, unlit = (
        render_color(
            load(tmp_path, "translation -1 0 0.5 width 64 height 64", light + content, sky="Background { }"), "eye"
        ).astype(int)
        for light in (sun % "FALSE", sun % "TRUE", dark)
    )
    assert lit[-1, 32].min() > 50 and not unlit[-1, 32].any()
    is_floor = (lit == lit[-1, 32]).all(axis=-1)
    in_shadow = is_floor & (shadowed < lit).all(axis=-1)
    assert 0.05 < in_shadow.sum() / is_floor.sum() < 0.5 and not shadowed[in_shadow].any()
    np.testing.assert_array_equal(shadowed[~in_shadow], lit[~in_shadow])


def test_ignored_fields_are_named(tmp_path):
    content = solid("a", "2 0 0", "Box { size 0.1 9 9 }")
    fields = 'noise 0.04 motionBlur 50 antiAliasing TRUE exposure 2 noiseMaskUrl "mask.png" lensFlare LensFlare { }'
    world = load(tmp_path, fields, content)
    names = ("noise", "motionBlur", "exposure", "antiAliasing", "noiseMaskUrl", "lensFlare")
    assert world.devices["eye"].ignored == names
    with recorded_warnings() as caught:
        image = render_color(world, "eye")
    (warning,) = caught
    assert str(warning.message) == f"'eye': {', '.join(names)} of Camera have no effect on colors"
    assert warning.filename == __file__ and (image == RED).all()
    neutral = load(tmp_path, "noise 0 motionBlur 0 bloomThreshold -1 exposure 1 antiAliasing FALSE", content)
    assert neutral.devices["eye"].ignored == ()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        render_color(neutral, "eye")


def test_command_line_renders_cameras(tmp_path, monkeypatch, capsys):
    load(tmp_path, "width 8 height 6", solid("a", "2 0 0", "Box { size 0.1 9 9 }"))
    monkeypatch.setattr("sys.argv", ["warpvis", "render", str(tmp_path / "world.wbt"), "--out", str(tmp_path / "out")])
    main()
    assert "color/000000.png" in capsys.readouterr().out
    np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / "out/eye/color/000000.png")), [[RED] * 8] * 6)
    assert not (tmp_path / "out/eye/depth.npz").exists()


def test_range_finders_have_no_colors(tmp_path):
    (tmp_path / "a.wbt").write_text(
        '#VRML_SIM R2023b utf8\nRobot { children RangeFinder { name "eye" } }' + solid("a", "2 0 0", "Sphere { }")
    )
    world = load_webots(tmp_path / "a.wbt")
    with pytest.raises(SceneError, match="'eye' is a range finder, which has no colors: use render_range"):
        render_color(world, "eye")
    with pytest.raises(SceneError, match="the world has no device 'ear'; it has 'eye'"):
        render_color(world, "ear")
