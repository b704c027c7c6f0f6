"""The report's table of landmarks: picture, names, place, size, and what each was called when."""

import base64
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from seo_slam.report.crop import Crop
from seo_slam.report.crops import ReportRecorder
from seo_slam.report.escaping import clean_text, escaped
from seo_slam.report.label_history import LabelRun
from seo_slam.report.life_history import away_spans, life_line
from seo_slam.types import Landmark

_COLOURS = 12
_SHOWN_LABELS = 3
_SHOWN_CHANGES = 4
_STRIP_PX = (200.0, 12.0)
_LEAST_RUN_PX = 2.0

_COLUMNS = (
    ("", "picture", ""),
    ("id", "id", "num"),
    ("label", "label", ""),
    ("position", "position, m", "num"),
    ("sigma", "sigma", "num"),
    ("size", "size, cm", "num"),
    ("observations", "seen", "num"),
    ("existence", "there", "num"),
    ("first", "first – last", "num"),
    ("", "called, over time", ""),
)


class LabelColours:
    """Gives each label one of 12 CSS classes, ``c0`` to ``c11``: equal labels look equal in the whole report.

    The labels of most landmarks come first, so the commonest ones have colours of their own.
    """

    def __init__(self, landmarks: Iterable[Landmark]) -> None:
        counts: dict[str, int] = {}
        for landmark in landmarks:
            counts[landmark.label] = counts.get(landmark.label, 0) + 1
        ranked = sorted(filter(None, counts), key=lambda label: (-counts[label], label))
        self._class = {label: f"c{rank % _COLOURS}" for rank, label in enumerate(ranked)}

    def css_class(self, label: str | None) -> str:
        """The class of a label; ``none`` for no label."""
        if not label:
            return "none"
        return self._class.setdefault(label, f"c{len(self._class) % _COLOURS}")


@dataclass(frozen=True, slots=True)
class TableContext:
    """What every row needs: times are shown from ``start_s`` and strips run from there to ``end_s``."""

    recorder: ReportRecorder | None
    colours: LabelColours
    start_s: float
    end_s: float


def landmark_table(landmarks: Sequence[Landmark], name: str, context: TableContext) -> str:
    """Return a ``<table>`` of landmarks, by rising id; JavaScript makes it sortable, and it reads well without."""
    heads = "".join(
        f'<th scope="col"{f" data-key={key!r}" if key else ""}{f" class={kind!r}" if kind else ""}>{escaped(title)}</th>'
        for key, title, kind in _COLUMNS
    )
    rows = "".join(_row(landmark, context) for landmark in sorted(landmarks, key=lambda m: m.id))
    return (
        f'<div class="table-frame"><table class="landmarks" id="table-{name}"><thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table>'
        '<p class="nothing" hidden>No landmark of that name.</p></div>'
    )


def sigma_m(landmark: Landmark) -> float:
    """The greatest standard deviation of the position in any direction, metres (NaN if the covariance is not finite)."""
    if not np.isfinite(landmark.covariance_m2).all():
        return float("nan")
    return float(np.sqrt(max(float(np.linalg.eigvalsh(landmark.covariance_m2)[-1]), 0.0)))


