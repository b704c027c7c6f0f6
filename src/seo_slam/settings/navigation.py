"""Settings of the navigator: what counts as a match, where to look next, how to drive (DualMap IV-B, IV-C)."""

from typing import Literal

from pydantic import Field

from seo_slam.settings.base import Settings

Strategy = Literal["updated", "original", "random"]
NextCandidate = Literal["learn", "highest", "same_class"]
Opportunism = Literal["never", "after_first", "always"]


class NavigationSettings(Settings):
    """How a thing is searched for by name. Scores are cosines in the space of the embedder: the defaults are for MiniLM and words."""

    attempts: int = Field(3, ge=1, description="candidates that are gone to before the search ends (the paper: three)")
    unknown_attempts: int = Field(
        6, ge=1, description="the same for what the map knows nothing like, where it has no hint where to begin; at least `attempts`"
    )
    margin: float = Field(0.1, ge=0, le=1, description="a match may score so much less than the first candidate did")
    enough_score: float = Field(
        0.75,
        ge=-1,
        le=1,
        description="a match that scores so is enough, however well the map did itself (one made of words alone scores 1); 1: the paper",
    )
    least_score: float = Field(0.55, ge=-1, le=1, description="below it nothing is alike: the map does not know what is asked for")
    unknown: Literal["search", "answer"] = Field(
        "search", description="such a thing is searched for all the same, or the answer is given at once: the map may lack what is there"
    )
    local_observations: int = Field(3, ge=1, description="observations of this search that a match needs")
    box_growth: float = Field(0.1, ge=0, le=1, description="the anchor's footprint box is grown by this share on each side for a match")
    strategy: Strategy = Field(
        "updated",
        description="where the next candidate comes from (Table V): the map updated on the way, the map as it was, or a random pick",
    )
    next_candidate: NextCandidate = Field(
        "learn",
        description="when nothing left scores like the first: where most is learned; the highest score (the paper); the first "
        "candidate's class first (the public code)",
    )
    opportunistic: Opportunism = Field(
        "after_first", description="whether a clear match elsewhere than at the candidate ends the search; only with strategy 'updated'"
    )
    clear_observations: int = Field(4, ge=1, description="observations of this search that a clear match elsewhere needs")
    clear_score: float = Field(0.7, ge=-1, le=1, description="and the score that it needs, beside that of any match")
    clear_range_m: float = Field(3.5, gt=0, description="and from how near it must have been seen")
    look_first: bool = Field(True, description="look at the furniture around before setting out")
    look_in_passing: bool = Field(
        True, description="where it is open what is where, stop on the way for furniture that was not seen well yet, and look at it"
    )
    views: int = Field(2, ge=1, le=4, description="places from which an anchor is looked at before it is given up")
    look_keyframes: int = Field(3, ge=1, description="keyframes that a look lasts")
    look_frames: int = Field(20, ge=1, description="frames that a look lasts at most")
    look_range_m: float = Field(3.5, gt=0, description="furniture this near is looked at from where the robot is, if it is in sight")
    seen_share: float = Field(0.7, gt=0, le=1, description="an anchor is seen well when this share of its top was")
    travel_m: float = Field(8.0, gt=0, description="a way so long halves what a place is worth")
    update_observations: int = Field(5, ge=1, description="a landmark not stable yet needs so many observations to enter the abstract map")
    verify: bool = Field(True, description="look once more before the match, and go on searching if it is something else")
    speed_m_s: float = Field(0.5, gt=0, description="fastest")
    turn_rad_s: float = Field(0.75, gt=0, description="fastest")
    look_ahead_m: float = Field(0.6, gt=0, description="the robot heads for the point of its path this far ahead")
    reach_m: float = Field(0.04, gt=0, description="a waypoint is reached at this distance")
    turned_rad: float = Field(0.06, gt=0, description="a heading is reached at this difference")
    escape_m: float = Field(
        1.0, ge=0, description="free floor this near to a robot outside of it is gone to first; after a look around, twice as far"
    )
    approach_m: float = Field(1.5, gt=0, description="the robot stops at most this far from the middle of the match")
    grow_floor: bool = Field(True, description="floor that the map does not know and that is seen on the way may be walked on")
    stuck_frames: int = Field(20, ge=2, description="frames without getting ahead after which another path is planned")
    replans: int = Field(3, ge=0, description="other paths on one way before it counts as blocked")
    max_steps: int = Field(3000, ge=1, description="frames after which a search is given up")
