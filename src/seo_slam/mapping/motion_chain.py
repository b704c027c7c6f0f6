"""The camera's motion since the last keyframe, from the motions of single frames."""

import numpy as np

from seo_slam.geometry import FloatArray, adjoint, compose_motion, inverse
from seo_slam.types import Motion, OdometryStatus


class MotionChain:
    """Chains motions so that no uncertainty is lost or counted twice.

    Independent steps (wheels) add up by the adjoint. An odometry that measures every frame against a map of its own says with
    ``Motion.end_covariance`` how well: its steps telescope, so that between two frames only their own two errors remain, however many
    frames lie between.
    """

    def __init__(self) -> None:
        """Start at no keyframe."""
        self._motion: Motion | None = None
        self._at_keyframe: FloatArray | None = None  # end covariance of the keyframe
        self._telescopes = False

    @property
    def T_keyframe_frame(self) -> FloatArray:
        """(4, 4) the motion so far; the identity on the keyframe itself."""
        return np.eye(4) if self._motion is None else self._motion.T_previous_current

    @property
    def motion(self) -> Motion | None:
        """The motion so far with its covariance, "lost" if any step was; None on the keyframe itself."""
        return self._motion

    def add(self, step: Motion) -> None:
        """Append the motion of one frame."""
        self._telescopes = self._telescopes and step.end_covariance is not None
        if self._motion is None:
            self._motion = step
            return
        T, covariance = compose_motion(self._motion.T_previous_current, self._motion.covariance, step.T_previous_current, step.covariance)
        if self._telescopes and self._at_keyframe is not None and step.end_covariance is not None:
            Ad = adjoint(inverse(T))
            covariance = Ad @ self._at_keyframe @ Ad.T + step.end_covariance
        status: OdometryStatus = "lost" if "lost" in (self._motion.status, step.status) else "ok"
        self._motion = Motion(
            T_previous_current=T,
            covariance=covariance,
            status=status,
            T_world_camera=step.T_world_camera,
            end_covariance=step.end_covariance,
        )

    def restart(self, keyframe: Motion) -> None:
        """Begin anew at a keyframe, whose own motion was the last one added (or the first of all)."""
        self._at_keyframe = keyframe.end_covariance
        self._telescopes = self._at_keyframe is not None
        self._motion = None