def _row(m: Landmark, context: TableContext) -> str:
    crop = context.recorder.crop(m.id) if context.recorder else None
    colour = context.colours.css_class(m.label)
    sigma = sigma_m(m)
    axes = ", ".join(f"{1000 * s:.0f}" for s in np.sqrt(np.maximum(np.diag(np.nan_to_num(m.covariance_m2)), 0.0)))
    position = " ".join(f"<span>{value:.3f}</span>" for value in m.position_m)
    first, last = m.first_seen_s - context.start_s, m.last_seen_s - context.start_s
    keys = {
        "id": f"{m.id}",
        "label": clean_text(m.label),
        "position": f"{m.position_m[0]:.4f}",
        "sigma": f"{sigma:.6f}",
        "size": f"{float(np.prod(m.size_m)):.9f}",
        "observations": f"{m.observations}",
        "existence": f"{m.existence:.6f}",
        "first": f"{m.first_seen_s:.4f}",
    }
    data = "".join(f' data-{key}="{escaped(value)}"' for key, value in keys.items())
    cells = (
        ("picture", "", picture(crop, m.id, m.label)),
        ("id num", "id", f'<a href="#map" data-show="{m.id}">#{m.id}</a>'),
        (
            "label",
            "label",
            f'<b class="{colour}"><i class="swatch"></i>{escaped(m.label) or "unnamed"}</b>{_category(m)}{_distribution(m)}',
        ),
        ("num xyz", "at", position),
        ("num", "sigma", f'<span title="along x, y, z: {axes} mm">{_length(sigma)}</span>'),
        ("num", "size", " × ".join(f"{100 * s:.0f}" for s in m.size_m)),
        ("num", "seen", f'{m.observations}<small class="unit"> ×</small>'),
        ("num", "there", f'<small title="probability that it is there">{_probability(m.existence)}</small>'),
        ("num", "first – last", f'<span title="stamps {m.first_seen_s:.3f} to {m.last_seen_s:.3f} s">{first:.1f} – {last:.1f} s</span>'),
        ("history", "called", _history(m.id, context)),
    )
    body = "".join(f'<td class="{kind}"{f" data-name={chr(34)}{name}{chr(34)}" if name else ""}>{cell}</td>' for kind, name, cell in cells)
    return f'<tr id="landmark-{m.id}" class="{m.state}"{data}>{body}</tr>'


def _length(metres: float) -> str:
    if not np.isfinite(metres):
        return "unknown"
    return f"{1000 * metres:.1f} mm" if metres < 0.01 else f"{100 * metres:.1f} cm" if metres < 1 else f"{metres:.2f} m"


def _probability(share: float) -> str:
    """A share as a percentage; what is not quite certain is not shown as certain."""
    if 0.995 <= share < 1.0:
        return "&gt; 99 %"
    return "&lt; 1 %" if 0.0 < share < 0.005 else f"{100 * share:.0f} %"


def picture(crop: Crop | None, landmark_id: int, label: str) -> str:
    """Return the picture of a landmark with the frame of its box, as HTML."""
    if crop is None:
        return '<div class="crop empty">no picture</div>'
    data = base64.b64encode(crop.jpeg).decode("ascii")
    left, top, right, bottom = (100 * share for share in crop.box_share)
    frame = f"left:{left:.1f}%;top:{top:.1f}%;width:{right - left:.1f}%;height:{bottom - top:.1f}%"
    name = escaped(f"best view of {clean_text(label) or 'an unnamed object'} #{landmark_id}, t = {crop.timestamp_s:.3f} s", 240)
    return (
        f'<div class="crop"><span><img src="data:image/jpeg;base64,{data}" width="{crop.width_px}" height="{crop.height_px}" '
        f'alt="{name}" title="{name}"><i style="{frame}"></i></span></div>'
    )


def _category(m: Landmark) -> str:
    return f'<small class="category">{escaped(m.category, 40)}</small>' if m.category and m.category != m.label else ""


def _distribution(m: Landmark) -> str:
    ranked = sorted(m.labels.items(), key=lambda item: (-item[1], item[0]))
    if len(ranked) < 2:
        return ""
    shown = "".join(
        f'<li><i style="width:{100 * min(max(weight, 0.0), 1.0):.0f}%"></i><span>{escaped(label, 40)}</span><em>{weight:.0%}</em></li>'
        for label, weight in ranked[:_SHOWN_LABELS]
    )
    more = f"<li><span>and {len(ranked) - _SHOWN_LABELS} more</span></li>" if len(ranked) > _SHOWN_LABELS else ""
    return f'<ul class="shares">{shown}{more}</ul>'


