# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Formats with one file per frame, read back by public readers and compared with the rendered points."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.batch import find_format, render_batch
from warpvis.batch.storage._output import ShardFiles
from warpvis.cameras.frames import Frames
from warpvis.core.outputs import SENSOR_NAMES
from warpvis.core.poses import poses_to_matrices
from warpvis.io import depth_to_units, encode_png, load_camera, read_frames

from support import batch_layouts
from support.batch_layouts import (
    CAMERA,
    FRAMES,
    MILLIMETER,
    OUTPUTS,
    SHARD_FRAMES,
    TIMES,
    bytes_of,
    frame_file,
    pixel_grid,
    plan_of,
    read_image,
    seen_error,
    write,
)

rendered = batch_layouts.rendered  # a fixture


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(1, 1), (3, 1), (1, 4), (37, 53)])
def test_png_bytes_read_back_with_pillow(tmp_path, dtype, shape):
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)
    for pixels in (image, image[::-1], image.T, image[:, ::-2]):
        (tmp_path / "image.png").write_bytes(encode_png(pixels))
        mode, read = read_image(tmp_path / "image.png")
        assert mode == {np.uint8: "L", np.uint16: "I;16"}[dtype]
        np.testing.assert_array_equal(read, pixels)


@pytest.mark.parametrize(
    "image", [np.zeros((2, 2), np.float32), np.zeros((2, 2, 3), np.uint8), np.zeros((0, 3), np.uint8)]
)
def test_encode_png_of_invalid_image_raises(image):
    with pytest.raises(wv.errors.ArrayError, match=r"a PNG image must be uint8 or uint16 of shape \(H, W\), got"):
        encode_png(image)


def test_depth_to_units():
    depth = [0.00009, 0.00011, 1.23456, 13.10689, 13.10691, 13.1072, 13.2, np.inf, -np.inf, np.nan]
    assert depth_to_units(depth, 5000).tolist() == [0, 1, 6173, 65534, 0, 0, 0, 0, 0, 0]
    assert depth_to_units(1.5, 1000) == 1500
    single = np.array([61.31549835205078, 58.50450134277344], dtype=np.float32)  # times 1000, float32 rounds to halves
    assert depth_to_units(single, 1000).tolist() == [61315, 58505]


def test_png_images(tmp_path, rendered):
    assert write(tmp_path, rendered, "png") == {}
    images = rendered["z"][2]
    for frame in range(FRAMES):
        mode, depth = read_image(tmp_path / "depth" / frame_file(frame, ".png"))
        assert mode == "I;16"
        seen = np.isfinite(images["depth"][frame])
        np.testing.assert_allclose(depth[seen] / 1000, images["depth"][frame][seen], atol=0.501e-3)
        assert (depth[~seen] == 0).all()
        mode, labels = read_image(tmp_path / "labels" / frame_file(frame, ".png"))
        assert mode == "L"
        np.testing.assert_array_equal(labels, images["labels"][frame])
        mode, objects = read_image(tmp_path / "segmentation" / frame_file(frame, ".png"))
        assert mode == "I;16"
        np.testing.assert_array_equal(objects.astype(int) - 1, images["segmentation"][frame])
    assert load_camera(str(tmp_path / "camera.json")) == CAMERA
    meaning = json.loads((tmp_path / "images.json").read_text())
    assert meaning["depth"] == {"kind": "planar", "units_per_meter": 1000.0, "no_depth": 0}
    assert meaning["labels"]["values"]["3"] == "object"
    assert [item["name"] for item in meaning["segmentation"]["objects"]] == ["floor", "ball", "box"]


def test_camera_with_infinite_range_is_valid_json(tmp_path, rendered):
    camera = wv.Camera(CAMERA.width, CAMERA.height, 50.0, 50.0, 24.0, 18.0)
    write(tmp_path, rendered, "png", camera=camera)
    assert load_camera(str(tmp_path / "camera.json")) == camera
    json.loads((tmp_path / "camera.json").read_text(), parse_constant=pytest.fail)


@pytest.mark.parametrize("scale", [2e4, "20000", "2e4"])
def test_depth_beyond_16_bits_is_reported(tmp_path, rendered, scale):
    warnings = write(tmp_path, rendered, "png", outputs=("depth",), options={"scale": scale})
    depth = rendered["z"][2]["depth"]
    lost = np.isfinite(depth) & (depth > 65534.5 / 2e4)
    assert list(warnings.values()) == [np.count_nonzero(lost)]
    assert next(iter(warnings)).startswith("pixels have a depth that 16 bits of 20000 units a meter cannot hold")
    for frame in range(FRAMES):
        units = read_image(tmp_path / "depth" / frame_file(frame, ".png"))[1]
        np.testing.assert_array_equal(units == 0, lost[frame] | ~np.isfinite(depth[frame]))


