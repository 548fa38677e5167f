# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""BOP datasets, checked from their files alone: BOP's definitions in float64 NumPy, applied to models and poses."""

import dataclasses
import json
import math

import numpy as np
import pytest
import trimesh
from PIL import Image
from pose_samples import unit

import warpvis as wv
from warpvis.batch import find_format, make_plan, render_batch
from warpvis.batch.storage._output import ShardFiles
from warpvis.cameras.frames import Frames
from warpvis.core.threads import Crew
from warpvis.scene.worlds import pose_columns
from warpvis.visibility import object_visibility

WIDTH, HEIGHT, FRAMES, SHARD = 40, 30, 50, 30
CAMERA = wv.Camera(WIDTH, HEIGHT, 38.0, 37.0, 19.3, 15.6, near=0.6, far=4.5)
OBJECTS = ("ball", "cup", "cart", "buried")
EDGE = 3e-4  # [px]: closer to a triangle's edge, single precision may differ
ROUNDING = 0.2  # [mm]: error of the depth image along a ray


def table():
    """Return a scene with two static objects, a movable one, a buried one, a wall and a floor."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((8, 8, 0.1)), name="floor", label="ground", pose=(0, 0, -0.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((0.1, 1.0, 0.6)), name="wall", pose=(0.9, 0.2, 0.3, 0, 0, 0.2, 0.98))
    scene.add(trimesh.creation.icosahedron(), name="ball", label="object", scale=0.35, pose=(1.6, 0.1, 0.4, 0, 0, 0, 1))
    tilted = unit((0.4, -0.5, 0.25, 0, 0.1, 0.3, 0.94))
    scene.add(trimesh.creation.box((0.3, 0.2, 0.5)), name="cup", label="object", pose=tilted)
    scene.add(
        trimesh.creation.box((0.5, 0.3, 0.2)), name="cart", label="object", movable=True, pose=(0, 0, 1, 0, 0, 0, 1)
    )
    scene.add(trimesh.creation.box((0.2, 0.2, 0.2)), name="buried", label="object", pose=(0.5, 0.5, -0.3, 0, 0, 0, 1))
    return scene


def walk(seed=7):
    """Return cameras all around, some close enough for clipping by range and image border, and a moving cart."""
    rng = np.random.default_rng(seed)
    angle, radius = rng.uniform(0, 2 * np.pi, FRAMES), rng.uniform(0.9, 4.6, FRAMES)
    eyes = np.stack([0.8 + radius * np.cos(angle), radius * np.sin(angle), rng.uniform(0.2, 2.0, FRAMES)], axis=1)
    targets = rng.uniform([0.2, -0.6, 0.0], [1.7, 0.6, 0.7], (FRAMES, 3))
    poses = [wv.look_at(eye, target) for eye, target in zip(eyes, targets, strict=True)]
    cart = np.concatenate(
        [rng.uniform([-0.5, -1, 0.1], [2, 1, 0.5], (FRAMES, 3)), rng.normal(size=(FRAMES, 4))], axis=1
    )
    return Frames.from_poses(np.array(poses), object_poses=unit(cart)[:, None].astype(np.float32))


def plan_of(scene, frames, *, camera=CAMERA, shard_frames=SHARD, chosen=OBJECTS, **changes):
    given = {
        "frames": frames,
        "camera": camera,
        "outputs": ("depth", "visibility"),
        "shard_frames": shard_frames,
        "object_names": tuple(item.name for item in scene),
        "object_labels": tuple(int(item.label) for item in scene),
        "object_columns": tuple(pose_columns(scene).tolist()),
        "object_centers": tuple(tuple(item.bounds.astype(np.float64).mean(axis=0).tolist()) for item in scene),
        "chosen": tuple(scene.index(name) for name in chosen),
    }
    return dataclasses.replace(make_plan(scene, camera, frames, find_format("npz")), **(given | changes))


def images_of(scene, plan, frames, layout):
    """Return the images that the job's renderer passes to a format that requests unclipped masks."""
    moved = {"object_poses": frames.object_poses, "world_index": frames.world_index}
    depth = wv.render(scene, plan.camera, frames.camera_to_world, outputs=("depth",), **moved).depth
    anywhere = dataclasses.replace(plan.camera, near=0.0, far=math.inf)
    options = {"objects": plan.chosen, "delta": layout.delta, "masks": layout.masks, **moved}
    seen = object_visibility(scene, anywhere, frames.camera_to_world, **options)
    names = ("masks", "image_pixels", "silhouette_pixels", "silhouette_box")
    return {"depth": depth.numpy()} | {name: getattr(seen, name).numpy() for name in names}


