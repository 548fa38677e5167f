# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Webots worlds on the command line: what was read of them, and the images of their range finders."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from warpvis.cli._output import make_folder
from warpvis.core.checks import counted
from warpvis.errors import FileFormatError, SceneError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from warpvis.core.label_rules import LabelRules
    from warpvis.scene import Scene
    from warpvis.webots import Device


def is_world(path: Path | None) -> bool:
    """Tell whether a file is a Webots world, by its name."""
    return path is not None and path.suffix.lower() == ".wbt"


def print_world(path: Path, *, search_path: Sequence[Path], strict: bool, labels: LabelRules) -> Scene:
    """Print the tree of what was read, the devices, what was left out and what has stand-ins.

    See `load_webots` for the arguments.

    Returns:
        The scene.
    """
    from warpvis.webots import load_webots

    world = load_webots(path, search_path=search_path, strict=strict, labels=labels)
    triangles = counted(world.scene.triangle_count, "triangle")
    print(f"{path}: {world.version}, {world.scene.up} up, {counted(len(world.scene), 'object')}, {triangles}")
    print(world.tree)
    for name, device in world.devices.items():
        place = " ".join(f"{value:.4g}" for value in device.pose)
        print(f"device  {name!r} of {device.robot!r}: {device.describe()}; at {place}")
    for name, count in world.skipped.items():
        print(f"left out  {name} ({count})")
    for name, count in world.stand_ins.items():
        print(f"stand-in  {name} ({count})")
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
    """Render range finders of a world to OUT/NAME/depth.npz and OUT/NAME/depth/000000.png.

    Returns:
        Whether any of them sees anything; a warning names those that do not.
    """
    from warpvis.webots import find_device, load_webots, render_range

    world = load_webots(path, device=device, search_path=search_path, strict=strict)
    names = [name for name, item in world.devices.items() if item.measures]
    if device_name is not None:
        find_device(world, device_name)
        names = [device_name]
    if not names:
        known = ", ".join(map(repr, world.devices)) or "none"
        raise SceneError(f"{path} has no range finder; its devices are: {known}; give --poses and --camera")
    blind = []
    for name in names:
        image = render_range(world, name, webots_version="header" if version_exact else None, threads=threads)
        folder = out / re.sub(r"[^\w .-]|^\.+", "_", name)
        _write(folder, world.devices[name], image, bent=version_exact)
        if not _sees(image, world.devices[name]):
            blind.append(name)
        if not quiet:
            print(f"{name}: {folder / 'depth.npz'}, {folder / 'depth' / '000000.png'}")
    if blind:
        some, sees = ", ".join(map(repr, blind)), "sees" if len(blind) == 1 else "see"
        warnings.warn(
            f"{len(blind)} of {counted(len(names), 'range finder')} {sees} nothing in their range: {some}", stacklevel=2
        )
    return len(blind) < len(names)


def _sees(image: NDArray[np.float32], device: Device) -> bool:
    """Tell whether an image shows anything nearer than the range ends; some versions of Webots say that for nothing."""
    import numpy as np

    return bool((np.isfinite(image) & (image < device.max_range)).any())


def _write(folder: Path, device: Device, image: NDArray[np.float32], *, bent: bool) -> None:
    """Write an image, in which the device's lens has its part if it is bent: a pinhole's K does not say that."""
    import numpy as np

    from warpvis.batch import npz_parts
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
    try:
        (folder / "depth.npz").write_bytes(b"".join(npz_parts(arrays)))
    except OSError as error:
        raise FileFormatError(f"{folder / 'depth.npz'}: cannot be written: {error.strerror}") from None
    save_depth_png(image, folder / "depth" / "000000.png")
