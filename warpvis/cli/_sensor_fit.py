# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The command ``warpvis sensor-fit``: parameters of a depth camera from its images of flat walls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from warpvis.cli._help import with_help


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
