"""Immersed rigid bodies that fall, drift and tumble: Kirchhoff equations with a Langevin model of turbulence, on NVIDIA Warp."""

import pathlib as _pathlib

_here = _pathlib.Path(__file__).parent
if not (_here / "kernels").is_dir() and (_here.parent / "kernels" / "__init__.py").is_file():
    __path__.append(str(_here.parent))  # source checkout: kernels/ and scenes/ sit beside this package
