"""Labels come from networks and from text in images: they are shown, written and sent on, so they are made harmless first."""

import unicodedata

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.errors import FrameError
from seo_slam.perception.labels import MAX_LABEL_CHARACTERS, clean_label


@pytest.mark.parametrize(
    ("label", "wanted"),
    [
        ("cup", "cup"),
        ("  cell \n phone\t", "cell phone"),
        ("", None),
        ("\x00\x1b", None),
        (None, None),
        ("cu\x07p", "cup"),
        ("red\u202ecup", "redcup"),  # text direction override
        ("ok\ud800", "ok"),  # a lone surrogate cannot be written to a file
        ("tasse à café", "tasse à café"),
        ("椅子", "椅子"),
        ("cafe\u0301", "caf\u00e9"),  # one word has one spelling
        ("cafe\u200b\u0301", "caf\u00e9"),
        (7, "class 7"),
        (np.int64(7), "class 7"),
        (np.str_("mug"), "mug"),
        ("x" * 100, "x" * 80),
    ],
)
def test_examples(label, wanted):
    assert clean_label(label) == wanted


@given(st.text(st.characters(codec=None), max_size=200))
def test_laws(label):
    clean = clean_label(label)
    if clean is None:
        return
    assert 0 < len(clean) <= MAX_LABEL_CHARACTERS
    assert clean_label(clean) == clean
    assert not any(unicodedata.category(c) in ("Cc", "Cs") for c in clean)
    clean.encode("utf-8")


@pytest.mark.parametrize("label", [3.5, True, b"cup", ["cup"]])
def test_other_types_are_refused(label):
    with pytest.raises(FrameError, match="wanted text or None"):
        clean_label(label)
