"""When a landmark's word names a true object: the label rules of ``landmarks/1``."""

import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from seo_slam.errors import EvaluationError

LabelGroups = Sequence[Sequence[str]]


@dataclass(frozen=True, slots=True)
class LabelRule:
    """Decides whether words agree. Case, spaces, underscores and how an accent is spelt never matter.

    Attributes:
        name: "exact", "synonyms" or "geometry"; stated in every result.
        groups: sets of words that mean the same, for "synonyms"; each already in the form of ``normal``.
        source: where the groups come from, stated in the result.
    """

    name: str
    groups: tuple[frozenset[str], ...] = field(default=(), repr=False)
    source: str = ""

    @classmethod
    def exact(cls) -> "LabelRule":
        """One of the landmark's words is one of the object's accepted labels."""
        return cls("exact")

    @classmethod
    def synonyms(cls, groups: LabelGroups, source: str = "") -> "LabelRule":
        """As ``exact``, or a group holds both words. Groups are not chained: a word in two groups does not join them.

        Raises:
            EvaluationError: a group has fewer than two words.
        """
        for number, words in enumerate(groups):
            if len({normal(word) for word in words} - {""}) < 2:
                raise EvaluationError(f"synonyms: group {number} is {list(words)}, wanted at least two different words")
        return cls("synonyms", tuple(frozenset(normal(word) for word in words) for words in groups), source)

    @classmethod
    def geometry(cls) -> "LabelRule":
        """Labels are ignored: how the map does as geometry alone."""
        return cls("geometry")

    def agree(self, words: Iterable[str], accepted: Iterable[str]) -> bool:
        """Whether any of ``words`` names a thing whose accepted labels are ``accepted``."""
        if self.name == "geometry":
            return True
        ours = {normal(word) for word in words} - {""}
        theirs = {normal(word) for word in accepted}
        if ours & theirs:
            return True
        return any(group & ours and group & theirs for group in self.groups)

    def describe(self) -> str:
        """The rule in words, for a result."""
        return f"{self.name}:{self.source}" if self.source else self.name


def normal(word: str) -> str:
    """A word without case, spaces and underscores, its accents spelt as a map spells them."""
    return "".join(unicodedata.normalize("NFC", word).casefold().replace("_", " ").split())
