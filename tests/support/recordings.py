# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a room, 6 x 4 x 3 m, computed in double precision and written in the formats of datasets."""

import json

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

import warpvis as wv

LOW, HIGH = np.array([0.0, 0.0, 0.0]), np.array([6.0, 4.0, 3.0])
FLIP = np.diag([1.0, -1.0, 1.0, 1.0])

SMALL, K_SMALL = (64, 48), (60.0, 61.0, 31.5, 23.5)


def poses(times):
    """Return camera-to-world matrices of a camera that moves and turns at constant rates, shape ``(N, 4, 4)``."""
    times = np.asarray(times, dtype=np.float64)
    matrices = np.tile(np.eye(4), (len(times), 1, 1))
    level = np.array([[0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # looks along x, y down
    turn = Rotation.from_rotvec(times[:, None] * [0.05, -0.1, 0.4]).as_matrix()
    matrices[:, :3, :3] = turn @ Rotation.from_euler("y", 0.2).as_matrix() @ level
    matrices[:, :3, 3] = [1.5, 2.0, 1.2] + times[:, None] * [0.2, 0.1, 0.05]
    return matrices


def rows(matrices):
    """Return rows ``x y z qx qy qz qw``."""
    turns = Rotation.from_matrix(matrices[:, :3, :3]).as_quat()
    return np.concatenate([matrices[:, :3, 3], turns], axis=1)


def rays(k, width, height, center=0.0):
    """Return the directions of pixels whose centers are at integers plus `center`, with z = 1, ``(H, W, 3)``."""
    y, x = np.mgrid[:height, :width] + center
    fx, fy, cx, cy = k
    return np.stack([(x - cx) / fx, (y - cy) / fy, np.ones_like(x)], axis=-1)


def room_depth(directions, pose):
    """Return the depth of the room's walls, by their planes [m]."""
    turned = directions @ pose[:3, :3].T
    with np.errstate(divide="ignore"):
        walls = np.where(turned > 0, (HIGH - pose[:3, 3]) / turned, (LOW - pose[:3, 3]) / turned)
    return walls.min(axis=-1)


def distance_to_walls(points):
    """Return how far points are from the nearest wall [m]."""
    return np.minimum(np.abs(points - LOW), np.abs(points - HIGH)).min(axis=-1)


def world_points(frame):
    """Return the points of a frame's pixels, computed in double precision from its camera and pose."""
    camera, pose = frame.camera, frame.camera_to_world
    k = (camera.fx, camera.fy, camera.cx, camera.cy)
    points = rays(k, camera.width, camera.height, 0.5) * frame.depth[..., None].astype(np.float64)
    return points @ Rotation.from_quat(pose[3:]).as_matrix().T + pose[:3]


def assert_room(recording, units=1000, tolerance=1e-6):
    """Check that the pixels of all frames, back-projected in double precision, are on the walls of the room."""
    for frame in recording:
        assert frame.depth.dtype == np.float32
        assert np.isfinite(frame.depth).all()
        # A point moves along its ray by at most half a unit; rays in the corners are up to 1.4 times as long as z.
        assert distance_to_walls(world_points(frame)).max() < 0.75 / units + tolerance


def refusal(call):
    with pytest.raises(wv.WarpvisError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message
    return message


def save_depth(path, depth, units):
    path.parent.mkdir(parents=True, exist_ok=True)
    image = np.rint(np.nan_to_num(depth * units)).astype(np.uint16)
    Image.fromarray(image).save(path)
    return image


def save_color(path, shape, value):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((*shape, 3), value, dtype=np.uint8)).save(path)


def save_lines(path, lines):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line}\n" for line in lines))


def text(values):
    return " ".join(repr(float(value)) for value in values)


def save_matrix(path, matrix):
    save_lines(path, [text(row) for row in matrix])


K_VGA = (525.0, 525.0, 319.5, 239.5)


def write_tum(folder, k=K_VGA, size=(640, 480), count=3, name="rgbd_dataset_freiburg1_room"):
    """Write frames every 33 ms, colors 4 ms later, and poses at 100 Hz, which are not synchronous with them."""
    times = 10 + np.arange(count) / 30
    width, height = size
    depths, colors = [f"# file: '{name}.bag'"], ["# timestamp filename"]
    for index, time in enumerate(times):
        save_depth(folder / f"depth/{time:.6f}.png", room_depth(rays(k, *size), poses([round(time, 6) - 10])[0]), 5000)
        depths.append(f"{time:.6f} depth/{time:.6f}.png")
        save_color(folder / f"rgb/{time + 0.004:.6f}.png", (height, width), 10 * index)
        colors.append(f"{time + 0.004:.6f} rgb/{time + 0.004:.6f}.png")
    save_lines(folder / "depth.txt", depths)
    save_lines(folder / "rgb.txt", colors)
    stamps = 9.9534 + np.arange(40) / 100
    save_lines(
        folder / "groundtruth.txt",
        [text([time, *row]) for time, row in zip(stamps, rows(poses(stamps - 10)), strict=True)],
    )
    return folder


def write_frames(folder, k, size, count=3, *, center=0.0, depth="depth/{:d}.png", units=1000):
    """Write depth images of `poses` at whole seconds; return the poses."""
    matrices = poses(np.arange(count))
    for index, pose in enumerate(matrices):
        save_depth(folder / depth.format(index), room_depth(rays(k, *size, center), pose), units)
    return matrices


def write_seven_scenes(folder, size=(640, 480), k=(585.0, 585.0, 320.0, 240.0)):
    matrices = write_frames(folder, k, size, center=0.5, depth="frame-{:06d}.depth.png")
    for index, matrix in enumerate(matrices):
        matrix[:3, :3] *= 1 + 2e-4  # as rounded as the published ones
        save_matrix(folder / f"frame-{index:06d}.pose.txt", matrix)
        save_color(folder / f"frame-{index:06d}.color.png", size[::-1], index)
    return folder


def write_icl(folder):
    """Write frames with poses whose y is up, as published; return these poses."""
    published = FLIP @ write_frames(folder, (481.2, 480.0, 319.5, 239.5), (640, 480), units=5000) @ FLIP
    lines = [text([i, *row]) for i, row in enumerate(rows(published))]
    save_lines(folder / "livingRoom0.gt.freiburg", lines[1:])
    save_lines(folder / "associations.txt", [f"{i} depth/{i}.png {i} rgb/{i}.png" for i in range(3)])
    for index in range(3):
        save_color(folder / f"rgb/{index}.png", (480, 640), 7 * index)
    return published


def write_scannet(folder):
    """Write depth images and color images of twice the resolution, whose red channel is the column."""
    matrices = write_frames(folder, K_SMALL, SMALL)
    for index, matrix in enumerate(matrices):
        save_matrix(folder / f"pose/{index}.txt", np.full((4, 4), -np.inf) if index == 1 else matrix)
        columns = np.broadcast_to(np.arange(128, dtype=np.uint8)[None, :, None], (96, 128, 3))
        (folder / "color").mkdir(exist_ok=True)
        Image.fromarray(np.ascontiguousarray(columns)).save(folder / f"color/{index}.png")
    for name, factor in (("depth", 1), ("color", 2)):
        k = np.eye(4)
        k[0, 0], k[1, 1] = 60 * factor, 61 * factor
        k[:2, 2] = np.array([32, 24]) * factor - 0.5
        save_matrix(folder / f"intrinsic/intrinsic_{name}.txt", k)
    return folder


def write_redwood(folder):
    matrices = write_frames(folder, K_SMALL, SMALL, depth="depth/{:05d}.png")
    lines = []
    for index in (0, 2):
        lines += [f"{index} {index} {index + 1}", *(text(row) for row in matrices[index])]
        save_color(folder / f"color/{index:05d}.jpg", SMALL[::-1], 100)
    save_lines(folder / "trajectory.log", lines)
    return folder


def write_nerfstudio(folder, matrices, **extra):
    frames = [
        {
            "file_path": f"images/{i}.png",
            "transform_matrix": (matrix @ np.diag([1.0, -1, -1, 1])).tolist(),
            **{name: value.format(i) for name, value in extra.items()},
        }
        for i, matrix in enumerate(matrices)
    ]
    intrinsics = {"w": 64, "h": 48, "fl_x": 60.0, "fl_y": 61.0, "cx": 32.0, "cy": 24.0}
    (folder / "transforms.json").write_text(json.dumps({**intrinsics, "frames": frames[::-1]}))


def write_folders(root):
    """Yield the name and the folder of a small recording of every format, with its camera."""
    size, k = SMALL, K_SMALL
    folder = write_tum(root / "tum", k, size, 2, "own")
    save_lines(folder / "calibration.txt", [text(k)])
    yield "tum", folder
    folder = write_seven_scenes(root / "7scenes", size, k)
    save_matrix(folder / "camera-intrinsics.txt", [[k[0], 0, k[2]], [0, k[1], k[3]], [0, 0, 1]])
    yield "7scenes", folder
    yield "scannet", write_scannet(root / "scannet")
    folder = write_redwood(root / "redwood")
    camera = {"width": size[0], "height": size[1], "intrinsic_matrix": [k[0], 0, 0, 0, k[1], 0, k[2], k[3], 1]}
    (folder / "camera.json").write_text(json.dumps(camera))
    yield "redwood", folder
    write_nerfstudio(root / "images", write_frames(root / "images", k, size), depth_file_path="depth/{:d}.png")
    for index in range(3):
        save_color(root / f"images/images/{index}.png", size[::-1], index)
    yield "images", root / "images"
