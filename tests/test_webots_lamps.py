# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of lamps of Webots worlds whose PROTO files are not available: their lights and shapes."""

import warnings

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import FileFormatError
from warpvis.webots import load_webots
from warpvis.webots.protos._lamps import LAMPS


@pytest.fixture(autouse=True)
def no_webots(monkeypatch, tmp_path):
    """Hide an installation of Webots and its cache."""
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(tmp_path, text, version="R2023b", **options):
    path = tmp_path / "a.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\n{text}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_webots(path, **options)


@pytest.mark.parametrize(("version", "up"), [("R2023b", 2), ("R2021b", 1)])
def test_ceiling_light(tmp_path, version, up):
    place = [1.0, 2.0, 2.0]
    text = "CeilingLight { translation 1 2 2 pointLightColor 1 0.5 0 pointLightIntensity 3 pointLightRadius 7 }"
    world = load(tmp_path, text, version)
    (light,) = world.scene.lights
    place[up] -= 0.6
    assert light.kind == "point" and light.position == pytest.approx(place)
    assert light.color == pytest.approx((1, 0.21404, 0), abs=1e-5)
    assert (light.intensity, light.reach, light.attenuation) == (3, 7, (0, 0, 1)) and not light.cast_shadow
    lamp = world.scene["ceiling light"]
    bulb = lamp.appearance.materials[-1]
    assert bulb.emission == pytest.approx((3, 3 * 0.5, 0)) and bulb.base_color == (1, 1, 1, 1)
    low, high = lamp.bounds
    assert (low[up], high[up]) == pytest.approx((2 - 0.7, 2), abs=1e-3)
    assert world.stand_ins == {"CeilingLight": 1}


def test_lamps_before_r2019a(tmp_path):
    """Their light does not fall off by default, and has an ambient part, which an Appearance reflects."""
    boxes = "Shape { appearance Appearance { material Material { } } geometry Box { } }\n" * 4
    ambient, light = load(tmp_path, "CeilingLight { pointLightAmbientIntensity 0.5 }" + boxes, "R2018b").scene.lights
    assert light.attenuation == (1, 0, 0) and light.position == pytest.approx((0, 2.4 - 0.6, 0))
    assert ambient.ambient == (0.5, 0.5, 0.5)
    (light,) = load(tmp_path, "CeilingLight { pointLightAttenuation 0 1 0 }", "R2018b").scene.lights
    assert light.attenuation == (0, 1, 0)


def test_floor_light_stands_on_the_floor(tmp_path):
    world = load(tmp_path, "FloorLight { pointLightCastShadows TRUE }")
    (light,) = world.scene.lights
    low, high = world.scene["floor light"].bounds
    assert light.position == pytest.approx((0, 0, 1.5)) and not light.cast_shadow  # which the bulb would block
    assert (low[2], high[2]) == pytest.approx((0, 1.714), abs=1e-6)


@pytest.mark.parametrize(
    ("kind", "version", "direction", "cone"),
    [
        ("CeilingSpotLight", "R2022a", (0, 0, -1), (0.3, 0.48)),
        ("CeilingSpotLight", "R2021b", (0, -1, 0), (0.3, 0.48)),
        ("ConstructionLamp", "R2024a", (1, 0, 0), (0.2, 1)),
        ("ConstructionLamp", "R2021c", (0, 0, 1), (0.2, 1)),
    ],
)
def test_spots(tmp_path, kind, version, direction, cone):
    (light,) = load(tmp_path, f"{kind} {{ spotLightColor 0 1 0 }}", version).scene.lights
    assert light.kind == "spot" and light.direction == pytest.approx(direction)
    assert (light.inner_angle, light.outer_angle) == cone and light.color == (0, 1, 0)
    assert light.intensity == (2 if kind == "ConstructionLamp" else 1)


@pytest.mark.parametrize("kind", sorted(LAMPS))
def test_light_reaches_the_floor(tmp_path, kind):
    """Also with shadows, although the light is in or near its own lamp."""
    turn = "rotation 0 1 0 1.5708" if kind == "ConstructionLamp" else ""
    prefix = "point" if LAMPS[kind].kind == "Point" else "spot"
    height = 0.0 if kind == "FloorLight" else 1.5
    text = f"{kind} {{ translation 0 0 {height} {turn} {prefix}LightCastShadows %s }} Floor {{ size 4 4 }}"
    camera, pose = wv.Camera.from_fov(32, 32, hfov=0.3), wv.look_at((3, 0, 1), (0.3, 0, 0))
    images = []
    for casts in ("FALSE", "TRUE"):
        scene = load(tmp_path, text % casts).scene
        views = wv.render(scene, camera, pose, outputs=("color", "labels"))
        ground = views.labels.numpy()[0] == wv.Label.GROUND
        images.append(views.color.numpy()[0][ground].max())
    assert min(images) > 20


def test_strict_skips_no_lamp(tmp_path):
    with pytest.raises(FileFormatError, match="skipped CeilingLight"):
        load(tmp_path, "CeilingLight { } Floor { }", strict=True)


def test_light_falls_off_with_distance(tmp_path, device):
    floor = "Floor { size 4 4 appearance PBRAppearance { baseColor 0.5 0.5 0.5 metalness 0 roughness 1 } }"
    scene = load(tmp_path, f"CeilingLight {{ translation 0 0 2.6 }} {floor}", device=device).scene
    camera, pose = wv.Camera.from_fov(3, 3, hfov=0.01), wv.look_at((2, 0, 1), (0, 0, 0))
    center = wv.render(scene, camera, pose, outputs=("color",)).color.numpy()[0, 1, 1] / 255
    far = wv.render(scene, camera, wv.look_at((2, 0, 1), (0, 2, 0)), outputs=("color",)).color.numpy()[0, 1, 1] / 255
    assert np.ptp(center) < 0.02 and 0.1 < center[0] < 0.6 and far[0] < 0.7 * center[0]
