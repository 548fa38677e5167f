"""Materials, lights, labels and joints of SDF files."""

import numpy as np
import pytest

import warpvis as wv
from warpvis.errors import PoseError

from support.sdf_files import BOX, BOX_LINK, image, load, model, only, read, visual, world, write


def material(folder, content, shape=BOX, more=""):
    text = model(f'<link name="l">{visual(shape, more=f"<material>{content}</material>{more}")}</link>')
    return only(read(folder, text)).appearance.get().materials[0]


def test_colors(tmp_path):
    colors = "<ambient>1 0 0 1</ambient><diffuse>0 1 0 0.5</diffuse><specular>0 0 1 1</specular>"
    found = material(tmp_path, f"{colors}<shininess>20</shininess><emissive>0.5 0 0 1</emissive>")
    assert (found.base_color, found.alpha_mode, found.shininess) == ((0, 1, 0, 0.5), "blend", 20)
    assert (found.specular, found.emission, found.shading) == ((0, 0, 1), (0.5, 0, 0), "phong")
    assert material(tmp_path, "<ambient>1 0 0 1</ambient>").base_color == (1, 0, 0, 1)
    assert material(tmp_path, "<diffuse>0.1 0.2 0.3</diffuse>").base_color == (0.1, 0.2, 0.3, 1)
    flat = material(tmp_path, "<lighting>0</lighting><double_sided>true</double_sided>")
    assert flat.shading == "unlit" and flat.double_sided


def test_shapes_without_a_material_are_gray(tmp_path):
    part = only(read(tmp_path, model(BOX_LINK)))
    assert part.appearance.get().materials[0].base_color == (0.7, 0.7, 0.7, 1)


@pytest.mark.parametrize(
    ("name", "color"),
    [
        ("Gazebo/Red", (1, 0, 0, 1)),
        ("Gazebo/DarkGrey", (0.175, 0.175, 0.175, 1)),
        ("Gazebo/Orange", (1, 0.5088, 0.0468, 1)),
        ("Gazebo/GreyTransparent", (0.5, 0.5, 0.5, 0.5)),
    ],
)
def test_names_of_gazebo_classic(tmp_path, name, color):
    uri = "<uri>file://media/materials/scripts/gazebo.material</uri>"
    assert material(tmp_path, f"<script>{uri}<name>{name}</name></script>").base_color == color


def test_glowing_material(tmp_path):
    assert material(tmp_path, "<script><name>Gazebo/GreenGlow</name></script>").emission == (0, 1, 0)


SCRIPT = """
// a comment
material Base { technique { pass { ambient 0.1 0.1 0.1 diffuse 0.2 0.4 0.6 1.0 } } }
material Sign/Stop : Base
{
  technique
  {
    pass
    {
      emissive 0.1 0 0
      texture_unit { texture stop.png }
    }
  }
}
"""


def test_ogre_script(tmp_path):
    write(tmp_path, SCRIPT, "sign/materials/scripts/sign.material")
    image(tmp_path / "sign" / "materials" / "textures" / "stop.png", np.full((2, 2, 3), 9))
    uris = "<uri>model://sign/materials/scripts</uri><uri>model://sign/materials/textures</uri>"
    found = material(tmp_path, f"<script>{uris}<name>Sign/Stop</name></script>")
    assert found.base_color == (0.2, 0.4, 0.6, 1) and found.emission == (0.1, 0, 0)
    assert (found.texture.image == 9).all()


def test_unknown_materials_are_one_warning(tmp_path):
    text = model(
        f'<link name="l">{visual(BOX, more="<material><script><name>No/Such</name></script></material>")}</link>'
    )
    path = write(tmp_path, text)
    with pytest.warns(UserWarning, match="materials or images were not found: No/Such"):
        scene = wv.Scene.load(path)
    assert scene["m::l::v"].appearance.materials[0].base_color == (0.7, 0.7, 0.7, 1)


def test_pbr_metal(tmp_path):
    for name, value in (("a", 50), ("r", 100), ("m", 200), ("n", 128), ("e", 10), ("o", 60)):
        image(tmp_path / f"{name}.png", np.full((2, 2, 3), value))
    maps = "<albedo_map>a.png</albedo_map><roughness_map>r.png</roughness_map><metalness_map>m.png</metalness_map>"
    maps += "<normal_map>n.png</normal_map><emissive_map>e.png</emissive_map>"
    maps += "<ambient_occlusion_map>o.png</ambient_occlusion_map>"
    found = material(tmp_path, f"<pbr><metal>{maps}</metal></pbr>")
    assert found.shading == "pbr" and found.base_color == (1, 1, 1, 1) and found.emission == (1, 1, 1)
    assert found.metallic_roughness_texture.image[0, 0].tolist() == [255, 100, 200]
    textures = (found.texture, found.normal_texture, found.emissive_texture, found.occlusion_texture)
    assert [texture.image[0, 0, 0] for texture in textures] == [50, 128, 10, 60]
    plain = material(tmp_path, "<diffuse>1 0 0</diffuse><pbr><metal><roughness>0.3</roughness></metal></pbr>")
    assert (plain.roughness, plain.metallic, plain.base_color) == (0.3, 0.5, (1, 0, 0, 1))
    gloss = material(tmp_path, "<pbr><specular><glossiness>0.9</glossiness></specular></pbr>")
    assert np.isclose(gloss.roughness, 0.1) and gloss.metallic == 0


