"""PLY files, text and binary, of many hands; what is wrong with one is said with file and line."""

import struct

import numpy as np
import pytest

from seo_slam.datasets.ply import read_ply
from seo_slam.errors import DatasetError

HEADER = "ply\nformat {form} 1.0\ncomment by hand\nelement vertex 2\nproperty float x\nproperty uchar red\nproperty int label\n"
ROWS = ((1.5, 200, -7), (-2.25, 3, 70000))


def written(path, form, rows=ROWS, more="", tail=b""):
    if form == "ascii":
        body = "".join(f"{x} {red} {label}\n" for x, red, label in rows).encode()
    else:
        order = "<" if form == "binary_little_endian" else ">"
        body = b"".join(struct.pack(f"{order}fBi", *row) for row in rows)
    path.write_bytes((HEADER.format(form=form) + more + "end_header\n").encode() + body + tail)
    return path


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_vertices_are_read(tmp_path, form):
    ply = read_ply(written(tmp_path / "a.ply", form))
    assert ply.comments == ("by hand",)
    assert {name: values.tolist() for name, values in ply.vertices.items()} == {"x": [1.5, -2.25], "red": [200, 3], "label": [-7, 70000]}
    assert [values.dtype for values in ply.vertices.values()] == [np.float32, np.uint8, np.int32]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_faces_may_follow(tmp_path, form):
    more, tail = "element face 1\nproperty list uchar int vertex_indices\n", b"3 0 1 1\n"
    assert read_ply(written(tmp_path / "a.ply", form, more=more, tail=tail)).vertices["label"].tolist() == [-7, 70000]


def test_lines_may_end_as_on_windows(tmp_path):
    path = written(tmp_path / "a.ply", "ascii")
    path.write_bytes(path.read_bytes().replace(b"\n", b"\r\n"))
    assert read_ply(path).vertices["red"].tolist() == [200, 3]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_a_file_of_no_points_is_a_file(tmp_path, form):
    path = written(tmp_path / "a.ply", form, rows=())
    path.write_bytes(path.read_bytes().replace(b"vertex 2", b"vertex 0"))
    assert read_ply(path).vertices["x"].shape == (0,)


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian"])
def test_cut_off_or_too_long_is_noticed(tmp_path, form):
    path = written(tmp_path / "a.ply", form)
    data = path.read_bytes()
    path.write_bytes(data[:-9])
    with pytest.raises(DatasetError, match=r"cut off|got 1 numbers, wanted 3"):
        read_ply(path)
    path.write_bytes(data + b"1 2 3\n")
    with pytest.raises(DatasetError, match="more"):
        read_ply(path)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("ply\n", "obj\n", "not a PLY file"),
        ("end_header", "end", "does not end"),
        ("format ascii", "format base64", r"a.ply:2: 'format base64"),
        ("format ascii 1.0\n", "", "names no format"),
        ("element vertex", "element face", "first element is 'face'"),
        ("element vertex 2", "element vertex two", "a.ply:4"),
        ("property float x", "property list uchar int x", "a.ply:5: vertices hold a list"),
        ("property float x", "property half x", "a.ply:5"),
        ("property int label", "property int x", "there twice"),
        ("200", "many", "property 'red'"),
        ("200", "200 1", "a.ply:9: got 4 numbers, wanted 3"),
        ("200", "-1", "a.ply:9: property 'red' is -1, wanted a number of type uint8"),
        (" 3 ", " 300 ", "a.ply:10: property 'red' is 300"),
        ("70000", "2.9", "a.ply:10: property 'label' is 2.9, wanted a number of type int32"),
        ("70000", "nan", "property 'label' is nan"),
        ("70000", "4294967295", "property 'label' is 4294967295"),
        ("1.5", "1e300", "property 'x' is 1e300, wanted a number of type float32"),
    ],
)
def test_what_is_wrong_is_said(tmp_path, old, new, message):
    path = written(tmp_path / "a.ply", "ascii")
    path.write_text(path.read_text().replace(old, new, 1))
    with pytest.raises(DatasetError, match=message):
        read_ply(path)


def test_text_may_say_numbers_in_any_way_that_their_type_holds(tmp_path):
    vertices = read_ply(written(tmp_path / "a.ply", "ascii", rows=((0.1, "2.0", "-7e2"), ("nan", 255, 0)))).vertices
    assert vertices["x"].tolist() == pytest.approx([0.1, np.nan], nan_ok=True)
    assert vertices["red"].tolist() == [2, 255]
    assert vertices["label"].tolist() == [-700, 0]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(DatasetError, match=r"none\.ply: cannot be read"):
        read_ply(tmp_path / "none.ply")
