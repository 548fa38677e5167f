# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Small files of poses, cameras, points and datasets, written by the tests' writers, for `fuzz_files`."""

from __future__ import annotations

import contextlib
import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import trimesh
from batch_jobs import FORMATS, make_frames, make_scene
from fuzz_scene_seeds import Item, png

import warpvis as wv
from warpvis.batch import render_batch, verify
from warpvis.errors import WarpvisError
from warpvis.io import load_camera, read_archive, read_depth, read_points, save_depth_png

CAMERA = wv.Camera.from_fov(12, 9, hfov=1.0, near=0.3, far=4.5)
_FRAMES = 4
_MAX_FRAMES = 6
"""Maximum number of frames read from a dataset; a damaged manifest may claim many."""


def all_of(*calls: Callable[[], object]) -> None:
    """Run all calls, then raise the first error if any failed."""
    refused = None
    for call in calls:
        try:
            call()
        except WarpvisError as error:
            refused = refused or error
    if refused is not None:
        raise refused


def _npy(array: np.ndarray) -> bytes:
    whole = io.BytesIO()
    np.save(whole, array)
    return whole.getvalue()


def _npz(**arrays: np.ndarray) -> bytes:
    whole = io.BytesIO()
    np.savez(whole, **arrays)
    return whole.getvalue()


def _read_poses(name: str, **options: object) -> Callable[[Path], None]:
    return lambda folder: wv.read_frames(folder / name, **options)


def poses(root: Path) -> Iterator[Item]:
    from pose_samples import MATRICES, ROWS, TIMES, bop, nerfstudio

    from support.camera_files import NERF, colmap_binary, colmap_text

    rows = "".join(
        " ".join(f"{value:.9g}" for value in (time, *row)) + "\n" for time, row in zip(TIMES, ROWS, strict=True)
    )
    yield "poses, TUM", {"a.txt": "# timestamp tx ty tz qx qy qz qw\n" + rows}, (), _read_poses("a.txt")
    csv = "time,x,y,z,qx,qy,qz,qw\n" + rows.replace(" ", ",")
    yield "poses, CSV", {"a.csv": csv}, (), _read_poses("a.csv")
    for array in (ROWS, MATRICES, ROWS.astype(np.float32)):
        yield "poses, npy", {"a.npy": _npy(array)}, (), _read_poses("a.npy")
    moved = np.zeros((2, 1, 7)) + (0, 0, 0, 0, 0, 0, 1.0)
    more = {"object_poses": moved, "world_index": np.arange(6) % 2}
    archive = _npz(camera_to_world=ROWS, timestamps=TIMES, **more)
    yield "poses, npz", {"a.npz": archive}, (), _read_poses("a.npz")
    yield (
        "worlds, npz",
        {"a.npz": _npz(**more)},
        (),
        lambda folder: read_archive(folder / "a.npz", ("object_poses", "world_index"), "object_poses"),
    )
    parquet = _parquet(ROWS)
    if parquet:
        yield "poses, Parquet", {"a.parquet": parquet}, (), _read_poses("a.parquet")
    yield (
        "poses, nerfstudio",
        {"transforms.json": json.dumps({**nerfstudio(), **NERF})},
        (),
        (_read_poses("transforms.json")),
    )
    seen = {"transforms.json": json.dumps(nerfstudio()), "0.png": png(64, 48)}
    yield "poses, nerfstudio", seen, (), _read_poses("transforms.json")
    yield "poses, BOP", {"scene_camera.json": json.dumps(bop())}, (), _read_poses("scene_camera.json")
    seen = {"scene_camera.json": json.dumps(bop()), "depth/000000.png": png(64, 48, np.uint16)}
    yield "poses, BOP", seen, (), _read_poses("scene_camera.json")
    for number, write in enumerate((colmap_text, colmap_binary)):
        path = write(root / f"colmap_{number}")
        files = {item.name: item.read_bytes() for item in path.parent.iterdir()}
        yield "poses, COLMAP", files, (), _read_poses(path.name)


def _parquet(rows: np.ndarray) -> bytes | None:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        return None
    whole = io.BytesIO()
    pyarrow.parquet.write_table(
        pyarrow.table(dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), rows.T, strict=True))), whole
    )
    return whole.getvalue()


def bags(root: Path) -> Iterator[Item]:
    try:
        from support.ros_bags import KINDS, write_bag
    except ImportError:
        return
    for storage in ("mcap", "sqlite3"):
        for number, kind in enumerate(("PoseStamped", "Path", "TFMessage")):
            folder = root / f"{storage}_{number}"
            write_bag(folder, {"/camera": KINDS[kind][0]}, storage)
            files = {f"bag/{path.name}": path.read_bytes() for path in folder.iterdir()}
            yield f"poses, ROS bag ({storage})", files, (), _read_poses("bag")


