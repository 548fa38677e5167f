# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare what a teleoperator and a collaborator see of a table on which robots handle a pot.

The scene is aloha_pot of the package mujoco-warp, with its cameras teleoperator_pov and collaborator_pov, and three
small added objects. Prints the visibility of objects for both, the objects that the collaborator may mean, and the
objects for which the teleoperator must move; writes aloha_perspective.png.
"""

import importlib.resources

import mujoco  # noqa: TID253
import trimesh

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.mujoco import camera_from_mujoco, camera_poses, geom_poses, scene_from_mujoco

file = importlib.resources.files("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"
model = mujoco.MjModel.from_xml_path(str(file))
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, 0)
mujoco.mj_forward(model, data)


def thing_of(geom: int) -> str:
    """Return the name of the object that a geom is part of."""
    body = model.body(int(model.geom_bodyid[geom])).name
    if body == "world":
        return "floor" if model.geom(geom).name == "floor" else "frame"
    parts = {"partnet_100015/link_1": "pot", "partnet_100015/link_0": "lid"}
    return f"{body.split(chr(92))[0]} arm" if chr(92) in body else parts.get(body, body)


# Merge the geoms of each object into one mesh, at their current poses.
geoms = scene_from_mujoco(model, movable="all")
meshes: dict[str, list[trimesh.Trimesh]] = {}
for item, geom, pose in zip(geoms.scene, geoms.geom_ids, poses_to_matrices(geom_poses(data, geoms)), strict=True):
    mesh = trimesh.Trimesh(item.mesh_vertices, item.faces, process=False).apply_transform(pose)
    meshes.setdefault(thing_of(int(geom)), []).append(mesh)
labels = {"floor": "ground", "table": "obstacle", "frame": "obstacle", "left arm": "robot", "right arm": "robot"}
scene = wv.Scene()
for name, parts in meshes.items():
    scene.add(trimesh.util.concatenate(parts), name=name, label=labels.get(name, "object"))
for name, place in {"salt": (0, 0.2, 0.035), "cup": (0.02, -0.2, 0.035), "spoon": (0, 0, 0.03)}.items():
    cylinder = trimesh.creation.cylinder(radius=0.03, height=0.06)
    scene.add(cylinder, name=name, label="object", pose=(*place, 0, 0, 0, 1))

agents = []
for name in ("teleoperator", "collaborator"):
    camera = model.camera(f"{name}_pov").id
    pose = camera_poses(data, model, [camera])[0]
    agents.append(wv.Agent(name, camera_from_mujoco(model, camera, 640, 480), pose))
seen = wv.perspective(scene, agents)
print(seen.table())
for candidate in seen.candidates("collaborator", "teleoperator"):
    print(f"the collaborator may mean the {candidate.object}: {candidate.probability:.0%}")
print("the teleoperator must move to see:", ", ".join(seen.to_see("teleoperator", "collaborator")))
wv.viz.save_perspective(scene, agents, seen, "aloha_perspective.png", title="aloha_pot: teleoperator and collaborator")
