# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""The documentation is correct: its code runs, and its links, files, names and commands exist."""

import importlib
import inspect
import re
import shlex
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import docs_preludes as preludes
import pytest
from renamed import RENAMED_NAMES, RENAMED_OPTIONS

import warpvis as wv
from warpvis.cli import main
from warpvis.core import plugins

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
CHANGES = ROOT / "CHANGELOG.md"
# tests/test_docs_tutorials.py and test_docs_coming_from.py run these and compare their output.
RUN_ELSEWHERE = (ROOT / "docs" / "tutorials", ROOT / "docs" / "coming_from")
GALLERY = ROOT / "docs" / "gallery.md"  # checked by tests/test_site.py
SNIPPETS = [page for page in PAGES[1:] if page.parent not in RUN_ELSEWHERE and page != GALLERY]

_EXPLAINED_FROM = 45  # column of the map where explanations begin

PAGE = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)


def fences(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def code_words(page):
    """Return the words between backticks and in fences."""
    text = page.read_text()
    fenced = re.findall(r"^```\w*\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    quoted = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))
    return [word for piece in [*fenced, *quoted] for word in piece.split()]


def slug(heading):
    """Return GitHub's anchor of a heading."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def find(dotted):
    """Return the object of a dotted name; raise `AttributeError` or `ImportError` if it does not exist."""
    first, *rest = dotted.split(".")
    thing = importlib.import_module(first)
    for name in rest:
        # A dataclass field without a default is not a class attribute.
        if name in getattr(thing, "__dataclass_fields__", ()):
            thing = thing.__dataclass_fields__[name]
        elif isinstance(thing, types.ModuleType) and not hasattr(thing, name):
            thing = importlib.import_module(f"{thing.__name__}.{name}")
        else:
            thing = getattr(thing, name)
    return thing


@pytest.mark.docs
def test_quickstart_runs_as_written(tmp_path):
    code = re.search(r"## Quickstart.*?```python\n(.*?)```", README, re.DOTALL)[1]
    assert len([line for line in code.splitlines() if line.strip()]) <= 12
    (tmp_path / "quickstart.py").write_text(code)
    result = subprocess.run([sys.executable, "quickstart.py"], cwd=tmp_path, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    promised = re.search(r"## Quickstart.*?```text\n(.*?)```", README, re.DOTALL)[1]
    printed = [line for line in result.stdout.splitlines() if not line.startswith(("Warp ", "Module ", "   "))]
    assert "\n".join(printed).strip() == promised.strip()
    assert (tmp_path / "map.png").is_file()


@pytest.mark.docs
@pytest.mark.parametrize("page", [page for page in SNIPPETS if fences(page, "python")], ids=lambda page: page.stem)
def test_code_runs(page, tmp_path, monkeypatch):
    """Run all Python fences of a page in order, after the page's prelude."""
    monkeypatch.chdir(tmp_path)
    names = preludes.prepare(page.stem, tmp_path)
    for number, code in enumerate(fences(page, "python")):
        # Warp reads the source of kernels from the file.
        file = tmp_path / f"{page.stem}_{number}.py"
        file.write_text(preludes.made_smaller(code))
        exec(compile(file.read_text(), file, "exec"), names)


@pytest.mark.docs
@pytest.mark.parametrize(
    "page",
    [page for page in [*PAGES[:1], *SNIPPETS] if "warpvis " in "".join(fences(page, "bash"))],
    ids=lambda page: page.stem,
)
def test_commands_run(page, tmp_path, monkeypatch, capsys):
    """Run all ``warpvis`` commands in a page's shell fences."""
    monkeypatch.chdir(tmp_path)
    preludes.prepare(page.stem, tmp_path)
    for line in preludes.made_smaller("".join(fences(page, "bash"))).splitlines():
        if line.startswith("warpvis "):
            monkeypatch.setattr(sys, "argv", shlex.split(line))
            try:
                main()
            except SystemExit as stop:
                assert not stop.code, f"{line}\n{capsys.readouterr().err}"


@pytest.mark.parametrize("page", [*PAGES, CHANGES], ids=lambda page: page.stem)
def test_links_resolve(page):
    for target in re.findall(r"\]\(([^)]+)\)", page.read_text()):
        if "://" in target:
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        assert there.exists(), target
        assert there.is_relative_to(ROOT), target
        if anchor:
            headings = re.findall(r"^#+ (.+)$", there.read_text(), re.MULTILINE)
            assert anchor in map(slug, headings), target


@PAGE
def test_mentioned_files_exist(page):
    """Checks paths from the repository's root, and headers by bare names."""
    for word in code_words(page):
        path = word.strip("(),;:").split("::")[0]
        if (
            re.fullmatch(r"(warpvis|kernels|tests|bench|docs|scripts|examples|scenes|\.ci)/[\w./*{},-]+", path)
            and "/_build/" not in path
        ):
            patterns = [path.replace("{cpu,cuda,shared}", kind) for kind in ("cpu", "cuda", "shared")]
            assert all(list(ROOT.glob(pattern)) for pattern in patterns), path
        if re.fullmatch(r"\w+\.h", path):
            assert list((ROOT / "kernels" / "native").rglob(path)), path


@PAGE
def test_mentioned_names_exist(page):
    """Checks ``wv.name`` and ``warpvis.name``, and ``Name.attribute`` of top-level classes."""
    words = " ".join(code_words(page))
    dotted = re.findall(r"(?<![\w./'\[-])(?:wv|warpvis)((?:\.[A-Za-z]\w*)+)", words)
    for name in re.findall(r"(?<![\w.])[A-Z]\w+\.[a-z]\w+", words):
        if name.split(".")[0] in wv.__all__:
            dotted.append(f".{name}")
    for name in dotted:
        if f"warpvis{name}" in (plugins.MESH_READERS, plugins.DATASET_FORMATS, plugins.OUTPUT_MODULES):
            continue  # groups of entry points
        try:
            find(f"warpvis{name}")
        except (AttributeError, ImportError) as error:
            pytest.fail(f"{page.name} names warpvis{name}, which is not there: {error}")


def test_top_level_names_are_documented():
    """Every top-level function and class is mentioned in the README or a page."""
    text = " ".join(" ".join(code_words(page)) for page in PAGES)
    missing = [name for name in wv.__all__ if not (name.startswith("_") or re.search(rf"\b{name}\b", text))]
    assert missing == []


def test_old_names_are_gone():
    """Renamed names exist under their new names only, and no page uses the old ones."""
    words = {word for page in [*PAGES, CHANGES] for word in code_words(page)}
    for old, new in RENAMED_NAMES.items():
        find(new.replace("wv", "warpvis", 1))
        with pytest.raises((AttributeError, ImportError)):
            find(old.replace("wv", "warpvis", 1))
        assert not any(re.search(rf"\b{re.escape(old)}\b", word) for word in words), old


@pytest.mark.parametrize("options", RENAMED_OPTIONS, ids=lambda options: options[1])
def test_old_options_are_gone(options):
    """Functions accept renamed options by their new names only."""
    old, new, *functions = options
    for function in functions:
        thing = find(f"warpvis.{function}")
        parameters = inspect.signature(thing).parameters
        assert new in parameters and old not in parameters, f"{function}: {', '.join(parameters)}"


def test_architecture_map_matches_the_import_linter():
    """Layers are listed from the top down, with layers of equal rank on one line."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    layers = project["tool"]["importlinter"]["contracts"][0]["layers"]
    held = [set(re.findall(r"warpvis\.(\w+)", layer)) for layer in layers]
    drawn = fences(ROOT / "docs" / "architecture.md", "text")[0].split("\n\n")[0]
    names = [set(re.findall(r"\w+", line[:_EXPLAINED_FROM])) for line in drawn.splitlines()]
    assert [line for line in names if line] == held


def test_figures_page_has_benchmark_markers(monkeypatch):
    """The page of figures contains the markers that `make bench` and bench/gpu.py write between."""
    monkeypatch.syspath_prepend(ROOT / "bench")
    marked = importlib.import_module("marked")
    for name in ("bench", "gpu"):
        head, tail = marked.split_marked(ROOT / "docs" / "figures.md", name)
        assert head.startswith("# Figures") and tail.strip()


def test_mentioned_make_targets_exist():
    makefile = (ROOT / "Makefile").read_text()
    for page in PAGES:
        for target in re.findall(r"(?:^    |`)make ([a-z][a-z-]*)", page.read_text(), re.MULTILINE):
            assert re.search(rf"^{target}:", makefile, re.MULTILINE), f"{page.name}: make {target}"