def _read_camera(name: str) -> Callable[[Path], None]:
    return lambda folder: load_camera(str(folder / name))


def cameras(root: Path) -> Iterator[Item]:
    from pose_samples import bop, nerfstudio

    from support.camera_files import KALIBR, NERF, ROS_YAML, colmap_binary, colmap_text

    own = {"width": 64, "height": 48, "near": 0.1, "far": 5.0}
    matrix = [[60, 0, 31.3], [0, 58, 25.1], [0, 0, 1]]
    for fields in ({**own, "hfov": 1.0}, {**own, "K": matrix, "pixel_center": 0.0}):
        yield "cameras, JSON", {"a.json": json.dumps(fields)}, (), _read_camera("a.json")
    yield (
        "cameras, nerfstudio",
        {"transforms.json": json.dumps({**nerfstudio(), **NERF})},
        (),
        (_read_camera("transforms.json")),
    )
    fields = {"fx": 60, "fy": 58, "cx": 31, "cy": 25, "width": 64, "height": 48, "depth_scale": 0.1}
    yield "cameras, BOP", {"camera.json": json.dumps(fields)}, (), _read_camera("camera.json")
    files = {"train/000000/scene_camera.json": json.dumps(bop()), "camera.json": json.dumps(fields)}
    yield "cameras, BOP", files, (), _read_camera("train/000000/scene_camera.json")
    for text in (ROS_YAML, KALIBR, KALIBR + KALIBR.replace("cam0", "cam1")):
        yield "cameras, YAML", {"a.yaml": text}, (), _read_camera("a.yaml")
    for number, write in enumerate((colmap_text, colmap_binary)):
        folder = write(root / f"camera_{number}").parent
        path = next(folder.glob("cameras.*"))
        yield "cameras, COLMAP", {path.name: path.read_bytes()}, (), _read_camera(path.name)


_OPENCV = """%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 60., 0., 31.3, 0., 58., 25.1, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.2, 0.05, 0.001, -0.002, 0.01 ]
"""
_OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage><image_width>64</image_width><image_height>48</image_height>
<fisheye_model>1</fisheye_model>
<camera_matrix type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt>
  <data>60. 0. 31.3 0. 58. 25.1 0. 0. 1.</data></camera_matrix>
<distortion_coefficients type_id="opencv-matrix"><rows>4</rows><cols>1</cols><dt>d</dt>
  <data>0.01 0.002 -0.003 0.0004</data></distortion_coefficients></opencv_storage>
