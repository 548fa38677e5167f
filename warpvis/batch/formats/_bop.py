# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The scenewise layout of the BOP benchmark: color, depth, masks, and poses and visible fractions of objects."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar, TypeAlias

import numpy as np
from numpy.typing import NDArray

from warpvis.batch._job import shard_name
from warpvis.batch.formats._base import Images, require_pinhole
from warpvis.batch.formats._layouts import COLOR_OPTIONS, Layout
from warpvis.core.labels import Label
from warpvis.core.poses import poses_to_matrices
from warpvis.core.types import Json
from warpvis.errors import FileFormatError
from warpvis.io import ColorFile, count_lost, depth_to_units, encode_png
from warpvis.visibility import BOP_DELTA

if TYPE_CHECKING:
    from warpvis.batch._job import Plan
    from warpvis.batch.storage._output import ShardFiles
    from warpvis.cameras.frames import Frames
    from warpvis.scene import Scene

_MILLIMETERS_PER_METER = 1000.0

_Entry: TypeAlias = dict[str, Json]
"""An entry of a camera or an object in BOP's JSON files."""
_BLOCK = 512  # points per block: distances of all pairs of two blocks take 2 MB and fit into the cache of a core


_NO_BOX = (-1, -1, -1, -1)


class Bop(Layout):
    """Writes scenes, ``train/000012/``: images, masks, ``scene_camera``, ``scene_gt`` and ``scene_gt_info.json``.

    A shard is a BOP scene, and its frames are the images 0, 1, 2, ... of the scene. Models are numbered from 1 in the
    order of the chosen objects; movable objects with the same mesh share a model. All objects are annotated in every
    image, in their order, even if they are not visible. Color images are ``rgb/000000.png``, or ``.jpg`` as in BOP's
    sets of rendered training images.

    The layout is defined in ``docs/bop_datasets_format.md`` of BOP's toolkit. Masks, counts and boxes are computed as
    in its ``scripts/calc_gt_info.py`` and ``calc_gt_masks.py`` (Hodan et al., "BOP: Benchmark for 6D Object Pose
    Estimation", ECCV 2018), but from depth before rounding. Note that pixel centers are at integers; that the width of
    a box is its last column minus its first; that an object without visible pixels has no box; and that a pixel without
    depth (outside of the camera's range, or too far for 16 bits) counts as visible unless the option ``missing`` is
    ``hidden``, called bop18 in the toolkit.
    """

    name: ClassVar[str] = "bop"
    library: str | None = "zlib"
    outputs: ClassVar[frozenset[str]] = frozenset({"color", "depth", "visibility"})
    default_outputs: ClassVar[tuple[str, ...]] = ("color", "depth", "visibility")
    options: ClassVar[Mapping[str, str]] = {
        "delta": "0.015 meters",
        "depth_scale": "1.0, millimeters per unit of the depth images",
        "split": "train",
        "missing": "visible or hidden",
        **COLOR_OPTIONS,
        "color": "png or jpeg",
    }
    color_files: ClassVar[tuple[ColorFile, ...]] = ("png", "jpeg")
    masks = True
    any_depth = True
    """Whether visibility includes objects at any depth; here, pixels with missing depth are handled separately."""
    object_label = Label.OBJECT
    """Label of the objects that are annotated by default."""

    def __init__(self, plan: Plan) -> None:
        super().__init__(plan)
        self._camera = require_pinhole(plan, self.name, "which has no distortion")
        if not {"depth", "visibility"} <= set(plan.outputs):
            raise FileFormatError(
                f"outputs must include depth and visibility for format 'bop', got only {', '.join(plan.outputs)}"
            )
        if not plan.chosen:
            raise FileFormatError(
                "objects must not be empty for format 'bop', and the scene has none with the label OBJECT. Assign that "
                "label with labels= or choose objects with objects= to annotate them."
            )
        hidden = [plan.object_names[index] for index in plan.chosen if index in plan.exclude]
        if hidden:
            raise FileFormatError(f"objects must not be excluded for format 'bop', got {hidden[0]!r} in exclude")
        self.delta = self.positive_option("delta", BOP_DELTA)
        self._depth_scale = self.positive_option("depth_scale", 1.0)
        self._split = str(plan.options.get("split", "train"))
        if not re.fullmatch(r"(train|val|test)(_\w+)?", self._split, re.ASCII):
            raise FileFormatError(
                f"option split must be train, val or test, or one of these with _NAME, got {self._split!r}"
            )
        missing = plan.options.get("missing", "visible")
        if missing not in ("visible", "hidden"):
            raise FileFormatError(f"option missing must be visible or hidden, got {missing!r}")
        self._missing_is_visible = missing == "visible"
        models = plan.object_models or range(len(plan.object_names))
        numbers = {model: number for number, model in enumerate(dict.fromkeys(models[k] for k in plan.chosen), start=1)}
        self._model_of = [numbers[models[index]] for index in plan.chosen]
        """Number of the model of each chosen object."""
        self._blank = encode_png(np.zeros((plan.camera.height, plan.camera.width), dtype=np.uint8))

    def write_shard(self, shard: int, images: Images, files: ShardFiles) -> list[str]:
        scene = f"{self._split}/{shard_name(shard)}"
        frames = self.plan.frames[self.plan.shard_slice(shard)]
        count, camera = len(images["depth"]), self.plan.camera
        written: dict[int, tuple[int, list[_Entry]]] = {}

        def write_images(numbers: range) -> None:
            for image in numbers:
                written[image] = self._write_image(scene, image, images, files)

        self.encode_each(count, camera.width * camera.height, write_images)
        infos = [written[image][1] for image in range(count)]
        world_to_camera = _inverse(poses_to_matrices(frames.camera_to_world))
        files.write_text(f"{scene}/scene_camera.json", _json_lines(enumerate(self._cameras(world_to_camera))))
        files.write_text(f"{scene}/scene_gt.json", _json_lines(enumerate(self._poses(frames, world_to_camera))))
        files.write_text(f"{scene}/scene_gt_info.json", _json_lines(enumerate(infos)))
        files.warn(
            f"pixels have a depth that does not fit into 16 bits of {self._depth_scale:g} mm, and are 0, no depth",
            sum(lost for lost, _ in written.values()),
        )
        return [scene]

    def index(self, files: ShardFiles) -> list[str]:
        """Write ``camera.json``."""
        camera, matrix = self.plan.camera, self._matrix
        values = dict(zip(("fx", "fy", "cx", "cy"), matrix[[0, 1, 0, 1], [0, 1, 2, 2]].tolist(), strict=True))
        values |= {"width": camera.width, "height": camera.height, "depth_scale": self._depth_scale}
        files.write_text("camera.json", json.dumps(values, indent=2) + "\n")
        return ["camera.json"]

    def write_models(self, files: ShardFiles, scene: Scene) -> list[str]:
        """Write the meshes of objects as ``models/obj_000001.ply`` in millimeters, and ``models_info.json``."""
        infos = {}
        names: dict[int, list[str]] = {}
        for number, index in zip(self._model_of, self.plan.chosen, strict=True):
            item = scene.objects[index]
            names.setdefault(number, []).append(item.name)
            if len(names[number]) > 1:
                continue
            points = (item.frame_vertices.astype(np.float64) - self._origin(index)) * _MILLIMETERS_PER_METER
            files.write_text(f"models/obj_{number:06d}.ply", ply_text(points, item.faces))
            infos[number] = {**model_info(points), "name": item.name, "names": names[number]}
        files.write_text("models/models_info.json", _json_lines(infos.items()))
        return ["models"]

    @property
    def _matrix(self) -> NDArray[np.float64]:
        return self._camera.to_K(pixel_center=0.0)

    def _origin(self, index: int) -> NDArray[np.float64]:
        """Return the origin of a model in its mesh [m], shape ``(3,)``: 0 if movable, else the center of the box."""
        if self.plan.object_columns[index] >= 0:
            return np.zeros(3)
        return np.array(self.plan.object_centers[index], dtype=np.float64)

    def _write_image(self, scene: str, image: int, images: Images, files: ShardFiles) -> tuple[int, list[_Entry]]:
        """Write the files of a frame; return the number of pixels that do not fit, and its objects' entries."""
        depth = images["depth"][image]
        units = depth_to_units(depth, _MILLIMETERS_PER_METER / self._depth_scale)
        files.write(f"{scene}/depth/{image:06d}.png", encode_png(units))
        if "color" in self.plan.outputs:
            (color,) = self.encode_colors(images["color"][image : image + 1])
            files.write(f"{scene}/rgb/{image:06d}{self.color_suffix}", color)
        missing, infos = units == 0, []
        for index, mask in enumerate(images["masks"][image]):
            total = int(images["silhouette_pixels"][image, index])
            if not images["image_pixels"][image, index]:
                infos.append(_object_info(total, 0, None, ()))
                pair = self._blank, self._blank
            else:
                silhouette = mask > 0
                visible = (mask > 1) | (silhouette & missing) if self._missing_is_visible else (mask > 1) & ~missing
                valid = int(np.count_nonzero(silhouette & ~missing))
                box = images["silhouette_box"][image, index].tolist()
                infos.append(_object_info(total, valid, visible, box))
                pair = self._mask_png(silhouette), self._mask_png(visible)
            for kind, mask_png in zip(("mask", "mask_visib"), pair, strict=True):
                files.write(f"{scene}/{kind}/{image:06d}_{index:06d}.png", mask_png)
        return count_lost(depth, units), infos

    def _mask_png(self, mask: NDArray[np.bool_]) -> bytes:
        return encode_png(mask.view(np.uint8) * np.uint8(255)) if mask.any() else self._blank

    def _cameras(self, world_to_camera: NDArray[np.float64]) -> list[_Entry]:
        matrix = self._matrix.ravel().tolist()
        return [
            {
                "cam_K": matrix,
                "depth_scale": self._depth_scale,
                "cam_R_w2c": pose[:3, :3].ravel().tolist(),
                "cam_t_w2c": (pose[:3, 3] * _MILLIMETERS_PER_METER).tolist(),
            }
            for pose in world_to_camera
        ]

    def _poses(self, frames: Frames, world_to_camera: NDArray[np.float64]) -> list[list[_Entry]]:
        """Return poses from model to camera for all frames and objects."""
        scene_gt: list[list[_Entry]] = [[] for _ in world_to_camera]
        for number, index in zip(self._model_of, self.plan.chosen, strict=True):
            column = self.plan.object_columns[index]
            model_to_world = np.eye(4)
            model_to_world[:3, 3] = self._origin(index)
            if column >= 0:
                model_to_world = poses_to_matrices(_poses_of_object(frames, column))
            for entries, pose in zip(scene_gt, world_to_camera @ model_to_world, strict=True):
                rotation, translation = pose[:3, :3].ravel().tolist(), (pose[:3, 3] * _MILLIMETERS_PER_METER).tolist()
                entries.append({"cam_R_m2c": rotation, "cam_t_m2c": translation, "obj_id": number})
        return scene_gt


