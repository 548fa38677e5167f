# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots worlds on the command line: what was read of them, and the images of their range finders."""

from __future__ import annotations

import re
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from warpvis.cli._inputs import make_folder
from warpvis.errors import SceneError

if TYPE_CHECKING:
    from warpvis.webots import Device, WebotsWorld


def is_world(path: Path | None) -> bool:
    """Whether a file is a Webots world, by its name."""
    return path is not None and path.suffix.lower() == ".wbt"


def print_world(path: Path, search_path: Sequence[Path]) -> None:
    """The tree of what was read, the devices, and what was left out."""
    world = _load(path, search_path, "cpu")
    print(f"{path}: {world.version}, {world.scene.up} up, {len(world.scene)} objects, {_triangles(world)}")
    print(world.tree)
    for name, device in world.devices.items():
        place = " ".join(f"{value:.4g}" for value in device.pose)
        print(f"device  {name!r} of {device.robot!r}: {device.describe()}; at {place}")
    for name, count in world.skipped.items():
        print(f"left out  {name} ({count})")


def render_world(
    path: Path,
    out: Path,
    *,
    device_name: str | None,
    version_exact: bool,
    search_path: Sequence[Path],
    device: str,
    quiet: bool,
) -> None:
    """Render range finders of a world to OUT/NAME/depth.npz and OUT/NAME/depth/000000.png."""
    from warpvis.webots import find_device, render_range

    world = _load(path, search_path, device)
    names = [name for name, item in world.devices.items() if item.measures]
    if device_name is not None:
        find_device(world, device_name)
        names = [device_name]
    if not names:
        known = ", ".join(map(repr, world.devices)) or "none"
        raise SceneError(f"{path} has no range finder; its devices are: {known}; give --poses and --camera")
    for name in names:
        image = render_range(world, name, webots_version="header" if version_exact else None)
        folder = out / re.sub(r"[^\w .-]|^\.+", "_", name)
        _write(folder, world.devices[name], image)
        if not quiet:
            print(f"{name}: {folder / 'depth.npz'}, {folder / 'depth' / '000000.png'}")


def _load(path: Path, search_path: Sequence[Path], device: str) -> WebotsWorld:
    from warpvis.webots import load_webots

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        world = load_webots(path, device=device, search_path=list(search_path))
    for warning in caught:
        print(f"warning: {warning.message}", file=sys.stderr)
    return world


def _triangles(world: WebotsWorld) -> str:
    return f"{world.scene.triangle_count} triangles"


def _write(folder: Path, device: Device, image: Any) -> None:
    import numpy as np

    from warpvis.io import DepthArchive, save_depth_png

    make_folder(folder / "depth")
    beside: dict[str, Any] = {"camera_to_world": device.pose[None].astype(np.float32), "timestamp": np.zeros(1)}
    if device.projection == "planar":
        beside["K"] = device.camera.to_K()
    else:
        beside |= {"projection": np.array(device.projection), "hfov": np.array(device.fov)}
    with DepthArchive(folder / "depth.npz", (1, *image.shape), **beside) as archive:
        archive.append(image[None])
    save_depth_png(image, folder / "depth" / "000000.png")
