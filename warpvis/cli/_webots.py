# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots worlds on the command line: their content, and images of their range finders and lidars."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpvis.cli._output import make_folder
from warpvis.core.checks import pluralize
from warpvis.core.file_content import writing
from warpvis.errors import SceneError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.core.label_rules import LabelRules
    from warpvis.scene import Scene
    from warpvis.webots import Device, Lidar, WebotsWorld


def is_world(path: Path | None) -> bool:
    """Return whether a file is a Webots world, by its name."""
    return path is not None and path.suffix.lower() == ".wbt"


def print_world(path: Path, *, search_path: Sequence[Path], strict: bool, labels: LabelRules) -> Scene:
    """Print the tree of a world, its devices, and lists of skipped and replaced nodes; return its scene."""
    from warpvis.webots import load_webots

    world = load_webots(path, search_path=search_path, strict=strict, labels=labels)
    triangles = pluralize(world.scene.triangle_count, "triangle")
    print(f"{path}: {world.version}, {world.scene.up} up, {pluralize(len(world.scene), 'object')}, {triangles}")
    print(world.tree)
    devices: dict[str, Mapping[str, Device | Lidar]] = {"device": world.devices, "lidar": world.lidars}
    for kind, named in devices.items():
        for name, item in named.items():
            place = " ".join(f"{value:.4g}" for value in item.pose)
            print(f"{kind}  {name!r} of {item.robot!r}: {item.describe()}; at {place}")
    for kind, counts in (("left out", world.skipped), ("stand-in", world.stand_ins)):
        for name, count in counts.items():
            print(f"{kind}  {name} ({count})")
    return world.scene


def render_world(
    path: Path,
    out: Path,
    *,
    device_name: str | None,
    version_exact: bool,
    quiet: bool,
    threads: int | None,
    device: str,
    search_path: Sequence[Path],
    strict: bool,
) -> bool:
    """Render range finders and lidars of a world.

    Range finders: OUT/NAME/depth.npz and OUT/NAME/depth/000000.png. Lidars: OUT/NAME/ranges.npz and
    OUT/NAME/pcd/000000.pcd. Return whether any of them sees anything; a warning lists those that do not.
    """
    import numpy as np

    from warpvis.webots import load_webots, render_lidar, render_range

    world = load_webots(path, device=device, search_path=search_path, strict=strict)
    finders, lidars = _chosen(world, path, device_name)
    release, blind = "header" if version_exact else None, []
    kinds: list[tuple[Any, ...]] = [
        (finders, world.devices, render_range, _write, ("depth.npz", "depth/000000.png")),
        (lidars, world.lidars, render_lidar, _write_scan, ("ranges.npz", "pcd/000000.pcd")),
    ]
    for names, devices, render, write, files in kinds:
        for name in names:
            image = render(world, name, webots_version=release, threads=threads)
            folder = out / re.sub(r"[^\w .-]|^\.+", "_", name)
            write(folder, devices[name], image, version_exact)
            # Some versions of Webots return the maximum range for no hit.
            if not (np.isfinite(image) & (image < devices[name].max_range)).any():
                blind.append(name)
            if not quiet:
                print(f"{name}: {', '.join(str(folder / file) for file in files)}")
    if blind:
        names, sees = ", ".join(map(repr, blind)), "sees nothing in its" if len(blind) == 1 else "see nothing in their"
        count = pluralize(len(finders) + len(lidars), "device")
        warnings.warn(f"{len(blind)} of {count} {sees} range: {names}", stacklevel=2)
    return len(blind) < len(finders) + len(lidars)


def _chosen(world: WebotsWorld, path: Path, name: str | None) -> tuple[list[str], list[str]]:
    """Return the range finders and the lidars to render: all of them, or the given one."""
    from warpvis.webots import find_device

    if name in world.lidars and name not in world.devices:
        return [], [name]
    if name is not None:
        find_device(world, name)
        return [name], []
    finders = [known for known, item in world.devices.items() if item.measures]
    if not finders and not world.lidars:
        known = ", ".join(map(repr, world.devices)) or "none"
        raise SceneError(f"{path} has no range finder or lidar; its devices are: {known}; give --poses and --camera")
    return finders, list(world.lidars)


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
