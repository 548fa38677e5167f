# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The manifest: the input of a dataset, which determines whether a job may resume it.

Scenes, cameras and frames are identified by descriptions and hashes of their contents.
"""

from __future__ import annotations

import hashlib
import json
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import asdict, fields, is_dataclass
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from warpvis.core.checks import truncate
from warpvis.core.labels import Label, LabelNames
from warpvis.core.types import Json
from warpvis.errors import FileFormatError, SceneError
from warpvis.sensors import sensor_to_fields

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.formats._base import Format
    from warpvis.batch.storage._stores import Store
    from warpvis.cameras.frames import Frames
    from warpvis.rendering import ColorOptions
    from warpvis.scene import Scene, SceneObject

MANIFEST = "manifest.json"
_VERSION = 1
_MAX_DIFFERENCES = 8

_NOT_COMPARED = {
    ("scene", "file"),  # contents of files are compared, not their names
    ("poses", "source", "file"),
    ("poses", "source", "worlds"),
    ("scene", "sha256"),  # differences of the objects are reported in more detail
}


Manifest = dict[str, Json]
"""The input of a dataset; None stands for exact depth as the sensor, and for an infinite far of the camera."""


class Contents(NamedTuple):
    """The layout of a dataset, from its manifest."""

    format: str
    frames: int
    shard_frames: int
    """Frames of each shard except the last."""
    poses_sha256: str | None
    """Hash of its poses, from `frames_hash`; None for situations."""

    @property
    def shard_count(self) -> int:
        """Number of shards."""
        return -(-self.frames // self.shard_frames)


def make_manifest(
    plan: Plan,
    scene: Scene,
    layout: Format,
    *,
    device: str,
    source: str | None,
    caster: str,
    colors: ColorOptions,
) -> Manifest:
    """Make a job's manifest; it depends only on the job's arguments, so it is the same in every call.

    `device` is ``"cpu"`` or ``"cuda"``, whose images agree, but not bit for bit; `source` is the scene's file.
    """
    frames = plan.frames
    packages = ["warp-lang", "numpy", *(layout.library or "").split()]
    return {
        "warpvis_dataset": _VERSION,
        "format": layout.name,
        "options": dict(sorted(plan.options.items())),
        "outputs": list(plan.outputs),
        "frames": len(frames),
        "shard_frames": plan.shard_frames,
        "camera": plan.camera.to_dict(),
        "scene": {"file": source, **describe_scene(scene), **(_describe_colors(scene) if plan.has_colors else {})},
        "objects": [plan.object_names[index] for index in plan.chosen],
        "exclude": [plan.object_names[index] for index in plan.exclude],
        "poses": {"source": dict(frames.source), "sha256": frames_hash(frames)},
        "seed": frames.source.get("seed"),
        "sensor": None if plan.sensor is None else sensor_to_fields(plan.sensor),
        "sensor_seed": None if plan.sensor is None else plan.sensor_seed,
        "device": device,
        "caster": caster,
        **(_color_fields(colors) if plan.has_colors else {}),
        "versions": versions(*packages),
    }


def _color_fields(colors: ColorOptions) -> dict[str, Json]:
    """Return the options of colors as fields of a manifest."""
    found: dict[str, Any] = dict(colors)
    occlusion = colors["ambient_occlusion"]
    return found | {"ambient_occlusion": None if occlusion is None else asdict(occlusion)}


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
    corners = item.frame_vertices
    return hash_values(item.name, int(item.label), item.movable, corners, item.faces, item.pose, item.parent, *shape)


def same_meshes(scene: Scene) -> tuple[int, ...]:
    """Return for every object the first movable object with the same mesh in its local frame.

    For static objects, and for those without a mesh, this is the object itself.
    """
    first: dict[str, int] = {}
    result = []
    for index, item in enumerate(scene.objects):
        if not item.movable:
            result.append(index)
            continue
        result.append(first.setdefault(hash_values(item.frame_vertices, item.faces), index))
    return tuple(result)


def describe_scene(scene: Scene) -> dict[str, Json]:
    """Return the label, size and hash of every object of a scene, and one hash of the whole scene.

    Hashes are the same on every device and in every process.
    """
    hashes = [object_hash(item) for item in scene.objects]
    objects: dict[str, Json] = {
        item.name: {
            "label": item.label.name if isinstance(item.label, Label) else item.label,
            "vertices": len(item.vertices),
            "faces": len(item.faces),
            "movable": item.movable,
            "sha256": digest,
        }
        for item, digest in zip(scene.objects, hashes, strict=True)
    }
    names = {str(number): name for number, name in scene.label_names.items()}
    return {"up": scene.up, "sha256": hash_values(scene.up, *hashes), "label_names": names, "objects": objects}


def _describe_colors(scene: Scene) -> dict[str, Json]:
    """Return hashes of the scene's appearances, and of its lights and background."""
    appearances = [value for item in scene.objects for value in _contents(item.appearance)]
    lights = [value for light in scene.lights for value in _contents(light)]
    return {
        "appearances": {"sha256": hash_values(*appearances)},
        "lights": {"sha256": hash_values(*lights, *_contents(scene.background))},
    }


