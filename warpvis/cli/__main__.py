# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m warpvis.cli``."""

from warpvis.cli import main

main()
