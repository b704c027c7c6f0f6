"""Settings: files, presets and single assignments, and errors that name the misspelt key and the one that was meant."""

import json

import pytest

from seo_slam.config import PRESETS, Component, Config, read_settings
from seo_slam.errors import ConfigError

TOML = """
seed = 3

[detector]
name = "yolox"
options = { weights = "w.onnx", score = 0.25 }

[keyframes]
period_s = 0.25

[[agents]]
name = "mine:Agent"
"""

YAML = """
seed: 3
detector: {name: yolox, options: {weights: w.onnx, score: 0.25}}
keyframes:
  period_s: 0.25
agents:
  - name: mine:Agent
"""


@pytest.fixture
def write(tmp_path):
    def file(name, text):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return file


def test_toml_and_yaml_say_the_same(write):
    configs = [Config.from_file(write("a.toml", TOML)), Config.from_file(write("a.yaml", YAML)), Config.from_file(write("a.yml", YAML))]
    assert configs[0] == configs[1] == configs[2]
    assert configs[0].detector == Component(name="yolox", options={"weights": "w.onnx", "score": 0.25})
    assert configs[0].keyframes.period_s == 0.25
    assert configs[0].keyframes.distance_m == Config().keyframes.distance_m
    assert configs[0].agents == (Component(name="mine:Agent"),)


def test_empty_files_are_the_defaults(write):
    assert Config.from_file(write("a.toml", "")) == Config.from_file(write("a.yaml", "# nothing\n")) == Config()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.toml", "seed = ", ["does not parse"]),
        ("a.toml", b"\xff\xfe", ["does not parse"]),
        ("a.yaml", "a: [1", ["does not parse"]),
        ("a.yaml", "- 1", ["got a list at the top"]),
        ("a.json", "{}", ["'.json'", ".toml"]),
        ("a.toml", "[keyframe]\nperiod_s = 1", ["unknown setting 'keyframe'", "did you mean 'keyframes'"]),
        ("a.toml", "[keyframes]\nperiod = 1", ["unknown setting 'keyframes.period'", "did you mean 'period_s'", "angle_deg"]),
        ("a.toml", "[detector]\nname = 'none'\nscore = 1", ["unknown setting 'detector.score'", "name, options"]),
        ("a.toml", "[keyframes]\nperiod_s = -1", ["keyframes.period_s", "greater than 0", "got -1"]),
        ("a.toml", "[keyframes]\nperiod_s = 'often'", ["keyframes.period_s", "got 'often'"]),
        ("a.toml", "sed = 1\nkeyframes = {perod_s = 1}", ["'seed'", "'period_s'"]),
        ("a.toml", "[[agents]]\nnam = 'x'", ["agents.0"]),
    ],
)
def test_bad_files(write, name, text, words):
    path = write(name, text)
    with pytest.raises(ConfigError) as caught:
        Config.from_file(path)
    for word in (str(path), *words):
        assert word in str(caught.value)


def test_missing_file(tmp_path):
    with pytest.raises(ConfigError, match="no such config file"):
        read_settings(tmp_path / "gone.toml")


@pytest.mark.parametrize("name", sorted(PRESETS))
def test_presets_are_valid(name):
    assert Config.preset(name).seed == 0


def test_unknown_preset():
    known = "dualmap, dualmap_estimated_poses, nearest, rg, rg_a, rg_d, rg_d_a, rg_d_cosine, seo_slam"
    with pytest.raises(ConfigError, match=f"unknown preset 'seo'; known: {known}"):
        Config.preset("seo")


def test_assignments():
    config = Config().with_settings(
        [
            "keyframes.period_s=0.25",
            "association.semantic_gate=cosine",
            "map.merge_duplicates=false",
            "detector.name=mine:Detector",
            "detector.options.weights=a=b.onnx",
            'embedder={"name": "hashed", "options": {"size": 64}}',
        ]
    )
    assert config.keyframes.period_s == 0.25
    assert config.association.semantic_gate == "cosine"
    assert config.map.merge_duplicates is False
    assert config.detector == Component(name="mine:Detector", options={"weights": "a=b.onnx"})
    assert config.embedder.options == {"size": 64}


@pytest.mark.parametrize(
    ("assignment", "words"),
    [
        ("keyframes.period_s", "wanted key=value"),
        ("=3", "wanted key=value"),
        ("seed.x=3", "inside a setting that holds no others"),
        ("keyframe.period_s=1", "did you mean 'keyframes'"),
        ("keyframes.periods=1", "did you mean 'period_s'"),
        ("lifting.max_depth_m=0", "greater than 0"),
        ("association.semantic_gate=fuzzy", "association.semantic_gate"),
    ],
)
def test_bad_assignments(assignment, words):
    with pytest.raises(ConfigError, match=words):
        Config().with_settings([assignment])


def test_updating_keeps_the_other_settings():
    config = Config().with_settings(["keyframes.angle_deg=9"]).updated({"keyframes": {"period_s": 2}, "seed": 5}, "mine")
    assert (config.keyframes.angle_deg, config.keyframes.period_s, config.seed) == (9.0, 2.0, 5)
    with pytest.raises(ConfigError, match=r"^mine: unknown setting"):
        config.updated({"keyframes": {"period": 2}}, "mine")


def test_a_config_survives_json():
    config = Config.preset("nearest")
    assert Config.from_dict(json.loads(config.model_dump_json())) == config


@pytest.mark.parametrize("setting", ["status.enabled=true", "associator.name=overlap"])
def test_what_needs_clouds_says_so(setting):
    with pytest.raises(ConfigError, match=r"needs clouds: set clouds\.enabled"):
        Config().with_settings([setting])
    assert Config().with_settings([setting, "clouds.enabled=true"]).clouds.enabled
