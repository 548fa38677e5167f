# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m warpvis``, and the command ``warpvis``: Ctrl-C ends it while the command line is still being imported."""

import os
import signal


def main() -> None:
    """Run the command line, and end the process."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    try:
        from warpvis.cli import main as run

        run()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the run is over: its exit code counts


if __name__ == "__main__":
    main()
