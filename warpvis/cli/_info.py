# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The commands ``warpvis info``, on this machine or a scene file, and ``sensor-fit``, on images of walls."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from warpvis.cli._inputs import MaybeSceneFile, SceneOptions, refuse_options, scene_options
from warpvis.cli._output import format_rows, with_help
from warpvis.core.checks import pluralize

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.scene import Scene
    from warpvis.webots import Device, Lidar

# A vertex is three floats, a face three indices; a tree takes 50 bytes (32 lanes) to 52 (16 lanes) per triangle.
_CORNER_BYTES, _FACE_BYTES, _TREE_BYTES = 12, 12, 51


@with_help
@dataclass(frozen=True, kw_only=True)
class Info(SceneOptions):
    """Print versions, devices and cores, or the content of a scene file."""

    file: MaybeSceneFile = None

    def run(self) -> None:
        if self.file is None:
            refuse_options(self, scene_options, "info of this machine takes")
            _print_versions()
        elif is_world(self.file):
            unused = [name for name in scene_options if name not in ("search_path", "strict", "labels", "label_names")]
            refuse_options(self, unused, "info of a Webots world takes")
            self._print_world(self.file)
        else:
            self._print_objects(self.file)

    def _print_world(self, file: Path) -> None:
        """Print the tree of a Webots world, its devices, lists of skipped and replaced nodes, and its size."""
        from warpvis.webots import load_webots

        world = load_webots(file, search_path=self.folders(), strict=self.strict, labels=self.label_rules())
        triangles = pluralize(world.scene.triangle_count, "triangle")
        print(f"{file}: {world.version}, {world.scene.up} up, {pluralize(len(world.scene), 'object')}, {triangles}")
        print(world.tree)
        devices: dict[str, Mapping[str, Device | Lidar]] = {"device": world.devices, "lidar": world.lidars}
        for kind, named in devices.items():
            for name, item in named.items():
                place = " ".join(f"{value:.4g}" for value in item.pose)
                print(f"{kind}  {name!r} of {item.robot!r}: {item.describe()}; at {place}")
        for name, person in world.people.items():
            print(f"person  {name!r}: eyes at {_numbers(person.poses[0])}")
        for kind, counts in (("left out", world.skipped), ("stand-in", world.stand_ins)):
            for name, count in counts.items():
                print(f"{kind}  {name} ({count})")
        print(f"\n{describe(world.scene)}")

    def _print_objects(self, file: Path) -> None:
        scene = self.load_scene(file)
        print(
            f"{file}: {scene.up} up, {pluralize(len(scene), 'object')}, {pluralize(scene.triangle_count, 'triangle')}"
        )
        print(describe(scene))
        rows = []
        for item in scene:
            rows.append(
                [item.name, scene.label_names.name(item.label), str(len(item.faces)), *map(_numbers, item.bounds)]
            )
        print()
        print(format_rows(["object", "label", "triangles", "least corner [m]", "greatest corner [m]"], rows))


def is_world(path: Path | None) -> bool:
    """Return whether a file is a Webots world, by its name."""
    return path is not None and path.suffix.lower() == ".wbt"


def describe(scene: Scene) -> str:
    """Return a scene's size, labels and memory, and a hint if its unit seems to be millimeters."""
    import numpy as np

    from warpvis.scene import looks_like_millimeters

    if not len(scene):
        return "empty"
    boxes = np.array([item.bounds for item in scene.objects], dtype=np.float64)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    size = high - low
    labels = Counter(scene.label_names.name(item.label) for item in scene)
    meshes = {id(item.faces): (item.vertices, item.faces) for item in scene.objects}
    corners, faces = (sum(len(mesh[k]) for mesh in meshes.values()) for k in (0, 1))
    memory = corners * _CORNER_BYTES + faces * (_FACE_BYTES + _TREE_BYTES)
    lines = [
        f"spans   {' x '.join(f'{side:.4g}' for side in size)} m, from {_numbers(low)} to {_numbers(high)}",
        f"labels  {', '.join(f'{name} {count}' for name, count in labels.most_common())}",
        f"memory  {f'about {memory / 1e6:.3g}' if memory >= 1e5 else 'less than 0.1'} MB with its trees",
    ]
    if looks_like_millimeters(size):
        scaled = " x ".join(f"{side / 1000:.3g}" for side in size)
        lines.append(f"units   possibly millimeters: with --scale 0.001 it spans {scaled} m")
    return "\n".join(lines)


def _numbers(values: Sequence[float] | NDArray[np.floating]) -> str:
    return " ".join(f"{value:.4g}" for value in values)


def _print_versions() -> None:
    import platform
    from importlib.metadata import version

    import warp as wp

    import warpvis
    from warpvis.core.threads import core_count

    print(f"warpvis {warpvis.__version__}")
    print(f"python  {platform.python_version()} on {platform.platform()}")
    for package in ("warp-lang", "numpy", "trimesh", "mujoco"):
        print(f"{package} {version(package)}")
    print(f"cores   {core_count()}")
    for device in wp.get_devices():
        print(f"device  {device.alias}: {device.name}")


@with_help
@dataclass(frozen=True, kw_only=True)
class SensorFit:
    """Fit noise, quantization and dropout of a stereo or structured-light camera to its images of flat walls.

    Each image shows one wall, at any distance and angle: 16-bit PNG files or .npy files.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of depth images."""
    camera: Annotated[str, tyro.conf.arg(metavar="FILE")]
    """File of the camera: JSON with width, height, hfov (radians) or K; transforms.json, BOP's camera.json, COLMAP's
    cameras.txt or .bin, YAML of ROS, Kalibr or OpenCV."""
    baseline: float | None = None
    """Distance between the sensor's two cameras (meters); by default f b follows from --subpixel or from the band
    without depth at one side of the image."""
    subpixel: int | None = None
    """Number of disparity steps per pixel."""
    unit: float = 0.001
    """Length of one unit of integer images (meters)."""
    region: float = 0.8
    """Central fraction of the image's width and height to use."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Output picture: errors, their histogram and autocorrelation, and errors by depth."""

    def run(self) -> None:
        from warpvis.io import find_depth_images, load_camera, read_depth
        from warpvis.sensors import fit

        camera = load_camera(self.camera, distortion=False)
        files = find_depth_images(self.folder)
        images = [read_depth(file, unit=self.unit) for file in files]
        rounded = self.unit if any(file.suffix.lower() == ".png" for file in files) else 0.0
        options = {"baseline": self.baseline, "subpixel": self.subpixel, "region": self.region}
        found = fit(images, camera, depth_step=rounded, **options)  # type: ignore[arg-type]
        print(found.report())
        if self.out is not None:
            from warpvis.viz import save_sensor_fit

            save_sensor_fit(found, self.out)
            print(f"\n{self.out}: errors and fitted parameters")
