"""Geometries of SDF: shapes, mesh files, terrain, collision elements and actors."""

import sys

import numpy as np
import pytest
import trimesh

import warpvis as wv
from warpvis.errors import FileFormatError, SceneError
from warpvis.io import read_parts
from warpvis.scene.solids import Solid

from support.sdf_files import BOX, BOX_LINK, image, load, model, only, read, visual, world, write


def link(shape, more=""):
    return model(f'<link name="l">{visual(shape)}</link>{more}')


def bounds(part):
    vertices = part.mesh.vertices if isinstance(part.mesh, Solid) else part.mesh[0]
    return np.stack([vertices.min(axis=0), vertices.max(axis=0)])


def volume(part):
    mesh = part.mesh
    mesh = trimesh.Trimesh(*(mesh if isinstance(mesh, tuple) else (mesh.vertices, mesh.faces)), process=True)
    assert mesh.is_watertight
    return mesh.volume


@pytest.mark.parametrize(
    ("shape", "extent", "expected"),
    [
        (BOX, (0.5, 1, 1.5), 6),
        ("<sphere><radius>2</radius></sphere>", (2, 2, 2), 4 / 3 * np.pi * 8),
        ("<cylinder><radius>0.5</radius><length>3</length></cylinder>", (0.5, 0.5, 1.5), 0.75 * np.pi),
        ("<capsule><radius>0.5</radius><length>3</length></capsule>", (0.5, 0.5, 2), np.pi * (0.75 + 1 / 6)),
        ("<ellipsoid><radii>1 2 3</radii></ellipsoid>", (1, 2, 3), 8 * np.pi),
        ("<cone><radius>1</radius><length>3</length></cone>", (1, 1, 1.5), np.pi),
    ],
    ids=["box", "sphere", "cylinder", "capsule", "ellipsoid", "cone"],
)
def test_shapes_are_closed_and_centered(tmp_path, shape, extent, expected):
    part = only(read(tmp_path, link(shape)))
    assert np.allclose(np.abs(bounds(part)), [extent, extent], atol=2e-3)
    assert np.isclose(volume(part), expected, rtol=3e-3)


def test_moving_round_shapes_are_solids_and_static_ones_triangles(tmp_path):
    shape = "<sphere><radius>2</radius></sphere>"
    assert isinstance(only(read(tmp_path, link(shape))).mesh, Solid)
    assert isinstance(only(read(tmp_path, link(shape, "<static>true</static>"))).mesh, tuple)


def test_planes_have_a_finite_size_and_a_normal(tmp_path):
    part = only(read(tmp_path, link("<plane><size>4 2</size></plane>")))
    assert np.allclose(bounds(part), [(-2, -1, 0), (2, 1, 0)]) and part.label == wv.Label.GROUND
    part = only(read(tmp_path, link("<plane><normal>1 0 0</normal><size>4 2</size></plane>")))
    vertices, faces = part.mesh
    assert np.allclose(vertices[:, 0], 0)
    assert np.allclose(trimesh.Trimesh(vertices, faces, process=False).face_normals, (1, 0, 0))


def points(*rows, height=2):
    return f"<polyline>{''.join(f'<point>{x} {y}</point>' for x, y in rows)}<height>{height}</height></polyline>"


SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]


def test_polylines(tmp_path):
    concave = only(read(tmp_path, link(points((0, 0), (4, 0), (4, 4), (2, 1), (0, 4)))))
    area = 4 * 4 - 0.5 * 4 * 3
    assert np.allclose(bounds(concave), [(0, 0, 0), (4, 4, 2)])
    triangles = trimesh.Trimesh(*concave.mesh, process=False)
    assert np.isclose(triangles.volume, 2 * area)


@pytest.mark.parametrize("hole", [[(1, 1), (3, 1), (3, 3), (1, 3)], [(1, 1), (1, 3), (3, 3), (3, 1)]])
def test_polyline_with_a_hole(tmp_path, hole):
    part = only(read(tmp_path, link(points(*SQUARE) + points(*hole))))
    assert np.isclose(trimesh.Trimesh(*part.mesh, process=False).volume, 2 * 12)
    scene = wv.Scene.load(tmp_path / "file.sdf")
    camera = wv.Camera.from_fov(3, 3, hfov=0.1)
    for x, top in ((2, np.inf), (0.5, 8)):
        depth = wv.render(scene, camera, wv.look_at((x, 2, 10), (x, 2, 0), up="y")).depth.numpy()
        assert np.allclose(depth[0, 1, 1], top)


