# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Count calls of a function."""

import sys


def calls_of(function, run):
    """Return how often a function of that name is called during `run`."""
    count = 0

    def look(frame, event, _):
        nonlocal count
        count += event == "call" and frame.f_code.co_name == function

    sys.setprofile(look)
    try:
        run()
    finally:
        sys.setprofile(None)
    return count
