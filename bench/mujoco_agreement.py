# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare `warpvis.mujoco.Renderer` on real robots with `mujoco.Renderer` and exact rays, and measure both.

    MUJOCO_GL=egl python bench/mujoco_agreement.py [--configurations 50] [--mesh-tolerance 5e-4] [--rounds 30]

Robots come from the packages mujoco_warp, gymnasium_robotics and dm_control, as far as they are installed. All cameras
and the free camera see them with random joints. Exits with 1 if depth of any image, a model's segmentation or its rays
exceed a bound. Pixels less than 1 mm behind MuJoCo's near plane do not count, because rounding decides what it clips.

- Depth: pixels where both renderers show a geom, away from silhouettes. Segmentation: all pixels.
- Rays: `mj_multiRay` through 200 random pixels of an image, in double precision on the true shapes. They also hit
  surfaces from behind and at any distance, so these images use ``cull_backfaces=False`` and ``near_plane="occlude"``;
  planes are excepted, because rays do not hit them from below.
- Speed: `update_scene` and `render` of depth, medians of the model's cameras, summed; MuJoCo in the model's quality.

In compared images MuJoCo tessellates round shapes with 128 slices and 64 stacks: its default of 28 slices removes 0.6 %
of a radius, more than the mesh tolerance from 8 cm up.
"""

from __future__ import annotations

import argparse
import functools
import importlib.util
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from numpy.typing import NDArray
from timing import take_turns

from warpvis.mujoco import Renderer, camera_from_mujoco
from warpvis.mujoco._cameras import viewer_camera
from warpvis.mujoco._scene import DEFAULT_GROUPS, DEFAULT_MESH_TOLERANCE

_MODELS = (
    ("mujoco_warp", "test_data/aloha_pot/scene.xml"),
    ("gymnasium_robotics", "envs/assets/fetch/reach.xml"),
    ("gymnasium_robotics", "envs/assets/fetch/pick_and_place.xml"),
    ("dm_control", "locomotion/walkers/assets/humanoid_CMU_V2020.xml"),
)
_SIZE = _HEIGHT, _WIDTH = 240, 320
_RAYS, _MIN_SAME = 200, 0.995
Found = defaultdict[str, list[Any]]  # findings by name, one item for each image of a model


def report(found: Found, mesh_tolerance: float) -> tuple[bool, list[str]]:
    """Return whether all bounds hold, and the cells of the table's row."""
    errors, rays, ray_same = (np.concatenate(found[name]) for name in ("errors", "ray_errors", "ray_same"))
    quantiles = [np.quantile(values, (0.5, 0.99)) for values in (*found["errors"], rays) if values.size]
    *within, rays_keep = [bool((pair < np.array([1e-4, 2e-3]) + mesh_tolerance).all()) for pair in quantiles]
    same = min(np.mean(found["same"]), np.mean(ray_same)) >= _MIN_SAME
    return all(within) and rays_keep and bool(same), [
        f"{len(found['same'])}, {sum(found['empty'])} see no geom",
        "median {:.4f}, 99 % {:.4f} mm of {} px".format(*1e3 * np.quantile(errors, (0.5, 0.99)), errors.size),
        f"{sum(within)} of {len(within)} images",
        f"{100 * np.mean(found['same']):.4f} %, least image {100 * min(found['same']):.3f} %",
        f"{sum(found['cut'])} px",
        "median {:.4f}, 99 % {:.4f} mm of {} px".format(*1e3 * np.quantile(rays, (0.5, 0.99)), rays.size),
        f"{100 * np.mean(ray_same):.3f} % of {ray_same.size} px",
    ]


def find_model(package: str, path: str) -> Path | None:
    """Return a file of an installed package, or None."""
    spec = importlib.util.find_spec(package)
    folders = list(spec.submodule_search_locations or []) if spec else []
    return next((Path(folder) / path for folder in folders if (Path(folder) / path).is_file()), None)


