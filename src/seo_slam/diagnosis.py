"""What is installed here, and what more could be: for bug reports and for whoever wonders why a plug-in is not found."""

import os
import platform
import re
import sqlite3
import sys
from dataclasses import asdict, dataclass
from importlib import metadata
from typing import Any

import seo_slam
from seo_slam import registry
from seo_slam.errors import SeoSlamError

_DISTRIBUTION = "seo-slam"
# The extras that users choose, and what each adds. The packages are read from the installed metadata.
EXTRAS = {
    "yolox": "the detector 'yolox' (ONNX weights of your own)",
    "minilm": "the embedder 'minilm': a real text embedding on a machine without a model hub",
    "sim": "simulated worlds with meshes, and drawing that is many times faster",
    "nav": "abstract maps with rooms, and walking to things by name",
}


@dataclass(frozen=True, slots=True)
class Package:
    """A package from outside and its installed version, None where it is not installed."""

    name: str
    version: str | None


@dataclass(frozen=True, slots=True)
class Extra:
    """An optional part: what it adds, its packages, and the command that installs it."""

    name: str
    adds: str
    packages: tuple[Package, ...]
    install: str

    @property
    def installed(self) -> bool:
        """Whether all of its packages are there."""
        return all(package.version is not None for package in self.packages)


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The state of an installation.

    Attributes:
        seo_slam, python, platform: versions.
        cores: processors that this process may use.
        sqlite, sqlite_rtree: version of SQLite, and whether its R*Tree is built in (the store "sqlite" needs it).
        packages: the required packages.
        extras: the optional ones.
        embedder: name of the model that the embedder "auto" takes here, or why it takes none.
        plug_ins: kind -> names that the registry knows, those of other installed packages included.
    """

    seo_slam: str
    python: str
    platform: str
    cores: int
    sqlite: str
    sqlite_rtree: bool
    packages: tuple[Package, ...]
    extras: tuple[Extra, ...]
    embedder: str
    plug_ins: dict[str, tuple[str, ...]]

    @property
    def problems(self) -> tuple[str, ...]:
        """What is missing of what is required, in words."""
        found = [f"{package.name} is required and not installed" for package in self.packages if package.version is None]
        if not self.sqlite_rtree:
            found.append(f"SQLite {self.sqlite} has no R*Tree: the store 'sqlite' will not work")
        return tuple(found)

    def as_dict(self) -> dict[str, Any]:
        """The diagnosis as JSON types."""
        content = asdict(self)
        for entry, extra in zip(content["extras"], self.extras, strict=True):
            entry["installed"] = extra.installed
        return {**content, "problems": list(self.problems)}


def diagnose() -> Diagnosis:
    """Look at this installation. Making the embedder "auto" may load its model, which takes seconds."""
    return Diagnosis(
        seo_slam=seo_slam.__version__,
        python=f"{platform.python_implementation()} {platform.python_version()}",
        platform=platform.platform(),
        cores=len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1,
        sqlite=sqlite3.sqlite_version,
        sqlite_rtree=_has_rtree(),
        packages=tuple(_package(name) for name in _required("")),
        extras=tuple(
            Extra(name, adds, tuple(_package(package) for package in _required(name)), f"pip install '{_DISTRIBUTION}[{name}]'")
            for name, adds in EXTRAS.items()
        ),
        embedder=_automatic_embedder(),
        plug_ins={kind: registry.known(kind) for kind in registry.KINDS},
    )


def _required(extra: str) -> list[str]:
    """Names of the packages that the distribution itself ("") or one of its extras asks for."""
    try:
        lines = metadata.requires(_DISTRIBUTION) or []
    except metadata.PackageNotFoundError:  # run from a source folder
        return []
    found = []
    for line in lines:
        name = re.match(r"[A-Za-z0-9._-]+", line)
        of_extra = re.search(r"extra\s*==\s*['\"]([^'\"]+)['\"]", line)
        if name and (of_extra.group(1) if of_extra else "") == extra:
            found.append(name.group(0))
    return found


def _package(name: str) -> Package:
    try:
        return Package(name, metadata.version(name))
    except metadata.PackageNotFoundError:
        return Package(name, None)


def _has_rtree() -> bool:
    connection = sqlite3.connect(":memory:")
    try:
        connection.execute("CREATE VIRTUAL TABLE probe USING rtree(id, low, high)")
    except sqlite3.OperationalError:
        return False
    finally:
        connection.close()
    return True


def _automatic_embedder() -> str:
    try:
        return str(registry.create("embedder", "auto").name)
    except SeoSlamError as error:
        return f"none: {error}"
