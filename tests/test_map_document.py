"""The JSON schema of map.json, and its page in the docs."""

import json
import re
from dataclasses import replace
from pathlib import Path

import jsonschema
import pytest

from seo_slam.errors import MapError
from seo_slam.map import Map
from seo_slam.map_document import LandmarkDocument, MapDocument, map_json_schema, parse_document, write_atomically
from seo_slam.testing.store import make_landmark

DOCS = Path(__file__).resolve().parents[1] / "docs"


def a_map():
    return Map([make_landmark(4), make_landmark(2, (-0.0, 1e-12, 1 / 3)), make_landmark(5, state="tentative")], "poses", "minilm")


def test_the_schema_in_the_docs_is_the_one_that_pydantic_makes():
    wanted = json.dumps(map_json_schema(), indent=2) + "\n"
    assert (DOCS / "map.schema.json").read_text(encoding="utf-8") == wanted


def test_what_is_written_fulfils_the_schema():
    jsonschema.Draft202012Validator.check_schema(map_json_schema())
    validator = jsonschema.Draft202012Validator(map_json_schema())
    written = json.loads(a_map().to_json())
    assert list(validator.iter_errors(written)) == []
    del written["landmarks"][0]["size_m"]
    assert len(list(validator.iter_errors(written))) == 1


def test_a_file_of_before_there_was_existence_loads_as_certain(tmp_path):
    written = json.loads(a_map().to_json())
    assert [row.pop("existence") for row in (*written["landmarks"], *written["tentative"])] == [0.875] * 3
    assert list(jsonschema.Draft202012Validator(map_json_schema()).iter_errors(written)) == []
    (tmp_path / "map.json").write_text(json.dumps(written), encoding="utf-8")
    loaded = Map.load(tmp_path)
    assert [row.existence for row in (*loaded.landmarks, *loaded.tentative)] == [1.0] * 3


def test_existence_and_lost_come_back(tmp_path):
    lost = replace(make_landmark(7, state="lost"), existence=0.25)
    Map([make_landmark(4), lost]).save(tmp_path)
    loaded = Map.load(tmp_path)
    assert [(row.id, row.state, row.existence) for row in loaded.tentative] == [(7, "lost", 0.25)]
    assert [(row.id, row.state, row.existence) for row in loaded.landmarks] == [(4, "stable", 0.875)]


def described(landmark_id=4):
    """A landmark that an agent called more than its plain word, which alone is among its labels."""
    words = {"label": "chipped white mug", "category": "cup", "labels": {"cup": 0.9, "bowl": 0.1}}
    return replace(make_landmark(landmark_id), **words)


def test_a_descriptive_label_and_its_category_come_back(tmp_path):
    Map([described(), make_landmark(5)]).save(tmp_path)
    loaded = Map.load(tmp_path).landmarks
    assert [(row.label, row.category, dict(row.labels)) for row in loaded] == [
        ("chipped white mug", "cup", {"cup": 0.9, "bowl": 0.1}),
        ("cup", "", {"cup": 0.75, "bowl": 0.25}),
    ]
    written = json.loads((tmp_path / "map.json").read_bytes())
    assert list(jsonschema.Draft202012Validator(map_json_schema()).iter_errors(written)) == []
    assert Map.load(tmp_path).to_json() == (tmp_path / "map.json").read_bytes()


def test_without_agents_a_file_is_as_it_was_before_there_were_categories():
    assert b"category" not in a_map().to_json()


def test_a_label_that_neither_it_nor_its_category_is_among_labels_is_refused():
    for row in (replace(described(), category="shoe"), replace(described(), category="")):
        with pytest.raises(MapError, match="'chipped white mug' is not among labels"):
            Map([row]).to_json()


@pytest.mark.parametrize("value", [-0.1, 1.1, float("nan")])
def test_an_existence_that_is_no_probability_is_not_written(value):
    with pytest.raises(MapError, match="existence"):
        Map([replace(make_landmark(4), existence=value)]).to_json()


def test_the_page_tells_of_every_field():
    page = (DOCS / "map-format.md").read_text(encoding="utf-8")
    told = set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE))
    fields = {field.alias or name for model in (MapDocument, LandmarkDocument) for name, field in model.model_fields.items()}
    assert told >= fields


def test_the_example_of_the_page_is_a_map():
    page = (DOCS / "map-format.md").read_text(encoding="utf-8")
    example = re.search(r"```json\n(.*?)```", page, re.DOTALL)
    document = parse_document(example[1].encode(), "the example")
    assert len(document.landmarks) == 1


def test_one_line_a_landmark_rounded_and_heaviest_label_first():
    lines = a_map().to_json().decode().splitlines()
    row = next(line for line in lines if '"id": 2' in line)
    assert '"position_m": [0.0, 0.0, 0.333333333]' in row
    assert '"labels": {"cup": 0.75, "bowl": 0.25}' in row
    assert sum('"id": ' in line for line in lines) == 3
    assert lines[0] == "{"
    assert lines[1] == ' "schema": "seo_slam.map/1",'


def test_labels_of_any_script_are_readable_and_quoted():
    label = '杯子 "</script>'
    row = make_landmark(0)
    named = Map([type(row)(**{name: getattr(row, name) for name in row.__slots__} | {"label": label, "labels": {label: 1.0}})])
    text = named.to_json().decode()
    assert '杯子 \\"</script>' in text
    assert parse_document(text.encode(), "it").landmarks[0].label == label


@pytest.mark.parametrize("field", ["label", "category"])
def test_half_of_a_surrogate_pair_is_refused(field):
    with pytest.raises(MapError, match="no valid Unicode"):
        Map([replace(make_landmark(1), labels={"\ud800": 1.0}, **{"label": "\ud800", field: "\ud800"})]).to_json()


@pytest.mark.parametrize(
    "text", ["<script>alert(1)</script>", "'); DROP TABLE landmark; --", "a\x00b\x1b[31m\u202e", '"}],"tentative":[', "x" * 100_000]
)
def test_hostile_labels_and_categories_come_back_letter_by_letter(tmp_path, text):
    Map([replace(make_landmark(1), label=text, category=text, labels={text: 1.0})]).save(tmp_path)
    (row,) = Map.load(tmp_path).landmarks
    assert (row.label, row.category, dict(row.labels)) == (text, text, {text: 1.0})


def test_a_write_that_fails_leaves_the_old_file_and_no_draft(tmp_path, monkeypatch):
    path = tmp_path / "map.json"
    write_atomically(path, b"old")

    def no_disk(handle):
        raise OSError("no space left")

    monkeypatch.setattr("os.fsync", no_disk)
    with pytest.raises(MapError, match="no space left"):
        write_atomically(path, b"new")
    assert path.read_bytes() == b"old"
    assert [file.name for file in tmp_path.iterdir()] == ["map.json"]
