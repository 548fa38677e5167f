# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Objects and segmentation images of Webots cameras with a Recognition node."""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.cameras import AnyCamera, as_pinhole
from warpvis.cameras.pinhole import Camera
from warpvis.cameras.rays import WideCamera
from warpvis.core.poses import look_at
from warpvis.errors import SceneError
from warpvis.rendering import Renderer, render
from warpvis.scene import Scene
from warpvis.visibility import object_visibility
from warpvis.webots._detection import Bounds, Box, Extent, Frustum, triangles_of
from warpvis.webots._devices import Device
from warpvis.webots._nodes import Node, replaced
from warpvis.webots._range_images import find_device
from warpvis.webots.shapes._geometry import Resolve
from warpvis.webots.shapes._polygons import join

if TYPE_CHECKING:
    from warpvis.webots._world import WebotsWorld

_Obstacles: TypeAlias = tuple[Scene, dict[Extent, str]]
"""A scene of bounding objects, and its object of each Solid."""


@dataclass(frozen=True, eq=False)
class Recognized:
    """A Solid recognized by a camera."""

    name: str
    """Its key in `WebotsWorld.recognizable`."""
    objects: tuple[str, ...]
    """Names of its objects in the scene."""
    position: NDArray[np.float64]
    """Center of its box in the OpenCV frame of the camera [m], shape ``(3,)``, as computed by Webots."""
    size: NDArray[np.float64]
    """Size of that box along the camera's axes [m], shape ``(3,)``."""
    image_position: tuple[int, int]
    """Center of that box's projected corners: Webots' ``position_on_image`` [px]."""
    image_size: tuple[int, int]
    """Width and height of the projected corners: Webots' ``size_on_image`` [px]."""
    box: tuple[int, int, int, int]
    """Bounding box of its silhouette within the image, ignoring occlusion: x, y, width and height [px]."""
    visible_pixels: int
    """Number of pixels in which it is visible."""
    colors: NDArray[np.float64]
    """Its `recognitionColors`, shape ``(n, 3)``."""


def recognize(world: WebotsWorld, camera_name: str, *, threads: int | None = None) -> list[Recognized]:
    """List the objects recognized by a camera's Recognition node, by decreasing size in the image.

    The rules are those of Webots (``WbObjectDetection.cpp``, ``WbCamera.cpp``). They apply to Solids with
    `recognitionColors`, except the camera's robot and its direct child Solids. A Solid's box, along the camera's axes,
    bounds its bounding objects and those of its descendants, or, without any, the bounding sphere of its shapes. The
    part outside the image is cut off. The box must overlap the image and be at least a pixel wide and high in it. The
    forward distance of its center must be at most `maxRange` plus half of the box's forward length.

    Then the field `occlusion` selects a test: 0 skips it; 1 casts a ray to the Solid's origin, 2 one to each corner of
    its box. At least one ray must not end in another Solid's bounding object more than half of the box's length before
    its target. The camera's own robot and Solids without a bounding object do not occlude; compare `visible_pixels`.
    The `maxObjects` objects with the largest sizes in the image are returned.

    For cylindrical and spherical images, the frustum's planes follow planar formulas, and image positions follow the
    projection, as in Webots since R2023a. A camera whose field of view exceeds a hemisphere recognizes objects in front
    of it, and objects behind it beyond one of the four planes; round bounds are then not cut off.

    Raises:
        SceneError: If there is no such camera, or it has no Recognition node.
        FileFormatError: If a field of the Recognition node has a wrong type.
    """
    device, node = _recognizing(world, camera_name)
    reach, max_objects, occlusion = _limits(node)
    groups = {name: names for name, (_, names) in world.recognizable.items() if names}
    if not groups:
        return []
    frustum = Frustum.of(device)
    boxes, counts = _seen(world, device, groups, threads)
    obstacles = _obstacles(world.bounds) if occlusion else None
    found = []
    for name, names in groups.items():
        extent = world.bounds.recognized[name]
        box = _detected(frustum, extent, reach, world.bounds.resolve)
        if box is None:
            continue
        place, size = frustum.on_image(box)
        if min(size) < 1 or (obstacles and _hidden(obstacles, frustum, extent, box, occlusion, threads)):
            continue
        pixels = int(sum(counts[world.scene.index(item)] for item in names))
        silhouette = _union([boxes[item] for item in names]) or (0, 0, 0, 0)
        colors = world.recognizable[name][0].numbers("recognitionColors").reshape(-1, 3)
        middle, lengths = box.middle[[1, 2, 0]] * (-1, -1, 1), box.size[[1, 2, 0]]
        found.append(Recognized(name, names, middle, lengths, place, size, silhouette, pixels, colors))
    found.sort(key=lambda item: item.image_size[0] * item.image_size[1], reverse=True)
    return found if max_objects < 0 else found[:max_objects]


