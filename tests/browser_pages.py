# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pages in Debian's Chromium, driven by Playwright with WebGL by SwiftShader, and counts of their draw calls."""

import contextlib
import os
import shutil
from pathlib import Path

import numpy as np
from PIL import Image

DESKTOP, PHONE = (1400, 900), (390, 844)

_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_READY_MS = 120_000
_BETWEEN_PICTURES_MS, _MAX_PICTURES = 1500, 20
_CHANGING = 1e-3  # share of pixels that may change between frames, such as a frame counter
_POINTS = 0  # WebGL's POINTS

# Count the draw calls of each frame by primitive.
_COUNT_DRAWS = """
window.drawn = [];
for (const name of ["drawArrays", "drawElements"]) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    window.drawn.push([given[0], name === "drawArrays" ? given[2] : given[1]]);
    if (window.drawn.length > 2000) window.drawn.shift();
    return draw.apply(this, given);
  };
}
"""


def why_no_chromium():
    """Return why no browser is available, or an empty string."""
    return "" if shutil.which("chromium") else "no chromium is here"


@contextlib.contextmanager
def chromium():
    """Yield a browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=_OPTIONS)
        yield browser
        browser.close()


@contextlib.contextmanager
def opened(browser, url, size=DESKTOP):
    """Yield a page that has drawn something; `page.problems` lists its errors."""
    width, height = size
    page = browser.new_page(viewport={"width": width, "height": height})
    page.problems, page.requests = [], []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on("request", lambda request: page.requests.append(request.url))
    page.add_init_script(_COUNT_DRAWS)
    try:
        page.goto(url)
        page.wait_for_function("window.drawn.some(d => d[0] === 4 && d[1] > 300)", timeout=_READY_MS)
        with contextlib.suppress(Exception):  # ignore the notification that WebGL is software
            page.locator(".mantine-Notification-closeButton").first.click(timeout=2000)
        yield page
    finally:
        page.close()  # a page left open would keep drawing


def drawn_points(page):
    """Return the largest number of points drawn by one call in the last frames."""
    return page.evaluate(f"Math.max(0, ...window.drawn.filter(d => d[0] === {_POINTS}).map(d => d[1]))")


def wait_for_points(page, count):
    """Wait until the point cloud is drawn."""
    page.wait_for_function(f"window.drawn.some(d => d[0] === {_POINTS} && d[1] === {count})", timeout=_READY_MS)


def context_version(page):
    """Return the WebGL version of the page's largest canvas."""
    return page.evaluate(
        """() => {
          const all = [...document.querySelectorAll("canvas")].sort((a, b) => b.width * b.height - a.width * a.height);
          return all[0].getContext("webgl2").getParameter(WebGL2RenderingContext.VERSION);
        }"""
    )


def screenshot(page, name):
    """Save a screenshot to the folder in `WARPVIS_SCREENSHOTS` and return its pixels.

    The page is captured once animations have finished and nothing changes any more.
    """
    folder = Path(os.environ.get("WARPVIS_SCREENSHOTS", ".pytest_cache/screenshots"))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    before = None
    for _ in range(_MAX_PICTURES):
        page.wait_for_timeout(_BETWEEN_PICTURES_MS)
        page.screenshot(path=path)
        picture = np.asarray(Image.open(path).convert("RGB"))
        if before is not None and (picture != before).any(axis=-1).mean() < _CHANGING:
            break
        before = picture
    return picture
