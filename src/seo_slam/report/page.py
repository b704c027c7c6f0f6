"""The shell of a page: one HTML file that holds its style, its script and its data, and loads nothing."""

import base64
import hashlib
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from seo_slam.report.escaping import escaped, script_json


def document(title: str, main: str, data: Mapping[str, Any], more_style: str = "") -> str:
    """Return a whole page.

    Args:
        title: text.
        main: HTML of the body.
        data: what a program finds in ``#report-data``.
        more_style: CSS beside that of every report.
    """
    style, script = packaged("report.css") + more_style, packaged("report.js")
    digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
    # Should an escape ever be missed, the browser still runs no script but ours and loads nothing from anywhere.
    policy = (
        f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{digest}'; base-uri 'none'; form-action 'none'"
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><meta name="color-scheme" content="light dark">'
        f'<title>{escaped(title)}</title><link rel="icon" href="data:,"><style>{style}</style></head>\n'
        f"<body><main>{main}</main>\n"
        f'<script type="application/json" id="report-data">{script_json(data)}</script>\n'
        f"<script>{script}</script></body></html>\n"
    )


def section(name: str, title: str, body: str) -> str:
    """A part of a page under a heading; ``body`` is HTML."""
    return f'<section id="{name}-section"><h2>{title}</h2>{body}</section>'


def packaged(name: str) -> str:
    """Return a text file that lies beside this module."""
    return resources.files("seo_slam.report").joinpath(name).read_text(encoding="utf-8")


def write_whole(path: str | Path, text: str) -> None:
    """Write a text file; an older one is replaced only once the new one is complete.

    Raises:
        OSError: it cannot be written.
    """
    target = Path(path)
    unfinished = target.with_name(target.name + ".part")
    unfinished.write_text(text, encoding="utf-8", newline="\n")
    os.replace(unfinished, target)
