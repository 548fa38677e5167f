# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Names for what calls take, for signatures and type checkers."""

from __future__ import annotations

import warp as wp

DeviceLike = wp.Device | str | None
"""A device or its name: ``"cpu"``, ``"cuda:0"``, ...; None for Warp's current one."""