def _detected(frustum: Frustum, extent: Extent, reach: float, resolve: Resolve) -> Box | None:
    """Compute the box of a Solid; None if it belongs to the camera's robot, is too far away or not in the image."""
    robot, sphere = frustum.device.robot, extent.sphere()
    if robot and extent.robot == robot and extent.level <= 1:
        return None
    if sphere is None or np.linalg.norm(sphere.center - frustum.eye) > reach + sphere.radius:
        return None
    box = frustum.box(extent, resolve)
    return box if box is not None and abs(box.middle[0]) <= reach + box.size[0] / 2 else None


def _seen(
    world: WebotsWorld, device: Device, groups: Mapping[str, tuple[str, ...]], threads: int | None
) -> tuple[dict[str, list[int]], NDArray[np.int64]]:
    """Compute silhouette boxes by object, and the number of visible pixels of each object of the scene."""
    scene, camera = world.scene, _camera(device, 0.0, math.inf)
    planar = as_pinhole(camera)
    chosen = list(dict.fromkeys(name for names in groups.values() for name in names))
    if planar is not None:
        silhouettes = object_visibility(
            scene, planar, device.pose, objects=chosen, canvas=(0, 0, 0, 0), caster="rays", threads=threads
        )
        boxes = dict(zip(chosen, silhouettes.silhouette_box.numpy()[0].tolist(), strict=True))
    else:
        boxes = _isolated_boxes(scene, camera, device, chosen, threads)
    return boxes, np.bincount(_object_image(world, device, threads).ravel() + 1, minlength=len(scene) + 1)[1:]


def _isolated_boxes(
    scene: Scene, camera: AnyCamera, device: Device, chosen: Sequence[str], threads: int | None
) -> dict[str, list[int]]:
    """Compute silhouette boxes in a wide image by rendering each object in isolation."""
    renderer = Renderer(scene, camera, outputs=("segmentation",), threads=threads)
    boxes = {}
    for name in chosen:
        hidden = np.ones((1, len(scene)), dtype=np.uint8)
        hidden[0, scene.index(name)] = 0
        rows, columns = np.nonzero(renderer.render(device.pose, exclude=hidden).segmentation.numpy()[0] >= 0)
        boxes[name] = [0, 0, 0, 0]
        if len(rows):
            x, y = int(columns.min()), int(rows.min())
            boxes[name] = [x, y, int(columns.max()) + 1 - x, int(rows.max()) + 1 - y]
    return boxes


def _obstacles(bounds: Bounds) -> _Obstacles:
    """Build a scene of all bounding objects; return it with the object name of each Solid."""
    scene = Scene()
    names: dict[Extent, str] = {}
    for extent in bounds.solids:
        meshes = [triangles_of(node, transform, bounds.resolve) for node, transform in extent.bounding]
        parts = [part for part in meshes if part is not None]
        if parts:
            names[extent] = str(len(names))
            scene.add(join(parts), name=names[extent])
    return scene, names


def segmentation_image(world: WebotsWorld, camera_name: str, *, threads: int | None = None) -> NDArray[np.int32]:
    """Render a Recognition node's segmentation image, which shows Solids with `recognitionColors` only.

    Returns:
        Indices into the scene's objects, -1 for none, shape ``(H, W)`` int32.

    Raises:
        SceneError: If there is no such camera, or it has no Recognition node.
    """
    device, _ = _recognizing(world, camera_name)
    image = _object_image(world, device, threads)
    known = [world.scene.index(name) for _, names in world.recognizable.values() for name in names]
    return np.where(np.isin(image, known), image, np.int32(-1)).astype(np.int32)