def test_texture_of_a_box_is_on_each_side(tmp_path):
    image(tmp_path / "a.png", [[(255, 0, 0), (0, 255, 0)], [(0, 0, 255), (255, 255, 255)]])
    more = "<material><pbr><metal><albedo_map>a.png</albedo_map><metalness>0</metalness></metal></pbr></material>"
    scene = load(tmp_path, model(f'<link name="l">{visual("<box><size>2 2 2</size></box>", more=more)}</link>'))
    camera = wv.Camera.from_fov(2, 2, hfov=0.4)
    seen = wv.render(scene, camera, wv.look_at((5, 0, 0), (0, 0, 0)), outputs=["albedo"]).albedo.numpy()[0]
    assert (seen[..., :3].argmax(axis=-1)[0] == (0, 1)).all() and seen[1, 0, :3].argmax() == 2


def test_transparency_and_metadata_of_visuals(tmp_path):
    more = "<transparency>0.75</transparency><cast_shadows>false</cast_shadows><visibility_flags>2</visibility_flags>"
    part = only(read(tmp_path, model(f'<link name="l">{visual(BOX, more=more)}</link>')))
    found = part.appearance.get().materials[0]
    assert found.base_color[3] == 0.25 and found.alpha_mode == "blend"
    assert part.extras == {"cast_shadows": False, "visibility_flags": "2"}


def lights(folder, body):
    return {light.name: light for light in load(folder, world(f'{body}<model name="m">{BOX_LINK}</model>')).lights}


def test_lights(tmp_path):
    sun = '<light name="sun" type="directional"><pose>0 0 9 0 0 1.5707963267948966</pose><direction>1 0 -1</direction>'
    sun += "<diffuse>1 0.5 0 1</diffuse><intensity>2</intensity><cast_shadows>true</cast_shadows></light>"
    lamp = '<light name="lamp" type="point"><pose>1 2 3 0 0 0</pose><attenuation><range>7</range><linear>0</linear>'
    lamp += "<constant>0.5</constant><quadratic>0.1</quadratic></attenuation></light>"
    spot = '<light name="spot" type="spot"><spot><inner_angle>0.2</inner_angle><outer_angle>0.8</outer_angle>'
    spot += "<falloff>1</falloff></spot></light>"
    off = '<light name="off" type="point"><light_on>false</light_on></light>'
    found = lights(tmp_path, sun + lamp + spot + off)
    assert list(found) == ["ambient", "sun", "lamp", "spot"]
    assert np.allclose(found["sun"].direction, (0, 0.5**0.5, -(0.5**0.5))) and found["sun"].color == (1, 0.5, 0)
    assert found["sun"].cast_shadow and found["sun"].intensity == 2 and not found["lamp"].cast_shadow
    assert found["lamp"].attenuation == (0.5, 0, 0.1) and found["lamp"].reach == 7
    assert found["lamp"].position == (1, 2, 3)
    assert (found["spot"].inner_angle, found["spot"].outer_angle, found["spot"].falloff) == (0.1, 0.4, "webots")


def test_light_of_a_link(tmp_path):
    light = '<light name="led" type="point"><pose>1 0 0 0 0 0</pose></light>'
    text = world(f'<model name="m"><pose>0 0 2 0 0 0</pose><link name="l">{visual(BOX)}{light}</link></model>')
    (_, found) = load(tmp_path, text).lights
    assert (found.name, found.position) == ("m::l::led", (1, 0, 2))


def test_without_lights_there_is_a_headlight(tmp_path):
    assert [light.kind for light in load(tmp_path, world(f'<model name="m">{BOX_LINK}</model>')).lights] == [
        "headlight"
    ]


