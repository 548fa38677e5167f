# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Export of a page to one HTML file with the interactive 3D view, the table and the images."""

from __future__ import annotations

import base64
import io
import os
from html import escape
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from warpvis.core.checks import as_path, check_text
from warpvis.errors import FileFormatError
from warpvis.viewer._page import Page
from warpvis.viewer._state import Snapshot
from warpvis.viewer._tables import legend_html, table_html

_WIDE = 700
"""On pages narrower than this, the panel is initially closed [px]."""


def write_page(page: Page, path: str | os.PathLike[str], title: str) -> None:
    """Write the current page to a file, without handles, which have no effect there."""
    check_text(title, "title")
    file = as_path(path)
    assert page.snapshot is not None  # set by the constructor of `Page`
    shown = page.gizmos.visible
    page.gizmos.visible = False
    try:
        document = page.server.scene.as_html(dark_mode=page.dark)
    finally:
        page.gizmos.visible = shown
    if "</body>" not in document or "<head>" not in document:
        raise FileFormatError(f"{file}: the page exported by this version of viser has no <head> or <body>")
    head, _, tail = document.rpartition("</body>")
    document = f"{head}{_panel(page.snapshot, title, page.dark)}</body>{tail}"
    document = document.replace("<head>", f"<head><title>{escape(title)}</title>", 1)
    try:
        Path(file).write_text(document, encoding="utf-8")
    except OSError as error:
        raise FileFormatError(f"{file}: cannot be written: {error.strerror}") from None


def _panel(snapshot: Snapshot, title: str, dark: bool) -> str:
    """Return the HTML of a collapsible panel with the table and the images, at the page's right border."""
    paper, ink = ("#1b1b1b", "#ddd") if dark else ("#fff", "#111")
    images = "".join(
        f'<figure style="margin:0.6em"><figcaption style="font-size:0.8em">{escape(agent.name)} sees</figcaption>'
        f'<img alt="what {escape(agent.name)} sees" style="width:100%" src="{_data_url(picture)}"></figure>'
        for agent, picture in zip(snapshot.agents, snapshot.pictures, strict=True)
    )
    style = (
        f"position:fixed;top:0.5em;right:0.5em;width:min(20em,85vw);max-height:calc(100vh - 1em);overflow:auto;"
        f"background:{paper};color:{ink};border-radius:0.4em;box-shadow:0 0 0.6em rgba(0,0,0,0.3);z-index:1000;"
        f"font-family:system-ui,sans-serif"
    )
    summary = f'<summary style="padding:0.5em 0.6em;font-weight:600;cursor:pointer">{escape(title)}</summary>'
    legend = legend_html([agent.name for agent in snapshot.agents])
    closing = f"if(innerWidth<{_WIDE})document.getElementById('warpvis').open=false"
    return (
        f'<details id="warpvis" open style="{style}">{summary}{table_html(snapshot)}{legend}{images}</details>'
        f"<script>{closing}</script>"
    )


def _data_url(picture: NDArray[np.uint8]) -> str:
    from PIL import Image

    data = io.BytesIO()
    Image.fromarray(picture).save(data, "PNG", optimize=True)
    return f"data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}"
