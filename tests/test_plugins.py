# SPDX-FileCopyrightText: Copyright (c) 2026 The warpvis authors
# SPDX-License-Identifier: Apache-2.0
"""Outputs, mesh and dataset formats of other distributions, and the examples of docs/extending.md."""

import copy
import dataclasses
import pickle
import re
import sys
from pathlib import Path

import docs_preludes as preludes
import numpy as np
import pytest
import reference_ray_table

import warpvis as wv
from warpvis.core import outputs as outputs_table
from warpvis.core.outputs import OUTPUTS
from warpvis.rendering import _computed

from compare import wrong_depth

PAGE = (Path(__file__).parent.parent / "docs" / "extending.md").read_text()
CORNERS = "0 0 0\n1 0 0\n0 1 0\n"


@pytest.fixture
def examples(tmp_path, monkeypatch):
    """Return the names that the page's examples define; install the formats among them as a distribution."""
    code = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names = preludes.prepare("extending", tmp_path)
    (tmp_path / "my_formats.py").write_text("import numpy as np\n" + "\n".join(code[4:]))
    (tmp_path / "my_outputs.py").write_text("import numpy as np, warp as wp\n" + code[3].split("views =")[0])
    (tmp_path / "my_sensors.py").write_text(
        "from dataclasses import dataclass\nimport numpy as np, warpvis as wv\n" + code[2].split("views =")[0]
    )
    info = tmp_path / "my_formats-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: my-formats\nVersion: 1.0\n")
    text = "\n".join(re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL))
    text = text.replace("project.entry-points.", "").replace('"', "")
    broken = "[warpvis.mesh_readers]\ngone = my_formats:gone\nmissing = not_installed:read\nwrong = my_formats:Raw\n"
    merged = text.replace("[warpvis.mesh_readers]\n", broken)
    (info / "entry_points.txt").write_text(re.sub(r"^#.*\n", "", merged, flags=re.MULTILINE))
    monkeypatch.syspath_prepend(tmp_path)
    for block in code[:2]:
        exec(compile(block, "docs/extending.md", "exec"), names)
    yield names
    for name in ("my_formats", "my_sensors", "my_outputs"):
        sys.modules.pop(name, None)
    for table in (OUTPUTS, _computed._COMPUTED):
        table.pop("slope", None)


def test_example_cameras_match_the_reference(examples):
    scene, pose = examples["scene"], examples["pose"]
    scanner = examples["LineScanner"](64, 2.0)
    for camera in (scanner, examples["camera"]):
        depth = wv.render(scene, camera, pose, outputs=("depth",)).depth.numpy()[0]
        options = {"near": camera.near, "far": camera.far}
        expected = reference_ray_table.cast_ray_table(scene, camera.rays, pose[0], **options).depth
        assert wrong_depth(depth, expected).mean() < 1e-3 and np.isfinite(depth).mean() > 0.2
    lens = examples["camera"].lens
    rays = lens.directions(160, 120).reshape(-1, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1, atol=1e-12)
    centers = np.stack(np.meshgrid(np.arange(160) + 0.5, np.arange(120) + 0.5), axis=-1).reshape(-1, 2)
    np.testing.assert_allclose(lens.project(rays), centers, atol=1e-9)


def test_example_sensor_rounds_depth(examples, tmp_path):
    import my_sensors

    scene, pose = examples["scene"], examples["pose"]
    exact = wv.render(scene, wv.Camera.kinect(), pose).depth.numpy()
    found = wv.render(scene, wv.Camera.kinect(), pose, sensor=my_sensors.Quantized(0.05)).depth.numpy()
    both = np.isfinite(found) & np.isfinite(exact)
    assert both.mean() > 0.4
    np.testing.assert_allclose(found[both] / 0.05, np.round(found[both] / 0.05), atol=1e-4)
    assert np.abs(found[both] - exact[both]).max() < 0.0251


@pytest.mark.parametrize("caster", ["packets", "rays"])
def test_example_output_is_found_by_its_name(examples, caster):
    """Nothing imports its module, other images are not changed, and the sensor's depth is not used."""
    scene, pose, camera = examples["scene"], examples["pose"], wv.Camera.kinect()
    assert "slope" not in OUTPUTS
    plain = wv.render(scene, camera, pose, outputs=("depth", "normals"), caster=caster)
    x, y, z = np.moveaxis(plain.normals.numpy().astype(np.float64), -1, 0)
    slope = np.arctan2(np.hypot(x, y), np.abs(z))
    for outputs in (("slope",), ("slope", "depth"), ("normals", "slope", "depth")):
        for sensor in (None, wv.sensors.NguyenNoise()):
            views = wv.render(scene, camera, pose, outputs=outputs, caster=caster, sensor=sensor, seed=1)
            found = views.slope.numpy()
            near = np.isfinite(plain.depth.numpy())
            np.testing.assert_allclose(found[near], slope[near], atol=1e-5)
            assert sensor is not None or np.isnan(found[~near]).all()
            if "depth" in outputs and sensor is None:
                np.testing.assert_array_equal(views.depth.numpy(), plain.depth.numpy())
    for points in (np.full((1, 5, 2), 80.5), np.full((1, 4, 6, 2), 80.5)):
        at = wv.Renderer(scene, camera, outputs=("slope",), caster=caster).render_at(pose, points)
        assert at.slope.shape == points.shape[:-1]
    copied = copy.deepcopy(views), pickle.loads(pickle.dumps(views))
    for other in copied:
        np.testing.assert_array_equal(other.slope.numpy(), views.slope.numpy())


