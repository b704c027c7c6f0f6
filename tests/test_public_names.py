"""The front door: every public name is there, is loaded only when asked for, and is known to the type checker."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import seo_slam
import seo_slam.errors

PUBLIC = [name for name in seo_slam.__all__ if name != "__version__"]


def names_for_the_type_checker():
    """Name -> module, from the imports that only a type checker sees."""
    tree = ast.parse(Path(seo_slam.__file__).read_text(encoding="utf-8"))
    (hidden,) = (node for node in tree.body if isinstance(node, ast.If))
    return {alias.name: node.module for node in hidden.body for alias in node.names}


@pytest.mark.parametrize("name", PUBLIC)
def test_every_public_name_can_be_had(name):
    value = getattr(seo_slam, name)
    home = seo_slam._HOME[name]
    assert value is getattr(sys.modules[home], name)
    if isinstance(value, type):
        assert value.__module__ == home, f"{name} is defined in {value.__module__}, not in {home}"


def test_a_star_import_gives_them_all():
    names = {}
    exec("from seo_slam import *", names)
    assert set(PUBLIC) <= set(names)


def test_the_tables_agree():
    assert len(set(seo_slam.__all__)) == len(seo_slam.__all__)
    assert sorted(seo_slam._HOME) == sorted(PUBLIC)
    assert names_for_the_type_checker() == seo_slam._HOME


def test_every_error_is_public():
    errors = {name for name, value in vars(seo_slam.errors).items() if isinstance(value, type)}
    assert errors <= set(PUBLIC)


def test_dir_lists_them():
    assert set(seo_slam.__all__) <= set(dir(seo_slam))


def test_no_public_name_is_also_a_module():
    # importing the module would put it in the name's place
    modules = {path.stem if path.suffix == ".py" else path.name for path in Path(seo_slam.__file__).parent.iterdir()}
    assert not modules & set(PUBLIC)


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="no attribute 'Pipelin'"):
        _ = seo_slam.Pipelin
    assert not hasattr(seo_slam, "Detector3000")


def test_the_import_loads_no_part_of_it():
    code = "import seo_slam, sys; print(sorted(name for name in sys.modules if name.startswith('seo_slam.')))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