def write(folder, scene, plan, threads=None):
    """Write a dataset as the job does, but in one folder."""
    layout, files = find_format("bop")(plan), ShardFiles(folder)
    layout.encoders = None if threads is None else Crew(threads, "encoder")
    units = []
    for shard in range(plan.shard_count):
        images = images_of(scene, plan, plan.frames[plan.shard_slice(shard)], layout)
        units += layout.write_shard(shard, images, files)
    units += layout.write_models(files, scene) + layout.index(files)
    written = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert all(any(name == unit or name.startswith(unit + "/") for unit in units) for name in written)
    return files


@pytest.fixture(scope="module")
def dataset(tmp_path_factory):
    folder, scene, frames = tmp_path_factory.mktemp("bop"), table(), walk()
    files = write(folder, scene, plan_of(scene, frames, options={"depth_scale": "0.1", "split": "train_pbr"}))
    assert files.warnings == {}
    return folder, scene, frames


def read_png(path, dtype=np.uint8):
    image = np.array(Image.open(path))
    assert image.dtype == dtype
    return image


def read_json(path):
    return {int(key): value for key, value in json.loads(path.read_text()).items()}


def meet(vertices, faces, directions):
    """Return the depth at which rays ``(n, 3)`` from the origin with z = 1 hit triangles, and uncertain rays.

    Depth is +inf for a miss. A ray hits a triangle if the signed volumes with its three edges have the same sign
    (Moller
    and Trumbore 1997 without the division); the depth is that of the triangle's plane. A ray is uncertain if it passes
    so
    close to an edge that single precision may differ.
    """
    depth, doubtful = np.full(len(directions), np.inf), np.zeros(len(directions), dtype=bool)
    for a, b, c in vertices[faces]:
        normal, edges = np.cross(b - a, c - a), np.stack([np.cross(a, b), np.cross(b, c), np.cross(c, a)], axis=1)
        with np.errstate(divide="ignore", invalid="ignore"):
            z = (a @ normal) / (directions @ normal)
        # Volumes in units of their change by EDGE: within 1 of 0, the ray is that close to the edge.
        sides = directions @ (edges / np.linalg.norm(edges[:2], axis=0) * (CAMERA.fx / EDGE))
        low, high = sides.min(axis=1), sides.max(axis=1)
        depth = np.where(((low > 0) | (high < 0)) & (z > 0) & (z < depth), z, depth)
        doubtful |= ((np.abs(low) < 1) | (np.abs(high) < 1)) & (z > 0)
    return depth, doubtful


def rays(K, columns, rows):
    """Return rays of pixels with centers at whole numbers, as in BOP's toolkit."""
    x, y = np.meshgrid(columns, rows)
    return np.stack([(x - K[0, 2]) / K[0, 0], (y - K[1, 2]) / K[1, 1], np.ones(x.shape)], axis=-1)


def box_of(mask, x0=0, y0=0):
    """Return BOP's box: its width and height are last minus first column and row."""
    ys, xs = mask.nonzero()
    return [int(v) for v in (xs.min() + x0, ys.min() + y0, xs.max() - xs.min(), ys.max() - ys.min())]


def judge(alone_canvas, depth, directions, delta=15.0, missing_is_visible=True):
    """Apply BOP's definition to an object rendered alone on a canvas of 3 W x 3 H [mm] and the depth image [mm]."""
    inner = slice(HEIGHT, 2 * HEIGHT), slice(WIDTH, 2 * WIDTH)
    length = np.linalg.norm(directions[inner], axis=-1)
    alone = alone_canvas[inner]
    there = np.isfinite(alone)
    difference = np.where(there, alone, 0) * length - depth * length
    visible = there & (difference <= delta) & (depth > 0)
    if missing_is_visible:
        visible |= there & (depth == 0)
    info = {
        "px_count_all": int(np.isfinite(alone_canvas).sum()),
        "px_count_valid": int((depth[there] > 0).sum()),
        "px_count_visib": int(visible.sum()),
        "bbox_obj": box_of(np.isfinite(alone_canvas), -WIDTH, -HEIGHT) if visible.any() else [-1] * 4,
        "bbox_visib": box_of(visible) if visible.any() else [-1] * 4,
    }
    info["visib_fract"] = info["px_count_visib"] / info["px_count_all"] if info["px_count_all"] else 0.0
    return there, visible, info, there & (depth > 0) & (np.abs(difference - delta) < ROUNDING)