def _contents(value: object) -> Iterator[object]:
    """Yield the numbers, texts and arrays of an appearance or a light, and the bytes of image files, without names."""
    if is_dataclass(value):
        yield type(value).__name__
        for item in fields(value):
            if item.name != "name":
                yield from _contents(getattr(value, item.name))
    elif isinstance(value, Mapping):
        yield from _contents(tuple(value.items()))
    elif isinstance(value, tuple | list):
        yield len(value)
        for part in value:
            yield from _contents(part)
    elif isinstance(value, Path):
        yield np.frombuffer(value.read_bytes(), dtype=np.uint8) if value.is_file() else "missing"
    else:
        yield np.frombuffer(value, dtype=np.uint8) if isinstance(value, bytes) else value


def frames_hash(frames: Frames) -> str:
    """Hash the poses, times and worlds of frames."""
    return hash_values(frames.camera_to_world, frames.timestamps, frames.object_poses, frames.world_index)


def versions(*packages: str) -> dict[str, str]:
    """Return the versions of warpvis and of `packages`, which affect a dataset's bytes; ``"zlib"`` is Python's zlib."""
    import warpvis

    found = {name: zlib.ZLIB_RUNTIME_VERSION if name == "zlib" else metadata.version(name) for name in packages}
    return {"warpvis": warpvis.__version__, **found}


def manifest_text(manifest: Manifest) -> str:
    """Return the text of a manifest's file."""
    return json.dumps(manifest, indent=1, allow_nan=False) + "\n"


def parse_manifest(data: bytes | None) -> Manifest | None:
    """Parse the contents of a manifest's file; return None if it is not a manifest."""
    try:
        content = json.loads(data or b"")
    except (ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) and "warpvis_dataset" in content else None


def read_manifest(store: Store) -> tuple[Manifest, Contents]:
    """Read the manifest of a dataset, and the layout that it defines."""
    manifest = parse_manifest(store.read(MANIFEST))
    if manifest is None:
        raise _no_dataset(store)
    match manifest:
        case {
            "format": str(format),
            "frames": int(frames),
            "shard_frames": int(shard_frames),
            "poses": {"sha256": str(poses_sha256)},
        } if frames > 0 and shard_frames > 0:
            return manifest, Contents(format, frames, shard_frames, poses_sha256)
        case {"contents": "situations"}:
            raise FileFormatError(f"{store.name}: contains situations, not frames: open it with open_situations")
    raise FileFormatError(f"{store.name}: is not a dataset: its {MANIFEST} does not define the contents")


