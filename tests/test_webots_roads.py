# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of roads of Webots worlds whose PROTO files are not available."""

import warnings

import numpy as np
import pytest

from warpvis import Label
from warpvis.scene.materials import linear_color
from warpvis.webots import load_webots
from warpvis.webots.protos._library import FINISHES


@pytest.fixture(autouse=True)
def no_webots(monkeypatch, tmp_path):
    """Hide an installation of Webots and its cache."""
    monkeypatch.delenv("WEBOTS_HOME", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def load(tmp_path, text, version="R2023b"):
    path = tmp_path / "a.wbt"
    path.write_text(f"#VRML_SIM {version} utf8\nSolid {{ children Shape {{ geometry Box {{ }} }} }}\n{text}\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return load_webots(path)


def normals(item):
    corners = item.vertices[item.faces]
    return np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])


@pytest.mark.parametrize(("version", "axes"), [("R2023b", (0, 1, 2)), ("R2021b", (2, 0, 1))])
def test_straight_road(tmp_path, version, axes):
    """It begins at the origin, and its sidewalks are outside of its width and 0.15 m high."""
    text = "StraightRoadSegment { length 20 width 6 startingRoadBorderWidth 1 endingRoadBorderWidth 1 }"
    road = load(tmp_path, text, version).scene["road"]
    low, high = (row[list(axes)] for row in road.bounds)
    np.testing.assert_allclose((low, high), ((0, -4, 0), (20, 4, 0.15)), atol=1e-6)
    assert road.label == Label.GROUND
    up, across = normals(road)[:, axes[2]], normals(road)[:, axes[1]]
    assert (up >= -1e-9).all() and up.sum() / 2 == pytest.approx(20 * 8, rel=1e-5)
    # The inner sides of the sidewalks face the road, and the outer ones away from it.
    assert np.abs(across).sum() / 2 == pytest.approx(4 * 20 * 0.15, rel=1e-4) and across.sum() == pytest.approx(0)
    colors = [tuple(item.base_color[:3]) for item in road.appearance.materials]
    assert colors[0] == pytest.approx(linear_color(FINISHES["Asphalt"].color), abs=1e-6)
    assert colors[1] == pytest.approx(linear_color(FINISHES["Pavement"].color), abs=1e-6)


def test_curved_road(tmp_path):
    text = "CurvedRoadSegment { curvatureRadius 20 width 4 rightBorder FALSE leftBorder FALSE subdivision 64 }"
    road = load(tmp_path, text).scene["road"]
    np.testing.assert_allclose(road.bounds, ((0, 0, 0), (22, 22, 0)), atol=1e-3)
    radii = np.linalg.norm(road.vertices[:, :2], axis=1)
    assert set(np.round(radii, 4)) == {18, 22}
    assert (normals(road)[:, 2] > 0).all()
    assert normals(road)[:, 2].sum() / 2 == pytest.approx(np.pi / 4 * (22**2 - 18**2), rel=1e-3)


def test_free_road_and_crossroad(tmp_path):
    text = 'Road { wayPoints [ 0 0 0 10 0 0 10 10 1 ] width 2 rightBorder FALSE roadBorderWidth [ 0.5 ] name "r" }'
    text += " Crossroad { translation 0 0 3 shape [ 0 0 0 4 0 0 4 2 0 0 2 0 ] }"
    scene = load(tmp_path, text).scene
    assert scene["r"].bounds[1, 2] == pytest.approx(1.15) and scene["r"].bounds[0, 1] == pytest.approx(-1)
    np.testing.assert_allclose(scene["crossroad"].bounds, ((0, 0, 3), (4, 2, 3)))
    assert normals(scene["crossroad"])[:, 2].sum() / 2 == pytest.approx(8)
    assert scene["crossroad"].label == Label.GROUND


def test_road_intersection(tmp_path):
    road = load(tmp_path, "RoadIntersection { roadsWidth 6 startRoadsLength [ 5 2 ] }").scene["road"]
    np.testing.assert_allclose(road.bounds, ((-5, -5, 0), (8, 5, 0)))
    assert load(tmp_path, "RoadIntersection { roadNumber 3 }").skipped == {"RoadIntersection": 1}


@pytest.mark.parametrize("text", ["Road { wayPoints [ 1 2 ] }", "Crossroad { shape [ ] }", 'Road { width "x" }'])
def test_roads_without_a_surface_are_skipped(tmp_path, text):
    assert load(tmp_path, text).skipped == {text.split()[0]: 1}