@pytest.mark.slow
def test_counts_boxes_and_masks_match_bops_definition(dataset):
    """Values are equal if no ray of the canvas is within 3e-4 px of an edge and no depth within rounding of delta.

    Otherwise all other pixels are equal.
    """
    folder, _, frames = dataset
    models = [trimesh.load(folder / f"models/obj_{k:06d}.ply", process=False) for k in range(1, 5)]
    kinds, exact, every = set(), 0, 0
    for frame in range(len(frames)):
        part, image = folder / f"train_pbr/{frame // SHARD:06d}", frame % SHARD
        camera, gt, info = (read_json(part / f"scene_{n}.json")[image] for n in ("camera", "gt", "gt_info"))
        K = np.array(camera["cam_K"]).reshape(3, 3)
        depth = read_png(part / f"depth/{image:06d}.png", np.uint16) * camera["depth_scale"]
        directions = rays(K, np.arange(-WIDTH, 2 * WIDTH), np.arange(-HEIGHT, 2 * HEIGHT))
        assert [entry["obj_id"] for entry in gt] == [1, 2, 3, 4]
        for place, (entry, got) in enumerate(zip(gt, info, strict=True)):
            R, t = np.array(entry["cam_R_m2c"]).reshape(3, 3), np.array(entry["cam_t_m2c"])
            met = meet(models[place].vertices @ R.T + t, models[place].faces, directions.reshape(-1, 3))
            z, doubtful = (each.reshape(3 * HEIGHT, -1) for each in met)
            alone, visible, wanted, close = judge(z, depth, directions)
            unsure = doubtful[HEIGHT : 2 * HEIGHT, WIDTH : 2 * WIDTH] | close
            for name, mask in (("mask", alone), ("mask_visib", visible)):
                written = read_png(part / f"{name}/{image:06d}_{place:06d}.png")
                assert set(np.unique(written)) <= {0, 255} and written.shape == (HEIGHT, WIDTH)
                assert ((written > 0) == mask)[~unsure].all(), (frame, place, name)
            every += 1
            if not (doubtful.any() or unsure.any()):
                exact += 1
                assert got == wanted, (frame, place)
            kinds |= {
                ("cut", 0 < np.isfinite(z).sum() - alone.sum() and alone.any()),
                ("hidden", alone.any() and not visible.any()),
                ("partly", 0 < visible.sum() < alone.sum()),
                ("no depth", bool((depth[visible] == 0).any())),
                ("buried", place == 3 and alone.any() and visible.sum() == 0),
            }
    assert exact > 0.9 * every
    assert {(kind, True) for kind in ("cut", "hidden", "partly", "no depth", "buried")} <= kinds


def test_depth_back_projects_to_the_world_within_1_mm(dataset):
    """With pixel centers shifted by 0.5 px, the error is larger."""
    folder, scene, frames = dataset
    x, y = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    directions = np.stack([(x - CAMERA.cx) / CAMERA.fx, (y - CAMERA.cy) / CAMERA.fy, np.ones(x.shape)], axis=-1)
    for frame in range(0, len(frames), 5):
        part, image = folder / f"train_pbr/{frame // SHARD:06d}", frame % SHARD
        camera = read_json(part / "scene_camera.json")[image]
        K, R = (np.array(camera[name]).reshape(3, 3) for name in ("cam_K", "cam_R_w2c"))
        depth = read_png(part / f"depth/{image:06d}.png", np.uint16) * camera["depth_scale"]
        placed = place(scene, frames, frame)
        c2w = matrix_of(frames.camera_to_world[frame])
        inside = [((v - c2w[:3, 3]) @ c2w[:3, :3], f) for v, f in placed]
        met = [meet(v, f, directions.reshape(-1, 3)) for v, f in inside]
        z = np.min([m[0] for m in met], axis=0).reshape(HEIGHT, WIDTH)
        sure = ~np.any([m[1] for m in met], axis=0).reshape(HEIGHT, WIDTH)
        measured = (z >= CAMERA.near) & (z <= CAMERA.far)
        assert ((depth > 0) == measured)[sure & (abs(z - CAMERA.far) > 1e-5) & (abs(z - CAMERA.near) > 1e-5)].all()
        shown = sure & measured
        truth = (directions * z[..., None])[shown] @ c2w[:3, :3].T + c2w[:3, 3]
        for shift, off in ((0.0, False), (0.5, True)):
            back = rays(K, np.arange(WIDTH) + shift, np.arange(HEIGHT) + shift)[shown] * depth[shown][:, None]
            world = (back - camera["cam_t_w2c"]) @ R
            error = np.linalg.norm(world - truth * 1000, axis=-1)
            assert error.min() > 1 if off else error.max() < 1, (frame, error.max())


