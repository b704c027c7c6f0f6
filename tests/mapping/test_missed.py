"""DualMap's checks with existence beside them: what is missed where it should be seen does not stay, what is hidden does."""

import numpy as np
import pytest
from living_map import LivingMap

from painted_blocks import Block

CUP, BOOK, LAMP, SHOE = Block("cup", -0.3), Block("book", 0.0), Block("lamp", 0.3), Block("shoe", 0.1, -0.25)
DESK = {0: CUP, 1: BOOK, 2: LAMP, 3: SHOE}
REST = {i: block for i, block in DESK.items() if i != 0}


def desk_of(existence, **status):
    made = LivingMap(status={"existence": existence, **status})
    happened = made.see(DESK, times=12)
    assert sorted(happened) == [("stable", i) for i in DESK]
    return made


def test_what_is_taken_away_is_lost_and_then_removed_but_never_in_the_paper():
    assert desk_of(True).see(REST, times=12) == [("lost", 0), ("removed", 0)]
    assert desk_of(False).see(REST, times=40) == []


def test_what_is_lost_and_seen_again_is_found():
    desk = desk_of(True)
    while ("lost", 0) not in desk.see(REST):
        assert desk.keyframes < 40
    assert desk.see(DESK, times=6) == [("found", 0)]
    assert desk.state(0) == "stable"


def test_what_stands_behind_something_else_stays():
    desk = desk_of(True)
    assert desk.see(REST, there=DESK, before=[Block("screen", CUP.x, CUP.y, 0.9, 0.12)], times=40) == []
    assert desk.state(0) == "stable"


@pytest.mark.parametrize("existence", [True, False])
def test_a_mistake_that_comes_back_now_and_then_is_stable_only_in_the_paper(existence):
    desk = desk_of(existence)
    ghost = Block("vase", -0.1, 0.25)
    rng = np.random.default_rng(1)
    for view in range(60):
        desk.see({**DESK, 4: ghost} if view == 0 or (4 in desk.objects and rng.uniform() < 0.25) else DESK, there=DESK)
    assert ((4 in desk.objects) and desk.state(4) == "stable") is not existence


@pytest.mark.parametrize("existence", [True, False])
def test_what_never_became_stable_and_is_not_found_again_leaves_the_map_without_waiting_for_silence(existence):
    desk = desk_of(existence, silent_keyframes=1000)
    desk.see({**DESK, 4: Block("vase", -0.1, 0.25)}, there=DESK)
    desk.see(DESK, times=30)
    assert desk.ids() == ([0, 1, 2, 3] if existence else [0, 1, 2, 3, 4])
