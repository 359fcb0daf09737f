"""Immersed rigid bodies that fall, drift and tumble: Kirchhoff equations with a Langevin model of turbulence, on NVIDIA Warp."""

import importlib as _importlib
import pathlib as _pathlib
from typing import TYPE_CHECKING, Any

_here = _pathlib.Path(__file__).parent
if not (_here / "kernels").is_dir() and (_here.parent / "kernels" / "__init__.py").is_file():
    __path__.append(str(_here.parent))  # source checkout: kernels/ and scenes/ sit beside this package

if TYPE_CHECKING:
    from warp_immersed import library
    from warp_immersed.added_mass import kirchhoff_tensor
    from warp_immersed.errors import InputError, MeshRepairWarning
    from warp_immersed.export_options import ExportOptions
    from warp_immersed.fluid import AIR, WATER, Fluid
    from warp_immersed.mass_properties import PointMass
    from warp_immersed.recording import Recording, open_recording
    from warp_immersed.scene import Scene
    from warp_immersed.shape import Shape
    from warp_immersed.simulation import simulate
    from warp_immersed.turbulence import HomogeneousTurbulence
    from warp_immersed.usd_export import export_usd
    from warp_immersed.version import __version__

# Where each public name lives. They are imported on first use, so that the command line starts fast.
_HOMES = {
    "AIR": "fluid",
    "WATER": "fluid",
    "Fluid": "fluid",
    "HomogeneousTurbulence": "turbulence",
    "InputError": "errors",
    "MeshRepairWarning": "errors",
    "PointMass": "mass_properties",
    "Recording": "recording",
    "Scene": "scene",
    "Shape": "shape",
    "__version__": "version",
    "ExportOptions": "export_options",
    "export_usd": "usd_export",
    "open_recording": "recording",
    "kirchhoff_tensor": "added_mass",
    "simulate": "simulation",
}


def __getattr__(name: str) -> Any:
    if name == "library":
        return _importlib.import_module("warp_immersed.library")
    if name in _HOMES:
        return getattr(_importlib.import_module(f"warp_immersed.{_HOMES[name]}"), name)
    raise AttributeError(f"module 'warp_immersed' has no attribute {name!r}")


__all__ = [
    "AIR",
    "WATER",
    "ExportOptions",
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
    "open_recording",
    "simulate",
]
