"""Checks of stamps, image files and depth values."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from seo_slam.camera import Camera
from seo_slam.datasets.alignment import measure_alignment
from seo_slam.datasets.findings import Finding, error, ok, warning
from seo_slam.datasets.recording import ImagePair, check_pair
from seo_slam.errors import DatasetError
from seo_slam.types import Frame

_KINECT_STEP_PER_M = 2.85e-3
Facts = dict[str, float | int | str | None]


def check_stamps(pairs: Sequence[ImagePair], facts: Facts) -> list[Finding]:
    """Rate, gaps, and the time between colour and depth."""
    stamps_s = np.array([pair.timestamp_s for pair in pairs])
    offsets_s = np.array([pair.depth_timestamp_s for pair in pairs]) - stamps_s
    facts |= {"frames": len(pairs), "duration_s": float(stamps_s[-1] - stamps_s[0])}
    facts["depth_minus_colour_s"] = float(np.median(offsets_s))
    if len(pairs) < 2:
        return [warning("stamps", "only one pair of images", "record more")]
    steps_s = np.diff(stamps_s)
    usual_s = float(np.median(steps_s))
    facts |= {"rate_hz": 1.0 / usual_s, "largest_gap_s": float(steps_s.max())}
    findings = []
    gaps = np.flatnonzero(steps_s > max(0.5, 5 * usual_s))
    if len(gaps):
        at = int(gaps[np.argmax(steps_s[gaps])])
        what = f"{len(gaps)} gaps in time, the longest {steps_s[at]:.2f} s after frame {at} (t={stamps_s[at]:.3f})"
        findings.append(warning("stamps", what, "visual odometry may get lost there; recorded poses bridge it"))
    if usual_s < 0.002 or usual_s > 5:
        what = f"images are {usual_s:.4g} s apart"
        findings.append(warning("stamps", what, "stamps must be in seconds: a file in ms, us or ns needs dividing"))
    spread_s = float(np.abs(offsets_s).max())
    what = f"{len(pairs)} pairs over {facts['duration_s']:.1f} s, {1 / usual_s:.1f} a second, depth up to {1000 * spread_s:.0f} ms off"
    return [*findings, ok("stamps", what)]


def check_files(pairs: Sequence[ImagePair], camera: Camera, source: str, scale: float | None) -> list[Finding]:
    """Headers and ends of all images."""
    faults = []
    for pair in pairs:
        try:
            check_pair(pair, camera, source, scale)
        except DatasetError as fault:
            faults.append(str(fault))
    if not faults:
        return [ok("images", f"all {2 * len(pairs)} files are whole and of one size, depth deep enough")]
    shown = "; ".join(faults[:3])
    fix = "repair or remove those files (the reader's skip_broken leaves them out)"
    return [error("images", f"{len(faults)} of {len(pairs)} pairs cannot be used: {shown}", fix)]


def check_depth(frames: Sequence[Frame], scale: float | None, facts: Facts) -> list[Finding]:
    """Unit and coverage of the depth of some frames."""
    samples = [frame.depth_m[::4, ::4] for frame in frames]
    seen = np.concatenate([sample[sample > 0] for sample in samples])
    zeros = 1.0 - len(seen) / sum(sample.size for sample in samples)
    facts |= {"depth_scale": scale, "depth_zero_share": float(zeros)}
    if len(seen) == 0:
        return [error("depth", "no pixel of the sampled frames has depth", "record depth; 0 means no return")]
    middle_m, high_m = float(np.median(seen)), float(np.percentile(seen, 95))
    facts |= {"median_depth_m": middle_m, "depth_95th_percentile_m": high_m}
    findings = []
    empty = [frame.index for frame in frames if not frame.has_depth]
    if empty:
        what = f"{len(empty)} of {len(frames)} sampled frames have no depth at all (frame {empty[0]})"
        findings.append(warning("depth", what, "such frames move the camera but map nothing"))
    if zeros > 0.6:
        what = f"{100 * zeros:.0f} % of the pixels have no depth"
        findings.append(warning("depth", what, "objects need depth: check range, sunlight and the registration step"))
    findings += _check_unit(middle_m, high_m, scale, _own_scale(frames, scale))
    at = f" at depth_scale {scale:g}" if scale else ""
    return findings or [
        ok("depth", f"half of it nearer than {middle_m:.2f} m, 95 % nearer than {high_m:.2f} m{at}; {100 * zeros:.0f} % empty")
    ]


def _own_scale(frames: Sequence[Frame], scale: float | None) -> float | None:
    found = [_scale_of_structured_light(frame.depth_m, scale) for frame in frames] if scale else []
    known = [value for value in found if value is not None]
    return float(np.median(known)) if len(known) > len(found) / 2 else None


def _scale_of_structured_light(depth_m: NDArray[np.float32], scale: float) -> float | None:
    """The depth scale that a Kinect's disparity steps give away; None if the depth does not count in such steps.

    Neighbouring values of a structured-light sensor are 2.85 mm z^2 apart (Khoshelham and Elberink, Sensors 2012), so that
    the stored integers tell their own unit. Over TUM's recordings the estimate is 4900-4970 for a true 5000.
    """
    units = np.unique(np.round(depth_m[depth_m > 0].astype(np.float64) * scale))
    if len(units) < 100:
        return None
    estimates = _KINECT_STEP_PER_M * units[1:] * units[:-1] / np.diff(units)
    middle = float(np.median(estimates))
    agree = float((np.abs(estimates / middle - 1) < 0.3).mean())
    return middle if agree > 0.85 else None


def _check_unit(middle_m: float, high_m: float, scale: float | None, own_scale: float | None) -> list[Finding]:
    if scale is None:
        if high_m > 50:
            what = f"depth in metres reaches {high_m:.0f} m"
            return [error("depth", what, "floating-point .npy must hold metres; these look like millimetres: divide by 1000")]
        return []
    what = f"half of the depth is nearer than {middle_m:.2f} m, 95 % nearer than {high_m:.2f} m, with depth_scale {scale:g}"
    likely = next((s for s in (1000.0, 5000.0) if own_scale is not None and 0.85 <= own_scale / s <= 1.1), scale)
    if likely != scale and not 0.5 < middle_m < 3.0:  # other sensors' steps may mislead: distances must look wrong too
        fix = f"the steps of the stored values are those of a Kinect with depth_scale {likely:g}: set that"
        return [warning("depth", what, fix)]
    fix = f"set depth_scale: {_better_scales(middle_m * scale)}"
    if high_m > 12:
        return [warning("depth", f"{what}: farther than RGB-D cameras see", fix)]
    if middle_m < 0.3:
        return [warning("depth", f"{what}: nearer than RGB-D cameras see", fix)]
    return []


def _better_scales(middle_raw: float) -> str:
    likely = [scale for scale in (1000.0, 5000.0, 6553.5, 10000.0, 256.0) if 0.5 <= middle_raw / scale <= 4.0]
    return ", ".join(f"{scale:g} would put it at {middle_raw / scale:.1f} m" for scale in likely) or "units of the file a metre"


def check_alignment(frames: Sequence[Frame], facts: Facts) -> list[Finding]:
    """Whether depth edges lie on colour edges, and if not, where they would."""
    found = measure_alignment((frame.rgb, frame.depth_m) for frame in frames)
    if found is None or found.edge_px < 100 * len(frames):
        return [ok("alignment", "too few depth edges to tell whether depth lies on colour")]
    width = frames[0].camera.width
    facts |= {"alignment_shift_x_px": found.shift_px[0], "alignment_shift_y_px": found.shift_px[1]}
    facts |= {"alignment_zoom": found.zoom, "alignment_strength": found.strength}
    fix = "register depth to the colour camera (for example RealSense's align_to color, depth_registration in ROS) and record again"
    x, y = found.shift_px
    if max(found.strength, found.strength_zoomed) < 0.2:
        what = "depth edges do not lie on colour edges, wherever they are moved: other view, mirrored, or wrong pairs"
        return [warning("alignment", what, fix)]
    if found.zoom != 1.0 and found.strength_zoomed > 1.15 * found.strength:
        what = f"depth fits colour best when scaled by {found.zoom:g}: it seems to have another field of view"
        return [warning("alignment", what, fix)]
    if np.hypot(x, y) > 0.016 * width and found.strength > 1.15 * found.strength_as_is:
        return [warning("alignment", f"depth fits colour best when moved by ({x:.0f}, {y:.0f}) px", fix)]
    return [ok("alignment", f"depth edges lie on colour edges (best shift {x:.0f}, {y:.0f} px)")]
