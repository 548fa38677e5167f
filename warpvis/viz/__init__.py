# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of depth images, labels, floor maps, scenes from outside, and of what agents see.

Functions that write a file raise `warpvis.errors.FileFormatError` if it cannot be written.
"""

import lazy_loader

# Modules are loaded lazily: `save_map` needs neither planning nor visibility.
# `__init__.pyi` in this directory lists the public names.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
