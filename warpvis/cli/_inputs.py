# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Options that the commands share: scenes, cameras and poses. Heavy packages are imported only when called."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from warpvis.cli._output import with_help
from warpvis.core.checks import pluralize
from warpvis.errors import CameraError, FileFormatError, PoseError, SceneError, WarpvisError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.cameras import ImageCamera
    from warpvis.cameras.frames import Frames
    from warpvis.cameras.pinhole import Camera
    from warpvis.core.labels import LabelRules
    from warpvis.core.poses import QuaternionOrder
    from warpvis.scene import Scene
    from warpvis.scenes import Experiment

_MAX_DIGITS = 10

Axes = Literal["opencv", "opengl", "ros_body", "ros_optical"]
PoseFormat = Literal["tum", "npy", "npz", "csv", "parquet", "nerfstudio", "bop", "colmap", "ros"]

_FILES = "A mesh file (OBJ, STL, PLY, GLB, ...), a Webots world (.wbt), MJCF (.xml) or URDF (.urdf, .xacro)"
FILE_HELP = f"{_FILES}; or experiment_1 to experiment_4 of the demo."
_POSES = (
    "Camera poses, camera to world: a file (TUM text, .npy, .npz, .csv, .parquet, transforms.json, scene_camera.json, "
    "COLMAP's images.txt or .bin, a ROS bag), or a generator: "
    '"orbit target=0,0,0.5 radius=2 height=1 count=360", "random count=1000 seed=1 clearance=0.3".'
)

SceneFile = Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE", help=FILE_HELP)]
"""The argument FILE."""
MaybeSceneFile = Annotated[Path | None, tyro.conf.Positional, tyro.conf.arg(metavar="[FILE]", help=FILE_HELP)]
"""The optional argument FILE."""
Poses = Annotated[str, tyro.conf.arg(metavar="FILE|SPEC", help=_POSES)]
"""The option --poses."""
MaybePoses = Annotated[str | None, tyro.conf.arg(metavar="FILE|SPEC", help=_POSES)]
"""The option --poses if it may be omitted."""
Names = Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME,...")]
"""Names separated by commas or spaces; a name that contains spaces must be quoted in the shell."""


@with_help
@dataclass(frozen=True, kw_only=True)
class SceneOptions:
    """Options for reading a scene file."""

    labels: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=LABEL,...|FILE")] = ()
    """Labels of objects: "ball=object,wall_*=obstacle,road_*=40"; or a JSON, TOML or YAML file of names or patterns and
    their labels, or with labels, label_names and ground_labels."""
    label_names: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NUMBER=NAME,...")] = ()
    """Names of user-defined classes, from 0 to 255: "40=road,252=moving car"."""
    scale: float = 1.0
    """Meters per unit of a mesh file (0.001 for millimeters)."""
    up: Literal["z", "y"] | None = None
    """The scene's vertical axis; by default that of the Webots world, else z."""
    file_up: Literal["z", "y"] | None = None
    """A mesh file's vertical axis; by default y for glTF, and the scene's for other formats."""
    search_path: Annotated[tuple[str, ...], tyro.conf.arg(metavar="DIR,...")] = ()
    """Folders to search for referenced files: PROTO files, meshes, packages, includes."""
    strict: bool = False
    """Treat unsupported content as an error; by default a warning lists it."""
    show_environment: bool = False
    """Show the images of a glTF file's image-based light behind surfaces in color images."""

    def label_rules(self) -> LabelRules:
        """Parse --labels and --label-names."""
        from warpvis.core.labels import LABEL_FILES, LabelRules

        rules = LabelRules()
        for word in split_pairs(self.labels):
            is_file = "=" not in word and word.lower().endswith(LABEL_FILES)
            rules = rules.followed_by(LabelRules.of(word if is_file else _parse_label(word)))
        return LabelRules.of(rules, _parse_label_names(split_pairs(self.label_names)))

    def folders(self) -> list[Path]:
        """Return the folders of --search-path: an item is one existing folder, or several separated by commas."""
        return [
            Path(part) for word in self.search_path for part in ([word] if Path(word).is_dir() else split_names([word]))
        ]

    def load_scene(self, file: Path, *, device: str = "cpu", movable: bool | Sequence[str] = False) -> Scene:
        """Load the scene: a file, or an experiment of the demo."""
        from warpvis.scene import Scene

        experiment = find_experiment(file)
        if experiment is not None:
            refuse_options(self, scene_options, f"{experiment.name} is not a file, so it takes")
            if movable:
                raise SceneError(f"{experiment.name} has no movable objects, so it takes no --movable")
            return experiment.build(device)
        return Scene.load(
            file,
            device=device,
            up=self.up,
            file_up=self.file_up,
            scale=self.scale,
            labels=self.label_rules(),
            movable=movable,
            search_path=self.folders(),
            strict=self.strict,
            show_environment=self.show_environment,
        )


