"""When a frame becomes a keyframe."""

import numpy as np

from seo_slam.config import KeyframeSettings
from seo_slam.geometry import FloatArray, so3_log


def is_keyframe(T_keyframe_current: FloatArray, elapsed_s: float, settings: KeyframeSettings) -> bool:
    """Whether the camera moved, turned or waited enough since the last keyframe.

    Args:
        T_keyframe_current: (4, 4) motion since the last keyframe.
        elapsed_s: time since then.
        settings: the three limits.
    """
    moved_m = float(np.linalg.norm(T_keyframe_current[:3, 3]))
    turned_deg = float(np.degrees(np.linalg.norm(so3_log(T_keyframe_current[:3, :3]))))
    limits = (
        moved_m >= settings.distance_m,
        turned_deg >= settings.angle_deg,
        elapsed_s >= settings.period_s - 1e-6,  # stamps are rounded
    )
    return any(limits)
