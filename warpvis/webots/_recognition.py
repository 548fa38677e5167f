# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a Webots camera with a Recognition node recognises."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from warpvis.core.camera import Camera
from warpvis.core.poses import look_at, poses_to_matrices
from warpvis.errors import SceneError
from warpvis.rendering import Renderer, WideCamera, render
from warpvis.scene import Scene
from warpvis.visibility import object_visibility
from warpvis.webots._detection import Box, Frustum, is_hidden
from warpvis.webots._devices import Device
from warpvis.webots._extents import Bounds, Extent, triangles_of
from warpvis.webots._nodes import Node
from warpvis.webots._range_images import find_device
from warpvis.webots.shapes._polygons import join
from warpvis.webots.shapes._resets import correction

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
    """The middle of its box in the OpenCV frame of the camera [m], shape ``(3,)``, as Webots computes it."""
    size: NDArray[np.float64]
    """Lengths of that box along the camera's axes [m], shape ``(3,)``."""
    image_position: tuple[int, int]
    """Middle of that box's corners in the image: Webots' ``position_on_image`` [px]."""
    image_size: tuple[int, int]
    """Their width and height: Webots' ``size_on_image`` [px]."""
    box: tuple[int, int, int, int]
    """Box of all of it that is within the image, hidden or not: x, y, width and height [px]."""
    visible_pixels: int
    """Pixels that show it."""
    colors: NDArray[np.float64]
    """Its `recognitionColors`, shape ``(n, 3)``."""


def recognise(world: WebotsWorld, camera_name: str, *, threads: int | None = None) -> list[Recognised]:
    """List what a camera's Recognition node lists, largest in the image first.

    The rules are Webots' (``WbObjectDetection.cpp``, ``WbCamera.cpp``), for Solids with `recognitionColors` that are
    not the camera's robot or a Solid just below it. A Solid's box is about its bounding objects and those of the
    Solids in it, or, without any, about the sphere of its shapes. It is along the camera's axes, and what is outside of
    the image is cut off. It must be partly within the image and a pixel wide and high there. The distance of its
    middle, ahead, is at most `maxRange` plus half of the box's length ahead.

    Then comes the test that `occlusion` names: 0, none; 1, the ray to the Solid's origin, and 2, one of those to its
    box's corners, must not end in another Solid's bounding object more than half of the box's length before that. The
    camera's own robot hides nothing, nor does what has no bounding object: see `visible_pixels`. Of what passes, the
    `maxObjects` with the largest sizes in the image are listed.

    Of cylindrical and spherical images the sides are planes by planar formulas, and places in the image those of the
    projection, as in Webots since R2023a. A camera that sees more than half of all directions recognises what is
    ahead, or behind it beyond one of the four planes; of round bounds nothing is cut off then.

    Args:
        world: The world, from `load_webots`.
        camera_name: The camera.
        threads: CPU threads to use; all cores of this process by default.

    Raises:
        SceneError: There is no such camera, or it has no Recognition node.
        FileFormatError: A field of the Recognition node is not of its type.
    """
    device, node = _recognising(world, camera_name)
    reach, most, occlusion = _limits(node)
    groups = {name: names for name, (_, names) in world.recognisable.items() if names}
    if not groups:
        return []
    frustum, matrix = Frustum.of(device), poses_to_matrices(device.pose)
    eye, axes = matrix[:3, 3], matrix[:3, :3].T
    axes = np.stack([axes[2], -axes[0], -axes[1]])  # forward, left, up
    boxes, counts = _seen(world, device, groups, threads)
    obstacles = _obstacles(world.bounds) if occlusion else None
    found = []
    for name, names in groups.items():
        extent = world.bounds.recognised[name]
        box = _detected(world, device, frustum, (eye, axes), extent, reach)
        if box is None:
            continue
        place, size = frustum.on_image(box)
        if min(size) < 1 or (obstacles and _hidden(obstacles, extent, box, device.robot, eye, occlusion, threads)):
            continue
        pixels = int(sum(counts[world.scene.index(item)] for item in names))
        silhouette = _union([boxes[item] for item in names]) or (0, 0, 0, 0)
        colors = world.recognisable[name][0].numbers("recognitionColors").reshape(-1, 3)
        middle, lengths = box.middle[[1, 2, 0]] * (-1, -1, 1), box.size[[1, 2, 0]]
        found.append(Recognised(name, names, middle, lengths, place, size, silhouette, pixels, colors))
    found.sort(key=lambda item: item.image_size[0] * item.image_size[1], reverse=True)
    return found if most < 0 else found[:most]


