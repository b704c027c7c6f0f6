"""Checks of intrinsics against the image: size, principal point, field of view, lens."""

import numpy as np

from seo_slam.camera import Camera
from seo_slam.datasets.findings import Finding, error, ok, warning

_TOPIC = "camera"
_COMMON_SIZES = ((320, 240), (640, 360), (640, 480), (848, 480), (1280, 720), (1280, 960), (1920, 1080))


def check_camera(camera: Camera, source: str, image_size: tuple[int, int] | None) -> list[Finding]:
    """Compare intrinsics with the size (width, height) of the colour images, if known."""
    if image_size is not None and image_size != (camera.width, camera.height):
        factor = image_size[0] / camera.width
        return [
            error(
                _TOPIC,
                f"intrinsics ({source}) are for {camera.width}x{camera.height}, the images are {image_size[0]}x{image_size[1]}",
                f"write the intrinsics of these images; if they were scaled (not cut), multiply fx, fy, cx and cy by {factor:.4g}",
            )
        ]
    findings = [*_principal_point(camera), *_field_of_view(camera), *_lens(camera)]
    size = f"fx {camera.fx:g} fy {camera.fy:g} cx {camera.cx:g} cy {camera.cy:g}, {camera.width}x{camera.height}"
    return findings or [ok(_TOPIC, f"{size}, from {source}")]


def _principal_point(camera: Camera) -> list[Finding]:
    off_x = abs(camera.cx - (camera.width - 1) / 2) / camera.width
    off_y = abs(camera.cy - (camera.height - 1) / 2) / camera.height
    if max(off_x, off_y) <= 0.12:
        return []
    fix = "check cx and cy; they are pixels, not halves or metres"
    for width, height in _COMMON_SIZES:
        if abs(2 * camera.cx / width - 1) < 0.08 and abs(2 * camera.cy / height - 1) < 0.08:
            fix = f"they look like intrinsics of {width}x{height} images: multiply fx, fy, cx and cy by {camera.width / width:.4g}"
            break
    what = f"the principal point ({camera.cx:g}, {camera.cy:g}) is far from the middle of {camera.width}x{camera.height}"
    outside = not (0 <= camera.cx < camera.width and 0 <= camera.cy < camera.height)
    return [error(_TOPIC, what, fix) if outside else warning(_TOPIC, what, fix)]


def _field_of_view(camera: Camera) -> list[Finding]:
    findings = []
    fov_deg = float(np.degrees(2 * np.arctan(camera.width / (2 * camera.fx))))
    if not 25 <= fov_deg <= 125:
        what = f"fx {camera.fx:g} gives a horizontal field of view of {fov_deg:.0f} degrees; RGB-D cameras have 40 to 100"
        findings.append(warning(_TOPIC, what, "check fx: it is in pixels of these images"))
    if not 0.93 <= camera.fx / camera.fy <= 1.07:
        what = f"fx {camera.fx:g} and fy {camera.fy:g} differ by more than 7 %"
        findings.append(warning(_TOPIC, what, "check both; images stretched to another shape need fx and fy scaled apart"))
    return findings


def _lens(camera: Camera) -> list[Finding]:
    if not any(camera.distortion):
        return []
    border = np.linspace(0.0, 1.0, 20)
    u = np.concatenate([border, border, np.zeros(20), np.ones(20)]) * (camera.width - 1)
    v = np.concatenate([np.zeros(20), np.ones(20), border, border]) * (camera.height - 1)
    uv_px = np.stack([u, v], axis=-1)
    error_px = float(np.abs(camera.project(camera.back_project(uv_px, np.ones(len(u)))) - uv_px).max())
    if error_px < 0.5:
        return []
    what = f"the distortion {list(camera.distortion)} cannot be undone at the image border (off by {error_px:.0f} px)"
    return [warning(_TOPIC, what, "calibrate again with views that reach the corners, or undistort the images and write zeros")]