@pytest.mark.parametrize("kind", ["npz", "zarr"])
def test_example_output_survives_a_dataset(examples, tmp_path, kind):
    pytest.importorskip("zarr" if kind == "zarr" else "numpy")
    scene, pose, camera = examples["scene"], examples["pose"], wv.Camera.kinect()
    frames = wv.Frames(np.repeat(pose, 3, axis=0), np.arange(3.0))
    wv.render_batch(scene, camera, frames, tmp_path / "out", format=kind, outputs=("depth", "slope"))
    dataset = wv.open_dataset(tmp_path / "out")
    assert dataset.outputs == ("depth", "slope")
    expected = wv.render(scene, camera, pose, outputs=("slope",)).slope.numpy()[0]
    for number in range(3):
        np.testing.assert_array_equal(dataset[number]["slope"], expected)


def test_motion_with_a_registered_output_is_refused(examples):
    camera = wv.sensors.RollingShutter(wv.Camera.kinect(), 0.03)
    motion = wv.sensors.Motion(np.repeat(examples["pose"], 2, axis=0)[:, None], [0.0, 0.03])
    with pytest.raises(wv.errors.CameraError, match="outputs must not contain slope for a Motion"):
        wv.render(examples["scene"], camera, motion, outputs=("depth", "slope"))


def test_dataset_of_an_unknown_output_is_refused(examples, tmp_path, monkeypatch):
    wv.render_batch(
        examples["scene"],
        wv.Camera.kinect(),
        wv.Frames(examples["pose"], np.zeros(1)),
        tmp_path / "out",
        outputs=("slope",),
    )
    del OUTPUTS["slope"]
    monkeypatch.setattr(outputs_table, "load_plugin", lambda *_: None)
    with pytest.raises(wv.errors.FileFormatError, match=r"output slope is unknown\. Import the module"):
        wv.open_dataset(tmp_path / "out")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"name": "depth"}, "must be a new Python identifier, got 'depth'"),
        ({"name": "a b"}, "must be a new Python identifier, got 'a b'"),
        ({"stage": "cast"}, 'must have stage="compute"'),
        ({"dtype": "float64"}, "must have stage=.* got stage='compute', float64"),
        ({"components": "xy"}, "components 'xy'"),
        ({"needs": ()}, "needs of level must be some of depth, .* got none"),
        ({"needs": ("depth", "color")}, "needs of level must be some of depth, .* got color"),
    ],
)
def test_bad_outputs_are_refused(changes, message):
    spec = wv.rendering.OutputSpec("level", "float32", "compute", needs=("depth",))
    with pytest.raises(wv.errors.ArrayError, match=message):
        wv.rendering.register_output(dataclasses.replace(spec, **changes), lambda frame, out: None)
    assert "level" not in OUTPUTS


def test_mesh_files_are_read_by_a_plugin(examples, tmp_path):
    (tmp_path / "wall.tri").write_text(CORNERS)
    scene = wv.Scene.load(tmp_path / "wall.tri", scale=2.0)
    assert [item.name for item in scene] == ["wall"]
    np.testing.assert_array_equal(scene["wall"].vertices, [[0, 0, 0], [2, 0, 0], [0, 2, 0]])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("a.gone", "my_formats:gone, 'gone' of warpvis.mesh_readers, cannot be imported: AttributeError"),
        ("a.missing", "cannot be imported: ModuleNotFoundError"),
        ("bad.tri", "bad.tri: cannot be read: "),
        ("a.wrong", "a.wrong: cannot be read: "),
        ("a.none", "'.none' is not a scene format; supported are .*, tri,"),
    ],
)
def test_faults_of_plugins_are_one_sentence(examples, tmp_path, name, message):
    (tmp_path / name).write_text("no numbers")
    with pytest.raises(wv.errors.FileFormatError, match=message):
        wv.Scene.load(tmp_path / name)


def test_datasets_are_written_by_a_plugin(examples, tmp_path):
    camera = wv.Camera.from_fov(16, 12, hfov=1.0)
    poses = np.repeat(examples["pose"], 3, axis=0)
    wv.render_batch(examples["scene"], camera, poses, tmp_path / "out", format="raw", shard_frames=2)
    expected = wv.render(examples["scene"], camera, poses).depth.numpy()
    for frame, file in enumerate(("000000/000000.raw", "000000/000001.raw", "000001/000000.raw")):
        depth = np.fromfile(tmp_path / "out" / "depth" / file, np.float32).reshape(12, 16)
        np.testing.assert_array_equal(depth, expected[frame])
    assert wv.batch.verify(tmp_path / "out").ok
    with pytest.raises(wv.errors.FileFormatError, match=r"format must be one of npz, .*, raw, got 'rows'"):
        wv.render_batch(examples["scene"], camera, poses, tmp_path / "none", format="rows")
