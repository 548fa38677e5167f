# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Shadows on CUDA without a GPU: blocks of an emulated warp, compared with double precision over all surfaces."""

import numpy as np
import pytest
import reference_shadows
import trimesh
from cuda_emulator import Emulator, Variant

import warpvis as wv
from warpvis.kernels.casting.packets_cuda import FoundObjects
from warpvis.kernels.shading.shadow_packets_cuda import BLOCK_HEIGHT, BLOCK_WIDTH
from warpvis.rendering import _shadows
from warpvis.scene.acceleration import traversal_plan
from warpvis.scene.acceleration.geometry import build_scene_bvh
from warpvis.scene.lights import Light

from support.shadows import LIGHTS, POSES, check, table, under_ceiling, worlds_of

pytestmark = pytest.mark.cxx
CAMERA = wv.Camera.from_fov(29, 22, hfov=0.9)  # the last blocks are incomplete
HEADERS = ("quick_volume.h", "shadow_walk.h", "shadows.h", "shafts.h", "shadow_volumes.h", "worlds.h")


@pytest.fixture(scope="module")
def emulator(tmp_path_factory):
    """Return an emulator with sanitizers and line counts."""
    return Emulator(tmp_path_factory.mktemp("cuda_shadows"))


@pytest.fixture(autouse=True)
def emulated(emulator, monkeypatch):
    """Cast shadows by the emulator, with the scene's trees of 32 lanes."""

    def cast(frame, caster, out):
        images = [frame.images[name] for name in ("points", "segmentation", "normals")]
        scene, (views, height, width) = frame.scene, images[0].shape
        names = ("points_in", "segmentation_in", "normals_in")
        arguments = dict(zip(names, images, strict=True)) | {
            "scene": build_scene_bvh(scene.objects, scene.device, lanes=32, faces=False).struct,
            "lights": frame.lights(),
            "camera_to_world": frame.poses,
            "worlds": frame.worlds,
            "found": FoundObjects(),
            "shadows_out": out,
        }
        variant = Variant(8, True, True, resized=frame.worlds.object_sizes is not None, shadows=True)
        emulator.launch(variant, (views, -(-height // BLOCK_HEIGHT), -(-width // BLOCK_WIDTH)), arguments)
        return True

    monkeypatch.setattr(_shadows, "_cast_by_warps", cast)


def references_of(scene, count=2, **options):
    return [reference_shadows.ShadowReference(scene, **options)] * count


def test_meshes_and_solids():
    scene = table("cpu")
    expected = check(scene, POSES, references_of(scene), CAMERA)
    assert 0.1 < (expected == 0).mean() < 0.9


def test_worlds_and_exclusions():
    scene = table("cpu")
    worlds, flags, references = worlds_of(scene)
    check(scene, POSES, references, CAMERA, object_poses=worlds, exclude=flags)


def test_scaled_objects():
    scene = wv.Scene(device="cpu")
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1))
    scene.add(trimesh.creation.torus(0.4, 0.1, 16, 8), name="ring", pose=(0, 0, 0, 0, 0.6, 0, 0.8), movable=True)
    scales = np.array([[[1, 1, 1]], [[1.5, 0.5, 2.0]]], dtype=np.float32)
    references = [reference_shadows.ShadowReference(scene, scales=rows) for rows in scales]
    check(scene, POSES, references, CAMERA, object_scales=scales)


def test_fine_meshes_and_instances(monkeypatch):
    """Trees of several levels, more objects than lanes, and a light whose rays end at a plane."""
    for name in ("_MIN_USES", "_MIN_SAVED", "_MIN_SAVED_CUDA"):
        monkeypatch.setattr(traversal_plan, name, 1)
    scene, rng = wv.Scene(device="cpu"), np.random.default_rng(4)
    scene.add(trimesh.creation.box((6, 6, 0.1)), name="floor", pose=(0, 0, -0.6, 0, 0, 0, 1))
    blob = trimesh.creation.icosphere(4, 0.2)
    blob.vertices *= 1 + 0.15 * np.sin(17 * blob.vertices[:, :1])
    for _ in range(34):
        scene.add(blob, pose=(*rng.uniform(-0.8, 0.8, 2), rng.uniform(-0.4, 0.4), 0, 0, 0.6, 0.8))
    lights = (*LIGHTS[1:3], Light("directional", direction=(0, 0.2, -1), position=(0, 0, 0.2), shadow_plane=True))
    expected = check(scene, POSES[:1], references_of(scene, 1), wv.Camera.from_fov(16, 12, hfov=0.9), lights)
    assert 0.1 < (expected == 0).mean() < 0.9


def test_triangles_meet_exactly_between_points_and_lights():
    """Single precision does not suffice for any point: no light passes between the triangles."""
    scene = under_ceiling("cpu")
    scene.lights = (Light("directional", direction=(0, 0, -1)), Light("point", position=(0.5, 0.25, 2.0)))
    camera = wv.Camera(24, 24, 8.0, 8.0, 12.5, 12.5)  # sees points with coordinates that are multiples of 1/8
    pose = np.array([[0, 0, 0.75, 1, 0, 0, 0]])
    expected = check(scene, pose, references_of(scene, 1), camera, scene.lights)
    assert (expected == 0).mean() > 0.5


@pytest.mark.slow
def test_every_line_runs(emulator, request):
    chosen = {item.function for item in request.session.items if item.path == request.path}
    if not all(value in chosen for name, value in globals().items() if name.startswith("test_") and callable(value)):
        pytest.skip("only some of this file's tests ran")
    counts = {line: count for line, count in emulator.line_counts().items() if line[0] in HEADERS}
    assert len(counts) > 200
    assert [f"{name}:{number}: {text}" for (name, number, text), count in counts.items() if count == 0] == []