def tum_points(folder, frame, *, cx_shift=0.0):
    """Return world points of a frame by TUM's equations: pixel centers at whole numbers, 5000 units per meter."""
    fx, fy, cx, cy = np.loadtxt(folder / "calibration.txt")
    lines = [line.split() for line in (folder / "depth.txt").read_text().splitlines() if line[0] != "#"]
    poses = np.loadtxt(folder / "groundtruth.txt")
    stamp, name = lines[frame]
    assert float(stamp) == poses[frame, 0]
    z = read_image(folder / name)[1] / 5000
    z[z == 0] = np.nan
    u, v = np.moveaxis(pixel_grid(0), -1, 0)
    local = np.stack([(u - cx - cx_shift) * z / fx, (v - cy) * z / fy, z, np.ones_like(z)], axis=-1)
    return (local @ poses_to_matrices(poses[frame, 1:]).T)[..., :3]


def test_tum_points_equal_the_rendered_points(tmp_path, rendered):
    assert write(tmp_path, rendered, "tum") == {}
    for frame in range(FRAMES):
        points = rendered["z"][2]["points"][frame]
        assert seen_error(tum_points(tmp_path, frame), points).max() < MILLIMETER
        for shift in (-0.5, 0.5):  # principal point of the other convention
            assert np.median(seen_error(tum_points(tmp_path, frame, cx_shift=shift), points)) > 5 * MILLIMETER


def test_evo_reads_tum(tmp_path, rendered):
    from evo.tools import file_interface

    write(tmp_path, rendered, "tum")
    trajectory = file_interface.read_tum_trajectory_file(str(tmp_path / "groundtruth.txt"))
    valid, details = trajectory.check()
    assert valid, details
    frames = Frames.from_poses(rendered["z"][1])
    np.testing.assert_array_equal(trajectory.timestamps, TIMES)
    np.testing.assert_array_equal(trajectory.positions_xyz, frames.camera_to_world[:, :3])
    np.testing.assert_array_equal(trajectory.orientations_quat_wxyz[:, [1, 2, 3, 0]], frames.camera_to_world[:, 3:])
    assert (tmp_path / "calibration.txt").read_text().splitlines()[0] == "50.0 47.0 21.8 18.6"


def nerfstudio_points(folder, frame, *, pixel_center=0.5):
    """Return points of a frame in the saved world, by nerfstudio's equations."""
    meta = json.loads((folder / "transforms.json").read_text())
    entry = meta["frames"][frame]
    z = read_image(folder / entry["depth_file_path"])[1] * 1e-3
    z[z == 0] = np.nan
    x, y = np.moveaxis(pixel_grid(pixel_center), -1, 0)
    directions = np.stack(
        [(x - meta["cx"]) / meta["fl_x"], -(y - meta["cy"]) / meta["fl_y"], -np.ones_like(x)], axis=-1
    )
    camera_to_world = np.array(entry["transform_matrix"])
    assert camera_to_world[3].tolist() == [0, 0, 0, 1]
    return z[..., None] * (directions @ camera_to_world[:3, :3].T) + camera_to_world[:3, 3]


@pytest.mark.parametrize("up", ["z", "y"])
def test_nerfstudio_points_equal_the_rendered_points(tmp_path, rendered, up):
    assert write(tmp_path, rendered, "nerfstudio", up=up) == {}
    meta = json.loads((tmp_path / "transforms.json").read_text())
    assert (meta["w"], meta["h"], meta["camera_model"]) == (CAMERA.width, CAMERA.height, "OPENCV")
    assert meta["orientation_override"] == "none"
    assert ("applied_transform" in meta) == (up == "y")
    applied = np.array(meta.get("applied_transform", np.eye(4)[:3]))
    images = rendered[up][2]
    for frame in range(FRAMES):
        points = images["points"][frame] @ applied[:, :3].T + applied[:, 3]
        assert seen_error(nerfstudio_points(tmp_path, frame), points).max() < MILLIMETER
        assert np.median(seen_error(nerfstudio_points(tmp_path, frame, pixel_center=0), points)) > 5 * MILLIMETER
        floor = images["segmentation"][frame] == 0
        assert np.abs(nerfstudio_points(tmp_path, frame)[floor][:, 2]).max(initial=0) < 0.101  # horizontal floor
        mode, color = read_image(tmp_path / meta["frames"][frame]["file_path"])
        assert mode == "RGB"
        np.testing.assert_array_equal(color, images["color"][frame])
        mode, labels = read_image(tmp_path / "labels" / frame_file(frame, ".png"))
        assert mode == "L"
        np.testing.assert_array_equal(labels, images["labels"][frame])


