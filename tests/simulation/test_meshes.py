"""GLB files, the paint of meshes, and the library of a folder."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.simulation.mesh_library import MeshLibrary
from seo_slam.simulation.meshes import MeshPaint, MeshShape, load_glb
from seo_slam.simulation.world import Thing

RED, GREEN, BLUE, WHITE = (255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 255)


def triangle_glb(**visual: Any) -> bytes:
    """One triangle of a file that is y up: at (0, 0, 0), (1, 0, 0) and (0, 2, 0)."""
    mesh = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 2, 0]], [[0, 1, 2]], process=False, **visual)
    return bytes(mesh.export(file_type="glb"))


def edited(glb: bytes, change: Any) -> bytes:
    """The file with its JSON changed."""
    length = struct.unpack("<I", glb[12:16])[0]
    header = json.loads(glb[20 : 20 + length])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    rest = glb[20 + length :]
    return glb[:8] + struct.pack("<II", 20 + len(text) + len(rest), len(text)) + glb[16:20] + text + rest


def shape_of(path: Path, content: bytes) -> tuple[MeshShape, MeshPaint]:
    path.write_bytes(content)
    (part,) = load_glb(path)
    assert isinstance(part.shape, MeshShape)
    assert part.shape.paint is not None
    return part.shape, part.shape.paint


def textured_glb() -> bytes:
    # Above: red, green. Below: blue, white. The triangle's corners: lower left, lower right, upper left of the image.
    image = Image.fromarray(np.array([[RED, GREEN], [BLUE, WHITE]], dtype=np.uint8))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    return triangle_glb(visual=trimesh.visual.TextureVisuals(uv=[[0, 0], [1, 0], [0, 1]], material=material))  # trimesh: v upward


def test_a_file_that_is_y_up_becomes_z_up(tmp_path: Path) -> None:
    shape, _ = shape_of(tmp_path / "a.glb", triangle_glb())
    assert np.allclose(shape.vertices[shape.faces[0]], [[0, 0, 0], [1, 0, 0], [0, 0, 2]])


def test_the_pose_of_a_node_is_applied_before_the_turn(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box((1, 1, 1)), transform=trimesh.transformations.translation_matrix([3, 4, 5]))
    shape, _ = shape_of(tmp_path / "a.glb", bytes(scene.export(file_type="glb")))
    low, high = shape.bounds()
    assert np.allclose((low + high) / 2, [3, -5, 4])


def test_textures_are_not_upside_down(tmp_path: Path) -> None:
    _, paint = shape_of(tmp_path / "a.glb", textured_glb())
    assert np.allclose(paint.uv[0] % 1.0, [[0, 0], [0, 0], [0, 0]])
    assert paint.uv[0, 2, 1] < paint.uv[0, 0, 1]  # the upper corner of the triangle lies above in the image: down is positive
    assert paint.images[0][0, 0].tolist() == list(RED)


def test_a_base_colour_and_a_texture_are_multiplied(tmp_path: Path) -> None:
    def dim(header: dict[str, Any]) -> None:
        header["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = [0.5, 1.0, 1.0, 1.0]

    _, paint = shape_of(tmp_path / "a.glb", edited(textured_glb(), dim))
    assert paint.images[0][0, 0].tolist() == [128, 0, 0]
    assert paint.images[0][0, 1].tolist() == [0, 255, 0]


def test_colours_of_other_writers_are_linear_light(tmp_path: Path) -> None:
    def plain(header: dict[str, Any]) -> None:
        header["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [0.5, 0.0, 1.0, 1.0]}}]
        header["meshes"][0]["primitives"][0]["material"] = 0

    def foreign(header: dict[str, Any]) -> None:
        plain(header)
        header["asset"]["generator"] = "another program"

    _, own = shape_of(tmp_path / "a.glb", edited(triangle_glb(), plain))
    _, other = shape_of(tmp_path / "b.glb", edited(triangle_glb(), foreign))
    assert own.images[0][0, 0].tolist() == [128, 0, 255]
    assert other.images[0][0, 0].tolist() == [188, 0, 255]  # 0.5 of the light is 188 on the screen (sRGB)


@pytest.mark.parametrize("material", [False, True])
def test_vertex_colours(tmp_path: Path, material: bool) -> None:
    def change(header: dict[str, Any]) -> None:
        if material:
            header["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, 1.0]}}]
            header["meshes"][0]["primitives"][0]["material"] = 0

    glb = triangle_glb(vertex_colors=[(*RED, 255), (*GREEN, 255), (*BLUE, 255)])
    _, paint = shape_of(tmp_path / "a.glb", edited(glb, change))
    assert paint.tint is not None
    assert np.allclose(paint.tint[0], np.eye(3))
    assert np.allclose(paint.mean_rgb(), 1 / 3, atol=1e-6)


def test_a_triangle_with_broken_texture_coordinates_gets_one_colour(tmp_path: Path) -> None:
    image = Image.fromarray(np.full((2, 2, 3), 90, dtype=np.uint8))
    material = trimesh.visual.material.PBRMaterial(baseColorTexture=image)
    visual = trimesh.visual.TextureVisuals(uv=[[0, 0], [3e9, 0], [0, 1]], material=material)
    _, paint = shape_of(tmp_path / "a.glb", triangle_glb(visual=visual))
    assert np.abs(paint.uv).max() <= 1.0


@pytest.mark.parametrize("content", [b"", b"glTF", b"not a mesh at all, but long enough for a header", triangle_glb()[:150]])
def test_damaged_files_are_named(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "broken.glb"
    path.write_bytes(content)
    with pytest.raises(DatasetError, match=r"broken\.glb"):
        load_glb(path)


def test_missing_and_empty_files_are_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"nowhere\.glb"):
        load_glb(tmp_path / "nowhere.glb")

    def empty(header: dict[str, Any]) -> None:
        header["nodes"] = [{"name": "world"}]

    (tmp_path / "empty.glb").write_bytes(edited(triangle_glb(), empty))
    with pytest.raises(DatasetError, match=r"empty\.glb"):
        load_glb(tmp_path / "empty.glb")


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (np.zeros((3, 2)), [[0, 1, 2]]),
        (np.zeros((3, 3)), [[0, 1, 3]]),
        (np.full((3, 3), np.nan), [[0, 1, 2]]),
        (np.zeros((3, 3)), np.zeros((0, 3))),
    ],
)
def test_bad_meshes_are_refused(vertices: Any, faces: Any) -> None:
    with pytest.raises(ConfigError, match="mesh"):
        MeshShape(np.asarray(vertices), np.asarray(faces))


def test_the_exact_renderer_refuses_meshes() -> None:
    shape = MeshShape(np.eye(3), np.array([[0, 1, 2]]))
    with pytest.raises(ConfigError, match="embree"):
        shape.intersect(np.zeros(3), np.ones((1, 3)))
    with pytest.raises(ConfigError, match="embree"):
        shape.normals(np.zeros((1, 3)))


# The library -----------------------------------------------------------------------------------------------------------------------

MODEL = {"name": "bit", "file": "bit.glb", "label": "thing", "kind": "volatile", "size": [1.0, 0.1, 2.0], "faces": 1}


def library_folder(folder: Path, *models: Any) -> Path:
    (folder / "some").mkdir(parents=True, exist_ok=True)
    (folder / "some" / "manifest.json").write_text(json.dumps(list(models)))
    (folder / "some" / "bit.glb").write_bytes(triangle_glb())
    return folder


def test_a_library_finds_models_by_name_and_label(tmp_path: Path) -> None:
    other = {**MODEL, "name": "a bit", "kind": "anchor", "licence": "CC0", "creator": "somebody"}
    library = MeshLibrary(library_folder(tmp_path, MODEL, other))
    assert len(library) == 2
    assert [model.name for model in library.with_label("thing")] == ["a bit", "bit"]
    assert library.with_label("nothing") == ()
    assert library.labels == ("thing",)
    assert "bit" in library
    assert library["a bit"].creator == "somebody"
    assert library["bit"].size_m == (1.0, 0.1, 2.0)


def test_parts_are_read_once_and_late(tmp_path: Path) -> None:
    library = MeshLibrary(library_folder(tmp_path, MODEL, {**MODEL, "name": "gone", "file": "gone.glb"}))
    assert library.parts("bit") is library.parts("bit")
    with pytest.raises(DatasetError, match=r"gone\.glb"):
        library.parts("gone")


def test_a_manifest_right_in_the_folder_counts(tmp_path: Path) -> None:
    assert len(MeshLibrary(library_folder(tmp_path, MODEL) / "some")) == 1


def test_folders_without_a_manifest_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="no such folder"):
        MeshLibrary(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match=r"manifest\.json"):
        MeshLibrary(tmp_path)


@pytest.mark.parametrize(
    ("model", "words"),
    [
        ({**MODEL, "kind": "wobbly"}, r"bit.*kind.*wobbly.*anchor"),
        ({**MODEL, "size": [1, 2]}, r"bit.*size"),
        ({**MODEL, "size": [1, 2, float("nan")]}, r"bit.*size"),
        ({**MODEL, "size": [1, 2, 0]}, r"bit.*size"),
        ({**MODEL, "label": ""}, r"bit.*label"),
        ({**MODEL, "faces": "many"}, r"bit.*faces"),
        ({**MODEL, "licence": 3}, r"bit.*licence"),
        ({k: v for k, v in MODEL.items() if k != "file"}, r"bit.*file"),
        ({k: v for k, v in MODEL.items() if k != "name"}, r"model 0.*name"),
        ("bit", r"model 0"),
    ],
)
def test_malformed_models_name_file_and_key(tmp_path: Path, model: Any, words: str) -> None:
    with pytest.raises(DatasetError, match=rf"(?s)manifest\.json.*{words}"):
        MeshLibrary(library_folder(tmp_path, model))


def test_malformed_manifests_and_names_used_twice(tmp_path: Path) -> None:
    folder = library_folder(tmp_path, MODEL, MODEL)
    with pytest.raises(DatasetError, match="twice"):
        MeshLibrary(folder)
    for text in ('{"bit": 1}', "[", "\udcff"):
        (folder / "some" / "manifest.json").write_bytes(text.encode("utf-8", "surrogateescape"))
        with pytest.raises(DatasetError, match=r"manifest\.json"):
            MeshLibrary(folder)


def test_an_unknown_name_is_named(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="bits"):
        MeshLibrary(library_folder(tmp_path, MODEL))["bits"]


# Real files -----------------------------------------------------------------------------------------------------------------------


def test_real_models_have_the_sizes_of_their_manifest(shared: Path) -> None:
    library = MeshLibrary(shared / "meshes")
    assert len(library) > 100
    for name in ("ycb_banana", "snowman", "chair_oak", "toy_car_red", "vase_cream", "desk_plain"):
        model = library[name]
        thing = Thing(1, model.label, library.parts(name), np.eye(4))
        low, high = thing.bounds_world
        assert np.allclose(high - low, model.size_m, atol=2e-3), name
        assert abs(low[2]) < 2e-3, name
        assert np.abs(low + high)[:2].max() < 4e-3, name
        (part,) = thing.parts
        assert isinstance(part.shape, MeshShape)
        assert len(part.shape.faces) == model.faces


def test_real_colours(shared: Path) -> None:
    def mean_rgb(name: str) -> np.ndarray:
        (part,) = library.parts(name)
        assert isinstance(part.shape, MeshShape)
        assert part.shape.paint is not None
        return part.shape.paint.mean_rgb()

    library = MeshLibrary(shared / "meshes")
    red, green, blue = mean_rgb("toy_car_red")
    assert red > max(green, blue)
    red, green, blue = mean_rgb("bin_recycling")  # no texture, a base colour
    assert blue > 2 * max(red, green)


def test_house_models_stay_where_their_file_puts_them(shared: Path) -> None:
    path = shared / "meshes" / "aws-small-house" / "SofaC_01.glb"
    raw = trimesh.load_scene(path).bounds
    (part,) = load_glb(path)
    low, high = part.shape.bounds()
    assert np.allclose([low[0], low[2]], [raw[0, 0], raw[0, 1]], atol=1e-5)
    assert np.allclose([-high[1], -low[1]], raw[:, 2], atol=1e-5)
