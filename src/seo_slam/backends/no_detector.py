"""A detector that sees nothing: odometry only."""

from seo_slam.types import Detections, Frame


class NoDetector:
    """Finds nothing in any frame."""

    def detect(self, frame: Frame) -> Detections:  # noqa: ARG002  # the interface has it
        """Return no detections."""
        return Detections.empty()
