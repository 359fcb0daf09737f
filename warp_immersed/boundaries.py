"""What is given on the six sides of a flow domain."""

from dataclasses import dataclass
from math import isfinite, log, sqrt

from warp_immersed.errors import InputError

Vector = tuple[float, float, float]

SIDES = ("x_min", "x_max", "y_min", "y_max", "z_min", "z_max")
VON_KARMAN = 0.41
C_MU = 0.09


@dataclass(frozen=True)
class Inlet:
    """Fluid enters with one velocity [m/s] (3,), one k [m^2/s^2] and one epsilon [m^2/s^3]."""

    velocity: Vector
    k: float
    epsilon: float

    @staticmethod
    def from_intensity(velocity: Vector, intensity: float, length_scale: float) -> "Inlet":
        """k = 3/2 (I U)^2 and epsilon = C_mu^(3/4) k^(3/2) / l, with the intensity I [-] and the length scale l [m]."""
        speed = sqrt(sum(c * c for c in velocity))
        k = 1.5 * (intensity * speed) ** 2
        return Inlet(velocity, k, C_MU**0.75 * k**1.5 / length_scale)


@dataclass(frozen=True)
class LogInlet:
    """The neutral atmospheric surface layer enters (Richards and Hoxey 1993): u = u* / kappa ln((y + z0) / z0) above the ground.

    direction: (3,) unit and horizontal. friction_velocity u* [m/s], roughness z0 [m], ground: height y where it starts [m].
    """

    direction: Vector
    friction_velocity: float
    roughness: float
    ground: float

    @staticmethod
    def from_reference(direction: Vector, speed: float, height: float, roughness: float, ground: float = 0.0) -> "LogInlet":
        """The profile with `speed` [m/s] at `height` [m] above the ground.

        Raises:
            InputError: direction is zero or not horizontal, or a value is not positive.
        """
        for name, value in (("reference_speed", speed), ("reference_height", height), ("roughness", roughness)):
            if not (isfinite(value) and value > 0.0):
                raise InputError(f"{name}: found {value!r}, must be a positive number")
        length = sqrt(sum(c * c for c in direction))
        if not (isfinite(length) and length > 0.0 and abs(direction[1]) <= 1e-6 * length):
            raise InputError(f"direction: found {list(direction)}, must be horizontal (y = 0) and not zero")
        unit = (direction[0] / length, 0.0, direction[2] / length)
        return LogInlet(unit, speed * VON_KARMAN / log((height + roughness) / roughness), roughness, ground)

    def speed(self, height: float) -> float:
        """Mean speed [m/s] at a height y [m]."""
        return self.friction_velocity / VON_KARMAN * log((max(height - self.ground, 0.0) + self.roughness) / self.roughness)


@dataclass(frozen=True)
class Wall:
    """A wall, smooth or with the roughness length z0 [m], that may slide along itself with a velocity [m/s] (3,)."""

    roughness: float = 0.0
    velocity: Vector = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Outlet:
    """Fluid leaves: pressure zero, everything else continued."""


@dataclass(frozen=True)
class Slip:
    """Nothing crosses and nothing rubs: a frictionless wall, or a plane of symmetry."""


@dataclass(frozen=True)
class Periodic:
    """Continues on the opposite side, which must be periodic too."""


Boundary = Inlet | LogInlet | Wall | Outlet | Slip | Periodic
