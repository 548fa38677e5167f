# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m warpvis``."""

from warpvis.cli import main

if __name__ == "__main__":
    main()