def matrix_of(pose):
    matrix = np.eye(4)
    x, y, z, w = pose[3:] / np.linalg.norm(pose[3:])
    u = np.array([x, y, z])
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    matrix[:3, :3] = (w * w - u @ u) * np.eye(3) + 2 * np.outer(u, u) + 2 * w * cross
    matrix[:3, 3] = pose[:3]
    return matrix


def place(scene, frames, frame):
    """Return world vertices and faces of all objects in a frame."""
    placed = []
    for item in scene:
        vertices = item.vertices.astype(np.float64)
        if item.movable:
            pose = matrix_of(frames.object_poses[frame, 0].astype(np.float64))
            vertices = item.mesh_vertices.astype(np.float64) @ pose[:3, :3].T + pose[:3, 3]
        placed.append((vertices, item.faces))
    return placed


def test_equal_meshes_share_a_model(tmp_path):
    """Instances of an object share its number and are distinguished by their order in an image."""
    scene, cup = wv.Scene(), trimesh.creation.cylinder(0.05, 0.1)
    scene.add(trimesh.creation.box((2, 2, 0.1)), name="floor", label="ground")
    places = np.array([[(x, 0, 0.1, 0, 0, 0, 1) for x in (0.0, 0.3, 0.6)]], dtype=np.float32)
    for name, mesh, place in zip(
        ("cup", "can", "cup 2"), (cup, trimesh.creation.box((0.1,) * 3), cup), places[0], strict=True
    ):
        scene.add(mesh, name=name, label="object", pose=place, movable=True)
    frames = Frames.from_poses([wv.look_at((0.3, -1.5, 0.8), (0.3, 0, 0))], object_poses=places)
    render_batch(scene, CAMERA, frames, tmp_path / "set", format="bop")
    gt = read_json(tmp_path / "set/train/000000/scene_gt.json")[0]
    assert [entry["obj_id"] for entry in gt] == [1, 2, 1]
    assert gt[0]["cam_t_m2c"] != gt[2]["cam_t_m2c"]
    infos = read_json(tmp_path / "set/models/models_info.json")
    assert [infos[k]["names"] for k in (1, 2)] == [["cup", "cup 2"], ["can"]] and infos[1]["name"] == "cup"
    assert sorted(path.name for path in (tmp_path / "set/models").glob("*.ply")) == ["obj_000001.ply", "obj_000002.ply"]
    dataset = wv.open_dataset(tmp_path / "set")
    assert dataset.visibility_objects == ("cup", "can", "cup 2") and (dataset[0]["visible_pixels"] > 0).all()


def test_models_coincide_with_objects(dataset):
    """Model-to-camera and world-to-camera transforms agree for every vertex."""
    folder, scene, frames = dataset
    infos = read_json(folder / "models/models_info.json")
    assert [infos[k]["name"] for k in range(1, 5)] == list(OBJECTS)
    for number, name in enumerate(OBJECTS, start=1):
        model = trimesh.load(folder / f"models/obj_{number:06d}.ply", process=False)
        info = infos[number]
        size = model.vertices.max(axis=0) - model.vertices.min(axis=0)
        assert [info[f"size_{axis}"] for axis in "xyz"] == pytest.approx(size, abs=1e-3)
        assert [info[f"min_{axis}"] for axis in "xyz"] == pytest.approx(
            -size / 2, abs=1e-3
        )  # the origin is in its middle
        steps = model.vertices[:, None] - model.vertices
        assert info["diameter"] == pytest.approx(np.linalg.norm(steps, axis=2).max(), abs=1e-3)
        for frame in (0, 31, 49):
            part, image = folder / f"train_pbr/{frame // SHARD:06d}", frame % SHARD
            camera, gt = (read_json(part / f"scene_{n}.json")[image] for n in ("camera", "gt"))
            R, t = np.array(gt[number - 1]["cam_R_m2c"]).reshape(3, 3), np.array(gt[number - 1]["cam_t_m2c"])
            vertices = place(scene, frames, frame)[scene.index(name)][0] * 1000
            wanted = vertices @ np.array(camera["cam_R_w2c"]).reshape(3, 3).T + camera["cam_t_w2c"]
            assert np.abs(model.vertices @ R.T + t - wanted).max() < 1e-3