def test_nerfstudio_worlds_do_not_depend_on_the_up_axis(tmp_path, rendered):
    for up in "zy":
        write(tmp_path / up, rendered, "nerfstudio", up=up)
    for frame in range(FRAMES):
        z_up, y_up = (
            np.array(json.loads((tmp_path / up / "transforms.json").read_text())["frames"][frame]["transform_matrix"])
            for up in "zy"
        )
        np.testing.assert_allclose(z_up, y_up, atol=1e-12)


@pytest.mark.parametrize("options", [{}, {"color": "jpeg"}])
def test_nerfstudio_frames_refer_to_color_images_only(tmp_path, rendered, options):
    write(tmp_path, rendered, "nerfstudio", outputs=("color",), options=options)
    frames = json.loads((tmp_path / "transforms.json").read_text())["frames"]
    suffix = ".jpg" if options else ".png"
    assert [frame["file_path"] for frame in frames] == [f"images/{frame_file(i, suffix)}" for i in range(FRAMES)]
    assert sorted(frame["file_path"] for frame in frames) == [frame["file_path"] for frame in frames]
    assert "depth_file_path" not in frames[0]
    assert all(read_image(tmp_path / frame["file_path"])[0] == "RGB" for frame in frames)


def test_pycolmap_reads_colmap(tmp_path, rendered):
    import pycolmap

    write(tmp_path, rendered, "colmap", options={"sparse_points": 0})
    model = pycolmap.Reconstruction()
    model.read_text(str(tmp_path / "sparse"))
    assert (model.num_images(), model.num_cameras(), model.num_points3D()) == (FRAMES, 1, 0)
    images = rendered["z"][2]
    for frame in range(FRAMES):
        image = model.image(frame + 1)
        assert image.name == frame_file(frame, ".png")
        camera = model.camera(image.camera_id)
        assert (camera.model_name, camera.width, camera.height) == ("PINHOLE", CAMERA.width, CAMERA.height)
        world_from_camera = image.cam_from_world().inverse()
        maps = tmp_path / "stereo"
        depth_map, normal_map = pycolmap.DepthMap(), pycolmap.NormalMap()
        depth_map.read(str(maps / "depth_maps" / f"{image.name}.geometric.bin"))
        normal_path = maps / "normal_maps" / f"{image.name}.geometric.bin"
        normal_map.read(str(normal_path))
        assert (normal_map.width, normal_map.height) == (CAMERA.width, CAMERA.height)
        depth = depth_map.to_array().astype(np.float64)
        seen = np.isfinite(images["depth"][frame])
        np.testing.assert_array_equal(depth[seen], images["depth"][frame][seen])
        assert (depth[~seen] == 0).all()
        rays = np.array([camera.cam_from_img(pixel) for pixel in pixel_grid(0.5).reshape(-1, 2)])
        rays = np.concatenate([rays, np.ones((len(rays), 1))], axis=1).reshape(*depth.shape, 3)
        rotation, translation = world_from_camera.rotation.matrix(), world_from_camera.translation
        points = depth[..., None] * rays @ rotation.T + translation
        points[~seen] = np.nan
        assert seen_error(points, images["points"][frame]).max() < 1e-5
        # COLMAP stores three planes; pycolmap 4.2 returns them as if x, y and z of a pixel were interleaved.
        planes = np.frombuffer(normal_path.read_bytes().split(b"&", 3)[3], dtype="<f4")
        normals = planes.reshape(3, *depth.shape).transpose(1, 2, 0)
        assert (normals[~seen] == 0).all()
        np.testing.assert_allclose(normals[seen] @ rotation.T, images["normals"][frame][seen], atol=1e-6)


