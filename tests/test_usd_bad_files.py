# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Invalid USD stages raise one sentence, and print nothing."""

import sys

import pytest

import warpvis as wv
from warpvis.errors import FileFormatError, SceneError

from support import usd_stages as stages

pytest.importorskip("pxr")
from pxr import Sdf

_INSTANCER = """
def PointInstancer "p"
{
    rel prototypes = [</p/m>]
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0, 0, 0), (1, 0, 0)]
    MORE
    MESH
}
""".replace("MESH", stages.mesh("m"))


def instancer(old, new):
    return _INSTANCER.replace(old, new).replace("MORE", "")


INVALID = {
    "syntax": ('def Mesh "a"\n{\n    point3f[] points = [(0, 0\n}\n', r"stage.usda:\d+: cannot be read as USD: "),
    "index": (
        stages.mesh("a", shape=stages.TRIANGLE.replace("[0, 1, 2]", "[0, 1, 7]")),
        r"stage.usda: faceVertexIndices of </a> must be from 0 to 2, got 7",
    ),
    "negative index": (
        stages.mesh("a", shape=stages.TRIANGLE.replace("[0, 1, 2]", "[0, 1, -2]")),
        r"faceVertexIndices of </a> must be from 0 to 2, got -2",
    ),
    "counts": (
        stages.mesh("a", shape=stages.TRIANGLE.replace("[3]", "[4]")),
        r"faceVertexCounts of </a> must sum to its 3 faceVertexIndices",
    ),
    "negative counts": (
        stages.mesh("a", shape=stages.TRIANGLE.replace("[3]", "[-3, 6]")),
        r"faceVertexCounts of </a> must",
    ),
    "points": (
        stages.mesh("a", shape=stages.TRIANGLE.replace("(1, 0, 0)", "(nan, 0, 0)")),
        r"stage.usda: vertices of '/a' must be finite: 1 are not",
    ),
    "transform": (
        stages.mesh("a", 'float3 xformOp:scale = (inf, 1, 1)\nuniform token[] xformOpOrder = ["xformOp:scale"]'),
        r"stage.usda: the transform of </a> must be finite",
    ),
    "axis": ('def Cone "a"\n{\n    uniform token axis = "W"\n}\n', r"axis of </a> must be X, Y or Z, got 'W'"),
    "radius": ('def Sphere "a"\n{\n    double radius = -1\n}\n', r"radius of </a> must be at least 0, got -1"),
    "prototypes": (
        instancer("[0, 0]", "[0, 3]"),
        r"left out instances: protoIndices of </p> must be from 0 to 0, got 3; nothing is left",
    ),
    "positions": (instancer("[(0, 0, 0), (1, 0, 0)]", "[(0, 0, 0)]"), r"</p> must have one of positions for each of"),
    "scales": (instancer("MORE", "float3[] scales = [(1, 1, 1)]"), r"</p> must have one of scales for each of its 2"),
    "infinite": (instancer("(1, 0, 0)]", "(inf, 0, 0)]"), r"</p> must have finite positions, orientations and scales"),
    "recursion": (instancer("</p/m>", "</p>"), r"</p> is below its own prototype"),
    "missing reference": (
        'def "a" (\n    prepend references = @none.usda@\n)\n{\n}\n',
        r"left out references that cannot be opened: Could not open asset @.*none.usda@.*; nothing is left",
    ),
    "no triangles": (stages.mesh("a", shape=""), r"left out '/a', which hold no triangles; nothing is left"),
    "empty": ("", r"stage.usda: holds no triangles"),
}


@pytest.mark.parametrize("case", INVALID)
def test_invalid_stages_raise(tmp_path, case, capfd):
    text, message = INVALID[case]
    with pytest.raises((FileFormatError, SceneError), match=message) as error:
        stages.load(tmp_path, text)
    assert "\n" not in str(error.value) and "pxrInternal" not in str(error.value)
    assert capfd.readouterr() == ("", "")


FILES = {
    "empty.usd": (b"", "is empty"),
    "a.usda": (b"PXR-USDC" + bytes(100), r"is a binary file of USD, whose name must end in .usdc or .usd; rename it"),
    "a.usdc": (b"#usda 1.0\n", r"is a text file of USD, whose name must end in .usda or .usd; rename it"),
    "a.usdz": (b"#usda 1.0\n", r"is a text file of USD"),
    "junk.usdz": (b"junk of some length", r"cannot be read as USD: it is not a zip archive"),
    "zip.usdz": (b"PK\x03\x04" + bytes(60), r"cannot be read as USD: "),
    "junk.usd": (b"junk of some length", r"cannot be read as USD: "),
    "short.usdc": (b"PXR-USDC" + bytes(10), r"cannot be read as USD: File too small"),
    "zeros.usdc": (b"PXR-USDC" + bytes(1000), r"cannot be read as USD: "),
    "lfs.usd": (
        b"version https://git-lfs.github.com/spec/v1\noid sha256:0\n",
        r"is a git-lfs pointer, not a USD stage",
    ),
}


@pytest.mark.parametrize("name", FILES)
def test_invalid_files_raise(tmp_path, name, capfd):
    data, message = FILES[name]
    (tmp_path / name).write_bytes(data)
    with pytest.raises(FileFormatError, match=f"{name}: {message}") as error:
        wv.Scene.load(tmp_path / name)
    assert "\n" not in str(error.value)
    assert capfd.readouterr() == ("", "")


def test_truncated_binary_files_raise(tmp_path, capfd):
    path = stages.write(tmp_path, stages.mesh("a") + stages.mesh("b", shape=stages.SQUARE))
    Sdf.Layer.FindOrOpen(str(path)).Export(str(tmp_path / "a.usdc"))
    data = (tmp_path / "a.usdc").read_bytes()
    for length in range(8, len(data), max(1, len(data) // 40)):
        (tmp_path / f"cut_{length}.usdc").write_bytes(data[:length])
        with pytest.raises(FileFormatError, match="cannot be read as USD"):
            wv.Scene.load(tmp_path / f"cut_{length}.usdc")
    assert capfd.readouterr() == ("", "")


def test_invalid_units_raise(tmp_path):
    path = stages.write(tmp_path, stages.mesh("a"), header="#usda 1.0\n(\n    metersPerUnit = 0\n)\n")
    with pytest.raises(FileFormatError, match="metersPerUnit must be greater than 0, got 0"):
        wv.Scene.load(path)


def test_missing_references_are_left_out(tmp_path):
    text = 'def "a" (\n    prepend references = @none.usda@\n)\n{\n}\n' + stages.mesh("b")
    with pytest.warns(UserWarning, match="left out references that cannot be opened"):
        assert len(stages.load(tmp_path, text)) == 1
    with pytest.raises(FileFormatError, match="left out references that cannot be opened"):
        wv.Scene.load(tmp_path / "stage.usda", strict=True)


def test_changed_files_are_read_again(tmp_path):
    assert [item.name for item in stages.load(tmp_path, stages.mesh("a"))] == ["/a"]
    assert [item.name for item in stages.load(tmp_path, stages.mesh("b"))] == ["/b"]


def test_missing_package_is_named(tmp_path, monkeypatch):
    path = stages.write(tmp_path, stages.mesh("a"))
    monkeypatch.setitem(sys.modules, "pxr", None)
    with pytest.raises(FileFormatError, match=r"needs usd-core, which is missing: pip install 'warpvis\[usd\]'"):
        wv.Scene.load(path)
