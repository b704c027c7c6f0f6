"""How simulated chat models count tokens: a fixed rule, since each real model has its own.

Text: a token every four characters begun. An image: 85 and 170 for every 512x512 tile begun. A question also has 4 for each of its
messages, and the schema of the reply counts as text.
"""

import json
import struct

from seo_slam.interfaces import ChatRequest

_TILE_PX = 512
_PER_MESSAGE, _PER_IMAGE, _PER_TILE = 4, 85, 170
_FRAME_HEADERS = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}  # of JPEG: segments that begin with the size of the image


def tokens_of_text(text: str) -> int:
    """Return the tokens of a text: a quarter of its characters, rounded up."""
    return -(-len(text) // 4)


def tokens_of_image(image: bytes) -> int:
    """Return the tokens of a JPEG or PNG file; one tile's where its size cannot be read."""
    width, height = image_size(image) or (_TILE_PX, _TILE_PX)
    return _PER_IMAGE + _PER_TILE * -(-width // _TILE_PX) * -(-height // _TILE_PX)


def tokens_of_question(request: ChatRequest) -> int:
    """Return the prompt tokens of a request."""
    texts = [request.system, request.text, *(text for turn in request.turns for text in turn)]
    if request.schema is not None:
        texts.append(json.dumps(request.schema))
    messages = 2 + 2 * len(request.turns)
    return _PER_MESSAGE * messages + sum(map(tokens_of_text, texts)) + sum(map(tokens_of_image, request.images))


def image_size(image: bytes) -> tuple[int, int] | None:
    """Return width and height, pixels, of a JPEG or PNG file from its header; None where there is none."""
    if image[:8] == b"\x89PNG\r\n\x1a\n" and len(image) >= 24:
        width, height = struct.unpack(">II", image[16:24])
        return int(width), int(height)
    if image[:2] != b"\xff\xd8":
        return None
    at = 2
    while at + 9 <= len(image) and image[at] == 0xFF:
        if image[at + 1] in _FRAME_HEADERS:
            height, width = struct.unpack(">HH", image[at + 5 : at + 9])
            return int(width), int(height)
        at += 2 + int.from_bytes(image[at + 2 : at + 4], "big")
    return None