@with_help
@dataclass(frozen=True, kw_only=True)
class ViewpointOptions(SceneOptions):
    """Options for reading a scene, a camera and poses."""

    camera: Annotated[str | None, tyro.conf.arg(metavar="kinect|FILE")] = None
    """kinect, or a file: JSON with width, height, hfov (radians) or K, near and far (meters); transforms.json, BOP's
    camera.json, COLMAP's cameras.txt or .bin, or a calibration of OpenCV, ROS, Kalibr, camodocal, ORB-SLAM, Basalt,
    OCamCalib, RealSense or NVIDIA, with the lens if it has one; FILE:NAME if it has several cameras. By default the
    camera in the pose file, else kinect."""
    distortion: bool = True
    """Render with the camera's lens distortion; if disabled, as a pinhole with the same intrinsics (for ROS, those of
    the rectified images)."""
    replace_camera: bool = False
    """Use --camera although the pose file defines a different one."""
    convention: Axes | None = None
    """Axes of the camera frame of the poses; by default those of the pose file's format."""
    quaternion: Literal["xyzw", "wxyz"] = "xyzw"
    """Order of the quaternions in poses given as 7 numbers, and in .npy and .npz files."""
    file_format: PoseFormat | None = None
    """The pose file's format, if its name does not determine it."""
    topic: str | None = None
    """ROS bags only: the topic of the poses."""

    def read_poses(self, path: str) -> Frames:
        """Read a pose file, with quaternions in the order of `quaternion` if its format does not define the order."""
        from warpvis.io import read_frames

        quaternion = self.quaternion if self.orders(path) else "xyzw"
        return read_frames(
            path,
            convention=self.convention,
            quaternion=quaternion,
            file_format=self.file_format,
            topic=self.topic,
            distortion=self.distortion,
        )

    def device_camera(self) -> Camera | None:
        """Return the default camera if neither an option nor a pose file defines one; None for the Kinect."""
        return None

    def choose_camera(self, frames: Frames | None = None) -> ImageCamera:
        """Load the camera: the given one, that of the pose file, or the Kinect."""
        from warpvis.cameras import require_image_camera
        from warpvis.io import load_camera

        camera = None if self.camera is None else load_camera(self.camera, distortion=self.distortion)
        stored = None if frames is None else frames.camera
        if self.replace_camera and (camera is None or stored is None):
            raise CameraError("--replace-camera requires a pose file that defines a camera, and another --camera")
        if frames is None or stored is None or self.replace_camera:
            return (self.device_camera() or load_camera("kinect")) if camera is None else camera
        return require_image_camera(frames.choose_camera(camera))

    def orders(self, path: str) -> bool:
        """Return whether `quaternion` has an effect on a pose file."""
        from warpvis.io import leaves_order_open

        return leaves_order_open(Path(path), self.file_format)

    def load_pose(self, text: str, option: str, up: str) -> NDArray[np.float64]:
        """Read one pose: six numbers (eye and target), seven numbers (a row), or a file with one pose.

        A row has the axes of `convention` and the order of `quaternion`; for eye and target, the scene's vertical axis
        `up` points up in the image. Return a row ``x y z qx qy qz qw`` in the OpenCV frame, shape ``(7,)``.
        """
        from warpvis.core.poses import look_at, poses_to_opencv, to_xyzw

        numbers = _numbers(text)
        if len(numbers) == 7:
            pose = to_xyzw(numbers, self.quaternion, option)
            return poses_to_opencv(pose, self.convention or "opencv", name=option)[0]
        if len(numbers) == 6:
            try:
                return look_at(numbers[:3], numbers[3:], up=up)
            except PoseError as error:
                raise PoseError(f"{option}: {error}") from None
        if not numbers and os.path.exists(text):
            frames = self.read_poses(text)
            if len(frames) != 1:
                raise PoseError(f"{option} must be one pose, and {text} holds {len(frames)}")
            return frames.camera_to_world[0]
        raise PoseError(
            f"{option} must be 6 numbers, eye and target, 'x y z tx ty tz' [m], a pose of 7, 'x y z qx qy qz qw', "
            f"or a file of one pose, got {text!r}"
        )


