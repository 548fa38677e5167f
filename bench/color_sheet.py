# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Make a sheet of MuJoCo models and glTF files, each next to a picture of `mujoco.Renderer` or pyrender.

    MUJOCO_GL=egl python bench/color_sheet.py SHEET.webp MODEL[:CAMERA]... FILE.glb...

A model is a name of `bench/mujoco_colors.py`, in its initial pose, with shadows, reflections and sky; a camera is one
of the model's or "free". A glTF file is lit by a directional and an ambient light. On the left of each pair is warpvis.
pyrender needs ``pip install --no-deps pyrender PyOpenGL pyglet freetype-py networkx six``.
"""

from __future__ import annotations

import os
import sys
import warnings
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import warp as wp
from mujoco_colors import installed_models
from numpy.typing import NDArray
from PIL import Image, ImageDraw

import warpvis as wv
import warpvis.mujoco
from warpvis.scene.lights import Background, Light

_HEIGHT, _WIDTH = 240, 320
_COLUMNS, _SHRINK, _TITLE = 5, 2, 14
_FIELD = np.radians(40.0)  # vertical, of the camera of glTF files
_TOWARD = np.array([0.6, 0.45, 1.0])  # direction of the camera of glTF files from their center
_SUN, _SUN_INTENSITY, _AMBIENT = np.array([-0.4, -1.0, -0.5]), 4.0, 0.3

Pair = tuple[NDArray[np.uint8], NDArray[np.uint8]]


def mujoco_pair(name: str, camera: str) -> Pair:
    """Render a model with warpvis and MuJoCo."""
    model, data = dict(installed_models())[name]()
    model.vis.global_.offwidth, model.vis.global_.offheight = _WIDTH, _HEIGHT
    if data is None:
        data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    pictures = []
    for renderer in (wv.mujoco.Renderer(model, _HEIGHT, _WIDTH), mujoco.Renderer(model, _HEIGHT, _WIDTH)):
        for _ in range(2):  # an endless plane is moved to the position of the camera before
            renderer.update_scene(data, -1 if camera == "free" else camera)
        pictures.append(np.array(renderer.render()))
        renderer.close()
    return pictures[0], pictures[1]


def gltf_pair(path: Path) -> Pair:
    """Render a glTF file with warpvis and pyrender."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    vars(np)["infty"] = np.inf  # pyrender 0.1.45 is older than NumPy 2
    import pyrender
    import trimesh

    scene = trimesh.load(path, force="scene")
    center, radius = scene.bounds.mean(axis=0), np.linalg.norm(np.ptp(scene.bounds, axis=0)) / 2
    pose = _facing(_TOWARD)
    pose[:3, 3] = center + pose[:3, 2] * radius / np.sin(_FIELD / 2)
    theirs = pyrender.Scene.from_trimesh_scene(scene, bg_color=np.ones(4), ambient_light=np.full(3, _AMBIENT))
    theirs.add(pyrender.PerspectiveCamera(_FIELD, znear=radius / 20, zfar=20 * radius), pose=pose)
    theirs.add(pyrender.DirectionalLight(np.ones(3), _SUN_INTENSITY), pose=_facing(-_SUN))
    renderer = pyrender.OffscreenRenderer(_WIDTH, _HEIGHT)
    picture = renderer.render(theirs)[0]
    renderer.delete()
    ours = wv.Scene.load(path, up="y")
    options: dict[str, Any] = {"color_space": "linear", "falloff": "gltf", "cast_shadow": False}
    sun = Light("directional", direction=tuple(_SUN), intensity=_SUN_INTENSITY, **options)
    ours.lights = (sun, Light("ambient", ambient=(_AMBIENT,) * 3, **options))
    ours.background = Background(color=(1.0, 1.0, 1.0))
    camera = wv.Camera.from_fov(_WIDTH, _HEIGHT, vfov=_FIELD)
    image = wv.render(ours, camera, pose @ np.diag([1.0, -1.0, -1.0, 1.0]), outputs=("color",), samples=4)
    return image.color.numpy()[0], picture


def _facing(direction: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a pose whose z axis points in a direction, and whose y axis upwards."""
    z = direction / np.linalg.norm(direction)
    x = np.cross([0.0, 1.0, 0.0], z)
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    return pose


def main() -> int:
    """Render pairs and save the sheet."""
    wp.config.log_level = wp.LOG_WARNING
    warnings.simplefilter("ignore")
    target, *names = sys.argv[1:]
    height, width = _HEIGHT // _SHRINK, _WIDTH // _SHRINK
    rows = -(-len(names) // _COLUMNS)
    sheet = Image.new("RGB", (_COLUMNS * (2 * width + 4), rows * (height + _TITLE + 4)), "white")
    for number, name in enumerate(names):
        path, camera, title = Path(name), name.rpartition(":")[2], name
        if path.suffix in (".glb", ".gltf"):
            pair, title = gltf_pair(path), path.name
        else:
            model = name.rpartition(":")[0]
            pair = mujoco_pair(model, camera)
            title = f"{model.split('/')[0]}: {Path(model).stem}"
        error = np.abs(pair[0].astype(int) - pair[1]).mean()
        print(f"{name}: mean difference {error:.2f} of 255", flush=True)
        left, top = number % _COLUMNS * (2 * width + 4), number // _COLUMNS * (height + _TITLE + 4)
        row = Image.fromarray(np.hstack(pair)).resize((2 * width, height), Image.Resampling.BOX)
        sheet.paste(row, (left, top + _TITLE))
        ImageDraw.Draw(sheet).text((left + 2, top + 1), title[:52], fill="black")
    sheet.save(target, quality=82)
    return 0


if __name__ == "__main__":
    sys.exit(main())