def test_ambient_light_and_background(tmp_path):
    sun = '<light name="sun" type="directional"/>'
    scene = load(tmp_path, world(f'{sun}<model name="m">{BOX_LINK}</model>'))
    assert np.allclose(scene.lights[0].ambient, 0.4 / np.pi) and scene.background.color == (0.7, 0.7, 0.7)
    colors = "<scene><ambient>0.1 0.2 0.3 1</ambient><background>0 0 1 1</background></scene>"
    scene = load(tmp_path, world(f'{colors}{sun}<model name="m">{BOX_LINK}</model>'))
    assert np.allclose(scene.lights[0].ambient, np.array((0.1, 0.2, 0.3)) / np.pi) and scene.background.color == (
        0,
        0,
        1,
    )
    scene = load(tmp_path, world(f'<scene><sky/><fog/></scene><model name="m">{BOX_LINK}</model>'))
    assert scene.background.color == (0.5, 0.7, 0.9)


PLUGIN = '<plugin filename="gz-sim-label-system" name="gz::sim::systems::Label"><label>{}</label></plugin>'


def test_label_plugin(tmp_path):
    text = world(
        f'<model name="car">{PLUGIN.format(40)}{BOX_LINK}</model>'
        f'<model name="mug"><link name="l">{visual(BOX, more=PLUGIN.format(3))}</link></model>'
    )
    assert [part.label for part in read(tmp_path, text).parts] == [40, wv.Label.OBJECT]
    scene = load(tmp_path, text, labels={"label 3": "human", "label 40": "robot"})
    assert [item.label for item in scene] == [wv.Label.ROBOT, wv.Label.HUMAN]


def test_labels_by_names(tmp_path):
    static = "<static>true</static>"
    camera = '<sensor name="c" type="camera"/>'
    wheel = f'<link name="w">{visual(BOX)}</link>'
    wheel += '<joint name="j" type="continuous"><parent>l</parent><child>w</child></joint>'
    text = world(
        f'<model name="cafe_table_12">{static}{BOX_LINK}</model>'
        f'<model name="floor">{static}{BOX_LINK}</model>'
        f'<model name="floor_lamp">{static}{BOX_LINK}</model>'
        f'<model name="mug">{BOX_LINK}</model>'
        f'<model name="person_standing">{BOX_LINK}</model>'
        f'<model name="rover">{wheel}<link name="l">{visual(BOX)}{camera}</link></model>'
    )
    scene = load(tmp_path, text)
    found = {item.category: item.label.name for item in scene}
    assert found == {
        "cafe_table": "OBSTACLE",
        "floor": "GROUND",
        "floor_lamp": "OBSTACLE",
        "mug": "OBJECT",
        "person_standing": "HUMAN",
        "rover": "ROBOT",
    }


def robot(joints, links=("base", "arm", "tip"), more=""):
    parts = "".join(
        f'<link name="{name}"><pose>{x} 0 0 0 0 0</pose>{visual(BOX)}</link>' for x, name in enumerate(links)
    )
    return world(f'<model name="r"><pose>0 0 1 0 0 0</pose>{more}{parts}{joints}</model>')


def joint(name, kind, parent, child, axis="", more=""):
    axis = axis and f"<axis>{axis}</axis>"
    ends = f"<parent>{parent}</parent><child>{child}</child>"
    return f'<joint name="{name}" type="{kind}">{more}{ends}{axis}</joint>'


Z = "<xyz>0 0 1</xyz>"


def positions(scene, values=None):
    poses = scene.joints.poses(values)[0]
    return {list(scene)[index].name: poses[column, :3].round(6).tolist() for column, index in enumerate(scene.movable)}


def test_joints_move_links(tmp_path):
    """The arm turns about its own origin at x = 1, where the joint is; the tip slides along the arm."""
    joints = joint("turn", "revolute", "base", "arm", f"{Z}<limit><lower>-2</lower><upper>2</upper></limit>")
    joints += joint("slide", "prismatic", "arm", "tip", "<xyz>1 0 0</xyz>")
    scene = load(tmp_path, robot(joints), movable=True)
    assert scene.joints.names == ("r::turn", "r::slide", "r::base")
    assert scene.joints["r::turn"].limits == (-2, 2) and scene.joints["r::slide"].limits is None
    moved = positions(scene, {"r::turn": np.pi / 2, "r::slide": 0.5})
    assert moved == {"r::base::v": [0, 0, 1], "r::arm::v": [1, 0, 1], "r::tip::v": [1, 1.5, 1]}
    away = positions(scene, {"r::base": (0, 5, 1, 0, 0, 0, 1)})
    assert away["r::tip::v"] == [2, 5, 1]
    with pytest.raises(PoseError, match="-2 to 2"):
        scene.joints.poses({"r::turn": 3.0})


