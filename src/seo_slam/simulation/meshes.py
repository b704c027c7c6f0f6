"""Textured triangle meshes, read from GLB files.

A mesh carries its own paint, since that is laid out triangle by triangle. Only the Embree renderer draws meshes.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from seo_slam.errors import ConfigError, DatasetError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.primitives import Shape
from seo_slam.simulation.tessellation import Triangles
from seo_slam.simulation.textures import Texture
from seo_slam.simulation.world import Part
from seo_slam.types import IntArray

_Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""glTF is y up: (x, y, z) of the file is (x, -z, y) here."""


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

    def intersect(self, p_shape: FloatArray, directions: FloatArray) -> FloatArray:
        """See ``Shape``.

        Raises:
            ConfigError: always; only Embree casts rays at meshes.
        """
        raise ConfigError("mesh: only the Embree renderer and caster take meshes; choose renderer 'embree'")

    def normals(self, p_shape: FloatArray) -> FloatArray:
        """See ``intersect``."""
        raise ConfigError("mesh: only the Embree renderer and caster take meshes; choose renderer 'embree'")

    def triangles(self) -> Triangles:  # noqa: D102
        return self.vertices, self.faces

    def support(self, direction: FloatArray) -> float:  # noqa: D102
        x, y, z = self.vertices.T
        return float((x * direction[0] + y * direction[1] + z * direction[2]).max())


def load_glb(path: Path | str) -> tuple[Part, ...]:
    """Return what a GLB file shows, as one part: metres, turned to z up, otherwise where the file puts it.

    Base colours, textures and vertex colours are read; transparency is not: everything is opaque.

    Raises:
        DatasetError: the file is not there, is no GLB, or holds no triangle; the message names it.
    """
    import trimesh

    path = Path(path)
    try:
        content = path.read_bytes()
    except OSError as error:
        raise DatasetError(f"{path}: {error.strerror or error}") from error
    try:
        scene = trimesh.load_scene(io.BytesIO(content), file_type="glb", process=False)
    except Exception as error:  # whatever the parser stumbles over, the file is at fault
        raise DatasetError(f"{path}: not a readable GLB ({type(error).__name__}: {error})") from error
    pieces = []
    for node in sorted(scene.graph.nodes_geometry):
        T, name = scene.graph[node]
        mesh = scene.geometry[name]
        if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces):
            pieces.append((mesh, np.asarray(T, dtype=np.float64)))
    if not pieces:
        raise DatasetError(f"{path}: got no triangles")
    shape = _merged(pieces)
    mean = shape.paint.mean_rgb() if shape.paint is not None else np.ones(3)
    return (Part(shape, Texture(mean.astype(np.float32)[None, None, None], (1.0, 1.0)), np.eye(4)),)


def _merged(pieces: list[tuple[Any, FloatArray]]) -> MeshShape:
    """Join trimesh meshes with their poses in the file into one, each with an image of its own."""
    vertices, faces, uvs, images, which, tints = [], [], [], [], [], []
    count = 0
    for mesh, T in pieces:
        T = T.copy()
        T[:3] = _Z_UP @ T[:3]
        own = np.asarray(mesh.vertices, dtype=np.float64)
        vertices.append(own @ T[:3, :3].T + T[:3, 3])
        own_faces = np.asarray(mesh.faces, dtype=np.int64)
        faces.append(own_faces + count)
        count += len(own)
        image, uv, tint = _paint_of(mesh, own_faces)
        which.append(np.full(len(own_faces), len(images), dtype=np.int64))
        images.append(image)
        uvs.append(uv)
        tints.append(tint)
    tint = None
    if any(t is not None for t in tints):
        tint = np.concatenate([np.ones((len(f), 3, 3), np.float32) if t is None else t for t, f in zip(tints, faces, strict=True)])
    paint = MeshPaint(np.concatenate(uvs), np.concatenate(which), tuple(images), tint)
    return MeshShape(np.concatenate(vertices), np.concatenate(faces), paint)


def _paint_of(mesh: Any, faces: IntArray) -> tuple[NDArray[np.uint8], NDArray[np.float32], NDArray[np.float32] | None]:
    """Return image (H, W, 3), corners in it (F, 3, 2) and tint (F, 3, 3) of one trimesh mesh."""
    visual = mesh.visual
    material, uv = getattr(visual, "material", None), getattr(visual, "uv", None)
    factor = np.ones(3)
    if material is not None and material.baseColorFactor is not None:
        factor = np.asarray(material.baseColorFactor, dtype=np.float64)[:3] / 255.0
    image = np.ones((1, 1, 3))
    corners = np.zeros((len(faces), 3, 2), dtype=np.float32)
    if material is not None and material.baseColorTexture is not None and uv is not None:
        image = np.asarray(material.baseColorTexture.convert("RGB"), dtype=np.float64) / 255.0
        corners = np.asarray(uv, dtype=np.float32)[faces]
        corners[..., 1] = 1.0 - corners[..., 1]  # trimesh counts upward
        corners -= np.floor(corners.min(axis=1, keepdims=True))  # near 0, where float32 is finest; images repeat
    colours = getattr(visual, "vertex_attributes", {}).get("color")
    if colours is None and getattr(visual, "kind", None) == "vertex":
        colours = visual.vertex_colors
    tint = None
    if colours is not None:
        colours = np.asarray(colours)
        colours = colours / 255.0 if colours.dtype == np.uint8 else colours
        tint = np.asarray(colours[:, :3], dtype=np.float32)[faces]
    return np.round(255.0 * image * factor).astype(np.uint8), corners, tint