def _poses_of_object(frames: Frames, column: int) -> NDArray[np.float32]:
    """Return the poses of a movable object in all frames, or in their common world, shape ``(n or 1, 7)``."""
    assert frames.object_poses is not None  # set in a plan if an object is movable
    rows = frames.object_poses[:, column]
    return rows if frames.world_index is None else rows[frames.world_index]


def _inverse(matrices: NDArray[np.float64]) -> NDArray[np.float64]:
    """Invert rigid transforms, shape ``(n, 4, 4)``."""
    inverse = np.zeros_like(matrices)
    inverse[:, :3, :3] = matrices[:, :3, :3].swapaxes(1, 2)
    inverse[:, :3, 3] = -np.einsum("nij,nj->ni", inverse[:, :3, :3], matrices[:, :3, 3])
    inverse[:, 3, 3] = 1
    return inverse


def _object_info(total: int, valid: int, visible: NDArray[np.bool_] | None, box: Sequence[int]) -> _Entry:
    """Return the entry of an object in an image for ``scene_gt_info.json``.

    `total` counts the pixels of its silhouette on the canvas, in the box x, y, width and height, and `valid` those of
    its mask with depth; `visible` is None if it is outside of the image.
    """
    count = 0 if visible is None else int(np.count_nonzero(visible))
    info: _Entry = {
        "bbox_obj": [*_NO_BOX],
        "bbox_visib": [*_NO_BOX],
        "px_count_all": total,
        "px_count_valid": valid,
        "px_count_visib": count,
        "visib_fract": 0.0,
    }
    if visible is not None and count:
        x, y, width, height = box
        info["bbox_obj"], info["bbox_visib"] = [x, y, width - 1, height - 1], _box(visible)
        info["visib_fract"] = count / total
    return info


