# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for ROS 2's message classes, which check their fields as those that rosidl_generator_py makes do.

Their fields and types are those that rosbags has of ROS 2 Jazzy. What ROS asserts of a value, in
rosidl_generator_py/resource/_msg.py.em: whole numbers and floats are Python's own, an array of a fixed size may be
NumPy's, a sequence of numbers is an `array.array`, or anything whose items are looked at one by one.
"""

import array
import sys
import types
from collections.abc import Sequence

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from warpvis.io import register_livox_types

STORE = get_typestore(Stores.ROS2_JAZZY)
register_livox_types(STORE)
ROS1 = get_typestore(Stores.ROS1_NOETIC)

KINDS = [
    "builtin_interfaces/msg/Time",
    "std_msgs/msg/Header",
    "std_msgs/msg/String",
    "sensor_msgs/msg/RegionOfInterest",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/PointField",
    "sensor_msgs/msg/PointCloud2",
    "geometry_msgs/msg/Vector3",
    "geometry_msgs/msg/Quaternion",
    "geometry_msgs/msg/Transform",
    "geometry_msgs/msg/TransformStamped",
    "livox_ros_driver2/msg/CustomPoint",
    "livox_ros_driver2/msg/CustomMsg",
]

_CODES = {"uint8": "B", "float32": "f", "float64": "d"}


def install(monkeypatch):
    """Put packages of messages onto Python's path, as sourcing ROS's setup file does."""
    classes = {}
    for kind in KINDS:
        package, _, name = kind.split("/")
        classes[kind] = type(name, (_Message,), {"KIND": kind, "FIELDS": STORE.fielddefs[kind][1], "CLASSES": classes})
        parent = sys.modules.get(package) or types.ModuleType(package)
        module = sys.modules.get(f"{package}.msg") or types.ModuleType(f"{package}.msg")
        setattr(module, name, classes[kind])
        monkeypatch.setitem(sys.modules, package, parent)
        monkeypatch.setitem(sys.modules, f"{package}.msg", module)
    return classes


def as_rosbags(message):
    """The same message of rosbags, which writes it as bytes."""
    values = {name: _as_rosbags(getattr(message, name)) for name, _ in message.FIELDS}
    return STORE.types[message.KIND](**values)


def _as_rosbags(value):
    if isinstance(value, _Message):
        return as_rosbags(value)
    if isinstance(value, array.array):
        return np.array(value)
    return [_as_rosbags(item) for item in value] if isinstance(value, list) else value


class _Message:
    def __init__(self, **values):
        known = [name for name, _ in self.FIELDS]
        assert all(name in known for name in values), "Invalid arguments passed to constructor"
        for name, kind in self.FIELDS:
            if name in values:
                self._check(name, kind, values[name])
            setattr(self, name, values.get(name))

    def _check(self, name, kind, value):
        node, of = kind
        if node == Nodetype.NAME:
            assert isinstance(value, self.CLASSES[of]), f"The '{name}' field must be a sub message of type '{of}'"
        elif node == Nodetype.BASE:
            _check_base(name, of[0], value)
        else:
            self._check_items(name, node, of, value)

    def _check_items(self, name, node, of, value):
        item, count = of
        base = item[1][0] if item[0] == Nodetype.BASE else None
        if node == Nodetype.ARRAY and isinstance(value, np.ndarray):
            assert value.dtype == base, f"The '{name}' numpy.ndarray() must have the dtype of '{base}'"
            assert value.size == count, f"The '{name}' numpy.ndarray() must have a size of {count}"
        elif node == Nodetype.SEQUENCE and isinstance(value, array.array):
            assert value.typecode == _CODES[base], f"The '{name}' array.array() must have another type code"
        else:
            assert isinstance(value, Sequence) and not isinstance(value, str), f"The '{name}' field must be a sequence"
            for one in value:
                self._check(name, item, one)


def _check_base(name, base, value):
    if base == "string":
        assert isinstance(value, str), f"The '{name}' field must be of type 'str'"
    elif base == "bool":
        assert isinstance(value, bool), f"The '{name}' field must be of type 'bool'"
    elif base.startswith("float"):
        assert isinstance(value, float), f"The '{name}' field must be of type 'float'"
    else:
        assert isinstance(value, int), f"The '{name}' field must be of type 'int'"
        bits = int(base.lstrip("uint"))
        least, most = (0, 2**bits) if base.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1))
        assert least <= value < most, f"The '{name}' field must be an integer in [{least}, {most - 1}]"
