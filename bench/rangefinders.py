# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Measure rangefinder sensors of a MuJoCo model against MuJoCo's own sensors.

    python bench/rangefinders.py quadruped.xml [--worlds 4096] [--hills] [--device cuda:0]
    python bench/rangefinders.py [quadruped.xml] --worlds 1 [--threads 1]

The model is any MJCF file with rangefinders, such as the quadruped of dm_control's suite. MuJoCo computes all position
sensors (`mj_sensorPos`) of data with computed poses, on as many threads; warpvis reads the same poses. Readings are
compared first. Calls alternate; the medians are printed, and the time of a call that starts from joint positions.

With `--worlds 1`, CPU times of a call are compared for the model and for a lidar of 1, 20 and 360 rays among 10 to 200
geoms: `mj_sensorPos`, `mj_multiRay` with the rays of the first sensor's body, and `read` of a `mujoco.MjData` and of
poses. They are the minima of alternating rounds. The ratio is that of the faster of MuJoCo's to `read` of data.
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np
import warp as wp

from warpvis.core.threads import core_count, run_each
from warpvis.mujoco import Rangefinders, WorldPoses

ROUNDS = 7
# Rounds of one world, and their minimum duration [s].
SHORT_ROUNDS, SHORT_ROUND = 25, 0.004
RAYS, GEOMS = (1, 20, 360), (10, 50, 200)
# Corners of a ball of about 10,000 triangles, in rows.
BALL_ROWS = 72


def place_worlds(model: mujoco.MjModel, count: int) -> list[mujoco.MjData]:
    """Place the model's first free body at random in each world, slightly above the floor, and move its joints."""
    rng, worlds = np.random.default_rng(0), []
    for _ in range(count):
        data = mujoco.MjData(model)
        if model.nq >= 7:
            data.qpos[:2] += rng.uniform(-10, 10, 2)
            data.qpos[2] += rng.uniform(0, 1.5)
            data.qpos[7:] += rng.normal(scale=0.3, size=model.nq - 7)
        mujoco.mj_fwdPosition(model, data)
        worlds.append(data)
    return worlds


def make_model(rays: int, geoms: int, surroundings: str) -> mujoco.MjModel:
    """Make a lidar of horizontal rays on a box, among geoms at random places.

    Geoms are spheres, capsules, boxes, ellipsoids and cylinders ("shapes"); with "meshes", every fifth is a mesh of
    10,000 triangles; with "hills", the floor is a height field.
    """
    rng, parts = np.random.default_rng(1), []
    kinds = ["sphere", "capsule", "box", "ellipsoid", "cylinder"]
    for index in range(geoms - 2):
        angle, distance = rng.uniform(0, 2 * np.pi), rng.uniform(1, 8)
        place = f'pos="{distance * np.cos(angle)} {distance * np.sin(angle)} {rng.uniform(0.2, 1)}"'
        sizes = " ".join(map(str, rng.uniform(0.1, 0.4, 3)))
        kind = f'type="{kinds[index % 5]}" size="{sizes}"'
        if surroundings == "meshes" and index % 5 == 0:
            kind = 'type="mesh" mesh="ball"'
        parts.append(f'<geom {kind} {place} euler="{rng.uniform(-90, 90)} {rng.uniform(-90, 90)} 0"/>')
    turns = np.linspace(0, 2 * np.pi, rays, endpoint=False)
    sites = [f'<site name="s{i}" zaxis="{np.cos(turn)} {np.sin(turn)} -.02"/>' for i, turn in enumerate(turns)]
    sensors = [f'<rangefinder site="s{i}"/>' for i in range(rays)]
    floor = '<geom type="hfield" hfield="hills"/>' if surroundings == "hills" else '<geom type="plane" size="0 0 1"/>'
    ball = ""
    if surroundings == "meshes":
        up, around = np.meshgrid(np.linspace(0, np.pi, BALL_ROWS), np.linspace(0, 2 * np.pi, BALL_ROWS, endpoint=False))
        corners = 0.3 * np.stack([np.sin(up) * np.cos(around), np.sin(up) * np.sin(around), np.cos(up)], axis=-1)
        corners *= 1 + 0.2 * np.sin(3 * around[..., None]) * np.sin(4 * up[..., None])
        first = np.arange(BALL_ROWS * BALL_ROWS).reshape(BALL_ROWS, BALL_ROWS)
        a, b = first[:, :-1], first[:, 1:]
        c, d = np.roll(a, -1, axis=0), np.roll(b, -1, axis=0)
        faces = np.concatenate([np.stack([a, b, d], axis=-1), np.stack([a, d, c], axis=-1)]).reshape(-1, 3)
        numbers = (" ".join(map(str, values.ravel().round(6).tolist())) for values in (corners, faces))
        ball = '<mesh name="ball" inertia="shell" vertex="{}" face="{}"/>'.format(*numbers)
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><asset><hfield name="hills" nrow="100" ncol="100" size="10 10 .3 .1"/>{ball}</asset>'
        f"<worldbody>{floor}"
        f'{"".join(parts)}<body pos="0 0 .5"><freejoint/><geom type="box" size=".2 .2 .1"/>{"".join(sites)}</body>'
        f"</worldbody><sensor>{''.join(sensors)}</sensor></mujoco>"
    )
    model.hfield_data[:] = rng.random(len(model.hfield_data))
    return model


