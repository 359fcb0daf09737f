"""Bodies and runs for tests."""

from dataclasses import fields

import numpy as np

from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.body_model import BodyModel, body_model, point_model, substep_rates
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.emitters import Emission, random_rotations
from warp_immersed.ensemble import Ensemble
from warp_immersed.force_law import LoadCoefficients
from warp_immersed.resting import Resting

GRAVITY = 9.81


def no_loads(**changes) -> LoadCoefficients:
    """A fluid without viscosity or wakes, but for the coefficients given."""
    values = {}
    for field in fields(LoadCoefficients):
        values[field.name] = np.zeros(3) if field.type in ("Array", LoadCoefficients.__annotations__["drag_linear"]) else 0.0
    return LoadCoefficients(**{**values, **changes})


def ideal_body(mass=(1.0, 1.0, 1.0), moment=(1.0, 1.0, 1.0), coupling=None, net_weight=1.0, pull=0.0, loads=None) -> BodyModel:
    """A body given by its generalized inertia per unit mass, in a fluid that exerts `loads` and nothing else."""
    inertia = np.diag([*mass, *moment]).astype(float)
    if coupling is not None:
        inertia[:3, 3:] = coupling
        inertia[3:, :3] = np.asarray(coupling).T
    loads = loads or no_loads()
    corners = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    return BodyModel(
        inertia=inertia,
        net_weight=net_weight,
        buoyancy_arm=np.zeros(3),
        loads=loads,
        rates=substep_rates(inertia, loads, pull),
        resting=Resting(corners, np.zeros((0, 3))),
        bounding_radius=2.0,
        settling_rate=1.0,
        friction=1.0,
        eddy_size=1e-9,
        point=point_model(inertia, loads, pull),
    )


def started(positions=None, orientations=None, velocities=None, angular_velocities=None, release_times=None, count=1) -> Emission:
    """Bodies at rest at the origin, unrotated, released at once, but for what is given ((3,), (4,) or one row a body)."""

    def rows(values, default):
        values = np.asarray(default if values is None else values, dtype=float)
        return np.tile(values, (count, 1)) if values.ndim == 1 else values

    return Emission(
        rows(positions, (0.0, 0.0, 0.0)),
        rows(orientations, (0.0, 0.0, 0.0, 1.0)),
        rows(velocities, (0.0, 0.0, 0.0)),
        rows(angular_velocities, (0.0, 0.0, 0.0)),
        np.zeros(count) if release_times is None else np.asarray(release_times, dtype=float),
    )


def random_orientations(count: int, seed: int) -> np.ndarray:
    """Uniformly distributed quaternions (count, 4)."""
    return random_rotations(np.random.default_rng(seed).random((count, 3)))


def model_in(shape, fluid) -> BodyModel:
    """The model of a shape in a fluid under standard gravity."""
    return body_model(shape, fluid, kirchhoff_tensor(shape, fluid), GRAVITY)


def trajectory(
    groups: list[Group] | BodyModel, emission: Emission | None, surroundings: Surroundings, fps: float, frames: int, **options
):
    """Frames 0 ... frames - 1 of a run as a dict of arrays (frames, N, ...), and the ensemble's substeps under "body_steps"."""
    if isinstance(groups, BodyModel):
        assert emission is not None
        groups = [Group(groups, emission, random_key=1)]
    ensemble = Ensemble(groups, surroundings, fps, **options)
    names = ("positions", "orientations", "velocities", "angular_velocities", "state")
    record = {name: [] for name in names}
    steps = []
    for frame in ensemble.frames(frames):
        for name in names:
            record[name].append(getattr(frame, name).copy())
        steps.append(frame.body_steps)
    ensemble.close()
    return {**{name: np.array(values) for name, values in record.items()}, "body_steps": np.array(steps)}


def rotate(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    u, w = q[..., :3], q[..., 3:]
    return v + 2.0 * np.cross(u, np.cross(u, v) + w * v)


def rotate_back(q: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Vectors (..., 3) turned by the inverses of quaternions (..., 4)."""
    return rotate(q * [-1.0, -1.0, -1.0, 1.0], v)
