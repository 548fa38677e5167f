# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Interactive viewer: a browser page where users move agents and objects, and see what each agent sees.

>>> viewer = warpvis.view(scene, agents=[robot, human])

The page needs the extra ``warpvis[view]``. `ViewerState` computes its contents and needs no browser.
"""

import lazy_loader

# `__init__.pyi` in this directory lists the public names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
