# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Depth cameras that are PROTOs in Webots, as nodes, for worlds whose PROTO files are not at hand."""

from __future__ import annotations

from typing import Any

from warpvis.webots.nodes import Node

# Distance of the Kinect's two sensors from its middle, height of its head, and the head's width, height and depth [m].
_KINECT_ASIDE, _KINECT_HEAD, _KINECT_SIZE = 0.0127, 0.05, (0.28, 0.038, 0.064)

DEPTH_CAMERAS = ("Kinect", "Astra")
"""The PROTOs that `expand_depth_camera` knows."""


def expand_depth_camera(node: Node) -> Node | None:
    """What such a PROTO stands for, from the documentation of its fields.

    Kinect: a head of 0.28 m x 0.038 m x 0.064 m, on a foot 0.05 m high that is not drawn, with the range finder
    ``"<cameraName> range"`` 12.7 mm to the left of its middle and the camera ``"<cameraName> color"`` as far to the
    right. Astra: the range finder ``"<name> depth"`` and the camera ``"<name> color"`` at its origin.

    Returns:
        A Solid, or None for other types.
    """
    if node.type == "Kinect":
        return _kinect(node)
    return _astra(node) if node.type == "Astra" else None


def _kinect(node: Node) -> Node:
    width, height = float(node.integer("width", 320)), float(node.integer("height", 190))
    shared: dict[str, Any] = {"fieldOfView": [1.0], "width": [width], "height": [height]}
    name = node.text("cameraName", "kinect")
    left = _translation(node, left=_KINECT_ASIDE)
    right = _translation(node, left=-_KINECT_ASIDE)
    wide, high, deep = _KINECT_SIZE
    size = [deep, wide, high] if node.version.z_up else [wide, high, deep]
    ranges: dict[str, Any] = {
        "name": [f"{name} range"],
        "maxRange": [node.number("maxRange", 3.5)],
        "noise": [node.number("rangeNoise", 0.0)],
    }
    head = _new(
        node,
        "Pose",
        translation=_translation(node, up=_KINECT_HEAD if node.flag("foot", True) else 0.0),
        children=[
            _new(node, "Shape", geometry=_new(node, "Box", size=size)),
            _new(node, "Camera", **shared, translation=right, name=[f"{name} color"]),
            _new(node, "RangeFinder", **shared, **ranges, translation=left),
        ],
    )
    return _new(node, "Solid", **_placed(node), name=[node.text("name", "Kinect")], children=[head])


def _astra(node: Node) -> Node:
    shared: dict[str, Any] = {"fieldOfView": [1.04], "width": [640.0], "height": [480.0]}
    name = node.text("name", "Astra")
    ranges: dict[str, Any] = {
        "name": [f"{name} depth"],
        "minRange": [0.6],
        "maxRange": [8.0],
        "noise": [node.number("depthNoise", 0.0)],
    }
    cameras = [
        _new(node, "Camera", **shared, name=[f"{name} color"]),
        _new(node, "RangeFinder", **shared, **ranges),
    ]
    return _new(node, "Solid", **_placed(node), name=[name], children=cameras)


def _placed(node: Node) -> dict[str, Any]:
    return {name: node.fields[name] for name in ("translation", "rotation") if name in node.fields}


def _translation(node: Node, *, left: float = 0.0, up: float = 0.0) -> list[float]:
    """In the axes of the node's version: x forward and z up, or x to the right and y up."""
    return [0.0, left, up] if node.version.z_up else [-left, up, 0.0]


def _new(like: Node, kind: str, **fields: Any) -> Node:
    return Node(kind, fields, None, like.file, like.line, like.version, like.protos)
