# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Camera files of several formats."""

import json
import struct

import numpy as np
from pose_samples import MATRICES

import warpvis as wv

CAMERA = wv.Camera(64, 48, fx=60.0, fy=58.0, cx=31.3, cy=25.1)
INTEGER = CAMERA.to_K(pixel_center=0.0)  # pixel centers at whole numbers
FX, FY, CX, CY = INTEGER[[0, 1, 0, 1], [0, 1, 2, 2]].tolist()
NERF = {"fl_x": 60.0, "fl_y": 58.0, "cx": 31.3, "cy": 25.1, "w": 64, "h": 48}
ROS_YAML = f"""%YAML:1.0
image_width: 64
image_height: 48
camera_name: eye
camera_matrix: {{rows: 3, cols: 3, data: [{FX}, 0, {CX}, 0, {FY}, {CY}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}}
"""
KALIBR = f"""
cam0:
  camera_model: pinhole
  intrinsics: [{FX}, {FY}, {CX}, {CY}]
  distortion_model: radtan
  distortion_coeffs: [0.0, 0.0, 0.0, 0.0]
  resolution: [64, 48]
"""


def put(path, content):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def colmap_binary(folder, model=1, parameters=(60.0, 58.0, 31.3, 25.1)):
    folder.mkdir(exist_ok=True)
    cameras = struct.pack("<Q", 1) + struct.pack(f"<iiQQ{len(parameters)}d", 7, model, 64, 48, *parameters)
    (folder / "cameras.bin").write_bytes(cameras)
    inverse = np.linalg.inv(MATRICES)
    rows = wv.Frames.from_poses(inverse).camera_to_world
    data = struct.pack("<Q", len(rows))
    for number in reversed(range(len(rows))):  # the order is that of the names
        x, y, z, qx, qy, qz, qw = rows[number]
        data += struct.pack("<I7di", number + 1, qw, qx, qy, qz, x, y, z, 7) + f"{number:03d}.png\0".encode()
        data += struct.pack("<Q", 2) + bytes(48)
    (folder / "images.bin").write_bytes(data)
    return folder / "images.bin"


def colmap_text(folder, cameras="7 PINHOLE 64 48 60 58 31.3 25.1", camera=7):
    folder.mkdir(exist_ok=True)
    (folder / "cameras.txt").write_text(f"# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n{cameras}\n")
    lines = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"]
    for number, row in enumerate(wv.Frames.from_poses(np.linalg.inv(MATRICES)).camera_to_world.tolist()):
        x, y, z, qx, qy, qz, qw = row
        lines += [f"{number + 1} {qw} {qx} {qy} {qz} {x} {y} {z} {camera} a picture/{number:03d}.png", "1.5 2.5 -1"]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    return folder / "images.txt"
