"""CSV and PLY of a map."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest

from seo_slam.map import Map
from seo_slam.map_export import CSV_COLUMNS, box_corners, label_color, to_csv, to_ply
from seo_slam.testing.store import make_landmark


@pytest.fixture
def two():
    nasty = replace(make_landmark(1, (1.0, 2.0, 3.0)), label='a, "b"\nend_header', labels={'a, "b"\nend_header': 1.0})
    flat = replace(make_landmark(4, (0.0, -1.0, 0.5)), size_m=np.array([0.2, 0.0, 0.4]))
    return Map([flat, nasty, make_landmark(3, state="tentative")], gravity="poses")


def read_ply(text):
    """Vertices (N, 7) and triangles (M, 3) of an ASCII PLY, by the letter of its header."""
    header, body = text.split("end_header\n", 1)
    lines = header.splitlines()
    assert lines[0] == "ply"
    counts = {line.split()[1]: int(line.split()[2]) for line in lines if line.startswith("element ")}
    rows = [line.split() for line in body.splitlines()]
    assert len(rows) == counts["vertex"] + counts["face"]
    vertices = np.array(rows[: counts["vertex"]], dtype=float)
    faces = np.array(rows[counts["vertex"] :], dtype=int)
    assert (faces[:, 0] == 3).all()
    return vertices, faces[:, 1:], lines


def test_csv_comes_back(two):
    rows = list(csv.DictReader(io.StringIO(to_csv(two), newline="")))
    assert [row["id"] for row in rows] == ["1", "4"]
    assert tuple(rows[0]) == CSV_COLUMNS
    assert rows[0]["label"] == 'a, "b"\nend_header'
    assert [float(rows[0][f"{axis}_m"]) for axis in "xyz"] == [1.0, 2.0, 3.0]
    sigma_m = [float(rows[1][f"sigma_{axis}_m"]) for axis in "xyz"]
    assert np.square(sigma_m) == pytest.approx([1.1e-4, 2.1e-4, 3.1e-4])
    assert float(rows[1]["weight"]) == 0.75
    assert float(rows[1]["first_seen_s"]) == 1305031102.175304
    assert (rows[1]["state"], float(rows[1]["existence"])) == ("stable", 0.875)
    assert len(list(csv.reader(io.StringIO(to_csv(two, tentative=True), newline="")))) == 4


def test_csv_tells_the_category_and_its_weight():
    boot = replace(make_landmark(1), label='=green "boot"', category="cup")
    (row,) = csv.DictReader(io.StringIO(to_csv(Map([boot])), newline=""))
    assert (row["label"], row["category"], float(row["weight"])) == ('=green "boot"', "cup", 0.75)


@pytest.mark.parametrize("text", ["<script>", "'); DROP TABLE landmark; --", 'a\x1b[31m"\r\n,b', "=1+1"])
def test_hostile_labels_stay_in_their_cells(text):
    (row,) = csv.DictReader(io.StringIO(to_csv(Map([replace(make_landmark(1), label=text, category=text)])), newline=""))
    assert (row["label"], row["category"], row["state"]) == (text, text, "stable")


def test_csv_of_an_empty_map_has_its_columns():
    assert to_csv(Map()).strip().split(",") == list(CSV_COLUMNS)


def test_ply_boxes_enclose_their_landmarks(two):
    vertices, faces, header = read_ply(to_ply(two))
    assert vertices.shape == (16, 7)
    assert faces.shape == (24, 3)
    for k, row in enumerate(two.landmarks):
        own = vertices[8 * k : 8 * k + 8]
        assert own[:, 6].tolist() == [row.id] * 8
        assert own[:, :3].min(axis=0) == pytest.approx(row.position_m - np.maximum(row.size_m, 0.01) / 2, abs=1e-6)
        assert own[:, :3].max(axis=0) == pytest.approx(row.position_m + np.maximum(row.size_m, 0.01) / 2, abs=1e-6)
        assert tuple(own[0, 3:6].astype(int)) == label_color(row.label)
    assert 'comment landmark 1 "a, \\"b\\"\\nend_header"' in header


def test_ply_sides_are_closed_and_face_outwards(two):
    vertices, faces, _ = read_ply(to_ply(two))
    edges = {(int(a), int(b)) for triangle in faces for a, b in zip(triangle, np.roll(triangle, -1), strict=True)}
    assert len(edges) == 3 * len(faces)
    assert all((b, a) in edges for a, b in edges)
    for k, row in enumerate(two.landmarks):
        corners = vertices[faces[12 * k : 12 * k + 12], :3]
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        outwards = corners.mean(axis=1) - row.position_m
        assert (np.sum(normals * outwards, axis=1) > 0).all()
        volume = np.sum(corners[:, 0] * np.cross(corners[:, 1], corners[:, 2])) / 6
        assert volume == pytest.approx(np.prod(np.maximum(row.size_m, 0.01)), rel=1e-3)


def test_ply_of_an_empty_map_is_a_ply():
    text = to_ply(Map())
    assert "element vertex 0\n" in text
    assert text.endswith("end_header\n")


def test_ply_is_ascii_whatever_the_labels(two):
    row = replace(make_landmark(0), label="杯子", labels={"杯子": 1.0})
    assert to_ply(Map([row])).isascii()


def test_a_label_has_one_colour_and_most_labels_have_different_ones():
    assert label_color("cup") == label_color("cup")
    assert label_color("") == (128, 128, 128)
    words = [f"thing {i}" for i in range(40)]
    colours = {label_color(word) for word in words}
    assert len(colours) > 35
    assert all(0 <= channel <= 255 for colour in colours for channel in colour)


def test_a_box_has_eight_corners():
    corners = box_corners(make_landmark(0, (1.0, 1.0, 1.0)))
    assert corners.shape == (8, 3)
    assert len(np.unique(corners, axis=0)) == 8
