# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Scenes of BOP datasets, also of BlenderProc: the objects of an image at their annotated poses.

The format is that of https://github.com/thodan/bop_toolkit/blob/master/docs/bop_datasets_format.md.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, check_choice, check_flag, check_whole
from warpvis.core.file_content import is_file
from warpvis.core.labels import Label, LabelRules
from warpvis.core.poses import poses_to_opencv
from warpvis.core.types import DeviceLike
from warpvis.errors import FileFormatError, SceneError
from warpvis.io._meshes import read_mesh_file, unique_names
from warpvis.io.datasets._fields import Fields
from warpvis.io.datasets._joined import Shape, join
from warpvis.scene import FileParts, Part, Scene
from warpvis.scene.lights import HEADLIGHT

BopFrame = Literal["world", "camera"]
"""Frame of a scene: the world of the dataset, or the camera of the image (x right, y down, z forward)."""

_MILLIMETER = 1e-3
_PARENTS = 3
"""Number of folders above a scene in which models are searched."""


def load_bop_scene(
    path: str | os.PathLike[str],
    image: int | None = None,
    *,
    frame: BopFrame = "world",
    models: str | os.PathLike[str] | None = None,
    device: DeviceLike = "cpu",
    movable: bool = False,
) -> Scene:
    """Load the objects of an image of a BOP dataset, in meters.

    Objects are named ``obj_000005`` by their model, with ``_1``, ``_2``, ... for further instances, and have the label
    OBJECT. Instances of a model share its mesh. In the frame ``"world"``, the camera's pose is that of `read_frames`
    from ``scene_camera.json``; in the frame ``"camera"``, it is the identity.

    Args:
        path: The folder of a scene (``test/000002``), or its ``scene_gt.json``.
        image: Id of the image; by default the first.
        frame: Frame of the objects. ``"world"`` needs ``scene_camera.json`` with ``cam_R_w2c``.
        models: Folder of ``obj_000001.ply`` in millimeters; by default ``models`` above the scene, else ``models_*``.
        device: Device that renders the scene.
        movable: Whether the objects are movable.

    Raises:
        FileFormatError: If a file is missing or invalid, or the image is not annotated.
        SceneError: If an argument is invalid, or the image has no objects.
    """
    path = as_path(path)
    check_choice(frame, "frame", get_args(BopFrame), SceneError)
    number = None if image is None else check_whole(image, "image", minimum=0, error=SceneError)
    found = _read(path, number, frame, None if models is None else as_path(models, "models"))
    scene = Scene(device=device)
    rules = LabelRules.of(None, None)
    scene.add_parts(found, rules, movable=check_flag(movable, "movable", SceneError))
    return scene


def read_bop(path: Path, *, search_path: Sequence[Path] = (), strict: bool = False) -> FileParts:
    """Read the first image of ``scene_gt.json``, in the world's frame if it is known; see `load_bop_scene`."""
    frame: BopFrame = "world" if _has_world(_cameras_of(path)) else "camera"
    return _read(path, None, frame, next(iter(search_path), None))


def _read(path: Path, image: int | None, frame: BopFrame, models: Path | None) -> FileParts:
    annotations = path / "scene_gt.json" if path.is_dir() else path
    fields = Fields.read(annotations)
    numbers = {int(key): key for key in fields.values if key.isascii() and key.isdigit()}
    if not numbers:
        raise FileFormatError(
            f"{annotations}: must have images by their ids, got {'nothing' if not fields.values else 'other keys'}"
        )
    image = min(numbers) if image is None else image
    if image not in numbers:
        raise FileFormatError(f"{annotations}: has no image {image}; its images are {min(numbers)} to {max(numbers)}")
    camera_to_frame = np.eye(4) if frame == "camera" else _camera_to_world(_cameras_of(annotations), image)
    folder = _find_models(annotations, models)
    shapes: dict[int, Shape] = {}
    parts = []
    for item in fields.children(numbers[image]):
        number = item.whole("obj_id")
        if number not in shapes:
            shapes[number] = _read_model(folder, number)
        pose = camera_to_frame @ _matrix(item, "cam_R_m2c", "cam_t_m2c")
        parts.append(_part(number, shapes[number], poses_to_opencv(pose)[0]))
    names = unique_names([part.name for part in parts])
    parts = [replace(part, name=name) for name, part in zip(names, parts, strict=True)]
    return FileParts(annotations, parts, lights=(HEADLIGHT,))


