"""The page of an evaluation: truth and map side by side, the scores, and what became of each object."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from seo_slam.evaluation.scores import ENOUGH_KEYFRAMES, ExtraLandmark, LandmarksResult, MatchedLandmark, MissingObject, Score
from seo_slam.evaluation.true_objects import Truth
from seo_slam.records import Trajectory
from seo_slam.report.escaping import escaped
from seo_slam.report.page import document, section, write_whole
from seo_slam.report.sections import folded
from seo_slam.report.truth_scene import compare
from seo_slam.report.truth_svg import BELOW, BESIDE, draw_comparison, truth_css
from seo_slam.types import Landmark

SCHEMA = "seo_slam.evaluation/1"


def write_evaluation(
    path: str | Path,
    *,
    landmarks: Iterable[Landmark],
    truth: Truth,
    result: LandmarksResult,
    trajectory: Trajectory | None = None,
    title: str = "",
) -> None:
    """Write the page of an evaluation; one file, the same input gives the same bytes.

    Args:
        path: the file to write; replaced only once the new one is complete.
        landmarks: those that were scored, true world, z up.
        truth: what they were scored against.
        result: of ``evaluate_landmarks``.
        trajectory: camera poses, true world; None draws none.
        title: what was mapped.

    Raises:
        OSError: the file cannot be written.
    """
    write_whole(path, render_evaluation(landmarks=landmarks, truth=truth, result=result, trajectory=trajectory, title=title))


def render_evaluation(
    *, landmarks: Iterable[Landmark], truth: Truth, result: LandmarksResult, trajectory: Trajectory | None = None, title: str = ""
) -> str:
    """Return the page that ``write_evaluation`` writes."""
    comparison = compare(landmarks, truth, result, trajectory)
    picture = (
        '<p class="dim">Seen from above: world x to the right, y up. On the left what is there when the recording ends, on the right what '
        "the map has of it.</p>"
        f"{draw_comparison(comparison, result, BESIDE, stacked=False)}{draw_comparison(comparison, result, BELOW, stacked=True)}"
    )
    name = title or "a map"
    main = (
        f'<header><p class="kicker">seo_slam · evaluation of a map</p><h1>{escaped(name, 200)}</h1></header>',
        _tiles(result),
        section("truth", "Truth and map", picture),
        section("scores", "Scores", _scores(result)),
        section("classes", "Classes", _classes(result)),
        section("objects", "One by one", _one_by_one(result)),
    )
    data = {"schema": SCHEMA, "title": title, "not_drawn": comparison.left_out, **result.as_dict()}
    return document(f"{name}: truth and map", "".join(main), data, truth_css())


def _tiles(result: LandmarksResult) -> str:
    s = result.score
    tiles = (
        (f"{s.f1:.2f}", "F1", "main"),
        (f"{s.precision:.2f}", "precision", ""),
        (f"{s.recall:.2f}", "recall", ""),
        (f"{s.matched} of {s.objects}", "objects found", ""),
        (f"{result.duplicates}", "duplicates", "alert" if result.duplicates else ""),
        (f"{result.ghosts}", "ghosts", "alert" if result.ghosts else ""),
        (f"{result.false}", "false", "alert" if result.false else ""),
    )
    body = "".join(f'<div class="tile {kind}"><dd>{value}</dd><dt>{name}</dt></div>' for value, name, kind in tiles)
    return f'<dl class="tiles">{body}</dl>'


def _scores(result: LandmarksResult) -> str:
    s = result.score
    rows: list[tuple[str, Score | None]] = [
        ("all objects present at the end", s),
        (f"those in view for {ENOUGH_KEYFRAMES} keyframes or more", s.visible),
        ("as given", s.given),
    ]
    counted = _table(
        ("G: which objects count", "objects", "landmarks", "matched", "precision", "recall", "F1"),
        [(name, *_score_cells(score)) for name, score in rows if score is not None],
    )
    swept = _table(
        ("radius", "matched", "precision", "recall", "F1", "F1, in view"),
        [
            (
                f"{row.radius_m:g} m",
                f"{row.matched}",
                f"{row.precision:.3f}",
                f"{row.recall:.3f}",
                f"{row.f1:.3f}",
                f"{row.visible.f1:.3f}" if row.visible else "–",
            )
            for row in result.sweep
        ],
    )
    left_out = f", {result.tentative} others left out" if result.tentative else ""
    how = (
        f"Protocol {result.protocol}: a landmark and an object may match within {result.radius_m:g} m (or half the object's smaller "
        f"horizontal extent), labels {result.label_rule}; one-to-one. Only stable landmarks count{left_out}. "
        "Where only objects in view count, a landmark on one that was seldom in view is neither right nor false."
    )
    return f'<p class="dim">{escaped(how, 600)}</p>{counted}<h3>Other radii</h3>{swept}'


def _score_cells(score: Score) -> tuple[str, ...]:
    counts = (f"{score.objects}", f"{score.landmarks}", f"{score.matched}")
    return (*counts, f"{score.precision:.3f}", f"{score.recall:.3f}", f"{score.f1:.3f}")


def _classes(result: LandmarksResult) -> str:
    rows = []
    for row in result.per_class:
        name = "label of no class here" if row.label is None else row.label
        rows.append((name, *(str(n) for n in (row.objects, row.matched, row.missing, row.duplicates, row.ghosts, row.false))))
    return _table(("class", "objects", "matched", "missing", "duplicates", "ghosts", "false"), rows, mark_from=3)


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]], mark_from: int | None = None) -> str:
    """A table of text; from the column ``mark_from`` on, what is not 0 stands out."""

    def cell(text: str, column: int) -> str:
        kind = ""
        if mark_from is not None and column >= mark_from:
            kind = ' class="zero"' if text == "0" else ' class="some"'
        return f"<td{kind}>{escaped(text)}</td>"

    head = "".join(f'<th scope="col">{escaped(text)}</th>' for text in heads)
    body = "".join(f"<tr>{''.join(cell(text, column) for column, text in enumerate(row))}</tr>" for row in rows)
    return f'<div class="table-frame"><table class="numbers"><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _one_by_one(result: LandmarksResult) -> str:
    parts = [_who(f"missing ({len(result.missing)})", [_missing(item) for item in result.missing])]
    parts.append(_who(f"landmarks without an object ({len(result.extra)})", [_extra(item) for item in result.extra]))
    matched = [_match(pair) for pair in result.matched]
    return "".join(parts) + folded(f"matched ({len(matched)})", _list(matched))


def _who(title: str, lines: Sequence[str]) -> str:
    return f"<h3>{escaped(title)}</h3>{_list(lines)}"


def _list(lines: Sequence[str]) -> str:
    if not lines:
        return '<p class="dim">None.</p>'
    return f'<ul class="who">{"".join(f"<li>{escaped(line, 300)}</li>" for line in lines)}</ul>'


def _match(pair: MatchedLandmark) -> str:
    found = f"landmark {pair.landmark_id}, {pair.label or 'unnamed'}, {100 * pair.distance_m:.1f} cm off"
    return f"{pair.object_label} ({pair.object_id}) = {found}"


def _missing(item: MissingObject) -> str:
    near = ""
    if item.nearest_landmark_id is not None and item.nearest_m is not None:
        near = f"; nearest is landmark {item.nearest_landmark_id}, {item.nearest_label or 'unnamed'}, {item.nearest_m:.2f} m away"
    return f"{item.object_label} ({item.object_id}){near}"


def _extra(item: ExtraLandmark) -> str:
    what = f"{item.kind} of {item.of}" if item.of else f"false; nearest is {item.nearest_object_id}, {item.nearest_m:.2f} m away"
    x, y, z = item.position_m
    return f"landmark {item.landmark_id}, {item.label or 'unnamed'}, at {x:.2f} {y:.2f} {z:.2f}: {what}"
