"""``seo-slam export``."""

import sys

import pytest

from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.cli import app as application
from seo_slam.map import Map
from seo_slam.map_export import to_csv, to_ply
from seo_slam.testing.store import make_landmark, make_record


@pytest.fixture
def run(monkeypatch, capsysbinary):
    def call(*words):
        monkeypatch.setattr(sys, "argv", ["seo-slam", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            application.main()
        out, err = capsysbinary.readouterr()
        return ended.value.code or 0, out, err.decode()

    return call


@pytest.fixture
def made():
    return Map([make_landmark(0), make_landmark(2, state="tentative")], "poses", "hashed")


def test_each_format_on_standard_output(run, made, tmp_path):
    made.save(tmp_path)
    for name, wanted in (("json", made.to_json()), ("csv", to_csv(made).encode()), ("ply", to_ply(made).encode())):
        assert run("export", tmp_path, "--format", name) == (0, wanted, "")


def test_to_a_file_with_tentative_landmarks(run, made, tmp_path):
    made.save(tmp_path)
    out = tmp_path / "new" / "map.ply"
    assert run("export", tmp_path, "--format", "ply", "--out", out, "--tentative") == (0, b"", "")
    assert out.read_text() == to_ply(made, tentative=True)
    assert "element vertex 16\n" in out.read_text()


def test_a_killed_run_is_turned_into_a_map_file(run, made, tmp_path):
    with SqliteStore(tmp_path / "map.db") as store:
        store.set_meta("gravity", "poses")
        store.set_meta("embedder", "hashed")
        store.commit(make_record(0, landmarks=(*made.landmarks, *made.tentative)))
    status, _, _ = run("export", tmp_path, "--format", "json", "--out", tmp_path / "map.json")
    assert status == 0
    assert (tmp_path / "map.json").read_bytes() == made.to_json()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("export", "{result}", "--format", "xml"), "xml"),
        (("export", "{result}"), "--format"),
        (("export", "{result}/none", "--format", "csv"), "no such map file"),
        (("export", "{result}", "--format", "csv", "--out", "{result}/map.json/x.csv"), "cannot be written"),
    ],
)
def test_mistakes_end_with_a_clear_message(run, made, tmp_path, words, message):
    made.save(tmp_path)
    status, out, err = run(*(word.replace("{result}", str(tmp_path)) for word in words))
    assert (status, out) == (2, b"")
    assert message in err
    assert "Traceback" not in err