def _part(number: int, shape: Shape, pose: NDArray[np.float64]) -> Part:
    options: dict[str, Any] = {"movable": True, "appearance": shape.appearance, "extras": {"obj_id": number}}
    return Part(f"obj_{number:06d}", (shape.vertices, shape.faces), Label.OBJECT, pose, **options)


def _cameras_of(annotations: Path) -> Path:
    """Return the file of cameras next to a file of annotations, of the same camera if there are several."""
    return annotations.with_name(annotations.name.replace("scene_gt", "scene_camera", 1))


def _has_world(cameras: Path) -> bool:
    if not is_file(cameras):
        return False
    fields = Fields.read(cameras)
    return bool(fields.values) and all("cam_R_w2c" in fields.child(key).values for key in fields.values)


def _camera_to_world(cameras: Path, image: int) -> NDArray[np.float64]:
    if not is_file(cameras):
        raise FileFormatError(f"{cameras}: no such file, which the frame 'world' needs; use frame='camera'")
    fields = Fields.read(cameras)
    key = next((key for key in fields.values if key.isascii() and key.isdigit() and int(key) == image), None)
    if key is None or "cam_R_w2c" not in fields.child(key).values:
        raise FileFormatError(f"{cameras}: image {image} has no cam_R_w2c, which the frame 'world' needs; use 'camera'")
    return np.linalg.inv(_matrix(fields.child(key), "cam_R_w2c", "cam_t_w2c")).astype(np.float64)


def _matrix(item: Fields, rotation: str, translation: str) -> NDArray[np.float64]:
    """Return a pose in meters."""
    missing = next((name for name in (rotation, translation) if name not in item.values), None)
    if missing:
        raise FileFormatError(f"{item.named(missing)} must be numbers, got nothing")
    matrix = np.eye(4)
    matrix[:3, :3] = item.vector(rotation, (0.0,) * 9).reshape(3, 3)
    matrix[:3, 3] = item.vector(translation, (0.0,) * 3) * _MILLIMETER
    if np.abs(matrix[:3, :3] @ matrix[:3, :3].T - np.eye(3)).max() > 1e-3 or np.linalg.det(matrix[:3, :3]) < 0:
        raise FileFormatError(f"{item.named(rotation)} must be a rotation matrix, got {matrix[:3, :3].tolist()}")
    return matrix


def _find_models(annotations: Path, models: Path | None) -> Path:
    """Return the folder of models."""
    places = [] if models is None else [models]
    for folder in [] if models is not None else list(annotations.absolute().parents)[: _PARENTS + 1]:
        places += [folder / "models", *sorted(folder.glob("models_*"))]
    found = next((folder for folder in places if folder.is_dir()), None)
    if found is None:
        where = f"{models} is not one" if models is not None else "there is no 'models' above it"
        raise FileFormatError(f"{annotations}: needs a folder of models (obj_000001.ply), and {where}")
    return found


def _read_model(folder: Path, number: int) -> Shape:
    path = folder / f"obj_{number:06d}.ply"
    if not is_file(path):
        raise FileFormatError(f"{path}: no such file, which the object {number} needs")
    found = read_mesh_file(path, search_path=(), strict=False)
    if not found.parts:
        raise FileFormatError(f"{path}: holds no triangles")
    shape = join(found.parts, path)
    return shape._replace(vertices=shape.vertices * _MILLIMETER)
