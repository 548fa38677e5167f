# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Sphinx extension: write API pages from the lists of public names, and link types and code to them."""

from __future__ import annotations

import ast
import functools
import importlib
import inspect
import re
import sys
import types
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docutils import nodes
from sphinx.addnodes import pending_xref
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.pycode import ModuleAnalyzer
from sphinx.util.inspect import stringify_signature

ROOT = "warpvis"

# Documentation of types from other projects that occur in signatures.
ELSEWHERE = {
    "numpy.ndarray": "https://numpy.org/doc/stable/reference/generated/numpy.ndarray.html",
    "warp.array": "https://nvidia.github.io/warp/modules/runtime.html#arrays",
    "torch.Tensor": "https://docs.pytorch.org/docs/stable/tensors.html",
    "mujoco.MjModel": "https://mujoco.readthedocs.io/en/stable/APIreference/APItypes.html#mjmodel",
    "mujoco.MjData": "https://mujoco.readthedocs.io/en/stable/APIreference/APItypes.html#mjdata",
    "trimesh.Trimesh": "https://trimesh.org/trimesh.base.html#trimesh.base.Trimesh",
    "pathlib.Path": "https://docs.python.org/3/library/pathlib.html#pathlib.Path",
    "collections.abc.Sequence": "https://docs.python.org/3/library/collections.abc.html#collections.abc.Sequence",
    "collections.abc.Iterator": "https://docs.python.org/3/library/collections.abc.html#collections.abc.Iterator",
    "collections.abc.Mapping": "https://docs.python.org/3/library/collections.abc.html#collections.abc.Mapping",
    "collections.abc.Callable": "https://docs.python.org/3/library/collections.abc.html#collections.abc.Callable",
}

# Names of unions of types in signatures, and the modules that define them.
WORDS = {
    "ArrayInput": "warpvis.core.types",
    "PoseLike": "warpvis.core.types",
    "MeshLike": "warpvis.core.types",
    "ObjectPoses": "warpvis.core.types",
    "ObjectScales": "warpvis.core.types",
    "Excluded": "warpvis.core.types",
    "Json": "warpvis.core.types",
    "Up": "warpvis.pose_generators._generators",
    "Direction": "warpvis.sensors._rolling_shutter",
    "DeviceLike": "warpvis.core.types",
    "Convention": "warpvis.core.poses",
    "QuaternionOrder": "warpvis.core.poses",
    "LabelInput": "warpvis.core.labels",
    "ImageCamera": "warpvis.cameras.image_cameras",
    "PlanarCamera": "warpvis.cameras.image_cameras",
    "DepthKind": "warpvis.cameras.base",
    "Reflectivity": "warpvis.sensors._echoes",
    "LearnedInput": "warpvis.sensors.depth._learned",
    "SceneSource": "warpvis.batch._frame_renderer",
    "CameraChoice": "warpvis.mujoco._batch_views",
    "Movable": "warpvis.mujoco._scene",
    "Resizable": "warpvis.mujoco._world_models",
    "Segmentation": "warpvis.mujoco.gymnasium._outputs",
    "Message": "warpvis.core.messages",
    "Stamp": "warpvis.core.messages",
}
_ALIASES = {"np": "numpy", "wp": "warp", "wv": ROOT}


def public_modules() -> dict[str, types.ModuleType]:
    """Return the modules that list public names, by dotted name, from the top down."""
    found: dict[str, types.ModuleType] = {}

    def visit(name: str) -> None:
        module = importlib.import_module(name)
        listed = names_of(module)
        if not listed or name in found:
            return
        found[name] = module
        for child in listed:
            if isinstance(getattr(module, child), types.ModuleType):
                visit(f"{name}.{child}")

    visit(ROOT)
    visit(f"{ROOT}.mujoco.gymnasium")  # not imported by `warpvis.mujoco`, since it needs an extra
    return found


def names_of(module: types.ModuleType) -> list[str]:
    """Return the public names of a module; without ``__all__``, the names that it defines."""
    listed = getattr(module, "__all__", None)
    if listed is None:
        listed = [name for name, thing in vars(module).items() if getattr(thing, "__module__", "") == module.__name__]
    return sorted((name for name in listed if not name.startswith("_")), key=str.lower)


