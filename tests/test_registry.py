"""Plug-ins are found by name, by module:Class and by entry point, and every miss says what to do."""

import sys
from importlib.metadata import EntryPoint
from types import ModuleType

import pytest

from seo_slam import registry
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.no_detector import NoDetector
from seo_slam.config import Component
from seo_slam.errors import ConfigError, MissingBackendError, UnknownBackendError


@pytest.fixture
def module(monkeypatch):
    """An outside module with plug-ins."""
    made = ModuleType("their_slam_parts")
    made.Detector = type("Detector", (), {"__init__": lambda self, threshold=0.5: setattr(self, "threshold", threshold)})
    made.Greedy = lambda **anything: anything
    monkeypatch.setitem(sys.modules, "their_slam_parts", made)
    return made


@pytest.fixture
def announce(monkeypatch, module):
    """Installed packages that announce plug-ins."""

    def points(**names):
        announced = [EntryPoint(name, value, "seo_slam.detectors") for name, value in names.items()]
        monkeypatch.setattr(registry, "entry_points", lambda group: [p for p in announced if p.group == group])

    return points


@pytest.mark.parametrize("kind", registry.KINDS)
def test_every_built_in_name_leads_somewhere(kind):
    for name in registry.known(kind):
        assert callable(registry.find(kind, name))


def test_by_name():
    assert isinstance(registry.create("detector", "none"), NoDetector)
    assert registry.create("embedder", Component(name="hashed", options={"size": 32})).size == 32


def test_groups():
    assert registry.group("detector") == "seo_slam.detectors"
    assert registry.group("odometry") == "seo_slam.odometries"


@pytest.mark.parametrize(
    ("kind", "name", "words"),
    [
        ("detector", "yolo", ["unknown detector 'yolo'", "did you mean 'yolox'", "recorded, yolox", "module:Class"]),
        ("embedder", "qqqq", ["unknown embedder", "auto, hashed, minilm"]),
        ("embedder", ":Class", ["unknown embedder"]),
        ("agent", "verifier", ["unknown agent", "module:Class"]),
        ("detektor", "yolox", ["unknown kind of plug-in 'detektor'", "detector"]),
        ("detector", "their_slam_parts:Detectr", ["module their_slam_parts has no 'Detectr'"]),
        ("detector", "nowhere.at_all:Detector", ["no module 'nowhere'", "PYTHONPATH"]),
        ("detector", "seo_slam.nowhere:Detector", ["no module 'seo_slam.nowhere'"]),
    ],
)
def test_unknown_names(module, kind, name, words):
    with pytest.raises(UnknownBackendError) as caught:
        registry.create(kind, name)
    assert isinstance(caught.value, LookupError)
    for word in words:
        assert word in str(caught.value)


def test_a_missing_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    monkeypatch.delitem(sys.modules, "seo_slam.backends.yolox_detector", raising=False)
    with pytest.raises(MissingBackendError, match=r"detector 'yolox' needs the package 'onnxruntime'.*seo-slam\[yolox\]") as caught:
        registry.create("detector", Component(name="yolox", options={"weights": "w.onnx"}))
    assert isinstance(caught.value, ImportError)


def test_a_missing_package_of_a_plug_in_is_named(tmp_path, monkeypatch):
    (tmp_path / "needy_parts.py").write_text("import a_package_that_is_not_here\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingBackendError, match="pip install a_package_that_is_not_here"):
        registry.create("detector", "needy_parts:Detector")


def test_a_package_missed_by_a_constructor_is_named(module):
    def needy():
        raise ModuleNotFoundError("No module named 'their_engine'", name="their_engine.core")

    module.Needy = needy
    with pytest.raises(MissingBackendError, match="needs the package 'their_engine'"):
        registry.create("detector", "their_slam_parts:Needy")


def test_module_and_class(module):
    made = registry.create("detector", Component(name="their_slam_parts:Detector", options={"threshold": 0.25}))
    assert made.threshold == 0.25


def test_entry_points(announce):
    before = registry.known("detector")
    announce(theirs="their_slam_parts:Detector", none="their_slam_parts:Detector")
    assert registry.known("detector") == tuple(sorted([*before, "theirs"]))
    assert registry.create("detector", "theirs").threshold == 0.5
    assert isinstance(registry.create("detector", "none"), NoDetector)  # a package cannot take a built-in name


def test_context_goes_only_where_it_is_asked_for(module):
    made = registry.create("detector", "their_slam_parts:Detector", threshold=0.1, camera="not asked for")
    assert made.threshold == 0.1
    own = Component(name="their_slam_parts:Detector", options={"threshold": 0.9})
    assert registry.create("detector", own, threshold=0.1).threshold == 0.9


def test_misspelt_option(module):
    with pytest.raises(ConfigError, match=r"has no option 'siz'; did you mean 'size'\? \(known: size\)"):
        registry.create("embedder", Component(name="hashed", options={"siz": 3}))
    with pytest.raises(ConfigError, match=r"'none' has no option 'score'.*known: none"):
        registry.create("detector", Component(name="none", options={"score": 0.3}))
    assert registry.create("detector", Component(name="their_slam_parts:Greedy", options={"any": 1})) == {"any": 1}


def test_needed_option_that_is_missing():
    with pytest.raises(ConfigError, match=r"detector 'yolox' needs the option 'weights' \(detector.options.weights=…\)"):
        registry.create("detector", "yolox")


def test_a_class_is_found_without_being_made():
    assert registry.find("embedder", "hashed") is HashedEmbedder
