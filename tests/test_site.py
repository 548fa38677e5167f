# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Tests of the documentation site built by `make docs`: coverage of the public interface, links, and page layout."""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
from browser_pages import DESKTOP, PHONE, chromium, drawn_points, opened, screenshot

ROOT = Path(__file__).parent.parent
EXAMPLES = ROOT / "examples"
DOCS = ROOT / "docs"
SITE = DOCS / "_build" / "html"
PAGES = (
    "index",
    "gallery",
    "start",
    "sensors/depth_cameras",
    "figures",
    "tutorials/kinect_in_ten_minutes",
    "api/warpvis",
)

COMMANDS = ("warpvis demo --out demo", "warpvis perspective experiment_2 --out who", "warpvis view experiment_3")

built = pytest.mark.site


class Loads(HTMLParser):
    """Collect the files that a page loads."""

    def __init__(self, page):
        super().__init__()
        self.found = []
        self.feed(page.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        """Note files of scripts, styles and images."""
        given = dict(attributes)
        if tag in ("script", "img", "iframe"):
            self.found.append(given.get("src"))
        elif tag == "link" and given.get("rel") in ("stylesheet", "preload", "icon"):
            self.found.append(given.get("href"))


@pytest.fixture(scope="module")
def reference():
    """Return the extension that generates the API reference."""
    sys.path.insert(0, str(DOCS / "_site"))
    import reference

    yield reference
    sys.path.remove(str(DOCS / "_site"))


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


def cards():
    """Return the gallery's pictures by name, with the commands that create each."""
    text = (DOCS / "gallery.md").read_text()
    card = r":::\{grid-item-card\}.*?\{image\} pictures/(\S+)(.*?)^:::$"
    return {
        name: re.findall(r"^```bash\n(.*?)^```", rest, re.S | re.M)
        for name, rest in re.findall(card, text, re.S | re.M)
    }


def test_gallery_has_a_command_for_each_picture():
    """Pictures of tutorials, and of pages with measurements or the viewer, are explained there instead."""
    shown = cards()
    elsewhere = [*DOCS.glob("tutorials/*"), *DOCS.glob("coming_from/*"), DOCS / "situations" / "methods.md"]
    elsewhere += [DOCS / "viewer.md", DOCS / "figures.md"]
    explained = "".join(page.read_text() for page in elsewhere if page.is_file() and page.suffix in (".md", ".ipynb"))
    missing = [path.name for path in DOCS.glob("pictures/*") if path.name not in shown and path.name not in explained]
    assert missing == ["experiment_1.png"]  # looks like experiment_2.png
    for picture, (command,) in shown.items():
        kind, what, *_ = command.split()
        if kind == "python":
            assert picture in (EXAMPLES.parent / what).read_text() + command
        else:
            assert command.strip() in COMMANDS


@built
def test_public_names_are_in_the_reference(reference):
    from sphinx.util.inventory import InventoryFile

    with (SITE / "objects.inv").open("rb") as file:
        inventory = InventoryFile.load(file, "", lambda base, path: path)
    explained = {name for kind, entries in inventory.items() if kind.startswith("py:") for name in entries}
    modules = reference.public_modules()
    public = {name for module_name, module in modules.items() for name, _ in reference.things_of(module_name, module)}
    assert len(public) > 200 and public - explained == set()


@built
def test_site_needs_no_network():
    pages = sorted(SITE.rglob("*.html"))
    assert len(pages) > 40
    away = {(page.name, file) for page in pages for file in Loads(page).found if file and re.match(r"(\w+:)?//", file)}
    assert away == set()


@built
def test_page_links_resolve():
    """Both files and anchors."""
    places = {page: set(re.findall(r'\bid="([^"]+)"', page.read_text())) for page in SITE.rglob("*.html")}
    broken = []
    for page in places:
        for target in re.findall(r'<a [^>]*href="([^"]+)"', page.read_text()):
            file, _, place = target.partition("#")
            there = (page.parent / file).resolve() if file else page
            if ":" in target or (file and not file.endswith(".html")):
                continue
            if there not in places or (place and place not in places[there]):
                broken.append((page.relative_to(SITE).as_posix(), target))
    assert broken == []


@built
@pytest.mark.browser
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("name", PAGES)
def test_pages_fit_the_window(browser, name, size):
    """All images load, and only scrollable elements are wider than the window."""
    page = browser.new_page(viewport={"width": size[0], "height": size[1]})
    page.goto((SITE / f"{name}.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= size[0]
    assert page.evaluate("[...document.images].filter(i => i.complete && !i.naturalWidth).map(i => i.src)") == []
    picture = screenshot(page, f"site_{Path(name).name}_{'desktop' if size == DESKTOP else 'phone'}")
    assert picture.std() > 10
    page.close()


@built
@pytest.mark.browser
@pytest.mark.parametrize("scene", ["experiment_2", "experiment_3", "experiment_4"])
def test_gallery_live_pages_open_from_disk(browser, scene):
    """Without network requests."""
    page_file = SITE / "_static" / "live" / f"{scene}.html"
    with opened(browser, page_file.as_uri()) as page:
        assert drawn_points(page) > 10_000
        assert page.problems == []
        assert {request for request in page.requests if request.startswith("http")} == set()
        assert screenshot(page, f"site_live_{scene}").std() > 10
