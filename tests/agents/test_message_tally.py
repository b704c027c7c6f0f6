"""Messages are counted, and never kept without bound."""

from hypothesis import given
from hypothesis import strategies as st

from seo_slam.agents.message_tally import MOST_MESSAGES, OTHERS, MessageTally


def counted(messages):
    tally = MessageTally()
    tally.add(messages)
    return tally.as_dict()


def test_a_message_is_told_as_it_came_and_counted():
    assert counted(["no detections", "2 boxes are empty", "no detections"]) == {"no detections": 2, "2 boxes are empty": 1}


def test_messages_that_differ_in_numbers_only_are_one_with_the_largest():
    depth = [f"{few} of {all_} detections have too little depth" for few, all_ in ((1, 5), (2, 7), (2, 12), (1, 30), (2, 7))]
    assert counted([*depth, "no detections"]) == {"2 of 12 detections have too little depth (and the like)": 5, "no detections": 1}


def test_a_message_for_each_time_is_one():
    found = counted([f"HTTP 503, another try in {0.25 * k} s" for k in range(1000)])
    assert found == {"HTTP 503, another try in 249.75 s (and the like)": 1000}


def test_whatever_comes_memory_is_bounded_and_nothing_is_lost():
    found = counted(["".join(chr(97 + int(digit)) for digit in str(k)) for k in range(5000)])
    assert len(found) == MOST_MESSAGES + 1
    assert sum(found.values()) == 5000
    assert found[OTHERS] == 5000 - MOST_MESSAGES


@given(st.lists(st.text("ab 0123456789.e+-", max_size=12), max_size=40))
def test_nothing_is_lost_and_its_order_tells_nothing(messages):
    found = counted(messages)
    assert sum(found.values()) == len(messages)
    assert dict(sorted(counted(messages[::-1]).items())) == dict(sorted(found.items()))