def test_intrinsics_have_pixel_centers_at_whole_numbers(dataset):
    folder, _, _ = dataset
    camera = json.loads((folder / "camera.json").read_text())
    assert camera == {"fx": 38, "fy": 37, "cx": 18.8, "cy": 15.1, "width": WIDTH, "height": HEIGHT, "depth_scale": 0.1}
    first = read_json(folder / "train_pbr/000000/scene_camera.json")[0]
    assert first["cam_K"] == [38.0, 0, 18.8, 0, 37.0, 15.1, 0, 0, 1]
    assert len(read_json(folder / "train_pbr/000001/scene_camera.json")) == FRAMES - SHARD


def test_read_frames_returns_the_poses(dataset):
    from warpvis.io import read_frames

    folder, _, frames = dataset
    got = read_frames(folder / "train_pbr/000000/scene_camera.json").camera_to_world
    for a, b in zip(got, frames.camera_to_world[:SHARD], strict=True):
        assert np.abs(matrix_of(a) - matrix_of(b)).max() < 1e-9


def test_bytes_do_not_depend_on_threads(dataset, tmp_path):
    folder, scene, frames = dataset
    write(tmp_path, scene, plan_of(scene, frames, options={"depth_scale": 0.1, "split": "train_pbr"}), threads=1)
    names = sorted(path.relative_to(folder) for path in folder.rglob("*") if path.is_file())
    assert len(names) == FRAMES * (1 + 2 * len(OBJECTS)) + 2 * 3 + len(OBJECTS) + 2
    for name in names:
        assert (folder / name).read_bytes() == (tmp_path / name).read_bytes(), name


def test_render_batch_writes_the_same_files(dataset, tmp_path):
    """`render_batch` selects objects by label and casts beyond the camera's range for masks."""
    folder, scene, frames = dataset
    options = {"depth_scale": 0.1, "split": "train_pbr"}
    render_batch(scene, CAMERA, frames, tmp_path / "out", format="bop", shard_frames=SHARD, options=options)
    for name in (path.relative_to(folder) for path in folder.rglob("*") if path.is_file()):
        assert (folder / name).read_bytes() == (tmp_path / "out" / name).read_bytes(), name


def test_missing_depth_may_count_as_hidden(dataset, tmp_path):
    """As the toolkit's bop18: pixels without depth are not visible."""
    folder, scene, frames = dataset
    plan = plan_of(scene, frames[:10], options={"missing": "hidden", "depth_scale": 0.1})
    write(tmp_path, scene, plan)
    differ = 0
    for name in ("train/000000/scene_gt_info.json",):
        hidden, visible = read_json(tmp_path / name), read_json(folder / name.replace("train", "train_pbr"))
        for image in range(10):
            depth = read_png(tmp_path / f"train/000000/depth/{image:06d}.png", np.uint16)
            for place, entry in enumerate(hidden[image]):
                other = read_png(folder / f"train_pbr/000000/mask_visib/{image:06d}_{place:06d}.png") > 0
                mine = read_png(tmp_path / f"train/000000/mask_visib/{image:06d}_{place:06d}.png") > 0
                assert (mine == (other & (depth > 0))).all()
                assert entry["px_count_visib"] == mine.sum() <= visible[image][place]["px_count_visib"]
                differ += mine.sum() < other.sum()
    assert differ > 0


