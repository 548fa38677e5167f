# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Pages in Debian's Chromium, driven by Playwright with WebGL by SwiftShader, and counts of their draw calls."""

import contextlib
import os
import shutil
import time
from pathlib import Path

import numpy as np
from PIL import Image

DESKTOP, PHONE = (1400, 900), (390, 844)

_OPTIONS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
_READY_MS = 120_000
_MAX_ATTEMPTS = 9
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
def opened(browser, url, size=DESKTOP, *, drawn=True):
    """Yield a page, by default one that has drawn something; `page.problems` lists its errors."""
    width, height = size
    page = browser.new_page(viewport={"width": width, "height": height})
    page.set_default_timeout(_READY_MS)
    page.problems, page.requests = [], []
    page.on("pageerror", lambda error: page.problems.append(str(error)))
    page.on("console", lambda message: message.type == "error" and page.problems.append(message.text))
    page.on("request", lambda request: page.requests.append(request.url))
    page.add_init_script(_COUNT_DRAWS)
    try:
        page.goto(url)
        if drawn:
            _wait_for_drawing(page)
        _close_notification(page)
        yield page
    finally:
        page.close()  # a page left open would keep drawing


def _wait_for_drawing(page):
    page.wait_for_function("window.drawn.some(d => d[0] === 4 && d[1] > 300)", timeout=_READY_MS)


def _close_notification(page):
    """Close the notification that WebGL is software."""
    with contextlib.suppress(Exception):
        page.locator(".mantine-Notification-closeButton").first.click(timeout=2000)


def clients_of_attempts(page, server):
    """Yield the client of a page whose camera stands still, once an attempt.

    Slow software WebGL may lose a press of the mouse, turn it into a turn of the camera, or lose all of a page: each
    third attempt loads the page again.
    """
    for attempt in range(_MAX_ATTEMPTS):
        if attempt and attempt % 3 == 0:
            page.reload()
            _wait_for_drawing(page)
            _close_notification(page)
        assert holds_within(page, lambda: len(server.get_clients()) == 1)
        (client,) = server.get_clients().values()
        wait_for_camera(page, client)
        yield client


def holds_within(page, condition, seconds=60):
    """Return whether a condition holds before the time is over: software WebGL may need seconds for each picture."""
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        page.wait_for_timeout(100)
    return condition()


def project(camera, points, size):
    """Return where the page shows world points [px], for a canvas of this size."""
    from viser.transforms import SO3

    width, height = size
    inside = (np.asarray(points) - camera.position) @ SO3(np.asarray(camera.wxyz)).as_matrix()
    focal = height / 2 / np.tan(camera.fov / 2)
    return np.array([width / 2, height / 2]) + focal * inside[..., :2] / inside[..., 2:]


def wait_for_camera(page, client):
    """Wait until the browser's camera stands still where the server knows it: the first view is set twice."""
    own = "(() => { const c = window.__viserMutable?.camera; return c ? [...c.matrixWorld.elements, c.fov] : null; })()"
    before = None

    def is_still():
        nonlocal before
        last, before = before, (page.evaluate(own), client.camera.update_timestamp, client.camera.fov)
        if before[0] is None or before != last:
            return False
        # The browser's world is turned, which keeps the distance from the origin.
        same_place = np.isclose(np.linalg.norm(before[0][12:15]), np.linalg.norm(client.camera.position), rtol=1e-4)
        return bool(same_place and np.isclose(before[0][-1], np.degrees(client.camera.fov)))

    assert holds_within(page, is_still), f"the camera moves: {before}"


def click(page, place):
    """Click at a place [px] as a user does, with time between the press and the release."""
    page.mouse.move(*place)
    page.wait_for_timeout(100)
    page.mouse.down()
    page.wait_for_timeout(100)
    page.mouse.up()


def panel_box(page):
    """Return the borders of the panel of a live page: left, top, right, bottom [px]."""
    return page.evaluate(
        """() => {
          const divs = [...document.querySelectorAll("div")];
          let node = divs.find((div) => div.childElementCount === 0 && div.textContent === "warpvis");
          while (node.parentElement.getBoundingClientRect().width < 350) node = node.parentElement;
          const box = node.getBoundingClientRect();
          return [box.left, box.top, box.right, box.bottom];
        }"""
    )


def is_beside_panel(page, server, points, size):
    """Return whether the only browser of a server shows all points on its canvas, above or to the left of the panel."""
    (client,) = server.get_clients().values()
    pixels = project(client.camera, points, size)
    left, top, _, _ = panel_box(page)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    on_canvas = (low >= 0).all() and (high <= size).all()
    return bool(on_canvas and (high[0] <= left or high[1] <= top))


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
