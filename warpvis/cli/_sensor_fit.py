# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis sensor-fit``: the numbers of a depth camera, by its pictures of flat walls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from warpvis.cli._help import with_help
from warpvis.errors import CameraError


@with_help
@dataclass(frozen=True, kw_only=True)
class SensorFit:
    """Fit noise, steps and dropout of a stereo or structured-light camera to its pictures of flat walls.

    A picture shows one wall, at any distance and angle: PNG files of 16 bits or .npy files.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of depth images."""
    camera: Annotated[str, tyro.conf.arg(metavar="FILE")]
    """Their camera's file: JSON with width, height, hfov (radians) or K; transforms.json, BOP's camera.json, COLMAP's
    cameras.txt or .bin, YAML of ROS, Kalibr or OpenCV."""
    baseline: float | None = None
    """Distance of the sensor's two eyes (metres); by default f b is found by --subpixel or by the band at one side."""
    subpixel: int | None = None
    """Into how many parts of a pixel disparities are rounded."""
    unit: float = 0.001
    """What one unit of whole numbers is (metres)."""
    region: float = 0.8
    """Which part of the image's width and height to look at, about its middle."""
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Picture to write: errors, their histogram and autocorrelation, and errors by depth."""

    def run(self) -> None:
        """Run the command."""
        from warpvis.core.camera import Camera
        from warpvis.io import find_depth_images, load_camera, read_depth
        from warpvis.sensors import fit

        camera = load_camera(self.camera, distortion=False)
        if not isinstance(camera, Camera):
            raise CameraError(
                f"--camera must be a pinhole's, as rectified depth images have, got {type(camera).__name__}"
            )
        files = find_depth_images(self.folder)
        images = [read_depth(file, unit=self.unit) for file in files]
        rounded = self.unit if any(file.suffix.lower() == ".png" for file in files) else 0.0
        options = {"baseline": self.baseline, "subpixel": self.subpixel, "region": self.region}
        found = fit(images, camera, resolution=rounded, **options)  # type: ignore[arg-type]
        print(found.report())
        if self.out is not None:
            from warpvis.viz import save_sensor_fit

            save_sensor_fit(found, self.out)
            print(f"\n{self.out}: errors and what was found of them")
