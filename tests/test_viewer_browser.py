# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the live page and its export in a browser."""

import importlib.resources
import io
import itertools
from pathlib import Path

import numpy as np
import pytest
from browser_pages import (
    DESKTOP,
    PHONE,
    chromium,
    click,
    clients_of_attempts,
    context_version,
    drawn_points,
    holds_within,
    is_beside_panel,
    opened,
    panel_box,
    project,
    screenshot,
    wait_for_points,
)
from PIL import Image

from warpvis.cli import View
from warpvis.scenes import EXPERIMENTS
from warpvis.viewer import Viewer, ViewerState
from warpvis.visibility import State
from warpvis.viz import STATE_COLORS

from support.picking import agents, table

pytestmark = pytest.mark.browser

PORT = 8431


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
    state = View(file=Path(str(file)), robot="teleoperator_pov", human=("collaborator_pov",)).load()
    with Viewer(state, port=PORT) as viewer, opened(browser, viewer.url, size) as page:
        wait_for_points(page, len(viewer.page.snapshot.points))
        assert table_of(page)[0][0] == "partnet_100015"
        assert screenshot(page, f"viewer_aloha_{'desktop' if size == DESKTOP else 'phone'}").std() > 20
        assert page.problems == []


def corners_of(scene):
    """Return the corners of the boxes of all objects, ``(n, 3)``."""
    return np.array([corner for item in scene.objects for corner in itertools.product(*item.bounds.T)])


def test_phone_shows_the_whole_scene_and_a_folded_panel(browser, viewer):
    corners = corners_of(viewer.state.scene)
    with opened(browser, viewer.url, PHONE) as page:
        assert holds_within(page, lambda: is_beside_panel(page, viewer.server, corners, PHONE))
        assert holds_within(page, lambda: PHONE[1] - panel_box(page)[1] <= 60)
        screenshot(page, "viewer_first_view_phone")
        (client,) = viewer.server.get_clients().values()
        pixels = project(client.camera, corners, PHONE)
        assert np.ptp(pixels[:, 0]) > 0.8 * PHONE[0]  # no smaller than necessary
        page.get_by_text("warpvis", exact=True).click()
        assert holds_within(page, lambda: PHONE[1] - panel_box(page)[1] > 400)
        wait_for_table(page, "out of view")
        screenshot(page, "viewer_open_panel_phone")
        turned = PHONE[::-1]
        page.set_viewport_size({"width": turned[0], "height": turned[1]})
        assert holds_within(page, lambda: is_beside_panel(page, viewer.server, corners, turned))
        screenshot(page, "viewer_turned_phone")
        assert page.problems == []


def test_desktop_shows_the_whole_scene_beside_the_panel_until_it_is_moved(browser, viewer):
    corners = corners_of(viewer.state.scene)
    with opened(browser, viewer.url) as page:
        assert holds_within(page, lambda: is_beside_panel(page, viewer.server, corners, DESKTOP))
        assert panel_box(page)[3] - panel_box(page)[1] > 400
        nothing_there = np.array([100, 750])
        for client in clients_of_attempts(page, viewer.server):
            before = client.camera.position
            drag(page, nothing_there, nothing_there + (100, 0))
            if holds_within(page, lambda: np.linalg.norm(client.camera.position - before) > 0.5, seconds=20):  # noqa: B023
                break
        assert np.linalg.norm(client.camera.position - before) > 0.5, what_is_at(page, nothing_there)
        page.wait_for_timeout(2000)
        moved = client.camera.position
        viewer.page.first_view.extend(10 * corners)  # no longer moves the camera
        page.wait_for_timeout(2000)
        np.testing.assert_allclose(client.camera.position, moved, atol=1e-3)
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

        def has_moved():
            return viewer.state.object_pose("ball")[1] > ball[1] + 0.3

        for client in clients_of_attempts(page, viewer.server):
            # The green arrow, which moves the ball behind the high obstacle.
            start, end = (project(client.camera, ball + (0, way, 0), DESKTOP) for way in (0.9 * gizmo.scale, 1.5))
            page.mouse.move(*start)
            if holds_within(page, lambda: is_yellow(page, start), seconds=20):  # noqa: B023 (called within this round)
                drag(page, start, end)
                if holds_within(page, has_moved, seconds=20):
                    break
        assert has_moved(), what_is_at(page, start)
        row = next(row for row in viewer.page.snapshot.rows if row.name == "ball")
        wait_for_table(page, row.cells[0])
        assert row.fractions[0] < 0.9


