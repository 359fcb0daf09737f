"""Immersed rigid bodies that fall, drift and tumble: Kirchhoff equations with a Langevin model of turbulence, on NVIDIA Warp."""

import pathlib as _pathlib

_here = _pathlib.Path(__file__).parent
if not (_here / "kernels").is_dir() and (_here.parent / "kernels" / "__init__.py").is_file():
    __path__.append(str(_here.parent))  # source checkout: kernels/ and scenes/ sit beside this package

from warp_immersed import library
from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.errors import InputError, MeshRepairWarning
from warp_immersed.fluid import AIR, WATER, Fluid
from warp_immersed.mass_properties import PointMass
from warp_immersed.recording import Recording
from warp_immersed.scene import Scene
from warp_immersed.shape import Shape
from warp_immersed.simulate import simulate
from warp_immersed.turbulence import HomogeneousTurbulence
from warp_immersed.version import __version__


def export_usd(recording: Recording, path: str | _pathlib.Path) -> None:
    """Write a recording to a USD file (.usdc, .usda or .usd); see `warp_immersed.usd`."""
    from warp_immersed.usd import export_usd as write

    write(recording, path)


__all__ = [
    "AIR",
    "WATER",
    "Fluid",
    "HomogeneousTurbulence",
    "InputError",
    "MeshRepairWarning",
    "PointMass",
    "Recording",
    "Scene",
    "Shape",
    "__version__",
    "export_usd",
    "kirchhoff_tensor",
    "library",
    "simulate",
]
