# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Stand-ins for Webots' package `controller`, with the signatures and failures of its two implementations.

Up to R2022b SWIG wraps C++ (``src/controller/python/controller.i`` of Webots): `getFromDevice` takes a Device and
raises a TypeError for anything else. From R2023a on Python calls C through ctypes (``lib/controller/python``):
functions
have a result type and no argument types, `getFromDevice` passes its argument to C unchanged, and a device that is not a
number raises a `ctypes.ArgumentError`.
"""

import ctypes
from types import SimpleNamespace

import numpy as np


class Simulation:
    """The state of Webots that the library reads, for a robot with one range finder.

    `nodes` maps DEF names to node-to-world matrices, `displays` names to sizes; `shown` lists displayed images. Values
    of
    `image` and `nodes` are read at each call; `on_step` may change them.
    """

    def __init__(self, device, image, position, orientation, *, tag=7, name="range-finder", supervisor=True, steps=1):
        self.device, self.tag, self.name = device, tag, name
        self.image = np.array(image, dtype=np.float32, order="C")
        self.position, self.orientation = list(position), np.asarray(orientation, dtype=float).ravel().tolist()
        self.supervisor, self.period, self.steps = supervisor, 0, steps
        self.nodes, self.displays, self.shown, self.world_path = {}, {}, {}, ""
        self.on_step = None


class _Function(ctypes._CFuncPtr):
    """A C function as returned by `ctypes.CDLL`, without argument types."""

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
    """Return the module `controller` as of R2023a and later."""
    place, turn = (ctypes.c_double * 3)(*simulation.position), (ctypes.c_double * 9)(*simulation.orientation)
    device, wb = simulation.device, _Library()
    definitions, displays, images, answers = list(simulation.nodes), list(simulation.displays), {}, []
    number, real, pointer = ctypes.c_int, ctypes.c_double, ctypes.c_void_p

    def enable(tag, period):
        simulation.period = period if tag == simulation.tag else simulation.period

    def node_of(tag):  # NULL if the robot is no supervisor, and for tags of other devices
        return 1000 + tag if simulation.supervisor and tag == simulation.tag else None

    def step(period):
        simulation.steps -= 1
        if simulation.on_step is not None:
            simulation.on_step()
        return -1 if simulation.steps < 0 else 0

    def node_by_definition(name):
        return 1 + definitions.index(name.decode()) if simulation.supervisor and name.decode() in definitions else None

    def matrix_of(node):
        return np.asarray(simulation.nodes[definitions[node - 1]], dtype=float)

    def position_of(node):
        answers.append(place if node > 1000 else (ctypes.c_double * 3)(*matrix_of(node)[:3, 3]))
        return ctypes.addressof(answers[-1])

    def orientation_of(node):
        answers.append(turn if node > 1000 else (ctypes.c_double * 9)(*matrix_of(node)[:3, :3].ravel()))
        return ctypes.addressof(answers[-1])

    def image_new(tag, width, height, data, form):
        channels = {3: 3, 4: 4, 5: 4, 6: 4, 7: 4}[form]
        pixels = np.frombuffer(ctypes.string_at(data, width * height * channels), dtype=np.uint8)
        images[5000 + len(images)] = pixels.reshape(height, width, channels)
        return 4999 + len(images)

    def image_paste(tag, image, x, y, blend):
        simulation.shown.setdefault(displays[tag - 100], []).append((images[image], (x, y), blend))

    tags = {simulation.name: simulation.tag, **{name: 100 + k for k, name in enumerate(displays)}}
    wb.add("get_device", number, [ctypes.c_char_p], lambda name: tags.get(name.decode(), 0))
    wb.add("enable", None, [number, number], enable)
    wb.add("get_period", number, [number], lambda tag: simulation.period)
    wb.add("get_width", number, [number], lambda tag: device.width)
    wb.add("get_height", number, [number], lambda tag: device.height)
    wb.add("get_fov", real, [number], lambda tag: device.fov)
    wb.add("get_min_range", real, [number], lambda tag: device.min_range)
    wb.add("get_max_range", real, [number], lambda tag: device.max_range)
    wb.add("get_image", pointer, [number], lambda tag: simulation.image.ctypes.data)
    wb.get_image.restype = ctypes.POINTER(ctypes.c_float)
    wb.add("get_from_device", pointer, [number], node_of)
    wb.add("get_from_def", pointer, [ctypes.c_char_p], node_by_definition)
    wb.add("get_position", pointer, [pointer], position_of)
    wb.add("get_orientation", pointer, [pointer], orientation_of)
    world_path = ctypes.create_string_buffer(simulation.world_path.encode())
    wb.add("get_world_path", pointer, [], lambda: ctypes.addressof(world_path))
    wb.get_world_path.restype = ctypes.c_char_p
    wb.add("image_new", pointer, [pointer, number, number, pointer, number], image_new)
    wb.image_new.argtypes = [pointer, number, number, pointer, number]
    wb.add("image_paste", None, [number, pointer, number, number, number], image_paste)
    wb.add("image_delete", None, [number, pointer], lambda tag, image: images.__setitem__(image, None))
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

    class Display:
        RGB, RGBA, ARGB, BGRA, ABGR = 3, 4, 5, 6, 7

        def __init__(self, name):
            self._tag = wb.get_device(name.encode())

        def imageNew(self, data, format, width, height):
            return wb.image_new(self._tag, int(width), int(height), data, format)

        def imagePaste(self, image, x, y, blend):
            wb.image_paste(self._tag, ctypes.c_void_p(image), int(x), int(y), ctypes.c_int(blend))

        def imageDelete(self, image):
            wb.image_delete(self._tag, ctypes.c_void_p(image))

    class Robot:
        def __init__(self):
            self._devices = {simulation.name: RangeFinder(simulation.name)}
            self._devices |= {name: Display(name) for name in simulation.displays}

        def getBasicTimeStep(self):
            return 32.0

        def getDevice(self, name):
            return self._devices.get(name)

        def getWorldPath(self):
            return wb.get_world_path().decode()

        def step(self, period):
            return wb.step(period)

    class Supervisor(Robot):
        def getFromDef(self, d):
            node = Node(wb.get_from_def(str.encode(d)))
            return node if node._ref else None

        def getFromDevice(self, tag):
            node = Node(wb.get_from_device(tag))
            return node if node._ref else None

    return SimpleNamespace(Robot=Robot, Supervisor=Supervisor)


def swig_library(simulation):
    """Return the module `controller` as of R2022b and earlier."""
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
            if not simulation.period:  # a buffer of the right size with uninitialized memory
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
