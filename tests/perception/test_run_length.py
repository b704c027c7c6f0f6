"""COCO run-length code: what is written comes back, and files of other tools are read."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays

from seo_slam.errors import FrameError
from seo_slam.perception.run_length import decode_mask, encode_mask

masks = arrays(np.bool_, array_shapes(min_dims=2, max_dims=2, max_side=24))


@given(masks)
def test_round_trip(mask):
    code = encode_mask(mask)
    assert np.array_equal(decode_mask(code), mask)
    assert sum(code["counts"][1::2]) == mask.sum()
    assert all(count > 0 for count in code["counts"][1:])


def packed(counts):
    """Pack as COCO does, for the test only: the library reads packed masks and writes plain ones."""
    text = ""
    for i, count in enumerate(counts):
        value = count - counts[i - 2] if i > 2 else count
        while True:
            bits, value = value & 31, value >> 5
            done = value == (-1 if bits & 16 else 0)
            text += chr(48 + bits + (0 if done else 32))
            if done:
                break
    return text


@given(masks)
def test_packed_text_is_read(mask):
    code = encode_mask(mask)
    assert np.array_equal(decode_mask(code | {"counts": packed(code["counts"])}), mask)


def test_columns_come_first():
    mask = np.zeros((3, 2), bool)
    mask[2, 0] = mask[0, 1] = True
    assert encode_mask(mask) == {"size": [3, 2], "counts": [2, 2, 2]}


def test_a_mask_of_another_tool():
    # Made by COCO's own mask API.
    mask = np.zeros((6, 7), bool)
    mask[1:4, 2:6] = mask[5, 0] = mask[0, 6] = True
    assert np.array_equal(decode_mask({"size": [6, 7], "counts": "5172L00000ON3"}), mask)
    assert packed(encode_mask(mask)["counts"]) == "5172L00000ON3"


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ([1, 2], "keys"),
        ({"size": [2, 2]}, "keys"),
        ({"size": [2, 2], "counts": [4], "area": 3}, "keys"),
        ({"size": [2], "counts": [4]}, "size"),
        ({"size": [2, 0], "counts": []}, "size"),
        ({"size": [2, 2], "counts": [3]}, "cover 3 pixels"),
        ({"size": [2, 2], "counts": [5, -1]}, "negative"),
        ({"size": [2, 2], "counts": [1.5, 2.5]}, "whole numbers"),
        ({"size": [2, 2], "counts": [2**70, 1]}, "too large"),
        ({"size": [2, 2], "counts": None}, "whole numbers"),
        ({"size": [2, 2], "counts": "4\x00"}, "character 1"),
        ({"size": [2, 2], "counts": "T"}, "cut off"),
        ({"size": [2, 2], "counts": "o" * 20}, "packed text"),
    ],
)
def test_bad_codes(code, words):
    with pytest.raises(FrameError, match=words):
        decode_mask(code)
