# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render poses to a sharded dataset on disk with `warpvis.render_batch`; jobs can be interrupted and resumed.

A dataset is a folder, or an fsspec URL::

    manifest.json        the input of the job: scene, camera, poses, outputs, versions; written first
    poses.npz            the frames: camera_to_world, timestamps, object_poses, world_index
    begin.json           the record of files that a format writes before any shard, if there are any
    ...                  the files of the shards, in the layout of the format
    shards/000012.json   the record of a shard, with bytes and CRC-32 of its files; written after them
    index.json           the record of files that cover the whole dataset; its presence means that it is complete

`_job` defines the plan of a dataset, and `formats` lays out its files. `_writer` renders shards in one process and
passes them to `_encoding`, which encodes them on threads or in additional processes; `engines` run one or many such
processes. `_dataset` and `storage` manage the folder, and `reading` reads it back. `_manifest` determines whether a job
may resume a dataset, and `_verify` checks whether a dataset is intact.
"""

from __future__ import annotations

from warpvis.batch._frame_renderer import FrameRenderer, check_batch_outputs as check_batch_outputs, warmup
from warpvis.batch._render_batch import BatchSummary, make_plan as make_plan, render_batch as render_batch
from warpvis.batch._verify import verify
from warpvis.batch.engines._local import parse_devices as parse_devices
from warpvis.batch.formats._base import Format as Format, find_format as find_format
from warpvis.batch.formats._npz import npz_parts as npz_parts
from warpvis.batch.reading._frames import FrameDataset, open_dataset as open_dataset

__all__ = [
    "BatchSummary",
    "FrameDataset",
    "FrameRenderer",
    "verify",
    "warmup",
]