def gone_table(recorder: ReportRecorder, context: TableContext) -> str:
    """Return a ``<table>`` of the things that were removed: their best picture, what they were called, and what became of them."""
    heads = "".join(f'<th scope="col"{kind}>{title}</th>' for title, kind in (("picture", ""), ("id", ' class="num"'), ("label", "")))
    rows = "".join(_gone_row(landmark_id, recorder, context) for landmark_id in recorder.gone)
    return (
        f'<div class="table-frame"><table class="landmarks gone"><thead><tr>{heads}<th scope="col">history</th></tr></thead>'
        f'<tbody>{rows}</tbody></table><p class="nothing" hidden>No thing of that name.</p></div>'
    )


def last_name(landmark_id: int, recorder: ReportRecorder) -> str:
    """What a thing was called most often, not escaped; "" if nothing named it."""
    counts: dict[str, int] = {}
    for run in recorder.label_history(landmark_id):
        if run.label:
            counts[run.label] = counts.get(run.label, 0) + run.count
    return min(counts, key=lambda label: (-counts[label], label), default="")


def _gone_row(landmark_id: int, recorder: ReportRecorder, context: TableContext) -> str:
    label = last_name(landmark_id, recorder)
    colour = context.colours.css_class(label)
    best = picture(recorder.crop(landmark_id), landmark_id, label)
    return (
        f'<tr id="landmark-{landmark_id}" class="gone" data-id="{landmark_id}" data-label="{escaped(label)}">'
        f'<td class="picture">{best}</td>'
        f'<td class="id num" data-name="id">#{landmark_id}</td><td class="label" data-name="label"><b class="{colour}">'
        f'<i class="swatch"></i>{escaped(label) or "unnamed"}</b></td>'
        f'<td class="history" data-name="called">{_history(landmark_id, context)}</td></tr>'
    )


def _history(landmark_id: int, context: TableContext) -> str:
    runs = context.recorder.label_history(landmark_id) if context.recorder else ()
    life = context.recorder.life(landmark_id) if context.recorder else ()
    line = life_line(life, context.start_s)
    if not runs:
        return line or '<span class="dim">not recorded</span>'
    width, height = _STRIP_PX
    scale = width / max(context.end_s - context.start_s, 1e-9)
    bars = "".join(
        f'<rect class="{context.colours.css_class(run.label)}" x="{(run.first_s - context.start_s) * scale:.1f}" '
        f'width="{max((run.last_s - run.first_s) * scale, _LEAST_RUN_PX):.1f}" height="{height:g}"><title>'
        f"{_name(run.label)}: {run.count} times, {run.first_s - context.start_s:.1f} to {run.last_s - context.start_s:.1f} s"
        "</title></rect>"
        for run in runs
    )
    bars += "".join(
        f'<rect class="away" x="{(since - context.start_s) * scale:.1f}" y="{height - 4:g}" '
        f'width="{max((until - since) * scale, _LEAST_RUN_PX):.1f}" height="4"><title>'
        f"not where it was: {since - context.start_s:.1f} to {until - context.start_s:.1f} s</title></rect>"
        for since, until in away_spans(life, context.end_s)
    )
    window = f'viewBox="0 0 {width:g} {height:g}" preserveAspectRatio="none"'
    strip = f'<svg class="strip" {window} role="img" aria-label="labels over time">{bars}</svg>'
    return f"{strip}<small>{_changes(runs)}</small>{line}"


def _changes(runs: Sequence[LabelRun]) -> str:
    """The labels in order, repeats folded, sightings without a label left out: "cup → mug → cup, 3 more changes"."""
    named = [run.label or "" for run in runs if run.label] or [""]
    names = [name for i, name in enumerate(named) if i == 0 or named[i - 1] != name]
    more = len(names) - _SHOWN_CHANGES
    return " → ".join(_name(name) for name in names[:_SHOWN_CHANGES]) + (f" … {more} more changes" if more > 0 else "")


def _name(label: str | None) -> str:
    return escaped(label or "", 40) or "(no label)"