@with_help
@dataclass(frozen=True, kw_only=True)
class FrameOptions(ViewpointOptions):
    """Options for reading a scene, a camera and frames."""

    frame: bool = False
    """Instead of --poses: use one pose from which the whole scene is in the image, at any range without --camera.
    Ground that is much larger than everything else is cut off."""
    movable: Names = ()
    """Names or patterns of the objects that are placed by --worlds or by object_poses of the pose file, in the file's
    order; or the single word model for the moving bodies of MJCF or URDF, one pose per body. Write [m]odel for an
    object of that name."""
    worlds: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Poses of the movable objects: .npz with object_poses, rows x y z qx qy qz qw of shape (W, M, 7), for mesh files
    relative to the file's frame; and, unless there is one world per frame, world_index of shape (frames,)."""

    def load(self, file: Path, poses: str | None, *, device: str = "cpu") -> tuple[Scene, ImageCamera, Frames]:
        """Load scene, camera and frames."""
        frames = self._read_frames(poses)
        names = split_names(self.movable)
        scene = self.load_scene(file, device=device, movable=names == [_BY_MODEL] or names)
        if frames is None:
            frames = self._make_frames(poses, scene)
        if self.worlds is not None:
            frames = _with_worlds(frames, self.worlds, self.quaternion)
        placed = 0 if frames.object_poses is None else frames.object_poses.shape[1]
        if self.movable and not placed:
            raise SceneError("--movable has no effect without poses of objects: give --worlds")
        if placed and placed != len(scene.movable):
            raise PoseError(
                f"the frames have poses of {pluralize(placed, 'object')}, but the scene has {len(scene.movable)} "
                "that are movable; name them with --movable"
            )
        camera = self.choose_camera(frames)
        return scene, camera, replace(frames, camera=None) if self.replace_camera else frames

    def _read_frames(self, poses: str | None) -> Frames | None:
        """Read a file of poses; None for poses that are generated from the scene."""
        from warpvis.pose_generators import looks_like_spec

        if (poses is None) != self.frame:
            raise PoseError("give either --poses or --frame, one pose from which all of the scene is seen")
        if poses is None or looks_like_spec(poses):
            refuse_options(self, ("convention", "file_format", "topic"), "generated poses take")
            if self.worlds is None:
                refuse_options(self, ("quaternion",), "generated poses take")
            return None
        if self.worlds is None and not self.orders(poses):
            reason = f"poses in {poses}, whose format defines the order, take"
            refuse_options(self, ("quaternion",), reason)
        return self.read_poses(poses)

    def _make_frames(self, poses: str | None, scene: Scene) -> Frames:
        """Generate poses from a scene: those of a specification, or one that sees the whole scene."""
        from warpvis.cameras.frames import Frames
        from warpvis.pose_generators import frames_from_spec, framing

        if poses is not None:
            return frames_from_spec(poses, scene, up=scene.up)
        camera = self.choose_camera()
        if self.camera is None and self.device_camera() is None:
            camera = replace(camera, near=0.0, far=math.inf)
        stored = camera if self.camera is None else None
        return Frames.from_poses(framing(scene, camera), camera=stored, source={"made": "framing"})