@pytest.fixture
def two_boxes(tmp_path):
    """A mesh file of two objects of different colors."""
    scene = trimesh.Scene()
    for name, x, color in (("left", 0, (255, 0, 0, 255)), ("right", 5, (0, 255, 0, 255))):
        mesh = trimesh.creation.box((1, 1, 1))
        mesh.apply_translation((x, 0, 0))
        mesh.visual = trimesh.visual.TextureVisuals(
            material=trimesh.visual.material.PBRMaterial(baseColorFactor=color, metallicFactor=0.0)
        )
        scene.add_geometry(mesh, node_name=name, geom_name=name)
    (tmp_path / "meshes").mkdir()
    scene.export(tmp_path / "meshes" / "two.glb")
    return "<mesh><uri>meshes/two.glb</uri>{}</mesh>"


def test_mesh_files_keep_all_parts_and_their_colors(tmp_path, two_boxes):
    found = read(tmp_path, link(two_boxes.format("<scale>2 2 -2</scale>")))
    assert [part.name for part in found.parts] == ["m::l::v::left", "m::l::v::right"]
    assert [part.appearance.get().materials[0].base_color[:2] for part in found.parts] == [(1, 0), (0, 1)]
    assert np.allclose(bounds(found.parts[1]), [(9, -1, -1), (11, 1, 1)])
    assert np.isclose(volume(found.parts[0]), 8)  # a mirrored mesh is not inside out


def test_submesh(tmp_path, two_boxes):
    part = only(read(tmp_path, link(two_boxes.format("<submesh><name>right</name></submesh>"))))
    assert np.allclose(bounds(part).mean(axis=0), (5, 0, 0))
    centered = "<submesh><name>right</name><center>true</center></submesh>"
    assert np.allclose(bounds(only(read(tmp_path, link(two_boxes.format(centered))))).mean(axis=0), 0)


def test_submesh_of_collada_by_the_name_of_its_node(tmp_path):
    pytest.importorskip("collada")
    boxes = [trimesh.creation.box((1, 1, 1)) for _ in range(2)]
    boxes[1].apply_translation((7, 0, 0))
    text = trimesh.exchange.dae.export_collada(boxes).decode()
    (tmp_path / "m.dae").write_text(text.replace('name="node1"', 'name="Body"'))
    part = only(read(tmp_path, link("<mesh><uri>m.dae</uri><submesh><name>Body</name></submesh></mesh>")))
    assert np.allclose(bounds(part).mean(axis=0), (7, 0, 0))


@pytest.mark.parametrize("name", ["../materials/textures/a.png", "a.png"])
def test_images_of_meshes_are_searched_in_the_folder_of_the_model(tmp_path, name):
    image(tmp_path / "materials" / "textures" / "a.png", np.full((2, 2, 3), 9))
    text = "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    write(tmp_path, text, "meshes/m.obj")
    write(tmp_path, f"newmtl a\nKd 1 1 1\nmap_Kd {name}\n", "meshes/m.mtl")
    (material,) = only(read(tmp_path, link("<mesh><uri>meshes/m.obj</uri></mesh>"))).appearance.get().materials
    assert (material.texture.image == 9).all()


def test_equal_meshes_share_their_arrays(tmp_path, two_boxes):
    shape = two_boxes.format("<scale>2 2 2</scale>")
    models = "".join(f'<model name="m{n}"><link name="l">{visual(shape)}</link></model>' for n in range(2))
    first, _, second, _ = read(tmp_path, world(models)).parts
    assert first.mesh[0] is second.mesh[0] and first.mesh[1] is second.mesh[1]