def _detected(
    world: WebotsWorld,
    device: Device,
    frustum: Frustum,
    frame: tuple[NDArray[np.float64], NDArray[np.float64]],
    extent: Extent,
    reach: float,
) -> Box | None:
    """Compute the box of what is shown of a Solid; None if it is the robot's own, too far away or not in the image."""
    eye, axes = frame
    if device.robot and extent.robot == device.robot and extent.level <= 1:
        return None
    sphere = extent.sphere()
    if sphere is None or np.linalg.norm(sphere.center - eye) > reach + sphere.radius:
        return None
    box = frustum.box(extent, eye, axes, world.bounds.resolve)
    return box if box is not None and abs(box.middle[0]) <= reach + box.size[0] / 2 else None


def _seen(
    world: WebotsWorld, device: Device, groups: Mapping[str, tuple[str, ...]], threads: int | None
) -> tuple[dict[str, list[int]], NDArray[np.int64]]:
    """Compute the boxes of silhouettes by object, and the number of pixels that show each object of the scene."""
    scene, camera = world.scene, _camera(device, 0.0, math.inf)
    chosen = list(dict.fromkeys(name for names in groups.values() for name in names))
    if isinstance(camera, Camera):
        silhouettes = object_visibility(
            scene, camera, device.pose, objects=chosen, canvas=(0, 0, 0, 0), caster="rays", threads=threads
        )
        boxes = dict(zip(chosen, silhouettes.silhouette_box.numpy()[0].tolist(), strict=True))
    else:
        boxes = _boxes_alone(scene, camera, device, chosen, threads)
    return boxes, np.bincount(_object_image(world, device, threads).ravel() + 1, minlength=len(scene) + 1)[1:]


def _boxes_alone(
    scene: Scene, camera: WideCamera, device: Device, chosen: Sequence[str], threads: int | None
) -> dict[str, list[int]]:
    """Compute the boxes of silhouettes in a wide image, of which each object is rendered alone."""
    renderer = Renderer(scene, camera, outputs=("segmentation",), threads=threads)
    boxes = {}
    for name in chosen:
        others = np.ones((1, len(scene)), dtype=np.uint8)
        others[0, scene.index(name)] = 0
        rows, columns = np.nonzero(renderer.render(device.pose, exclude=others).segmentation.numpy()[0] >= 0)
        boxes[name] = [0, 0, 0, 0]
        if len(rows):
            x, y = int(columns.min()), int(rows.min())
            boxes[name] = [x, y, int(columns.max()) + 1 - x, int(rows.max()) + 1 - y]
    return boxes


def _obstacles(bounds: Bounds) -> tuple[Scene, dict[Extent, str]]:
    """Make a scene of all bounding objects, and name what each Solid's are called in it."""
    scene = Scene()
    names: dict[Extent, str] = {}
    for extent in bounds.solids:
        made = [triangles_of(node, transform, bounds.resolve) for node, transform in extent.bounding]
        parts = [part for part in made if part is not None]
        if parts:
            names[extent] = str(len(names))
            scene.add(join(parts), name=names[extent])
    return scene, names


