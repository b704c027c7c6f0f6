"""Messages are counted, and never kept without bound."""

from seo_slam.agents.message_tally import ALIKE, MOST_MESSAGES, OTHERS, MessageTally


def counted(messages):
    tally = MessageTally()
    tally.add(messages)
    return tally.as_dict()


def test_a_message_is_told_as_it_came_and_counted():
    assert counted(["no detections", "2 boxes are empty", "no detections"]) == {"no detections": 2, "2 boxes are empty": 1}


def test_messages_that_differ_in_numbers_only_are_counted_together_beyond_a_few():
    found = counted([f"HTTP 503, another try in {0.25 * k} s" for k in range(1000)])
    assert len(found) == ALIKE + 1
    assert next(iter(found)) == "HTTP 503, another try in 0.0 s"
    assert found["HTTP 503, another try in 0.0 s (and the like)"] == 1000 - ALIKE


def test_whatever_comes_memory_is_bounded_and_nothing_is_lost():
    found = counted(["".join(chr(97 + int(digit)) for digit in str(k)) for k in range(5000)])
    assert len(found) == MOST_MESSAGES + 1
    assert sum(found.values()) == 5000
    assert found[OTHERS] == 5000 - MOST_MESSAGES
