# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Color images in all formats of datasets, read back by public readers and by `open_dataset`."""

import json

import cv2
import numpy as np
import pytest
import trimesh
from batch_jobs import CAMERA, FORMATS, make_poses, run, tree
from PIL import Image

import warpvis as wv
from warpvis.cameras.frames import Frames
from warpvis.errors import FileFormatError
from warpvis.io import encode_colors, encode_pngs
from warpvis.scene.lights import Background, Light
from warpvis.scene.materials import Appearance, Material, Texture

FRAMES = 7
OUTPUTS = {
    "npz": ("depth", "color"),
    "zarr": ("depth", "color"),
    "png": ("depth", "color", "albedo"),
    "ply": ("points", "color"),
    "ros2": ("depth", "color"),
}
"""Outputs of formats that do not write color by default."""
FOLDERS = {"png": "color", "tum": "rgb", "bop": "train", "nerfstudio": "images", "colmap": "images"}
"""Folders of color images, with one file per frame."""
LOSSY = 40
"""Maximum difference of a JPEG of the scene at its edges, of 255. WebP stores colors at half the resolution."""


def make_scene(ball=(0.9, 0.1, 0.2)):
    """Return a checkered floor, a box and a ball under a lamp and a blue sky."""
    scene = wv.Scene()
    rows, columns = np.indices((8, 8))
    checker = np.where(((rows + columns) % 2 == 0)[..., None], [230, 220, 200], [60, 90, 60]).astype(np.uint8)
    corners = np.array([[-3.0, -3, 0], [3, -3, 0], [3, 3, 0], [-3, 3, 0]])
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    uv = (corners[faces][..., :2] / 6 + 0.5).astype(np.float32)
    floor = Appearance((Material(texture=Texture(checker, filter="nearest")),), uv=uv)
    scene.add((corners, faces), name="floor", label="ground", appearance=floor)
    box = trimesh.creation.box((0.5, 0.5, 1.0))
    scene.add(box, name="box", pose=(0.6, 0, 0.5, 0, 0, 0, 1), appearance=(0.2, 0.4, 0.9))
    sphere = trimesh.creation.icosphere(subdivisions=2, radius=0.4)
    scene.add(sphere, name="ball", label="object", pose=(-0.5, 0.3, 0.4, 0, 0, 0, 1), appearance=ball)
    scene.lights = (Light("directional", direction=(0.3, 0.5, -1.0)), Light("ambient", ambient=(0.3, 0.3, 0.3)))
    scene.background = Background(color=(0.5, 0.7, 1.0))
    return scene


def write(out, kind, *, scene=None, **options):
    """Write a data set of seven frames in shards of three."""
    frames = Frames.from_poses(make_poses(FRAMES), timestamps=1.7e9 + np.arange(FRAMES) / 30)
    options = {"outputs": OUTPUTS.get(kind)} | options
    return run(out, scene=scene or make_scene(), frames=frames, format=kind, **options)


@pytest.fixture(scope="module")
def rendered():
    """Return depth, points, colors and object indices of the frames."""
    names = ("depth", "points", "color", "albedo", "segmentation")
    views = wv.render(make_scene(), CAMERA, make_poses(FRAMES), outputs=names)
    images = {name: getattr(views, name).numpy() for name in names}
    assert len(np.unique(images["color"].reshape(-1, 3), axis=0)) > 30
    return images


def color_files(out, kind, suffix=".png"):
    """Return the color images of a data set, in the order of its frames."""
    files = sorted((out / FOLDERS[kind]).rglob(f"{'rgb/' if kind == 'bop' else ''}*{suffix}"))
    assert len(files) == FRAMES
    return files


def difference(image, expected):
    return np.abs(np.asarray(image).astype(int) - expected).max()