"""


def lenses(root: Path) -> Iterator[Item]:
    """Yield cameras with lenses; the reader also casts a few of their rays."""
    from support.camera_files import KALIBR, NERF, ROS_YAML, colmap_text

    def reader(name: str) -> Callable[[Path], None]:
        def read(folder: Path) -> None:
            camera = load_camera(str(folder / name), distortion=True)
            if isinstance(camera, wv.cameras.LensCamera):
                camera.unproject([[1.0, 2.0], [31.0, 25.0]])

        return read

    own = {"width": 64, "height": 48, "near": 0.1, "far": 5.0}
    lens = {"model": "KannalaBrandt", "fx": 60, "fy": 58, "cx": 31, "cy": 25, "coefficients": [0.01, 0, 0, 0]}
    files = {"a.yaml": _OPENCV, "a.xml": _OPENCV_XML, "ros.yaml": ROS_YAML, "kalibr.yaml": KALIBR}
    files["a.json"] = json.dumps({**own, "lens": lens})
    for name, text in files.items():
        yield "cameras with lenses", {name: text}, (), reader(name)
    tum = {"calibration.txt": "60 58 31.3 25.1 -0.2 0.05 0.001 0 0", "depth.txt": "0.0 depth/0.png\n"}
    tum["depth/0.png"] = png(64, 48, np.uint16)
    yield "cameras with lenses", tum, ("calibration.txt",), reader("calibration.txt")
    yield "cameras with lenses", {"transforms.json": json.dumps(NERF)}, (), reader("transforms.json")
    path = colmap_text(root / "lens")
    folder = path if path.is_dir() else path.parent
    place = next(folder.glob("cameras.*"))
    text = "1 OPENCV 64 48 60 58 31 25 -0.2 0.05 0.001 -0.002\n"
    yield "cameras with lenses", {place.name: text}, (), reader(place.name)


def calibrations(root: Path) -> Iterator[Item]:
    """Yield the calibration files of all tools."""
    from support.calibration_files import CASES

    for case in CASES.values():
        text = case.content if isinstance(case.content, str) else json.dumps(case.content)
        name = f"{case.file}:{case.name}" if case.name else case.file
        yield f"calibration files, {case.tool}", {case.file: text}, (), _read_camera(name)


def sensors(root: Path) -> Iterator[Item]:
    """Yield files of depth-camera models: distortion tables and manifest fields."""
    from reference_redwood import make_table, write_table

    def read_fields(folder: Path) -> None:
        try:
            fields = json.loads((folder / "a.json").read_bytes())
        except (ValueError, RecursionError):
            return  # the manifest reader reports this
        if isinstance(fields, dict):
            wv.sensors.sensor_from_fields(fields)

    table = make_table()
    text = write_table(root / "dist-model.txt", table).read_text()
    for name, data in (("a.txt", text), ("a.npy", _npy(table)), ("a.npy", _npy(table.astype(np.float64)))):
        yield "sensors, Redwood", {name: data}, (), lambda folder, name=name: wv.sensors.RedwoodNoise(folder / name)
    dots = np.eye(12, dtype=np.uint8)
    for sensor in (wv.sensors.SimKinect(pattern=dots), wv.sensors.Corruptions(of=wv.sensors.realsense_d435())):
        yield "sensors, JSON", {"a.json": json.dumps(wv.sensors.sensor_to_fields(sensor))}, (), read_fields


def scanners(root: Path) -> Iterator[Item]:
    """Yield lidar files: metadata, calibrations and samples."""
    from support.lidars import old_ouster_metadata, ouster_metadata

    lidars = wv.sensors.lidars
    for metadata in (ouster_metadata(), old_ouster_metadata()):
        files = {"a.json": json.dumps(metadata)}
        yield "lidars, Ouster", files, (), lambda folder: lidars.ouster(folder / "a.json")
    for count, make in ((16, lidars.vlp16), (32, lidars.vlp32c), (64, lidars.hdl64e)):
        rows = [
            f"- {{laser_id: {n}, vert_correction: {0.01 * n:.3f}, rot_correction: -0.1, vert_offset_correction: 0.2}}\n"
            for n in range(count)
        ]
        text = f"num_lasers: {count}\ndistance_resolution: 0.002\nlasers:\n{''.join(rows)}"
        yield (
            "lidars, Velodyne",
            {"a.yaml": text},
            (),
            lambda folder, make=make: make(calibration=folder / "a.yaml"),
        )
    angles = np.random.default_rng(0).uniform(-0.5, 0.5, (40, 2))
    lines = "".join(f"{n * 5e-6:.6f},{np.degrees(a):.4f},{90 - np.degrees(e):.4f}\n" for n, (a, e) in enumerate(angles))
    files = {"a.csv": "Time/s,Azimuth/deg,Zenith/deg\n" + lines, "a.npy": _npy(angles.astype(np.float32))}
    for name, data in files.items():
        yield (
            "lidars, Livox",
            {name: data},
            (),
            lambda folder, name=name: lidars.livox("mid360", folder / name).frame(0, samples=1),
        )


def points(root: Path) -> Iterator[Item]:
    points = np.random.default_rng(0).normal(size=(5, 3))
    text = "# x y z\n" + "".join(" ".join(f"{value:.6g}" for value in point) + "\n" for point in points)
    cloud = trimesh.PointCloud(points)
    ascii_cloud = cloud.export(file_type="ply", encoding="ascii")
    files = {"a.txt": text, "a.csv": "x,y,z\n" + text[8:].replace(" ", ","), "a.npy": _npy(points)}
    files |= {"a.ply": cloud.export(file_type="ply"), "b.ply": ascii_cloud}
    for name, data in files.items():
        yield "points", {name: data}, (), lambda folder, name=name: read_points(folder / name)


def depth_images(root: Path) -> Iterator[Item]:
    depth = np.random.default_rng(0).uniform(0.5, 4, (6, 8))
    save_depth_png(depth, root / "depth.png")
    files = {"a.png": (root / "depth.png").read_bytes(), "a.npy": _npy(depth.astype(np.float32))}
    units = (depth * 1000).astype(np.uint16)
    files |= {"b.npy": _npy(units), "a.pgm": b"P5\n8 6\n65535\n" + units.astype(">u2").tobytes()}
    for name, data in files.items():
        yield "depth images", {name: data}, (), lambda folder, name=name: read_depth(folder / name)


def occupancy_maps(root: Path) -> Iterator[Item]:
    depth = np.random.default_rng(0).uniform(0.5, 2, (1, 9, 12)).astype(np.float32)
    occupancy = wv.OccupancyMap(0.1, device="cpu")
    occupancy.integrate(depth, CAMERA, wv.look_at((0, 0, 1), (1, 0, 0.5))[None])
    for name in ("a.npz", "a.bt"):
        occupancy.save(root / name)
        files = {name: (root / name).read_bytes()}
        yield "occupancy maps", files, (), lambda folder, name=name: wv.OccupancyMap.load(folder / name, device="cpu")


def datasets(root: Path) -> Iterator[Item]:
    """Yield datasets of every format whose dependencies are installed; the reader verifies and resumes them."""
    kinds = [(kind, {}, {}) for kind in FORMATS] + [("zarr", {"compression": "zstd"}, {})]
    sensed = {"sensor": wv.sensors.StereoDepth(0.05, sigma=0.1), "outputs": ("depth", "reasons", "true_depth")}
    kinds += [(kind, {}, sensed) for kind in ("npz", "zarr", "png")]
    for number, (kind, options, more) in enumerate(kinds):
        folder = root / f"dataset_{number}"
        try:
            _run(folder, kind, options, **more)
        except WarpvisError as error:
            print(f"left out: {kind}: {error}")
            continue
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        inside = {f"set/{name}": data for name, data in files.items()}
        yield f"dataset, {kind}", inside, (), _read_dataset
        yield f"dataset, {kind}", inside, (), _repairer(kind, options, more)


def recordings(root: Path) -> Iterator[Item]:
    """Yield small recordings in folders of every dataset; the reader reads all of their images."""
    from support.recordings import write_folders

    for kind, folder in write_folders(root / "recordings"):
        files = {path.relative_to(folder).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        yield f"recording, {kind}", {f"set/{name}": data for name, data in files.items()}, (), _recording_reader("set")
    try:
        from support.recording_bags import KINDS, write_room
    except ImportError:
        return
    for kind in KINDS:
        path = write_room(root / "recordings" / kind, kind, encoding="16UC1" if kind == "ros1" else "32FC1")
        files = {
            file.relative_to(path.parent).as_posix(): file.read_bytes()
            for file in (path, *path.glob("*"))
            if file.is_file()
        }
        yield f"recording, bag ({kind})", files, (), _recording_reader(path.name)
    yield from _lerobot_recordings(root / "recordings")


def _lerobot_recordings(root: Path) -> Iterator[Item]:
    try:
        from support.recording_lerobot import depth_at, write_dataset, write_tiff, write_video_dataset
    except ImportError:
        return
    feature = {"dtype": "image", "info": {"is_depth_map": True}}
    write_dataset(root / "tiff", feature, lambda *item: write_tiff(depth_at(*item).astype(np.float32)), (2,))
    with contextlib.suppress(ImportError):
        import av  # noqa: F401

        write_video_dataset(root / "video", (2,))
    for name in ("tiff", "video"):
        folder = root / name
        files = {path.relative_to(root).as_posix(): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        if files:
            yield f"recording, LeRobot ({name})", files, (), _recording_reader(name, has_camera=False)


def _recording_reader(name: str, *, has_camera: bool = True) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        recording = wv.open_recording(folder / name, camera=wv.Camera.from_fov(64, 48, hfov=1.0))
        for frame in recording[:_MAX_FRAMES]:
            all_of(lambda frame=frame: frame.depth, lambda frame=frame: frame.color)
        if has_camera:
            wv.open_recording(folder / name)

    return read


_SCENES: dict[str, wv.Scene] = {}


def _run(folder: Path, kind: str, options: dict[str, str], **more: object) -> None:
    scene = _SCENES.setdefault("scene", make_scene())
    frames = make_frames(_FRAMES)
    render_batch(scene, CAMERA, frames, folder, format=kind, shard_frames=2, threads=1, options=options, **more)


def _read_dataset(folder: Path) -> None:
    folder /= "set"
    tables = ("*.txt", "transforms.json", "**/scene_camera.json", "**/images.txt", "poses.npz", "*.bin", "bag_000000")
    poses = [path for pattern in tables for path in folder.glob(pattern)]

    def read() -> None:
        dataset = wv.open_dataset(folder)
        for index in range(min(len(dataset), _MAX_FRAMES)):
            dataset[index]

    all_of(
        lambda: verify(folder),
        read,
        lambda: wv.open_dataset(folder).sensor,
        *(lambda path=path: wv.read_frames(path) for path in poses),
    )


def _repairer(kind: str, options: dict[str, str], more: dict[str, object]) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        _run(folder / "set", kind, options, resume=True, repair=True, **more)
        # A damaged record can lose a file's name; `verify` then reports a file without a record.
        problems = [
            problem for problem in verify(folder / "set").problems if not problem.endswith("is not part of any record")
        ]
        if problems:
            raise AssertionError(f"after repair: {problems[0]}")

    return read


MAKERS = (
    poses,
    bags,
    cameras,
    lenses,
    calibrations,
    scanners,
    sensors,
    points,
    depth_images,
    occupancy_maps,
    recordings,
    datasets,
)
