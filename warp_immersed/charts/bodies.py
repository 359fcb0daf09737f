"""The bodies on which integrators are compared, and runs of the product with them."""

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from warp_immersed import library
from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.body_model import BodyModel, body_model
from warp_immersed.charts.body_rates import started
from warp_immersed.device_state import Group, Precision, Surroundings
from warp_immersed.emitters import Emission
from warp_immersed.ensemble import Ensemble
from warp_immersed.fluid import AIR, WATER, Fluid
from warp_immersed.kernels.rigid_body import FAILED
from warp_immersed.shape import Shape

Array = NDArray[np.float64]
GRAVITY = 9.81
EVALUATIONS_PER_SUBSTEP = 4  # the product's RK4


@dataclass(frozen=True)
class TestBody:
    """A body to compare integrators on: spin at release [rad/s, world axes]; chaotic ones are compared by their statistics."""

    __test__ = False  # not for pytest

    name: str
    shape: Shape
    fluid: Fluid
    spin: tuple[float, float, float]
    chaotic: bool

    @property
    def model(self) -> BodyModel:
        """Its dynamics under standard gravity."""
        return model_in(self.shape, self.fluid)


def test_bodies() -> list[TestBody]:
    """Sphere, ellipsoid and fast spinner; the slides' paper, a disk near neutral buoyancy, a leaf."""
    return [
        TestBody("sphere, 2 cm, in water", library.sphere(0.01, 1100.0), WATER, (1.0, 2.0, 0.5), False),
        TestBody("ellipsoid 1:2:4 cm in water", library.ellipsoid((0.04, 0.02, 0.01), 1100.0), WATER, (1.0, 2.0, 0.5), False),
        TestBody("the same in air at 300 rad/s", library.ellipsoid((0.04, 0.02, 0.01), 1100.0), AIR, (300.0, 30.0, 60.0), False),
        TestBody("the slides' paper, 4 x 1 cm", library.elliptic_paper(), AIR, (0.0, 0.0, 0.0), True),
        TestBody("disk near neutral, 2 cm in water", library.disk(0.02, 1e-3, 1048.0), WATER, (0.0, 0.0, 0.0), True),
        TestBody("maple leaf, 7 cm", library.maple_leaf(), AIR, (0.0, 0.0, 0.0), True),
    ]


test_bodies.__test__ = False  # type: ignore[attr-defined]  # not for pytest


def model_in(shape: Shape, fluid: Fluid) -> BodyModel:
    """The model of a shape in a fluid under standard gravity."""
    return body_model(shape, fluid, kirchhoff_tensor(shape, fluid), GRAVITY)


@dataclass(frozen=True)
class Samples:
    """Bodies at equal intervals: positions (T, N, 3) [m], orientations (T, N, 4), velocities and angular velocities
    (T, N, 3), world axes; failed: (N,), whether a body was given up; body_steps: substeps taken by all."""

    positions: Array
    orientations: Array
    velocities: Array
    angular_velocities: Array
    failed: NDArray[np.bool_]
    body_steps: int


def run_product(
    groups: Sequence[tuple[BodyModel, Emission]],
    surroundings: Surroundings,
    fps: float,
    seconds: float,
    interval: float,
    precision: Precision = "float32",
) -> Samples:
    """The product's own kernels at `fps`, on one thread, sampled every `interval` [s] (a multiple of the frame)."""
    ensemble = Ensemble(
        [Group(model, emission, index + 1) for index, (model, emission) in enumerate(groups)],
        surroundings, fps, threads=1, precision=precision,
    )  # fmt: skip
    every = max(1, round(interval * fps))
    names = ("positions", "orientations", "velocities", "angular_velocities")
    record: dict[str, list[Array]] = {name: [] for name in names}
    for frame in ensemble.frames(round(seconds * fps) + 1):
        if frame.index % every == 0:
            for name in names:
                record[name].append(getattr(frame, name).astype(np.float64))
    ensemble.close()
    arrays = {name: np.array(values) for name, values in record.items()}
    return Samples(**arrays, failed=frame.state == FAILED, body_steps=frame.body_steps)


def evaluation_cost(model: BodyModel, fluid: Fluid, bodies: int = 2000, rounds: int = 7) -> float:
    """Seconds of one core for one evaluation of the product's right-hand side in float32: CPU time of frames in still air over
    substeps and stages, best of `rounds` blocks of frames, so that other work on the machine counts little."""
    ensemble = Ensemble([Group(model, started(bodies, 3), 1)], Surroundings(fluid), 24.0, threads=1)
    done, best = 0, np.inf
    for block in range(rounds + 1):
        start = time.process_time()
        for frame in ensemble.frames(4):
            steps = frame.body_steps
        if block > 0:
            best = min(best, (time.process_time() - start) / (steps - done))
        done = steps
    ensemble.close()
    return best / EVALUATIONS_PER_SUBSTEP
