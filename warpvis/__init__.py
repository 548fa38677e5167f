# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""What a camera at a pose sees, and which points and objects of the world are visible from it.

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

# Each public name is imported from where it lives when it is first used: `import warpvis` stays quick, and so does the
# command line. `__init__.pyi` beside this file is the table of them.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
__all__ += ["__version__"]

# In a checkout, `kernels/` and `scenes/` stand beside this folder; installed, they are inside it. This lets a checkout
# that shadows an installation (`python -m pytest` in its root) find its own.
_root = Path(__file__).resolve().parent.parent
if (_root / "pyproject.toml").is_file() and (_root / "kernels").is_dir():
    __path__.append(str(_root))
