# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The engine of many machines: Ray Data hands shards to actors, which render and write them.

What flows through Ray is numbers of shards one way and their records the other; images never leave their actor.
"""

from __future__ import annotations

import io
import logging
import os
import re
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from functools import partial
from types import ModuleType
from typing import TYPE_CHECKING, Any, NamedTuple, TextIO, TypedDict

import numpy as np
import warp as wp

from warpvis.batch._records import Record, read_whole, shard_record
from warpvis.batch._writer import Done, Job, Run, ShardWriter
from warpvis.batch.storage._stores import Store, open_store
from warpvis.batch.writing._encoder import WorkerLostError
from warpvis.errors import ArrayError, FileFormatError, WarpvisError

if TYPE_CHECKING:
    import ray
    from ray.actor import ActorHandle

# An actor is handed so many shards at once: enough that one is written while another is rendered, few enough that
# little is rendered again when it is lost.
_SHARDS_AT_ONCE = 8
_LEAST_ROUNDS = 4

# How often a worker is started anew: one that ends whatever it does must not be started for ever, as Ray Data does.
# Ray 2.64 has no argument for it any more, so that starts are counted here.
_MOST_RESTARTS = 10


_PRINTING_THREADS = ("ray_listen_error_messages", "ray_print_logs")
_COLOUR = re.compile(r"\x1b\[[0-9;]*m")


class _Row(TypedDict):
    """What an actor says of a shard."""

    shard: int
    error: Exception | None


class _Share(NamedTuple):
    """How many workers there are, and each one's part of the cluster."""

    workers: int
    cpus: int
    gpus: int


class _WithoutRay:
    """A stream without what Ray's own threads print, which is of nodes and workers that end: the engine says it."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return len(text) if threading.current_thread().name in _PRINTING_THREADS else self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Starts:
    """Counts how often workers are started, as an actor of Ray."""

    def __init__(self, most: int) -> None:
        """Allow so many."""
        self._left = most

    def more(self) -> bool:
        """Count one, and tell whether it is allowed."""
        self._left -= 1
        return self._left >= 0


class ShardActor:
    """A worker: it builds the scene once, and then renders and writes the shards that it is handed."""

    def __init__(self, job: Job | ray.ObjectRef[Job], device: str, threads: int, starts: ActorHandle) -> None:
        """Prepare to render.

        Args:
            job: A `Job`, or a reference to one in Ray's object store.
            device: ``"cpu"``, or ``"cuda"`` for the GPU that Ray gave this worker.
            threads: CPU threads.
            starts: A `Starts` of all workers.
        """
        import ray

        self._writer: ShardWriter | None = None
        if not ray.get(starts.more.remote()):
            return
        wp.config.log_level = wp.LOG_WARNING
        self._job: Job = ray.get(job) if isinstance(job, ray.ObjectRef) else job
        self._store: Store = open_store(self._job.out)
        self._writer = ShardWriter(self._job, device=device, threads=threads)

    def __call__(self, batch: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Make whole the shards of a batch, ``{"shard": numbers}``, and return it with each one's error or None.

        What another worker finished before it was lost is not done again.
        """
        shards = [int(shard) for shard in batch["shard"]]
        error: Exception | None = None
        if self._writer is None:
            error = WorkerLostError("Ray's workers ended, and were started anew too often")
            return {"shard": np.array(shards), "error": np.array([error] * len(shards), dtype=object)}
        try:
            self._writer.run([shard for shard in shards if self._record(shard) is None], lambda shard, record: None)
        except (OSError, WarpvisError) as caught:  # for the caller; Ray would take it for a reason to try again
            error = caught
        return {"shard": np.array(shards), "error": np.array([error] * len(shards), dtype=object)}

    def _record(self, shard: int) -> Record | None:
        part = self._job.plan.shard_slice(shard)
        return read_whole(self._store, shard_record(shard), part.stop - part.start)