def read_situation_contents(store: Store) -> Contents | None:
    """Read the layout of a dataset of situations; None if the manifest is not one of situations."""
    match parse_manifest(store.read(MANIFEST)):
        case {
            "contents": "situations",
            "format": str(format),
            "situations": int(situations),
            "shard_situations": int(shard_situations),
        } if situations > 0 and shard_situations > 0:
            return Contents(format, situations, shard_situations, None)
    return None


def _no_dataset(store: Store) -> FileFormatError:
    """Return the error for a folder without a manifest: it does not exist, is empty, or holds something else."""
    entries = store.entries()
    if not entries:
        return FileFormatError(f"{store.name}: is not a dataset: the folder does not exist or is empty")
    inside = [entry for entry in entries if store.size(f"{entry}/{MANIFEST}") is not None]
    hint = f"; its subfolders with datasets: {', '.join(inside)}" if inside else ""
    return FileFormatError(f"{store.name}: is not a dataset: it has no {MANIFEST} of warpvis{hint}")


def read_label_names(name: str, manifest: Mapping[str, Json]) -> LabelNames:
    """Return the names of a dataset's classes; only the names of `Label` if the manifest defines none."""
    scene = manifest.get("scene")
    names = scene.get("label_names", {}) if isinstance(scene, dict) else {}
    if isinstance(names, dict) and all(isinstance(key, str) and key.isascii() and key.isdigit() for key in names):
        try:
            return LabelNames({int(key): value for key, value in names.items()})
        except (SceneError, ValueError):  # Python refuses to convert a string of too many digits
            pass
    raise FileFormatError(f"{name}: label_names in {MANIFEST} must be valid names of labels")


def require_same(found: Mapping[str, Json], expected: Manifest, name: str) -> None:
    """Check that a dataset was begun with the same input as the job that is to resume it."""
    differences = list(dict.fromkeys(_differences(found, json.loads(manifest_text(expected)), ())))
    if differences:
        text = "; ".join(truncate(difference, 300) for difference in differences[:_MAX_DIFFERENCES])
        more = len(differences) - _MAX_DIFFERENCES
        text += f"; and {more} more" if more > 0 else ""
        raise FileFormatError(f"{name}: cannot be resumed because it was started with other input: {text}")


def _differences(found: Json, expected: Json, path: tuple[str, ...]) -> Iterator[str]:
    """Yield a description of each field that differs."""
    if isinstance(found, dict) and isinstance(expected, dict):
        if path == ("scene", "objects"):
            yield from _object_differences(found, expected)
            return
        for key in dict.fromkeys([*found, *expected]):
            if path + (key,) not in _NOT_COMPARED:
                yield from _differences(found.get(key), expected.get(key), path + (key,))
    elif found != expected:
        name, verbs = "'s ".join(path), ("were", "are") if isinstance(expected, list) else ("was", "is")
        change = f"{name} {verbs[0]} {_format_value(found)} and {verbs[1]} {_format_value(expected)}"
        yield f"the {path[-2]} differ" if path[-1] == "sha256" else change


def _object_differences(found: Mapping[str, Json], expected: Mapping[str, Json]) -> Iterator[str]:
    for name in dict.fromkeys([*found, *expected]):
        old, new = found.get(name), expected.get(name)
        if old is None or new is None:
            yield f"the scene's object {name!r} {'is new' if old is None else 'is missing'}"
        elif old != new:
            changes = ""
            if isinstance(old, dict) and isinstance(new, dict):
                keys = [key for key in old if key != "sha256" and old[key] != new.get(key)]
                changes = ", ".join(f"{key} {old[key]} to {new.get(key)}" for key in keys)
            yield f"the scene's object {name!r} differs" + (f" ({changes})" if changes else "")
    if list(found) != list(expected) and set(found) == set(expected):
        yield "the scene's objects are in another order"


def _format_value(value: Json) -> str:
    text = json.dumps(value)
    return text if len(text) <= 80 else text[:77] + "..."