def segmentation_image(world: WebotsWorld, camera_name: str, *, threads: int | None = None) -> NDArray[np.int32]:
    """Render a Recognition node's segmentation image: objects of Solids with `recognitionColors`, else nothing.

    Args:
        world: The world, from `load_webots`.
        camera_name: The camera.
        threads: CPU threads to use; all cores of this process by default.

    Returns:
        Indices into the scene's objects, -1 for none, shape ``(H, W)`` int32.

    Raises:
        SceneError: There is no such camera, or it has no Recognition node.
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


def _limits(node: Node) -> tuple[float, int, int]:
    """Read `maxRange`, `maxObjects` and `occlusion`, reset as Webots resets them."""
    reach, most = node.number("maxRange", 100.0), node.integer("maxObjects", -1)
    value = node.fields.get("occlusion")
    if isinstance(value, list) and value and isinstance(value[0], bool):  # it was TRUE or FALSE at first
        occlusion = node.integer("occlusionAccuracy", 1) if node.flag("occlusion", True) else 0
    else:
        occlusion = node.integer("occlusion", 1)
    notes = []
    if reach <= 0:
        notes.append(correction(node, "maxRange", reach, 100))
    if most < 1 and most != -1:
        notes.append(correction(node, "maxObjects", most, -1))
    if occlusion not in (0, 1, 2):
        notes.append(correction(node, "occlusion", occlusion, 1))
    for note in notes:
        warnings.warn(note, stacklevel=3)
    return reach if reach > 0 else 100.0, max(most, -1) or -1, occlusion if occlusion in (0, 1, 2) else 1


def _camera(device: Device, near: float, far: float) -> Camera | WideCamera:
    """Make the camera that a device is, of any projection, with another depth range [m]."""
    if device.projection == "planar":
        return dataclasses.replace(device.camera, near=near, far=far)
    return WideCamera(device.width, device.height, device.fov, device.projection, near, far)


def _object_image(world: WebotsWorld, device: Device, threads: int | None) -> NDArray[np.int32]:
    camera = _camera(device, device.min_range, device.max_range)
    views = render(world.scene, camera, device.pose, outputs=("segmentation",), cull_backfaces=True, threads=threads)
    return views.segmentation.numpy()[0]


def _hidden(
    obstacles: tuple[Scene, dict[Extent, str]],
    extent: Extent,
    box: Box,
    robot: str,
    eye: NDArray[np.float64],
    occlusion: int,
    threads: int | None,
) -> bool:
    """Tell whether all rays to a Solid end in bounding objects of others, well before it."""
    scene, names = obstacles
    # Webots adds the corners of the box along the camera's axes to a place in the world without turning them.
    ends = extent.origin + (np.zeros((1, 3)) if occlusion == 1 else box.corners())
    lengths = np.linalg.norm(ends - eye, axis=1)
    own = {extent, *extent.solids}
    passed = {name for each, name in names.items() if each in own or (robot and each.robot == robot)}
    hits = np.full(len(ends), np.inf)
    if len(passed) < len(names) and (lengths > 0).all():
        ray = Camera.from_fov(1, 1, hfov=0.1, near=0.0, far=math.inf)
        sideways = np.eye(3)[np.abs(ends - eye).argmin(axis=1)]
        poses = np.stack([look_at(eye, end, up=up) for end, up in zip(ends, sideways, strict=True)])
        views = render(scene, ray, poses, outputs=("depth",), exclude=sorted(passed), threads=threads, caster="rays")
        hits = views.depth.numpy()[:, 0, 0].astype(np.float64)
    return is_hidden(lengths, hits, box.size)


def _union(boxes: Sequence[Sequence[int]]) -> tuple[int, int, int, int] | None:
    """Find the box around boxes; None if all are empty."""
    filled = np.array([box for box in boxes if box[2] > 0])
    if not len(filled):
        return None
    low, high = filled[:, :2].min(axis=0), (filled[:, :2] + filled[:, 2:]).max(axis=0)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
