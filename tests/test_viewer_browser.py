# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the live page and its export in a browser."""

import importlib.resources
import io
import time
from pathlib import Path

import numpy as np
import pytest
import viser.transforms
from browser_pages import DESKTOP, PHONE, chromium, context_version, drawn_points, opened, screenshot, wait_for_points
from PIL import Image

from warpvis.cli import View
from warpvis.scenes import EXPERIMENTS
from warpvis.viewer import Viewer, ViewerState
from warpvis.visibility import State
from warpvis.viz import STATE_COLORS

pytestmark = pytest.mark.browser

PORT = 8431
MAX_DRAGS = 3


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def serve(**options):
    experiment = EXPERIMENTS[2]
    return Viewer(ViewerState(experiment.build(), experiment.agents(), points=8000), port=PORT, **options)


@pytest.fixture
def viewer():
    with serve() as found:
        yield found


def table_of(page):
    """Return the table's cells as text, without the dots."""
    rows = page.locator("table.warpvis-table tbody tr")
    return [row.locator("td").all_inner_texts() for row in rows.all()]


def wait_for_table(page, text):
    page.locator("table.warpvis-table", has_text=text).wait_for(timeout=20_000)


def count_of(picture, color):
    return int((np.abs(picture.astype(int) - color).max(axis=-1) < 12).sum())


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_page_shows_experiment_3(browser, viewer, size):
    with opened(browser, viewer.url, size) as page:
        wait_for_points(page, len(viewer.page.snapshot.points))
        assert "WebGL 2" in context_version(page)
        assert [row[0] for row in table_of(page)] == [row.name for row in viewer.page.snapshot.rows]
        assert table_of(page)[2][1:] == ["100 %", "out of view"]
        name = "desktop" if size == DESKTOP else "phone"
        picture = screenshot(page, f"viewer_experiment_3_{name}")
        assert picture.std() > 20
        for state in (State.FIRST, State.SECOND, State.NEITHER):  # more than the legend's dots
            assert count_of(picture, STATE_COLORS[state]) > 1500
        assert page.problems == []


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_page_shows_two_agents_at_the_aloha_table(browser, size):
    file = importlib.resources.files("mujoco_warp") / "test_data" / "aloha_pot" / "scene.xml"
    state = View(file=Path(str(file)), robot="teleoperator_pov", human="collaborator_pov").load()
    with Viewer(state, port=PORT) as viewer, opened(browser, viewer.url, size) as page:
        wait_for_points(page, len(viewer.page.snapshot.points))
        assert table_of(page)[0][0] == "partnet_100015"
        assert screenshot(page, f"viewer_aloha_{'desktop' if size == DESKTOP else 'phone'}").std() > 20
        assert page.problems == []


def test_slider_changes_the_table(browser, viewer):
    with opened(browser, viewer.url) as page:
        wait_for_table(page, "out of view")
        before = table_of(page)[2][1]
        slider = page.get_by_role("slider").first  # the height of the robot's eyes
        slider.focus()
        for _ in range(60):
            slider.press("ArrowLeft")
        page.wait_for_function(
            "was => document.querySelectorAll('table.warpvis-table tbody tr')[2].children[1].innerText !== was",
            arg=before,
            timeout=20_000,
        )
        assert viewer.state.height("robot") < 0.6
        page.get_by_role("button", name="Reset scene").click()
        wait_for_table(page, before)


def test_dragged_handle_changes_the_table(browser, viewer):
    with opened(browser, viewer.url) as page:
        wait_for_table(page, "100 %")
        gizmo = viewer.page.gizmos.objects["ball"]
        ball = np.array(gizmo.position)
        (client,) = viewer.server.get_clients().values()

        def has_moved():
            return viewer.state.object_pose("ball")[1] > ball[1] + 0.3

        # Slow software WebGL may lose a press of the mouse, or turn it into a turn of the camera: drag again then.
        for _ in range(MAX_DRAGS):
            # The green arrow, which moves the ball behind the high obstacle.
            start, end = (project(client.camera, ball + (0, way, 0), DESKTOP) for way in (0.9 * gizmo.scale, 1.5))
            page.mouse.move(*start)
            if holds_within(page, lambda: is_yellow(page, start)):  # noqa: B023 (called within this round)
                drag(page, start, end)
            if holds_within(page, has_moved):
                break
        assert has_moved()
        row = next(row for row in viewer.page.snapshot.rows if row.name == "ball")
        wait_for_table(page, row.cells[0])
        assert row.fractions[0] < 0.9


def drag(page, start, end):
    """Drag the mouse in six steps."""
    page.mouse.down()
    for share in np.linspace(0.1, 1, 6):
        page.mouse.move(*(start + share * (end - start)))
    page.mouse.up()


def holds_within(page, condition, seconds=60):
    """Return whether a condition holds before the time is over: software WebGL may need seconds for each picture."""
    deadline = time.monotonic() + seconds
    while not condition() and time.monotonic() < deadline:
        page.wait_for_timeout(100)
    return condition()


def is_yellow(page, place):
    """Return whether the page shows yellow at a place [px]."""
    png = page.screenshot(clip={"x": place[0], "y": place[1], "width": 1, "height": 1})
    red, green, blue = Image.open(io.BytesIO(png)).convert("RGB").getpixel((0, 0))
    return min(red, green) > blue + 50


def project(camera, point, size):
    """Return where the page shows a world point [px]."""
    width, height = size
    inside = viser.transforms.SO3(np.asarray(camera.wxyz)).inverse() @ (np.asarray(point) - camera.position)
    focal = height / 2 / np.tan(camera.fov / 2)
    return np.array([width / 2, height / 2]) + focal * inside[:2] / inside[2]


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_exported_file_opens_from_disk(browser, tmp_path, dark):
    path = tmp_path / "three.html"
    with serve(dark=dark) as viewer:
        viewer.save_html(path, title="Experiment 3")
        points, rows = len(viewer.page.snapshot.points), viewer.page.snapshot.rows
    for size, name in ((DESKTOP, "desktop"), (PHONE, "phone")):
        with opened(browser, path.as_uri(), size) as page:
            wait_for_points(page, points)
            assert drawn_points(page) == points
            assert [row[1:] for row in table_of(page)] == [list(row.cells) for row in rows] or name == "phone"
            assert page.title() == "Experiment 3"
            assert [url for url in page.requests if not url.startswith(("file:", "data:", "blob:"))] == []
            picture = screenshot(page, f"viewer_export_{'dark_' if dark else ''}{name}")
            assert (picture.mean() < 128) == dark and picture.std() > 20
            assert page.problems == []
