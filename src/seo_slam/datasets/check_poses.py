"""Checks of the poses: coverage of the frames, one clock, no jumps, and whether they explain the depth."""

import itertools
from collections.abc import Callable, Sequence

import numpy as np

from seo_slam.datasets.findings import Finding, error, ok, warning
from seo_slam.datasets.pose_agreement import AS_IS, measure_agreement
from seo_slam.datasets.recording import ImagePair
from seo_slam.datasets.trajectory_files import interpolate_pose, usual_max_gap_s
from seo_slam.geometry import FloatArray, inverse, so3_log
from seo_slam.records import Trajectory
from seo_slam.types import Frame

Facts = dict[str, float | int | str | None]
_TOPIC = "poses"
_UNITS = {1e-9: "seconds, not nanoseconds", 1e-6: "seconds, not microseconds", 1e-3: "seconds, not milliseconds"}


def check_coverage(trajectory: Trajectory, pairs: Sequence[ImagePair], facts: Facts) -> list[Finding]:
    """Whether every frame has a pose, and why not."""
    stamps_s = np.array([pair.timestamp_s for pair in pairs])
    posed = _poses_of(trajectory, pairs)
    covered = sum(pose is not None for pose in posed)
    facts |= {"poses": len(trajectory), "frames_with_pose": covered}
    if covered == len(pairs):
        return [ok(_TOPIC, f"{len(trajectory)} poses, one for every frame")]
    first_s, last_s = (float(t) for t in trajectory.timestamps_s[[0, -1]])
    spans = f"frames {stamps_s[0]:.3f}..{stamps_s[-1]:.3f} s, poses {first_s:.3f}..{last_s:.3f} s"
    if covered == 0:
        for unit, words in _UNITS.items():
            for numbers_s, name in ((first_s, "pose"), (float(stamps_s[0]), "image")):
                other_s = float(stamps_s[0]) if name == "pose" else first_s
                if abs(other_s) > 1 and 0.9 < numbers_s * unit / other_s < 1.1:
                    return [error(_TOPIC, f"no frame has a pose: {spans}", f"write the {name} stamps in {words}")]
        fix = "images and poses need one clock: add the difference to one of them"
        return [error(_TOPIC, f"no frame has a pose: {spans}", fix)]
    what = f"{len(pairs) - covered} of {len(pairs)} frames have no pose ({spans})"
    return [warning(_TOPIC, what, "those frames count as lost; cut them, or use visual odometry")]


def check_jumps(trajectory: Trajectory, pairs: Sequence[ImagePair], facts: Facts) -> list[Finding]:
    """Whether the camera ever moved faster than a person or robot can."""
    posed = [(pair, pose) for pair, pose in zip(pairs, _poses_of(trajectory, pairs), strict=True) if pose is not None]
    jumps, fastest_m_s, fastest_deg_s = [], 0.0, 0.0
    for (a, T_a), (b, T_b) in itertools.pairwise(posed):
        step_s = b.timestamp_s - a.timestamp_s
        if step_s > 1.0:
            continue
        T_a_b = inverse(T_a) @ T_b
        moved_m, turned_deg = float(np.linalg.norm(T_a_b[:3, 3])), float(np.degrees(np.linalg.norm(so3_log(T_a_b[:3, :3]))))
        fastest_m_s, fastest_deg_s = max(fastest_m_s, moved_m / step_s), max(fastest_deg_s, turned_deg / step_s)
        if (moved_m > 0.1 and moved_m / step_s > 4) or (turned_deg > 10 and turned_deg / step_s > 400):
            jumps.append(f"{moved_m:.2f} m and {turned_deg:.0f} degrees in {step_s:.3f} s at frame {b.index} (t={b.timestamp_s:.3f})")
    facts |= {"fastest_m_s": fastest_m_s, "fastest_deg_s": fastest_deg_s}
    if jumps:
        fix = "poses from a tracker that was lost or relocalised there: cut the recording, or use visual odometry; units must be metres"
        return [warning(_TOPIC, f"{len(jumps)} jumps: {'; '.join(jumps[:3])}", fix)]
    return [ok(_TOPIC, f"no jumps (at most {fastest_m_s:.2f} m/s and {fastest_deg_s:.0f} degrees/s)")]


def check_agreement(
    trajectory: Trajectory, pairs: Sequence[ImagePair], read: Callable[[int], Frame | None], scale: float | None, facts: Facts
) -> list[Finding]:
    """Whether the poses carry the depth of one frame onto the depth of another."""
    poses = _poses_of(trajectory, pairs)
    compared = []
    for i, j in _frames_apart(poses):
        a, b, T_a, T_b = read(i), read(j), poses[i], poses[j]
        if a is not None and b is not None and T_a is not None and T_b is not None:
            compared.append((a, T_a, b, T_b))
    found = measure_agreement(compared) if len(compared) >= 2 else None
    if found is None:
        return [ok(_TOPIC, "the camera moves too little to tell whether the poses explain the depth")]
    as_is, best = found.shares[AS_IS], found.shares[found.best]
    facts["poses_explain_depth_share"] = as_is
    what = f"poses explain {100 * as_is:.0f} % of the depth"
    if found.best != AS_IS and best > 1.25 * as_is and best > 0.4:
        if found.depth_factor != 1.0:
            wanted = f"; set depth_scale to {scale / found.depth_factor:.5g}" if scale else ""
            return [
                error(
                    "depth",
                    f"{what}, but {100 * best:.0f} % if all depth is multiplied by {found.depth_factor:.4g}",
                    f"fix the depth unit{wanted}",
                )
            ]
        fix = "write T_world_camera: camera to world, OpenCV axes (x right, y down, z forward)"
        return [error(_TOPIC, f"{what}, but {100 * best:.0f} % if they are taken {found.best}", fix)]
    if as_is < 0.3:
        fix = "poses must be those of the colour camera (not of a body or marker), on the images' clock, in metres"
        return [warning(_TOPIC, what, fix)]
    return [ok(_TOPIC, f"{what} of other frames within 2 %")]


def _poses_of(trajectory: Trajectory, pairs: Sequence[ImagePair]) -> list[FloatArray | None]:
    max_gap_s = usual_max_gap_s(trajectory)
    return [interpolate_pose(trajectory, pair.timestamp_s, max_gap_s) for pair in pairs]


def _frames_apart(poses: Sequence[FloatArray | None], wanted: int = 8) -> list[tuple[int, int]]:
    """Pairs of frames that overlap but stand apart: 0.1-0.4 m or 8-20 degrees, spread over the recording."""
    found = []
    for i in np.unique(np.linspace(0, len(poses) - 1, wanted + 2).astype(int)[:-1]):
        start = poses[int(i)]
        if start is None:
            continue
        for j in range(int(i) + 1, min(len(poses), int(i) + 60)):
            end = poses[j]
            if end is None:
                continue
            T = inverse(start) @ end
            moved_m, turned_deg = np.linalg.norm(T[:3, 3]), np.degrees(np.linalg.norm(so3_log(T[:3, :3])))
            if moved_m > 0.4 or turned_deg > 20:
                break
            if moved_m > 0.1 or turned_deg > 8:
                found.append((int(i), j))
                break
    return found
