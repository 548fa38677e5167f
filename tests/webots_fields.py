# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Fields of the Webots R2023b nodes used in our worlds, and a check of nodes against them.

Names and types are those of ``resources/nodes`` of Webots; only fields that a world may set are listed.
"""

from warpvis.webots import Node

_POSE = {"translation": "SFVec3f", "rotation": "SFRotation", "children": "MFNode"}
_SOLID = {
    **_POSE,
    **{"name": "SFString", "model": "SFString", "description": "SFString", "contactMaterial": "SFString"},
    **{"boundingObject": "SFNode", "physics": "SFNode", "locked": "SFBool", "recognitionColors": "MFColor"},
}
_IMAGE = {"width": "SFInt32", "height": "SFInt32"}
FIELDS = {
    "WorldInfo": {"info": "MFString", "title": "SFString", "basicTimeStep": "SFFloat", "coordinateSystem": "SFString"},
    "Viewpoint": {"fieldOfView": "SFFloat", "orientation": "SFRotation", "position": "SFVec3f", "follow": "SFString"},
    "Background": {"skyColor": "MFColor", "luminosity": "SFFloat"},
    "DirectionalLight": {
        **{"ambientIntensity": "SFFloat", "color": "SFColor", "direction": "SFVec3f", "intensity": "SFFloat"},
        **{"on": "SFBool", "castShadows": "SFBool"},
    },
    "Group": {"children": "MFNode"},
    "Pose": _POSE,
    "Solid": _SOLID,
    "Robot": {**_SOLID, "controller": "SFString", "controllerArgs": "MFString", "supervisor": "SFBool"},
    "RangeFinder": {
        **_SOLID,
        **_IMAGE,
        **dict.fromkeys(("fieldOfView", "near", "minRange", "maxRange", "noise", "resolution"), "SFFloat"),
        **{"projection": "SFString", "lens": "SFNode"},
    },
    "Display": {**_SOLID, **_IMAGE},
    "Shape": {"appearance": "SFNode", "geometry": "SFNode", "castShadows": "SFBool", "isPickable": "SFBool"},
    "PBRAppearance": {
        "baseColor": "SFColor",
        "roughness": "SFFloat",
        "metalness": "SFFloat",
        "transparency": "SFFloat",
    },
    "Box": {"size": "SFVec3f"},
    "Sphere": {"radius": "SFFloat", "subdivision": "SFInt32", "ico": "SFBool"},
    "Cylinder": {"height": "SFFloat", "radius": "SFFloat", "subdivision": "SFInt32"},
    "Capsule": {"height": "SFFloat", "radius": "SFFloat", "subdivision": "SFInt32"},
}
_GEOMETRY = {"Box", "Sphere", "Cylinder", "Capsule"}
_TREE = {"Group", "Pose", "Solid", "Robot", "RangeFinder", "Display", "Shape"}
ALLOWED = {"children": _TREE, "geometry": _GEOMETRY, "appearance": {"PBRAppearance"}}
ALLOWED["boundingObject"] = _GEOMETRY | {"Group", "Pose", "Shape"}
_LENGTHS = {"Vec3f": 3, "Color": 3, "Rotation": 4, "Float": 1, "Int32": 1, "Bool": 1, "String": 1, "Node": 1}
_KINDS = {"Bool": bool, "String": str, "Node": Node}


def faults(node):
    """Return the errors that Webots would report for a node and its descendants."""
    found = []
    if node.type not in FIELDS:
        return [f"{node}: no node of this type"]
    for name, value in node.fields.items():
        kind = FIELDS[node.type].get(name)
        if kind is None:
            found.append(f"{node}: no field {name}")
            continue
        values = value if isinstance(value, list) else [value]
        multiple, base = kind[:2] == "MF", kind[2:]
        length, wanted = _LENGTHS[base], _KINDS.get(base, float)
        if len(values) % length or (not multiple and len(values) != length):
            found.append(f"{node}: {name} has {len(values)} values")
        if any(type(item) is not wanted for item in values):
            found.append(f"{node}: {name} is no {kind}")
        elif base == "Int32" and any(item != int(item) for item in values):
            found.append(f"{node}: {name} is no whole number")
        for item in values:
            if isinstance(item, Node):
                found += faults(item)
                if item.type not in ALLOWED[name]:
                    found.append(f"{node}: {item.type} in {name}")
    return found


def descend(nodes):
    """Yield all nodes and their descendants in file order; nodes inserted by USE are repeated."""
    for node in nodes:
        yield node
        for value in node.fields.values():
            yield from descend(
                [item for item in (value if isinstance(value, list) else [value]) if isinstance(item, Node)]
            )
