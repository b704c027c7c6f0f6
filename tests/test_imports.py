"""The layers of the package: who may import whom, what loads with `import seo_slam`, and how long a file may be."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import seo_slam

SOURCE = Path(seo_slam.__file__).parent

# Each unit may import only units that stand before it (and itself). A package is one unit.
ORDER = (
    "errors",
    "geometry",
    "camera",
    "types",
    "records",
    "interfaces",
    "settings",
    "config",
    "registry",  # it names everything else as strings only, so that a part can make its default part by name
    "perception",
    "association",
    "mapping",
    "abstraction",
    "navigation",
    "agents",
    "evaluation",
    "datasets",
    "simulation",
    "map_document",
    "map_clouds",
    "map_features",
    "map",
    "map_export",
    "undo",
    "ask",
    "stages",
    "composition",
    "measuring",
    "abstraction_host",
    "keeping",
    "agent_host",
    "run_result",
    "pipeline",
    "run_files",
    "diagnosis",
    "backends",
    "report",
    "run_recording",
    "driving",
    "testing",
    "cli",
)

# Packages from outside, and the units that may use them. Backends may use any.
EVERYWHERE = {"numpy", "pydantic", "pydantic_core"}
ALLOWED = {
    "scipy": {"perception", "association", "mapping", "abstraction", "navigation", "evaluation", "simulation"},
    "networkx": {"navigation", "abstraction"},
    "skimage": {"navigation", "abstraction"},
    "trimesh": {"simulation"},
    "embreex": {"simulation"},
    "cv2": {"perception", "agents", "datasets", "simulation", "report"},
    "yaml": {"config"},
    "typer": {"cli"},
    "click": {"cli"},
    "rich": {"cli"},
}
HEAVY = (
    "scipy",
    "networkx",
    "skimage",
    "gtsam",
    "cv2",
    "httpx",
    "torch",
    "sentence_transformers",
    "onnxruntime",
    "trimesh",
    "embreex",
    "typer",
    "rich",
)


def unit_of(path):
    """The unit a file belongs to: its package, or its own name; "" for the front door, seo_slam/__init__.py."""
    first = path.relative_to(SOURCE).parts[0]
    return "" if first == "__init__.py" else first.removesuffix(".py")


def imported_modules(tree):
    """Absolute names that a file imports, at any depth, but for those only the type checker sees; relative ones start with a dot."""
    hidden = {
        id(node)
        for block in ast.walk(tree)
        if isinstance(block, ast.If) and "TYPE_CHECKING" in ast.dump(block.test)
        for statement in block.body
        for node in ast.walk(statement)
    }
    for node in ast.walk(tree):
        if id(node) in hidden:
            continue
        if isinstance(node, ast.Import):
            yield from ((alias.name, node.lineno) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level:
                yield "." * node.level + (node.module or ""), node.lineno
            elif node.module == "seo_slam":
                yield from ((f"seo_slam.{alias.name}", node.lineno) for alias in node.names)
            else:
                yield node.module, node.lineno


def violations(source, unit):
    """What is wrong with the imports of a file of ``unit``, one line each."""
    found = []
    for name, line in imported_modules(ast.parse(source)):
        top, _, rest = name.partition(".")
        if name.startswith("."):
            found.append(f"line {line}: relative import; write it in full")
        elif top == "seo_slam":
            other = rest.partition(".")[0]
            if other and (SOURCE / other).exists() is False and (SOURCE / f"{other}.py").exists() is False:
                continue  # an attribute of the front door, for example __version__
            if other and unit and other != unit:
                if other not in ORDER:
                    found.append(f"line {line}: {other} has no place in ORDER")
                elif ORDER.index(other) > ORDER.index(unit):
                    found.append(f"line {line}: {unit} imports {other}, which stands after it")
        elif top not in sys.stdlib_module_names and top not in EVERYWHERE and unit not in {"backends", *ALLOWED.get(top, set())}:
            found.append(f"line {line}: {unit or 'seo_slam/__init__.py'} imports {top}")
    return found


def sources():
    return sorted(SOURCE.rglob("*.py"))


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(SOURCE)))
def test_imports_go_upward_only(path):
    unit = unit_of(path)
    assert not unit or unit in ORDER, f"{unit} is new: give it a place in ORDER"
    assert violations(path.read_text(encoding="utf-8"), unit) == []


@pytest.mark.parametrize(
    ("source", "unit", "message"),
    [
        ("from seo_slam.cli.app import app", "mapping", "mapping imports cli"),
        ("from seo_slam import registry", "types", "types imports registry"),
        ("def late():\n    import seo_slam.report", "config", "config imports report"),
        ("import torch", "perception", "perception imports torch"),
        ("from scipy.optimize import minimize", "datasets", "datasets imports scipy"),
        ("import cv2.aruco", "mapping", "mapping imports cv2"),
        ("import rich", "report", "report imports rich"),
        ("from . import types", "mapping", "relative import"),
        ("import httpx", "", r"seo_slam/__init__.py imports httpx"),
    ],
)
def test_the_test_sees_a_violation(source, unit, message):
    (found,) = violations(source, unit)
    assert message in found


@pytest.mark.parametrize(
    ("source", "unit"),
    [
        ("import numpy as np\nimport json\nfrom seo_slam.types import Frame", "perception"),
        ("from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from seo_slam.cli import app", "mapping"),
        ("import torch\nimport gtsam", "backends"),
        ("from seo_slam.mapping.nearby import x", "mapping"),
        ("import seo_slam\nfrom seo_slam import __version__", "cli"),
    ],
)
def test_the_test_lets_good_imports_pass(source, unit):
    assert violations(source, unit) == []


def test_importing_the_package_loads_nothing_heavy():
    code = f"import seo_slam, sys; print([name for name in {HEAVY} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("path", sources(), ids=lambda path: str(path.relative_to(SOURCE)))
def test_no_file_is_longer_than_400_lines(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 400