def test_trimesh_reads_ply(tmp_path, rendered):
    write(tmp_path, rendered, "ply")
    images = rendered["z"][2]
    for frame in range(FRAMES):
        cloud = trimesh.load(tmp_path / "clouds" / frame_file(frame, ".ply"), process=False)
        seen = np.isfinite(images["depth"][frame])
        np.testing.assert_array_equal(np.float32(cloud.vertices), images["points"][frame][seen])
        data = cloud.metadata["_ply_raw"]["vertex"]["data"]
        assert data.dtype.names == ("x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "label", "object")
        assert [data.dtype[name].str for name in ("x", "nz", "red", "label", "object")] == [
            "<f4", "<f4", "|u1", "|u1", "<i4"
        ]  # fmt: skip
        np.testing.assert_array_equal(cloud.colors[:, :3], images["color"][frame][seen])
        normals = np.stack([data["nx"], data["ny"], data["nz"]], axis=-1).reshape(-1, 3)
        np.testing.assert_array_equal(normals, images["normals"][frame][seen])
        np.testing.assert_array_equal(data["label"].ravel(), images["labels"][frame][seen])
        np.testing.assert_array_equal(data["object"].ravel(), images["segmentation"][frame][seen])
    names = json.loads((tmp_path / "clouds.json").read_text())
    assert [item["name"] for item in names["object"]] == ["floor", "ball", "box"]


@pytest.mark.parametrize("organized", [True, "true"])
def test_organized_ply_has_one_point_per_pixel(tmp_path, rendered, organized):
    write(tmp_path, rendered, "ply", outputs=("points", "segmentation"), options={"organized": organized})
    images = rendered["z"][2]
    path = tmp_path / "clouds" / frame_file(4, ".ply")
    data = trimesh.load(path, process=False).metadata["_ply_raw"]["vertex"]["data"]
    points = np.stack([data["x"], data["y"], data["z"]], axis=-1).reshape(CAMERA.height, CAMERA.width, 3)
    np.testing.assert_array_equal(points, images["points"][4])
    assert np.isnan(points).any()
    np.testing.assert_array_equal(data["object"].reshape(CAMERA.height, CAMERA.width), images["segmentation"][4])
    header = path.read_bytes().split(b"end_header\n")[0].decode("ascii").splitlines()
    assert header[2:5] == ["obj_info num_cols 48", "obj_info num_rows 36", f"element vertex {48 * 36}"]


@pytest.mark.parametrize("kind", OUTPUTS)
def test_bytes_do_not_depend_on_threads(tmp_path, rendered, kind):
    for threads in (1, 3):
        write(tmp_path / str(threads), rendered, kind, threads=threads)
    once, again = bytes_of(tmp_path / "1"), bytes_of(tmp_path / "3")
    assert once.keys() == again.keys()
    assert once == again
    frames = {name for name in once if Path(name).stem.split(".")[0].isdigit()}
    images = {"ply": 1}.get(kind, len(OUTPUTS[kind]))
    assert len(frames) == FRAMES * images


@pytest.mark.parametrize("kind", OUTPUTS)
def test_single_output(tmp_path, rendered, kind):
    default = find_format(kind).default_outputs
    assert set(default) <= set(find_format(kind).outputs) - set(SENSOR_NAMES) == set(OUTPUTS[kind])
    write(tmp_path, rendered, kind, outputs=default[:1])
    assert len({name.split("/")[0] for name in bytes_of(tmp_path)}) > 1


@pytest.mark.parametrize("kind", OUTPUTS)
def test_render_batch_writes_the_same_files(tmp_path, rendered, kind):
    scene, poses, _ = rendered["z"]
    frames = Frames.from_poses(poses, timestamps=TIMES)
    options = {"format": kind, "outputs": OUTPUTS[kind], "shard_frames": SHARD_FRAMES}
    render_batch(scene, CAMERA, frames, tmp_path / "job", **options)
    write(tmp_path / "alone", rendered, kind)
    whole, alone = bytes_of(tmp_path / "job"), bytes_of(tmp_path / "alone")
    assert {name: whole.get(name) for name in alone} == alone
    for name in ("groundtruth.txt", "transforms.json"):
        if name in whole:
            matrices = poses_to_matrices(read_frames(tmp_path / "job" / name).camera_to_world)
            np.testing.assert_allclose(matrices, poses_to_matrices(poses), atol=1e-14)


@pytest.mark.parametrize("kind", OUTPUTS)
def test_empty_frame(tmp_path, rendered, kind):
    poses = [wv.look_at((0, 0, 3), (0, 1, 6))]
    views = wv.render(rendered["z"][0], CAMERA, poses, outputs=OUTPUTS[kind])
    images = {name: getattr(views, name).numpy() for name in OUTPUTS[kind]}
    plan = plan_of(rendered, kind, frames=Frames.from_poses(poses))
    files = ShardFiles(tmp_path)
    find_format(kind)(plan).write_shard(0, images, files)
    assert files.warnings == {}
    for path in tmp_path.rglob("*.png"):
        assert not read_image(path)[1].any()
    for path in tmp_path.rglob("*.bin"):
        assert not any(path.read_bytes().split(b"&", 3)[3])
    for path in tmp_path.rglob("*.ply"):
        assert b"element vertex 0\n" in path.read_bytes()
        assert path.read_bytes().endswith(b"end_header\n")
    assert files.sums()
