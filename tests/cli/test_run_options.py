"""How the options of ``seo-slam run``, its config file and its settings go together, on a small simulated recording."""

import json

import pytest
from typer.testing import CliRunner

from seo_slam import SimulatedDesk
from seo_slam.backends.sqlite_store import SqliteStore
from seo_slam.cli import app as application
from seo_slam.errors import ConfigError

FOREIGN = """
from seo_slam.backends.visual_odometry import VisualOdometry

class Theirs(VisualOdometry):
    pass
"""


@pytest.fixture(scope="module")
def desk(tmp_path_factory):
    folder = tmp_path_factory.mktemp("desk")
    SimulatedDesk(frames=8).write(folder)
    return folder


@pytest.fixture
def run(desk, tmp_path):
    """Run the command on the desk; raise what ``main`` would print."""

    def run(*arguments, out="out", recording=desk):
        fixed = ["run", "tum", recording, "--out", tmp_path / out, "--set", "embedder.name=hashed", "--json"]
        result = CliRunner().invoke(application.app, [str(a) for a in (*fixed, *arguments)])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        assert result.exit_code == 0, result.stderr
        return json.loads(result.stdout), result.stderr

    return run


def test_the_detector_named_on_the_command_line_takes_nothing_from_another_one_in_the_file(run, desk, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text('[detector]\nname = "yolox"\noptions = {weights = "theirs.onnx", threads = 2}\n')
    ran, _ = run("--config", file, "--detector", "recorded", "--detections", desk / "detections.jsonl")
    assert ran["config"]["detector"] == {"name": "recorded", "options": {"path": str(desk / "detections.jsonl")}}
    assert ran["counts"]["detections"] > 0


def test_no_detector_is_said(run):
    assert "--detector" in run()[1]


def test_the_store_takes_its_options_from_the_settings(run, tmp_path, monkeypatch):
    made = []
    real = SqliteStore.__init__
    monkeypatch.setattr(SqliteStore, "__init__", lambda self, *a, **k: (made.append(k.get("durability")), real(self, *a, **k))[1])
    run("--set", "store.options.durability=full")
    assert made[-1] == "full"
    assert (tmp_path / "out" / "map.db").is_file()


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("store.name=postgres", "map.db of --out"),
        ('store.options.path="elsewhere.db"', "map.db of --out"),
        ("store.options.durability=ful", "durability: got 'ful'"),
        ("store.options.durabilty=full", "did you mean 'durability'"),
        ("odometry.options.sigma_m=abc", "odometry 'recorded'.*abc"),
        ("keyframes.period_s=Infinity", "keyframes.period_s.*finite"),
        ("detector.name=..:Detector", "unknown detector"),
    ],
)
def test_a_setting_that_cannot_be_is_refused_before_anything_is_written(run, tmp_path, setting, words):
    with pytest.raises((ConfigError, LookupError), match=words):
        run("--set", setting)
    assert not (tmp_path / "out").exists()


def test_poses_to_replay_are_not_ignored(run, desk, tmp_path):
    with pytest.raises(ConfigError, match="--trajectory goes with --odometry recorded"):
        run("--odometry", "visual", "--trajectory", desk / "groundtruth.txt")
    file = tmp_path / "mine.yaml"
    file.write_text("odometry: {name: recorded, options: {trajectory: no_such_file.txt}}\n")
    run("--config", file, "--trajectory", desk / "groundtruth.txt")  # the command line wins


def test_an_odometry_of_ones_own_is_used_where_there_are_no_poses(run, desk, tmp_path, monkeypatch):
    (tmp_path / "foreign_odometry.py").write_text(FOREIGN)
    monkeypatch.syspath_prepend(tmp_path)
    bare = tmp_path / "bare"
    SimulatedDesk(frames=4).write(bare)
    for name in ("odometry.txt", "groundtruth.txt"):
        (bare / name).unlink()
    ran, _ = run("--set", "odometry.name=foreign_odometry:Theirs", recording=bare)
    assert ran["config"]["odometry"]["name"] == "foreign_odometry:Theirs"