def test_missing_and_unreadable_meshes_are_one_warning(tmp_path):
    write(tmp_path, "nothing", "bad.stl")
    shapes = "".join(visual(f"<mesh><uri>{name}</uri></mesh>", name) for name in ("gone.dae", "bad.stl"))
    path = write(tmp_path, model(f'<link name="l">{visual(BOX)}{shapes}</link>'))
    with pytest.warns(UserWarning, match=r"skipped gone\.dae .*bad\.stl") as caught:
        assert len(wv.Scene.load(path)) == 1
    assert len(caught) == 1
    with pytest.raises(FileFormatError, match=r"gone\.dae"):
        wv.Scene.load(path, strict=True)


def test_heightmap(tmp_path):
    pixels = np.zeros((3, 3), dtype=np.uint8)
    pixels[0, 2] = 200  # the upper right corner is at x, y > 0
    image(tmp_path / "h.png", pixels)
    shape = "<heightmap><uri>h.png</uri><size>10 8 5</size><pos>0 0 1</pos></heightmap>"
    part = only(read(tmp_path, link(shape)))
    vertices, faces = part.mesh
    assert len(vertices) == 9 and len(faces) == 8 and part.label == wv.Label.GROUND
    assert np.allclose(vertices[np.argmax(vertices[:, 2])], (5, 4, 6))
    assert np.allclose(vertices[:, 2].min(), 1)
    assert (trimesh.Trimesh(vertices, faces, process=False).face_normals[:, 2] > 0).all()


def test_elevation_model(tmp_path):
    rasterio = pytest.importorskip("rasterio")
    heights = np.array([[100, 101], [102, 110]], dtype=np.float32)
    place = rasterio.transform.from_origin(500000, 4000000, 30, 30)
    options = {"height": 2, "width": 2, "count": 1, "dtype": "float32", "crs": "EPSG:32633", "transform": place}
    with rasterio.open(tmp_path / "dem.tif", "w", driver="GTiff", **options) as file:
        file.write(heights, 1)
    vertices, _ = only(read(tmp_path, link("<heightmap><uri>dem.tif</uri></heightmap>"))).mesh
    assert np.allclose(np.ptp(vertices, axis=0), (60, 60, 10)) and np.allclose(vertices[3], (30, -30, 10))


