# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Formats of datasets, one module per format. `Layout` is the base class of formats with one file per frame."""

import lazy_loader

# Loaded lazily: `_base`, which lists the formats, is imported by modules that `Layout` needs.
__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={"_layouts": ["Layout"]})
