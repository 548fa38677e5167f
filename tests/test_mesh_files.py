# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Mesh files: names and order of parts, compression, units and axes, and archives."""

import bz2
import gzip
import io
import subprocess
import sys
import tarfile
import warnings
import zipfile

import numpy as np
import pytest
import trimesh
from gltf_files import GltfWriter

import warpvis as wv
from warpvis import Scene
from warpvis.errors import FileFormatError, SceneError

from support.mesh_files import BALL, OBJ, SOLIDS, TRIANGLE, car, dae, draco_file, meshopt_file, threemf


def load(path, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return Scene.load(path, **options)


def write(folder, writer, name="x.glb", **options):
    (folder / name).write_bytes(writer.bytes(**options) if isinstance(writer, GltfWriter) else writer)
    return folder / name


def refusal(path, **options):
    with pytest.raises(FileFormatError) as caught:
        load(path, **options)
    assert "\n" not in str(caught.value)
    return str(caught.value)


CAR = ["body_0", "body_1", "body_2", "wheel", "wheel_2", "wheel_1", "mesh_6", "node_4_0", "node_4_1"]


def test_names_and_order_match_file(tmp_path):
    scene = load(write(tmp_path, car()))
    assert [item.name for item in scene] == CAR
    scene.export(tmp_path / "again.glb")
    again = load(tmp_path / "again.glb")
    assert [item.name for item in again] == CAR
    for item in again:
        np.testing.assert_allclose(item.vertices, scene[item.name].vertices, atol=1e-6)


def files_of_many_parts(folder):
    """Write files of every multi-part format, and return the names in each."""
    write(folder, car(), "car.glb")
    (folder / "animals.obj").write_text(OBJ)
    (folder / "groups.obj").write_text(OBJ.replace("o ", "g "))
    (folder / "solids.stl").write_text(SOLIDS)
    (folder / "animals.dae").write_text(dae("", geometries=("zebra", "apple", "mid")))
    with zipfile.ZipFile(folder / "all.zip", "w") as archive:
        for name in ("solids.stl", "animals.obj", "groups.obj"):
            archive.write(folder / name, f"in/{name}")
        BALL.export(folder / "ball.ply")
        archive.write(folder / "ball.ply", "ball.ply")
        archive.writestr("__MACOSX/._ball.ply", b"junk")
        archive.writestr("read.me", b"no mesh")
    animals = ["zebra", "apple", "mid"]
    return {
        "car.glb": CAR,
        "animals.obj": animals,
        "groups.obj": animals,
        "solids.stl": animals[:2],
        "animals.dae": animals,
        "all.zip": [*animals[:2], "zebra_1", "apple_1", "mid", "zebra_2", "apple_2", "mid_1", "ball"],
    }


@pytest.mark.slow
def test_names_are_deterministic_across_processes(tmp_path):
    names = files_of_many_parts(tmp_path)
    assert {name: [item.name for item in load(tmp_path / name)] for name in names} == names
    code = (
        "import sys; from warpvis.io import read_parts\n"
        "for path in sys.argv[1:]: print([part.name for part in read_parts(path).parts])"
    )
    command = [sys.executable, "-c", code, *names]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert [line for line in run.stdout.splitlines() if line.startswith("[")] == list(map(str, names.values()))


def test_batch_of_multi_material_file_resumes(tmp_path):
    path = write(tmp_path, car())
    frames = wv.Frames.from_poses(np.repeat([wv.look_at((0, -3, 1), (0, 0, 1))], 3, axis=0))
    camera = wv.Camera.from_fov(8, 8, hfov=1.0)
    wv.render_batch(path, camera, frames, tmp_path / "out", shard_frames=1)
    (tmp_path / "out" / "index.json").unlink()
    (tmp_path / "out" / "shards" / "000001.json").unlink()
    assert wv.render_batch(path, camera, frames, tmp_path / "out", shard_frames=1, resume=True).rendered_frames == 1


def test_obj_syntax_variants(tmp_path):
    upright = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 2\nv 1 0 2\nv 0 1 2\nf 4 5 6\n"
    variants = {
        "relative": upright.replace("f 1 2 3", "f -3 -2 -1").replace("f 4 5 6", "f -3 -2/ -1"),
        "tabs": upright.replace(" ", "\t"),
        "spaces": "  " + upright.replace("\n", "\n  ").replace("v ", "v   "),
        "windows": upright.replace("\n", "\r\n"),
        "continued": upright.replace("f 1 2 3", "f 1 \\\n2 3"),
    }
    for name, text in {"upright": upright, **variants}.items():
        (tmp_path / f"{name}.obj").write_bytes(text.encode())
        scene = load(tmp_path / f"{name}.obj")
        assert [item.name for item in scene] == [name]
        corners = scene[name].vertices[scene[name].faces].reshape(-1, 3)
        np.testing.assert_array_equal(corners[:, 2], [0, 0, 0, 2, 2, 2], err_msg=name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0\nv 1 0\nv 0 1\nf 1 2 3\n", r"line 1: a vertex needs three numbers, got 'v 0 0'"),
        ("v 0 0 0\n v 1 0 # short\nv 0 1 0\nf 1 2 3\n", r"line 2: a vertex needs three numbers, got 'v 1 0 # short'"),
        ("v 0 0 0\nv 1 \\\n0 0\nv 0 1\nf 1 2 3\n", r"line 4: a vertex needs three numbers, got 'v 0 1'"),
        ("v 0 0 0\nv 1 0 0\nv 0 1 0\nf -4 2 3\n", r"a face references vertex -4 after 3 vertices"),
    ],
)
def test_malformed_obj_lines_are_reported(tmp_path, text, message):
    assert message in refusal(write(tmp_path, text.encode(), "x.obj"))