@pytest.mark.parametrize("shape", [(1, 1), (1, 2), (3, 1), (1, 4), (37, 53)])
def test_png_of_color_reads_back_with_pillow_and_opencv(tmp_path, shape):
    images = np.random.default_rng(0).integers(0, 256, (2, *shape, 3), dtype=np.uint8)
    for pixels in (images, images[:, ::-1], images[:, :, ::-2], images[..., ::-1]):
        for place, data in enumerate(encode_pngs(pixels)):
            (tmp_path / "image.png").write_bytes(data)
            with Image.open(tmp_path / "image.png") as image:
                assert image.mode == "RGB"
                np.testing.assert_array_equal(np.asarray(image), pixels[place])
            read = cv2.imread(str(tmp_path / "image.png"), cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(read[..., ::-1], pixels[place])


@pytest.mark.parametrize("kind", ["jpeg", "webp"])
def test_quality_of_lossy_images(rendered, kind):
    sizes, errors = [], []
    for quality in (30, 75, 95):
        (data,) = encode_colors(rendered["color"][:1], kind, quality)
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        sizes.append(len(data))
        errors.append(np.abs(image.astype(int) - rendered["color"][0]).mean())
    assert sizes == sorted(sizes)
    assert errors == sorted(errors, reverse=True)
    assert sizes[0] < sizes[2]
    assert errors[2] < {"jpeg": 3, "webp": 8}[kind]


@pytest.mark.parametrize("file", ["png", "jpeg", "webp"])
@pytest.mark.parametrize("kind", [kind for kind in FORMATS if kind != "ply"])
def test_open_dataset_returns_color(tmp_path, rendered, kind, file):
    if file != "png" and (kind not in FOLDERS or (kind, file) == ("bop", "webp")):
        pytest.skip("the format has no such files")
    options = None if file == "png" else {"color": file, "quality": 98}
    write(tmp_path / "out", kind, options=options)
    dataset = wv.open_dataset(tmp_path / "out")
    assert {"color", "depth"} <= set(dataset.outputs)
    color = dataset["color"]
    assert (color.dtype, color.shape) == (np.uint8, (FRAMES, CAMERA.height, CAMERA.width, 3))
    tolerance = {"png": 0, "jpeg": LOSSY, "webp": 255}[file]
    assert difference(color[:], rendered["color"]) <= tolerance
    assert difference(dataset[5]["color"], rendered["color"][5]) <= tolerance
    assert np.abs(color[:].astype(int) - rendered["color"]).mean() < {"png": 1, "jpeg": 2, "webp": 8}[file]
    if kind == "png":
        assert difference(dataset["albedo"][:], rendered["albedo"]) <= tolerance


def test_samples_smooth_edges_of_data_sets(tmp_path, rendered):
    write(tmp_path / "out", "npz", samples=4)
    smooth = wv.render(make_scene(), CAMERA, make_poses(FRAMES), outputs="color", samples=4).color.numpy()
    np.testing.assert_array_equal(wv.open_dataset(tmp_path / "out")["color"][:], smooth)
    assert (smooth != rendered["color"]).any()
    assert json.loads((tmp_path / "out/manifest.json").read_text())["samples"] == 4
    with pytest.raises(wv.WarpvisError, match="samples"):
        write(tmp_path / "out", "npz", resume=True)
    with pytest.raises(wv.WarpvisError, match=r"samples must be 1, 2, 4, 8, 16 per pixel, got 3"):
        write(tmp_path / "other", "npz", samples=3)


def test_shadows_of_data_sets_are_optional(tmp_path, rendered):
    write(tmp_path / "out", "npz", shadows=False)
    dataset = wv.open_dataset(tmp_path / "out")
    bright = wv.render(make_scene(), CAMERA, make_poses(FRAMES), outputs="color", shadows=False).color.numpy()
    np.testing.assert_array_equal(dataset["color"][:], bright)
    assert (bright != rendered["color"]).any()
    assert json.loads((tmp_path / "out/manifest.json").read_text())["shadows"] is False
    with pytest.raises(wv.WarpvisError, match="shadows"):
        write(tmp_path / "out", "npz", resume=True)
    write(tmp_path / "depth", "npz", outputs=["depth"])
    assert "shadows" not in json.loads((tmp_path / "depth/manifest.json").read_text())
    with pytest.raises(wv.WarpvisError, match="shadows must be"):
        write(tmp_path / "other", "npz", shadows="soft")


@pytest.mark.parametrize("kind", FOLDERS)
def test_files_of_color_have_8_bits_without_alpha(tmp_path, rendered, kind):
    for options, suffix, container in ((None, ".png", "PNG"), ({"color": "jpeg"}, ".jpg", "JPEG")):
        write(tmp_path / suffix, kind, options=options)
        for path, expected in zip(color_files(tmp_path / suffix, kind, suffix), rendered["color"], strict=True):
            with Image.open(path) as image:
                assert (image.mode, image.format, image.size) == ("RGB", container, (CAMERA.width, CAMERA.height))
            read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
            assert read.dtype == np.uint8
            assert difference(read[..., ::-1], expected) <= (LOSSY if options else 0)


def test_tum_lists_color_and_depth_at_the_same_times(tmp_path, rendered):
    write(tmp_path, "tum")
    lists = {}
    for name in ("rgb", "depth"):
        rows = [line.split() for line in (tmp_path / f"{name}.txt").read_text().splitlines() if line[0] != "#"]
        lists[name] = {float(time): file for time, file in rows}
    assert lists["rgb"].keys() == lists["depth"].keys()
    pairs = [line.split() for line in (tmp_path / "associations.txt").read_text().splitlines()]
    assert [(float(pair[0]), pair[1]) for pair in pairs] == list(lists["rgb"].items())
    assert [(float(pair[2]), pair[3]) for pair in pairs] == list(lists["depth"].items())
    for file, expected in zip(lists["rgb"].values(), rendered["color"], strict=True):
        np.testing.assert_array_equal(np.asarray(Image.open(tmp_path / file)), expected)


@pytest.mark.parametrize("kind", ["tum", "ros2"])
def test_open_recording_joins_color_with_depth(tmp_path, rendered, kind):
    write(tmp_path / "out", kind, shard_frames=FRAMES)
    recording = wv.open_recording(tmp_path / "out" / "bag_000000" if kind == "ros2" else tmp_path / "out")
    assert len(recording) == FRAMES
    for frame, color, depth in zip(recording, rendered["color"], rendered["depth"], strict=True):
        np.testing.assert_array_equal(frame.color, color)
        seen = np.isfinite(depth)
        np.testing.assert_allclose(frame.depth[seen], depth[seen], atol=2e-4)


def test_bop_colors_lie_within_the_masks(tmp_path, rendered):
    write(tmp_path, "bop", scene=make_scene())
    index = [item.name for item in make_scene()].index("ball")
    for frame, path in enumerate(color_files(tmp_path, "bop")):
        color = np.asarray(Image.open(path)).astype(int)
        mask = np.asarray(Image.open(path.parents[1] / "mask_visib" / f"{path.stem}_000000.png")) > 0
        np.testing.assert_array_equal(mask, rendered["segmentation"][frame] == index)
        red = color[..., 0] > 2 * color[..., 1]
        assert mask.any()
        np.testing.assert_array_equal(red, mask)


def test_pycolmap_finds_an_image_file_of_every_pose(tmp_path, rendered):
    import pycolmap

    write(tmp_path, "colmap", options={"color": "jpeg"})
    model = pycolmap.Reconstruction()
    model.read_text(str(tmp_path / "sparse"))
    assert model.num_images() == FRAMES
    for frame, expected in enumerate(rendered["color"]):
        image = model.image(frame + 1)
        bitmap = pycolmap.Bitmap.read(tmp_path / "images" / image.name, True)
        assert difference(bitmap.to_array(), expected) <= LOSSY
        assert (tmp_path / "stereo/depth_maps" / f"{image.name}.geometric.bin").is_file()


def test_ros_images_have_the_frame_and_times_of_depth(tmp_path, rendered):
    from rosbags.highlevel import AnyReader

    write(tmp_path, "ros2", shard_frames=FRAMES, options={"color_topic": "rgb", "frame_id": "optical"})
    with AnyReader([tmp_path / "bag_000000"]) as bag:
        messages = {item.topic: [] for item in bag.connections}
        for connection, _, data in bag.messages():
            messages[connection.topic].append(bag.deserialize(data, connection.msgtype))
    assert sorted(messages) == [
        "/camera/depth/camera_info", "/camera/depth/image_rect", "/rgb/camera_info", "/rgb/image_rect", "/tf"
    ]  # fmt: skip
    depths, infos = messages["/camera/depth/image_rect"], messages["/rgb/camera_info"]
    for image, depth, info, expected in zip(messages["/rgb/image_rect"], depths, infos, rendered["color"], strict=True):
        assert (image.encoding, image.step, image.is_bigendian) == ("rgb8", 3 * CAMERA.width, 0)
        assert image.header == depth.header == info.header
        assert image.header.frame_id == "optical"
        np.testing.assert_array_equal(image.data.reshape(expected.shape), expected)


def test_color_topic_of_depth_raises(tmp_path):
    with pytest.raises(FileFormatError, match="color_topic must not be the topic of depth, got '/camera/depth'"):
        write(tmp_path / "out", "ros2", options={"color_topic": "camera/depth/"})


@pytest.mark.parametrize(
    ("change", "difference"),
    [
        (lambda scene: scene.add(trimesh.creation.box(), name="more"), "object 'more' is new"),
        (lambda scene: setattr(scene, "lights", Light("headlight")), "the lights differ"),
        (lambda scene: setattr(scene, "background", None), "the lights differ"),
        (None, "the appearances differ"),
    ],
)
def test_other_colors_cannot_be_resumed(tmp_path, change, difference):
    write(tmp_path, "tum")
    scene = make_scene(ball=(0.9, 0.1, 0.3) if change is None else (0.9, 0.1, 0.2))
    if change is not None:
        change(scene)
    with pytest.raises(FileFormatError, match=f"was started with other input: .*{difference}"):
        write(tmp_path, "tum", scene=scene, resume=True)
    assert write(tmp_path, "tum", resume=True).rendered_frames == 0


def test_textures_are_compared_by_content_without_names(tmp_path):
    def textured(folder, value):
        folder.mkdir(exist_ok=True)
        Image.fromarray(np.full((4, 4, 3), value, np.uint8)).save(folder / "wood.png")
        scene = make_scene()
        scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), appearance=Material(texture=Texture(folder / "wood.png")))
        return scene

    write(tmp_path / "out", "tum", scene=textured(tmp_path / "a", 10))
    write(tmp_path / "out", "tum", scene=textured(tmp_path / "b", 10), resume=True)
    with pytest.raises(FileFormatError, match="the appearances differ"):
        write(tmp_path / "out", "tum", scene=textured(tmp_path / "b", 11), resume=True)


