# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the page of `warpvis watch` in a browser."""

import subprocess
import sys

import numpy as np
import pytest
from browser_pages import (
    DESKTOP,
    PHONE,
    chromium,
    holds_within,
    is_beside_panel,
    opened,
    panel_box,
    project,
    screenshot,
)

import warpvis as wv
from warpvis.viewer import WatchPage

from support.watching import BALL, BOX, CAMERA, EYES, FLOOR, depths, person, raised, save_folder, trajectory

pytestmark = pytest.mark.browser

PORT = 8461
BEFORE_BOARD = (0.5, -0.8, 1.3)
"""Where a person stands who sees both balls, on the camera's side of the board."""
FRAMES, WALK_ENDS, START = 12, 10, 100
"""Number of frames, one a second; the first in which the person stands there; time of the first frame [s]."""


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture
def command(tmp_path):
    """Run `warpvis watch` at 10 s a frame on a recording in which a person walks to the other side of the board."""
    camera = save_folder(tmp_path / "room", FRAMES)
    poses = tmp_path / "room" / "groundtruth.txt"
    numbers = [line.split(maxsplit=1) for line in poses.read_text().splitlines()]
    poses.write_text("".join(f"{START + int(when)} {row}\n" for when, row in numbers))
    for path in sorted((tmp_path / "room" / "depth").iterdir()):
        path.rename(path.with_name(f"{START + int(path.stem)}.000000.png"))
    rows = [person(eyes=BEFORE_BOARD if when >= WALK_ENDS else EYES).poses[0] for when in range(FRAMES)]
    lines = [f"{START + when},anna,{','.join(map(str, row))}" for when, row in enumerate(rows)]
    (tmp_path / "people.csv").write_text("\n".join(["timestamp,name,x,y,z,qx,qy,qz,qw", *lines]) + "\n")
    places = [f"{name}={','.join(map(str, raised(place)))}" for name, place in (("ball", BALL), ("box", BOX))]
    options = ["--camera", camera.name, "--people", "people.csv", "--floor", FLOOR, "--cell-size", 0.04]
    options += ["--places", *places, "--speed", 0.1, "--port", PORT]
    words = [sys.executable, "-m", "warpvis", "watch", "room", *map(str, options)]
    with subprocess.Popen(words, cwd=tmp_path, stdout=subprocess.PIPE, text=True) as process:
        yield process
        process.kill()


def cell(page, place, column):
    """Return what a cell of the table says when the mouse is over it."""
    row = page.locator("table.warpvis-table tbody tr", has_text=place).first
    return row.locator("td").nth(column).get_attribute("title")


def test_answers_change_with_the_recording(browser, command):
    url = command.stdout.readline().split()[0]
    with opened(browser, url) as page:
        page.locator("table.warpvis-table th", has_text="anna").wait_for(timeout=60_000)
        heads = page.locator("table.warpvis-table th").all_inner_texts()
        assert heads == ["", "robot", "anna"]
        status = page.locator(".warpvis-status").inner_text()
        assert status.startswith("frame") and f"of {FRAMES}, time" in status, status
        screenshot(page, "watch_desktop")
        assert cell(page, "ball", 1).startswith("seen") and cell(page, "ball", 2).startswith("hidden"), status
        assert cell(page, "box", 2).startswith("seen")
        slider = page.locator('[role=slider][aria-valuemax="4"]')  # the speed
        assert slider.get_attribute("aria-valuenow") == "0.1"
        slider.press("End")
        assert holds_within(page, lambda: slider.get_attribute("aria-valuenow") == "4", 10)
        page.locator(".warpvis-status", has_text=f"frame {FRAMES} of {FRAMES}").wait_for(timeout=60_000)
        assert cell(page, "ball", 2).startswith("seen") and cell(page, "box", 2).startswith("seen")
        screenshot(page, "watch_desktop_end")
        assert page.problems == []


def cloud_points(page):
    return np.array(page._clouds["surface"].points)


@pytest.mark.parametrize("size", [PHONE, DESKTOP], ids=["phone", "desktop"])
@pytest.mark.parametrize("first", ["page", "browser"])
def test_first_view_shows_map_people_and_places(browser, size, first):
    poses = trajectory(3)
    people = [person(), person("bob", eyes=(0.5, 3.0, 1.4))]
    places = {"ball": raised(BALL), "box": raised(BOX)}
    watcher = wv.visibility.DepthWatcher(CAMERA, floor=FLOOR, cell_size=0.04, places=places)
    watched = [watcher.update(image, pose, people) for image, pose in zip(depths(poses), poses, strict=True)]
    with WatchPage(watcher, port=PORT + 1) as shown:
        if first == "page":
            shown.show(watched[-1], "frame 3")
        with opened(browser, shown.url, size, drawn=first == "page") as page:
            shown.show(watched[-1], "frame 3")
            names = page.locator("table.warpvis-table th", has_text="bob")
            names.wait_for(state="attached", timeout=60_000)
            eyes = [agent.poses[0, :3] for agent in (watched[-1].robot, *watched[-1].people)]
            points = np.concatenate([eyes, [place[:3] for place in watched[-1].places.values()]])
            assert holds_within(page, lambda: is_beside_panel(page, shown.server, points, size))
            (client,) = shown.server.get_clients().values()
            cloud = project(client.camera, cloud_points(shown), size)
            free = np.array(size) - ((0, 60) if size == PHONE else (size[0] - panel_box(page)[0], 0))
            assert len(cloud) > 5000 and ((cloud > 0) & (cloud < free)).all(axis=1).mean() > 0.99
            if size == PHONE:
                assert holds_within(page, lambda: size[1] - panel_box(page)[1] <= 60)
            screenshot(page, f"watch_first_view_{size[0]}_{first}")
            far = cloud_points(shown) * (3, 3, 1)
            shown._view.extend(far)  # a map that grows
            assert holds_within(page, lambda: is_beside_panel(page, shown.server, far, size))
            assert page.problems == []
