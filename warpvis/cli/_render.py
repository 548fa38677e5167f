# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis render``: images and pictures of them, or point clouds of a lidar, along poses."""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from warpvis.cli._datasets import ImageOptions, color_options, print_summary
from warpvis.cli._info import is_world
from warpvis.cli._inputs import (
    MaybePoses,
    Names,
    SceneFile,
    given_options,
    refuse_options,
    scene_options,
    split_names,
    viewpoint_options,
)
from warpvis.cli._lidars import choose_turns, find_lidar, parse_noise
from warpvis.cli._output import make_folder, with_help
from warpvis.core.checks import check_choice, pluralize
from warpvis.core.file_content import writing
from warpvis.errors import FileFormatError, PoseError, SceneError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.batch import Format, FrameDataset
    from warpvis.cameras import ImageCamera, Rays
    from warpvis.cameras.frames import Frames
    from warpvis.cameras.pinhole import Camera
    from warpvis.rendering import Output
    from warpvis.scene import Scene
    from warpvis.sensors import LidarNoise
    from warpvis.sensors.lidars import Livox
    from warpvis.webots import Device, Lidar, WebotsWorld

_FRAMES = (*viewpoint_options[len(scene_options) :], "movable", "worlds")
_IMAGES = ("outputs", "option", "sensor", "sensor_seed", "sensor_vary")

_CLOUD_FORMATS = ("bin", "pcd", "ply", "las", "npy")
"""File formats of point clouds."""

_CLOUD_OUTPUTS: tuple[Output, ...] = ("depth", "labels", "segmentation")
_RAYS_AT_ONCE = 2**22
_NOT_OF_LIDARS = ("camera", "replace_camera", "convention", "objects", "outputs", "option", "sensor", "sensor_vary")
_OF_DEVICES = ("device_name", "version_exact")

_PREVIEWS, _SHEET = "preview", "contact_sheet.png"
"""Names of the folder and the file of pictures."""

_MAX_PREVIEWS, _MAX_ON_SHEET = 100, 24


