# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Reading of a dataset's manifest."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from warpvis.batch._manifest import MANIFEST, Contents, read_label_names, read_manifest
from warpvis.batch.formats._base import VISIBILITY_ARRAYS
from warpvis.batch.storage._stores import Store
from warpvis.cameras import ImageCamera, camera_from_dict
from warpvis.core.checks import describe_exception, truncate
from warpvis.core.labels import Label, LabelNames
from warpvis.core.outputs import VISIBILITY, find_output
from warpvis.core.types import Json
from warpvis.errors import CameraError, FileFormatError, SceneError


class FrameSpec(NamedTuple):
    """Dtype and shape of an array of one frame."""

    dtype: np.dtype
    shape: tuple[int, ...]


@dataclass(frozen=True)
class Job:
    """The contents and the layout of a dataset, from its manifest."""

    name: str
    """Name of the dataset in messages."""
    contents: Contents
    options: Mapping[str, Json]
    outputs: tuple[str, ...]
    camera: ImageCamera
    object_names: tuple[str, ...]
    object_labels: tuple[int, ...]
    label_names: LabelNames
    visibility_objects: tuple[str, ...]
    """Names of the objects whose visibility was computed."""
    sensor: Json = None
    """The depth-camera model in the manifest; None for exact depth."""

    def shard_length(self, shard: int) -> int:
        """Return the number of frames of a shard."""
        return min(self.contents.shard_frames, self.contents.frames - shard * self.contents.shard_frames)

    def specs(self) -> dict[str, FrameSpec]:
        """Return dtypes and shapes of the arrays of a frame for all outputs of the job."""
        size = (self.camera.height, self.camera.width)
        specs = {}
        for name in self.outputs:
            spec = find_output(name)
            if spec is not None:
                vector = (len(spec.components),) if spec.components else ()
                specs[name] = FrameSpec(np.dtype(spec.dtype), (*size, *vector))
            elif name != VISIBILITY:
                raise FileFormatError(
                    f"{self.name}: output {name} is unknown. Import the module that registers it, before opening"
                )
        if VISIBILITY in self.outputs:
            count = len(self.visibility_objects)
            for name, (dtype, last) in VISIBILITY_ARRAYS.items():
                specs[name] = FrameSpec(np.dtype(dtype), (count, *last))
        return specs

    def option(self, name: str, default: float) -> float:
        """Return a numeric option of the format."""
        value = self.options.get(name, default)
        try:
            return float(value)  # type: ignore[arg-type]
        except (TypeError, ValueError, OverflowError):
            raise FileFormatError(
                f"{self.name}: {MANIFEST} has an invalid option: {name} must be a number, got {truncate(repr(value))}"
            ) from None


def read_job(store: Store) -> Job:
    """Read a dataset's manifest."""
    manifest, contents = read_manifest(store)
    match manifest:
        case {
            "options": dict(options),
            "outputs": list(outputs),
            "objects": list(chosen),
            "camera": dict(camera),
            "scene": {"objects": dict(objects)},
        } if all(isinstance(name, str) for name in (*outputs, *chosen)):
            return Job(
                name=store.name,
                contents=contents,
                options=options,
                outputs=tuple(outputs),
                camera=_read_camera(store.name, camera),
                object_names=tuple(objects),
                object_labels=_read_labels(store.name, objects),
                label_names=read_label_names(store.name, manifest),
                visibility_objects=tuple(chosen),
                sensor=manifest.get("sensor"),
            )
    raise FileFormatError(f"{store.name}: is not a dataset: its {MANIFEST} does not define the contents")


def _read_camera(name: str, fields: Mapping[str, Json]) -> ImageCamera:
    try:
        return camera_from_dict(fields)
    except CameraError as error:
        raise FileFormatError(f"{name}: {MANIFEST} has an invalid camera: {describe_exception(error)}") from None


def _read_labels(name: str, objects: Mapping[str, Json]) -> tuple[int, ...]:
    by_number = LabelNames()
    try:
        labels: list[Any] = [item["label"] for item in objects.values()]  # type: ignore[index, call-overload]
        return tuple(Label[label] if isinstance(label, str) else by_number.number(label) for label in labels)
    except (KeyError, TypeError, SceneError):
        raise FileFormatError(f"{name}: objects in {MANIFEST} must have a valid label") from None
