"""How a shape falls over the plane of Reynolds number and dimensionless moment of inertia: steadily, fluttering, in chaos or
tumbling, as Field, Klaus, Moore & Nori (Nature 388 (1997) 252) sorted falling disks.

Re = U D / nu with D the diameter of the disk of equal area; I* = J / (rho D^5) with J the mean moment of inertia about the
axes in the sheet, which for a disk of thickness t is pi rho_s t / (64 rho D). Everything else follows from the two but for
the thickness ratio, so the body is left as it is and each point of the plane is a fluid and a gravity of its own: those in
which the body falls D in a second.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.body_model import BodyModel, body_model, specific_loads, substep_rates
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.emitters import Emission
from warp_immersed.ensemble import Ensemble
from warp_immersed.errors import InputError
from warp_immersed.fluid import AIR, Fluid
from warp_immersed.force_law import CALIBRATED_PLATE, PlateCoefficients, quasi_steady_coefficients
from warp_immersed.kernels.rigid_body import FAILED
from warp_immersed.plates import plates_of
from warp_immersed.shape import Shape

Array = NDArray[np.float64]

REGIMES = ("steady", "periodic", "chaotic", "tumbling", "gliding", "failed")
STEADY, PERIODIC, CHAOTIC, TUMBLING, GLIDING, LOST = range(6)

# Releases: tilts from broadside [degrees]
TILTS = (3.0, 25.0, 45.0, 65.0, 87.0)
# All times in D / U: what is left out at the start, and what is looked at.
SETTLING, WINDOW, FRAMES_PER_TIME = 40.0, 60.0, 8.0
# A disk is at rest within so much of a straight fall, flips where its normal passes the horizontal by so much, and tumbles
# where so many of its half turns go on in the sense of the one before.
STEADY_TILT, FLIP_MARGIN, LASTING_SENSE, FEWEST_FLIPS = np.radians(3.0), 0.1, 0.85, 6


def disk_drag(reynolds: ArrayLike) -> Array:
    """Drag coefficient of a disk broadside on (Clift, Grace & Weber, Bubbles, Drops and Particles, 1978)."""
    re = np.asarray(reynolds, dtype=np.float64)
    return np.where(re < 133.0, 64.0 / (np.pi * re) * (1.0 + 0.138 * re**0.792), 1.17)


def with_plate(base: BodyModel, shape: Shape, fluid: Fluid, tensor: Array, gravity: float, plate: PlateCoefficients) -> BodyModel:
    """A body's model with another fluid, Kirchhoff tensor (6, 6), gravity [m/s^2] or (if it is flat) plate law; how it rests is
    kept."""
    inertia = (np.diag([shape.mass] * 3 + list(shape.inertia)) + tensor) / shape.mass
    loads = specific_loads(quasi_steady_coefficients(shape, fluid, plate), shape.mass)
    displaced = fluid.density * shape.volume / shape.mass
    plates = base.plates and plates_of(shape, fluid)
    plates = tuple(replace(plate, loads=specific_loads(plate.loads, shape.mass)) for plate in plates)
    return replace(
        base,
        inertia=inertia,
        net_weight=1.0 - displaced,
        buoyancy_arm=-displaced * shape.center_of_buoyancy,
        loads=loads,
        rates=substep_rates(inertia, loads, abs(1.0 - displaced) * gravity, plates),
        plates=plates,
    )


def model_at(
    base: BodyModel,
    shape: Shape,
    tensor: Array,
    reynolds: float,
    inertia: float,
    viscosity_factor: float,
    plate: PlateCoefficients,
) -> BodyModel:
    """The model of a shape in the fluid and gravity of a point (Re, I*), for an ensemble with gravity 1 m/s^2.

    base: its model in any fluid; tensor (6, 6): its Kirchhoff tensor in a fluid of density 1. The nominal speed, with which the
    viscosity follows from Re, is that of a steady fall with a disk's drag; viscosity_factor multiplies the viscosity.
    """
    area, diameter = planform(shape)
    density = shape.inertia[:2].mean() / (inertia * diameter**5)
    fluid = Fluid(density, viscosity_factor * diameter**2 / reynolds)
    share = 1.0 - density * shape.volume / shape.mass
    if share <= 0.0:
        raise InputError(f"shape: at I* {inertia:.3g} it would float; it must be thinner, or heavier against the fluid")
    gravity = 0.5 * density * area * float(disk_drag(reynolds)) * diameter**2 / (share * shape.mass)
    model = with_plate(base, shape, fluid, density * tensor, gravity, plate)
    return replace(model, net_weight=model.net_weight * gravity, buoyancy_arm=model.buoyancy_arm * gravity)


def planform(shape: Shape) -> tuple[float, float]:
    """Area [m^2] of a shape seen along its z axis, as that of its ellipse, and the diameter [m] of the disk of equal area."""
    area = float(np.pi * shape.semi_axes[0] * shape.semi_axes[1])
    return area, float(np.sqrt(4.0 * area / np.pi))


@dataclass(frozen=True)
class Falls:
    """Falls of one shape: regime (P, S) of each point and release as an index into REGIMES, and mean descent (P, S) over the
    nominal speed."""

    regime: NDArray[np.int64]
    descent: Array

    @property
    def most_frequent(self) -> NDArray[np.int64]:
        """The regime (P,) of most releases; the middle release decides a tie."""
        votes = np.stack([(self.regime == code).sum(axis=1) for code in range(len(REGIMES))], axis=1).astype(float)
        votes[np.arange(len(votes)), self.regime[:, self.regime.shape[1] // 2]] += 0.5
        return votes.argmax(axis=1)


def simulate_falls(
    shape: Shape,
    reynolds: ArrayLike,
    inertia: ArrayLike,
    tilts: Sequence[float] = TILTS,
    viscosity_factor: ArrayLike = 1.0,
    plates: Sequence[PlateCoefficients] = (CALIBRATED_PLATE,),
    window: float = WINDOW,
    threads: int | None = None,
) -> list[Falls]:
    """Let a shape fall at points (P,) of (Re, I*) from each tilt [degrees] and sort the motions; one entry a plate law.

    The releases are at rest, with a small disturbance out of the plane of the tilt. viscosity_factor: one or (P,).
    """
    re, moment, factor = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(v, float)) for v in (reynolds, inertia, viscosity_factor))
    )
    _, diameter = planform(shape)
    tensor = kirchhoff_tensor(shape, AIR) / AIR.density
    emission = releases(diameter, tilts)
    base = body_model(shape, AIR, AIR.density * tensor, 1.0)
    groups = [
        Group(model_at(base, shape, tensor, re[i], moment[i], factor[i], plate), emission, random_key=0)
        for plate in plates
        for i in range(len(re))
    ]
    normals, descent, failed = fall(groups, window, threads)
    regime = classify(normals)
    regime[failed] = LOST
    size = (len(plates), len(re), len(tilts))
    codes, speeds = regime.reshape(size), descent.reshape(size) / diameter
    return [Falls(codes[k], speeds[k]) for k in range(len(plates))]


def releases(diameter: float, tilts: Sequence[float]) -> Emission:
    """Bodies at rest with their normal tilted from the vertical, about slightly different axes."""
    count = len(tilts)
    half = 0.5 * (np.radians(np.asarray(tilts)) - np.pi / 2.0)
    orientations = np.column_stack([np.sin(half), np.zeros((count, 2)), np.cos(half)])
    disturbance = np.tile([0.02, 0.03, 0.02], (count, 1))
    return Emission(np.zeros((count, 3)), orientations, np.zeros((count, 3)), disturbance, np.zeros(count))


def fall(groups: Sequence[Group], window: float, threads: int | None) -> tuple[NDArray[np.float32], Array, NDArray[np.bool_]]:
    """Normals (F, N, 3) in the window, mean descent (N,) [m/s] in it, and which bodies failed."""
    first, frames = round(SETTLING * FRAMES_PER_TIME), round((SETTLING + window) * FRAMES_PER_TIME)
    ensemble = Ensemble(groups, Surroundings(AIR, gravity=(0.0, -1.0, 0.0)), FRAMES_PER_TIME, threads=threads)
    normals = np.empty((frames - first, ensemble.bodies, 3), dtype=np.float32)
    start: Any = None
    try:
        for frame in ensemble.frames(frames):
            if frame.index < first:
                continue
            if start is None:
                start = frame.positions[:, 1].copy()
            normals[frame.index - first] = normal_of(frame.orientations)
            end, state = frame.positions[:, 1], frame.state
        return normals, (start - end) / ((frames - 1 - first) / FRAMES_PER_TIME), state == FAILED
    finally:
        ensemble.close()


def normal_of(orientations: NDArray[Any]) -> NDArray[Any]:
    """World direction (N, 3) of body z, given quaternions (N, 4)."""
    x, y, z, w = orientations.T
    return np.column_stack([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])


def classify(normals: NDArray[Any]) -> NDArray[np.int64]:
    """Regimes (N,) from normals (F, N, 3): steady if the tilt stays below 3 degrees, gliding if it keeps another value and
    direction, chaotic if the body turns over, tumbling if it does so again and again in one sense; else periodic."""
    vertical = normals[..., 1]
    bodies = normals.shape[1]
    turned = np.cumsum(np.cross(normals[:-1], normals[1:]), axis=0)
    side = np.sign(vertical[0])
    flips, lasting = np.zeros(bodies), np.zeros(bodies)
    since = np.zeros((bodies, 3))
    last = np.zeros((bodies, 3))
    for frame in range(1, len(vertical)):
        over = np.flatnonzero(vertical[frame] * side < -FLIP_MARGIN)
        if len(over):
            half_turn = turned[frame - 1, over] - since[over]
            lasting[over] += (half_turn * last[over]).sum(axis=1) > 0.0
            flips[over] += 1
            side[over] *= -1.0
            last[over], since[over] = half_turn, turned[frame - 1, over]
    tilt = np.arccos(np.clip(np.abs(vertical), 0.0, 1.0)).max(axis=0)
    spread = np.sqrt(np.clip(1.0 - (normals.mean(axis=0) ** 2).sum(axis=1), 0.0, 1.0))
    regime = np.full(bodies, PERIODIC)
    regime[spread < np.sin(STEADY_TILT)] = GLIDING
    regime[tilt < STEADY_TILT] = STEADY
    regime[flips > 0] = CHAOTIC
    regime[(flips >= FEWEST_FLIPS) & (lasting >= LASTING_SENSE * (flips - 1))] = TUMBLING
    return regime
