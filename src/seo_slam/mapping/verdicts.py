"""What agents said of each landmark, weighed against what the detector and the depth image say.

A verdict is evidence, as strong as its model is reliable, and how reliable that is is measured in the run itself: most landmarks are sure
without any agent, so a model that often contradicts what is sure is believed little (one rate a model, as Dawid and Skene, 1979, have it a
rater; but judged by sightings alone, for a model that says the same of everything must not bear itself out). For every landmark the
explanations compete that it is nothing, or a thing of one of the words that were said of it.
"""

from collections import Counter, defaultdict, deque
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from seo_slam.geometry import FloatArray

ANOTHER = ""
"""A thing of a word that nobody said."""

VerdictKind = Literal["confirm", "doubt", "remove", "name"]

PRIOR_RIGHT, PRIOR_WRONG = 8.0, 2.0
"""A model counts as right in 8 of 10 verdicts until this run says otherwise."""

LEAST_RELIABLE, MOST_RELIABLE = 0.34, 0.97
"""A model that is right in one of three verdicts says nothing: they are of three kinds."""

OTHER_VERDICTS = 2.0
"""A wrong verdict is one of so many."""

OTHER_NAMES = 4.0
"""A wrong name is one of so many look-alikes."""

DETECTOR_SIDES = 3.5
"""Log odds of the detector's word if it was the only one: what one or two sides of a thing say, however many views there are of them."""

SURE_IT_IS = 4.0
"""Log odds, at most, that a landmark is something, from sightings alone."""

SURE_BY_SIGHT = 0.4
"""… and what each sighting adds to it at most: mistakes that stick to a place are found again, too."""

SAME_SIDE = 0.25
"""What a verdict adds after another from the same side: a model shown the same picture errs the same way."""


MOST_VERDICTS = 64
"""So many of a landmark are remembered with their view; beyond, their number."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """One thing that one agent said of a landmark.

    Attributes:
        who: agent and model, whose reliability is measured together.
        kind: "confirm" or "doubt" of ``word``; "remove": nothing to be recognised; "name": it is a ``word``.
        word: the plain word, casefolded; "" for "remove".
        side: from where it was seen, a small number.
        view: the keyframe that was looked at.
    """

    who: str
    kind: VerdictKind
    word: str
    side: int
    view: int = 0


@dataclass(frozen=True, slots=True)
class Belief:
    """What is believed of a landmark: the probability that it is nothing, and that it is a thing of each word; they sum to 1.

    The word ``ANOTHER`` stands for one that nobody said.
    """

    nothing: float
    words: Mapping[str, float]

    @property
    def best(self) -> str:
        """The most likely word, the alphabetically first on a tie; "" if none was said."""
        return min(self.words, key=lambda word: (-self.words[word], word)) if self.words else ""


@dataclass(slots=True)
class _Heard:
    verdicts: deque[Verdict] = field(default_factory=lambda: deque(maxlen=MOST_VERDICTS))
    counts: Counter[Verdict] = field(default_factory=Counter)  # the same without their views: few, however long a run is
    right: dict[str, tuple[float, float]] = field(default_factory=dict)  # who -> expected number of right verdicts, number of all

    def hear(self, verdict: Verdict) -> None:
        self.verdicts.append(verdict)
        self.counts[replace(verdict, view=0)] += 1


class Verdicts:
    """All verdicts of a run, by landmark."""

    def __init__(self) -> None:
        """Start with none heard."""
        self._heard: dict[int, _Heard] = {}
        self._right: defaultdict[str, float] = defaultdict(float)
        self._all: defaultdict[str, float] = defaultdict(float)

    def hear(self, landmark_id: int, verdict: Verdict) -> None:
        """Take a verdict."""
        self._heard.setdefault(landmark_id, _Heard()).hear(verdict)

    def is_judged(self, landmark_id: int) -> bool:
        """Whether anything was said of a landmark."""
        return landmark_id in self._heard and bool(self._heard[landmark_id].counts)

    def of(self, landmark_id: int) -> tuple[Verdict, ...]:
        """What was said of a landmark, the newest, oldest first."""
        return tuple(self._heard[landmark_id].verdicts) if landmark_id in self._heard else ()

    def reliability(self, who: str) -> float:
        """The share of verdicts that a model gets right, as far as this run can tell."""
        share = (PRIOR_RIGHT + self._right[who]) / max(PRIOR_RIGHT + PRIOR_WRONG + self._all[who], 1.0)
        return float(np.clip(share, LEAST_RELIABLE, MOST_RELIABLE))

    def merge(self, keep_id: int, drop_id: int) -> None:
        """Let what was said of the one count for the other, but for denials: a half is hard to recognise."""
        dropped = self._heard.get(drop_id)
        if dropped is not None:
            self.forget(drop_id)
            kept = self._heard.setdefault(keep_id, _Heard())
            for verdict in dropped.verdicts:
                if verdict.kind != "remove":
                    kept.hear(verdict)

    def forget(self, landmark_id: int) -> tuple[Verdict, ...]:
        """Drop what was said of a landmark that left the map, and return it; the models' reliability stays measured."""
        heard = self._heard.pop(landmark_id, None)
        return tuple(heard.verdicts) if heard else ()

    def belief(self, landmark_id: int, existence: float, observations: int, weights: Mapping[str, float]) -> Belief:
        """Weigh everything.

        Args:
            landmark_id: whose.
            existence: probability that it is there, from sightings.
            observations: how many those were.
            weights: word -> summed score of the detections that said it.
        """
        heard = self._heard.setdefault(landmark_id, _Heard())
        named = sorted({w.casefold() for w in weights} | {v.word for v in heard.counts if v.kind == "name"} - {""})
        words = [*named, ANOTHER]
        there = float(np.clip(existence, 1e-3, 1.0 - 1e-3))
        log_nothing = max(float(np.log(1.0 - there) - np.log(there)), -SURE_IT_IS, -SURE_BY_SIGHT * observations)
        log_words = _log_shares(_detector_says(words, weights))  # given that it is something, whose log odds are 0
        self._learn(heard, _belief(log_nothing, log_words, words))  # by what was seen alone: no model is to bear itself out
        for verdict, weight in _weights(heard.counts):
            a = self.reliability(verdict.who)
            log_nothing += weight * np.log(_chance(verdict, None, a))
            log_words = log_words + weight * np.log([_chance(verdict, word, a) for word in words])
        return _belief(log_nothing, log_words, words)

    def _learn(self, heard: _Heard, belief: Belief) -> None:
        """Count how far the verdicts of each model agree with what was seen; a landmark's count replaces its older one.

        What was seen leaves doubts, so that even a perfect model agrees with it only so far. If ``a`` of its verdicts are right, the mean
        agreement is ``a * perfect + (1 - a) * wrong``, which is solved for ``a`` over all its verdicts (method of moments).
        """
        for who, (right, number) in heard.right.items():
            self._right[who] -= right
            self._all[who] -= number
        heard.right = {}
        for verdict, times in heard.counts.items():
            right, number = heard.right.get(verdict.who, (0.0, 0.0))
            perfect, wrong = _expected_agreement(verdict, belief)
            agrees = _chance_right(verdict, belief)
            heard.right[verdict.who] = (right + times * (agrees - wrong), number + times * (perfect - wrong))
        for who, (right, number) in heard.right.items():
            self._right[who] += right
            self._all[who] += number


