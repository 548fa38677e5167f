"""Invalid SDF files end with one sentence: the file, the line, and what is expected."""

import pytest

import warpvis as wv
from warpvis.errors import FileFormatError, WarpvisError

from support.sdf_files import BOX, BOX_LINK, model, model_folder, visual, world, write

LINK = f'<link name="l">{visual(BOX)}</link>'


def shape(text):
    return model(f'<link name="l">{visual(text)}</link>')


BAD = {
    "no XML": ("hello", r"file\.sdf:1: cannot be read as XML"),
    "unclosed": ('<sdf version="1.9">\n<model name="m">', r"file\.sdf:2: cannot be read as XML"),
    "empty": ("", r"cannot be read as XML: no element found"),
    "another root": ("<robot/>", r"must be SDF, which begins with <sdf>, got XML of <robot>"),
    "version": ('<sdf version="two"/>', "must have a version such as 1.9, got 'two'"),
    "version 2": ('<sdf version="2.0"/>', "must have a version from 1.0"),
    "no content": ('<sdf version="1.9"/>', "must have a <world>, a <model>"),
    "no geometry": ('<sdf version="1.9"><model name="m"><link name="l"/></model></sdf>', "holds no triangles"),
    "no name": (model("<link/>"), r"<link> must have a name"),
    "no model name": ('<sdf version="1.9"><model/></sdf>', "<model> must have a name"),
    "visual without geometry": (model('<link name="l"><visual name="v"/></link>'), "<visual> .* has no <geometry>"),
    "pose of five": (model(f"<pose>1 2 3 4 5</pose>{LINK}"), "<pose> must be 6 finite numbers, got '1 2 3 4 5'"),
    "pose of words": (model(f"<pose>a b c d e f</pose>{LINK}"), "must be 6 finite numbers"),
    "pose not finite": (model(f"<pose>nan 0 0 0 0 0</pose>{LINK}"), "must be 6 finite numbers"),
    "far away": (model(f"<pose>1e19 0 0 0 0 0</pose>{LINK}"), "must be within 1e18 m"),
    "rotation format": (model(f'<pose rotation_format="axis">0 0 0 0 0 0</pose>{LINK}'), "rotation_format euler_rpy"),
    "zero quaternion": (model(f'<pose rotation_format="quat_xyzw">0 0 0 0 0 0 0</pose>{LINK}'), "other than 0"),
    "degrees": (model(f'<pose degrees="maybe">0 0 0 0 0 0</pose>{LINK}'), "degrees true or false"),
    "unknown frame": (
        model(f'<link name="l"><pose relative_to="nowhere"/>{visual(BOX)}</link>'),
        "must refer to a frame of the model 'm', got 'nowhere'",
    ),
    "unknown attached_to": (
        model(
            f'{LINK}<frame name="f" attached_to="x"/><frame name="g"><pose relative_to="f"/></frame>'
            f'<link name="k"><pose relative_to="g"/>{visual(BOX)}</link>'
        ),
        "got 'x'",
    ),
    "circle of frames": (
        model(
            '<frame name="a"><pose relative_to="b"/></frame><frame name="b"><pose relative_to="a"/></frame>'
            f'<link name="l"><pose relative_to="a"/>{visual(BOX)}</link>'
        ),
        "must not have frames that depend on themselves, got .*a -> b -> a",
    ),
    "placement frame": (model(LINK, more='placement_frame="top"'), "got 'top'"),
    "negative size": (shape("<box><size>1 -1 1</size></box>"), "<size> must be greater than 0, got -1"),
    "two numbers": (shape("<box><size>1 1</size></box>"), "<size> must be 3 finite numbers"),
    "radius 0": (shape("<sphere><radius>0</radius></sphere>"), "<radius> must be greater than 0"),
    "normal 0": (shape("<plane><normal>0 0 0</normal></plane>"), "must have a normal other than 0"),
    "mesh without uri": (shape("<mesh/>"), "<mesh> must have a <uri>"),
    "mesh of scale 0": (shape("<mesh><uri>file.sdf</uri><scale>0 1 1</scale></mesh>"), "scale other than 0"),
    "short polyline": (shape("<polyline><point>0 0</point></polyline>"), "at least 3 points, got 1"),
    "static": (model(f"<static>perhaps</static>{LINK}"), "<static> must be true or false, got 'perhaps'"),
    "include without uri": (world("<include/>"), "<include> must have a <uri>"),
    "joint type": (
        model(f'{LINK}<joint name="j" type="rubber"><parent>l</parent><child>world</child></joint>'),
        "rubber",
    ),
    "joint without child": (
        model(f'{LINK}<joint name="j" type="fixed"><parent>l</parent></joint>'),
        "must have a <child>",
    ),
    "axis 0": (
        model(
            f'{LINK}<link name="k"/><joint name="j" type="revolute"><parent>l</parent><child>k</child>'
            "<axis><xyz>0 0 0</xyz></axis></joint>"
        ),
        "must be an axis other than 0",
    ),
    "light type": (
        world(f'<light name="x" type="candle"/><model name="m">{LINK}</model>'),
        "point, spot or directional",
    ),
    "light direction": (
        world(f'<light name="x" type="spot"><direction>0 0 0</direction></light><model name="m">{LINK}</model>'),
        "direction other than 0",
    ),
    "color": (
        model(f'<link name="l">{visual(BOX, more="<material><diffuse>red</diffuse></material>")}</link>'),
        "<diffuse> must be 4 finite numbers, got 'red'",
    ),
    "ERB": ('<sdf version="1.9"><% x = 1 %></sdf>', "is an ERB template; convert it to SDF first: erb file.sdf"),
    "Jinja": ('<sdf version="1.9">{% set x = 1 %}</sdf>', "is a Jinja template"),
    "xacro": ('<sdf version="1.9"><xacro:property name="x" value="1"/></sdf>', "is a xacro file; convert it"),
    "too deep": ("<a>" * 300 + "</a>" * 300, "nested at most 200 deep"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_files(tmp_path, name):
    text, message = BAD[name]
    path = write(tmp_path, text)
    with pytest.raises(WarpvisError, match=message) as caught:
        wv.Scene.load(path)
    assert str(caught.value).startswith(str(path)) and "\n" not in str(caught.value)


def test_include_of_itself(tmp_path):
    path = write(tmp_path, model(f"{LINK}<include><uri>file.sdf</uri></include>"))
    with pytest.raises(FileFormatError, match="<include> must not include itself"):
        wv.Scene.load(path)


def test_include_that_multiplies(tmp_path, monkeypatch):
    """Ten levels of ten includes each would be ten billion models."""
    monkeypatch.setattr("warpvis.io.sdf._load._MAX_MODELS", 500)
    write(tmp_path, model(LINK), "0.sdf")
    for level in range(10):
        includes = "".join(f"<include><uri>{level}.sdf</uri><name>n{n}</name></include>" for n in range(10))
        write(tmp_path, model(includes), f"{level + 1}.sdf")
    with pytest.raises(FileFormatError, match="too many"):
        wv.Scene.load(tmp_path / "10.sdf")


def test_bad_model_config(tmp_path):
    path = model_folder(tmp_path, "t", model(BOX_LINK), config="<model><sdf>other.sdf</sdf></model>")
    with pytest.raises(FileFormatError, match=r"must name an SDF file in its folder, got other\.sdf"):
        wv.Scene.load(path)
    path.write_text("<package/>")
    with pytest.raises(FileFormatError, match="must begin with <model>, got XML of <package>"):
        wv.Scene.load(path)


def test_world_in_an_include(tmp_path):
    write(tmp_path, world(f'<model name="m">{LINK}</model>'), "inner.sdf")
    path = write(tmp_path, world("<include><uri>inner.sdf</uri></include>"))
    with pytest.raises(FileFormatError, match="must have merge true to include the world"):
        wv.Scene.load(path)
    path.write_text(world('<include merge="true"><uri>inner.sdf</uri></include>'))
    assert [item.name for item in wv.Scene.load(path)] == ["m::l::v"]


def test_xml_that_gazebo_accepts(tmp_path):
    """Gazebo's own worlds have them."""
    path = write(tmp_path, "<!-- gz sim --help\n -->" + model(f"<!-- a -- b -->{LINK}"))
    assert len(wv.Scene.load(path)) == 1
    path.write_text('<!-- license -->\n<?xml version="1.0"?>' + model(f"{LINK}<author>A & B</author>"))
    assert len(wv.Scene.load(path)) == 1
    path.write_text("<!-- a -- b -->\n" + model("<pose>1</pose>" + LINK))
    with pytest.raises(FileFormatError, match=r"file\.sdf:2: <pose>"):
        wv.Scene.load(path)


def test_git_lfs_pointer(tmp_path):
    path = write(tmp_path, "version https://git-lfs.github.com/spec/v1\noid sha256:0\n")
    with pytest.raises(FileFormatError, match="git-lfs pointer"):
        wv.Scene.load(path)
