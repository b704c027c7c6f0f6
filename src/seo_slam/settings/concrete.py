"""Settings of the concrete map: matching and status checks (DualMap III-B)."""

from typing import Literal

from pydantic import Field

from seo_slam.settings.base import Settings


class OverlapSettings(Settings):
    """Matching by looks and overlap (DualMap Eq 3, 4)."""

    threshold: float = Field(1.2, ge=-1, le=2, description="cosine plus overlap share above which an observation is of a landmark")
    distance_m: float = Field(0.02, gt=0, description="a point this near to a point of the landmark overlaps it")
    noise_at_1m_m: float = Field(
        0.0,
        ge=0,
        description="that distance is at least this times the squared range, as depth noise grows; 0: the same everywhere (the paper)",
    )
    assignment: Literal["greedy", "one_to_one"] = Field(
        "one_to_one", description="greedy: each observation takes its best landmark (the paper); one_to_one: by assignment, none twice"
    )


class StatusSettings(Settings):
    """Checks of each landmark by itself instead of merging in 3D (DualMap III-B3)."""

    enabled: bool = Field(False, description="DualMap's checks decide about a landmark's life")
    existence: bool = Field(
        True,
        description="and so do the views in which it should have been seen and was not, as ``life`` says, unless ``life.enabled`` is off; "
        "off: the paper",
    )
    observations: int = Field(8, ge=1, description="observations that a stable landmark needs")
    majority: float = Field(2 / 3, ge=0, le=1, description="share of them that its most frequent word needs (the paper: two thirds)")
    alike_cosine: float = Field(
        0.75, ge=-1, le=1, description="features from which two words are names of one thing, and count together; 1: never (the paper)"
    )
    background: tuple[str, ...] = Field(
        ("wall", "floor", "ceiling"),
        description="a landmark without a word that looks more like these than any word said is never stable; none: looks do not count",
    )
    flat_m: float = Field(
        0.04,
        ge=0,
        description="nor is one without a word that is no thicker, or, where ``clouds.noise_at_1m_m`` is above 0, no thicker than that "
        "noise makes a surface; 0: neither counts",
    )
    silent_keyframes: int = Field(10, ge=1, description="a landmark not seen for so many keyframes is checked")
    silent_seconds: float = Field(2.0, ge=0, description="and for so long")
    split: bool = Field(
        True,
        description="part a landmark that is seen under two words at once; that comes only with ``overlap.assignment`` greedy, "
        "without effect otherwise",
    )
    split_keyframes: int = Field(6, ge=1, description="in more than so many of the newest ``window_keyframes`` it must have been")
    window_keyframes: int = Field(10, ge=1, description="so many keyframes with an observation of it are looked back at")
    fold: bool = Field(True, description="fold landmarks of one look and one place that were never seen apart; off: the paper")
    fold_gap_m: float = Field(0.05, ge=0, description="boxes are grown by so much")
    fold_share: float = Field(0.4, gt=0, le=1, description="share of the smaller box that must then lie in the other")
    fold_cosine: float = Field(0.85, ge=-1, le=1, description="features from which two look the same")
    merge: bool = Field(False, description="also fold landmarks whose clouds overlap (what the paper avoids)")
    merge_overlap: float = Field(0.9, gt=0, le=1, description="share of the smaller cloud from which two are one")
    merge_distance_m: float = Field(
        0.04, gt=0, description="points this near overlap, for that and for what goes with which side of a split"
    )
    merge_every: int = Field(20, ge=1, description="keyframes between two such passes")
