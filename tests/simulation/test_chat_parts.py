"""Parts of the simulated vision-language model: reading questions, counting tokens, naming colours, keeping frames."""

import json

import cv2
import numpy as np
import pytest
from drawn_question import question
from hypothesis import given
from hypothesis import strategies as st
from pydantic import BaseModel

from seo_slam.interfaces import ChatRequest
from seo_slam.simulation.chat_question import AskedBox, question_of
from seo_slam.simulation.chat_tokens import image_size, tokens_of_image, tokens_of_question, tokens_of_text
from seo_slam.simulation.colour_words import COLOURS, colour_indices, colours_of_things
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.shown_frames import ShownFrame
from seo_slam.simulation.simple_reply import simplest_reply


@pytest.fixture(scope="module")
def desk_frame():
    """The first frame of the desk: as a recording gives it, and as it is kept."""
    kept = []

    class Keeper:
        def show(self, timestamp_s, view):
            kept.append((view, ShownFrame.of(view)))

    desk = SimulatedDesk(seed=1, frames=2, level=0.0)
    desk.show_to(Keeper())
    return desk.frame(0), *kept[0]


def test_a_kept_frame_has_its_ids_and_places(desk_frame):
    _, view, kept = desk_frame
    assert (kept.instance_ids() == view.rendered.instance_ids).all()
    assert len(kept.packed_ids) + kept.coarse_depth_m.nbytes < 0.15 * view.rendered.instance_ids.nbytes
    p_camera = view.camera.back_project([160.0, 120.0], view.rendered.depth_m[120, 160])
    expected = view.T_world_camera[:3, :3] @ p_camera + view.T_world_camera[:3, 3]
    np.testing.assert_allclose(kept.place_world(160.0, 120.0), expected, atol=0.01)
    assert np.isfinite(kept.place_world(-500.0, 9000.0)).all()


def test_questions_are_read(desk_frame):
    frame, *_ = desk_frame
    box = (10.0, 10.0, 20.0, 20.0)
    read = question_of(question("verification", frame, [box], ['mug"}\n{"', "b"]))
    assert (read.role, read.boxes) == ("verification", (AskedBox(1, 'mug"}\n{"'), AskedBox(2, "b")))
    read = question_of(question("description", frame, [box], ["mug"], known_labels=["red mug"]))
    assert (read.role, read.known_labels) == ("description", ("red mug",))
    read = question_of(question("merging", frame, [box], ["mug"], positions_m=[(1, 2, 3)], separate_beyond_m=0.2))
    assert (read.role, read.boxes[0].position_m, read.separate_beyond_m) == ("merging", (1.0, 2.0, 3.0), 0.2)


@given(
    st.one_of(
        st.text(),
        st.recursive(st.none() | st.integers() | st.text(), lambda s: st.lists(s) | st.dictionaries(st.text(), s)).map(json.dumps),
    )
)
def test_whatever_else_is_asked_is_somebody_elses_question(text):
    assert question_of(ChatRequest("s", text)).role == "other"


def test_broken_landmarks_are_somebody_elses_question():
    for landmarks in ([{"label": "no box"}], [3], "text", None, [{"box": 1, "label": "a", "position_m": [1, 2]}]):
        assert question_of(ChatRequest("s", json.dumps({"landmarks": landmarks}))).role == "other"


def test_tokens_follow_the_stated_rule():
    image = np.zeros((600, 400, 3), dtype=np.uint8)
    jpeg, png = (cv2.imencode(kind, image)[1].tobytes() for kind in (".jpg", ".png"))
    assert image_size(jpeg) == image_size(png) == (400, 600)
    assert tokens_of_image(jpeg) == 85 + 2 * 170
    assert tokens_of_image(b"no image") == 85 + 170
    assert [tokens_of_text(text) for text in ("", "a", "abcd", "abcde")] == [0, 1, 1, 2]
    bare = ChatRequest("abcd", "abcdefgh")
    assert tokens_of_question(bare) == 2 * 4 + 1 + 2
    asked = ChatRequest("abcd", "abcdefgh", (png,), {"a": 1}, turns=(("abcd", "abcd"),))
    assert tokens_of_question(asked) == 4 * 4 + 1 + 2 + 2 + tokens_of_image(png) + tokens_of_text('{"a": 1}')


@given(st.binary(max_size=40))
def test_no_bytes_break_the_token_rule(data):
    for image in (data, b"\xff\xd8" + data, b"\xff\xd8\xff\xe0\x00\x00" + data, b"\x89PNG\r\n\x1a\n" + data):
        assert tokens_of_image(image) > 0


@pytest.mark.parametrize(
    ("rgb", "word"),
    [
        ((250, 250, 250), "white"),
        ((10, 10, 12), "black"),
        ((120, 125, 122), "grey"),
        ((200, 20, 20), "red"),
        ((250, 140, 10), "orange"),
        ((110, 70, 30), "brown"),
        ((230, 215, 30), "yellow"),
        ((30, 160, 50), "green"),
        ((30, 60, 200), "blue"),
        ((120, 40, 170), "purple"),
        ((240, 110, 180), "pink"),
    ],
)
def test_colours_have_their_names(rgb, word):
    assert COLOURS[int(colour_indices(np.array([rgb], dtype=np.uint8))[0])] == word
    image = np.full((4, 4, 3), rgb, dtype=np.uint8)
    assert colours_of_things(image, np.full((4, 4), 7, dtype=np.int32)) == {7: word}


def test_a_thing_has_the_colour_of_most_of_its_pixels():
    image = np.zeros((10, 10, 3), dtype=np.uint8)
    ids = np.zeros((10, 10), dtype=np.int32)
    ids[:5], ids[5:] = 1, 2
    image[:3] = (200, 20, 20)
    for row, rgb in enumerate([(200, 20, 20), (30, 160, 50), (30, 60, 200), (230, 215, 30), (120, 40, 170)], start=5):
        image[row] = rgb
    assert colours_of_things(image, ids) == {1: "red", 2: "colourful"}
    assert colours_of_things(image, np.zeros_like(ids)) == {}


class Inner(BaseModel):
    """Part of a reply."""

    name: str
    share: float | None


class Outer(BaseModel):
    """A reply with everything that a schema may have."""

    ok: bool
    inner: Inner
    many: list[Inner]
    count: int


def test_the_simplest_reply_fits_its_schema():
    said = simplest_reply(ChatRequest("s", "t", schema=Outer.model_json_schema()))
    assert Outer.model_validate_json(said).ok
    assert json.loads(simplest_reply(ChatRequest("s", "t", schema={"type": "object"}))) == {}
    enum = {"type": "object", "properties": {"a": {"enum": ["x", "y"]}, "b": {"const": 3}, "c": {"type": ["string", "null"]}, "d": {}}}
    assert json.loads(simplest_reply(ChatRequest("s", "t", schema=enum))) == {"a": "x", "b": 3, "c": "", "d": None}
