"""Text from outside (replies, error messages, names), made fit to be shown and kept."""

import unicodedata


def excerpt(text: str, most: int = 200) -> str:
    """Return the beginning of a text: at most ``most`` characters, spaces folded, without control and formatting characters."""
    looked_at = text[: 4 * most]  # enough to fill an excerpt, and a text of 10 MB is not gone through
    shown = "".join(" " if c.isspace() else c for c in looked_at if c.isspace() or unicodedata.category(c)[0] != "C")
    folded = " ".join(shown.split())
    cut = len(folded) > most or len(text) > len(looked_at)
    return folded[:most] + "…" if cut else folded


def encodable(text: str) -> str:
    """Return a text that any file can hold: half of a surrogate pair, which UTF-8 has no bytes for, becomes its escape."""
    return text.encode("utf-8", "backslashreplace").decode("utf-8")
