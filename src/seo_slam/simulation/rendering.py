"""Which renderer draws a world: Embree's for meshes and speed, or the small exact one for primitives."""

import importlib.util
from typing import Literal, Protocol

from seo_slam.camera import Camera
from seo_slam.errors import ConfigError, MissingBackendError
from seo_slam.geometry import FloatArray
from seo_slam.simulation.renderer import Rendered, render
from seo_slam.simulation.world import World

RendererName = Literal["auto", "embree", "primitive"]


class Renderer(Protocol):
    """Draws what a camera sees."""

    name: str

    def __call__(self, world: World, camera: Camera, T_world_camera: FloatArray, smooth_edges: bool = True) -> Rendered:
        """Return colour, depth and instances from a (4, 4) pose."""
        ...


class PrimitiveRenderer:
    """The ray caster of ``renderer``: exact, needs nothing, no meshes."""

    name = "primitive"

    def __call__(self, world: World, camera: Camera, T_world_camera: FloatArray, smooth_edges: bool = True) -> Rendered:
        """See ``Renderer``."""
        return render(world, camera, T_world_camera, smooth_edges)


def embree_is_installed() -> bool:
    """Whether the extra ``sim`` is there."""
    return all(importlib.util.find_spec(name) is not None for name in ("trimesh", "embreex"))


def require_embree(what: str) -> None:
    """Raise ``MissingBackendError`` unless the extra ``sim`` is installed; ``what`` needs it."""
    if not embree_is_installed():
        raise MissingBackendError(f"{what} needs trimesh and embreex: pip install 'seo-slam[sim]'")


def make_renderer(name: RendererName = "auto") -> Renderer:
    """Return a renderer: "auto" is Embree's if the extra ``sim`` is installed.

    Raises:
        MissingBackendError: "embree" without the extra.
        ConfigError: another name.
    """
    if name not in ("auto", "embree", "primitive"):
        raise ConfigError(f"renderer: got {name!r}, wanted auto, embree or primitive")
    if name == "primitive" or (name == "auto" and not embree_is_installed()):
        return PrimitiveRenderer()
    require_embree("the Embree renderer")
    from seo_slam.simulation.embree import EmbreeRenderer

    return EmbreeRenderer()
