"""Settings of the abstract map: anchors, what is on them, and how a new view changes it (DualMap IV-A, IV-D)."""

from typing import Literal, Self

from pydantic import Field, model_validator

from seo_slam.settings.base import Settings
from seo_slam.settings.mobility_words import MOVABLE_NAMES, MOVABLE_PHRASES, STATIC_NAMES, STATIC_PHRASES


class AbstractionSettings(Settings):
    """From the concrete map to the abstract one, and its update; thresholds of cosines are for the MiniLM embedder."""

    anchor_rule: Literal["prototypes", "template"] = Field(
        "prototypes",
        description="prototypes: nearer to a static name than to a movable one; template: near enough to the mean static word (the paper)",
    )
    static_names: tuple[str, ...] = Field(STATIC_NAMES, min_length=1, description="things that rarely move; one in this list is an anchor")
    movable_names: tuple[str, ...] = Field(MOVABLE_NAMES, description="things that people carry; one in this list is no anchor")
    static_phrases: tuple[str, ...] = Field(STATIC_PHRASES, description="what the static ones have in common")
    movable_phrases: tuple[str, ...] = Field(MOVABLE_PHRASES, description="what the movable ones have in common")
    name_margin: float = Field(0.08, ge=0, le=2, description="where static and movable names are less apart in cosine, the phrases decide")
    phrase_margin: float = Field(0.02, ge=0, le=2, description="where the phrases are less apart, a word stays undecided")
    template_threshold: float = Field(0.54, ge=-1, le=1, description="cosine to the template from which a thing is an anchor")
    undecided_share: float = Field(
        0.2, ge=0, le=1, description="words for and against an anchor that differ by at most this share decide nothing"
    )
    large_is_anchor: bool = Field(True, description="what words and feature leave undecided is an anchor if it is as large as furniture")
    large_side_m: float = Field(0.7, gt=0, description="large: its longer side seen from above is at least this")
    large_height_m: float = Field(0.4, ge=0, description="and its height at least this")
    large_most_m: float = Field(3.0, gt=0, description="and no side is longer than this: that would be a wall")

    small_side_m: float = Field(
        0.4,
        ge=0,
        description="what is smaller, is in no list of static things and is on or in an anchor is none itself, whatever it is like",
    )

    relations: tuple[Literal["on", "in", "next to"], ...] = Field(
        ("on", "in", "next to"), description='which ways of belonging to an anchor count, first come first; the paper: ("on",)'
    )
    plane_bin_m: float = Field(0.02, gt=0, description="bin of the height histogram that finds supporting planes")
    plane_share: float = Field(0.12, gt=0, le=1, description="share of the footprint that a supporting plane takes at least")
    on_overlap: float = Field(0.8, gt=0, le=1, description="on: share of a thing's own footprint above the anchor")
    on_below_m: float = Field(0.1, ge=0, description="on: its bottom may be so far below the plane")
    on_above_m: float = Field(0.2, ge=0, description="on: or so far above it, where its lower part is hidden")
    in_share: float = Field(0.8, gt=0, le=1, description="in: share of its points inside the anchor's box")
    in_enclosed: float = Field(0.5, ge=0, le=1, description="in: share of the directions around it in which there is anchor")
    next_to_m: float = Field(0.3, ge=0, description="next to: gap between the footprints")
    next_to_height_m: float = Field(0.1, ge=0, description="next to: its height range may miss the anchor's by so much")

    hint_observations: int = Field(
        3, ge=1, description="what is not trusted is kept as a hint on its anchor if it has a word and was observed so often"
    )

    footprint_voxel_m: float = Field(0.05, gt=0, description="one point of a footprint, the mean, a square of this side")

    overlap: Literal["cells", "boxes"] = Field(
        "cells", description="overlap of footprints cell by cell, or of their boxes (the code of the paper)"
    )
    update_overlap: float = Field(0.5, gt=0, le=1, description="a new anchor is an old one if more than this of either lies in the other")
    replace_overlap: float = Field(
        0.85, gt=0, le=1, description="what is on an anchor is what a new view says, if the view covers more than this of the anchor"
    )
    replace_points: float = Field(
        0.4, ge=0, description="and has at least this share of its points: seen from so near that small things show"
    )
    same_anchor_cosine: float = Field(0.7, ge=-1, le=1, description="features from which two anchors in one place may be the same")
    same_height_m: float = Field(0.1, ge=0, description="or their supporting planes are so near and each covers most of the other")
    same_volatile_cosine: float = Field(0.9, ge=-1, le=1, description="features from which two volatile things of an anchor are one")

    @model_validator(mode="after")
    def _thresholds_agree(self) -> Self:
        if self.replace_overlap < self.update_overlap:
            raise ValueError(f"replace_overlap: got {self.replace_overlap}, wanted at least update_overlap ({self.update_overlap})")
        both = {_key(name) for name in self.static_names} & {_key(name) for name in self.movable_names}
        if both:
            raise ValueError(f"static_names and movable_names both hold {', '.join(sorted(both))}")
        return self


def _key(name: str) -> str:
    return " ".join(name.casefold().split())
