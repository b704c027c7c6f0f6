"""Checks of the project. `nox` runs all of them in one environment; `nox -s tests -- -k name` runs one of them alone."""

import os
import tempfile
from pathlib import Path

import nox

nox.options.sessions = ["all"]
nox.options.reuse_existing_virtualenvs = True
nox.options.error_on_external_run = True

# Runs as a program of its own in the session's environment, where jupytext and nbclient are.
EXECUTE_NOTEBOOK = """
import sys, time, jupytext, nbclient
path, folder = sys.argv[1:]
started = time.monotonic()
notebook = jupytext.read(path)
client = nbclient.NotebookClient(notebook, timeout=120, kernel_name="python3", resources={"metadata": {"path": folder}})
client.execute()
print(f"{path}: {len(notebook.cells)} cells, {time.monotonic() - started:.1f} s")
"""

CHECK_WHEEL = """
import sys, pathlib, importlib.metadata as metadata
import seo_slam
folder = pathlib.Path(sys.argv[1]).resolve()
assert folder in pathlib.Path(seo_slam.__file__).resolve().parents, seo_slam.__file__
assert (folder / "seo_slam" / "py.typed").is_file(), "py.typed is not in the wheel"
(found,) = metadata.distributions(name="seo-slam", path=[str(folder)])
assert found.version == seo_slam.__version__, (found.version, seo_slam.__version__)
assert [point.name for point in found.entry_points if point.group == "console_scripts"] == ["seo-slam"]
print("the wheel installs and imports:", seo_slam.__version__)
"""


def install(session, *what):
    session.install("-c", "constraints.txt", *what)


def run_lint(session):
    session.run("ruff", "check", ".")
    session.run("ruff", "format", "--check", ".")


def run_types(session):
    session.run("mypy", "--strict", "src")


def run_docs(session):
    session.run("zensical", "build", "--clean", "--strict")


def run_notebooks(session):
    notebooks = sorted(Path("examples").glob("*.py"))
    with tempfile.TemporaryDirectory() as folder:
        for notebook in notebooks:
            session.run("python", "-W", "ignore", "-c", EXECUTE_NOTEBOOK, str(notebook), folder, log=False)
    session.log(f"{len(notebooks)} notebooks executed")


def run_build(session):
    with tempfile.TemporaryDirectory() as folder:
        session.run("python", "-m", "build", "--no-isolation", "--outdir", f"{folder}/dist", silent=True)
        (wheel,) = Path(folder, "dist").glob("*.whl")
        session.run("python", "-m", "pip", "install", "--quiet", "--no-deps", "--target", f"{folder}/site", str(wheel))
        session.run("python", "-P", "-c", CHECK_WHEEL, f"{folder}/site", env={"PYTHONPATH": f"{folder}/site"}, log=False)


def run_tests(session):
    session.run("python", "-m", "pytest", *session.posargs, env={"CI": os.environ.get("CI", "")})


@nox.session(name="all")
def everything(session):
    """Every check, in one environment, so that the large packages are installed once. The tests come last."""
    install(session, "-e", ".[dev]", "build", "hatchling")
    for check in (run_lint, run_types, run_docs, run_notebooks, run_build, run_tests):
        check(session)


@nox.session
def lint(session):
    """Style: ruff check and ruff format."""
    install(session, "ruff")
    run_lint(session)


@nox.session
def types(session):
    """Types: mypy --strict."""
    install(session, "-e", ".[dev]")
    run_types(session)


@nox.session
def tests(session):
    """Pytest; what follows -- goes to it."""
    install(session, "-e", ".[dev]")
    run_tests(session)


@nox.session
def notebooks(session):
    """Execute the notebooks of examples/, without network."""
    install(session, "-e", ".[dev]")
    run_notebooks(session)


@nox.session
def docs(session):
    """Build the documentation into site/."""
    install(session, "zensical", "mkdocstrings-python")
    run_docs(session)


@nox.session
def build(session):
    """Build the wheel, install it into an empty folder and import it from there."""
    install(session, "build", "hatchling", "numpy", "pydantic")
    run_build(session)
