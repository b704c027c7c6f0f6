"""Random draws that depend on what they are for and not on when they are made.

Every draw of the simulation is keyed by words and numbers, for example ``(seed, "label", object_id, octant)``: asking for frames in
another order, or for fewer of them, changes nothing.
"""

import zlib

import numpy as np


def generator(*key: int | str) -> np.random.Generator:
    """Return a random generator of its own for ``key``; the same key gives the same numbers on every machine and run.

    The key goes through CRC32, since Python's ``hash`` of text differs from process to process; NumPy's seeding then spreads it.
    """
    return np.random.default_rng(zlib.crc32("|".join(str(part) for part in key).encode()))
