# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Check types as a user's editor sees them: of a copy laid out as installed, from another folder.

Type checkers do not follow the mapping of `kernels/` and `scenes/` into `warpvis` that an editable installation makes.
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
