# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The CUDA packet caster, compiled by a C++ compiler for the CPU: ``native/cuda_emulator.h`` emulates a warp.

The source that Warp would pass to NVRTC is compiled unchanged, with sanitizers, one function per variant. The structs
around it are generated from the kernel's, so that a missing field is a compile error.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import struct
import subprocess
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from native_build import cache_folder, find_compiler

from warpvis import Camera, Scene
from warpvis.cameras.rays import RayCamera
from warpvis.kernels import native_source
from warpvis.kernels.casting import packets_cuda
from warpvis.kernels.casting.point_order import PointLists
from warpvis.kernels.casting.rays import RayRange
from warpvis.kernels.pinhole import PinholeCamera
from warpvis.kernels.shading import shadow_packets_cuda
from warpvis.rendering import Renderer
from warpvis.rendering.casters.base import CastOptions, ImagesByName, ViewBatch, images_struct
from warpvis.rendering.casters.points_cuda import lists_of, packet_count
from warpvis.rendering.casters.rays import RayBundleCaster, RaysCaster
from warpvis.scene.acceleration.geometry import build_scene_bvh

from support.prepared_packets import prepare_all

NATIVE = Path(__file__).parent / "native"
HEADERS = Path(native_source.__file__).parent / "native"

_FLAGS = ["-std=c++17", "-g1", "-Wall", "-Wextra", "-fno-omit-frame-pointer", "-fno-optimize-sibling-calls"]
# Without optimization: a compiler that does not model warps may duplicate a call.
_CHECKED = ["-O0", "-ffp-contract=off", "-ftrivial-auto-var-init=pattern", "--coverage"]
_CHECKED += ["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-Wno-unused-function"]
_UNCHECKED = ["-O2", "-DEMULATOR_ASAN"]
MAX_PROGRAMS = 160
"""Maximum number of cached programs: about 40 variants of the current sources and of a few earlier versions."""

_SHARED = re.compile(r"__shared__ (warpvis::\w+) memory;")
_RESULTS = ("images", "shadows_out")
"""Arguments that a launch writes."""
_ABSENT, _GIVEN, _IMAGE = range(3)


@dataclass(frozen=True)
class Variant:
    """A variant of a kernel, for a compute capability."""

    side: int
    with_id: bool
    movable: bool
    clip: bool = False
    resized: bool = False
    found: bool = False
    """Whether movable objects are found and sorted into tiles before packets are cast."""
    large: bool = False
    """Whether trees are treated as larger than a GPU's cache."""
    ray_table: bool = False
    """Whether rays come from a ray bundle."""
    points: int = 0
    """Number of rays in a packet if they are of image points or unordered, else 0."""
    used: bool = False
    """Whether warps loop over packets of the image points that are used."""
    origins: bool = False
    """Whether the rays of a bundle have distinct origins."""
    image_side: int = 0
    """Side of the images whose windows are packets of a ray bundle; 0 if packets are whole images."""
    shadows: bool = False
    """Whether shadows are cast instead of images."""
    arch: int = 900

    @property
    def name(self) -> str:
        kind = (self.with_id, self.movable, self.clip, self.resized, self.found, self.large, self.ray_table)
        kind += (self.origins, self.shadows, self.used)
        flags = "_".join(str(int(flag)) for flag in (*kind, self.points, self.image_side))
        return f"packet_{self.side}_{flags}_{self.arch}"


REQUIRED = os.environ.get("WARPVIS_REQUIRE_CXX") == "1"
"""Whether a missing compiler or a compiler warning is a failure."""


