# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Files of all scene sources, in their own units and axes, nested and labeled, equal scenes built by hand."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

import warpvis as wv
from warpvis.scene import Y_UP_TO_Z_UP as UPRIGHT

from support import scans, source_files as files
from support.source_files import Row, rows, size


@dataclass(frozen=True)
class Source:
    """A file, and the scene built by hand that it must equal."""

    write: Callable[[Path], Path]
    rows: list[Row]
    options: dict[str, Any] = field(default_factory=dict)
    instances: tuple[str, str] | None = None  # objects that share their mesh
    movable: Any = False  # for which they do


OBJECTS = {"labels": {"floor": "ground", "left": "object", "right": "object"}}
FLAT = {"scale": 0.001, "file_up": "y", **OBJECTS}
TURNED_SCAN = {"scale": 0.5, "up": "y"}
HALVED = UPRIGHT.T @ size(0.5, 0.5, 0.5)
SIDES = ("left", "right")
MESHES = ("floor", "wedge", "wedge_1")
PARTS = {"labels": {"floor": "ground", "wedge*": "object"}}
SDF_NAMES = ("floor::l::v", "group::left::l::v", "group::right::l::v")
WORDS = ("floor", "cup", "cup")
SOURCES = {
    "URDF": Source(files.write_urdf, rows(), OBJECTS, SIDES),
    "xacro": Source(files.write_xacro, rows(), OBJECTS, SIDES),
    "MJCF": Source(files.write_mjcf, rows(), OBJECTS, SIDES),
    "USD": Source(
        files.write_usd,
        rows(UPRIGHT, ("/Room/Floor/mesh", "/Room/Group/Left/mesh", "/Room/Group/Right/mesh"), WORDS),
        {},
        ("/Room/Group/Left/mesh", "/Room/Group/Right/mesh"),
    ),
    "SDF": Source(
        files.write_sdf,
        rows(names=SDF_NAMES, categories=("floor", "group", "group")),
        {"labels": {"group::*": "object"}},
        SDF_NAMES[1:],
    ),
    "Webots": Source(files.write_webots, rows(UPRIGHT), {"up": "z"}),
    "Habitat": Source(
        files.write_habitat,
        rows(UPRIGHT, ("floor", "wedge", "wedge_1"), WORDS, turn=UPRIGHT.T),
        {},
        ("wedge", "wedge_1"),
    ),
    "glTF": Source(files.write_gltf, files.gltf_rows(), {}, SIDES),
    "OBJ": Source(files.write_obj, rows(UPRIGHT), FLAT),
    "STL": Source(files.write_stl, rows(UPRIGHT), FLAT),
    "PLY": Source(
        files.write_ply,
        [Row("room", trimesh.util.concatenate([*files.flat(1.0).values()]), UPRIGHT, "object")],
        {"scale": 0.001, "file_up": "y", "labels": {"room": "object"}},
    ),
    "3MF": Source(files.write_3mf, rows(names=MESHES), PARTS, MESHES[1:]),
    "COLLADA": Source(files.write_collada, rows(UPRIGHT, MESHES), PARTS),
    "ScanNet": Source(scans.write_scannet, files.scan_rows((0, 1, 2), HALVED), TURNED_SCAN),
    "ScanNet++": Source(scans.write_scannetpp, files.scan_rows((0, 1, 2), HALVED), TURNED_SCAN),
    "Replica": Source(scans.write_replica, files.scan_rows((3, 4, 5), HALVED), TURNED_SCAN),
    "Matterport3D": Source(scans.write_matterport, files.scan_rows((0, 1, 2), HALVED), TURNED_SCAN),
    "HM3D": Source(scans.write_hm3d, files.scan_rows((1, 2, 3), HALVED, "lamp, standing"), TURNED_SCAN),
    "BOP": Source(files.write_bop_scene, files.bop_rows(), {}, ("obj_000005", "obj_000005_1"), True),
    "GeoTIFF": Source(files.write_terrain, files.terrain_rows()),
}
EYES = [wv.look_at((2.5, -2.5, 4), (0, 0, 0)), wv.look_at((-1.5, 1.2, -2), (0, 0, 0))]
CAMERA = wv.Camera.from_fov(160, 120, hfov=1.4)


def build(rows, up):
    scene = wv.Scene(up=up)
    for row in rows:
        mesh = row.mesh.copy().apply_transform(row.matrix)
        scene.add((mesh.vertices, mesh.faces), name=row.name, label=row.label, category=row.category)
    return scene


def assert_same_triangles(found, expected):
    """Compare triangles in any order and with any first corner, without those of no area."""
    corners = [np.float64(item.vertices)[item.faces] for item in (found, expected)]
    found, expected = (
        rows[np.linalg.norm(np.cross(rows[:, 1] - rows[:, 0], rows[:, 2] - rows[:, 0]), axis=1) > 1e-9]
        for rows in corners
    )
    cycles = np.concatenate([np.roll(expected, shift, axis=1) for shift in range(3)])
    distance, match = cKDTree(cycles.reshape(-1, 9)).query(found.reshape(-1, 9), p=np.inf)
    assert distance.max() < 1e-6
    assert sorted(match % len(expected)) == list(range(len(expected)))


@pytest.mark.parametrize("name", SOURCES)
def test_equals_the_scene_built_by_hand(tmp_path, name):
    source = SOURCES[name]
    scene = wv.Scene.load(source.write(tmp_path), **source.options)
    hand = build(source.rows, scene.up)
    assert [(item.name, item.category, item.label) for item in scene] == [
        (item.name, item.category, item.label) for item in hand
    ]
    for item, expected in zip(scene, hand, strict=True):
        assert_same_triangles(item, expected)
    views, expected = (
        wv.render(one, CAMERA, EYES, outputs=["depth", "labels", "segmentation"]) for one in (scene, hand)
    )
    depth = expected.depth.numpy()
    seen = np.isfinite(depth)
    assert set(np.unique(expected.segmentation.numpy()[seen])) == set(range(len(hand)))
    np.testing.assert_array_equal(np.isfinite(views.depth.numpy()), seen)
    assert (np.abs(views.depth.numpy() - depth)[seen] <= 1e-6 * np.maximum(1, depth[seen])).all()
    for output in ("labels", "segmentation"):
        np.testing.assert_array_equal(getattr(views, output).numpy(), getattr(expected, output).numpy())


@pytest.mark.parametrize("name", [name for name, source in SOURCES.items() if source.instances])
def test_instances_share_their_mesh(tmp_path, name):
    source = SOURCES[name]
    scene = wv.Scene.load(source.write(tmp_path), movable=source.movable, **source.options)
    first, second = (scene[name] for name in source.instances)
    assert first.mesh is second.mesh
