# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Indexed access to the frames of a dataset: `open_dataset`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warpvis.batch._dataset import INDEX_RECORD, POSES, RECORDS_FOLDER, read_frame_arrays
from warpvis.batch._job import shard_name
from warpvis.batch._manifest import MANIFEST
from warpvis.batch.reading._job import FrameSpec, Job, read_job
from warpvis.batch.reading._pictures import BagReader, BopReader, ColmapReader, NerfstudioReader, PngReader, TumReader
from warpvis.batch.reading._shards import Files, NpzReader, ShardReader, ZarrReader
from warpvis.batch.storage._stores import Store, open_store
from warpvis.cameras import ImageCamera, opencv_intrinsics
from warpvis.cameras.frames import Frames
from warpvis.core.checks import as_items, check_mapping, describe_exception, is_whole, pluralize
from warpvis.core.labels import LabelNames
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import ArrayError, FileFormatError, WarpvisError
from warpvis.rendering import DepthSensor
from warpvis.sensors import sensor_from_fields

_READERS: Mapping[str, type[ShardReader]] = {
    "npz": NpzReader,
    "zarr": ZarrReader,
    "png": PngReader,
    "nerfstudio": NerfstudioReader,
    "tum": TumReader,
    "bop": BopReader,
    "ros2": BagReader,
}

Frame: TypeAlias = dict[str, Any]
"""A frame, or several: arrays and numbers by name."""


class NoSuchFrameError(ArrayError, IndexError):
    """The number of a frame is out of range; as an `IndexError`, it ends loops over all frames."""


class FrameArray:
    """One array of all frames; indexing reads only the selected frames, `numpy.asarray` reads all of them."""

    def __init__(self, dataset: FrameDataset, name: str, spec: FrameSpec) -> None:
        """Create the array `name` of a dataset; nothing is read yet."""
        self._dataset, self._name = dataset, name
        self.dtype = spec.dtype
        self.shape = (len(dataset), *spec.shape)

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def ndim(self) -> int:
        """Number of axes."""
        return len(self.shape)

    def __getitem__(self, key: int | slice | ArrayLike | tuple[Any, ...]) -> NDArray:
        """Read the array of a frame, or the stacked arrays of several; further indices select a part, as in NumPy.

        Raises:
            ArrayError: If there is no such frame or part.
        """
        if not isinstance(key, tuple):
            return self._dataset.read(self._name, key)
        frames, *parts = key or (slice(None),)
        wrong = [part for part in parts if not (is_whole(part) or isinstance(part, slice))]
        if wrong:
            raise ArrayError(f"indices after the frames must be whole numbers or slices, got {wrong[0]!r}")
        array = self._dataset.read(self._name, frames)
        leading = () if is_whole(frames) else (slice(None),)
        try:
            return array[(*leading, *parts)]
        except (IndexError, TypeError) as error:
            raise ArrayError(f"there is no such part of {self._name}, {self.shape}: {error}") from None

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray:
        array = self[:]
        return array if dtype is None else array.astype(dtype, copy=False)

    def __repr__(self) -> str:
        return f"<FrameArray {self._name!r}: {self.dtype} of {self.shape}>"


