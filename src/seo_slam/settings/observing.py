"""Settings of what an observation carries: its feature and its cloud (DualMap III-A)."""

from typing import Self

from pydantic import Field, model_validator

from seo_slam.settings.base import Settings


class FeatureSettings(Settings):
    """The feature of an observation: a weighted sum of image and text embedding (DualMap Eq 1)."""

    image_weight: float = Field(0.0, ge=0, le=1, description="of the picture; 0: words only, no image encoder is asked. DualMap: 0.7")
    text_weight: float = Field(1.0, ge=0, le=1, description="of the word. DualMap: 0.3")
    crop_margin_px: int = Field(20, ge=0, description="pixels shown around a box to the image encoder")
    null_text: bool = Field(False, description="what has no word gets the mean embedding of all known words (DualMap III-A2)")
    classes: tuple[str, ...] = Field((), description="words for that mean; none: those that the detector knows, or has said so far")
    only_classes: bool = Field(False, description="detections of other words than features.classes are dropped; needs such words")

    @model_validator(mode="after")
    def _there_are_classes_to_keep(self) -> Self:
        if self.only_classes and not self.classes:
            raise ValueError("only_classes drops every word that is not among features.classes, which is empty; give some")
        return self


class CloudSettings(Settings):
    """Clouds of points of what is seen (DualMap III-A3)."""

    enabled: bool = Field(False, description="keep a cloud of each landmark; off: only a few surface points")
    voxel_m: float = Field(0.02, gt=0, description="one point, the mean, a cube of this side")
    noise_at_1m_m: float = Field(
        0.0,
        ge=0,
        description="three standard deviations of the depth noise at 1 m: no new point within this times squared depth of one that is "
        "there; 0: every voxel fills up with noise",
    )
    cluster_m: float = Field(0.1, gt=0, description="points nearer than this are neighbours (DBSCAN's eps)")
    cluster_points: int = Field(10, ge=1, description="a point with at least so many neighbours is inside a cluster")
    named_share: float = Field(
        1 / 3,
        gt=0,
        le=1,
        description="where at least this share of a landmark's observations has a class, the others abstain; 1: the paper",
    )
    least_points: int = Field(5, ge=1, description="a smaller cloud is none")
