"""How much more likely two labels are if they name one thing: laws, words that must come out right, and where the numbers come from."""

import importlib.util
import json
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from seo_slam.association import label_likelihood
from seo_slam.association.label_likelihood import (
    CALIBRATION,
    KEEPS_WORD,
    MISTAKE_SHARE,
    OTHER_WORD,
    SAME_WORD,
    SHARES_WORD,
    LabelLikelihood,
)
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.backends.sentence_transformers_embedder import minilm_embedder
from seo_slam.interfaces import Embedder
from seo_slam.simulation.labels import DESK_LOOK_ALIKES

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "label_calibration.py"

words = st.sampled_from(["cup", "mug", "coffee mug", "tv", "chair", "office chair", "keyboard", "Tasse", "?"])
distributions = st.dictionaries(words, st.floats(0.01, 100.0), min_size=1, max_size=5)


@pytest.fixture(scope="module")
def calibration() -> Iterator[ModuleType]:
    """The benchmark as a module: it is a script, not part of the package."""
    spec = importlib.util.spec_from_file_location("label_calibration", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    yield module
    del sys.modules[spec.name]


@pytest.fixture(scope="module")
def minilm() -> Embedder:
    return minilm_embedder()


@pytest.fixture(scope="module")
def likelihood(minilm: Embedder) -> LabelLikelihood:
    return LabelLikelihood(minilm)


HASHED = LabelLikelihood(HashedEmbedder())


@given(words, words)
def test_words_are_compared_either_way_round(a: str, b: str) -> None:
    assert HASHED.log_ratio(a, {b: 1.0}) == LabelLikelihood(HashedEmbedder()).log_ratio(b, {a: 1.0})


@given(words, distributions)
def test_evidence_is_bounded(word: str, distribution: dict[str, float]) -> None:
    assert HASHED.lowest <= HASHED.log_ratio(word, distribution) <= HASHED.highest + 1e-12


@given(distributions, distributions)
def test_evidence_of_distributions_is_bounded(a: dict[str, float], b: dict[str, float]) -> None:
    assert HASHED.lowest - 1e-12 <= HASHED.between(a, b) <= HASHED.highest + 1e-12


@given(words, distributions, st.floats(0.01, 100.0))
def test_only_shares_count(word: str, distribution: dict[str, float], factor: float) -> None:
    scaled = {name: factor * weight for name, weight in distribution.items()}
    assert HASHED.log_ratio(word, scaled) == pytest.approx(HASHED.log_ratio(word, distribution))


@given(words, words)
def test_no_word_fits_better_than_the_same_word(a: str, b: str) -> None:
    assert HASHED.log_ratio(a, {b: 1.0}) <= HASHED.log_ratio(a, {a: 1.0}) == pytest.approx(HASHED.highest)


@given(words, distributions)
def test_a_word_seen_more_often_counts_more(word: str, distribution: dict[str, float]) -> None:
    more = distribution | {word: distribution.get(word, 0.0) + 1.0}
    assert HASHED.log_ratio(word, more) >= HASHED.log_ratio(word, distribution) - 1e-12


def test_words_vote_by_weight() -> None:
    none = LabelLikelihood(None)
    got = none.log_ratio("cup", {"cup": 3.0, "vase": 1.0})
    assert got == pytest.approx(math.log((1 - MISTAKE_SHARE) * 0.75 * math.exp(SAME_WORD) + MISTAKE_SHARE))


def test_two_distributions_are_compared_word_by_word() -> None:
    none = LabelLikelihood(None)
    ratios = [math.exp(none.log_ratio(word, {"cup": 1.0, "vase": 1.0})) for word in ("cup", "tv")]
    assert none.between({"cup": 3.0, "tv": 1.0}, {"cup": 1.0, "vase": 1.0}) == pytest.approx(math.log(0.75 * ratios[0] + 0.25 * ratios[1]))


@pytest.mark.parametrize("label", [None, ""])
def test_no_label_is_no_evidence(label: str | None) -> None:
    assert HASHED.log_ratio(label, {"cup": 1.0}) == 0.0


def test_an_unnamed_landmark_is_no_evidence() -> None:
    assert HASHED.log_ratio("cup", {}) == 0.0
    assert HASHED.between({}, {"cup": 1.0}) == 0.0
    assert HASHED.between({"cup": 1.0}, {}) == 0.0


def test_without_an_embedder_other_words_say_nothing_but_no() -> None:
    none = LabelLikelihood(None)
    assert none.log_ratio("cup", {"mug": 1.0}) == none.lowest == pytest.approx(math.log(MISTAKE_SHARE))


def test_chances_of_words_add_up() -> None:
    """Over two things, the mean ratio of same and other words is 1: both are ratios of the same two probabilities."""
    assert pytest.approx(1.0) == SHARES_WORD * math.exp(SAME_WORD) + (1 - SHARES_WORD) * math.exp(OTHER_WORD)
    assert pytest.approx(KEEPS_WORD) == SHARES_WORD * math.exp(SAME_WORD)


def test_an_unknown_model_takes_minilms_numbers(minilm: Embedder) -> None:
    class Renamed:
        name, size = "another", 384

        def embed_text(self, texts: list[str]) -> np.ndarray:
            return minilm.embed_text(texts)

    assert LabelLikelihood(Renamed()).log_ratio("cup", {"mug": 1.0}) == LabelLikelihood(minilm).log_ratio("cup", {"mug": 1.0})


ONE_THING = [
    "tv/monitor",
    "cup/mug",
    "couch/sofa",
    "cell phone/mobile phone",
    "mouse/computer mouse",
    "refrigerator/fridge",
    "shoe/sneaker",
]
TWO_THINGS = ["keyboard/mouse", "keyboard/monitor", "cup/keyboard", "book/monitor", "cup/plate", "book/pen", "chair/potted plant"]


@pytest.mark.parametrize("pair", ONE_THING)
def test_names_of_one_thing(likelihood: LabelLikelihood, pair: str) -> None:
    a, b = pair.split("/")
    assert likelihood.log_ratio(a, {b: 1.0}) > 0.0


@pytest.mark.parametrize("pair", TWO_THINGS)
def test_names_of_two_things(likelihood: LabelLikelihood, pair: str) -> None:
    a, b = pair.split("/")
    assert likelihood.log_ratio(a, {b: 1.0}) < 0.0


def test_a_known_confusion_weighs_less_against_than_a_stranger(likelihood: LabelLikelihood) -> None:
    confused = likelihood.log_ratio("laptop", {"tv": 1.0})
    stranger = likelihood.log_ratio("banana", {"tv": 1.0})
    assert stranger < confused - 0.3
    assert confused > -1.0


@pytest.mark.parametrize("name", sorted(CALIBRATION))
def test_the_numbers_are_those_of_the_fit(calibration: ModuleType, name: str) -> None:
    embedder = calibration.BatchedMinilm() if name == "minilm" else HashedEmbedder()
    groups = calibration.read_pairs()
    fitted = {group: groups[group] for group in (*calibration.ONE_THING, *calibration.TWO_THINGS)}
    values = calibration.cosines(embedder, fitted, label_likelihood.PHRASE)
    sample = calibration.sample_of(values, calibration.ONE_THING, calibration.TWO_THINGS)
    theta = calibration.fit(sample)
    assert CALIBRATION[name] == pytest.approx(theta, abs=0.0051)
    assert calibration.mean_ratio_of_two_things(theta, sample) == pytest.approx(1.0, abs=0.05)


def test_the_benchmark_embeds_as_the_library_does(calibration: ModuleType, minilm: Embedder) -> None:
    texts = ["a tv", "a monitor", "a bedside table", "a post-it note"]
    assert np.abs(calibration.BatchedMinilm().embed_text(texts) - minilm.embed_text(texts)).max() < 1e-5


def test_the_fit_recovers_a_known_line(calibration: ModuleType) -> None:
    draws = np.random.default_rng(3)
    cosine = draws.uniform(-0.2, 1.0, 20_000)
    is_one = (draws.random(20_000) < 1.0 / (1.0 + np.exp(-(8.0 * cosine - 3.0)))).astype(float)
    slope, offset = calibration.fit(calibration.Sample(cosine, is_one, np.full(20_000, 1.0 / 20_000)))
    assert (slope, offset) == pytest.approx((8.0, -3.0), abs=0.3)


def test_a_fit_that_means_nothing_is_refused(calibration: ModuleType) -> None:
    backwards = calibration.Sample(np.array([0.9, 0.1, 0.2, 0.3]), np.array([0.0, 1.0, 0.0, 1.0]), np.full(4, 0.25))
    with pytest.raises(ValueError, match="positive"):
        calibration.fit(backwards)


def test_no_pair_is_fitted_that_a_benchmark_scores(calibration: ModuleType, shared: Path) -> None:
    groups = calibration.read_pairs()
    fitted = {frozenset(pair) for name in (*calibration.ONE_THING, *calibration.TWO_THINGS) for pair in groups[name]}
    look_alikes = {frozenset((label, other)) for label, others in DESK_LOOK_ALIKES.items() for other in others}
    assert not fitted & look_alikes
    truth = json.loads((shared / "data" / "tum_fr1_xyz" / "objects_gt.json").read_text(encoding="utf-8"))
    scored = {entry["label"] for entry in truth["objects"]}
    assert not [pair for pair in fitted if pair <= scored]


def test_every_pair_stands_in_one_group(calibration: ModuleType) -> None:
    groups = calibration.read_pairs()
    pairs = [frozenset(pair) for group in groups.values() for pair in group]
    assert len(pairs) == len(set(pairs))
    assert all(len(pair) == 2 for pair in pairs)
    assert len(groups["names"]) >= 80
    assert len(groups["confusions"]) >= 40
    assert len(groups["neighbours"]) >= 80