def test_depth_is_resumed_with_other_colors(tmp_path):
    write(tmp_path, "tum", outputs=("depth",))
    write(tmp_path, "tum", outputs=("depth",), scene=make_scene(ball=(0, 0, 1)), resume=True)
    assert "appearances" not in json.loads((tmp_path / "manifest.json").read_text())["scene"]
    assert sorted(path.name for path in tmp_path.glob("*.txt")) == ["calibration.txt", "depth.txt", "groundtruth.txt"]


@pytest.mark.parametrize("kind", ["tum", "colmap"])
def test_bytes_of_jpeg_do_not_depend_on_threads_and_name_the_encoder(tmp_path, kind):
    for threads in (1, 4):
        write(tmp_path / str(threads), kind, threads=threads, options={"color": "jpeg"})
    assert tree(tmp_path / "1") == tree(tmp_path / "4")
    manifest = json.loads((tmp_path / "1" / "manifest.json").read_text())
    assert manifest["versions"]["pillow"] == Image.__version__
    assert manifest["options"] == {"color": "jpeg"}


@pytest.mark.parametrize("kind", FOLDERS)
def test_damaged_color_files_raise(tmp_path, kind):
    write(tmp_path, kind)
    dataset = wv.open_dataset(tmp_path)
    first, second, third, *_ = color_files(tmp_path, kind)
    Image.new("L", (CAMERA.width, CAMERA.height)).save(first)
    second.write_bytes(second.read_bytes()[:100])
    third.unlink()
    for frame, message in enumerate([r"must have shape \(24, 32, 3\), got \(24, 32\)", "damaged", "is missing"]):
        with pytest.raises(FileFormatError, match=message):
            dataset.read("color", frame)