def test_obj_faces_of_two_corners_are_skipped(tmp_path):
    """Some exporters write loose edges as such faces."""
    text = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\nf 1/1 3/1 # edge\nf 1 2 3\nf \\\n2 3\nf 3 2 1\n"
    path = write(tmp_path, text, "edges.obj")
    message = r"edges.obj: left out 3 faces of fewer than three corners, the first 'f 1 2' in line 4"
    with pytest.warns(UserWarning, match=message):
        scene = Scene.load(path)
    np.testing.assert_array_equal(scene["edges"].vertices[scene["edges"].faces][:, 0], [[0, 0, 0], [0, 1, 0]])
    with pytest.raises(FileFormatError, match=message):
        load(path, strict=True)
    path.write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2\n")
    with pytest.raises(SceneError, match=r"left out 1 face .*'f 1 2' in line 4; nothing is left"):
        load(path)


@pytest.mark.slow
def test_no_traceback_is_printed(tmp_path):
    """Tracebacks that trimesh logs, of errors it raises or recovers from, are suppressed too."""
    broken = SOLIDS.replace("normal 0 0 1", "normal x 0 1").encode()
    code = "import sys, warpvis as wv\ntry: wv.Scene.load(sys.argv[1])\nexcept wv.WarpvisError as error: print(error)"
    command = [sys.executable, "-c", code, str(write(tmp_path, broken, "x.stl"))]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "Traceback" not in run.stderr and "face_normals" not in run.stderr


def test_draco_is_decoded(tmp_path):
    pytest.importorskip("DracoPy")
    file = draco_file()
    assert b'"extensionsRequired":["KHR_draco_mesh_compression"]' in file.replace(b" ", b"")
    scene = load(write(tmp_path, file, "ball.glb"), up="y")
    faces = scene["ball"].faces
    assert len(faces) == len(BALL.faces)
    # 14 bits over the extent: the error of a coordinate is at most half a step.
    found, wanted = scene["ball"].vertices[faces], BALL.vertices[BALL.faces]
    np.testing.assert_allclose(found, wanted, atol=1.01 * 2**-15)