def test_elevation_model_without_rasterio(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rasterio", None)
    write(tmp_path, "x", "dem.tif")
    path = write(tmp_path, link("<heightmap><uri>dem.tif</uri></heightmap>"))
    with pytest.raises(FileFormatError, match=r"pip install 'warpvis\[geo\]'"):
        wv.Scene.load(path, strict=True)


def test_image_and_empty_geometries(tmp_path):
    shapes = visual("<image><uri>a.png</uri></image>", "i") + visual("<empty/>", "e")
    path = write(tmp_path, model(f'<link name="l">{visual(BOX)}{shapes}</link>'))
    with pytest.warns(UserWarning, match=r"<image>.*not supported"):
        assert len(wv.Scene.load(path)) == 1


def test_collisions_are_shown_if_a_model_has_no_visual(tmp_path):
    collision = f'<collision name="c"><geometry>{BOX}</geometry></collision>'
    text = world(
        f'<model name="a"><link name="l">{collision}</link></model>'
        f'<model name="b"><link name="l">{visual(BOX)}{collision}</link></model>'
    )
    assert [part.name for part in read(tmp_path, text).parts] == ["a::l::c", "b::l::v"]


def test_actor_is_a_person_at_rest(tmp_path):
    trimesh.creation.box((0.5, 0.5, 2)).export(tmp_path / "skin.stl")
    script = "<script><trajectory id='0' type='walk'><waypoint><time>0</time><pose>1 2 0 0 0 0</pose></waypoint>"
    actor = "<actor name='ann'><skin><filename>skin.stl</filename><scale>0.5</scale></skin>"
    path = write(tmp_path, world(f"{actor}{script}</trajectory></script></actor>"))
    found = read_parts(path)
    part = only(found)
    assert (part.name, part.label, part.category, part.movable) == ("ann", wv.Label.HUMAN, "person", True)
    assert np.allclose(part.pose[:2], (1, 2)) and np.allclose(np.ptp(bounds(part), axis=0), (0.25, 0.25, 1))
    assert "at rest" in found.warnings[0]


def test_links_are_movable_objects_with_their_visuals_attached(tmp_path):
    both = visual(BOX) + visual("<sphere><radius>1</radius></sphere>", "w")
    text = world(
        f'<model name="m"><link name="l">{both}</link></model><model name="s"><static>1</static>{BOX_LINK}</model>'
    )
    scene = load(tmp_path, text, movable=True)
    assert [list(scene)[index].name for index in scene.movable] == ["m::l::v"]
    with pytest.raises(SceneError, match="no moving"):
        load(tmp_path, world(f'<model name="s"><static>1</static>{BOX_LINK}</model>'), movable=True)


def test_other_elements_are_ignored(tmp_path):
    rest = "<inertial><mass>1</mass></inertial><sensor name='i' type='imu'/><particle_emitter name='p'/>"
    text = world(f'<physics/><gui/><wind/><model name="m"><link name="l">{visual(BOX)}{rest}</link></model>')
    assert len(read(tmp_path, text).parts) == 1
    path = write(tmp_path, world(f'<road name="r"/><model name="m">{BOX_LINK}</model>'))
    with pytest.warns(UserWarning, match="road"):
        wv.Scene.load(path)


def test_equals_the_same_scene_built_by_hand(tmp_path):
    """Nested, rotated and scaled models: depth and labels of both are equal."""
    trimesh.creation.icosphere(subdivisions=2, radius=0.5).export(tmp_path / "ball.stl")
    ball = visual("<mesh><uri>ball.stl</uri><scale>1 2 0.5</scale></mesh>", more="<pose>0 0 0.3 0.4 0 0</pose>")
    text = world(f"""
    <model name="floor"><static>1</static><link name="l">{visual("<plane><size>9 9</size></plane>")}</link></model>
    <model name="person"><pose>0 0 0.5 0 0 0.7</pose><link name="l"><pose>1 0 0 0 0.2 0</pose>{visual(BOX)}</link>
    <model name="cup"><pose relative_to="l">0 2 1 0.3 0 0</pose><link name="l">{ball}</link></model></model>""")
    camera, eyes = wv.Camera.from_fov(40, 30, hfov=1.2), [wv.look_at((6, x, 5), (0, 1, 0.5)) for x in (-3, 0, 4)]

    def matrix(x, y, z, roll=0.0, pitch=0.0, yaw=0.0):
        return trimesh.transformations.compose_matrix(angles=(roll, pitch, yaw), translate=(x, y, z))

    person = matrix(0, 0, 0.5, yaw=0.7) @ matrix(1, 0, 0, pitch=0.2)
    cup = person @ matrix(0, 2, 1, roll=0.3) @ matrix(0, 0, 0.3, roll=0.4)
    hand = wv.Scene()
    square = np.array([(-4.5, -4.5, 0), (4.5, -4.5, 0), (4.5, 4.5, 0), (-4.5, 4.5, 0)])
    hand.add((square, [(0, 1, 2), (0, 2, 3)]), label="ground")
    hand.add(trimesh.creation.box((1, 2, 3)), label="human", pose=person)
    hand.add(trimesh.load(tmp_path / "ball.stl"), label="human", pose=cup, scale=(1, 2, 0.5))
    for movable in (False, True):
        found = wv.render(load(tmp_path, text, movable=movable), camera, eyes, outputs=["depth", "labels"])
        expected = wv.render(hand, camera, eyes, outputs=["depth", "labels"])
        assert np.allclose(found.depth.numpy(), expected.depth.numpy(), atol=1e-5)
        assert (found.labels.numpy() == expected.labels.numpy()).mean() > 0.999


def test_included_models_share_their_meshes(tmp_path):
    trimesh.creation.icosphere(subdivisions=2).export(tmp_path / "ball.stl")
    write(
        tmp_path,
        link("<mesh><uri>../ball.stl</uri><scale>1 1 2</scale></mesh>", "<static>1</static>"),
        "ball/model.sdf",
    )
    includes = "".join(
        f"<include><uri>model://ball</uri><name>b{x}</name><pose>{3 * x} 0 0 0 0 {x}</pose></include>"
        for x in range(20)
    )
    items = list(load(tmp_path, world(includes)))
    assert len(items) == 20 and len({id(item.mesh) for item in items}) == 1
