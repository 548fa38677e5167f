# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a Webots camera with a Recognition node recognises."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.poses import look_at, poses_to_matrices
from warpvis.errors import FileFormatError, SceneError
from warpvis.rendering import render
from warpvis.visibility import object_visibility
from warpvis.webots._devices import Device
from warpvis.webots._nodes import Node
from warpvis.webots._range_images import find_device

if TYPE_CHECKING:
    from warpvis.webots._world import WebotsWorld


@dataclass(frozen=True, eq=False)
class Recognised:
    """A Solid that a camera recognises."""

    name: str
    """Its key in `WebotsWorld.recognisable`."""
    objects: tuple[str, ...]
    """Names of its objects in the scene."""
    position: NDArray[np.float64]
    """The middle of its box in the OpenCV frame of the camera [m], shape ``(3,)``."""
    box: tuple[int, int, int, int]
    """Box of all of it that is within the image, hidden or not: x, y, width and height [px]."""
    visible_pixels: int
    """Pixels that show it."""
    colors: NDArray[np.float64]
    """Its `recognitionColors`, shape ``(n, 3)``."""


def recognise(world: WebotsWorld, camera_name: str, *, threads: int | None = None) -> list[Recognised]:
    """List what a camera's Recognition node lists, largest in the image first.

    These are the Solids with `recognitionColors` that are partly within the image, whose middle is at most `maxRange`
    away, and that pass the test that `occlusion` names: 0, none; 1, nothing is between the camera and the middle of
    their box; 2, some of their pixels show. Of these, the `maxObjects` with the largest boxes in the image.

    Args:
        world: The world, from `load_webots`.
        camera_name: The camera.
        threads: CPU threads to use; all cores of this process by default.

    Raises:
        SceneError: There is no such camera, it has no Recognition node, or it is not planar.
        FileFormatError: A field of the Recognition node is not what it has to be.
    """
    device, node = _recognising(world, camera_name)
    reach, most, occlusion = node.number("maxRange", 100.0), node.integer("maxObjects", -1), _occlusion(node)
    groups = {name: names for name, (_, names) in world.recognisable.items() if names}
    if not groups:
        return []
    scene, camera = world.scene, _unlimited(device)
    chosen = list(dict.fromkeys(name for names in groups.values() for name in names))
    silhouettes = object_visibility(
        scene, camera, device.pose, objects=chosen, canvas=(0, 0, 0, 0), caster="rays", threads=threads
    )
    boxes = dict(zip(chosen, silhouettes.silhouette_box.numpy()[0].tolist(), strict=True))
    counts = np.bincount(_object_image(world, device, threads).ravel() + 1, minlength=len(scene) + 1)[1:]
    found = []
    for name, names in groups.items():
        box = _union([boxes[item] for item in names])
        corners = np.concatenate([scene[item].bounds for item in names]).astype(np.float64)
        middle = (corners.min(axis=0) + corners.max(axis=0)) / 2
        if box is None or np.linalg.norm(middle - device.pose[:3]) > reach:
            continue
        pixels = int(sum(counts[scene.index(item)] for item in names))
        if (occlusion == 2 and not pixels) or (occlusion == 1 and _hidden(world, device, middle, names, threads)):
            continue
        matrix = poses_to_matrices(device.pose)
        position = (middle - matrix[:3, 3]) @ matrix[:3, :3]
        colors = world.recognisable[name][0].numbers("recognitionColors").reshape(-1, 3)
        found.append(Recognised(name, names, position, box, pixels, colors))
    found.sort(key=lambda item: item.box[2] * item.box[3], reverse=True)
    return found if most < 0 else found[:most]


def segmentation_image(world: WebotsWorld, camera_name: str, *, threads: int | None = None) -> NDArray[np.int32]:
    """Render a Recognition node's segmentation image: objects of Solids with `recognitionColors`, else nothing.

    Args:
        world: The world, from `load_webots`.
        camera_name: The camera.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        Indices into the scene's objects, -1 for none, shape ``(H, W)`` int32.

    Raises:
        SceneError: There is no such camera, it has no Recognition node, or it is not planar.
    """
    device, _ = _recognising(world, camera_name)
    image = _object_image(world, device, threads)
    known = [world.scene.index(name) for _, names in world.recognisable.values() for name in names]
    return np.where(np.isin(image, known), image, np.int32(-1)).astype(np.int32)


def _recognising(world: WebotsWorld, name: str) -> tuple[Device, Node]:
    device = find_device(world, name)
    if device.recognition is None:
        raise SceneError(f"{name!r} must be a Camera with a Recognition node, which this {device.kind} does not have")
    return device, device.recognition


def _occlusion(node: Node) -> int:
    """Read the field `occlusion`, which was TRUE or FALSE at first."""
    value = node.fields.get("occlusion")
    if isinstance(value, list) and value and isinstance(value[0], bool):
        return int(node.flag("occlusion", True))
    occlusion = node.integer("occlusion", 1)
    if occlusion not in (0, 1, 2):
        raise FileFormatError(f"{node.file}:{node.line}: expected occlusion of Recognition 0, 1 or 2, got {occlusion}")
    return occlusion


def _unlimited(device: Device) -> Camera:
    return dataclasses.replace(device.camera, near=0.0, far=math.inf)


def _object_image(world: WebotsWorld, device: Device, threads: int | None) -> NDArray[np.int32]:
    views = render(
        world.scene, device.camera, device.pose, outputs=("segmentation",), cull_backfaces=True, threads=threads
    )
    return views.segmentation.numpy()[0]


def _hidden(
    world: WebotsWorld, device: Device, middle: NDArray[np.float64], names: Sequence[str], threads: int | None
) -> bool:
    """Tell whether something else is between the camera and a point."""
    eye = device.pose[:3]
    ahead = middle - eye
    distance = float(np.linalg.norm(ahead))
    if distance == 0:
        return False
    sideways = np.eye(3)[np.argmin(np.abs(ahead))]
    ray = Camera.from_fov(1, 1, hfov=0.1, near=0.0, far=math.inf)
    pose = look_at(eye, middle, up=sideways)
    views = render(
        world.scene, ray, pose, outputs=("depth", "segmentation"), cull_backfaces=True, threads=threads, caster="rays"
    )
    first = int(views.segmentation.numpy()[0, 0, 0])
    return first >= 0 and world.scene.objects[first].name not in names and views.depth.numpy()[0, 0, 0] < distance


def _union(boxes: Sequence[Sequence[int]]) -> tuple[int, int, int, int] | None:
    """Find the box around boxes; None if all are empty."""
    filled = np.array([box for box in boxes if box[2] > 0])
    if not len(filled):
        return None
    low, high = filled[:, :2].min(axis=0), (filled[:, :2] + filled[:, 2:]).max(axis=0)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