def test_optional_draco_needs_no_decoder(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "DracoPy", None)
    writer = GltfWriter(extensionsUsed=["KHR_draco_mesh_compression"])
    primitive = writer.primitive(TRIANGLE, [0, 1, 2])
    junk = {"bufferView": writer.view(b"junk"), "attributes": {"POSITION": 0}}
    writer.node(primitive | {"extensions": {"KHR_draco_mesh_compression": junk}}, name="flat")
    np.testing.assert_array_equal(load(write(tmp_path, writer), up="y")["flat"].vertices, TRIANGLE)


def test_draco_with_normalized_integers(tmp_path):
    """DracoPy returns integers as floats; the accessor defines their normalization."""
    DracoPy = pytest.importorskip("DracoPy")
    rows = np.round(BALL.vertices / 0.5 * 32767)
    data = DracoPy.encode(rows, BALL.faces, quantization_bits=20, compression_level=0)
    writer = GltfWriter(extensionsRequired=["KHR_draco_mesh_compression", "KHR_mesh_quantization"])
    view = writer.view(data)
    for normalized in (True, False):
        item = {"componentType": 5122, "count": len(rows), "type": "VEC3", "normalized": normalized}
        writer.content["accessors"].append(item)
        packed = {"bufferView": view, "attributes": {"POSITION": 0}}
        place = {"POSITION": len(writer.content["accessors"]) - 1}
        writer.node({"attributes": place, "extensions": {"KHR_draco_mesh_compression": packed}})
    scene = load(write(tmp_path, writer), up="y")
    for item, radius in zip(scene, (1.0, 32767.0), strict=True):
        np.testing.assert_allclose(np.linalg.norm(item.vertices[item.faces], axis=-1), radius, rtol=1e-4)


