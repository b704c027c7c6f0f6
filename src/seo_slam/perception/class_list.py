"""The words that a map is to be made of."""

import unicodedata
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from seo_slam.errors import ConfigError
from seo_slam.perception.labels import MAX_LABEL_CHARACTERS, clean_label

_MOST_SHOWN = 5


@dataclass(frozen=True, slots=True)
class ClassList:
    """Words of classes, all different whatever their case.

    Attributes:
        words: as they were written, but for blanks and for accents, which are spelt as ``clean_label`` spells them.
        source: where they come from, for messages.

    Raises:
        ConfigError: no word, an empty or overlong one, or one twice; the message names them.
    """

    words: tuple[str, ...]
    source: str = "class list"

    def __post_init__(self) -> None:
        if isinstance(self.words, str) or not all(isinstance(word, str) for word in self.words):
            raise ConfigError(f"{self.source}: got {self.words!r:.60}, wanted a list of words")
        object.__setattr__(self, "words", tuple(_spelt(word) for word in self.words))
        if not self.words:
            raise ConfigError(f"{self.source}: holds no word, wanted at least one class")
        bad = [word for word in self.words if clean_label(word) != word]
        if bad:
            raise ConfigError(f"{self.source}: {bad[0]!r:.100} is no class: wanted 1 to {MAX_LABEL_CHARACTERS} visible characters")
        times = Counter(word.casefold() for word in self.words)
        twice = [word for word in dict.fromkeys(word.casefold() for word in self.words) if times[word] > 1]
        if twice:
            more = f" and {len(twice) - _MOST_SHOWN} more" if len(twice) > _MOST_SHOWN else ""
            named = ", ".join(repr(word) for word in twice[:_MOST_SHOWN])
            raise ConfigError(f"{self.source}: {named}{more} stand more than once; wanted each class once")

    def __len__(self) -> int:
        return len(self.words)

    def __iter__(self) -> Iterator[str]:
        return iter(self.words)

    def __contains__(self, label: object) -> bool:
        """Whether a label is one of the classes, whatever its case, and however its accents are spelt."""
        return isinstance(label, str) and _spelt(label).casefold() in {word.casefold() for word in self.words}

    @classmethod
    def from_file(cls, path: str | Path) -> Self:
        """Read a text file: one class a line; empty lines, and what follows a ``#``, are not read.

        Raises:
            ConfigError: it cannot be read, or holds what is no class list; the message names file and lines.
        """
        file = Path(path)
        try:
            lines = file.read_text(encoding="utf-8-sig").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{file}: class list cannot be read: {error}") from error
        read = [(number, _spelt(line.partition("#")[0])) for number, line in enumerate(lines, 1)]
        read = [(number, word) for number, word in read if word]
        first: dict[str, int] = {}
        twice = []
        for number, word in read:
            if word.casefold() in first:
                twice.append(f"{word!r} (lines {first[word.casefold()]} and {number})")
            first.setdefault(word.casefold(), number)
        if twice:
            more = f" and {len(twice) - _MOST_SHOWN} more" if len(twice) > _MOST_SHOWN else ""
            raise ConfigError(f"{file}: {', '.join(twice[:_MOST_SHOWN])}{more}: wanted each class once")
        return cls(tuple(word for _, word in read), str(file))

    @classmethod
    def of_detector(cls, detector: Any) -> Self | None:
        """Return what a detector says it knows: words in ``names``, ``labels`` or ``classes``, of a mapping its values; else None.

        Whatever else an attribute of such a name holds, numbers of classes or the path of a file, is no list of words.
        """
        for attribute in ("names", "labels", "classes"):
            words = _different(_words_in(getattr(detector, attribute, None)))
            if words:
                return cls(words, f"{attribute} of {type(detector).__name__}")
        return None

    @classmethod
    def of(cls, given: "ClassList | Iterable[str] | str | Path") -> "ClassList":
        """Return a class list from one, from words, or from the path of a file.

        Raises:
            ConfigError: as the constructor and ``from_file``.
        """
        if isinstance(given, ClassList):
            return given
        if isinstance(given, str | Path):
            return cls.from_file(given)
        return cls(tuple(given), "classes")

    def write(self, path: str | Path, header: str = "") -> Path:
        """Write a file that ``from_file`` reads, and return it; a ``header`` is one line that begins with ``#``.

        Raises:
            ConfigError: it cannot be written, or a word holds a ``#``: what follows that is not read.
        """
        file = Path(path)
        cut = [word for word in self.words if "#" in word]
        if cut:
            raise ConfigError(f"{file}: {cut[0]!r} of {self.source} cannot be written, a # begins a comment there; wanted words without #")
        try:
            lines = [header, *self.words] if header else self.words
            file.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8", newline="\n")
        except OSError as error:
            raise ConfigError(f"{file}: class list cannot be written: {error.strerror}") from error
        return file


def _spelt(word: str) -> str:
    """A word with single blanks and in the one spelling of its accents that labels have."""
    return unicodedata.normalize("NFC", " ".join(word.split()))


def _words_in(said: Any) -> Sequence[str]:
    values = list(said.values()) if isinstance(said, Mapping) else said.tolist() if isinstance(said, np.ndarray) else said
    is_words = isinstance(values, list | tuple | ClassList) and all(isinstance(word, str) for word in values)
    return tuple(values) if is_words else ()


def _different(words: Iterable[str]) -> tuple[str, ...]:
    """The words without repeats: what a network's own list says twice is no one's mistake here."""
    found: dict[str, str] = {}
    for word in words:
        cleaned = clean_label(word)
        if cleaned:
            found.setdefault(cleaned.casefold(), cleaned)
    return tuple(found.values())
