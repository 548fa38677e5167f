# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of devices of Webots worlds: axes, fields and their corrections, range images by version, and recognition."""

import dataclasses
import math
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import warpvis as wv
from warpvis.cli import main
from warpvis.errors import FileFormatError, IntrinsicsWarning, SceneError
from warpvis.webots import load_webots, recognize, render_range, segmentation_image

from support.recorded_warnings import recorded_warnings

WORLDS = Path(__file__).parent.parent / "scenes" / "webots"
SHARED = Path(__file__).parent.parent.parent / "shared" / "webots"
needs_shared = pytest.mark.skipif(not SHARED.is_dir(), reason="no ../shared/webots here")

FINDER = 'name "eye" fieldOfView 1.5707963267948966 width 4 height 4 maxRange 3'


def load_text(tmp_path, text, version="R2023b", **options):
    path = tmp_path / "world.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\n{text}")
    return load_webots(path, **options)


def quiet(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_webots(path, **options)


def wall(x, size="0.1 9 9", fields=""):
    return f"Solid {{ translation {x} 0 0 {fields} children Shape {{ geometry Box {{ size {size} }} }} }}"


def finder(fields=FINDER, kind="RangeFinder", extra=""):
    return f'Robot {{ name "car" children [ {kind} {{ {fields} }} {extra} ] }}'


def device_of(tmp_path, fields, version="R2023b", kind="RangeFinder"):
    return quiet_text(tmp_path, finder(fields, kind) + wall(2), version).devices["eye"]


def quiet_text(tmp_path, *arguments, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_text(tmp_path, *arguments, **options)


def directions(device):
    """Return the directions of image right, image down and forward in the world."""
    return np.rint(wv.core.poses.poses_to_matrices(device.pose)[:3, :3] * 1000).T / 1000


# ---------------------------------------------------------------------------------------------------------- reading


def test_cameras_look_along_x_or_minus_z_by_version(tmp_path):
    new, old = (device_of(tmp_path, 'name "eye" translation 1 2 3', version) for version in ("R2022a", "R2021b"))
    np.testing.assert_array_equal(directions(new), [(0, -1, 0), (0, 0, -1), (1, 0, 0)])
    np.testing.assert_array_equal(directions(old), [(1, 0, 0), (0, -1, 0), (0, 0, -1)])
    np.testing.assert_allclose(new.pose[:3], [1, 2, 3])
    np.testing.assert_allclose(old.pose[:3], [1, 2, 3])


def test_poses_include_scales(tmp_path):
    text = (
        'Transform { scale 2 3 4 rotation 0 0 1 1.5707963267948966 translation 1 0 0 children RangeFinder { name "eye" '
        "translation 1 1 1 rotation 0 0 1 1.5707963267948966 } }"
    )
    device = load_text(tmp_path, text + wall(2)).devices["eye"]
    np.testing.assert_allclose(device.pose[:3], [1 - 3, 2, 4], atol=1e-12)
    np.testing.assert_array_equal(directions(device)[2], [-1, 0, 0])
    assert device.robot == ""


def test_defaults_of_a_range_finder(tmp_path):
    device = load_text(tmp_path, "Robot { children RangeFinder { } }" + wall(2)).devices["range-finder"]
    assert (device.robot, device.kind, device.measures) == ("robot", "range-finder", True)
    assert (device.width, device.height, device.fov) == (64, 64, 0.785398)
    assert (device.near, device.min_range, device.max_range) == (0.01, 0.01, 1.0)
    assert (device.projection, device.noise, device.resolution) == ("planar", 0.0, -1.0)
    assert device.lens is None and device.recognition is None and device.notes == ()
    assert device.camera == wv.Camera.from_fov(64, 64, hfov=0.785398, near=0.01, far=1.0)


def test_defaults_of_a_camera(tmp_path):
    device = load_text(tmp_path, "Camera { }" + wall(2)).devices["camera"]
    assert (device.kind, device.measures, device.near, device.max_range) == ("camera", False, 0.01, math.inf)
    assert device_of(tmp_path, 'name "eye" far 7', kind="Camera").max_range == 7


def test_pixels_are_square(tmp_path):
    """The manual of 2018 gives vfov = fov * height / width, but its code agrees with later ones."""
    camera = device_of(tmp_path, 'name "eye" fieldOfView 0.994837 width 320 height 240', "R2019a").camera
    assert camera.fx == camera.fy == pytest.approx(294.684, abs=1e-3)
    assert camera.vfov == pytest.approx(0.773424, abs=1e-6)


def test_all_fields_are_read(tmp_path):
    fields = (
        'name "eye" noise 0.02 resolution 0.1 near 0.05 minRange 0.2 maxRange 8 '
        "lens Lens { center 0.4 0.6 radialCoefficients 0.1 0.2 tangentialCoefficients 0.3 0.4 }"
    )
    device = device_of(tmp_path, fields)
    assert (device.noise, device.resolution, device.near, device.min_range, device.max_range) == (
        0.02,
        0.1,
        0.05,
        0.2,
        8,
    )
    assert device.lens is not None
    assert (device.lens.center, device.lens.radial, device.lens.tangential) == ((0.4, 0.6), (0.1, 0.2), (0.3, 0.4))


def test_old_cameras_may_be_range_finders(tmp_path):
    fields = 'name "eye" type "range-finder" near 0.3 maxRange 4.5 rangeNoise 0.01 rangeResolution 0.05'
    device = device_of(tmp_path, fields, "V7.2.5", kind="Camera")
    assert (device.kind, device.min_range, device.max_range) == ("range-finder", 0.3, 4.5)
    assert (device.noise, device.resolution) == (0.01, 0.05)


@pytest.mark.parametrize(
    ("fields", "attribute", "value"),
    [
        ("near -1", "near", 0.01),
        ("near 0.5 minRange 0.2", "near", 0.2),
        ("minRange 0 near 0.02", "min_range", 0.02),
        ("maxRange 0.5 minRange 0.5", "max_range", 1.5),
        ("resolution 0", "resolution", -1.0),
        ("fieldOfView 3.5", "fov", 0.785398),
        ('fieldOfView -1 projection "cylindrical"', "fov", 0.785398),
        ('fieldOfView 7 projection "cylindrical"', "fov", 2 * math.pi),
    ],
)
def test_corrections_are_reported(tmp_path, fields, attribute, value):
    text = finder(f'name "eye" {fields}') + wall(2)
    with pytest.warns(
        UserWarning, match=rf"world.wbt:2: {fields.split()[0] if attribute != 'max_range' else 'maxRange'}"
    ):
        world = load_text(tmp_path, text)
    device = world.devices["eye"]
    assert getattr(device, attribute) == value
    assert len(device.notes) == 1 and world.notes == device.notes


@pytest.mark.parametrize(
    ("fields", "projection"),
    [
        ("", "planar"),
        ("spherical TRUE", "cylindrical"),
        ("spherical FALSE", "planar"),
        ('projection "spherical"', "spherical"),
        ('projection "cylindrical" fieldOfView 6.28', "cylindrical"),
    ],
)
def test_projections(tmp_path, fields, projection):
    device = device_of(tmp_path, f'name "eye" {fields}')
    assert device.projection == projection
    if projection != "planar":
        with pytest.raises(SceneError, match=rf"'eye' has a {projection} projection"):
            _ = device.camera


def test_equal_names_are_numbered(tmp_path):
    world = load_text(tmp_path, finder() + finder(kind="Camera", fields='name "eye"') + wall(2))
    assert [(name, item.name, item.robot) for name, item in world.devices.items()] == [
        ("eye", "eye", "car"),
        ("eye (2)", "eye", "car (2)"),
    ]


@pytest.mark.parametrize(
    ("version", "at", "apart"), [("R2023b", (1.0127, 0, 0.05), 0), ("R2021b", (1 - 0.0127, 0.05, 0), 0.0254)]
)
def test_kinect_without_proto_file(tmp_path, version, at, apart):
    kinect = 'Kinect { translation 1 0 0 width 150 height 100 maxRange 4 cameraName "k" }'
    world = load_text(tmp_path, f"Robot {{ children {kinect} }}" + wall(3), version)
    ranges, colors = world.devices["k range"], world.devices["k color"]
    assert (ranges.kind, colors.kind) == ("kinect", "camera")
    assert (ranges.width, ranges.height, ranges.fov, ranges.max_range) == (150, 100, 1.0, 4.0)
    np.testing.assert_allclose(ranges.pose[:3], at, atol=1e-5)
    assert np.linalg.norm(ranges.pose[:3] - colors.pose[:3]) == pytest.approx(apart)
    assert world.robots["robot"] == ("Kinect",)
    # It does not see its own housing, which encloses it.
    depth = render_range(world, "k range")
    assert (depth[np.isfinite(depth)] > 0.5).all()


def test_kinect_in_a_slot_of_an_unknown_robot(tmp_path):
    text = 'Rover { translation 1 2 0 controller "x" extensionSlot [ Kinect { translation 0 0 1 } ] }' + wall(3)
    with recorded_warnings() as caught:
        world = load_text(tmp_path, text)
    messages = [str(warning.message) for warning in caught]
    assert "skipped Rover (1 with 1 node in it)" in messages[0]
    assert "'kinect range' is assumed to be at the origin of Rover" in messages[1]
    device = world.devices["kinect range"]
    assert device.robot == "Rover" and world.robots == {"Rover": ()} and len(world.scene) == 1
    np.testing.assert_allclose(device.pose[:3], [1.0127, 2, 1.05], atol=1e-5)


def test_astra_without_proto_file(tmp_path):
    device = load_text(tmp_path, "Robot { children Astra { } }" + wall(3)).devices["Astra depth"]
    assert (device.width, device.height, device.fov, device.min_range, device.max_range) == (640, 480, 1.04, 0.6, 8.0)


# ----------------------------------------------------------------------------------------------------- range images


def test_exact_depth_by_default(tmp_path):
    world = load_text(tmp_path, finder(FINDER + " minRange 1") + wall(2.05))
    np.testing.assert_allclose(render_range(world, "eye"), 2.0, atol=1e-6)
    near = load_text(tmp_path, finder(FINDER + " minRange 1") + wall(0.55) + wall(2.05))
    assert np.isneginf(render_range(near, "eye")).all()
    far = load_text(tmp_path, finder(FINDER + " minRange 1") + wall(4))
    assert np.isposinf(render_range(far, "eye")).all()


@pytest.mark.parametrize(
    ("version", "near", "middle", "far"),
    [
        ("R2019a", 3.0, 3 * 1.99 / 2.99, 3.0),
        ("R2020b", 3.0, 3 * 1.99 / 2.99, 3.0),
        ("R2021b", np.inf, 3 * 1.99 / 2.99, 3.0),
        ("R2022a", np.inf, 2.0, np.inf),
        ("R2025a", np.inf, 2.0, np.inf),
    ],
)
def test_range_values_by_version(tmp_path, version, near, middle, far):
    """Walls too near, in range, and too far; `webots_version` decides, not the header."""
    for text, wanted in ((wall(0.55) + wall(2.05), near), (wall(2.05), middle), (wall(9), far)):
        world = load_text(tmp_path, finder(FINDER + " minRange 1") + text)
        image = render_range(world, "eye", webots_version=version)
        assert image.dtype == np.float32 and image.shape == (4, 4)
        np.testing.assert_allclose(image, wanted, atol=1e-6)
    np.testing.assert_array_equal(
        render_range(world, "eye", webots_version="header"), render_range(world, "eye", webots_version="R2023b")
    )


def test_surfaces_before_the_near_plane_are_clipped_in_webots(tmp_path):
    text = finder(FINDER + " near 0.5 minRange 1 resolution -1") + wall(0.3, "0.1 0.3 9") + wall(2.05)
    world = load_text(tmp_path, text)
    assert np.isneginf(render_range(world, "eye")[:, 1:3]).any()
    np.testing.assert_allclose(render_range(world, "eye", webots_version="header"), 2.0, atol=1e-6)
    # A slanted wall is clipped by the near plane: the rest of it is too near, or occludes.
    slanted = "Solid { rotation 0 1 0 0.5 children Shape { geometry Box { size 0.02 9 9 } } translation 0.5 0 0 }"
    world = load_text(tmp_path, finder(FINDER + " near 0.5 minRange 0.5 width 8 height 8") + slanted + wall(2.05))
    true, drawn = render_range(world, "eye"), render_range(world, "eye", webots_version="header")
    cut = np.isneginf(true)
    assert 8 < cut.sum() < 56
    np.testing.assert_allclose(drawn[~cut], true[~cut], atol=1e-5)
    np.testing.assert_allclose(drawn[cut], 2.0, atol=1e-5)


def test_clipped_wall_leaves_an_empty_image(tmp_path):
    world = load_text(tmp_path, finder(FINDER + " near 0.9 minRange 0.9") + wall(0.3))
    assert np.isposinf(render_range(world, "eye", webots_version="header")).all()


def test_back_faces_are_culled(tmp_path):
    inside = "Solid { children Shape { geometry Box { size 1 1 1 } } }"
    world = load_text(tmp_path, finder() + inside + wall(2.05))
    np.testing.assert_allclose(render_range(world, "eye"), 2.0, atol=1e-6)
    plane = "Solid { translation 1 0 0 rotation 0 1 0 %s children Shape { geometry Plane { size 9 9 } } }"
    facing, turned = (load_text(tmp_path, finder() + plane % angle + wall(2.05)) for angle in (-1.5707963, 1.5707963))
    np.testing.assert_allclose(render_range(facing, "eye"), 1.0, atol=1e-5)
    np.testing.assert_allclose(render_range(turned, "eye"), 2.0, atol=1e-6)


def test_exclude_body_removes_the_robot(tmp_path):
    body = "Solid { translation 0.5 0 0 children Shape { geometry Box { size 0.1 9 9 } } }"
    world = load_text(tmp_path, finder(extra=body) + wall(2.05))
    np.testing.assert_allclose(render_range(world, "eye"), 0.45, atol=1e-6)
    np.testing.assert_allclose(render_range(world, "eye", exclude_body=True), 2.0, atol=1e-6)
    for version in ("header", None):
        image = render_range(world, "eye", exclude_body=True, webots_version=version)
        np.testing.assert_allclose(image, 2.0, atol=1e-6)


def test_resolution_and_noise(tmp_path):
    world = load_text(tmp_path, finder(FINDER + " width 64 height 64 resolution 0.3 noise 0.1") + wall(2.05))
    np.testing.assert_allclose(render_range(world, "eye"), 2.0, atol=1e-6)
    np.testing.assert_allclose(render_range(world, "eye", webots_version="header"), 2.1, atol=1e-6)
    noisy = render_range(world, "eye", webots_version="header", seed=3)
    np.testing.assert_array_equal(noisy, render_range(world, "eye", webots_version="header", seed=3))
    assert 0.08 < (noisy - 2.0).std() < 0.16
    np.testing.assert_allclose(noisy / 0.3, np.rint(noisy / 0.3), atol=1e-4)


def test_lens_distorts_the_image(tmp_path):
    lens = " width 32 height 32 lens Lens { radialCoefficients 0.5 0 }"
    post = wall(2.05, "0.1 2.6 9")
    straight, bent = (load_text(tmp_path, finder(FINDER + fields) + post) for fields in (" width 32 height 32", lens))
    with pytest.warns(IntrinsicsWarning, match="'eye' has a Lens, which exact depth ignores; pass webots_version"):
        true = render_range(bent, "eye")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert true.tolist() == render_range(straight, "eye").tolist()
        image = render_range(bent, "eye", webots_version="header")
    rows = np.isfinite(image) & (image > 0)
    assert len({tuple(row) for row in rows.tolist()}) > 1  # undistorted, all rows are equal
    np.testing.assert_allclose(image[rows], 2.0, atol=1e-6)


def test_files_of_distorted_images_have_no_pinhole_matrix(tmp_path, monkeypatch):
    world = tmp_path / "world.wbt"
    fields = FINDER + " width 32 height 32 lens Lens { center 0.4 0.6 radialCoefficients 0.5 0.1 }"
    world.write_text("#VRML_SIM R2023b utf8\n" + finder(fields) + wall(2.05))
    for out, options in (("true", ()), ("bent", ("--version-exact",))):
        monkeypatch.setattr(sys, "argv", ["warpvis", "render", str(world), "--out", str(tmp_path / out), *options])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", IntrinsicsWarning)
            main()
    true, bent = (dict(np.load(tmp_path / out / "eye" / "depth.npz")) for out in ("true", "bent"))
    assert "K" in true and "lens" not in true and "K" not in bent
    np.testing.assert_array_equal(bent["lens"], [[0.4, 0.6], [0.5, 0.1], [0, 0]])
    assert bent["hfov"] > 0


@pytest.mark.parametrize("projection", ["cylindrical", "spherical"])
def test_wide_images_contain_distances(tmp_path, projection):
    fields = f'name "eye" projection "{projection}" fieldOfView 3 width 31 height 31 maxRange 9'
    world = load_text(tmp_path, finder(fields) + wall(2.05))
    for version in (None, "header"):
        image = render_range(world, "eye", webots_version=version)
        assert image[15, 15] == pytest.approx(2.0, abs=1e-6)
        assert image[15, 20] == pytest.approx(2.0 / math.cos(5 * 3 / 31), abs=1e-5)


def test_images_are_equal_on_every_device(device):
    world = load_webots(WORLDS / "experiment_3_R2023b.wbt", device=device)
    again = load_webots(WORLDS / "experiment_3_R2023b.wbt")
    for version in (None, "header"):
        one, other = (render_range(item, "range-finder", webots_version=version) for item in (world, again))
        np.testing.assert_allclose(one, other, atol=1e-5)


# ------------------------------------------------------------------------------------------------------ recognition

CAMERA = 'name "eye" width 80 height 60 fieldOfView 1 recognition Recognition { %s }'


def ball(x, y, name, radius=0.1):
    return (
        f'Solid {{ translation {x} {y} 0 name "{name}" recognitionColors [ 1 0 0, 0 1 0 ] '
        f"children Shape {{ geometry Sphere {{ radius {radius} }} }} }}"
    )


def recognized(tmp_path, fields, text, version="R2023b"):
    return [
        item.name for item in recognize(load_text(tmp_path, finder(CAMERA % fields, "Camera") + text, version), "eye")
    ]


def test_recognition_in_the_paper_experiment(device):
    world = load_webots(WORLDS / "experiment_3_R2023b.wbt", device=device)
    (found,) = recognize(world, "camera")  # the person is behind the high obstacle
    assert (found.name, found.objects) == ("ball", ("ball",))
    eye = world.devices["camera"]
    np.testing.assert_allclose(found.colors, [[0.9, 0.2, 0.2]])
    x, y = eye.camera.project(found.position)
    left, top, width, height = found.box
    assert left < x < left + width and top < y < top + height
    assert 0.6 * width * height < found.visible_pixels < width * height
    seen = segmentation_image(world, "camera")
    assert set(np.unique(seen)) == {-1, world.scene.index("ball")}
    assert (seen >= 0).sum() == found.visible_pixels


def test_only_visible_solids_with_colors_are_recognized(tmp_path):
    text = ball(2, 0.3, "left") + ball(2, 5, "outside") + ball(-2, 0, "behind") + wall(4)
    assert recognized(tmp_path, "", text) == ["left"]


def test_recognition_range(tmp_path):
    text = ball(2, 0.3, "near") + ball(3, -0.3, "far")
    assert recognized(tmp_path, "", text) == ["near", "far"]
    assert recognized(tmp_path, "maxRange 2.5", text) == ["near"]


def test_largest_objects_are_recognized(tmp_path):
    text = ball(2, 0.5, "small", 0.05) + ball(2, 0, "large", 0.2) + ball(2, -0.5, "middle", 0.1)
    assert recognized(tmp_path, "", text) == ["large", "middle", "small"]
    assert recognized(tmp_path, "maxObjects 2", text) == ["large", "middle"]
    with pytest.warns(UserWarning, match="maxObjects 0 of Recognition is replaced by -1"):
        assert recognized(tmp_path, "maxObjects 0", text) == ["large", "middle", "small"]


def test_occlusion_modes(tmp_path):
    """One ball is visible; one is partly hidden, at its center; one is fully hidden."""
    text = ball(2, 0.6, "seen", 0.12) + ball(2, 0, "half", 0.11) + ball(2, -0.6, "hidden", 0.1)
    for y, width in ((0, 0.05), (-0.3, 0.2)):
        box = f"Box {{ size 0.02 {width} 9 }}"
        text += f"Solid {{ translation 1 {y} 0 children Shape {{ geometry {box} }} boundingObject {box} }}"
    assert recognized(tmp_path, "occlusion 0", text) == ["seen", "half", "hidden"]
    assert recognized(tmp_path, "occlusion 1", text) == ["seen"]
    assert recognized(tmp_path, "", text) == ["seen"]
    assert recognized(tmp_path, "occlusion 2", text) == ["seen", "half"]


def test_occlusion_was_a_flag_in_old_versions(tmp_path):
    text = "Solid { translation 0 0 -1 boundingObject Box { size 9 9 0.02 } }"
    text += (
        'Solid { translation 0 0 -2 name "ball" recognitionColors 1 0 0 '
        "children Shape { geometry Sphere { radius 0.1 } } }"
    )
    assert recognized(tmp_path, "occlusion FALSE", text, "R2019a") == ["ball"]
    assert recognized(tmp_path, "occlusion TRUE", text, "R2019a") == []


def test_child_solids_belong_to_the_recognized_solid(tmp_path):
    hat = 'Solid { translation 0 0 0.2 name "hat" children Shape { geometry Box { size 0.1 0.1 0.1 } } }'
    text = (
        'Solid { translation 2 0 0 name "doll" recognitionColors 1 0 0 '
        f"children [ Shape {{ geometry Sphere {{ radius 0.1 }} }} {hat} ] }}"
    )
    world = load_text(tmp_path, finder(CAMERA % "", "Camera") + text)
    (found,) = recognize(world, "eye")
    assert (found.name, found.objects) == ("doll", ("doll", "hat"))
    assert found.box[3] > 1.5 * found.box[2]


# ----------------------------------------------------------------------------------------------------------- errors

BAD = {
    "no device": (lambda tmp: render_range(plain(tmp), "ear"), "the world has no device 'ear'; it has 'eye'"),
    "no version": (lambda tmp: render_range(plain(tmp), "eye", webots_version="new"), "expected a Webots version"),
    "values of a camera": (
        lambda tmp: render_range(plain(tmp, "Camera"), "eye", webots_version="header"),
        "'eye' is a camera, which has no ranges in Webots: omit webots_version",
    ),
    "recognition of a range finder": (
        lambda tmp: recognize(plain(tmp), "eye"),
        "'eye' must be a Camera with a Recognition node, got a range-finder without",
    ),
    "segmentation without": (lambda tmp: segmentation_image(plain(tmp, "Camera"), "eye"), "with a Recognition node"),
    "no width": (lambda tmp: strict(tmp, 'name "eye" width 0'), "width 0 of RangeFinder is replaced by 1"),
    "half a width": (lambda tmp: strict(tmp, 'name "eye" width 1.5'), "expected a whole number in 'width'"),
    "projection": (
        lambda tmp: strict(tmp, 'name "eye" projection "flat"'),
        "projection flat of RangeFinder is replaced by planar",
    ),
    "name of numbers": (lambda tmp: strict(tmp, "name 1"), "expected a string in 'name' of RangeFinder"),
}


def strict(tmp_path, fields):
    return load_text(tmp_path, finder(fields) + wall(2), strict=True)


def plain(tmp_path, kind="RangeFinder"):
    return load_text(tmp_path, finder('name "eye"', kind) + wall(2))


@pytest.mark.parametrize("case", BAD)
def test_invalid_input_raises_one_line_message(case, tmp_path):
    act, message = BAD[case]
    with pytest.raises((FileFormatError, SceneError), match=message) as caught:
        act(tmp_path)
    assert "\n" not in str(caught.value)


# --------------------------------------------------------------------------------------------- Webots' own tests

EXPECTED = {
    "test_range_finder_R2023b": {(32, 0): np.inf, (0, 32): np.inf, (32, 32): 2.0, (63, 32): 2.0, (32, 63): 2.0},
    "test_range_finder_R2022a": {(0, 32): np.inf, (32, 32): 2.0, (63, 32): 2.0, (32, 63): 2.0},
    "test_range_finder_R2019a": {(0, 32): 3.0, (32, 32): 2.0, (63, 32): 2.0, (32, 63): 2.0},
    "test_range_finder_cylindrical_R2023b": {
        **{(0, 64): 2.0, (64, 64): np.inf, (128, 64): 2.0, (192, 64): np.inf, (255, 64): 2.0}
    },
}


@needs_shared
@pytest.mark.parametrize("name", EXPECTED)
def test_pixels_match_webots_own_tests(name):
    world = quiet(SHARED / f"{name}.wbt")
    image = render_range(world, "range-finder", webots_version="header")
    for (x, y), value in EXPECTED[name].items():
        assert image[y, x] == pytest.approx(value, abs=0.015), (x, y)


@needs_shared
def test_two_versions_of_the_webots_sample_agree():
    """One scene in two axis conventions, (x, y, z) and (x, z, -y); its robots stopped at different poses."""
    new, old = (quiet(SHARED / f"sample_range_finder_{version}.wbt") for version in ("R2023b", "R2019a"))
    turn = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # old to new
    for name, device in (("new", new.devices["range-finder"]), ("old", old.devices["range-finder"])):
        matrix = wv.core.poses.poses_to_matrices(device.pose)
        there = np.eye(4)
        there[:3] = (turn.T if name == "new" else turn) @ matrix[:3]
        poses = {"new": (matrix, there), "old": (there, matrix)}[name]
        images = []
        for world, pose in zip((new, old), poses, strict=True):
            moved = dataclasses.replace(device, pose=wv.core.poses.poses_to_opencv(pose)[0], robot="MyBot")
            placed = dataclasses.replace(world, devices={"eye": moved})
            images.append(render_range(placed, "eye", exclude_body=True))
        np.testing.assert_array_equal(np.isfinite(images[0]), np.isfinite(images[1]))
        np.testing.assert_allclose(images[0], images[1], atol=1e-5)
        assert 0.4 < np.isfinite(images[0]).mean() < 0.7


@needs_shared
@pytest.mark.parametrize("version", ["R2019a", "R2023b"])
def test_sample_device_sees_through_its_housing(version):
    world = quiet(SHARED / f"sample_range_finder_{version}.wbt")
    depth = render_range(world, "range-finder")
    assert (depth[np.isfinite(depth)] > 0.1).all() and np.isfinite(depth).any()
    device = world.devices["range-finder"]
    camera = dataclasses.replace(device.camera, near=0)
    assert (wv.render(world.scene, camera, device.pose).depth.numpy() < 0.02).all()  # the housing, from inside
