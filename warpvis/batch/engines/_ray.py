# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The engine for many machines: Ray Data passes shards to actors, which render and write them.

Only numbers of shards and errors pass through Ray; images never leave their actor.
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
from typing import TYPE_CHECKING, Any, TextIO

import numpy as np
import warp as wp

from warpvis.batch._dataset import read_whole, shard_record
from warpvis.batch._encoding import WorkerLostError
from warpvis.batch._shard_job import Done, Run, ShardJob, Worker
from warpvis.batch.storage._stores import Store, open_store
from warpvis.errors import ArrayError, FileFormatError, WarpvisError

if TYPE_CHECKING:
    import ray
    from ray.actor import ActorHandle

# Maximum number of shards passed to an actor at once: enough to write one while another is rendered, few enough that
# little is rendered again if the actor is lost.
_SHARDS_AT_ONCE = 8
_MIN_ROUNDS = 4

# Maximum number of restarts per worker: Ray Data would restart a worker that always crashes forever. Ray 2.64 no longer
# has an argument for this limit, so starts are counted here.
_MAX_RESTARTS = 10


_PRINTING_THREADS = ("ray_listen_error_messages", "ray_print_logs")
_COLOR = re.compile(r"\x1b\[[0-9;]*m")


class _WithoutRay:
    """A stream that drops the output of Ray's threads about lost nodes and workers, which the engine reports itself."""

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream

    def write(self, text: str) -> int:
        return len(text) if threading.current_thread().name in _PRINTING_THREADS else self._stream.write(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


class Starts:
    """A Ray actor that counts starts of workers."""

    def __init__(self, limit: int) -> None:
        """Allow `limit` starts."""
        self._remaining = limit

    def more(self) -> bool:
        """Count a start, and return whether it is allowed."""
        self._remaining -= 1
        return self._remaining >= 0


class ShardActor:
    """A worker, which builds the scene once, and then renders and writes the shards that it receives."""

    def __init__(self, job: ShardJob | ray.ObjectRef[ShardJob], device: str, threads: int, starts: ActorHandle) -> None:
        """Prepare to render on ``"cpu"``, or ``"cuda"`` for the GPU that Ray assigned to this worker."""
        import ray

        self._writer: Worker | None = None
        if not ray.get(starts.more.remote()):
            return
        wp.config.log_level = wp.LOG_WARNING
        self._job: ShardJob = ray.get(job) if isinstance(job, ray.ObjectRef) else job
        self._store: Store = open_store(self._job.out)
        self._writer = self._job.start_worker(device=device, threads=threads)

    def __call__(self, batch: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
        """Complete the shards of a batch, ``{"shard": numbers}``, and return it with an error or None for each.

        Shards that a lost worker had completed are not rendered again.
        """
        shards = [int(shard) for shard in batch["shard"]]
        error: Exception | None = None
        if self._writer is None:
            error = WorkerLostError("Ray's workers ended and were restarted too often")
            return {"shard": np.array(shards), "error": np.array([error] * len(shards), dtype=object)}
        try:
            lengths = [(shard, self._job.plan.shard_length(shard)) for shard in shards]
            missing = [
                shard for shard, length in lengths if read_whole(self._store, shard_record(shard), length) is None
            ]
            self._writer.run(missing, lambda shard, record: None)
        except (OSError, WarpvisError) as caught:  # returned to the caller, because Ray would retry after an exception
            error = caught
        return {"shard": np.array(shards), "error": np.array([error] * len(shards), dtype=object)}


@contextmanager
def ray_engine(*, gpu: bool, workers: int | None, address: str | None) -> Iterator[Run]:
    """Start the engine on a Ray cluster, as a context manager. Ray restarts lost workers and repeats their shards."""
    printed = redirect_stdout(_WithoutRay(sys.stdout)), redirect_stderr(_WithoutRay(sys.stderr))
    with printed[0], printed[1], _cluster(address) as ray:
        yield partial(_run, ray, _share(ray.cluster_resources(), gpu=gpu, workers=workers))


def _run(ray: ModuleType, share: tuple[int, int, int], job: ShardJob, shards: Sequence[int], done: Done) -> None:
    """Render and write shards."""
    if not shards:
        return
    store = open_store(job.out)
    try:
        for row in _results(ray, job, shards, share):
            if row["error"] is not None:
                raise row["error"]
            shard = int(row["shard"])
            record = read_whole(store, shard_record(shard), job.plan.shard_length(shard))
            if record is None:
                raise WorkerLostError(f"shard {shard} was written by a worker but is not visible to this process")
            done(shard, record)
    except ray.exceptions.RayError as error:
        reason = _COLOR.sub("", str(error)).strip().splitlines()[0]
        raise WorkerLostError(f"Ray gave up ({type(error).__name__}: {reason})") from None


def _results(
    ray: ModuleType, job: ShardJob, shards: Sequence[int], share: tuple[int, int, int]
) -> Iterator[dict[str, Any]]:
    """Pass shards to actors, and yield the number and the error of each as they arrive."""
    from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

    workers, cpus, gpus = share
    at_once = max(1, min(_SHARDS_AT_ONCE, len(shards) // (workers * _MIN_ROUNDS)))
    rows = ray.data.from_items([{"shard": shard} for shard in shards], override_num_blocks=-(-len(shards) // at_once))
    # The counter runs on the node of this process, on which the job depends anyway: another node could be lost.
    strategy = NodeAffinitySchedulingStrategy(ray.get_runtime_context().get_node_id(), soft=True)
    counter = ray.remote(Starts).options(num_cpus=0, max_restarts=-1, max_task_retries=-1, scheduling_strategy=strategy)
    arguments = {
        "job": ray.put(job),
        "device": "cuda" if gpus else "cpu",
        "threads": max(1, int(cpus)),
        "starts": counter.remote(workers * (1 + _MAX_RESTARTS)),
    }
    results = rows.map_batches(
        ShardActor,
        batch_size=None,
        compute=ray.data.ActorPoolStrategy(size=workers),
        num_cpus=cpus,
        num_gpus=gpus,
        fn_constructor_kwargs=arguments,
    )
    return results.iter_rows()


def _share(resources: Mapping[str, float], *, gpu: bool, workers: int | None) -> tuple[int, int, int]:
    """Divide a cluster among workers; return their number, and the CPUs and GPUs of each."""
    cpus, gpus = int(resources.get("CPU", 0)), int(resources.get("GPU", 0))
    limit = min(cpus, gpus) if gpu else cpus
    count = limit if workers is None else workers
    if not 1 <= count <= limit:
        raise ArrayError(
            f"workers must be from 1 to {limit}, the cluster's {'GPUs' if gpu else 'cores'}, got {workers}"
        )
    return int(count), cpus // int(count), 1 if gpu else 0


@contextmanager
def _cluster(address: str | None) -> Iterator[ModuleType]:
    """Connect Ray to a cluster, as a context manager; a cluster that was started here is shut down."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_BACKEND_LOG_LEVEL", "fatal")  # Ray Data's actors print a spurious error
    try:
        import ray
        import ray.data
    except ImportError:
        raise FileFormatError("engine 'ray' needs Ray: pip install 'warpvis[cluster]'") from None
    quiet = ray.data.DataContext.get_current()
    quiet.enable_progress_bars = False
    # Ray Data logs long error messages for exceptions that are raised anyway.
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
            # On shutdown, Ray prints the buffered output of its threads on this thread.
            with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
                ray.shutdown()