def _recognizing(world: WebotsWorld, name: str) -> tuple[Device, Node]:
    device = find_device(world, name)
    if device.recognition is None:
        raise SceneError(f"{name!r} must be a Camera with a Recognition node, got a {device.kind} without")
    return device, device.recognition


def _limits(node: Node) -> tuple[float, int, int]:
    """Read `maxRange`, `maxObjects` and `occlusion`, reset as Webots resets them."""
    reach, max_objects = node.number("maxRange", 100.0), node.integer("maxObjects", -1)
    value = node.fields.get("occlusion")
    if isinstance(value, list) and value and isinstance(value[0], bool):  # TRUE or FALSE in early releases
        occlusion = node.integer("occlusionAccuracy", 1) if node.flag("occlusion", True) else 0
    else:
        occlusion = node.integer("occlusion", 1)
    notes: list[str] = []
    if reach <= 0:
        reach = replaced(node, "maxRange", reach, 100.0, notes)
    if max_objects < 1 and max_objects != -1:
        max_objects = replaced(node, "maxObjects", max_objects, -1, notes)
    if occlusion not in (0, 1, 2):
        occlusion = replaced(node, "occlusion", occlusion, 1, notes)
    for note in notes:
        warnings.warn(note, stacklevel=3)
    return reach, max_objects, occlusion


def _camera(device: Device, near: float, far: float) -> Camera | WideCamera:
    """Build the camera of a device, of any projection, with the given depth limits [m]."""
    if device.projection == "planar":
        return dataclasses.replace(device.camera, near=near, far=far)
    return WideCamera(device.width, device.height, device.fov, device.projection, near, far)


def _object_image(world: WebotsWorld, device: Device, threads: int | None) -> NDArray[np.int32]:
    camera = _camera(device, device.min_range, device.max_range)
    views = render(world.scene, camera, device.pose, outputs=("segmentation",), cull_backfaces=True, threads=threads)
    return views.segmentation.numpy()[0]


def _hidden(
    obstacles: _Obstacles, frustum: Frustum, extent: Extent, box: Box, occlusion: int, threads: int | None
) -> bool:
    """Return whether other Solids' bounding objects end all rays to a Solid, more than half of its size before it.

    As in Webots, ray `i` is compared with the length along axis ``i // 2`` of the box.
    """
    (scene, names), robot, eye = obstacles, frustum.device.robot, frustum.eye
    # Webots adds the box's corners, in camera axes, to a position in the world without rotating them.
    ends = extent.origin + (np.zeros((1, 3)) if occlusion == 1 else box.corners())
    lengths = np.linalg.norm(ends - eye, axis=1)
    excluded = {extent, *extent.solids}
    passed = {name for each, name in names.items() if each in excluded or (robot and each.robot == robot)}
    hits = np.full(len(ends), np.inf)
    if len(passed) < len(names) and (lengths > 0).all():
        ray = Camera.from_fov(1, 1, hfov=0.1, near=0.0, far=math.inf)
        sideways = np.eye(3)[np.abs(ends - eye).argmin(axis=1)]
        poses = np.stack([look_at(eye, end, up=up) for end, up in zip(ends, sideways, strict=True)])
        views = render(scene, ray, poses, outputs=("depth",), exclude=sorted(passed), threads=threads, caster="rays")
        hits = views.depth.numpy()[:, 0, 0].astype(np.float64)
    before = np.where(hits < lengths, lengths - hits, 0.0)
    axis = np.minimum(np.arange(len(lengths)) // 2, 2)  # for rays 6 and 7 of 8, Webots reads past the vector
    return bool((before > 0.5 * box.size[axis]).all())


def _union(boxes: Sequence[Sequence[int]]) -> tuple[int, int, int, int] | None:
    """Compute the bounding box of boxes; None if all are empty."""
    filled = np.array([box for box in boxes if box[2] > 0])
    if not len(filled):
        return None
    low, high = filled[:, :2].min(axis=0), (filled[:, :2] + filled[:, 2:]).max(axis=0)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])
