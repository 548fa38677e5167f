# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for Webots' package `controller`, with the signatures of its two kinds and their failures.

Up to R2022b SWIG wraps C++ (``src/controller/python/controller.i`` of Webots): `getFromDevice` takes a Device and
refuses all else with a TypeError. From R2023a on Python calls C through ctypes (``lib/controller/python``): functions
have a result type and no argument types, `getFromDevice` hands its argument to C as it is, and a device that is no
number is an `ctypes.ArgumentError`.
"""

import ctypes
from types import SimpleNamespace

import numpy as np


class Simulation:
    """A robot with one range finder: what Webots knows, and the library asks for."""

    def __init__(self, device, image, position, orientation, *, tag=7, name="range-finder", supervisor=True, steps=1):
        self.device, self.image, self.tag, self.name = device, image, tag, name
        self.position, self.orientation = list(position), np.asarray(orientation, dtype=float).ravel().tolist()
        self.supervisor, self.period, self.steps = supervisor, 0, steps


class _Function(ctypes._CFuncPtr):
    """A function as `ctypes.CDLL` gives it: of C, with no argument types."""

    _flags_ = ctypes._FUNCFLAG_CDECL
    _restype_ = ctypes.c_int


class _Library:
    """C functions of libController, by name."""

    def __init__(self):
        self._kept = []

    def add(self, name, restype, argtypes, body):
        compiled = ctypes.CFUNCTYPE(restype, *argtypes)(body)
        self._kept.append(compiled)
        function = _Function(ctypes.cast(compiled, ctypes.c_void_p).value)
        function.restype = restype
        setattr(self, name, function)


def ctypes_library(simulation):
    """Make what ``from controller import ...`` gives from R2023a on."""
    values = np.ascontiguousarray(simulation.image, dtype=np.float32)
    place, turn = (ctypes.c_double * 3)(*simulation.position), (ctypes.c_double * 9)(*simulation.orientation)
    device, wb = simulation.device, _Library()
    number, real, pointer = ctypes.c_int, ctypes.c_double, ctypes.c_void_p

    def enable(tag, period):
        simulation.period = period if tag == simulation.tag else simulation.period

    def node_of(tag):  # NULL where the robot is no supervisor, and for tags of other devices
        return 1000 + tag if simulation.supervisor and tag == simulation.tag else None

    def step(period):
        simulation.steps -= 1
        return -1 if simulation.steps < 0 else 0

    tags = {simulation.name: simulation.tag}
    wb.add("get_device", number, [ctypes.c_char_p], lambda name: tags.get(name.decode(), 0))
    wb.add("enable", None, [number, number], enable)
    wb.add("get_period", number, [number], lambda tag: simulation.period)
    wb.add("get_width", number, [number], lambda tag: device.width)
    wb.add("get_height", number, [number], lambda tag: device.height)
    wb.add("get_fov", real, [number], lambda tag: device.fov)
    wb.add("get_min_range", real, [number], lambda tag: device.min_range)
    wb.add("get_max_range", real, [number], lambda tag: device.max_range)
    wb.add("get_image", pointer, [number], lambda tag: values.ctypes.data)
    wb.get_image.restype = ctypes.POINTER(ctypes.c_float)
    wb.add("get_from_device", pointer, [number], node_of)
    wb.add("get_position", pointer, [pointer], lambda node: ctypes.addressof(place))
    wb.add("get_orientation", pointer, [pointer], lambda node: ctypes.addressof(turn))
    wb.get_position.restype = wb.get_orientation.restype = ctypes.POINTER(ctypes.c_double)
    wb.add("step", number, [number], step)

    class RangeFinder:
        def __init__(self, name):
            self._tag = wb.get_device(name.encode())

        def enable(self, period):
            wb.enable(self._tag, period)

        def getSamplingPeriod(self):
            return wb.get_period(self._tag)

        def getWidth(self):
            return wb.get_width(self._tag)

        def getHeight(self):
            return wb.get_height(self._tag)

        def getFov(self):
            return wb.get_fov(self._tag)

        def getMinRange(self):
            return wb.get_min_range(self._tag)

        def getMaxRange(self):
            return wb.get_max_range(self._tag)

        def getRangeImage(self, data_type="list"):
            image = wb.get_image(self._tag)
            return image[: self.getWidth() * self.getHeight()] if data_type == "list" else image

    class Node:
        def __init__(self, ref):
            self._ref = ctypes.c_void_p(ref)

        def getPosition(self):
            return wb.get_position(self._ref)[:3]

        def getOrientation(self):
            return wb.get_orientation(self._ref)[:9]

    class Robot:
        def __init__(self):
            self._devices = {simulation.name: RangeFinder(simulation.name)}

        def getBasicTimeStep(self):
            return 32.0

        def getDevice(self, name):
            return self._devices.get(name)

        def step(self, period):
            return wb.step(period)

    class Supervisor(Robot):
        def getFromDevice(self, tag):
            node = Node(wb.get_from_device(tag))
            return node if node._ref else None

    return SimpleNamespace(Robot=Robot, Supervisor=Supervisor)


def swig_library(simulation):
    """Make what ``from controller import ...`` gives up to R2022b."""
    device = simulation.device

    class Device:
        def __init__(self, tag):
            self.__tag = tag

        def getTag(self):
            return self.__tag

    class RangeFinder(Device):
        def enable(self, period):
            simulation.period = period

        def getSamplingPeriod(self):
            return simulation.period

        def getWidth(self):
            return device.width

        def getHeight(self):
            return device.height

        def getFov(self):
            return device.fov

        def getMinRange(self):
            return device.min_range

        def getMaxRange(self):
            return device.max_range

        def getRangeImage(self, data_type="list"):
            values = np.ascontiguousarray(simulation.image, dtype=np.float32)
            if not simulation.period:  # a buffer of the right size, of memory that nothing was written to
                return None if data_type == "list" else b"\x55" * values.nbytes
            return values.ravel().tolist() if data_type == "list" else values.tobytes()

    class Node:
        def getPosition(self):
            return list(simulation.position)

        def getOrientation(self):
            return list(simulation.orientation)

    class Robot:
        def __init__(self):
            self._devices = {simulation.name: RangeFinder(simulation.tag)}

        def getBasicTimeStep(self):
            return 32.0

        def getDevice(self, name):
            return self._devices.get(name)

        def step(self, period):
            simulation.steps -= 1
            return -1 if simulation.steps < 0 else 0

    class Supervisor(Robot):
        def getFromDevice(self, device):
            if not isinstance(device, Device):
                raise TypeError("in method 'Supervisor_getFromDevice', argument 2 of type 'webots::Device const *'")
            return Node() if simulation.supervisor else None

    return SimpleNamespace(Robot=Robot, Supervisor=Supervisor)