class Emulator:
    """Launches variants, each a program that is compiled when it is first launched."""

    def __init__(self, folder: Path) -> None:
        """Find a compiler.

        Args:
            folder: An empty folder, for the line counts of the launches.
        """
        compiler = find_compiler()
        assert compiler is not None
        self._compiler, self._folder = compiler, folder
        self._programs: dict[Variant, tuple[Path, dict[str, Any]]] = {}
        # The runtime of --coverage writes counts to this folder instead of the object's folder.
        self._environment = {**os.environ, "GCOV_PREFIX": str(folder), "GCOV_PREFIX_STRIP": "99"}

    def launch(self, variant: Variant, size: tuple[int, int, int], arguments: dict[str, Any]) -> None:
        """Launch views, rows and columns of packets, and write the images among the arguments."""
        if variant not in self._programs:
            self._programs[variant] = self._compile(variant)
        program, types = self._programs[variant]
        images: list[np.ndarray] = []
        parts = [struct.pack("3i", *size)]
        for name, kind in types.items():
            _write(parts, images, kind, arguments[name], is_image=name in _RESULTS)
        result = subprocess.run([program], input=b"".join(parts), capture_output=True, env=self._environment)
        if result.returncode:
            raise AssertionError(result.stderr.decode()[-4000:])
        offset = 0
        for image in images:
            image[...] = np.frombuffer(result.stdout, image.dtype, image.size, offset).reshape(image.shape)
            offset += image.nbytes
        assert offset == len(result.stdout)

    def _compile(self, variant: Variant) -> tuple[Path, dict[str, Any]]:
        """Return a variant's program, from the cache if possible, and the types of its arguments."""
        function, body, headers = _native_code(variant)
        types = {name: kind for name, kind in function.input_types.items() if name not in _PLACE}
        sources = {path.name: path.read_text() for path in sorted(NATIVE.glob("cuda_*"))}
        sources["cuda_launch.h"] = _launch_header(types)
        sources[f"{variant.name}.cpp"] = _variant_source(variant, function, body, headers)
        built = _build(sources, self._compiler)
        notes = built / f"{variant.name}.gcno"
        (self._folder / notes.name).symlink_to(notes)
        return built / "cuda_emulator", types

    def line_counts(self) -> dict[tuple[str, int, str], int]:
        """Return how often all launches so far ran each line of the CUDA headers: by file, line number and text."""
        counts: dict[tuple[str, int, str], int] = {}
        for variant in self._programs:
            file, of_instance = "", False
            for line in _run([*_gcov(self._compiler), "-t", f"{variant.name}.gcda"], self._folder).splitlines():
                count, number, text = (part.strip() for part in (line + "::").split(":", 2))
                text = text.removesuffix("::")
                if not number.isdigit():  # a rule, or the name of an instance of a template, whose lines come once more
                    of_instance = not line.startswith("---")
                elif of_instance:
                    continue
                elif number == "0" and text.startswith("Source:"):
                    file = text.removeprefix("Source:")
                elif count != "-" and Path(file).is_relative_to(HEADERS):
                    key = (Path(file).name, int(number), text)
                    # gcov marks a block of the line that never ran by "*".
                    ran = 0 if count in ("#####", "=====") else int(count.rstrip("*"))
                    counts[key] = counts.get(key, 0) + ran
        assert len(counts) > 400
        return counts


def _build(sources: dict[str, str], compiler: str) -> Path:
    """Return the folder of the program of these sources, which is compiled if the cache does not hold it."""
    paths = [NATIVE, HEADERS]
    options = [*_FLAGS, *_CHECKED, *_UNCHECKED, str(REQUIRED), *map(str, paths)]
    version = _run([compiler, "--version"], NATIVE)
    digest = hashlib.sha256("\0".join([compiler, version, *options]).encode())
    for name, text in sorted(sources.items()):
        digest.update(f"\0{name}\0{text}".encode())
    target = cache_folder() / f"cuda_emulator-{digest.hexdigest()[:16]}"
    if target.is_dir():
        os.utime(target)
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    folder = Path(tempfile.mkdtemp(prefix=f"{target.name}.", dir=target.parent))
    for name, text in sources.items():
        (folder / name).write_text(text)

    def compile_one(name: str) -> str:
        options = _UNCHECKED if name == "cuda_warp.cpp" else _CHECKED
        options = [*options, "-Werror"] if REQUIRED else options
        _run([compiler, *_FLAGS, *options, "-c", name, "-o", f"{Path(name).stem}.o"], folder)
        return f"{Path(name).stem}.o"

    with ThreadPoolExecutor(len(os.sched_getaffinity(0))) as pool:
        objects = list(pool.map(compile_one, [name for name in sources if name.endswith(".cpp")]))
    _run([compiler, *_CHECKED, *objects, "-o", "cuda_emulator"], folder)
    for name in objects:
        (folder / name).unlink()
    try:
        folder.rename(target)
    except OSError:  # another process was faster
        shutil.rmtree(folder)
    programs = sorted(target.parent.glob("cuda_emulator-*"), key=lambda path: path.stat().st_mtime)
    for old in programs[:-MAX_PROGRAMS]:
        shutil.rmtree(old, ignore_errors=True)
    return target