@contextmanager
def ray_engine(*, gpu: bool, workers: int | None, address: str | None) -> Iterator[Run]:
    """Start the engine on a Ray cluster, as a context. Ray starts lost workers again, and repeats what they had.

    Args:
        gpu: Whether each worker has a GPU.
        workers: How many; by default one for each GPU or core of the cluster.
        address: Of the cluster; see `ray.init`.

    Raises:
        WarpvisError: Ray is missing, there is no such cluster, or it has no room for the workers.
    """
    printed = redirect_stdout(_WithoutRay(sys.stdout)), redirect_stderr(_WithoutRay(sys.stderr))
    with printed[0], printed[1], _cluster(address) as ray:
        yield partial(_run, ray, _share(ray.cluster_resources(), gpu=gpu, workers=workers))


def _run(ray: ModuleType, share: _Share, job: Job, shards: Sequence[int], done: Done) -> None:
    """Render and write shards.

    Raises:
        OSError: A file cannot be written.
        WorkerLostError: Workers were lost, and could not be started again.
    """
    if not shards:
        return
    store = open_store(job.out)
    try:
        for row in _results(ray, job, shards, share):
            if row["error"] is not None:
                raise row["error"]
            shard = int(row["shard"])
            part = job.plan.shard_slice(shard)
            record = read_whole(store, shard_record(shard), part.stop - part.start)
            if record is None:
                raise WorkerLostError(f"shard {shard} was written by a worker and cannot be seen from here")
            done(shard, record)
    except ray.exceptions.RayError as error:
        reason = _COLOUR.sub("", str(error)).strip().splitlines()[0]
        raise WorkerLostError(f"Ray gave up ({type(error).__name__}: {reason})") from None


def _results(ray: ModuleType, job: Job, shards: Sequence[int], share: _Share) -> Iterator[_Row]:
    """Hand shards to actors, and go through what they return, as it comes."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    workers, cpus, gpus = share
    at_once = max(1, min(_SHARDS_AT_ONCE, len(shards) // (workers * _LEAST_ROUNDS)))
    rows = ray.data.from_items([{"shard": shard} for shard in shards], override_num_blocks=-(-len(shards) // at_once))
    # Beside this process, without which nothing goes on: of another node, it could be lost.
    here = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=True)
    counter = ray.remote(Starts).options(num_cpus=0, max_restarts=-1, max_task_retries=-1, scheduling_strategy=here)
    given = {
        "job": ray.put(job),
        "device": "cuda" if gpus else "cpu",
        "threads": max(1, int(cpus)),
        "starts": counter.remote(workers * (1 + _MOST_RESTARTS)),
    }
    made = rows.map_batches(
        ShardActor,
        batch_size=None,
        compute=ray.data.ActorPoolStrategy(size=workers),
        num_cpus=cpus,
        num_gpus=gpus,
        fn_constructor_kwargs=given,
    )
    return made.iter_rows()


def _share(resources: Mapping[str, float], *, gpu: bool, workers: int | None) -> _Share:
    """Share a cluster out among workers.

    Raises:
        ArrayError: There is not so much.
    """
    cpus, gpus = int(resources.get("CPU", 0)), int(resources.get("GPU", 0))
    most = min(cpus, gpus) if gpu else cpus
    count = most if workers is None else workers
    if not 1 <= count <= most:
        raise ArrayError(f"workers must be from 1 to {most}, the cluster's {'GPUs' if gpu else 'cores'}, got {workers}")
    return _Share(int(count), cpus // int(count), 1 if gpu else 0)


@contextmanager
def _cluster(address: str | None) -> Iterator[ModuleType]:
    """Connect Ray to a cluster, as a context; one that was started for this is ended."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")  # Ray Data's own actors make it print an error that is none
    try:
        import ray
        import ray.data
    except ImportError:
        raise FileFormatError("engine 'ray' needs Ray: pip install 'warpvis[cluster]'") from None
    quiet = ray.data.DataContext.get_current()
    quiet.enable_progress_bars = False
    # It prints what goes wrong in many lines, which are raised anyway.
    logging.getLogger("ray.data").setLevel(logging.CRITICAL)
    ours = not ray.is_initialized()
    if ours:
        try:
            ray.init(address=address, include_dashboard=False, log_to_driver=False, logging_level=logging.ERROR)
        except (ConnectionError, ValueError) as error:
            raise FileFormatError(f"no Ray cluster at {address!r}: {error}") from None
    try:
        yield ray
    finally:
        if ours:
            # Ray prints what its threads have kept back now, on this one.
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                ray.shutdown()
