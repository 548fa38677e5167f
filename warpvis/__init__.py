# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Render depth images and compute which points and objects are visible from camera poses, by ray casting.

>>> import trimesh, warpvis as wv
>>> scene = wv.Scene()
>>> scene.add(trimesh.creation.icosphere(radius=0.1), name="ball", label="object", pose=(2, 0, 0, 0, 0, 0, 1))
0
>>> views = wv.render(scene, wv.Camera.kinect(), wv.look_at((0, 0, 0), (2, 0, 0)))
>>> views.depth.shape
(1, 240, 320)
"""

from pathlib import Path

import lazy_loader

__version__ = "0.1.0"

# Public names are imported lazily at first use, which keeps `import warpvis` and the command line fast. The names are
# listed in `__init__.pyi` in this folder.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]

# In a checkout, `kernels/` and `scenes/` are siblings of this folder; in an installation, they are inside it. This lets
# a checkout that shadows an installation (`python -m pytest` in its root) find its copies.
_root = Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file() and (_root / "kernels").is_dir():
    __path__.append(str(_root))
