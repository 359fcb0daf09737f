"""The arrays with which the device holds an ensemble."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import ceil, isinf
from typing import Any, Literal

import numpy as np
import trimesh
import warp as wp
from numpy.typing import NDArray

from warp_immersed.body_model import BodyModel
from warp_immersed.boundaries import VON_KARMAN, Inlet, LogInlet
from warp_immersed.emitters import Emission
from warp_immersed.errors import InputError
from warp_immersed.fidelity import Level
from warp_immersed.fluid import Fluid
from warp_immersed.kernels.rigid_body import WAITING, BodyKind, BodyKind64, Environment, Environment64, Plate, Plate64
from warp_immersed.plates import MOST_PLATES
from warp_immersed.seen_turbulence import decay_over, seen_turbulence, step_average
from warp_immersed.turbulence import LARGEST_C0, STILL, HomogeneousTurbulence, lagrangian_time_scale
from warp_immersed.turbulence_grid import TurbulenceGrid, far_field

Precision = Literal["float32", "float64"]
STRUCTS: dict[Precision, tuple[Any, Any, Any]] = {
    "float32": (BodyKind, Plate, Environment),
    "float64": (BodyKind64, Plate64, Environment64),
}

# The seen wind is renewed at least this often within its time scale T_L, so that its straight pieces keep its dispersion.
WIND_STEPS_PER_TIME_SCALE = 10
MOST_WIND_STEPS = 1000
MOST_GRID_WIND_STEPS = 16


@dataclass(frozen=True)
class Group:
    """Bodies of one kind: their model, how they start, the 32-bit key of their random numbers, and their level."""

    model: BodyModel
    emission: Emission
    random_key: int
    level: Level = "quasi_steady"


@dataclass(frozen=True)
class Surroundings:
    """What the bodies move in.

    fluid; gravity (3,) [m/s^2]; either a uniform mean_wind (3,) [m/s] with homogeneous turbulence, or a flow that varies in
    space (a baked grid, or a logarithmic wind); and the ground, if any: the plane y = ground_height [m], and a mesh [m]
    where that lies above it; each body's raised by its own part of layering [m]. Bodies that leave the box between the
    corners `bounds` [m] stop there.
    """

    fluid: Fluid
    gravity: tuple[float, float, float] = (0.0, -9.81, 0.0)
    mean_wind: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turbulence: HomogeneousTurbulence = STILL
    ground_height: float | None = None
    flow: TurbulenceGrid | LogInlet | None = None
    ground_mesh: trimesh.Trimesh | None = None
    layering: float = 0.0
    bounds: tuple[tuple[float, float, float], tuple[float, float, float]] | None = None

    @property
    def ground_varies(self) -> bool:
        """Whether the ground is another under every body."""
        return self.ground_mesh is not None or (self.layering > 0.0 and self.ground_height is not None)


@dataclass(frozen=True)
class DeviceState:
    """Arguments of the frame kernel, in its order.

    constants: kinds, plates, environment, flow, supports, rests, clock; schedule (when each body is released, and its ground)
    and evolving: one entry a body, the last two being alternatives for bodies of one plate and of several; outputs: two sets
    of arrays by the kernel's argument names.
    """

    constants: list[Any]
    schedule: list[wp.array]
    evolving: list[wp.array]
    outputs: tuple[dict[str, wp.array], dict[str, wp.array]]
    clock: wp.array
    ground_mesh: wp.Mesh | None

    @property
    def changing(self) -> dict[str, wp.array]:
        """By name every array that one frame leaves for the next. Outputs are made anew by each frame, constants stay."""
        named: dict[str, wp.array] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name not in ("constants", "outputs"):
                arrays = value if isinstance(value, list) else [value]
                named |= {f"{field.name}_{i}": array for i, array in enumerate(arrays) if isinstance(array, wp.array)}
        return named

    @property
    def bytes_per_body(self) -> int:
        """Device memory a body takes, both sets of outputs included."""
        arrays = [*self.schedule, *self.evolving, *self.outputs[0].values(), *self.outputs[1].values()]
        bodies = self.evolving[0].size
        return sum(wp.types.type_size_in_bytes(array.dtype) for array in arrays if array.size == bodies)


def allocate(
    groups: Sequence[Group],
    emission: Emission,
    surroundings: Surroundings,
    fps: float,
    seed: int,
    device: wp.Device,
    precision: Precision,
) -> DeviceState:
    """Put an ensemble on a device, its bodies waiting for their release. emission: of all groups, one after the other."""
    kind_struct, plate_struct, environment_struct = STRUCTS[precision]
    scalar = environment_struct.vars["wind_step"].type
    vec3 = environment_struct.vars["gravity"].type
    quaternion = wp.types.quaternion(scalar)
    plate_lifts = wp.types.vector(3 * MOST_PLATES, scalar)
    bodies = len(emission.positions)
    counts = [len(group.emission.positions) for group in groups]
    environment = environment_values(surroundings, 1.0 / fps, seed)
    plates = plate_values(groups)
    kinds, supports, rests = kind_values(groups, np.cumsum([0, *counts]), surroundings, environment["wind_step"])
    rounded = emission.positions.astype(np.float32 if precision == "float32" else np.float64)
    release_frame, release_fraction = release_frames(emission.release_times, fps)

    def array(values: Any, dtype: Any) -> wp.array:
        return wp.array(values, dtype=dtype, device=device)

    def empty(dtype: Any) -> wp.array:
        return wp.zeros(bodies, dtype=dtype, device=device)

    clock = array([0], wp.int32)
    ground_mesh = None
    if surroundings.ground_mesh is not None:
        points = array(np.asarray(surroundings.ground_mesh.vertices, dtype=np.float32), wp.vec3)
        ground_mesh = wp.Mesh(points, array(np.asarray(surroundings.ground_mesh.faces, dtype=np.int32).ravel(), wp.int32))
    outputs = tuple(
        {
            "position_out": empty(vec3),
            "orientation_out": empty(quaternion),
            "velocity_out": empty(vec3),
            "angular_velocity_out": empty(vec3),
            "state_out": empty(wp.uint8),
            "substeps_out": empty(wp.int32),
        }
        for _ in range(2)
    )
    return DeviceState(
        constants=[
            array([filled(kind_struct, values) for values in kinds], kind_struct),
            array([filled(plate_struct, values) for values in plates], plate_struct),
            array([filled(environment_struct, environment)], environment_struct),
            device_flow(surroundings, device),
            array(supports, vec3),
            array(rests, vec3),
            clock,
        ],
        schedule=[
            array(np.repeat(np.arange(len(groups)), counts), wp.int32),
            array(release_frame, wp.int32),
            array(release_fraction, scalar),
            # each body's ground plane, where the ground varies
            wp.zeros(bodies if surroundings.ground_varies else 1, dtype=vec3, device=device),
            wp.zeros(bodies if surroundings.ground_varies else 1, dtype=scalar, device=device),
        ],
        evolving=[
            wp.full(bodies, WAITING, dtype=wp.uint8, device=device),
            array(rounded, vec3),
            array(emission.positions - rounded.astype(np.float64), vec3),
            array(emission.orientations, quaternion),
            array(emission.velocities, vec3),
            array(emission.angular_velocities, vec3),
            empty(vec3),
            empty(vec3),
            empty(vec3),
            # lift of up to four plates; the arrays of bodies that have one are above
            wp.zeros(bodies if any(g.model.plates for g in groups) else 1, dtype=plate_lifts, device=device),
        ],
        outputs=(outputs[0], outputs[1]),
        clock=clock,
        ground_mesh=ground_mesh,
    )


def filled(struct: Any, values: Mapping[str, Any]) -> Any:
    """A Warp struct with its fields set from numbers and arrays of the right size."""
    instance = struct()
    for name, variable in struct.vars.items():
        if isinstance(values[name], Mapping):
            setattr(instance, name, filled(variable.type, values[name]))
        else:
            setattr(instance, name, variable.type(*np.ravel(values[name]).tolist()))
    return instance


def environment_values(surroundings: Surroundings, frame_time: float, seed: int) -> dict[str, Any]:
    """Fields of the Environment struct; frame_time [s]."""
    wind_steps = wind_steps_per_frame(frame_time, surroundings)
    wind_step = frame_time / wind_steps
    return {
        "gravity": surroundings.gravity,
        "mean_wind": surroundings.mean_wind,
        "wind_step": wind_step,
        "wind_steps": wind_steps,
        "wind_varies": int(surroundings.flow is not None),
        "viscosity": surroundings.fluid.kinematic_viscosity,
        "has_ground": int(surroundings.ground_height is not None),
        "has_ground_mesh": int(surroundings.ground_varies),
        "ground_height": surroundings.ground_height or 0.0,
        "seed": seed,
    }


def wind_steps_per_frame(frame_time: float, surroundings: Surroundings) -> int:
    """How often the seen wind is renewed in a frame [s].

    Raises:
        InputError: the turbulence changes too fast for frames of this length.
    """
    if isinstance(surroundings.flow, TurbulenceGrid):
        return grid_wind_steps(frame_time, surroundings.flow)
    if isinstance(surroundings.flow, LogInlet):
        # one metre above the ground, where epsilon / k = 0.3 u* / (kappa y)
        rate = 0.75 * LARGEST_C0 * 0.3 * surroundings.flow.friction_velocity / VON_KARMAN
        return int(np.clip(ceil(frame_time * WIND_STEPS_PER_TIME_SCALE * rate), 1, MOST_GRID_WIND_STEPS))
    turbulence = surroundings.turbulence
    time_scale = lagrangian_time_scale(turbulence, surroundings.fluid)
    if time_scale == 0.0 or isinf(time_scale):
        return 1
    steps = ceil(frame_time * WIND_STEPS_PER_TIME_SCALE / time_scale)
    if steps > MOST_WIND_STEPS:
        shortest = frame_time * WIND_STEPS_PER_TIME_SCALE / MOST_WIND_STEPS
        raise InputError(
            f"turbulence: its time scale T_L is {time_scale:.3g} s (k {turbulence.k:.3g}, epsilon {turbulence.epsilon:.3g}), "
            f"too short for frames of {frame_time:.3g} s; it must be at least {shortest:.3g} s: lower epsilon, or use "
            f'kind = "none"'
        )
    return steps


def grid_wind_steps(frame_time: float, grid: TurbulenceGrid) -> int:
    """Wind updates in a frame [s] on a grid: ten in the time scale that all but a tenth of the cells exceed, two in a cell's
    passage at the largest speed, at most MOST_GRID_WIND_STEPS: next to walls turbulence is faster than anything visible."""
    inside = np.broadcast_to(grid.fluid, grid.k.shape) & (grid.k > 0.0) & (grid.epsilon > 0.0)
    k, epsilon = grid.k[inside].astype(np.float64), grid.epsilon[inside].astype(np.float64)
    rate = 2.0 * float(np.abs(grid.velocity).max()) / min(grid.spacing)
    if len(k):
        rate = max(rate, WIND_STEPS_PER_TIME_SCALE * 0.75 * LARGEST_C0 * float(np.quantile(epsilon / k, 0.9)))
    return int(np.clip(ceil(frame_time * rate), 1, MOST_GRID_WIND_STEPS))


def device_flow(surroundings: Surroundings, device: wp.Device) -> Any:
    """The flow that varies in space, for kernels.langevin; an empty one where the wind is uniform."""
    if isinstance(surroundings.flow, TurbulenceGrid):
        return surroundings.flow.on_device(device)
    return far_field(surroundings.flow or Inlet(surroundings.mean_wind, 0.0, 0.0), device)


def kind_values(
    groups: Sequence[Group], first_bodies: NDArray[Any], surroundings: Surroundings, wind_step: float
) -> tuple[list[dict[str, Any]], NDArray[Any], NDArray[Any]]:
    """Fields of the BodyKind struct for each group, and all their support points (S, 3) and rest directions (R, 3)."""
    kinds = []
    gravity = np.asarray(surroundings.gravity)
    down = gravity / max(float(np.linalg.norm(gravity)), 1e-30)
    supports, rests = [group.model.resting.supports for group in groups], [group.model.resting.rests for group in groups]
    first_support = np.cumsum([0, *(len(s) for s in supports)])
    first_rest = np.cumsum([0, *(len(r) for r in rests)])
    first_plate = np.cumsum([0, *(len(group.model.plates) for group in groups)])
    for i, group in enumerate(groups):
        model = group.model
        inverse = np.linalg.inv(model.inertia)
        seen = seen_turbulence(surroundings.turbulence, surroundings.fluid, model.eddy_size)
        kinds.append(
            {
                "linear_inertia": model.inertia[:3, :3],
                "coupling": model.inertia[:3, 3:],
                "angular_inertia": model.inertia[3:, 3:],
                "inverse_linear": inverse[:3, :3],
                "inverse_coupling": inverse[:3, 3:],
                "inverse_angular": inverse[3:, 3:],
                "net_weight": model.net_weight,
                "buoyancy_arm": model.buoyancy_arm,
                "loads": {**vars(model.loads), "munk_mass": np.diag(model.inertia)[:3]},
                "first_plate": first_plate[i],
                "plate_count": len(model.plates),
                **{f"rate_{name}": rate for name, rate in vars(model.rates).items()},
                "eddy_size": model.eddy_size,
                "wind_sigma": seen.velocity_rms,
                "wind_decay": decay_over(wind_step, seen.time_scale),
                "rotation_sigma": seen.rotation_rms * step_average(wind_step, seen.rotation_time_scale),
                "rotation_decay": decay_over(wind_step, seen.rotation_time_scale),
                "point_inertia": model.point.inertia,
                "point_drag": model.point.drag,
                "tumbling": model.point.tumbling,
                "fall_speed": model.point.fall_speed,
                "fall_velocity": model.point.fall_speed * np.sign(model.net_weight) * down,
                "glide": model.point.glide,
                "bounding_radius": model.bounding_radius,
                "settling_rate": model.settling_rate,
                "friction": model.friction,
                "first_support": first_support[i],
                "support_count": len(supports[i]),
                "first_rest": first_rest[i],
                "rest_count": len(rests[i]),
                "first_body": first_bodies[i],
                "random_key": group.random_key,
            }
        )
    # Warp refuses arrays without elements
    return kinds, np.concatenate(supports), np.concatenate([*rests, np.zeros((1, 3))])


def plate_values(groups: Sequence[Group]) -> list[dict[str, Any]]:
    """Fields of the Plate struct for all plates of all groups; one that is not used where there are none."""
    values = []
    for group in groups:
        model = group.model
        added = np.diag(model.inertia)[:3]
        for plate in model.plates:
            munk_mass = [0.0, 0.0, float(plate.share @ (added - added.min()))]
            values.append({"axes": plate.axes, "loads": {**vars(plate.loads), "munk_mass": munk_mass}})
    # Warp refuses arrays without elements
    return values or [{"axes": np.eye(3), "loads": {**vars(groups[0].model.loads), "munk_mass": np.zeros(3)}}]


def release_frames(times: NDArray[Any], fps: float) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
    """The frame in which each body is released, and the fraction of it that has passed by then."""
    frames = np.floor(times * fps)
    return frames.astype(np.int32), times * fps - frames
