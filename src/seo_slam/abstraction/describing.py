"""An abstract map in words, for people."""

from collections import Counter

from seo_slam.abstraction.abstract_map import AbstractMap, Anchor
from seo_slam.abstraction.room_finding import room_of

_UNNAMED = "unnamed"


def describe(abstract_map: AbstractMap) -> str:
    """Return a line an anchor with what belongs to it, under its room where it lies in one; world frame, metres.

    For example::

        kitchen (12.5 m2)
          3 table at 1.2, 0.4: on it cup, 2 plate; next to it shoe
    """
    by_room: dict[int, list[str]] = {}
    for anchor in abstract_map.anchors:
        by_room.setdefault(room_id_of(abstract_map, anchor), []).append(_line(anchor))
    if not abstract_map.rooms:
        return "\n".join(line for lines in by_room.values() for line in lines) or "no anchors"
    blocks = [[f"{room.name} ({room.area_m2:.1f} m2)", *_indented(by_room.pop(room.id, []))] for room in abstract_map.rooms]
    outside = [line for _, lines in sorted(by_room.items()) for line in lines]
    return "\n".join("\n".join(block) for block in (*blocks, ["in no room", *_indented(outside)]) if block != ["in no room"])


def room_id_of(abstract_map: AbstractMap, anchor: Anchor) -> int:
    """Return the id of the room in which most of an anchor's footprint lies, or right beside which it lies; 0 for none."""
    return room_of(abstract_map.layout, anchor.footprint_world) if abstract_map.layout is not None else 0


def _line(anchor: Anchor) -> str:
    x, y = anchor.xy_world
    parts = []
    for relation in ("on", "in", "next to"):
        words = Counter(volatile.label or _UNNAMED for volatile in anchor.volatiles if volatile.relation == relation)
        if words:
            parts.append(f"{relation} it {', '.join(word if n == 1 else f'{n} {word}' for word, n in sorted(words.items()))}")
    return f"{anchor.id} {anchor.label or _UNNAMED} at {x:.1f}, {y:.1f}{': ' if parts else ''}{'; '.join(parts)}"


def _indented(lines: list[str]) -> list[str]:
    return [f"  {line}" for line in lines]
