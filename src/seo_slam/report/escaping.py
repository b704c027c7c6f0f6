"""Makes text from outside (labels, paths, warnings) safe to stand in HTML, in attributes, in SVG and inside a script element."""

import html
import json
import math
import unicodedata
from collections.abc import Mapping, Sequence, Set
from typing import Any

import numpy as np

LABEL_LIMIT = 120
"""Characters of a label that the report keeps."""
_JOINERS = "\u200c\u200d"  # needed by emoji and by several scripts; every other invisible character goes
_DEEPEST = 12


def clean_text(value: object, limit: int = LABEL_LIMIT) -> str:
    """Return ``str(value)`` on one line, without control, direction and surrogate characters, at most ``limit`` characters."""
    raw = str(value)[: 4 * limit + 64]  # a label of megabytes must not cost seconds
    kept = (c if c.isprintable() or c in _JOINERS else _visible(c) for c in raw)
    line = " ".join("".join(kept).split())
    return line if len(line) <= limit else line[: limit - 1].rstrip() + "…"


def _visible(character: str) -> str:
    return " " if character.isspace() or unicodedata.category(character) == "Cc" else ""


def escaped(value: object, limit: int = LABEL_LIMIT) -> str:
    """Return ``clean_text(value, limit)`` with ``& < > " '`` as entities: fit for element text and quoted attributes."""
    return html.escape(clean_text(value, limit), quote=True)


def plain(value: Any, limit: int = 1000, depth: int = 0) -> Any:
    """Return ``value`` as JSON's types: strings cleaned, arrays as lists, NaN and infinity as None, the rest as text."""
    if value is None or isinstance(value, bool | int):
        return value
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str) or depth > _DEEPEST:
        return clean_text(value, limit)
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist(), limit, depth + 1)
    if isinstance(value, Mapping):
        return {clean_text(key): plain(item, limit, depth + 1) for key, item in value.items()}
    if isinstance(value, Sequence | Set) and not isinstance(value, bytes):
        return [plain(item, limit, depth + 1) for item in value]
    return clean_text(value, limit)


def script_json(data: Any) -> str:
    """Return JSON that is safe between ``<script>`` and ``</script>``: no ``<``, ``>``, ``&`` and nothing beyond ASCII."""
    text = json.dumps(plain(data), allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")