def things_of(name: str, module: types.ModuleType) -> Iterator[tuple[str, Any]]:
    """Yield the dotted public names of a module that are not modules, with their objects."""
    for child in names_of(module):
        thing = getattr(module, child)
        if not isinstance(thing, types.ModuleType):
            yield f"{name}.{child}", thing


def write_pages(app: Sphinx) -> None:
    """Write a page for each public module, and their table of contents, to ``docs/api``."""
    folder = Path(app.srcdir) / "api"
    folder.mkdir(exist_ok=True)
    modules = public_modules()
    app.config.warpvis_public = dict(entry for name, module in modules.items() for entry in things_of(name, module))
    pages = {f"{name}.rst": page_of(name, module) for name, module in modules.items()}
    pages["index.rst"] = index_of(modules)
    pages["types.rst"] = types_page()
    for file in folder.glob("*.rst"):
        if file.name not in pages:
            file.unlink()
    for file_name, text in pages.items():
        # An unchanged file keeps its modification time, so that a second build has nothing to do.
        file = folder / file_name
        if not file.exists() or file.read_text() != text:
            file.write_text(text)


def index_of(modules: dict[str, types.ModuleType]) -> str:
    """Return the index page, with a row for each module."""
    rows = [f"   * - :doc:`{name} <{name}>`\n     - {first_sentence(module)}" for name, module in modules.items()]
    rows.append("   * - :doc:`types <types>`\n     - Types in signatures, such as `ArrayInput`.")
    contents = [f"   {name}" for name in (*modules, "types")]
    return "\n".join([
        "API reference", "=============", "",
        "Import the library as ``import warpvis as wv``: ``wv.render`` is here ``warpvis.render``.",
        "Every public name has one import path, and is on the page of that module.", "",
        ".. list-table::", "   :widths: 30 70", "", *rows, "",
        ".. toctree::", "   :hidden:", "", *contents, "",
    ])  # fmt: skip


def page_of(name: str, module: types.ModuleType) -> str:
    """Return the page of a module: its description, then its names, classes first."""
    things = list(things_of(name, module))
    lines = [name, "=" * len(name), "", f".. py:module:: {name}", "", first_sentence(module), ""]
    groups = {
        "Classes": [entry for entry in things if inspect.isclass(entry[1])],
        "Functions": [entry for entry in things if inspect.isroutine(entry[1])],
        "Data": [entry for entry in things if not (inspect.isclass(entry[1]) or inspect.isroutine(entry[1]))],
    }
    for title, entries in groups.items():
        if entries:
            lines += [title, "-" * len(title), ""]
        for dotted, thing in entries:
            directive = {"Classes": "autoclass", "Functions": "autofunction"}.get(title)
            lines += [f".. {directive}:: {dotted}", ""] if directive else data_of(dotted, thing)
    return "\n".join(lines)


def types_page() -> str:
    """Return the page of `WORDS`, with their definitions."""
    lines = ["Types of signatures", "===================", "", "These names cannot be imported.", ""]
    for word, module in sorted(WORDS.items()):
        value, explained = assignment(word, module)
        lines += [f".. py:data:: {word}", f"   :value: {value}", "", *(f"   {line}" for line in explained), ""]
    return "\n".join(lines)


def data_of(dotted: str, thing: Any) -> list[str]:
    """Return the entry of a constant: its docstring, and its value if that is a number or a type."""
    name = dotted.rsplit(".", 1)[-1]
    home = next(module for module in sorted(sys.modules) if name in assignments(module))
    value, explained = assignment(name, home)
    short = isinstance(thing, (int, float)) or not hasattr(thing, "__len__")
    return [f".. py:data:: {name}", *([f"   :value: {value}"] * short), "", *(f"   {line}" for line in explained), ""]


def assignment(name: str, module: str) -> tuple[str, list[str]]:
    """Return the source of a name's value in a module, and its docstring."""
    return assignments(module)[name], ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name), [])


@functools.cache
def assignments(module: str) -> dict[str, str]:
    """Return the names that a module of the library assigns, with the source of their values."""
    found: dict[str, str] = {}
    if not module.startswith(f"{ROOT}.") or getattr(sys.modules[module], "__file__", None) is None:
        return found
    for node in ast.parse(inspect.getsource(sys.modules[module])).body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            if isinstance(target, ast.Name) and getattr(node, "value", None) is not None:
                found[target.id] = ast.unparse(node.value).strip("'")
    return found


