"""Contract of an ``Odometry``."""

from collections.abc import Sequence

import numpy as np

from seo_slam.geometry import FloatArray, inverse, log
from seo_slam.interfaces import Odometry
from seo_slam.testing.clauses import require, require_covariance
from seo_slam.testing.worlds import hard_frames, tiny_frames, tiny_trajectory
from seo_slam.types import Frame, Motion


def check_odometry(odometry: Odometry, frames: Sequence[Frame] | None = None, T_world_camera: FloatArray | None = None) -> None:
    """Check that an odometry, freshly made, reports motions that the pipeline can use.

    Args:
        odometry: the one to check; it is fed all frames once.
        frames: in order of time; None for six small made-up ones and some that tell nothing, on which it must not raise.
        T_world_camera: (N, 4, 4) true poses of ``frames``, if known; then the motions must be about right and point the right way.

    Raises:
        AssertionError: says which clause failed.
    """
    require(isinstance(odometry, Odometry), odometry, "has no method update(frame)")
    truth = T_world_camera
    if frames is None:
        frames, truth = (*tiny_frames(), *hard_frames()), tiny_trajectory()
    motions = [_update(odometry, frame) for frame in frames]
    first = motions[0].T_previous_current
    require(bool(np.allclose(first, np.eye(4), atol=1e-9)), odometry, "the motion to the first frame is not the identity")
    if truth is not None:
        _compare(odometry, motions[: len(truth)], truth)


def _update(odometry: Odometry, frame: Frame) -> Motion:
    image = frame.rgb.copy()
    motion = odometry.update(frame)
    where = f"frame {frame.index}"
    require(isinstance(motion, Motion), odometry, f"update returned {type(motion).__name__} for {where}, wanted a Motion")
    require_covariance(motion.covariance, 6, odometry, f"the covariance of {where}")
    require(motion.status in ("ok", "lost"), odometry, f"status of {where} is {motion.status!r}, wanted 'ok' or 'lost'")
    require(motion.status == "ok" or bool(motion.message), odometry, f"{where} is lost, but its message does not say why")
    require(np.array_equal(image, frame.rgb), odometry, f"update changed the image of {where}; draw on a copy")
    return motion


def _compare(odometry: Odometry, motions: list[Motion], T_world_camera: FloatArray) -> None:
    followed = 0
    for k in range(1, len(motions)):
        if motions[k].status == "lost":
            continue
        followed += 1
        wanted = inverse(T_world_camera[k - 1]) @ T_world_camera[k]
        error, size = log(inverse(wanted) @ motions[k].T_previous_current), log(wanted)
        turn, shift = float(np.linalg.norm(error[:3])), float(np.linalg.norm(error[3:]))
        right = turn <= 0.5 * np.linalg.norm(size[:3]) + 0.005 and shift <= 0.5 * np.linalg.norm(size[3:]) + 0.005
        require(
            bool(right),
            odometry,
            f"the motion to frame {k} is off by {shift:.3f} m and {np.degrees(turn):.2f} degrees though its status is 'ok'; wanted "
            "T_previous_current, which maps points of the current camera to the previous one",
        )
    require(2 * followed >= len(motions) - 1, odometry, f"was lost in all but {followed} of {len(motions) - 1} easy steps")
