"""Fluids that bodies fall through."""

from dataclasses import dataclass
from math import isfinite

from warp_immersed.errors import InputError


@dataclass(frozen=True)
class Fluid:
    """A homogeneous Newtonian fluid.

    Args:
        density: mass density [kg/m^3], positive.
        kinematic_viscosity: nu = mu / density [m^2/s], positive.

    Raises:
        InputError: a value is not a positive finite number.
    """

    density: float
    kinematic_viscosity: float

    def __post_init__(self) -> None:
        for name in ("density", "kinematic_viscosity"):
            value = getattr(self, name)
            if not (isfinite(value) and value > 0.0):
                raise InputError(f"fluid {name}: found {value!r}, must be a positive number")

    @property
    def dynamic_viscosity(self) -> float:
        """mu = density * nu [Pa s]."""
        return self.density * self.kinematic_viscosity


# Dry air at 20 C and 1 atm; fresh water at 20 C.
AIR = Fluid(density=1.204, kinematic_viscosity=1.516e-5)
WATER = Fluid(density=998.2, kinematic_viscosity=1.004e-6)

PRESETS = {"air": AIR, "water": WATER}
