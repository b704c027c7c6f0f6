"""What belongs to the building and to no map of things: words such as "wall"."""

from collections.abc import Sequence

BACKGROUND = ("wall", "floor", "ceiling", "pillar", "window", "vent", "background")
"""Classes that DualMap's evaluation leaves out; a map of things has no use for them either."""


def is_background(label: str | None, words: Sequence[str] = BACKGROUND) -> bool:
    """Whether a label names background: its last word is one of ``words``, or a plural of it, whatever the case.

    "brick wall" and "windows" are background; "wall clock", "floor lamp" and "wallet", which hold such a word, are things.
    """
    if not label:
        return False
    name = label.casefold().replace("-", " ")
    return any(_ends_with(name, word.casefold().strip()) for word in words if word.strip())


def _ends_with(name: str, word: str) -> bool:
    return any(name == form or name.endswith(f" {form}") for form in (word, f"{word}s", f"{word}es"))
