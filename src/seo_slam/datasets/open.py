"""Open a recording by the name of its layout."""

import difflib
import inspect
from pathlib import Path
from typing import Any

from seo_slam.datasets.folder import DEPTH_FOLDERS, RGB_FOLDERS, FolderDataset
from seo_slam.datasets.recording import Recording, contents, require_folder
from seo_slam.datasets.tum import DEPTH_LIST, RGB_LIST, TumDataset
from seo_slam.errors import ConfigError, DatasetError

READERS: dict[str, type[Recording]] = {"tum": TumDataset, "folder": FolderDataset}
KINDS = ("auto", *READERS)


def detect_kind(path: str | Path) -> str:
    """Return "tum" or "folder", whichever layout a recording has.

    Raises:
        DatasetError: neither; the message says what was found and what was wanted.
    """
    folder = require_folder(path)
    if (folder / RGB_LIST).is_file() or (folder / DEPTH_LIST).is_file():
        return "tum"
    if any((folder / name).is_dir() for name in RGB_FOLDERS) and any((folder / name).is_dir() for name in DEPTH_FOLDERS):
        return "folder"
    raise DatasetError(
        f"{folder}: not a recording of a known layout: found {contents(folder)}; wanted {RGB_LIST} and {DEPTH_LIST} (kind tum), or "
        "folders rgb/ and depth/ (kind folder)"
    )


def open_dataset(kind: str, path: str | Path, **options: Any) -> Recording:
    """Open a recording.

    Args:
        kind: "tum", "folder", or "auto" to look.
        path: its folder.
        options: those of ``TumDataset`` or ``FolderDataset``; None counts as not given.

    Raises:
        ConfigError: unknown kind or option; the message lists the known ones.
        DatasetError: the recording cannot be read.
    """
    if kind not in KINDS:
        near = difflib.get_close_matches(kind, KINDS, n=1)
        raise ConfigError(f"unknown kind of recording {kind!r}{f'; did you mean {near[0]!r}?' if near else ''} (known: {', '.join(KINDS)})")
    reader = READERS[detect_kind(path) if kind == "auto" else kind]
    known = [name for name in inspect.signature(reader).parameters if name != "path"]
    given = {name: value for name, value in options.items() if value is not None}
    for name in given:
        if name not in known:
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ConfigError(f"a recording of kind {kind!r} has no option {name!r}{hint} (known: {', '.join(known)})")
    return reader(path, **given)  # type: ignore[arg-type]  # every reader but the base takes the folder first