def test_gpu_instancing(tmp_path):
    """EXT_mesh_gpu_instancing: translations, rotations and scales of any component type, relative to the node."""
    writer = GltfWriter(extensionsRequired=["EXT_mesh_gpu_instancing"])
    quarter = np.int16(np.round(32767 * np.array([[0, 0, 0, 1], [0, 0, 0.5**0.5, 0.5**0.5], [1, 0, 0, 0]])))
    move, size = np.float32([[0, 0, 0], [5, 0, 0], [0, 7, 0]]), np.float32([[1, 1, 1], [2, 1, 1], [1, 1, 3]])
    rows = {"TRANSLATION": move, "ROTATION": quarter, "SCALE": size}
    attributes = {key: writer.accessor(value, normalized=value.dtype == np.int16) for key, value in rows.items()}
    attributes["_ID"] = writer.accessor(np.float32([1, 2, 3]))
    many = {"EXT_mesh_gpu_instancing": {"attributes": attributes}}
    parts = [writer.primitive(TRIANGLE, [0, 1, 2]) for _ in range(2)]
    writer.node(*parts, name="many", extensions=many, translation=[0, 0, 9])
    few = {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": attributes["TRANSLATION"]}}}
    writer.node(parts[0], extensions=few, extras={"label": "human"})
    scene = load(write(tmp_path, writer), up="y")
    names = [f"many_{part}_{copy}" for part in range(2) for copy in range(3)]
    assert [item.name for item in scene] == [*names, "node_1_0", "node_1_1", "node_1_2"]
    first = [(0, 0, 9), (1, 0, 9), (0, 1, 9)], [(5, 0, 9), (5, 2, 9), (4, 0, 9)], [(0, 7, 9), (1, 7, 9), (0, 6, 9)]
    for name, corners in zip(names, first * 2, strict=True):
        np.testing.assert_allclose(scene[name].vertices, corners, atol=2e-4)
    for copy in range(3):
        np.testing.assert_allclose(scene[f"node_1_{copy}"].vertices, TRIANGLE + move[copy])
        assert scene[f"node_1_{copy}"].label == wv.Label.HUMAN


@pytest.mark.parametrize(
    ("change", "wanted"),
    [
        ({"count": 10**9}, "all attributes must have one number of rows up to 100000, got [1000000000]"),
        ({"count": 2, "bufferView": None}, "all attributes must have one number of rows up to 100000, got [2, 3]"),
        ({"count": -1}, "all attributes must have one number of rows up to 100000, got [-1]"),
        ({"type": "VEC2"}, "translation and scale must have 3 numbers, rotation 4, got 2"),
    ],
)
def test_invalid_gpu_instancing_is_rejected(tmp_path, change, wanted):
    writer = GltfWriter()
    places = [writer.accessor(np.zeros((3, 3), np.float32)) for _ in range(2)]
    items = writer.content["accessors"]
    items[0] |= {key: value for key, value in change.items() if value is not None}
    attributes = {"TRANSLATION": places[0]} | ({"SCALE": places[1]} if "bufferView" in change else {})
    writer.node(writer.primitive(TRIANGLE), extensions={"EXT_mesh_gpu_instancing": {"attributes": attributes}})
    assert wanted in refusal(write(tmp_path, writer))


@pytest.mark.parametrize("extension", ["EXT_meshopt_compression", "KHR_meshopt_compression"])
@pytest.mark.parametrize(("filter", "off"), [(None, 0), ("EXPONENTIAL", 2.0**-20)])
def test_meshopt_is_decoded(tmp_path, extension, filter, off):
    scene = load(write(tmp_path, meshopt_file(extension, filter)), up="y")
    wanted = np.sort(BALL.vertices[BALL.faces].astype(np.float32).reshape(-1, 9), axis=0)
    for name in ("ball", "twin"):  # the encoder may rotate the vertices of a triangle, but keeps the order of triangles
        item = scene[name]
        assert len(item.faces) == len(BALL.faces)
        np.testing.assert_allclose(item.vertices, BALL.vertices.astype(np.float32), atol=off)
        found = item.vertices[item.faces]
        np.testing.assert_allclose(found.mean(axis=1), BALL.triangles_center, atol=max(off, 1e-6))
    np.testing.assert_allclose(np.sort(found.reshape(-1, 9), axis=0), wanted, atol=max(off, 1e-6))


@pytest.mark.parametrize(
    ("package", "extension"),
    [("DracoPy", "KHR_draco_mesh_compression"), ("meshoptimizer", "EXT_meshopt_compression")],
)
def test_missing_decoder_error_names_package(tmp_path, monkeypatch, package, extension):
    pytest.importorskip(package)
    path = write(tmp_path, draco_file() if package == "DracoPy" else meshopt_file())
    monkeypatch.setitem(sys.modules, package, None)
    wanted = f"it is compressed by {extension}, and reading that needs {package}: pip install 'warpvis[gltf]'"
    assert refusal(path) == f"{path}: cannot be read as GLB: {wanted}"


def test_unsupported_required_extensions_are_rejected(tmp_path):
    for name, fine in {
        "CESIUM_RTC": False,
        "EXT_mesh_gpu_instancing": True,
        "KHR_materials_unlit": True,
        "KHR_texture_transform": True,
        "EXT_texture_webp": True,
        "KHR_mesh_quantization": True,
    }.items():
        writer = GltfWriter(extensionsRequired=[name])
        writer.node(writer.primitive(TRIANGLE), name="flat")
        path = write(tmp_path, writer)
        if fine:
            assert len(load(path)) == 1
        else:
            assert refusal(path).endswith(
                f"cannot be read as GLB: it requires the extension {name}, which is not supported"
            )


def test_quantized_and_sparse_positions(tmp_path):
    """KHR_mesh_quantization with plain and normalized integers, and sparse accessors."""
    writer = GltfWriter(extensionsRequired=["KHR_mesh_quantization"])
    rows = np.int16([[0, 0, 0, 0], [32767, 0, 0, 0], [0, -32768, 16384, 0]])
    view = writer.view(rows.tobytes(), byteStride=8)
    whole = writer.accessor(rows[:, :3], view=view)
    normal = writer.accessor(rows[:, :3], view=view, normalized=True)
    where, what = writer.view(np.uint8([2]).tobytes()), writer.view(np.float32([[5, 6, 7]]).tobytes())
    sparse = {
        "count": 1,
        "indices": {"bufferView": where, "componentType": 5121},
        "values": {"bufferView": what},
    }
    replaced = writer.accessor(TRIANGLE, sparse=sparse)
    writer.content["accessors"].append({"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse})
    for name, accessor in {"normal": normal, "replaced": replaced, "zeros": replaced + 1}.items():
        writer.node({"attributes": {"POSITION": accessor}}, name=name)
    writer.node({"attributes": {"POSITION": whole}}, name="whole", scale=[0.5, 1, 1])
    scene = load(write(tmp_path, writer), up="y")
    np.testing.assert_allclose(scene["whole"].vertices, rows[:, :3] * [0.5, 1, 1])
    np.testing.assert_allclose(scene["normal"].vertices, [[0, 0, 0], [1, 0, 0], [0, -1, 16384 / 32767]], rtol=1e-6)
    np.testing.assert_array_equal(scene["replaced"].vertices, [*TRIANGLE[:2], [5, 6, 7]])
    np.testing.assert_array_equal(scene["zeros"].vertices, [[0, 0, 0], [0, 0, 0], [5, 6, 7]])


def test_strips_fans_visibility_and_children_of_cameras(tmp_path):
    corners = np.float32([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]])
    writer = GltfWriter(cameras=[{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}}])
    writer.node(writer.primitive(corners, mode=5), name="strip")
    writer.node(writer.primitive(corners[[1, 3, 4, 2, 0]], [0, 1, 2, 3, 4], mode=6), name="fan")
    child = writer.node(writer.primitive(TRIANGLE), name="below")
    writer.node(camera=0, translation=[0, 0, 9], children=[child])
    hidden = {"KHR_node_visibility": {"visible": False}}
    writer.node(writer.primitive(TRIANGLE), name="hidden", extensions=hidden)
    writer.node(writer.primitive(TRIANGLE, mode=1), name="lines")
    path = write(tmp_path, writer, roots=[0, 1, 3, 4, 5])
    with pytest.warns(UserWarning, match="left out 'lines', which hold lines or points"):
        scene = Scene.load(path, up="y")
    assert [item.name for item in scene] == ["strip", "fan", "below"]
    for name in ("strip", "fan"):
        mesh = trimesh.Trimesh(scene[name].vertices, scene[name].faces, process=False)
        assert mesh.face_normals.tolist() == [[0, 0, 1]] * 3
        assert mesh.area == pytest.approx(1.5)
    np.testing.assert_array_equal(scene["below"].vertices[:, 2], [9, 9, 9])


def test_shared_nodes_and_files_without_scenes(tmp_path):
    writer = GltfWriter()
    shared = writer.node(writer.primitive(TRIANGLE), name="shared")
    writer.node(name="left", translation=[-1, 0, 0], children=[shared])
    writer.node(name="right", translation=[1, 0, 0], children=[shared])
    writer.node(writer.primitive(TRIANGLE), name="other")
    path = write(tmp_path, writer, roots=[1, 2, 3])
    scene = load(path, up="y")
    assert [item.name for item in scene] == ["shared", "shared_1", "other"]
    assert [item.vertices[0, 0] for item in scene] == [-1, 1, 0]
    path.write_bytes(path.read_bytes().replace(b'"scenes"', b'"sceneX"'))  # without scenes, all nodes are loaded
    assert [part.name for part in wv.io.read_parts(path).parts] == ["shared", "shared_1", "other"]


def test_malformed_gltf_is_rejected(tmp_path):
    def changed(**content):
        writer = GltfWriter(**content)
        writer.node(writer.primitive(TRIANGLE, [0, 1, 2]), name="flat")
        return writer

    looped, far, short = changed(), changed(), changed()
    looped.content["nodes"][0]["children"] = [0]
    far.content["accessors"][0]["count"] = 10**12
    short.content["accessors"][1]["count"] = 2
    nothing = changed()
    del nothing.content["accessors"][0]["bufferView"]
    nothing.content["accessors"][0]["count"] = 10**12
    cases = {
        "node 0 is below itself": looped,
        "an accessor of 1000000000000 elements exceeds": far,
        "triangles must have three corners each, got 2": short,
        "accessor 0 has 1000000000000 elements and no data": nothing,
        "it is glTF 1.0, but only 2 is supported": changed(asset={"version": "1.0"}),
        "it ends after 400 bytes, in the middle of a chunk": changed().bytes()[:400],
    }
    for wanted, file in cases.items():
        assert f"cannot be read as GLB: {wanted}" in refusal(write(tmp_path, file))


@pytest.mark.parametrize(
    ("asset", "wanted"),
    [
        ("", [(1, 0, 0), (0, 0, 2), (0, -3, 0)]),
        ("<up_axis>Y_UP</up_axis>", [(1, 0, 0), (0, 0, 2), (0, -3, 0)]),
        ('<unit name="inch" meter="0.0254"/><up_axis>Z_UP</up_axis>', 0.0254 * np.diag([1, 2, 3])),
        ('<unit meter="0.001"/><up_axis>X_UP</up_axis>', 0.001 * np.array([(0, 0, 1), (-2, 0, 0), (0, -3, 0)])),
    ],
)
def test_collada_units_and_axes(tmp_path, asset, wanted):
    pytest.importorskip("collada")
    (tmp_path / "part.dae").write_text(dae(asset))
    found = load(tmp_path / "part.dae")["part"].vertices
    np.testing.assert_allclose(found, wanted, atol=1e-7)
    if "Z_UP" in asset:  # arguments override the file
        other = load(tmp_path / "part.dae", file_up="y", scale=10)["part"].vertices
        np.testing.assert_allclose(other, 0.254 * np.array([(1, 0, 0), (0, 0, 2), (0, -3, 0)]), atol=1e-7)


def test_collada_with_zero_unit_is_rejected(tmp_path):
    pytest.importorskip("collada")
    (tmp_path / "part.dae").write_text(dae('<unit meter="0"/>'))
    assert refusal(tmp_path / "part.dae").endswith("cannot be read as DAE: the unit must be above zero, got 0 m")


def test_missing_collada_reader_error_names_package(tmp_path, monkeypatch):
    from trimesh.exchange import load as readers

    (tmp_path / "part.dae").write_text(dae(""))
    wrapper = trimesh.exceptions.ExceptionWrapper(ImportError("collada"))
    monkeypatch.setitem(readers.mesh_loaders, "dae", wrapper)
    wanted = "reading .dae needs pycollada: pip install 'warpvis[collada]'"
    assert refusal(tmp_path / "part.dae") == f"{tmp_path / 'part.dae'}: {wanted}"


def tar(data, name):
    whole = io.BytesIO()
    with tarfile.open(fileobj=whole, mode="w:gz") as archive:
        info = tarfile.TarInfo(name)
        info.size = len(data)
        archive.addfile(info, io.BytesIO(data))
    return whole.getvalue()


def test_archives_are_read(tmp_path):
    """Parts without names take the name of their file; glTF is y-up in archives too."""
    stl = BALL.export(file_type="stl")
    for name, data in {
        "x.tar.gz": tar(stl, "in/ball.stl"),
        "x.tgz": tar(stl, "ball.stl"),
        "ball.stl.gz": gzip.compress(stl),
        "ball.stl.bz2": bz2.compress(stl),
    }.items():
        scene = load(write(tmp_path, data, name))
        assert [(item.name, len(item.faces)) for item in scene] == [("ball", len(BALL.faces))], name
    writer = GltfWriter()
    writer.node(writer.primitive(TRIANGLE))
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        archive.writestr("flat.glb", writer.bytes())
    upright = load(tmp_path / "x.zip")
    assert [item.name for item in upright] == ["flat"]
    np.testing.assert_allclose(upright["flat"].vertices, TRIANGLE[:, [0, 2, 1]], atol=1e-7)


def test_gltf_buffers_in_archives_are_read(tmp_path):
    files = trimesh.exchange.gltf.export_gltf(trimesh.Scene({"ball": BALL}))
    with zipfile.ZipFile(tmp_path / "x.zip", "w") as archive:
        for name, data in files.items():
            archive.writestr(f"in/{name}", data)
    assert [item.name for item in load(tmp_path / "x.zip")] == ["ball"]


def test_invalid_archives_are_rejected(tmp_path, monkeypatch):
    stl, writer = BALL.export(file_type="stl"), GltfWriter()
    writer.node(writer.primitive(TRIANGLE))

    def zipped(**files):
        with zipfile.ZipFile(tmp_path / "x.zip", "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in files.items():
                archive.writestr(name.replace("_", "."), data)
        return tmp_path / "x.zip"

    assert "x.zip: contains no mesh file; supported are " in refusal(zipped(read_me=b"x"))
    assert "x.zip/bad.glb: cannot be read as GLB: " in refusal(zipped(ball_stl=stl, bad_glb=b"junk"))
    assert "'a.stl' and 'b.glb' have different vertical axes" in refusal(zipped(a_stl=stl, b_glb=writer.bytes()))
    assert "x.tar.gz: cannot be unpacked: " in refusal(write(tmp_path, b"junk", "x.tar.gz"))
    monkeypatch.setattr("warpvis.core.numpy_files.MAX_UNPACKED", 10_000)
    for path in (
        zipped(bomb_stl=bytes(10**6)),
        write(tmp_path, tar(bytes(10**6), "bomb.stl"), "x.tar.gz"),
        write(tmp_path, gzip.compress(bytes(10**6)), "bomb.stl.gz"),
    ):
        assert refusal(path) == f"{path}: unpacks to more than 1 GiB, the maximum: unpack it first"


@pytest.mark.parametrize(
    ("unit", "meters"), [("", 0.001), (' unit="meter"', 1), (" unit='inch'", 0.0254), (' unit="micron"', 1e-6)]
)
def test_3mf_units_and_order(tmp_path, monkeypatch, unit, meters):
    names = ["zebra", "apple", "a &amp; b", "mid"]
    file = threemf(unit, names)
    try:
        import lxml  # noqa: F401
        import networkx  # noqa: F401
    except ImportError:  # stand-in for trimesh's result, whose order differs from the file's
        shape = trimesh.Trimesh(np.diag([1.0, 2, 3]), [[0, 1, 2]], process=False)
        back = {name.replace("&amp;", "&"): shape for name in reversed(names)}
        monkeypatch.setattr(trimesh, "load_scene", lambda *given, **options: trimesh.Scene(back))
        monkeypatch.setattr(trimesh, "available_formats", lambda: {"3mf"})
    scene = load(write(tmp_path, file, "x.3mf"))
    assert [item.name for item in scene] == ["zebra", "apple", "a & b", "mid"]
    np.testing.assert_allclose(scene["mid"].vertices, meters * np.diag([1, 2, 3]), rtol=1e-6)


def test_invalid_3mf_is_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr(trimesh, "available_formats", lambda: {"3mf"})
    wanted = "the unit must be one of micron, millimeter, centimeter, inch, foot, meter, got 'mile'"
    assert refusal(write(tmp_path, threemf(' unit="mile"', ["a"]), "x.3mf")).endswith(wanted)
    monkeypatch.setattr("warpvis.core.numpy_files.MAX_UNPACKED", 100)
    assert "x.3mf: unpacks to more than 1 GiB" in refusal(write(tmp_path, threemf("", ["a"]), "x.3mf"))
