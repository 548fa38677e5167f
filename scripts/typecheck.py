# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check types in a copy of the package laid out as installed.

Type checkers do not support the mapping of `kernels/` and `scenes/` into `warpvis` by an editable installation.
"""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

root = Path(__file__).resolve().parent.parent
with tempfile.TemporaryDirectory() as folder:
    package = Path(folder) / "warpvis"
    shutil.copytree(root / "warpvis", package)
    for name in ("kernels", "scenes"):
        shutil.copytree(root / name, package / name)
    command = [sys.executable, "-m", "mypy", "--config-file", str(root / "pyproject.toml"), "-p", "warpvis"]
    sys.exit(subprocess.run(command, cwd=folder).returncode)
