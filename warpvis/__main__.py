# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""``python -m warpvis``, and the command ``warpvis``: Ctrl-C ends it while the command line is still being imported."""

import os
import signal
import sys
from collections.abc import Callable


def main() -> None:
    """Run the command line, and end the process."""
    signal.signal(signal.SIGINT, lambda *_: os._exit(130))
    try:
        run = _import_command_line()
        run()
    finally:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # the command has finished: keep its exit code


def _import_command_line() -> Callable[[], None]:
    try:
        from warpvis.cli import main as run
    except ModuleNotFoundError as error:
        if error.name != "tyro":
            raise
        sys.exit("error: the command line needs tyro, which is missing: pip install 'warpvis[cli]'")
    return run


if __name__ == "__main__":
    main()
