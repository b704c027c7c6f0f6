"""What of a model's text is found to be true of a map."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from seo_slam.ask.claims import fault_in, ids_in

POSITIONS = {1: np.array([-0.32, -0.48, 0.04]), 4: np.array([-0.34, 0.34, 0.05]), 12: np.array([2.0, 0.117, 1.0])}


@pytest.mark.parametrize(
    "text",
    [
        "The boot (1) or the green one (4).",
        "Landmarks 1, 4 and 12 would do; see also [12] and #4.",
        "Both (1, 4) do.",
        "At (-0.32, -0.48), or in full [-0.32, -0.48, 0.04].",
        "At x -0.3, y = -0.5, z: 0.04 m.",
        "It lies 0.75 m from the chair, and is 10 cm high.",
        "At -0.34, 0.34.",
        "At (\u22120.32, \u22120.48).",
        "There are 2 pairs, size 42, from 2019; 100 % sure.",
        "Landmark 4, 5 cm above the floor.",
        "The 3 boots: 1. the brown one, 2. the green one.",
        "",
    ],
)
def test_what_the_map_says_may_be_said(text):
    assert fault_in(text, POSITIONS, [0.75, 0.1]) == ""


@pytest.mark.parametrize(
    "text",
    [
        "The boot (2).",
        "The boot [ #2 ].",
        "Landmarks 1, 4 and 13.",
        "landmark #3",
        "Both (1, 5).",
        "At (-0.34, -0.48).",
        "At (0.32, 0.48, 0.04).",
        "At (-0.32, -0.48, 0.04, 1.0).",
        "At \uff08-0.3\uff0c 9.9\uff09.",
        "At 1.25, 7.",
        "At x 3.2.",
        "At Y=-0.9.",
        "3 m to the left.",
        "about 3.5 meters away",
        "80cm away",
        "6 feet away",
        "(\u0667)",
    ],
)
def test_what_the_map_does_not_say_is_found(text):
    assert fault_in(text, POSITIONS, [0.75, 0.1])


def test_ids_come_in_their_order():
    assert ids_in("First (4), then landmark 1 or [12], and (4) again", POSITIONS) == (4, 1, 12)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=80) | st.text("0123456789.,-+()[]{}#xyzm \n;|", max_size=80))
def test_any_text_can_be_checked(text):
    fault = fault_in(text, POSITIONS, [0.1])
    assert len(fault) < 200
    if not fault:
        assert set(ids_in(text, POSITIONS)) <= set(POSITIONS)