@with_help
@dataclass(frozen=True, kw_only=True)
class Render(ImageOptions):
    """Render depth images: OUT/npz in meters, OUT/png in millimeters (16 bit, 0 for no depth), or other formats.

    A Webots world can be rendered without --poses: its range finders to OUT/NAME/depth.npz and OUT/NAME/depth, its
    lidars to OUT/NAME/ranges.npz and OUT/NAME/pcd, and its cameras to OUT/NAME/color.
    """

    file: SceneFile
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Output folder; each format is written to a subfolder, which must be new or empty."""
    poses: MaybePoses = None
    format: Names = ("npz", "png")
    """npz, zarr, png, tum, bop, nerfstudio, colmap, ply or ros2; with --lidar bin, pcd, ply, las or npy, pcd by
    default."""
    lidar: Annotated[str | None, tyro.conf.arg(metavar="NAME|FILE")] = None
    """Render point clouds of a lidar instead of images: vlp16, vlp32c, hdl32e, hdl64e, vls128, pandar64, xt32, qt128,
    at128, bpearl, rplidar-a1 to -a3 or -s2, os1-128, -64-u or -32 and others of Ouster, an Ouster metadata file
    (.json), or mid360:FILE and other Livox models. Poses are of its frame: x forward, y left, z up."""
    lidar_noise: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE,...")] = ()
    """With --lidar: its noise, by parameters of warpvis.sensors.LidarNoise that are numbers, such as
    sigma=0.02,dropout=0.01,detection_range=40. --sensor-seed is the seed of the random numbers."""
    moving: bool = False
    """With --lidar: move the lidar along the poses, by their timestamps, while it measures. Renders one cloud per pose
    from which a whole revolution fits, as measured: each point is in the lidar's frame at its time."""
    device: str = "cpu"
    """Device to compute on: cpu, cuda:0, ..."""
    device_name: str | None = None
    """Webots worlds only: name of the range finder, lidar or camera to render; all by default. A camera by name gets
    depth, too."""
    pictures: bool = True
    """Also write colored depth: OUT/preview, of the first hundred frames, and OUT/contact_sheet.png."""
    version_exact: bool = False
    """Webots worlds only: values as computed by the Webots version in the world's header, instead of true depth."""

    def run(self) -> None:
        if self.lidar is not None:
            self._render_clouds(self.lidar)
        elif self.moving:
            raise PoseError("--moving requires --lidar")
        elif self.lidar_noise:
            raise PoseError("--lidar-noise requires --lidar")
        elif self.poses is not None or self.frame:
            refuse_options(self, _OF_DEVICES, "with --poses or --frame no device is rendered: give")
            self._render_poses(self.poses)
        elif not is_world(self.file):
            raise PoseError(
                f"give --poses, a file of camera poses, or --frame: {self.file} is not a Webots world with cameras"
            )
        else:
            scene = ("labels", "label_names", "up", "scale", "file_up", "show_environment", "exclude", "objects")
            refuse_options(self, (*_FRAMES, *_IMAGES, "format", *scene), "a world's devices have their own poses: give")
            self._render_world()

    def _render_world(self) -> None:
        """Render range finders, lidars and cameras of a Webots world; warn of those that see nothing in their range."""
        import numpy as np

        from warpvis.webots import load_webots, render_color, render_lidar, render_range

        world = load_webots(self.file, device=self.device, search_path=self.folders(), strict=self.strict)
        finders, lidars, cameras = self._choose_devices(world)
        if not cameras:
            refuse_options(self, color_options, "without cameras no colors are rendered: give")
        release, blind = "header" if self.version_exact else None, []
        kinds: list[tuple[Any, ...]] = [
            (finders, world.devices, render_range, _write, ("depth.npz", "depth/000000.png")),
            (lidars, world.lidars, render_lidar, _write_scan, ("ranges.npz", "pcd/000000.pcd")),
        ]
        for names, devices, render, write, files in kinds:
            for name in names:
                image = render(world, name, webots_version=release, threads=self.threads)
                folder = self._folder_of(name)
                write(folder, devices[name], image, self.version_exact)
                # Some versions of Webots return the maximum range for no hit.
                if not (np.isfinite(image) & (image < devices[name].max_range)).any():
                    blind.append(name)
                if not self.quiet:
                    print(f"{name}: {', '.join(str(folder / file) for file in files)}")
        for name in cameras:
            path = self._folder_of(name) / "color" / "000000.png"
            _write_color(path, render_color(world, name, threads=self.threads, **self.colors()))
            if not self.quiet:
                print(f"{name}: {path}")
        if blind:
            count = pluralize(len(finders) + len(lidars), "device")
            sees = "sees nothing in its" if len(blind) == 1 else "see nothing in their"
            warnings.warn(f"{len(blind)} of {count} {sees} range: {', '.join(map(repr, blind))}", stacklevel=2)
        self.end(empty=0 < len(blind) == len(finders) + len(lidars))

    def _folder_of(self, name: str) -> Path:
        """Return the folder of a device."""
        return self.out / re.sub(r"[^\w .-]|^\.+", "_", name)

    def _choose_devices(self, world: WebotsWorld) -> tuple[list[str], list[str], list[str]]:
        """Return the range finders, lidars and cameras to render: all of them, or the given one."""
        from warpvis.webots import find_device

        name = self.device_name
        if name in world.lidars and name not in world.devices:
            return [], [name], []
        if name is not None:
            return [name], [], [] if find_device(world, name).measures else [name]
        if not world.devices and not world.lidars:
            raise SceneError(f"{self.file} has no range finder, lidar or camera; give --poses and --camera")
        finders = [known for known, item in world.devices.items() if item.measures]
        return finders, list(world.lidars), [known for known in world.devices if known not in finders]

    def _render_clouds(self, name: str) -> None:
        """Write a cloud of every frame, OUT/pcd/000000.pcd and so on."""
        from warpvis.io import save_clouds
        from warpvis.pose_generators import looks_like_spec

        refused = (*_NOT_OF_LIDARS, *color_options, *_OF_DEVICES)
        refuse_options(self, refused, "with --lidar no camera is rendered: give")
        if not self.lidar_noise:
            refuse_options(self, ("sensor_seed",), "without --lidar-noise, give")
        noise = parse_noise(self.lidar_noise)
        if self.poses is None:
            raise PoseError("give --poses with --lidar, a file of the lidar's poses: x forward, y left, z up")
        if looks_like_spec(self.poses):
            raise PoseError(
                "--poses with --lidar must be a file of the lidar's poses, x forward, y left, z up, got "
                f"{self.poses!r}, which generates camera poses"
            )
        lidar = find_lidar(name)
        formats = split_names(self.format) if given_options(self, ("format",)) else ["pcd"]
        for kind in formats:
            check_choice(kind, "--format with --lidar", _CLOUD_FORMATS, FileFormatError)
            if (self.out / kind).exists() and any((self.out / kind).iterdir()):
                raise FileFormatError(f"{self.out / kind}: exists already; give a new or empty folder")
        scene, _, frames = self.load(self.file, self.poses, device=self.device)
        if frames.camera is not None:
            raise PoseError(f"{self.poses} contains a camera's poses, but a lidar's are x forward, y left, z up")
        turns = len(choose_turns(frames, lidar)) if self.moving else len(frames)
        began, points = time.perf_counter(), 0
        for place, cloud in enumerate(self._clouds(scene, frames, lidar, turns, noise)):
            points += len(cloud)
            for kind in formats:
                save_clouds(self.out / kind, [cloud], f".{kind}", first=place)
        if not self.quiet:
            folders, seconds = ", ".join(str(self.out / kind) for kind in formats), time.perf_counter() - began
            of = f" of {pluralize(len(frames), 'pose')}" if self.moving else ""
            print(
                f"clouds: {pluralize(turns, 'frame')}{of}, {pluralize(points, 'point')}, in {seconds:.1f} s: {folders}"
            )
        self.end(empty=not points)

    def device_camera(self) -> Camera | None:
        """Return the sensor's camera; a lidar has none."""
        return super().device_camera() if self.lidar is None else None

    def _clouds(
        self, scene: Scene, frames: Frames, lidar: Rays | Livox, turns: int, noise: LidarNoise | None
    ) -> Iterator[np.ndarray]:
        """Render the clouds in batches; a Livox has different rays in every frame."""
        import numpy as np

        from warpvis.cameras import Rays
        from warpvis.rendering import Renderer
        from warpvis.sensors import Motion, point_clouds

        prepare = partial(
            Renderer, scene, outputs=_CLOUD_OUTPUTS, threads=self.threads, sensor=noise, seed=self.sensor_seed
        )
        renderer, step = None, 1
        if isinstance(lidar, Rays):
            renderer, step = prepare(lidar), max(_RAYS_AT_ONCE // len(lidar), 1)
        for first in range(0, turns, step):
            part = frames[first : min(first + step, turns)]
            rays = lidar if isinstance(lidar, Rays) else lidar.frame(first)
            moves = self.moving and Motion(frames.camera_to_world, frames.timestamps, starts=part.timestamps)
            # Random numbers must not depend on the size of batches.
            numbers: dict[str, Any] = {
                "frame": np.arange(first, first + len(part)),
                "view_index": np.zeros(len(part), dtype=np.int64),
            }
            views = (renderer or prepare(rays)).render(
                moves or part.camera_to_world,
                object_poses=part.object_poses,
                world_index=part.world_index,
                exclude=split_names(self.exclude) or None,
                **(numbers if noise else {}),
            )
            yield from point_clouds(views, rays)

    def _render_poses(self, poses: str | None) -> None:
        from warpvis.batch import find_format, open_dataset, render_batch

        formats = dict.fromkeys(split_names(self.format))
        kinds = {name: find_format(name) for name in formats}
        if not kinds:
            raise FileFormatError("--format must name a format, got none")
        chosen = self.chosen()
        # Each format gets the options that it has; the first one refuses those that none has.
        known = {option for kind in kinds.values() for option in kind.options}
        given = chosen.pop("options")
        options = {
            name: {option: given[option] for option in given if option in kind.options or option not in known}
            for name, kind in kinds.items()
        }
        scene, camera, frames = self.load(self.file, poses, device=self.device)
        for name, kind in kinds.items():
            self._check(kind, scene, camera, frames, {**chosen, "options": options[name]})
        empty = False
        for name in kinds:
            summary = render_batch(
                scene,
                camera,
                frames,
                self.out / name,
                format=name,
                threads=self.threads,
                quiet=self.quiet,
                source=self.file.name,
                options=options[name],
                **chosen,
                **self.colors(),
            )
            print_summary(summary, name, quiet=self.quiet)
            empty = empty or summary.empty_frames == summary.frames
        pictured = next((name for name in ("npz", "zarr", "png") if name in kinds), None)
        if self.pictures and pictured is not None:
            dataset = open_dataset(self.out / pictured)
            if "depth" in dataset.outputs:
                written = _write_pictures(dataset, self.out)
                if not self.quiet:
                    print(written)
        self.end(empty=empty)

    def _check(
        self, kind: type[Format], scene: Scene, camera: ImageCamera, frames: Frames, chosen: dict[str, Any]
    ) -> None:
        """Raise the errors of all formats before anything is written."""
        from warpvis.batch import make_plan

        kind(make_plan(scene, camera, frames, kind, **chosen))
        folder = self.out / kind.name
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise FileFormatError(f"{folder}: exists already; give a new or empty folder")
        for picture in (self.out / _PREVIEWS, self.out / _SHEET):
            if self.pictures and picture.exists():
                raise FileFormatError(f"{picture}: exists already, from another run; give a new or empty folder")


def _write_pictures(dataset: FrameDataset, out: Path) -> str:
    """Write pictures of the first hundred frames' depth and a contact sheet of two dozen frames; return their list.

    All share one color scale, from the minimum to the maximum of the depth they show; if there is no depth, the
    camera's range.
    """
    import numpy as np

    from warpvis.viz import save_contact_sheet, save_preview

    count = len(dataset)
    first = range(min(count, _MAX_PREVIEWS))
    spread = sorted({round(place) for place in np.linspace(0, count - 1, min(count, _MAX_ON_SHEET))})
    min_depth, max_depth = np.inf, -np.inf
    for index in {*first, *spread}:
        seen = dataset.read("depth", index)
        seen = seen[np.isfinite(seen)]
        if seen.size:
            min_depth, max_depth = min(min_depth, float(seen.min())), max(max_depth, float(seen.max()))
    near, far = dataset.camera.near, dataset.camera.far
    camera_range = (near, far if np.isfinite(far) else near + 1)
    depth_range = (min_depth, max_depth) if min_depth <= max_depth else camera_range
    (out / _PREVIEWS).mkdir()
    for index in first:
        save_preview(dataset.read("depth", index), out / _PREVIEWS / f"{index:06d}.png", depth_range)
    names = [f"{index:06d}" for index in spread]
    save_contact_sheet([dataset.read("depth", index) for index in spread], names, out / _SHEET, depth_range)
    extent = "" if count == len(first) else f" of the first {pluralize(len(first), 'frame')}"
    return f"{out / _PREVIEWS}{extent}, {out / _SHEET}"


def _write(folder: Path, device: Device, image: NDArray[np.float32], bent: bool) -> None:
    """Write an image; if the device's lens distorts it, with the lens instead of K, which describes a pinhole only."""
    import numpy as np

    from warpvis.io import save_depth_png

    make_folder(folder / "depth")
    arrays: dict[str, NDArray[np.generic]] = {"depth": image[None], "timestamps": np.zeros(1)}
    arrays["camera_to_world"] = device.pose[None].astype(np.float32)
    if bent and device.bends and device.lens is not None:
        lens = device.lens
        arrays |= {"hfov": np.array(device.fov), "lens": np.array([lens.center, lens.radial, lens.tangential])}
    elif device.projection == "planar":
        arrays["K"] = device.camera.to_K()
    else:
        arrays |= {"projection": np.array(device.projection), "hfov": np.array(device.fov)}
    _write_arrays(folder / "depth.npz", arrays)
    save_depth_png(image, folder / "depth" / "000000.png")


def _write_color(path: Path, image: NDArray[np.uint8]) -> None:
    """Write a color image."""
    from PIL import Image

    make_folder(path.parent)
    with writing(path):
        Image.fromarray(image).save(path)


def _write_scan(folder: Path, lidar: Lidar, image: NDArray[np.float32], drawn: bool) -> None:
    """Write a range image with its rays, and its point cloud in the lidar's frame."""
    import numpy as np
    import warp as wp

    from warpvis.io import save_clouds
    from warpvis.rendering import Views
    from warpvis.sensors import point_clouds

    make_folder(folder)
    rays = lidar.drawn_rays if drawn else lidar.rays
    lengths = image
    if drawn and lidar.projection == "planar" and not lidar.rotates:
        lengths = (image / lidar.cosines()).astype(np.float32)
    arrays: dict[str, NDArray[np.generic]] = {"ranges": image, "directions": rays.directions}
    arrays["lidar_to_world"] = lidar.pose
    _write_arrays(folder / "ranges.npz", arrays)
    # Some versions of Webots return the maximum range for no hit.
    found = np.where(image < lidar.max_range, lengths, np.float32(np.inf))
    save_clouds(folder / "pcd", point_clouds(Views(depth=wp.array(found[None], device="cpu")), rays), ".pcd")


def _write_arrays(path: Path, arrays: dict[str, NDArray[np.generic]]) -> None:
    from warpvis.batch import npz_parts

    with writing(path):
        path.write_bytes(b"".join(npz_parts(arrays)))