def first_sentence(module: types.ModuleType) -> str:
    """Return the first paragraph of a module's docstring."""
    return " ".join((inspect.getdoc(module) or "").split("\n\n")[0].split())


def public_name(target: str, public: dict[str, Any]) -> str | None:
    """Return the import path of a type or a word in backticks; None if it is not public."""
    first, _, rest = target.partition(".")
    dotted = f"{_ALIASES.get(first, first)}.{rest}" if rest else first
    if dotted in public or dotted in WORDS:
        return dotted
    # `Camera`, `Camera.kinect`, or a path in the module that defines the class.
    head, tail = (dotted, "") if "." not in dotted else dotted.rsplit(".", 1)
    for candidate, attribute in ((dotted.rsplit(".", 1)[-1], ""), (head.rsplit(".", 1)[-1], tail)):
        homes = [name for name in public if name.rsplit(".", 1)[-1] == candidate]
        if len(homes) == 1 and (candidate[:1].isupper() or dotted.startswith(f"{ROOT}.")):
            return f"{homes[0]}.{attribute}" if attribute else homes[0]
    return None


def keep_attribute(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Hide the docstring of an attribute from Napoleon, which would read "Its eyes: ..." as a type."""
    if what in ("attribute", "data", "property") and not any(re.match(r"\w+:$", line) for line in lines):
        app.env.temp_data["warpvis_attribute"] = lines[:]
        lines[:] = [""]


def show_attribute(app: Sphinx, what: str, name: str, obj: Any, options: Any, lines: list[str]) -> None:
    """Restore the docstring that `keep_attribute` hid."""
    kept = app.env.temp_data.pop("warpvis_attribute", None)
    if kept is not None:
        lines[:] = kept


def written_signature(
    app: Sphinx, what: str, name: str, obj: Any, options: Any, args: str | None, result: str | None
) -> tuple[str, str] | None:
    """Return a signature with types as in the source: evaluated unions would fill the page."""
    if args is None or what not in ("class", "function", "method"):
        return None
    signature = inspect.signature(obj)
    parameters = list(signature.parameters.values())
    if parameters and parameters[0].name == "self":
        parameters = parameters[1:]
    result = signature.return_annotation if what != "class" else inspect.Signature.empty
    text = stringify_signature(
        signature.replace(parameters=parameters, return_annotation=result), unqualified_typehints=True
    )
    args, _, result = text.rpartition(" -> ") if " -> " in text else (text, "", "")
    return args, result


def resolve(app: Sphinx, env: BuildEnvironment, node: pending_xref, content: nodes.TextElement) -> nodes.Node | None:
    """Link a type to its page on this site or on that of its project."""
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    name = public_name(target, app.config.warpvis_public)
    if name is not None and (name != target or name in WORDS):
        domain = env.domains["py"]
        return domain.resolve_xref(env, node["refdoc"], app.builder, "obj", name, node, content)
    first, _, rest = target.partition(".")
    dotted = f"{_ALIASES.get(first, first)}.{rest}"
    full = next((known for known in ELSEWHERE if known in (dotted, target) or known.rsplit(".", 1)[-1] == target), None)
    if full is None:
        return None
    return nodes.reference("", "", content, internal=False, refuri=ELSEWHERE[full])


def link_code(app: Sphinx, doctree: nodes.document) -> None:
    """Turn code such as ``wv.render`` in pages into links."""
    for literal in list(doctree.findall(nodes.literal)):
        match = re.fullmatch(r"(wv(?:\.\w+)+)(\(.*\))?", literal.astext())
        if match is None or isinstance(literal.parent, (nodes.reference, pending_xref, nodes.title)):
            continue
        name = public_name(match[1], app.config.warpvis_public)
        if name is None:
            continue
        link = pending_xref("", refdomain="py", reftype="obj", reftarget=name, refexplicit=True, refwarn=False)
        link["refdoc"] = app.env.docname
        literal.replace_self(link)
        link += literal


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the extension."""
    app.add_config_value("warpvis_public", {}, "")
    app.connect("builder-inited", write_pages)
    app.connect("autodoc-process-signature", written_signature)
    app.connect("autodoc-process-docstring", keep_attribute, priority=400)
    app.connect("autodoc-process-docstring", show_attribute, priority=600)
    app.connect("missing-reference", resolve)
    app.connect("doctree-read", link_code)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
