"""Poses of SDF: relative_to, attached_to, placement frames, nested and merged models, and old versions."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.core.poses import poses_to_matrices
from warpvis.errors import FileFormatError

from support.sdf_files import BOX, BOX_LINK, load, model, model_folder, only, read, visual, world, write


def place(part):
    return poses_to_matrices(part.pose)


def test_pose_of_six_numbers_is_x_y_z_roll_pitch_yaw(tmp_path):
    found = read(tmp_path, model(f'<link name="l"><pose>1 2 3 0.1 0.2 0.3</pose>{visual(BOX)}</link>'))
    # Of libsdformat 12.3.
    expected = [1, 2, 3, 0.0342707985504821, 0.10602051106179562, 0.14357217502739192, 0.9833474432563559]
    assert np.allclose(only(found).pose, expected, atol=1e-12)


@pytest.mark.parametrize(
    "pose",
    [
        '<pose degrees="true">1 2 3 0 0 90</pose>',
        '<pose rotation_format="quat_xyzw">1 2 3 0 0 0.7071068 0.7071068</pose>',
        '<pose rotation_format="euler_rpy" degrees="1">1 2 3 0 0 90</pose>',
        "<pose>1 2 3 0 0 1.5707963267948966</pose>",
    ],
)
def test_rotation_formats(tmp_path, pose):
    found = read(tmp_path, model(f'<link name="l">{pose}{visual(BOX)}</link>'))
    assert np.allclose(place(only(found)), [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]], atol=1e-7)


FRAMES = f"""
<pose>10 0 0 0 0 1.5707963267948966</pose>
<link name="base"><pose>0 0 1 0 0 0</pose>{visual(BOX, "b")}</link>
<frame name="f" attached_to="base"><pose>0 1 0 0 0 1.5707963267948966</pose></frame>
<frame name="g"><pose relative_to="f">1 0 0 0 0 0</pose></frame>
<link name="arm"><pose relative_to="g">0 0 1 0 0 0</pose>
  {visual(BOX, "a", '<pose relative_to="base">0 0 5 0 0 0</pose>')}</link>
<joint name="j" type="revolute"><pose>0.5 0 0 0 0 0</pose><parent>base</parent><child>arm</child>
  <axis><xyz>0 0 1</xyz></axis></joint>
<link name="tip"><pose relative_to="j">0 0 1 0 0 0</pose>{visual(BOX, "t")}</link>
<model name="hand"><pose relative_to="tip">1 0 0 0 0 0</pose>
  <link name="palm"><pose>0 0 1 0 0 0</pose>{visual(BOX, "p")}</link></model>