def random_joints(model: mujoco.MjModel, count: int) -> NDArray[np.float64]:
    """Return positions, shape ``(count, nq)``: hinges and slides in the middle half of their range, or in -1 to 1."""
    joints = np.isin(model.jnt_type, (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE)))
    low, high = np.where(model.jnt_limited[joints, None], model.jnt_range[joints], (-2, 2)).T
    qpos, shares = np.tile(model.qpos0, (count, 1)), np.random.default_rng(0).uniform(0.25, 0.75, (count, len(low)))
    qpos[:, model.jnt_qposadr[joints]] = low + shares * (high - low)
    return qpos


def take_depth(renderer: Any, data: mujoco.MjData, camera: int, option: Any = None) -> NDArray[np.float32]:
    """Return depth, by the calls that both renderers have."""
    renderer.update_scene(data, camera, option)
    renderer.enable_depth_rendering()
    return renderer.render()


def take_images(renderer: Any, data: mujoco.MjData, camera: int) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return depth, and the geom of every pixel or -1; without sites."""
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    depth = take_depth(renderer, data, camera, option).astype(np.float64)
    renderer.enable_segmentation_rendering()
    geoms, kinds = np.moveaxis(renderer.render(), -1, 0)
    return depth, np.where(kinds == int(mujoco.mjtObj.mjOBJ_GEOM), geoms, -1)


def away_from_silhouettes(depth: NDArray[np.float64], reach: int = 2, step: float = 0.03) -> NDArray[np.bool_]:
    """Return the pixels without a step of depth nearby."""
    low = high = np.pad(depth, reach, mode="edge")
    for axis, size in enumerate(depth.shape):
        near = [(slice(None),) * axis + (slice(k, k + size),) for k in range(2 * reach + 1)]
        low, high = np.minimum.reduce([low[k] for k in near]), np.maximum.reduce([high[k] for k in near])
    return high - low < step * depth + step


def compare_images(ours: Renderer, theirs: mujoco.Renderer, data: mujoco.MjData, camera: int, found: Found) -> None:
    """Count one camera's images."""
    (depth, geoms), (expected, expected_geoms) = take_images(ours, data, camera), take_images(theirs, data, camera)
    shown = depth >= camera_from_mujoco(ours.model, camera, _WIDTH, _HEIGHT).near + 1e-3
    inside = away_from_silhouettes(depth) & away_from_silhouettes(expected)
    found["errors"].append(np.abs(depth - expected)[inside & shown & (geoms >= 0) & (expected_geoms >= 0)])
    found["same"].append(float((geoms == expected_geoms)[shown].mean()) if shown.any() else 1.0)
    found["cut"].append(int((~shown).sum()))
    found["empty"].append(not (expected_geoms >= 0).any())


def compare_rays(ours: Renderer, data: mujoco.MjData, camera: int, rng: np.random.Generator, found: Found) -> None:
    """Compare rays through random pixels of one image."""
    pixels = np.unravel_index(rng.choice(_HEIGHT * _WIDTH, _RAYS, replace=False), _SIZE)
    expected, expected_geoms, behind = cast_rays(ours.model, data, camera, pixels)
    image, image_geoms = take_images(ours, data, camera)
    depth, geoms, inside = image[pixels], image_geoms[pixels], away_from_silhouettes(image)[pixels]
    found["ray_errors"].append(np.abs(depth - expected)[inside & (geoms >= 0) & ~behind[geoms] & (expected_geoms >= 0)])
    found["ray_same"].append((geoms == expected_geoms)[~behind[geoms]])


