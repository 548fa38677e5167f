# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Look at a scene live: a page in the browser where agents and objects are moved, and what each agent sees changes.

>>> viewer = warpvis.view(scene, agents=[robot, human])

The page needs the extra ``warpvis[view]``. What it shows is computed by `ViewerState`, which needs no browser.
"""

import lazy_loader

# `__init__.pyi` beside this file is the table of names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
