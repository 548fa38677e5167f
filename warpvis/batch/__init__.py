# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render poses to a dataset on disk, in shards, safe to interrupt: `warpvis.render_batch`.

A dataset is a folder, or an fsspec URL::

    manifest.json        what it is made from: scene, camera, poses, outputs, versions; written first
    poses.npz            the frames: camera_to_world, timestamps, object_poses, world
    begin.json           the record of what a format says before there are shards, if it does
    ...                  the files of the shards, as the format lays them out
    shards/000012.json   the record of a shard, with bytes and CRC-32 of its files; written after them
    index.json           the record of what covers the whole dataset; its presence means that it is complete

`_job` says what is to be made, `formats` lays out files. `_writer` renders shards in one process and has them written
by `writing`, on threads or in processes beside; `engines` do so in one or many. `_dataset`, `_records` and `storage`
keep the folder, and `reading` reads it back. `_manifest` and `_identity` tell whether a job may go on with it,
`_verify` whether it is sound.
"""

from __future__ import annotations

from warpvis.batch._frame_renderer import FrameRenderer, check_batch_outputs as check_batch_outputs
from warpvis.batch._render_batch import BatchSummary, make_plan as make_plan, render_batch as render_batch
from warpvis.batch._verify import verify
from warpvis.batch._warmup import warmup
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
