# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pages in Debian's Chromium, driven by Playwright: WebGL by SwiftShader, and what was drawn by it."""

import contextlib
import os
import shutil
from pathlib import Path

import numpy as np
from PIL import Image

DESKTOP, PHONE = (1400, 900), (390, 844)

_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_READY_MS = 60_000
_POINTS = 0  # WebGL's POINTS

# Count what every frame draws, by the kind of primitive.
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
    """Why there is no browser here; empty if there is one."""
    return "" if shutil.which("chromium") else "no chromium is here"


@contextlib.contextmanager
def chromium():
    """A browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=_OPTIONS)
        yield browser
        browser.close()


@contextlib.contextmanager
def opened(browser, url, size=DESKTOP):
    """A page that has drawn something; what went wrong in it is in `page.problems`."""
    width, height = size
    page = browser.new_page(viewport={"width": width, "height": height})
    page.problems, page.requests = [], []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on("request", lambda request: page.requests.append(request.url))
    page.add_init_script(_COUNT_DRAWS)
    page.goto(url)
    page.wait_for_function("window.drawn.some(d => d[0] === 4 && d[1] > 300)", timeout=_READY_MS)
    yield page
    page.close()


def drawn_points(page):
    """The most points that one call has drawn, in the last frames."""
    return page.evaluate(f"Math.max(0, ...window.drawn.filter(d => d[0] === {_POINTS}).map(d => d[1]))")


def wait_for_points(page, count):
    """Wait until the cloud is drawn."""
    page.wait_for_function(f"window.drawn.some(d => d[0] === {_POINTS} && d[1] === {count})", timeout=_READY_MS)


def context_version(page):
    """The version of the WebGL that the page's largest canvas has."""
    return page.evaluate(
        """() => {
          const all = [...document.querySelectorAll("canvas")].sort((a, b) => b.width * b.height - a.width * a.height);
          return all[0].getContext("webgl2").getParameter(WebGL2RenderingContext.VERSION);
        }"""
    )


def screenshot(page, name):
    """Write a picture of the page where `WARPVIS_SCREENSHOTS` says, and return its pixels."""
    folder = Path(os.environ.get("WARPVIS_SCREENSHOTS", ".pytest_cache/screenshots"))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.png"
    # That WebGL is software is no news here.
    page.evaluate("document.querySelectorAll('.mantine-Notification-root').forEach(notice => notice.remove())")
    page.wait_for_timeout(3000)  # what fades in or out has done so
    page.screenshot(path=path)
    return np.asarray(Image.open(path).convert("RGB"))