def test_clicked_point_is_answered(browser):
    with Viewer(ViewerState(table(), agents(), points=3000), port=PORT) as viewer, opened(browser, viewer.url) as page:
        point = np.array([2.0, 0.15, 0.8])
        page.locator(".warpvis-answers", has_text="Click a surface").wait_for(timeout=90_000)
        wait_for_points(page, len(viewer.page.snapshot.points))
        for client in clients_of_attempts(page, viewer.server):
            click(page, project(client.camera, point, DESKTOP))
            if holds_within(page, lambda: viewer.page.snapshot.picked is not None, seconds=20):
                break
        picked = viewer.page.snapshot.picked
        assert picked is not None, what_is_at(page, project(client.camera, point, DESKTOP))
        np.testing.assert_allclose(picked.point, point, atol=0.02)
        page.locator(".warpvis-answers", has_text=f"robot: {picked.reasons['robot']}").wait_for(timeout=90_000)
        assert picked.object == "table" and picked.reasons["robot"].startswith("hidden by board at")
        assert page.locator(".warpvis-answers div").last.inner_text() == "anna: visible"
        screenshot(page, "viewer_picked")
        before = page.locator("table.warpvis-meant").inner_text()
        page.get_by_text("gaze", exact=True).click()
        page.get_by_text("right [deg]").wait_for(timeout=90_000)
        slider = page.get_by_role("slider").first
        for _ in range(12):
            slider.press("ArrowRight")
        page.locator("table.warpvis-meant tbody tr").first.filter(has_text="cup").wait_for(timeout=90_000)
        assert page.locator("table.warpvis-meant").inner_text() != before
        assert holds_within(page, lambda: viewer.page.gaze.angles["anna"][0] == pytest.approx(np.radians(12)))
        screenshot(page, "viewer_gaze")
        assert page.problems == []


def what_is_at(page, place):
    """Return what a page shows of presses: the element at a place [px], gestures, locks of the camera, the answers."""
    element = "([x, y]) => { const e = document.elementFromPoint(x, y); return `${e?.tagName} ${e?.className}`; }"
    gesture = """(() => {
      const pointer = window.__viserPointer;
      return JSON.stringify([pointer?.getGesture(), pointer?.hasSceneClickFilter(), pointer?.cameraLockReasons()]);
    })()"""
    answers = page.locator(".warpvis-answers").all_inner_texts()
    return f"{page.evaluate(element, place.tolist())}; {page.evaluate(gesture)}; {answers}; {page.problems}"


def drag(page, start, end):
    """Drag the mouse in six steps as a user does, with time between the press, the steps and the release."""
    page.mouse.move(*start.astype(float))
    page.wait_for_timeout(100)
    page.mouse.down()
    for share in np.linspace(0.1, 1, 6):
        page.wait_for_timeout(50)
        page.mouse.move(*(start + share * (end - start)))
    page.wait_for_timeout(50)
    page.mouse.up()


def is_yellow(page, place):
    """Return whether the page shows yellow at a place [px]."""
    png = page.screenshot(clip={"x": place[0], "y": place[1], "width": 1, "height": 1}, timeout=120_000)
    red, green, blue = Image.open(io.BytesIO(png)).convert("RGB").getpixel((0, 0))
    return min(red, green) > blue + 50


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
            borders = picture[picture.shape[0] // 4 :, [0, 1, 2, -3, -2, -1]]
            assert name == "desktop" or (borders == borders[0, 0]).all()  # the whole scene is on the page
            assert (picture.mean() < 128) == dark and picture.std() > 20
            assert page.problems == []
