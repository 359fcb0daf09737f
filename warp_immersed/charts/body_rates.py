"""The product's own equations of motion in float64, one call for many bodies: what oracles and baselines integrate."""

from collections.abc import Sequence

import numpy as np
import warp as wp
from numpy.typing import NDArray
from scipy.integrate import DOP853

from warp_immersed.body_model import BodyModel
from warp_immersed.device_state import STRUCTS, Group, Surroundings, environment_values, filled, kind_values, plate_values
from warp_immersed.emitters import Emission, random_rotations
from warp_immersed.fluid import AIR
from warp_immersed.kernels.body_rates import body_rates

Array = NDArray[np.float64]

# columns of a state
P, L, Q, X = slice(0, 3), slice(3, 6), slice(6, 10), slice(10, 13)
LIFTS, COLUMNS = 12, 25


class BodyRates:
    """Rates of N bodies in still air.

    Calling it with states y (N, 25) gives dy/dt (N, 25); `velocities` (N, 6) are then those of y, body axes, linear then
    angular. Columns: momentum, angular momentum, orientation (x, y, z, w), position, lift of up to four plates.

    Args:
        models: kinds of body.
        kind_index: (N,) kind of each body.
        gravity: (3,) [m/s^2], world axes.
    """

    def __init__(
        self, models: Sequence[BodyModel], kind_index: NDArray[np.int64], gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    ):
        kind_struct, plate_struct, environment_struct = STRUCTS["float64"]
        none = started(0)
        still = Surroundings(AIR, gravity=gravity)
        groups = [Group(model, none, 0) for model in models]
        kinds, _, _ = kind_values(groups, np.zeros(len(models), dtype=np.int64), still, 1.0)
        environment = filled(environment_struct, environment_values(still, 1.0, 0))
        count = len(kind_index)
        arrays = [wp.zeros((count, columns), dtype=wp.float64, device="cpu") for columns in (COLUMNS, COLUMNS, 6)]
        self._state, self._rates, self._velocities = (array.numpy() for array in arrays)  # views
        self._launch = wp.launch(
            body_rates,
            dim=count,
            inputs=[
                wp.array([filled(kind_struct, values) for values in kinds], dtype=kind_struct, device="cpu"),
                wp.array([filled(plate_struct, values) for values in plate_values(groups)], dtype=plate_struct, device="cpu"),
                wp.array([environment], dtype=environment_struct, device="cpu"),
                wp.array(kind_index, dtype=wp.int32, device="cpu"),
                arrays[0],
            ],
            outputs=arrays[1:],
            device="cpu",
            record_cmd=True,
        )
        inertia = np.array([model.inertia for model in models])
        self.inertia: Array = inertia[kind_index]  # (N, 6, 6)
        self.inverse: Array = np.linalg.inv(inertia)[kind_index]

    def __call__(self, y: Array) -> Array:
        self._state[:] = y
        self._launch.launch()
        return self._rates.copy()

    @property
    def velocities(self) -> Array:
        """Velocities (N, 6) of the states last asked for."""
        return self._velocities.copy()

    def state(self, emission: Emission) -> Array:
        """States (N, 25) of bodies as they start."""
        q = emission.orientations
        velocities = np.concatenate([rotate_back(q, emission.velocities), rotate_back(q, emission.angular_velocities)], axis=1)
        momenta = np.einsum("nij,nj->ni", self.inertia, velocities)
        return np.concatenate([momenta, q, emission.positions, np.zeros((len(q), LIFTS))], axis=1)


def dop853(rates: BodyRates, y: Array, times: Array, tolerance: float = 1e-11) -> tuple[Array, int]:
    """States (len(times), N, 25) by SciPy's DOP853 from time 0, and the number of evaluations; times ascending [s]."""
    shape = y.shape
    solver = DOP853(
        lambda _, flat: rates(flat.reshape(shape)).ravel(), 0.0, y.ravel(), times[-1], rtol=tolerance, atol=1e-2 * tolerance
    )
    states = []
    for time in times:
        while solver.t < time:
            solver.step()
            if solver.status == "failed":
                raise ArithmeticError(f"DOP853 failed at {solver.t:.6g} s")
        at = solver.y if solver.t == time else solver.dense_output()(time) if solver.t > 0.0 else solver.y
        states.append(at.reshape(shape).copy())
    return np.array(states), solver.nfev


def started(
    count: int,
    seed: int = 0,
    spin: tuple[float, float, float] = (0.0, 0.0, 0.0),
    height: float = 0.0,
    orientations: Array | None = None,
    velocity: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Emission:
    """Bodies turned at random, with one spin [rad/s] and velocity [m/s] in world axes, released at once at one height [m]."""
    turned = random_rotations(np.random.default_rng(seed).random((count, 3))) if orientations is None else orientations
    return Emission(
        positions=np.tile((0.0, height, 0.0), (count, 1)),
        orientations=turned,
        velocities=np.tile(np.asarray(velocity, dtype=np.float64), (count, 1)),
        angular_velocities=np.tile(np.asarray(spin, dtype=np.float64), (count, 1)),
        release_times=np.zeros(count),
    )


def rotate(q: Array, v: Array) -> Array:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    u, w = q[..., :3], q[..., 3:]
    return v + 2.0 * cross(u, cross(u, v) + w * v)


def rotate_back(q: Array, v: Array) -> Array:
    """Vectors (..., 3) turned by the inverses of quaternions (..., 4)."""
    return rotate(q * np.array([-1.0, -1.0, -1.0, 1.0]), v)


def cross(a: Array, b: Array) -> Array:
    """Cross products over the last axis; NumPy's own takes several times as long on few rows."""
    ax, ay, az = a[..., 0], a[..., 1], a[..., 2]
    bx, by, bz = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], axis=-1)
