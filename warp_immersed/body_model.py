"""`BodyModel`: the numbers with which the device moves one kind of body (see kernels/rigid_body.py)."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.optimize import brentq

from warp_immersed.exact_tensors import shifted_tensor
from warp_immersed.fluid import Fluid
from warp_immersed.force_law import LoadCoefficients, quasi_steady_coefficients
from warp_immersed.plates import Plate, plates_of
from warp_immersed.resting import Resting, resting
from warp_immersed.shape import Shape

Array = NDArray[np.float64]
Coefficient = Callable[[LoadCoefficients], Array | float]

FRICTION_COEFFICIENT = 0.5

# Load coefficients that are no forces, so that the mass leaves them alone.
UNDIVIDED = ("pressure_center", "lift_onset_cubed", "lift_lag", "munk_cut_edge", "munk_cut_swing")


@dataclass(frozen=True)
class SubstepRates:
    """Bound on a body's fastest rate [1/s] at speed V and spin w: linear + root V^(1/2) + speed V + spin w.

    linear [1/s], root [1/(m s)^(1/2)], speed [1/m], spin [1]; start [1/s] holds for a body at rest that gravity moves.
    """

    linear: float
    root: float
    speed: float
    spin: float
    start: float


@dataclass(frozen=True)
class PointModel:
    """A body without attitude, divided by its mass (kernels/point_mass.py).

    inertia: mass and mean added mass; drag (3,): rate of slowing per 1, V^(1/2) and V, over the inertia [1/s, 1/(m s)^(1/2),
    1/m]; fall_speed [m/s]: terminal; tumbling: spin per speed [1/m]; glide: sideways speed, across
    the axis of tumbling, over speed.
    """

    inertia: float
    drag: Array
    fall_speed: float
    tumbling: float = 0.0
    glide: float = 0.0


@dataclass(frozen=True)
class BodyModel:
    """Dynamics of one kind of body, divided by its mass.

    inertia (6, 6): mass and added mass about the centre of mass, [[M, D], [D^T, J]] in [1, m, m^2];
    net_weight: 1 - rho V / m; buoyancy_arm (3,) [m]: -rho V / m times the centre of buoyancy; loads: per unit mass;
    settling_rate [1/s] and friction [m/s^2] of a body on the ground; bounding_radius [m]; eddy_size [m]: smaller eddies are
    averaged out over the body; point: what is left of it without its attitude; plates: of a body that is not flat, their loads
    per unit mass.
    """

    inertia: Array
    net_weight: float
    buoyancy_arm: Array
    loads: LoadCoefficients
    rates: SubstepRates
    resting: Resting
    bounding_radius: float
    settling_rate: float
    friction: float
    eddy_size: float
    point: PointModel
    plates: tuple[Plate, ...] = ()


def body_model(shape: Shape, fluid: Fluid, added_mass: Array, gravity: float) -> BodyModel:
    """The model of a shape in a fluid, given its Kirchhoff tensor (6, 6) and the magnitude of gravity [m/s^2]."""
    inertia = (np.diag([shape.mass] * 3 + list(shape.inertia)) + added_mass) / shape.mass
    loads = specific_loads(quasi_steady_coefficients(shape, fluid), shape.mass)
    displaced = fluid.density * shape.volume / shape.mass
    net_weight = 1.0 - displaced
    plates = tuple(replace(plate, loads=specific_loads(plate.loads, shape.mass)) for plate in plates_of(shape, fluid))
    radius = shape.bounding_radius
    pull = max(abs(net_weight) * gravity, 1e-6)
    return BodyModel(
        inertia=inertia,
        net_weight=net_weight,
        buoyancy_arm=-displaced * shape.center_of_buoyancy,
        loads=loads,
        rates=substep_rates(inertia, loads, abs(net_weight) * gravity, plates),
        resting=resting(shape),
        bounding_radius=radius,
        # a rod of length R that topples about its end: rate^2 = 3 g / (2 R), slowed by the air it pushes away
        settling_rate=float(np.sqrt(1.5 * pull / (inertia[2, 2] * radius))),
        friction=float(FRICTION_COEFFICIENT * pull / inertia[0, 0]),
        eddy_size=2.0 * float(np.sqrt(shape.semi_axes[0] * shape.semi_axes[1])),
        point=point_model(inertia, loads, abs(net_weight) * gravity),
        plates=plates,
    )


def without_lift(model: BodyModel, gravity: float) -> BodyModel:
    """The model with drag and damping as its only loads, for the `kirchhoff` level; gravity [m/s^2]."""
    none = np.zeros(3)
    loads = replace(
        model.loads,
        drag_oblique=0.0, lift=0.0, circulation=none, lift_lag=0.0, munk_cut_edge=0.0, munk_cut_swing=0.0,
        damping_oblique=none, damping_roll=0.0,
    )  # fmt: skip
    return replace(model, loads=loads, plates=(), rates=substep_rates(model.inertia, loads, abs(model.net_weight) * gravity))


def point_model(inertia: Array, loads: LoadCoefficients, pull: float) -> PointModel:
    """A body that shows all its sides to the flow equally: exact for a sphere. inertia and loads per unit mass; pull [m/s^2]."""
    mean_inertia = float(np.trace(inertia[:3, :3]) / 3.0)
    quadratic = np.maximum(loads.drag_quadratic, [0.0, 0.0, loads.drag_broadside])
    drag = np.array([loads.drag_linear.mean(), loads.drag_root.mean(), quadratic.mean()]) / mean_inertia
    return PointModel(mean_inertia, drag, terminal_speed(drag, pull / mean_inertia))


def terminal_speed(drag: Array, pull: float) -> float:
    """The speed V [m/s] at which (d0 + d1 V^(1/2) + d2 V) V balances a pull [m/s^2]; drag (3,) as in `PointModel`."""
    if pull == 0.0 or not drag.any():
        return 0.0

    def excess(root: float) -> float:
        return float((drag[0] + (drag[1] + drag[2] * root) * root) * root**2 - pull)

    top = 1e-3
    while excess(top) < 0.0:
        top *= 2.0
    return float(brentq(excess, 0.0, top)) ** 2


def specific_loads(loads: LoadCoefficients, mass: float) -> LoadCoefficients:
    """The same coefficients divided by the mass of the body [kg]."""
    divided = {name: value if name in UNDIVIDED else value / mass for name, value in vars(loads).items()}
    return LoadCoefficients(**divided)


def substep_rates(inertia: Array, loads: LoadCoefficients, pull: float, plates: tuple[Plate, ...] = ()) -> SubstepRates:
    """Rates for the substep rule from the body's inertia (6, 6) and loads, both per unit mass; pull [m/s^2].

    Drag and damping: largest eigenvalue of (inertia)^-1 (resistance), with the exponent of the speed as a factor, summed
    over the plates of a body that has some. Munk moment: the frequency or growth rate of a body that translates along axis j
    and turns about k, V (m_j |m_j - m_i| / (m_i J_k))^(1/2) (Lamb, art. 124), over all axes.
    """
    surfaces = [(plate.axes, plate.loads) for plate in plates] or [(np.eye(3), loads)]

    def rate_of(translation: Coefficient, rotation: Coefficient = lambda _: 0.0) -> float:
        resistance = np.zeros((6, 6))
        for axes, load in surfaces:
            own = np.zeros((6, 6))
            own[:3, :3] = axes @ np.diag(np.full(3, 1.0) * translation(load)) @ axes.T
            resistance += shifted_tensor(own, axes @ load.pressure_center)
            resistance[3:, 3:] += axes @ np.diag(np.full(3, 1.0) * rotation(load)) @ axes.T
        return float(eigh(resistance, inertia, eigvals_only=True)[-1])

    lightest = 1.0 / np.diag(np.linalg.inv(inertia))
    mass, moment = lightest[:3], lightest[3:]
    munk = gyration = 0.0
    circulation = np.sum([np.abs(axes) @ load.circulation for axes, load in surfaces], axis=0)
    for i in range(3):
        for j in range(3):
            k = 3 - i - j
            if i != j:
                munk = max(munk, mass[j] * abs(inertia[j, j] - inertia[i, i]) / (mass[i] * moment[k]))
                gyration = max(gyration, circulation[k] / np.sqrt(mass[i] * mass[j]))
    speed = (
        np.sqrt(munk)
        + 2.0 * rate_of(lambda load: np.maximum(load.drag_quadratic, [0.0, 0.0, load.drag_broadside]) + 0.25 * load.drag_oblique)
        + rate_of(lambda load: load.lift)
        + rate_of(lambda _: 0.0, lambda load: load.damping_speed + load.damping_oblique + load.damping_roll)
    )
    speed = max(speed, *(load.lift_lag for _, load in surfaces))
    linear = rate_of(lambda load: load.drag_linear, lambda load: load.damping_linear)
    return SubstepRates(
        linear=linear,
        root=1.5 * rate_of(lambda load: load.drag_root),
        speed=float(speed),
        spin=float(1.0 + gyration + 2.0 * rate_of(lambda _: 0.0, lambda load: load.damping_spin)),
        start=float(linear + np.sqrt(speed * pull / mass.min())),
    )