def test_fixed_joints_weld_links(tmp_path):
    joints = joint("a", "fixed", "base", "arm") + joint("b", "continuous", "arm", "tip", Z)
    scene = load(tmp_path, robot(joints), movable=True)
    assert [list(scene)[index].name for index in scene.movable] == ["r::base::v", "r::tip::v"]
    scene = load(tmp_path, robot(joint("w", "fixed", "world", "base") + joints), movable=True)
    assert [list(scene)[index].name for index in scene.movable] == ["r::tip::v"]


@pytest.mark.parametrize(
    ("axis", "version", "expected"),
    [
        ("<xyz>1 0 0</xyz>", "1.9", (1, 0, 0)),
        ('<xyz expressed_in="__model__">1 0 0</xyz>', "1.9", (0, -1, 0)),
        ("<xyz>1 0 0</xyz><use_parent_model_frame>1</use_parent_model_frame>", "1.6", (0, -1, 0)),
        ("<xyz>1 0 0</xyz>", "1.4", (0, -1, 0)),
    ],
)
def test_frames_of_axes(tmp_path, axis, version, expected):
    turned = "<pose>0 0 0 0 0 1.5707963267948966</pose>"
    text = robot(joint("j", "revolute", "base", "arm", axis, turned)).replace("1.9", version)
    assert np.allclose(load(tmp_path, text).joints["r::j"].axis, expected, atol=1e-12)


def test_mimic(tmp_path):
    follower = f"{Z}<mimic joint='a'><multiplier>2</multiplier><offset>0.5</offset><reference>1</reference></mimic>"
    joints = joint("a", "revolute", "base", "arm", Z) + joint("b", "revolute", "arm", "tip", follower)
    assert load(tmp_path, robot(joints)).joints["r::b"].mimic == ("r::a", 2, -1.5)


def test_joints_of_two_axes(tmp_path):
    two = "<axis2><xyz>0 1 0</xyz></axis2>"
    text = robot(joint("u", "universal", "base", "arm", Z, two))
    found = load(tmp_path, text, movable=True).joints
    assert found["r::u"].axis.tolist() == [0, 0, 1] and found["r::u::2"].axis.tolist() == [0, 1, 0]
    poses = found.link_poses({"r::u": np.pi / 2, "r::u::2": np.pi / 2})["r::arm"][0]
    assert np.allclose(poses[:3, 0], (0, 0, -1), atol=1e-9)


@pytest.mark.parametrize(
    ("kind", "expected"), [("ball", "floating"), ("screw", "continuous"), ("gearbox", "continuous")]
)
def test_other_joints_are_approximated_with_a_warning(tmp_path, kind, expected):
    path = write(tmp_path, robot(joint("j", kind, "base", "arm")))
    with pytest.warns(UserWarning, match=f"{kind} joint 'r::j'"):
        assert wv.Scene.load(path).joints["r::j"].kind == expected


def test_loops_and_unknown_links_are_left_out(tmp_path):
    chain = joint("a", "revolute", "base", "arm", Z) + joint("b", "revolute", "arm", "tip", Z)
    path = write(tmp_path, robot(chain + joint("c", "revolute", "tip", "base", Z)))
    with pytest.warns(UserWarning, match="'r::c' is ignored: it closes a loop"):
        assert wv.Scene.load(path).joints.names == ("r::a", "r::b", "r::base")


def test_joints_between_models_of_a_world(tmp_path):
    models = "".join(
        f'<model name="{name}"><pose>{x} 0 0 0 0 0</pose>{BOX_LINK}</model>' for x, name in enumerate("ab")
    )
    text = world(models + joint("j", "prismatic", "a", "b::l", Z), version="1.11")
    scene = load(tmp_path, text, movable=True)
    assert scene.joints.names == ("j", "a::l")
    assert positions(scene, {"j": 2.0}) == {"a::l::v": [0, 0, 0], "b::l::v": [1, 0, 2]}


def test_infinite_limits_and_repeated_names(tmp_path):
    free = joint("j", "prismatic", "base", "arm", f"{Z}<limit><lower>-inf</lower><upper>inf</upper></limit>")
    assert load(tmp_path, robot(free)).joints["r::j"].limits is None
    path = write(tmp_path, robot(free + joint("j", "revolute", "arm", "tip", Z)))
    with pytest.warns(UserWarning, match="'r::j' is ignored: its name is taken"):
        assert wv.Scene.load(path).joints.names == ("r::j", "r::base", "r::tip")


def test_joint_with_the_name_of_a_link(tmp_path):
    """Files of Gazebo Classic have these."""
    scene = load(tmp_path, robot(joint("base", "revolute", "base", "arm", Z)))
    assert scene.joints.names == ("r::base", "r::base::floating", "r::tip")


def test_static_models_have_no_joints(tmp_path):
    text = robot(joint("j", "revolute", "base", "arm", Z), more="<static>true</static>")
    assert len(load(tmp_path, text).joints) == 0
