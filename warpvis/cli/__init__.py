# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Run the command line: ``warpvis demo``, ``render``, ``batch``, ``verify``, ``warmup``, ``check`` and so on.

Nothing heavy is imported until a command runs, so that ``--help`` answers at once.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from warpvis.cli._batch import Batch, Verify, Warmup
from warpvis.cli._check import Check
from warpvis.cli._inputs import make_folder
from warpvis.cli._perspective import Perspective
from warpvis.errors import FileFormatError, PoseError, WarpvisError

if TYPE_CHECKING:
    from warpvis.rendering import Renderer

_VIEWS_AT_A_TIME = 16


@dataclass(frozen=True)
class Demo:
    """Run the paper's four experiments: two pictures each, two tables, and summary.json."""

    out: Path = Path("demo")
    """Folder for the pictures and summary.json."""
    device: str = "cpu"
    """Where to compute: cpu, cuda:0, ..."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.demo import run_demo

        run_demo(self.out, device=self.device)


@dataclass(frozen=True)
class Render:
    """Render depth images of a mesh file: OUT/depth.npz in metres, OUT/depth/*.png in millimetres (16 bit, 0: none).

    Of a Webots world without --poses: the images of its range finders, in OUT/NAME/depth.npz and OUT/NAME/depth.
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE")]
    """Mesh file: OBJ, STL, PLY, GLB, ...; or a Webots world, .wbt."""
    out: Path
    """Folder to write to."""
    poses: Path | None = None
    """Camera poses, camera to world, a line each: timestamp tx ty tz qx qy qz qw (TUM)."""
    camera: str = "kinect"
    """kinect, or a JSON file with width, height, hfov (radians) or K, near and far (metres)."""
    convention: Literal["opencv", "opengl", "ros_body", "ros_optical"] = "opencv"
    """Axes of the camera frame of the poses."""
    scale: float = 1.0
    """Metres in a unit of the file (0.001 for millimetres)."""
    up: Literal["z", "y"] = "z"
    """The world's vertical axis."""
    file_up: Literal["z", "y"] | None = None
    """The file's vertical axis; y for glTF and the world's for other formats by default."""
    device: str = "cpu"
    """Where to compute: cpu, cuda:0, ..."""
    device_name: str | None = None
    """Of a Webots world: the one range finder to render; all by default."""
    version_exact: bool = False
    """Of a Webots world: the values that the Webots of its header gives, instead of true depth."""
    search_path: tuple[Path, ...] = ()
    """Of a Webots world: folders to look for PROTO files in."""
    quiet: bool = False
    """No progress bar and no summary."""

    def run(self) -> None:
        """Run the command."""
        if self.poses is None:
            self._render_devices()
        else:
            self._render_poses(self.poses)

    def _render_devices(self) -> None:
        from warpvis.cli._webots import is_world, render_world

        if not is_world(self.file):
            raise PoseError(f"give --poses, a file of the camera's poses: {self.file} is no Webots world with cameras")
        render_world(
            self.file,
            self.out,
            device_name=self.device_name,
            version_exact=self.version_exact,
            search_path=self.search_path,
            device=self.device,
            quiet=self.quiet,
        )

    def _render_poses(self, poses: Path) -> None:
        from warpvis.core.camera import Camera
        from warpvis.io import load_camera, read_poses
        from warpvis.rendering import Renderer
        from warpvis.scene import Scene

        camera: Camera = load_camera(self.camera)
        times, rows = read_poses(poses)
        scene = Scene.load(self.file, device=self.device, up=self.up, file_up=self.file_up, scale=self.scale)
        make_folder(self.out / "depth")
        renderer = Renderer(scene, camera, outputs=("depth",))
        too_far = self._write(renderer, times, rows)
        if too_far:
            print(
                f"warning: {too_far} pixels are farther than 65.535 m, which 16 bits of millimetres cannot hold: "
                "they are 0 in the PNG files and right in depth.npz",
                file=sys.stderr,
            )
        if not self.quiet:
            print(f"{len(rows)} views of {scene!r}: {self.out / 'depth.npz'}, {self.out / 'depth'}/*.png")

    def _write(self, renderer: Renderer, times: Any, rows: Any) -> int:
        """Render and write all views, some at a time; the number of pixels that millimetres cannot hold."""
        import numpy as np
        from tqdm import tqdm

        from warpvis.core.poses import poses_to_opencv
        from warpvis.io import DepthArchive, save_depth_png, too_far_for_millimetres

        poses = poses_to_opencv(rows, self.convention, name=str(self.poses)).astype(np.float32)
        camera = renderer.camera
        beside: dict[str, Any] = {"K": camera.to_K(), "camera_to_world": poses, "timestamp": times}
        too_far = 0
        with (
            DepthArchive(self.out / "depth.npz", (len(poses), camera.height, camera.width), **beside) as archive,
            tqdm(total=len(poses), unit="view", disable=self.quiet or not sys.stderr.isatty()) as progress,
        ):
            for start in range(0, len(poses), _VIEWS_AT_A_TIME):
                depth = renderer.render(poses[start : start + _VIEWS_AT_A_TIME]).depth.numpy()
                archive.append(depth)
                too_far += too_far_for_millimetres(depth)
                for index, image in enumerate(depth, start=start):
                    save_depth_png(image, self.out / "depth" / f"{index:06d}.png")
                    progress.update()
        return too_far


@dataclass(frozen=True)
class Info:
    """Print versions, devices and cores; or what a Webots world holds."""

    file: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="FILE")] = None
    """A Webots world, .wbt."""
    search_path: tuple[Path, ...] = ()
    """Folders to look for the world's PROTO files in."""

    def run(self) -> None:
        """Run the command."""
        if self.file is None:
            self._print_versions()
            return
        from warpvis.cli._webots import is_world, print_world

        if not is_world(self.file):
            raise FileFormatError(f"{self.file}: info is of Webots worlds, whose names end in .wbt")
        print_world(self.file, self.search_path)

    def _print_versions(self) -> None:
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


def main() -> None:
    """Entry point: bad input ends with one sentence and exit code 2."""
    commands = Demo | Render | Batch | Verify | Warmup | Check | Perspective | Info
    command = tyro.cli(commands, prog="warpvis", description=_DESCRIPTION)
    try:
        _quiet_warp()
        command.run()
    except WarpvisError as error:
        print(f"warpvis: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        sys.exit(1)


_DESCRIPTION = "What a camera at a pose sees: depth images and 3D visibility, on CPU or CUDA."


def _quiet_warp() -> None:
    """No start-up banner and no line for every kernel module loaded."""
    import warp as wp

    wp.config.log_level = wp.LOG_WARNING
