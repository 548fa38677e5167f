# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A small BOP dataset with two models, at three places in two images."""

import json

import numpy as np
import trimesh

MUG = trimesh.creation.cylinder(40.0, 90.0)
CARTON = trimesh.creation.box((60.0, 100.0, 150.0))
MODELS = {5: MUG, 11: CARTON}  # mm


def write_bop(folder, world_to_camera, placements, *, models="models"):
    """Write a scene, and return its folder.

    Args:
        folder: The folder of the dataset.
        world_to_camera: By image id, matrices in meters.
        placements: By image id, pairs of an object's id and its matrix to the world in meters.
        models: Name of the folder of models.
    """
    (folder / models).mkdir(parents=True)
    for number, mesh in MODELS.items():
        mesh.export(folder / models / f"obj_{number:06d}.ply")
    cameras, annotations = {}, {}
    for image, matrix in world_to_camera.items():
        rigid = {"cam_R_w2c": matrix[:3, :3].ravel().tolist(), "cam_t_w2c": (1000 * matrix[:3, 3]).tolist()}
        cameras[str(image)] = {"cam_K": [50, 0, 32, 0, 50, 24, 0, 0, 1], "depth_scale": 1.0, **rigid}
        seen = [(number, matrix @ pose) for number, pose in placements[image]]
        annotations[str(image)] = [
            {"obj_id": number, "cam_R_m2c": pose[:3, :3].ravel().tolist(), "cam_t_m2c": (1000 * pose[:3, 3]).tolist()}
            for number, pose in seen
        ]
    scene = folder / "test" / "000002"
    scene.mkdir(parents=True)
    (scene / "scene_camera.json").write_text(json.dumps(cameras))
    (scene / "scene_gt.json").write_text(json.dumps(annotations))
    return scene


def write_identity(folder):
    """Write a scene with one object in front of the camera, and return its folder."""
    pose = np.eye(4)
    pose[2, 3] = 1.0
    return write_bop(folder, {3: np.eye(4)}, {3: [(5, pose)]})
