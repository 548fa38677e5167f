# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""A small Habitat dataset."""

import json

import trimesh

CUP = trimesh.creation.cone(0.05, 0.1)
TABLE = trimesh.creation.box((1.0, 0.7, 0.6)).apply_translation((0.1, 0.35, 0.2))
STAGE = trimesh.creation.box((6.0, 0.1, 5.0))


def write(folder, name, content):
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    if isinstance(content, trimesh.Trimesh):
        content.export(path)
    else:
        path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def make_dataset(folder, scene, *, config=None, objects=(), stage=None, **files):
    """Write a dataset in the layout of HSSD: a configuration, a stage, a cup and a table; return the scene's file."""
    stage = {"render_asset": "room.glb", "up": [0, 1, 0], "front": [0, 0, -1], **(stage or {})}
    write(folder, "stages/room.glb", STAGE)
    write(folder, "stages/room.stage_config.json", stage)
    for name, mesh in (("cup", CUP), ("table", TABLE)):
        write(folder, f"objects/{name[0]}/{name}.glb", mesh)
        template = {"render_asset": f"{name}.glb", **dict(objects).get(name, {})}
        write(folder, f"objects/{name[0]}/{name}.object_config.json", template)
    paths = {
        "stages": ["stages"],
        "objects": ["objects/*"],
        "scene_instances": ["scenes"],
        "light_setups": ["lights/*"],
    }
    default = {kind: {"paths": {".json": globs}} for kind, globs in paths.items()}
    default["articulated_objects"] = {"paths": {".urdf": ["urdf/*"]}}
    write(folder, "house.scene_dataset_config.json", {**default, **(config or {})})
    for name, content in files.items():
        write(folder, name.replace("__", "/"), content)
    return write(folder, "scenes/a.scene_instance.json", scene)
