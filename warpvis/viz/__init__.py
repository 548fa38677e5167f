# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Draw pictures: depth images in metres, labels, a floor map with its legend, a scene from outside, who sees what."""

import lazy_loader

# `FloorMap.save` comes here from below: who draws a map needs no planning and no visibility.
# `__init__.pyi` beside this file is the table of names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