def _belief(log_nothing: float, log_words: FloatArray, words: list[str]) -> Belief:
    shares = np.exp(_log_shares(np.append(log_words, log_nothing)))
    return Belief(float(shares[-1]), dict(zip(words, shares[:-1].tolist(), strict=True)))


def _chance(verdict: Verdict, word: str | None, a: float) -> float:
    """Probability of a verdict on a thing of ``word``, or on nothing, by a model that is right with probability ``a``."""
    wrong = (1.0 - a) / OTHER_VERDICTS
    match verdict.kind:
        case "remove":
            return a if word is None else wrong
        case "confirm":
            return a if word == verdict.word else wrong
        case "doubt":
            return a if word is not None and word != verdict.word else wrong
        case "name":
            return a if word == verdict.word else (1.0 - a) / OTHER_NAMES


def _chance_right(verdict: Verdict, belief: Belief) -> float:
    """Probability that a verdict was right."""
    named = belief.words.get(verdict.word, 0.0)
    match verdict.kind:
        case "remove":
            return belief.nothing
        case "doubt":
            return 1.0 - belief.nothing - named
        case _:
            return named


def _expected_agreement(verdict: Verdict, belief: Belief) -> tuple[float, float]:
    """Expected ``_chance_right`` of a model that is always right, and of one that is always wrong, if the truth is as believed."""
    shares = [belief.nothing, *belief.words.values()]
    if verdict.kind != "name":  # nothing, the word that was asked about (of a denial it is not kept: the likeliest), any other
        asked = belief.words.get(verdict.word, 0.0) if verdict.kind != "remove" else max(belief.words.values())
        shares = [belief.nothing, asked, 1.0 - belief.nothing - asked]
    perfect = sum(share * share for share in shares)
    return perfect, (1.0 - perfect) / (OTHER_NAMES if verdict.kind == "name" else OTHER_VERDICTS)


def _detector_says(words: list[str], weights: Mapping[str, float]) -> FloatArray:
    total = sum(weights.values())
    shares: defaultdict[str, float] = defaultdict(float)
    for word, weight in weights.items():
        shares[word.casefold()] += weight / total if total > 0 else 0.0
    return np.array([DETECTOR_SIDES * shares[word] for word in words], dtype=np.float64)


def _weights(counts: Mapping[Verdict, int]) -> list[tuple[Verdict, float]]:
    """The first verdict of a model from a side counts whole, the next ones little; of kinds that contradict, each by its share."""
    number: Counter[tuple[str, bool, int]] = Counter()
    for verdict, times in counts.items():
        number[verdict.who, verdict.kind == "name", verdict.side] += times
    weights = []
    for verdict, times in counts.items():
        n = number[verdict.who, verdict.kind == "name", verdict.side]
        weights.append((verdict, times * (1.0 + SAME_SIDE * (n - 1)) / n))
    return weights


def _log_shares(log_weights: FloatArray) -> FloatArray:
    """Log of what each is of their sum."""
    top = float(log_weights.max())
    return np.asarray(log_weights - top - np.log(np.exp(log_weights - top).sum()), dtype=np.float64)