def cpu_seconds(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Return minimum CPU times of alternating rounds of calls, over all threads of this process."""
    best, counts = [np.inf] * len(calls), [1] * len(calls)
    for _ in range(SHORT_ROUNDS):
        for index, call in enumerate(calls):
            start = time.process_time()
            for _ in range(counts[index]):
                call()
            seconds = time.process_time() - start
            best[index] = min(best[index], seconds / counts[index])
            counts[index] = max(1, int(SHORT_ROUND / best[index]))
    return best


def compare_one_world(name: str, model: mujoco.MjModel, threads: int | None) -> None:
    """Print CPU times of reading one world."""
    (data,) = place_worlds(model, 1)
    finders = Rangefinders(model, threads=threads)
    poses, out = WorldPoses.of([data]), wp.empty(len(finders.addresses), dtype=wp.float32, device="cpu")
    mujoco.mj_sensorPos(model, data)
    expected = data.sensordata[finders.addresses]
    error = np.abs(finders.read(data, out=out).numpy() - expected) / np.maximum(1, np.abs(expected))
    rows = finders.read(poses)
    sites = model.sensor_objid[np.unique(finders.sensors)]
    directions = data.site_xmat.reshape(-1, 3, 3)[sites, :, 2].ravel()
    origin, body = data.site_xpos[sites[0]].copy(), int(model.site_bodyid[sites[0]])
    ids, distances = np.zeros(len(sites), dtype=np.int32), np.zeros(len(sites))
    calls = (
        lambda: mujoco.mj_sensorPos(model, data),
        lambda: mujoco.mj_multiRay(
            model, data, origin, directions, None, True, body, ids, distances, None, len(sites), mujoco.mjMAXVAL
        ),
        lambda: finders.read(data, out=out),
        lambda: finders.read(data),
        lambda: finders.read(poses, out=rows),
    )
    times = [seconds * 1e6 for seconds in cpu_seconds(calls)]
    numbers = " ".join(f"{microseconds:8.1f}" for microseconds in times)
    print(f"{name:24s} {numbers} {min(times[:2]) / times[2]:8.2f} {error.max():8.0e}", flush=True)


def compare_worlds(model: mujoco.MjModel, options: argparse.Namespace) -> None:
    """Compare readings of many worlds, measure, print."""
    worlds, threads = place_worlds(model, options.worlds), core_count()
    finders = Rangefinders(model, device=options.device)
    qpos, poses = np.stack([data.qpos for data in worlds]), WorldPoses.of(worlds)
    parts = np.array_split(np.arange(len(worlds)), threads)
    out = finders.read(poses)

    def theirs(part: np.ndarray) -> None:
        for world in part.tolist():
            mujoco.mj_sensorPos(model, worlds[world])

    run_each(theirs, parts, threads)
    expected = np.stack([data.sensordata[finders.addresses] for data in worlds])
    error = np.abs(out.numpy() - expected) / np.maximum(1, np.abs(expected))
    print(f"{expected.size} readings, {np.sum(error > 1e-5)} of them differ by more than 1e-5")
    print(f"largest difference of the others: {error[error <= 1e-5].max():.1e}")
    calls = (lambda: finders.read(poses, out=out), lambda: run_each(theirs, parts, threads), lambda: finders.read(qpos))
    names = ("warpvis, from poses", f"MuJoCo, {threads} threads", "warpvis, from joint positions")
    for name, seconds in zip(names, median_seconds(calls), strict=True):
        print(f"{name}: {seconds * 1e3:.1f} ms, {expected.size / seconds / 1e6:.2f} M rays/s")


def median_seconds(calls: Sequence[Callable[[], object]]) -> list[float]:
    """Return median times of alternating calls."""
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(ROUNDS):
        for call, seconds in zip(calls, times, strict=True):
            start = time.perf_counter()
            call()
            wp.synchronize()
            seconds.append(time.perf_counter() - start)
    return [statistics.median(seconds) for seconds in times]


def main() -> None:
    """Compare, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("model", nargs="?")
    parser.add_argument("--worlds", type=int, default=4096)
    parser.add_argument("--hills", action="store_true", help="random heights in the model's height fields")
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--threads", type=int, help="threads of warpvis for one world")
    options = parser.parse_args()
    models = {} if options.model is None else {options.model: mujoco.MjModel.from_xml_path(options.model)}
    if options.hills:
        for model in models.values():
            model.hfield_data[:] = np.random.default_rng(0).random(len(model.hfield_data)) * 0.1
    if options.worlds == 1:
        titles = ("sensors", "multiRay", "data,out", "data", "poses", "ratio", "error")
        print(f"{'CPU us per call':24s} " + " ".join(f"{title:>8s}" for title in titles))
        for name, model in models.items():
            compare_one_world(Path(name).name, model, options.threads)
        for surroundings in ("shapes", "meshes", "hills"):
            for rays in RAYS:
                for geoms in GEOMS:
                    name = f"{rays} rays, {geoms} {surroundings}"
                    compare_one_world(name, make_model(rays, geoms, surroundings), options.threads)
    else:
        compare_worlds(models[options.model], options)


if __name__ == "__main__":
    main()
