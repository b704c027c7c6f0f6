"""Labels as detectors give them, made safe to show, to write and to hand to a language model."""

import unicodedata
from typing import Any

import numpy as np

from seo_slam.errors import FrameError

MAX_LABEL_CHARACTERS = 80
"""Longer labels are cut: a label is a word or two, not a text."""

_JOINERS = "\u200c\u200d"  # part of the spelling of some scripts, so kept
_HIDDEN_CATEGORIES = {"Cc", "Cf", "Cs", "Co", "Cn"}


def clean_label(label: Any) -> str | None:
    """Return a label as one line of visible text of at most 80 characters.

    Control characters, invisible marks (text direction and the like) and lone surrogates are taken out, runs of white space become one
    blank, a letter and its accent become one character (Unicode's NFC), so that a word has one spelling. A whole number, the class of a
    detector that knows no words, becomes "class 3".

    Args:
        label: text, a whole number, or None.

    Returns:
        None where there is no label, or nothing visible in it.

    Raises:
        FrameError: it is neither text, whole number nor None.
    """
    if label is None:
        return None
    if isinstance(label, int | np.integer) and not isinstance(label, bool | np.bool_):
        return f"class {int(label)}"
    if not isinstance(label, str):
        raise FrameError(f"got a label of type {type(label).__name__} ({label!r:.40}), wanted text or None")
    text = str(label)
    if not (text.isascii() and text.isprintable()):  # the usual label skips the walk over its characters
        text = unicodedata.normalize("NFC", "".join(_visible(c) for c in text))
    return " ".join(text.split())[:MAX_LABEL_CHARACTERS].rstrip() or None


def _visible(character: str) -> str:
    if character.isspace():
        return " "
    if unicodedata.category(character) in _HIDDEN_CATEGORIES and character not in _JOINERS:
        return ""
    return character