def _box(mask: NDArray[np.bool_]) -> list[int]:
    """Return x, y, last column - first column, last row - first row of a mask that is not empty."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    x, y = int(columns[0]), int(rows[0])
    return [x, y, int(columns[-1]) - x, int(rows[-1]) - y]


def _json_lines(items: Iterable[tuple[int, object]]) -> str:
    """Format numbered values as a JSON object with one line per value, as in BOP's files."""
    return "{\n" + ",\n".join(f'  "{key}": {json.dumps(value)}' for key, value in items) + "\n}\n"


def ply_text(points: NDArray[np.float64], faces: NDArray[np.int32]) -> str:
    """Format a mesh [mm] as PLY text: single-precision vertices with normals, and triangles."""
    rows = np.concatenate([points, vertex_normals(points, faces)], axis=1).astype(np.float32)
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    vertices = ("%.9g %.9g %.9g %.9g %.9g %.9g\n" * len(rows)) % tuple(rows.ravel().tolist())
    triangles = ("3 %d %d %d\n" * len(faces)) % tuple(faces.ravel().tolist())
    return "\n".join(header) + "\n" + vertices + triangles


def vertex_normals(points: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Return vertex normals, weighted by the angles of the adjacent triangles, shape ``(n, 3)``.

    They are 0 at vertices without triangles. Source: Thuermer and Wuethrich, "Computing vertex normals from polygonal
    facets", 1998.
    """
    corners = points[faces]
    total = np.zeros_like(points)
    normals = _normalize(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    for k in range(3):
        after, before = (_normalize(corners[:, (k + step) % 3] - corners[:, k]) for step in (1, 2))
        angles = np.arccos(np.clip(np.einsum("ij,ij->i", after, before), -1, 1))
        np.add.at(total, faces[:, k], normals * angles[:, None])
    return _normalize(total)


def model_info(points: NDArray[np.float64]) -> dict[str, float]:
    """Return the entry of a model in ``models_info.json``: diameter, and minimum corner and size of the box [mm]."""
    low, high = points.min(axis=0).tolist(), points.max(axis=0).tolist()
    info = {"diameter": diameter(points)}
    info |= {f"min_{axis}": value for axis, value in zip("xyz", low, strict=True)}
    return info | {f"size_{axis}": b - a for axis, a, b in zip("xyz", low, high, strict=True)}


def diameter(points: NDArray[np.float64]) -> float:
    """Return the maximum distance between two of the points, shape ``(n, 3)``.

    Points that are too close to the center of the box to be part of the farthest pair are skipped.
    """
    points = np.unique(points, axis=0)
    center = (points.min(axis=0) + points.max(axis=0)) / 2
    radii = np.linalg.norm(points - center, axis=1)
    order = np.argsort(-radii, kind="stable")
    points, radii = points[order] - center, radii[order]
    max_squared = 0.0
    for first in range(0, len(points), _BLOCK):
        if (2 * radii[first]) ** 2 <= max_squared:
            break  # all remaining pairs are closer than the current maximum
        block = points[first : first + _BLOCK]
        # Triangle inequality: the other point of a farther pair has at least this radius.
        min_radius = math.sqrt(max_squared) - radii[first]
        last = first + int(np.searchsorted(-radii[first:], -min_radius, side="right"))
        for start in range(first, last, _BLOCK):
            steps = block[:, None] - points[None, start : min(start + _BLOCK, last)]
            max_squared = max(max_squared, float(np.einsum("ijk,ijk->ij", steps, steps).max()))
    return math.sqrt(max_squared)


def _normalize(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Normalize vectors; zero vectors are not changed."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(lengths > 0, lengths, 1)