class FrameDataset:
    """Frames of a dataset written by `render_batch`; `open_dataset` opens it.

    ``dataset[3]`` is a frame, a dict with the array of each output, ``camera_to_world`` (row ``x y z qx qy qz qw``,
    ``(7,)`` float64), ``K`` (``(3, 3)`` float64, pixel centers at +0.5) and ``distortion`` (OpenCV's coefficients, five
    zeros for a pinhole camera), ``timestamp`` [s], ``frame`` (its number in the job), and, if the scene has movable
    objects, ``object_poses`` (``(M, 7)``) and ``world`` (its index in `frames.object_poses`). For lenses of other
    models than OpenCV's pinhole, ``K`` and ``distortion`` are missing; see `camera`. All arrays are copies.
    ``dataset[3:9]`` and ``dataset[[5, 1]]`` stack several frames, and ``dataset["depth"]`` is one array of all frames.

    A dataset can be passed to `torch.utils.data.DataLoader`, with forked or spawned workers.
    """

    def __init__(self, store: Store, outputs: Iterable[str] | None) -> None:
        """Read the manifest and the poses of a dataset."""
        self._store = store
        self._outputs = None if outputs is None else tuple(outputs)
        job = self._job = read_job(store)
        frames = _read_poses(store, job)
        self._reader = _make_reader(store, job, frames)
        self._specs = _choose(self._reader.specs, self._outputs, job)
        self.camera: ImageCamera = job.camera
        """The camera of all frames; a `warpvis.cameras.LensCamera` if it has a lens."""
        self.format = job.contents.format
        """Name of the dataset's format."""
        self.outputs = tuple(self._specs)
        """Names of the arrays that are read from the files of a frame."""
        self.object_names = job.object_names
        """Names of the objects of the scene; values of ``segmentation`` are indices into them."""
        self.object_labels = job.object_labels
        """Labels of the objects of the scene."""
        self.label_names: LabelNames = job.label_names
        """Names of the classes, by number; ``label_names.number("road")`` is the value of its pixels in ``labels``."""
        self.visibility_objects = job.visibility_objects
        """Names of the objects of ``visible_fraction`` and the other arrays of visibility, in their order."""
        self.complete = store.size(INDEX_RECORD) is not None
        """Whether all frames exist; an interrupted job has written only some of them."""
        numbers = np.arange(job.contents.frames)
        if not self.complete:
            records = set(store.names(RECORDS_FOLDER))
            shards = range(job.contents.shard_count)
            recorded = np.array([f"{shard_name(shard)}.json" in records for shard in shards])
            numbers = numbers[recorded[numbers // job.contents.shard_frames]]
        self.frame_numbers: NDArray[np.int64] = numbers
        """The number of each frame in its job, shape ``(V,)``: 0, 1, 2, ... if the dataset is complete."""
        self.frames = frames if self.complete else frames.take(self.frame_numbers)
        """Poses, times and worlds of the frames."""

    @property
    def sensor(self) -> DepthSensor | None:
        """The depth-camera model that computed ``depth``; None for exact depth and for models not part of warpvis.

        Raises:
            FileFormatError: If the sensor in the manifest is invalid.
        """
        if self._job.sensor is None:
            return None
        try:
            return sensor_from_fields(check_mapping(self._job.sensor, "sensor"))
        except WarpvisError as error:
            raise FileFormatError(
                f"{self._job.name}: {MANIFEST} has an invalid sensor: {describe_exception(error)}"
            ) from None

    def __len__(self) -> int:
        return len(self.frame_numbers)

    def __iter__(self) -> Iterator[Frame]:
        return (self[index] for index in range(len(self)))

    def __getitem__(self, key: Any) -> Any:
        """Read a frame by its index, several by a slice or indices; or return an array of all frames by its name.

        Raises:
            ArrayError: If there is no such frame or array.
            FileFormatError: If a file is missing or damaged.
        """
        if isinstance(key, str):
            return self._by_name(key)
        if is_whole(key):
            row = self._row(key)
            images = {name: self.read(name, row) for name in self._specs}
            return images | self._metadata(row)
        rows = self._rows(key)
        return {name: self.read(name, rows) for name in self._specs} | self._metadata_rows(rows)

    def read(self, name: str, frames: Any) -> NDArray:
        """Read one array of a frame, or the stacked arrays of several frames.

        Args:
            name: One of `outputs`.
            frames: Index of a frame, from 0; a slice; or several indices.

        Raises:
            ArrayError: If there is no such frame or array.
            FileFormatError: If a file is missing or damaged.
        """
        if not isinstance(name, str) or name not in self._specs:
            raise ArrayError(
                f"there is no array {name!r}; there are {', '.join([*self._specs, *self._metadata_rows(())])}"
            )
        spec = self._specs[name]
        if is_whole(frames):
            out = self._memory(spec.shape, spec.dtype)
            self._read_into(name, self._row(frames), out)
            return out
        rows = self._rows(frames)
        out = self._memory((len(rows), *spec.shape), spec.dtype)
        for row, image in zip(rows, out, strict=True):
            self._read_into(name, row, image)
        return out

    def _rows(self, key: object) -> Sequence[int]:
        """Return the indices selected by a slice or a list."""
        if isinstance(key, slice):
            try:
                return range(len(self))[key]
            except TypeError:
                raise ArrayError(f"slices of frames must be of whole numbers, got {key!r}") from None
        return [self._row(index) for index in as_items(key, "frames", ArrayError)]

    def _memory(self, shape: tuple[int, ...], dtype: np.dtype) -> NDArray:
        try:
            return np.empty(shape, dtype)
        except (MemoryError, ValueError):
            raise ArrayError(
                f"{self._job.name}: arrays of shape {shape} do not fit into memory. Read fewer frames."
            ) from None

    def _read_into(self, name: str, row: int, out: NDArray) -> None:
        shard, offset = divmod(int(self.frame_numbers[row]), self._job.contents.shard_frames)
        self._reader.read_into(name, shard, offset, out)

    def _row(self, index: object) -> int:
        if not is_whole(index):
            raise ArrayError(f"index of a frame must be a whole number, got {index!r}")
        row, count = int(index), len(self)
        if not -count <= row < count:
            raise NoSuchFrameError(f"index of a frame must be less than {count}, the number of frames, got {row}")
        return row % count

    def _by_name(self, name: str) -> FrameArray | NDArray:
        if name in self._specs:
            return FrameArray(self, name, self._specs[name])
        metadata = self._metadata_rows(range(len(self)))
        if name not in metadata:
            raise ArrayError(f"there is no array {name!r}; there are {', '.join([*self._specs, *metadata])}")
        return metadata[name]

    def _metadata(self, row: int) -> Frame:
        """Return the poses, intrinsics and times of a frame."""
        frames = self.frames
        frame: Frame = {
            "camera_to_world": frames.camera_to_world[row].copy(),
            **opencv_intrinsics(self.camera),
            "timestamp": float(frames.timestamps[row]),
            "frame": int(self.frame_numbers[row]),
        }
        if frames.object_poses is not None:
            world = frames.world_of(row)
            frame |= {"object_poses": frames.object_poses[world].copy(), "world": world}
        return frame

    def _metadata_rows(self, rows: Sequence[int]) -> Frame:
        chosen, frames, same = np.asarray(rows, dtype=np.int64), self.frames, opencv_intrinsics(self.camera)
        several: Frame = {
            "camera_to_world": frames.camera_to_world[chosen],
            **{name: np.repeat(array[None], len(chosen), axis=0) for name, array in same.items()},
            "timestamp": frames.timestamps[chosen],
            "frame": self.frame_numbers[chosen],
        }
        if frames.object_poses is not None:
            worlds = np.array([frames.world_of(row) for row in rows], dtype=np.int64)
            several |= {"object_poses": frames.object_poses[worlds], "world": worlds}
        return several

    def __getstate__(self) -> dict[str, Any]:
        """Return the arguments for opening the dataset in another process, without open files."""
        return {"store": self._store, "outputs": self._outputs}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(**state)  # type: ignore[misc]

    def __repr__(self) -> str:
        state = "" if self.complete else f" of {self._job.contents.frames}, unfinished"
        frames = pluralize(len(self), "frame")
        return f"<FrameDataset {self._store.name}: {frames}{state}, {self.format}: {', '.join(self.outputs)}>"


def open_dataset(path: str | os.PathLike[str], *, outputs: Iterable[str] | None = None) -> FrameDataset:
    """Open a dataset written by `render_batch` or ``warpvis batch`` for random access to its frames.

    If the job was interrupted or is still running, the dataset contains the frames of complete shards. Local files are
    memory-mapped. Only the poses are read at once; images are read on access.

    Args:
        path: The folder of the dataset, or an fsspec URL, whose files are read whole.
        outputs: The arrays to read, such as ``("depth",)``. By default all in the files: images, and
            ``visible_fraction`` and the other arrays of the output ``visibility``.

    Raises:
        FileFormatError: If the path is not a dataset, if its format has no images (``ply``), or if it cannot be read.
    """
    if outputs is not None:
        outputs = tuple(as_items(outputs, "outputs", ArrayError))
    store = open_store(path)
    try:
        return FrameDataset(store, outputs)
    except OSError as error:
        raise FileFormatError(f"{store.name}: cannot be read: {error.strerror or error}") from None


def _make_reader(store: Store, job: Job, frames: Frames) -> ShardReader:
    files = Files(store)
    if job.contents.format == "colmap":
        return ColmapReader(files, job, poses_to_matrices(frames.camera_to_world)[:, :3, :3])
    if job.contents.format not in _READERS:
        reason = ": its files are point clouds without pixels" if job.contents.format == "ply" else ""
        raise FileFormatError(f"{job.name}: format {job.contents.format!r} cannot be read{reason}")
    return _READERS[job.contents.format](files, job)


def _choose(specs: Mapping[str, FrameSpec], outputs: Sequence[str] | None, job: Job) -> dict[str, FrameSpec]:
    if outputs is None:
        return dict(specs)
    missing = [name for name in outputs if not isinstance(name, str) or name not in specs]
    if missing or not outputs:
        wrong = repr(missing[0]) if missing else "none"
        raise ArrayError(f"{job.name}: outputs must be from {', '.join(specs)}, got {wrong}")
    return {name: specs[name] for name in outputs}


def _read_poses(store: Store, job: Job) -> Frames:
    try:
        arrays = read_frame_arrays(store)
        times, world_index = arrays.pop("timestamps"), arrays.pop("world_index", None)
        poses, objects = arrays["camera_to_world"], arrays.get("object_poses")
        worlds = {"object_poses": objects, "world_index": world_index}
        frames = Frames.from_poses(poses, timestamps=times, camera=job.camera, **worlds)
    except Exception as error:  # NumPy and zipfile may raise any exception for a damaged file
        raise FileFormatError(f"{store.name}: {POSES} is missing or damaged: {describe_exception(error)}") from None
    if len(frames) != job.contents.frames:
        raise FileFormatError(
            f"{store.name}: {POSES} must have poses of {pluralize(job.contents.frames, 'frame')}, got {len(frames)}"
        )
    return frames