scene_options = tuple(field.name for field in fields(SceneOptions))
"""Names of the options for reading a scene file."""
viewpoint_options = tuple(field.name for field in fields(ViewpointOptions))
"""Names of the options for reading a scene, a camera and poses."""


_NEXT_PAIR = re.compile(",(?=[^,=]+=|$)")

_BY_MODEL = "model"
"""Value of --movable that selects the moving bodies of the model."""


def find_experiment(file: Path) -> Experiment | None:
    """Return the experiment of the demo with this name, if no such file exists."""
    if file.exists():
        return None
    from warpvis.scenes import EXPERIMENTS

    return next((experiment for experiment in EXPERIMENTS if experiment.name == str(file)), None)


def given_options(command: SceneOptions, names: Sequence[str]) -> list[str]:
    """Return the names of options that differ from their defaults."""
    defaults = {field.name: field.default for field in fields(command)}
    return [name for name in names if getattr(command, name) != defaults[name]]


def refuse_options(command: SceneOptions, names: Sequence[str], reason: str) -> None:
    """Raise an error if options are given that have no effect."""
    changed = given_options(command, names)
    if changed:
        listed = ", ".join(
            ("--no-" if getattr(command, name) is False else "--") + name.replace("_", "-") for name in changed
        )
        raise SceneError(f"{reason} no {listed}")


def check_viewpoints(command: ViewpointOptions, texts: Sequence[str]) -> None:
    """Raise an error if options have no effect on poses given to `ViewpointOptions.load_pose`."""
    counts = [len(_numbers(text)) for text in texts]
    if all(counts):
        refuse_options(command, ("file_format", "topic"), "poses given as numbers take")
    if all(count == 6 for count in counts):
        refuse_options(command, ("convention",), "poses given by eye and target take")
    if not any(count == 7 or (not count and command.orders(text)) for count, text in zip(counts, texts, strict=True)):
        refuse_options(
            command, ("quaternion",), "poses given by eye and target, or in formats that define the order, take"
        )


def _numbers(text: str) -> list[float]:
    """Return the numbers of a text; an empty list if it is something else."""
    try:
        return [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        return []


def is_numbers(text: str) -> bool:
    """Return whether a text is one or more numbers."""
    return bool(_numbers(text))


def split_names(words: Sequence[str]) -> list[str]:
    """Split names at commas."""
    return [name.strip() for word in words for name in word.split(",") if name.strip()]


def split_pairs(words: Sequence[str]) -> list[str]:
    """Split words ``name=value`` at commas that are followed by another name."""
    return [part.strip() for word in words for part in _NEXT_PAIR.split(word) if part.strip()]


def _parse_label(word: str) -> dict[str, str]:
    """Parse a label by name or pattern, ``name=label``."""
    name, _, label = word.rpartition("=")
    if not (name and label):
        raise SceneError(f"labels must be given as NAME=LABEL, such as ball=object, or as a file of them, got {word!r}")
    return {name: label}


def _parse_label_names(words: Sequence[str]) -> dict[int, str]:
    """Parse names of classes, ``number=name``."""
    names: dict[int, str] = {}
    for word in words:
        number, equals, name = word.partition("=")
        if not (equals and name and number.isascii() and number.isdigit() and len(number) < _MAX_DIGITS):
            raise SceneError(f"label names must be given as NUMBER=NAME, such as 40=road, got {word!r}")
        names[int(number)] = name
    return names


def _with_worlds(frames: Frames, path: Path, quaternion: QuaternionOrder) -> Frames:
    """Return the frames with the objects' poses from a file."""
    from warpvis.cameras.frames import Frames
    from warpvis.core.poses import to_xyzw
    from warpvis.io import read_archive

    found = read_archive(path, ("object_poses", "world_index"), "object_poses")
    try:
        objects = to_xyzw(found["object_poses"], quaternion, "object_poses")
        worlds = found.get("world_index")
        moved = Frames.from_poses(frames.camera_to_world, object_poses=objects, world_index=worlds)
    except WarpvisError as error:
        raise FileFormatError(f"{path}: {error}") from None
    source = {**frames.source, "worlds": path.name}
    return replace(frames, object_poses=moved.object_poses, world_index=moved.world_index, source=source)