<link name="end"><pose relative_to="hand::palm">0 2 0 0 0 0</pose>{visual(BOX, "e")}</link>
"""


def test_relative_poses_equal_those_of_libsdformat(tmp_path):
    found = read(tmp_path, world(f'<model name="r">{FRAMES}</model>'))
    places = {part.name: place(part)[:3, 3] for part in found.parts}
    # Computed by libsdformat 12.3.
    expected = {
        "r::base::b": (10, 0, 1),
        "r::arm::a": (10, 0, 6),
        "r::tip::t": (7.5, 0, 3),
        "r::end::e": (6.5, -2, 4),
        "r::hand::palm::p": (6.5, 0, 4),
    }
    assert places.keys() == expected.keys()
    for name, position in expected.items():
        assert np.allclose(places[name], position, atol=1e-9), name


def test_placement_frame(tmp_path):
    body = f'<pose>5 0 0 0 0 0</pose><frame name="top"><pose>0 0 2 0 0 0</pose></frame>{BOX_LINK}'
    found = read(tmp_path, model(body, more='placement_frame="top"'))
    assert np.allclose(only(found).pose[:3], (5, 0, -2))


def test_world_frames_and_poses_relative_to_models(tmp_path):
    body = f"""
    <frame name="corner"><pose>1 1 0 0 0 0</pose></frame>
    <model name="a"><pose relative_to="corner">1 0 0 0 0 0</pose>{BOX_LINK}</model>
    <model name="b"><pose relative_to="a::l">0 0 1 0 0 0</pose>{BOX_LINK}</model>"""
    found = read(tmp_path, world(body))
    assert [part.pose[:3].tolist() for part in found.parts] == [[2, 1, 0], [2, 1, 1]]


def test_old_pose_frame_and_origin(tmp_path):
    old = model(f'<link name="l"><pose frame="">1 0 0 0 0 0</pose>{visual(BOX)}</link>', version="1.6")
    assert only(read(tmp_path, old)).pose[0] == 1
    named = '<link name="k"><pose>1 0 0 0 0 0</pose></link>'
    named += f'<link name="l"><pose frame="k">1 0 0 0 0 0</pose>{visual(BOX)}</link>'
    assert only(read(tmp_path, model(named, version="1.6"))).pose[0] == 2
    first = '<gazebo version="1.0"><model name="m"><link name="l"><origin pose="3 0 0 0 0 0"/>'
    first += '<visual name="v"><geometry><box size="1 1 1"/></geometry></visual></link></model></gazebo>'
    assert only(read(tmp_path, first)).pose[0] == 3


def test_saved_state_of_gazebo_classic(tmp_path):
    state = '<state world_name="w"><model name="m"><pose>1 0 0 0 0 0</pose>'
    state += '<link name="l"><pose>4 0 0 0 0 0</pose></link></model></state>'
    found = read(tmp_path, world(f'<model name="m">{BOX_LINK}</model>{state}', version="1.6"))
    assert only(found).pose[0] == 4


def test_include_overrides_name_pose_and_static(tmp_path):
    model_folder(tmp_path, "table", model(f"<pose>0 0 9 0 0 0</pose>{BOX_LINK}", "table"))
    include = "<include><uri>model://table</uri>{}</include>"
    changed = include.format("<name>desk</name><pose>1 0 0 0 0 0</pose><static>true</static>")
    found = read(tmp_path, world(include.format("") + changed))
    assert [(part.name, part.pose[:3].tolist(), part.movable) for part in found.parts] == [
        ("table::l::v", [0, 0, 9], True),
        ("desk::l::v", [1, 0, 0], False),
    ]
    first, second = found.parts
    assert first.mesh[0] is second.mesh[0] or np.array_equal(first.mesh[0], second.mesh[0])


def test_merged_include(tmp_path):
    arm = (
        f'<frame name="f"><pose>0 0 1 0 0 0</pose></frame><link name="arm"><pose relative_to="f"/>{visual(BOX)}</link>'
    )
    model_folder(tmp_path, "arm", model(arm, "arm"))
    body = f"""<include merge="true"><uri>model://arm</uri><pose>1 0 0 0 0 0</pose></include>
    <link name="l"><pose relative_to="arm">0 0 1 0 0 0</pose>{visual(BOX)}</link>"""
    found = read(tmp_path, model(body))
    assert {part.name: part.pose[:3].tolist() for part in found.parts} == {
        "m::l::v": [1, 0, 2],
        "m::arm::v": [1, 0, 1],
    }


def test_newest_sdf_of_a_model_config(tmp_path):
    config = '<model><name>t</name><sdf version="1.4">old.sdf</sdf><sdf version="1.10">model.sdf</sdf></model>'
    path = model_folder(tmp_path, "t", model(BOX_LINK, "new"), config=config)
    write(tmp_path / "t", model(BOX_LINK, "old", version="1.4"), "old.sdf")
    for file in (path, path.parent):
        assert [item.name for item in wv.Scene.load(file)] == ["new::l::v"]


@pytest.mark.parametrize(
    "variable", ["GZ_SIM_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH", "IGN_GAZEBO_RESOURCE_PATH"]
)
def test_environment_variables(tmp_path, monkeypatch, variable):
    model_folder(tmp_path / "far", "table", model(BOX_LINK, "table"))
    monkeypatch.setenv(variable, f"/nowhere:{tmp_path / 'far'}")
    found = read(tmp_path / "near", world("<include><uri>model://table</uri></include>"))
    assert only(found).name == "table::l::v"


def test_search_path(tmp_path):
    model_folder(tmp_path / "far", "table", model(BOX_LINK, "table"))
    text = world("<include><uri>model://table</uri></include>")
    for folder in (tmp_path / "far", tmp_path / "far" / "table"):
        assert only(read(tmp_path / "near", text, search_path=folder)).name == "table::l::v"


def test_fuel_cache(tmp_path, monkeypatch):
    cache = tmp_path / "cache" / "fuel.gazebosim.org" / "openrobotics" / "models" / "coffee mug"
    for version in (2, 10):
        model_folder(cache, str(version), model(BOX_LINK, f"mug{version}"))
    monkeypatch.setenv("GZ_FUEL_CACHE_PATH", str(tmp_path / "cache"))
    uri = "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Coffee Mug"
    found = read(tmp_path / "here", world(f"<include><uri>{uri}</uri></include>"))
    assert only(found).name == "mug10::l::v"
    found = read(tmp_path / "here", world(f"<include><uri>{uri}/2</uri></include>"))
    assert only(found).name == "mug2::l::v"


def test_missing_includes_are_one_warning_or_an_error(tmp_path):
    text = world(f'<model name="m">{BOX_LINK}</model>' + "<include><uri>model://gone</uri></include>" * 2)
    path = write(tmp_path, text)
    with pytest.warns(UserWarning, match=r"skipped model://gone .*search_path"):
        assert len(wv.Scene.load(path)) == 1
    with pytest.raises(FileFormatError, match="model://gone"):
        wv.Scene.load(path, strict=True)


def test_urdf_in_an_include(tmp_path):
    shape = '<visual><origin xyz="0 0 1"/><geometry><box size="1 1 1"/></geometry></visual>'
    urdf = f'<robot name="r"><link name="l">{shape}</link></robot>'
    write(tmp_path, urdf, "robot.urdf")
    text = world("<include><uri>robot.urdf</uri><name>one</name><pose>2 0 0 0 0 0</pose></include>")
    item = load(tmp_path, text)["one::l"]
    assert np.allclose(item.vertices.mean(axis=0), (2, 0, 1))


def test_include_outside_of_worlds(tmp_path):
    model_folder(tmp_path, "table", model(BOX_LINK, "table"))
    text = '<sdf version="1.9"><include><uri>model://table</uri><pose>1 0 0 0 0 0</pose></include></sdf>'
    part = only(read(tmp_path, text))
    assert part.name == "table::l::v" and part.pose[0] == 1


def test_unreadable_includes_are_skipped(tmp_path):
    write(tmp_path, "<sdf", "broken/model.sdf")
    path = write(tmp_path, world(f'<model name="m">{BOX_LINK}</model><include><uri>model://broken</uri></include>'))
    with pytest.warns(UserWarning, match="model://broken .*cannot be read as XML"):
        assert len(wv.Scene.load(path)) == 1


def test_names_of_repeated_models_are_unique(tmp_path):
    found = read(tmp_path, world(f'<model name="m">{BOX_LINK}</model>' * 3, version="1.6"))
    assert [part.name for part in found.parts] == ["m::l::v", "m_1::l::v", "m_2::l::v"]