def test_delta_option(tmp_path):
    """A sheet 20 mm in front of a cube occludes it with delta 15 mm, but not with 25 mm."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 0.1)), name="cube", label="object", pose=(0, 0, 2.05, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((3, 3, 0.002)), name="sheet", pose=(0, 0, 1.979, 0, 0, 0, 1))
    frames = Frames.from_poses([[0, 0, 0, 0, 0, 0, 1]])
    for delta, fraction in ((0.015, 0.0), (0.025, 1.0)):
        write(tmp_path / f"{delta}", scene, plan_of(scene, frames, chosen=["cube"], options={"delta": delta}))
        info = read_json(tmp_path / f"{delta}/train/000000/scene_gt_info.json")[0][0]
        assert info["visib_fract"] == fraction and info["px_count_valid"] > 0
        assert (info["bbox_obj"] == [-1] * 4) == (fraction == 0)


def test_object_just_behind_a_sheet_at_the_end_of_the_range(tmp_path):
    """The depth image contains the sheet; the isolated object is rendered at any depth, so BOP counts it as visible."""
    scene = wv.Scene()
    scene.add(trimesh.creation.box((1, 1, 0.1)), name="cube", label="object", pose=(0, 0, 4.555, 0, 0, 0, 1))
    scene.add(trimesh.creation.box((3, 3, 0.002)), name="sheet", pose=(0, 0, 4.497, 0, 0, 0, 1))
    render_batch(scene, CAMERA, Frames.from_poses([[0, 0, 0, 0, 0, 0, 1]]), tmp_path / "out", format="bop")
    info = read_json(tmp_path / "out/train/000000/scene_gt_info.json")[0][0]
    assert info["visib_fract"] == 1.0 and info["px_count_valid"] == info["px_count_all"] > 0


def test_depth_beyond_16_bits_is_reported(tmp_path):
    scene = wv.Scene()
    scene.add(trimesh.creation.box((90, 90, 1)), name="cube", label="object", pose=(0, 0, 10, 0, 0, 0, 1))
    plan = plan_of(scene, Frames.from_poses([[0, 0, 0, 0, 0, 0, 1]]), chosen=["cube"], options={"depth_scale": 0.1})
    plan = dataclasses.replace(plan, camera=dataclasses.replace(CAMERA, far=20.0))
    files = write(tmp_path, scene, plan)
    ((message, count),) = files.warnings.items()
    assert count == WIDTH * HEIGHT and "does not fit into 16 bits of 0.1 mm" in message
    info = read_json(tmp_path / "train/000000/scene_gt_info.json")[0][0]
    assert info["px_count_valid"] == 0 and info["visib_fract"] == pytest.approx(1 / 9)


def test_world_index_selects_object_poses(tmp_path):
    """`Frames.world_index` selects the cart's pose in each frame."""
    scene, frames = table(), walk()
    few = dataclasses.replace(
        frames, object_poses=frames.object_poses[:3], world_index=np.arange(FRAMES, dtype=np.int32) % 3
    )
    whole = dataclasses.replace(frames, object_poses=frames.object_poses[np.arange(FRAMES) % 3])
    one = dataclasses.replace(frames, object_poses=frames.object_poses[:1])
    poses = [
        find_format("bop")(plan_of(scene, f))._poses(f, np.tile(np.eye(4), (FRAMES, 1, 1))) for f in (few, whole, one)
    ]
    assert poses[0] == poses[1] != poses[2]
    assert poses[2][0] == poses[2][49] == poses[0][0]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outputs": ("depth",)}, "outputs must include depth and visibility for format 'bop', got only depth"),
        (
            {"chosen": ()},
            "Assign that label with labels= or choose objects with objects= to",
        ),
        ({"exclude": (2,)}, "objects must not be excluded for format 'bop', got 'ball' in exclude"),
        ({"options": {"scale": 1}}, "format 'bop' has no option 'scale'; its options: delta=0.015 meters, "),
        ({"options": {"delta": -1}}, "option delta must be a positive number, got -1"),
        ({"options": {"depth_scale": "0"}}, "option depth_scale must be a positive number, got '0'"),
        ({"options": {"depth_scale": "mm"}}, "option depth_scale must be a positive number, got 'mm'"),
        (
            {"options": {"split": "models"}},
            "option split must be train, val or test, or one of these with _NAME, got 'mo",
        ),
        ({"options": {"split": "train_/x"}}, "option split must be train, val or test, .*got 'train_/x'"),
        ({"options": {"missing": "maybe"}}, "option missing must be visible or hidden, got 'maybe'"),
    ],
)
def test_invalid_plans_raise(changes, message):
    with pytest.raises(wv.WarpvisError, match=message):
        find_format("bop")(plan_of(table(), walk(), **changes))
