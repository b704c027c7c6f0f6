"""Textured triangle meshes, read from GLB files.

A mesh carries its own paint, since that is laid out triangle by triangle. Only the Embree renderer draws meshes.
"""

import importlib.util
import io
import json
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import ConfigError, DatasetError, MissingBackendError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.primitives import Shape
from seo_slam.simulation.tessellation import Triangles
from seo_slam.simulation.textures import Texture
from seo_slam.simulation.world import Part
from seo_slam.types import IntArray

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""glTF is y up: (x, y, z) of the file is (x, -z, y) here."""

_WIDEST = 1e3
"""No triangle shows its image more often than this."""


@dataclass(frozen=True, slots=True, eq=False)
class MeshPaint:
    """The colours of a mesh of F triangles: an image each, times a tint at each corner.

    Attributes:
        uv: (F, 3, 2) float32, where each corner lies in its image: 0..1 to the right and *down*; images repeat.
        image: (F,) which image.
        images: (H, W, 3) uint8 each; one texel for a plain colour.
        tint: (F, 3, 3) float32 factors in 0..1 of the corners, or None for 1.
    """

    uv: NDArray[np.float32]
    image: IntArray
    images: tuple[NDArray[np.uint8], ...]
    tint: NDArray[np.float32] | None = None

    def mean_rgb(self) -> FloatArray:
        """Return the (3,) mean colour over the triangles, in 0..1."""
        means = np.array([image.reshape(-1, 3).mean(axis=0) / 255.0 for image in self.images])
        colours = means[self.image] if self.tint is None else means[self.image] * self.tint.mean(axis=1)
        return np.asarray(colours.mean(axis=0))


class MeshShape(Shape):
    """A triangle mesh; both sides of a triangle are seen.

    Attributes:
        vertices: (V, 3) metres, shape frame.
        faces: (F, 3) indices into them.
        paint: its own colours; None to wear the texture of its part.
    """

    is_mesh: ClassVar[bool] = True

    def __init__(self, vertices: FloatArray, faces: IntArray, paint: MeshPaint | None = None) -> None:
        """Take a mesh.

        Raises:
            ConfigError: no triangle, a vertex that is not finite, or a face that names a vertex that is not there.
        """
        vertices, faces = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
            raise ConfigError(f"mesh: got vertices {vertices.shape} and faces {faces.shape}, wanted (V, 3) and (F, 3), F > 0")
        if faces.min() < 0 or faces.max() >= len(vertices):
            raise ConfigError(f"mesh: got faces from {faces.min()} to {faces.max()}, wanted indices of {len(vertices)} vertices")
        if not np.isfinite(vertices).all():
            raise ConfigError("mesh: got a vertex with NaN or infinity")
        if paint is not None and not (len(paint.uv) == len(paint.image) == len(faces)):
            raise ConfigError(f"mesh: got paint of {len(paint.uv)} triangles for {len(faces)}")
        self.vertices, self.faces, self.paint = vertices, faces, paint

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:  # noqa: ARG002
        """See ``Shape``.

        Raises:
            ConfigError: always; only Embree casts rays at meshes.
        """
        raise ConfigError("mesh: only the Embree renderer and caster take meshes; choose renderer 'embree'")

    def normals(self, p_shape: FloatArray) -> FloatArray:  # noqa: ARG002
        """See ``intersect``."""
        raise ConfigError("mesh: only the Embree renderer and caster take meshes; choose renderer 'embree'")

    def triangles(self) -> Triangles:  # noqa: D102
        return self.vertices, self.faces

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        x, y, z = self.vertices.T
        return float((x * direction[0] + y * direction[1] + z * direction[2]).max())


def load_glb(path: Path | str) -> tuple[Part, ...]:
    """Return what a GLB file shows, as one part: metres, turned to z up, otherwise where the file puts it.

    Base colours, textures and vertex colours are read. Not read: transparency (all is opaque), texture samplers (images repeat).

    Raises:
        DatasetError: the file is not there, is no GLB, or holds no triangle; the message names it.
        MissingBackendError: trimesh or pillow is not installed.
    """
    if any(importlib.util.find_spec(name) is None for name in ("trimesh", "PIL")):
        raise MissingBackendError("reading meshes needs trimesh and pillow: pip install 'seo-slam[sim]'")
    import trimesh

    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from error
    try:
        linear = _has_linear_colours(content)
        scene = trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)
        pieces = [(scene.geometry[scene.graph[node][1]], scene.graph[node][0]) for node in sorted(scene.graph.nodes_geometry)]
        pieces = [(mesh, T) for mesh, T in pieces if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
        shape = _merged(pieces, linear) if pieces else None
    except Exception as error:  # whatever the parser stumbles over, the file is at fault
        raise DatasetError(f"{path}: not a readable GLB ({type(error).__name__}: {error})") from error
    if shape is None or shape.paint is None:
        raise DatasetError(f"{path}: got no triangles")
    mean = shape.paint.mean_rgb().astype(np.float32)
    return (Part(shape, Texture(mean[None, None, None], (1.0, 1.0)), np.eye(4)),)


def _has_linear_colours(content: bytes) -> bool:
    """Whether factors and vertex colours are linear, as glTF wants them; trimesh writes those of its source, made for the screen."""
    magic, _, _, length = struct.unpack("<4sIII", content[:16])
    if magic != b"glTF":
        raise ValueError("no glTF header")
    return "trimesh" not in str(json.loads(content[20 : 20 + length])["asset"].get("generator", ""))


def _for_screen(linear: FloatArray) -> FloatArray:
    """Return sRGB values of linear ones, both in 0..1 (IEC 61966-2-1)."""
    low = np.minimum(linear, 0.0031308) * 12.92
    return np.where(linear <= 0.0031308, low, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def _merged(pieces: list[tuple[Any, FloatArray]], linear: bool) -> MeshShape:
    """Join trimesh meshes with their poses in the file into one, each with an image of its own."""
    vertices, faces, painted = [], [], []
    count = 0
    for mesh, T_file_mesh in pieces:
        R, p = _Z_UP @ T_file_mesh[:3, :3], _Z_UP @ T_file_mesh[:3, 3]
        own = np.asarray(mesh.vertices, dtype=np.float64)
        own_faces = np.asarray(mesh.faces, dtype=np.int64)
        vertices.append(own @ R.T + p)
        faces.append(own_faces + count)
        painted.append(_paint_of(mesh, own_faces, linear))
        count += len(own)
    images, uvs, tints = zip(*painted, strict=True)
    which = np.repeat(np.arange(len(pieces)), [len(own) for own in faces])
    tint = None
    if any(own is not None for own in tints):
        tint = np.concatenate([np.ones((*uv.shape[:2], 3), np.float32) if own is None else own for own, uv in zip(tints, uvs, strict=True)])
    return MeshShape(np.concatenate(vertices), np.concatenate(faces), MeshPaint(np.concatenate(uvs), which, images, tint))


def _paint_of(mesh: Any, faces: IntArray, linear: bool) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32] | None]:
    """Return image (H, W, 3), the corners in it (F, 3, 2) and their tint (F, 3, 3) of one trimesh mesh."""
    visual, screen = mesh.visual, _for_screen if linear else np.asarray
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    factor = np.ones(3)
    if material is not None and material.baseColorFactor is not None:
        factor = screen(np.asarray(material.baseColorFactor, dtype=np.float64)[:3] / 255.0)
    image = np.ones((1, 1, 3))
    corners = np.zeros((len(faces), 3, 2), dtype=np.float32)
    if material is not None and material.baseColorTexture is not None and uv is not None:
        image = np.asarray(material.baseColorTexture.convert("RGB"), dtype=np.float64) / 255.0
        corners = np.asarray(uv, dtype=np.float32)[faces]
        corners[..., 1] = 1.0 - corners[..., 1]  # trimesh counts upward
        corners -= np.floor(corners.min(axis=1, keepdims=True))  # near 0, where float32 is finest; images repeat
        corners[~(corners < _WIDEST).all(axis=(1, 2))] = 0.0  # a broken triangle (seen in the wild) gets one colour
    colours = getattr(visual, "vertex_attributes", {}).get("color")
    if colours is None and getattr(visual, "kind", None) == "vertex":
        colours = visual.vertex_colors
    tint = None
    if colours is not None:
        colours = np.asarray(colours)[:, :3] / (255.0 if np.asarray(colours).dtype == np.uint8 else 1.0)
        tint = np.asarray(screen(colours), dtype=np.float32)[faces]
    return np.round(255.0 * image * factor).astype(np.uint8), corners, tint