def cast_rays(model: mujoco.MjModel, data: mujoco.MjData, camera: int, pixels: Any) -> tuple[NDArray[Any], ...]:
    """Return MuJoCo's depth along the optical axis at pixel centers, geoms or -1, and which geoms show their back."""
    right, up, forward, eye = np.zeros((4, 3))
    mujoco.mjv_cameraFrame(eye, forward, up, right, data, viewer_camera(model, camera))
    lens = camera_from_mujoco(model, camera, _WIDTH, _HEIGHT)
    x, y = (pixels[1] + 0.5 - lens.cx) / lens.fx, (pixels[0] + 0.5 - lens.cy) / lens.fy
    rays = np.outer(x, right) - np.outer(y, up) + forward  # length 1 along the axis: distances are depths
    geoms, depth = np.empty(_RAYS, dtype=np.int32), np.empty(_RAYS)
    groups = np.isin(range(mujoco.mjNGROUP), DEFAULT_GROUPS).astype(np.uint8)
    mujoco.mj_multiRay(model, data, eye, rays.ravel(), groups, True, -1, geoms, depth, None, _RAYS, mujoco.mjMAXVAL)
    below = ((eye - data.geom_xpos) * data.geom_xmat[:, 2::3]).sum(axis=1) < 0
    behind = below & (model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE))
    return depth, np.where(depth < lens.far, geoms, -1), np.append(behind, False)


def agreement(path: Path, configurations: int, mesh_tolerance: float) -> Found:
    """Compare the images of all cameras of a model in random configurations."""
    spec, found, rng = mujoco.MjSpec.from_file(str(path)), Found(list), np.random.default_rng(1)
    spec.visual.quality.numslices, spec.visual.quality.numstacks, spec.visual.quality.offsamples = 128, 64, 0
    model = spec.compile()
    # Rays have no near plane.
    unclipped = {"cull_backfaces": False, "near_plane": "occlude"}
    data, uncut = mujoco.MjData(model), Renderer(model, *_SIZE, mesh_tolerance=mesh_tolerance, **unclipped)
    with Renderer(model, *_SIZE, mesh_tolerance=mesh_tolerance) as ours, mujoco.Renderer(model, *_SIZE) as theirs:
        for data.qpos[:] in random_joints(model, configurations):
            mujoco.mj_forward(model, data)
            for camera in range(-1, model.ncam):
                compare_images(ours, theirs, data, camera, found)
                compare_rays(uncut, data, camera, rng, found)
    return found


def speed(path: Path, rounds: int, mesh_tolerance: float) -> list[str]:
    """Return cells of the table's row: times of both, summed over the model's cameras, and their ratio."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, total = mujoco.MjData(model), np.zeros(2)
    data.qpos[:] = random_joints(model, 1)[0]
    mujoco.mj_forward(model, data)
    with Renderer(model, *_SIZE, mesh_tolerance=mesh_tolerance) as ours, mujoco.Renderer(model, *_SIZE) as theirs:
        for camera in range(model.ncam):
            calls = [functools.partial(take_depth, renderer, data, camera) for renderer in (ours, theirs)]
            take_turns(calls, 1)  # warm them
            total += [1e3 * np.median(times) for times in take_turns(calls, rounds)]
    return [f"{model.ncam} cameras: {total[0]:.2f} ms", f"{total[1]:.2f} ms", f"{total[1] / total[0]:.1f}x"]


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configurations", type=int, default=50)
    parser.add_argument(
        "--mesh-tolerance", type=float, default=DEFAULT_MESH_TOLERANCE, help="of round shapes, in meters"
    )
    parser.add_argument("--rounds", type=int, default=30, help="of timing")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    missed = []
    print("| model | images | depth | in bounds | same geom | too near | rays | same geom | warpvis | MuJoCo | ratio |")
    print("|" + " --- |" * 11, flush=True)
    for package, name in _MODELS:
        if (path := find_model(package, name)) is None:
            print(f"| {name}: the package {package}, which has it, is not installed |")
            continue
        holds, cells = report(agreement(path, options.configurations, options.mesh_tolerance), options.mesh_tolerance)
        missed += [] if holds else [name]
        print("|", " | ".join([name, *cells, *speed(path, options.rounds, options.mesh_tolerance)]), "|", flush=True)
    print(f"\nBounds are missed by: {', '.join(missed) or 'none'}.")
    return int(bool(missed))


if __name__ == "__main__":
    sys.exit(main())
