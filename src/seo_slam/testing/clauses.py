"""How a contract check says what is wrong."""

from typing import Any

import numpy as np

from seo_slam.geometry import AnyArray


def require(holds: bool, plugin: Any, clause: str) -> None:
    """Raise ``AssertionError`` naming the plug-in and the clause unless it holds."""
    if not holds:
        raise AssertionError(f"{type(plugin).__name__}: {clause}")


def require_array(array: Any, shape: tuple[int, ...], kind: str, plugin: Any, what: str) -> None:
    """Raise unless ``array`` is a finite NumPy array of this shape and kind of type ("f", "i", "b")."""
    require(isinstance(array, np.ndarray), plugin, f"{what} is {type(array).__name__}, wanted a NumPy array")
    require(array.shape == shape, plugin, f"{what} has shape {array.shape}, wanted {shape}")
    require(array.dtype.kind == kind, plugin, f"{what} is {array.dtype}, wanted kind {kind!r}")
    if kind == "f":
        require(bool(np.isfinite(array).all()), plugin, f"{what} holds NaN or infinity")


def require_covariance(covariance: AnyArray, size: int, plugin: Any, what: str) -> None:
    """Raise unless ``covariance`` is finite, (size, size), symmetric and positive definite."""
    require_array(covariance, (size, size), "f", plugin, what)
    scale = float(np.abs(covariance).max()) or 1.0
    require(bool(np.allclose(covariance, covariance.T, atol=1e-6 * scale)), plugin, f"{what} is not symmetric")
    lowest = float(np.linalg.eigvalsh(0.5 * (covariance + covariance.T)).min())
    require(lowest > 0.0, plugin, f"{what} is not positive definite (lowest eigenvalue {lowest:.3g})")
