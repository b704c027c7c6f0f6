"""Without the extra "nav", planners and rooms say what to install."""

import importlib
import sys

import pytest

import seo_slam.abstraction.rooms
import seo_slam.navigation.global_planner  # noqa: F401
from seo_slam.errors import MissingBackendError


@pytest.mark.parametrize(
    ("module", "package"),
    [
        ("seo_slam.navigation.global_planner", "networkx"),
        ("seo_slam.navigation.global_planner", "skimage.morphology"),
        ("seo_slam.navigation.skeleton_graph", "networkx"),
        ("seo_slam.abstraction.rooms", "skimage.segmentation"),
    ],
)
def test_a_missing_package_is_named_with_its_extra(monkeypatch, module, package):
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, module)
    with pytest.raises(MissingBackendError, match=r"seo-slam\[nav\]"):
        importlib.import_module(module)
