"""Text that a model gave, made a label or refused: it goes into the map, into later prompts, reports and databases."""

import difflib
import unicodedata
from collections.abc import Iterable

from seo_slam.agents.replies import NOT_AVAILABLE
from seo_slam.perception.labels import MAX_LABEL_CHARACTERS, clean_label

MOST_LABEL_WORDS, MOST_CATEGORY_WORDS = 8, 3

_MARKS = frozenset(" -'’&/,.()+%°")
_ORDERS = ("delete", "disregard", "forget", "ignore", "jailbreak", "override", "previous")
_NO_OBJECTS = frozenset((*_ORDERS, "instruction", "instructions", "landmark", "landmarks", "prompt", "prompts"))
"""Words of whoever gives orders, which name no thing that stands in a room."""
_SAYS_NOTHING = frozenset({"", "unknown", "none", "null", "unclear", "unidentifiable", "unidentified", "object", "thing"})


def is_not_available(text: str) -> bool:
    """Whether a model said that there is nothing to be said: "N/A", in any case, also "NA" or "n.a."."""
    return text.strip(" \t\r\n\"'[]<>").casefold().replace(".", "").replace(" ", "") in {NOT_AVAILABLE.casefold(), "na"}


def label_from(text: str, most_words: int = MOST_LABEL_WORDS) -> str | None:
    """Return what a model said as a label in lower case, or None if it is none.

    Control and invisible characters are taken out. Refused is what cannot name a thing: "N/A", "unknown", more than a few words or 80
    characters, text without a letter, signs of markup, code or SQL, and words that give orders. Letters of any script are welcome.
    """
    if len(text) > 4 * MAX_LABEL_CHARACTERS or is_not_available(text):
        return None
    label = (clean_label(text) or "").lower().strip(" .,-/&'’")
    words = label.split()
    if label in _SAYS_NOTHING or len(words) > most_words or len(text.strip()) > MAX_LABEL_CHARACTERS or "--" in label or "/*" in label:
        return None
    if any(unicodedata.category(c)[0] not in "LMN" and c not in _MARKS for c in label) or not any(c.isalpha() for c in label):
        return None
    return None if _NO_OBJECTS.intersection(word.strip(".,()/'’") for word in words) else label


def nearest_labels(label: str, known: Iterable[str], most: int = 50) -> tuple[str, ...]:
    """Return those known labels that are most like a label, at most so many, in the order in which they were given first.

    Labels that share words with it come first, then those spelt alike, then older ones. None is given twice.
    """
    clean = list(dict.fromkeys(found for text in known if (found := label_from(text)) is not None))
    if len(clean) <= most:
        return tuple(clean)
    words = set(label.lower().split())
    ratio = difflib.SequenceMatcher(b=label.lower(), autojunk=False)

    def unlike(place: int) -> tuple[int, float, int]:
        ratio.set_seq1(clean[place])
        return -len(words.intersection(clean[place].split())), -ratio.quick_ratio(), place

    return tuple(clean[place] for place in sorted(sorted(range(len(clean)), key=unlike)[:most]))
