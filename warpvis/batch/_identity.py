# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Descriptions and hashes that identify scenes, cameras and frames by their contents."""

from __future__ import annotations

import hashlib
import math
import zlib
from dataclasses import asdict
from importlib import metadata
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from warpvis.cameras import LensCamera, lens_camera_to_fields
from warpvis.core.labels import Label
from warpvis.core.types import Json

if TYPE_CHECKING:
    from warpvis.cameras import CalibratedCamera
    from warpvis.cameras.frames import Frames
    from warpvis.scene import Scene, SceneObject


class ObjectDescription(TypedDict):
    """The description of an object in a manifest."""

    label: str | int
    """The name of a `Label`, or the number of a class without one."""
    vertices: int
    faces: int
    movable: bool
    sha256: str


class SceneDescription(TypedDict):
    """The description of a scene in a manifest."""

    up: str
    sha256: str
    label_names: dict[str, str]
    """Names of classes, by their numbers."""
    objects: dict[str, ObjectDescription]


def hash_values(*values: object) -> str:
    """Hash arrays with their dtypes and shapes, and other values by their `str`; return SHA-256 as hexadecimal text."""
    digest = hashlib.sha256()
    for value in values:
        if isinstance(value, np.ndarray):
            little = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<"))
            digest.update(f"{little.dtype.str}{little.shape}\n".encode())
            digest.update(little.reshape(-1).view(np.uint8).data)
        else:
            digest.update(f"{type(value).__name__} {value}\n".encode())
    return digest.hexdigest()


def object_hash(item: SceneObject) -> str:
    """Hash all properties that affect how an object is rendered."""
    solid = item.solid
    shape = () if solid is None else (int(solid.kind), np.asarray(solid.radii), float(solid.half))
    mesh = item.mesh_vertices if item.movable else item.vertices
    return hash_values(item.name, int(item.label), item.movable, mesh, item.faces, item.pose, item.parent, *shape)


def same_meshes(scene: Scene) -> tuple[int, ...]:
    """Return for every object the first movable object with the same mesh in its local frame.

    For static objects, and for those without a mesh, this is the object itself.
    """
    first: dict[str, int] = {}
    result = []
    for index, item in enumerate(scene.objects):
        if item.mesh_vertices is None or not item.movable:
            result.append(index)
            continue
        result.append(first.setdefault(hash_values(item.mesh_vertices, item.faces), index))
    return tuple(result)


def describe_scene(scene: Scene) -> SceneDescription:
    """Return the label, size and hash of every object of a scene, and one hash of the whole scene.

    Hashes are the same on every device and in every process.
    """
    objects: dict[str, ObjectDescription] = {
        item.name: {
            "label": item.label.name if isinstance(item.label, Label) else item.label,
            "vertices": len(item.vertices),
            "faces": len(item.faces),
            "movable": item.movable,
            "sha256": object_hash(item),
        }
        for item in scene.objects
    }
    scene_hash = hash_values(scene.up, *(item["sha256"] for item in objects.values()))
    names = {str(number): name for number, name in scene.label_names.items()}
    return {"up": scene.up, "sha256": scene_hash, "label_names": names, "objects": objects}


def describe_camera(camera: CalibratedCamera) -> dict[str, Json]:
    """Return a camera's fields; an infinite `far` becomes None, because JSON has no infinity."""
    if isinstance(camera, LensCamera):
        return lens_camera_to_fields(camera)
    fields = asdict(camera)
    return {**fields, "far": None if math.isinf(camera.far) else camera.far}


def frames_hash(frames: Frames) -> str:
    """Hash the poses, times and worlds of frames."""
    return hash_values(frames.camera_to_world, frames.timestamps, frames.object_poses, frames.world_index)


def versions(*packages: str) -> dict[str, str]:
    """Return the versions of warpvis and of `packages`, which affect a dataset's bytes; ``"zlib"`` is Python's zlib."""
    import warpvis

    found = {name: zlib.ZLIB_RUNTIME_VERSION if name == "zlib" else metadata.version(name) for name in packages}
    return {"warpvis": warpvis.__version__, **found}
