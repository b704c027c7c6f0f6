"""Settings of the hybrid front end (DualMap III-A1)."""

from typing import Literal

from pydantic import Field

from seo_slam.settings.base import Settings


class HybridSettings(Settings):
    """When two masks are one thing, and which segments are taken. Pixel counts are for 640x480 and scale with the image's area."""

    merge_iou: float = Field(0.8, gt=0, le=1, description="two masks that overlap more are one thing, whatever their colours")
    merge_colour: float = Field(0.95, gt=0, le=1, description="cosine of two colour histograms above which overlapping boxes are one thing")
    merge_overlap: float = Field(0.3, ge=0, le=1, description="share of the smaller box in the other from which boxes overlap")
    merge_by: Literal["masks", "boxes"] = Field(
        "masks", description="masks: those of overlapping boxes must overlap as well; boxes: as the paper, two alike chairs may become one"
    )
    novel_iou: float = Field(0.5, gt=0, le=1, description="a segment that overlaps a detection more is no news")
    novel_share: float = Field(0.6, gt=0, le=1, description="nor one of which, or in which, more than this share of the other lies")
    smallest_px: float = Field(204.0, ge=0, description="a smaller mask without a word is dropped")
    smallest_named_px: float = Field(60.0, ge=0, description="and with a word; the paper's code: 204 as well, which loses a peach at 2 m")
    silent_s: float = Field(60.0, gt=0, description="a segmenter that finds nothing for so long is worth a warning")


class StructureSettings(Settings):
    """Which segments without a word are walls, floor or ceiling, told by their shape alone."""

    planar_share: float = Field(0.85, gt=0, le=1, description="share of a segment's points that lie in one plane")
    plane_m: float = Field(0.03, gt=0, description="points this near to a plane lie in it")
    plane_share: float = Field(0.015, ge=0, description="and this share of their distance from the camera, for the depth's noise")
    large_m: float = Field(1.8, gt=0, description="nothing but structure is flat over so much both ways")
    cut_m: float = Field(1.0, gt=0, description="nor over so much both ways, if the image cuts it")
    outermost_m: float = Field(0.5, gt=0, description="a flat segment at least so long is structure if nothing lies behind its plane")
    behind_share: float = Field(0.02, ge=0, lt=1, description="share of the image's points behind a plane that still counts as nothing")
    behind_m: float = Field(0.1, gt=0, description="points at least so far behind a plane lie behind it")
