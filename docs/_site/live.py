# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx extension: write the live pages of the gallery, one file each, with the command line."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from sphinx.application import Sphinx

SCENES = ("experiment_2", "experiment_3", "experiment_4")


def write_pages(app: Sphinx) -> None:
    """Write ``_static/live/SCENE.html`` for each scene, unless it exists."""
    folder = Path(app.srcdir) / "_site" / "static" / "live"
    folder.mkdir(exist_ok=True)
    for scene in SCENES:
        page = folder / f"{scene}.html"
        if not page.exists():
            command = [sys.executable, "-m", "warpvis", "view", scene, "--html", str(page)]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension: pages are written before Sphinx copies static files."""
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}
