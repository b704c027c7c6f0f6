"""Images carry where their pixels come from, and other people's JPEGs do no harm."""

import json
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.agents.provenance import Panel, Provenance, provenance_of, with_provenance

JPEG = cv2.imencode(".jpg", np.random.default_rng(0).integers(0, 255, (40, 60, 3), dtype=np.uint8))[1].tobytes()
NOTE = Provenance(12.34, 640, 480, (Panel((10, 20, 110, 120), (0, 0, 256, 256), {"1": (20.5, 30, 200, 210)}),))


def commented(comment):
    return JPEG[:2] + struct.pack(">BBH", 0xFF, 0xFE, len(comment) + 2) + comment + JPEG[2:]


def test_a_note_comes_back_and_the_picture_is_the_same():
    marked = with_provenance(JPEG, NOTE)
    assert provenance_of(marked) == NOTE
    before, after = (cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR) for data in (JPEG, marked))
    assert np.array_equal(before, after)


def test_the_note_is_the_first_segment_and_names_its_form():
    marked = with_provenance(JPEG, NOTE)
    assert marked[2:4] == b"\xff\xfe"
    note = json.loads(marked[6 : 4 + int.from_bytes(marked[4:6], "big")])
    assert note["seo_slam"] == 1
    assert set(note) == {"seo_slam", "timestamp_s", "width", "height", "panels"}
    assert set(note["panels"][0]) == {"source", "target", "boxes"}


def test_a_panel_maps_there_and_back():
    panel = NOTE.panels[0]
    assert panel.in_image((10, 20, 60, 70)) == (0, 0, 128, 128)
    assert panel.in_frame(panel.in_image((33, 44, 55, 66))) == pytest.approx((33, 44, 55, 66))


@pytest.mark.parametrize(
    "comment",
    [
        b"Created with a camera",
        b"\xff\x00",
        b"[]",
        b"{}",
        b'{"seo_slam": 2, "panels": []}',
        b'{"seo_slam": 1, "timestamp_s": "x", "width": 1, "height": 1, "panels": []}',
        b'{"seo_slam": 1, "timestamp_s": NaN, "width": 1, "height": 1, "panels": []}',
        b'{"seo_slam": 1, "timestamp_s": 1, "width": 1, "height": 1, "panels": 3}',
        b'{"seo_slam": 1, "timestamp_s":1,"width":1,"height":1, "panels": [{"source": [0, 0, 0, 0], "target": [0, 0, 1, 1], "boxes": {}}]}',
        b'{"seo_slam": 1, "timestamp_s":1,"width":1,"height":1, "panels": [{"source": [0, 0, 1, 1], "target": [0, 0, 1, 1], "boxes": 7}]}',
        b'{"a":' * 5000,
    ],
)
def test_a_comment_of_somebody_else_is_none(comment):
    assert provenance_of(commented(comment)) is None


def test_a_foreign_comment_before_ours_is_passed_over():
    ours = with_provenance(JPEG, NOTE)
    both = ours[:2] + struct.pack(">BBH", 0xFF, 0xFE, 7) + b"hello" + ours[2:]
    assert provenance_of(both) == NOTE


@given(st.binary(max_size=60), st.integers(0, 400))
def test_any_bytes_are_read_without_error(tail, cut):
    assert provenance_of(tail) is None
    provenance_of(with_provenance(JPEG, NOTE)[:cut] + tail)


def test_what_is_no_jpeg_or_too_long_is_refused():
    with pytest.raises(ValueError, match="wanted a JPEG"):
        with_provenance(b"\x89PNG", NOTE)
    many = Provenance(0.0, 1, 1, tuple(NOTE.panels) * 2000)
    with pytest.raises(ValueError, match="65533"):
        with_provenance(JPEG, many)