def _trees(scene: Scene, images: ImagesByName) -> Any:
    """Return the trees of a scene that GPU casters read."""
    return build_scene_bvh(scene.objects, scene.device, lanes=32, faces="faces" in images).struct


class EmulatedCaster(RaysCaster):
    """Replaces the caster in `Renderer`; renders images with the scene's trees of 32 lanes."""

    def __init__(self, emulator: Emulator, variant: Variant, scene: Scene, camera: Camera, cull: bool) -> None:
        super().__init__(scene, camera, CastOptions(cull_backfaces=cull, clip_near=variant.clip))
        self._emulator = emulator
        self._variant = variant

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        scene, camera, side = self._scene, self._camera, self._variant.side
        struct = _trees(scene, images)
        arguments = {
            "scene": struct,
            "camera": camera.device_struct(clip_near=self._options.clip_near),
            "poses": views.poses,
            "worlds": views.worlds,
            "found": self._room(views.count, struct.drawn_count),
            "rays": PointLists(),
            "cull_backfaces": self._options.cull_backfaces,
            "images": images_struct(images),
        }
        size = (views.count, -(-camera.height // side), -(-camera.width // packets_cuda.packet_width(side)))
        self._emulator.launch(self._variant, size, arguments)

    def _room(self, views: int, count: int) -> Any:
        """Return scratch arrays for found objects: filled by a kernel on a GPU, by a view's first packet here."""
        room, camera, tile = packets_cuda.FoundObjects(), self._camera, 1 << packets_cuda.TILE_BITS
        if self._variant.found:
            room.tiles_y, room.tiles_x = -(-camera.height // tile), -(-camera.width // tile)
            tiles = views * room.tiles_y * room.tiles_x
            room.entries = wp.zeros((views, count), dtype=wp.vec4i, device="cpu")
            room.counts = wp.zeros((views, 2), dtype=wp.int32, device="cpu")
            room.tile_counts, room.tile_ends = (wp.zeros(tiles, dtype=wp.int32, device="cpu") for _ in range(2))
            room.order = wp.zeros(packets_cuda.MAX_TILES * views * count, dtype=wp.int32, device="cpu")
        return room


class EmulatedTableCaster(RayBundleCaster):
    """Replaces the caster of ray bundles."""

    def __init__(self, emulator: Emulator, variant: Variant, scene: Scene, camera: RayCamera, cull: bool) -> None:
        super().__init__(scene, camera, CastOptions(cull_backfaces=cull))
        self._emulator = emulator
        self._variant = variant

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        arguments = {
            "scene": _trees(self._scene, images),
            "camera": self._camera.device_struct(),
            "poses": views.poses,
            "worlds": views.worlds,
            "found": packets_cuda.FoundObjects(),
            "cull_backfaces": self._options.cull_backfaces,
            "images": images_struct(images),
        }
        # A launch writes all of an image: all packets have the same shape.
        shape = (self._camera.height, self._camera.width, 3)
        packets = prepare_all(
            self._camera.rays.reshape(shape),
            0 if self._variant.points else self._variant.image_side or self._variant.side,
            self._scene.device,
            self._camera.origins.reshape(shape) if self._variant.origins else None,
            self._variant.side,
        )
        self._emulator.launch(self._variant, (views.count, packets.windows.shape[0], 1), arguments | {"rays": packets})


class EmulatedPointCaster(RaysCaster):
    """Replaces the caster of image points."""

    def __init__(self, emulator: Emulator, variant: Variant, scene: Scene, camera: Camera, cull: bool) -> None:
        super().__init__(scene, camera, CastOptions(cull_backfaces=cull, clip_near=variant.clip))
        self._emulator = emulator
        self._variant = variant

    def cast(self, views: ViewBatch, images: ImagesByName) -> None:
        lists = lists_of(views, self._camera)
        lists.step = 2
        arguments = {
            "scene": _trees(self._scene, images),
            "camera": self._camera.device_struct(clip_near=self._options.clip_near),
            "poses": views.poses,
            "worlds": views.worlds,
            "found": packets_cuda.FoundObjects(),
            "rays": lists,
            "cull_backfaces": self._options.cull_backfaces,
            "images": images_struct(images),
        }
        packets = packet_count(lists, self._variant.points) if views.used is None else lists.step
        size = (views.count, packets, 1)
        self._emulator.launch(self._variant, size, arguments)


# Equivalent of `find_objects` of warpvis.rendering: all lanes find objects, then one lane sorts them.
_FIND_AND_SORT = """
if (packet_y == 0 && packet_x == 0) {
    if (warpvis::Warp::lane() == 0) found.counts.data[2 * view] = found.counts.data[2 * view + 1] = 0;
    warpvis::Warp::sync();
    for (int first = 0; first < scene.drawn_count; first += warpvis::LANES) {
        const int object = first + warpvis::Warp::lane();
        FIND
    }
    warpvis::Warp::sync();
    if (warpvis::Warp::lane() == 0) {
        const int tiles = found.tiles_y * found.tiles_x;
        int* count = found.tile_counts.data + view * tiles;
        int* end = found.tile_ends.data + view * tiles;
        for (int tile = 0, all = view ? end[-1] : 0; tile < tiles; ++tile) end[tile] = all += count[tile];
        for (int i = 0; i < found.counts.data[2 * view]; ++i) {
            const int* entry = (const int*)(found.entries.data + view * scene.drawn_count + i);
            for (int y = (entry[2] & 0xffff) >> warpvis::TILE_BITS; y <= entry[2] >> (16 + warpvis::TILE_BITS); ++y)
                for (int x = (entry[1] & 0xffff) >> warpvis::TILE_BITS; x <= entry[1] >> (16 + warpvis::TILE_BITS); ++x)
                    found.order.data[end[y * found.tiles_x + x] - count[y * found.tiles_x + x]--] = i;
        }
    }
    warpvis::Warp::sync();
}
"""


def emulated_renderer(emulator: Emulator, variant: Variant, scene: Scene, camera: Camera, **options: Any) -> Renderer:
    """Return a `Renderer` that renders with the emulator."""
    renderer = Renderer(scene, camera, **options)
    cull = options.get("cull_backfaces", False)
    kind: Any = EmulatedPointCaster if variant.points else EmulatedCaster
    kind = EmulatedTableCaster if variant.ray_table else kind
    renderer._caster = kind(emulator, variant, scene, camera, cull)
    return renderer


_PLACE = {"view": "view", "packet_y": "packet_y", "packet_x": "packet_x"}
_SCALARS = {int: "int", wp.int32: "int", float: "float", wp.float32: "float", wp.float64: "double", bool: "bool"}
_SCALARS |= {wp.bool: "bool", wp.uint8: "unsigned char"}
_FORMATS = {"int": "i", "float": "f", "double": "d", "bool": "?"}
_ELEMENTS = {wp.vec2: "Vec2", wp.vec3: "Vec3", wp.vec4: "Vec4", wp.vec4i: "Vec4", wp.transform: "Transform", **_SCALARS}


def _native_code(variant: Variant) -> tuple[wp.Function, str, str]:
    """Return the function called by the kernel, its body, and the C++ in front of it, with the paths of headers."""
    kind = variant.with_id, variant.movable
    cached = packets_cuda.CACHED_NUMBERS
    packets_cuda.CACHED_NUMBERS = 0 if variant.large else cached
    try:
        if variant.shadows:
            function = shadow_packets_cuda.cast_block
            kernel = shadow_packets_cuda.make_shadow_kernel(variant.resized)
        elif variant.ray_table:
            function = packets_cuda.cast_function(packets_cuda.BUNDLE, RayRange, packets_cuda.RayPackets)
            kernel = packets_cuda.make_ray_packet_kernel(
                variant.side, *kind, variant.resized, variant.points, variant.origins
            )
        else:
            of_points = packets_cuda.USED_POINTS if variant.used else packets_cuda.POINTS
            call = of_points if variant.points else packets_cuda.PIXELS
            function = packets_cuda.cast_function(call, PinholeCamera, PointLists)
            kernel = packets_cuda.make_packet_kernel(variant.side, *kind, variant.clip, variant.resized, variant.points)
    finally:
        packets_cuda.CACHED_NUMBERS = cached
    body = function.native_snippet
    if variant.found:
        body = _FIND_AND_SORT.replace("FIND", packets_cuda.FIND_OBJECT) + body
    preamble = kernel.module.options["extra_build_options"].extra_cuda_preamble
    return function, body, re.sub(r'^#line (\d+) "', rf'#line \1 "{HEADERS}/', preamble, flags=re.MULTILINE)


def _is_array(kind: Any) -> bool:
    return hasattr(kind, "dtype") and hasattr(kind, "ndim")


def _is_struct(kind: Any) -> bool:
    return not _is_array(kind) and hasattr(kind, "vars")


def _cpp_type(kind: Any) -> str:
    if _is_array(kind):
        return f"Array<{_cpp_type(kind.dtype)}>"
    return kind.key.split(".")[-1] if _is_struct(kind) else _ELEMENTS[kind]


def _fields(kind: Any) -> dict[str, Any]:
    return {name: var.type for name, var in kind.vars.items()}


def _struct(name: str, fields: dict[str, Any]) -> str:
    """Return the definition of a struct and the function that reads it."""
    members = "".join(f"    {_cpp_type(kind)} {field};\n" for field, kind in fields.items())
    reads = "".join(f"    read(reader, value.{field});\n" for field in fields)
    return f"struct {name} {{\n{members}}};\ninline void read(Reader& reader, {name}& value) {{\n{reads}}}\n"


def _launch_header(arguments: dict[str, Any]) -> str:
    structs: dict[str, dict[str, Any]] = {}
    for argument in filter(_is_struct, arguments.values()):
        elements = [kind.dtype for kind in _fields(argument).values() if _is_array(kind) and _is_struct(kind.dtype)]
        structs |= {_cpp_type(kind): _fields(kind) for kind in (*elements, argument)}
    text = ['#pragma once\n#include "cuda_emulator.h"\n#include "cuda_reader.h"\n']
    text += [_struct(name, fields) for name, fields in structs.items()]
    text.append(_struct("Arguments", arguments))
    text.append("void packet_function(void* arguments, int view, int packet_y, int packet_x);\n")
    return "".join(text)


def _variant_source(variant: Variant, function: Any, body: str, headers: str) -> str:
    # The body for pixels does not use `rays`, those for points and ray bundles not `packet_x`.
    parameters = ", ".join(f"[[maybe_unused]] {_cpp_type(kind)} {name}" for name, kind in function.input_types.items())
    given = ", ".join(_PLACE.get(name, f"all.{name}") for name in function.input_types)
    body, count = _SHARED.subn(r"auto& memory = *(\1*)emulator::shared_memory(sizeof(\1));", body)
    assert count == 1
    return (
        f'#define __CUDA_ARCH__ {variant.arch}\n#include "cuda_launch.h"\n{headers}#line 1 "{variant.name}.cpp"\n'
        f"static void cast_packet({parameters}) {{\n{body}}}\n"
        "void packet_function(void* arguments, int view, int packet_y, int packet_x) {\n    (void)packet_x;\n"
        f"    const Arguments& all = *(const Arguments*)arguments;\n    cast_packet({given});\n}}\n"
    )


def _write(parts: list[bytes], images: list[np.ndarray], kind: Any, value: Any, is_image: bool) -> None:
    """Append a value in the format that `read` of its type expects."""
    if _is_struct(kind):
        for field, field_kind in _fields(kind).items():
            _write(parts, images, field_kind, getattr(value, field), is_image)
    elif _is_array(kind):
        shape = (0,) * 4 if value is None else (*value.shape, *(0,) * (4 - len(value.shape)))
        there = value is not None and bool(value.ptr)
        data = value.numpy() if there else np.zeros(0)
        parts.append(struct.pack("=5iq", (_IMAGE if is_image else _GIVEN) if there else _ABSENT, *shape, data.nbytes))
        if there and is_image:
            images.append(data)
        elif there:
            parts.append(np.ascontiguousarray(data).tobytes())
    else:
        parts.append(struct.pack(_FORMATS[_SCALARS[kind]], value))


def _gcov(compiler: str) -> list[str]:
    """Return the gcov command that matches a compiler."""
    if "clang" not in Path(compiler).name:
        return ["gcov"]
    folder = Path(compiler).resolve().parent
    return [next((str(path) for path in sorted(folder.glob("llvm-cov*"))), "llvm-cov"), "gcov"]


def _run(command: list[str], folder: Path) -> str:
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    if result.returncode:
        raise AssertionError(f"{' '.join(command)}\n{result.stderr[-4000:]}")
    return result.stdout
