"""`Ensemble`: all bodies of a scene on one device, advanced frame by frame."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warp_immersed.device_state import Group, Precision, Surroundings, allocate
from warp_immersed.emitters import Emission
from warp_immersed.errors import InputError
from warp_immersed.frame_stepper import CpuStepper, CudaStepper, Outputs, available_threads
from warp_immersed.kernels import ground, integrate, point_mass
from warp_immersed.kernels.rigid_body import LANDED, MOVING, WAITING
from warp_immersed.kernels.runge_kutta import MOST_SUBSTEPS

KERNELS: dict[str, wp.Kernel] = {
    "drift": point_mass.advance_drift,
    "point": point_mass.advance_point,
    "kirchhoff": integrate.advance_kirchhoff,
    "quasi_steady": integrate.advance_quasi_steady,
    "plates": integrate.advance_plates,
}
# Points in a flow that varies in space have kernels of their own: looking it up would slow down all others.
UNEVEN_KERNELS = {**KERNELS, "drift": point_mass.advance_drift_uneven, "point": point_mass.advance_point_uneven}


@dataclass(frozen=True)
class Frame:
    """All bodies at one moment, in the order of their groups. The arrays are valid until the next frame is asked for.

    index; time [s]; positions (N, 3) [m] of the centres of mass; orientations (N, 4), (x, y, z, w), body to world;
    velocities (N, 3) [m/s] and angular_velocities (N, 3) [rad/s], world axes; state (N,) uint8: WAITING, MOVING, LANDED
    or FAILED; body_steps: substeps taken by all bodies since the start; snapshot: where one was asked for, copies of the
    device's arrays after this frame, from which `Ensemble.restore` goes on.
    """

    index: int
    time: float
    positions: NDArray[Any]
    orientations: NDArray[Any]
    velocities: NDArray[Any]
    angular_velocities: NDArray[Any]
    state: NDArray[np.uint8]
    body_steps: int
    snapshot: Mapping[str, NDArray[Any]] | None = None


class Ensemble:
    """All bodies of a scene on one device.

    Args:
        groups: the bodies, kind by kind.
        surroundings: what they move in.
        fps: frames per second of simulated time.
        device: a Warp device or its name ("cpu", "cuda:0").
        seed: 32-bit key of all random numbers.
        threads: CPU threads, default all cores; the results do not depend on it.
        precision: "float64" is the oracle for tests.

    Raises:
        InputError: turbulence too fast, or bodies too small, for frames of this length.
    """

    def __init__(
        self,
        groups: Sequence[Group],
        surroundings: Surroundings,
        fps: float,
        device: Any = "cpu",
        seed: int = 0,
        threads: int | None = None,
        precision: Precision = "float32",
    ):
        for group in groups:
            substeps = group.model.rates.linear / fps
            if group.level in ("kirchhoff", "quasi_steady") and substeps > MOST_SUBSTEPS:
                raise InputError(
                    f"a body of radius {group.model.bounding_radius:.3g} m is too small for {group.level}: it would need "
                    f"{substeps:.3g} substeps a frame, at most {MOST_SUBSTEPS}; use point, make it larger or raise fps"
                )
        emissions = [group.emission for group in groups]
        self._initial = Emission(*(np.concatenate([getattr(e, name) for e in emissions]) for name in vars(emissions[0])))
        self._runs = law_runs(groups)
        self._kernels = KERNELS if surroundings.flow is None else UNEVEN_KERNELS
        self._fps = fps
        self._real = np.dtype(precision)
        self._surroundings = surroundings
        self._device = wp.get_device(device)
        self._state = allocate(groups, self._initial, surroundings, fps, seed, self._device, precision)
        if self._device.is_cpu:
            self._stepper: CpuStepper | CudaStepper = CpuStepper(
                self.bodies, threads or available_threads(), self._state.clock, self._state.outputs, self._launch
            )
        else:
            self._stepper = CudaStepper(self.bodies, self._device, self._state.clock, self._state.outputs, self._launch)
        self._started = 0
        self._next = 0
        self._body_steps = 0

    @property
    def bodies(self) -> int:
        """Number of bodies."""
        return len(self._initial.positions)

    @property
    def bytes_per_body(self) -> int:
        """Device memory a body takes."""
        return self._state.bytes_per_body

    @property
    def frames_done(self) -> int:
        """Number of frames handed out, those before a restored snapshot included."""
        return self._next

    def frames(self, count: int, snapshot_due: Callable[[], bool] | None = None) -> Iterator[Frame]:
        """The next `count` frames, the first ever being the initial state. While one is looked at, the next is computed.

        snapshot_due: asked at every frame but the first ever and the last whether it shall carry a snapshot.
        """
        end = self._next + count
        while self._next < end:
            current = self._next
            self._next += 1
            self._start(current)
            snapshot = None
            if snapshot_due is not None and 0 < current < end - 1 and snapshot_due():
                self._stepper.wait(current)
                snapshot = {name: array.numpy().copy() for name, array in self._state.changing.items()}
            if current + 1 < end:
                self._start(current + 1)
            if current == 0:
                yield self._initial_frame()
            else:
                yield self._frame(current, self._stepper.wait(current), snapshot)

    def restore(self, frame: int, body_steps: int, snapshot: Mapping[str, NDArray[Any]]) -> None:
        """Stand where another ensemble of the same bodies stood after a frame: the next frame will be frame + 1.

        Raises:
            InputError: the snapshot is of another ensemble.
        """
        arrays = self._state.changing
        for name in sorted({*arrays, *snapshot}):
            there = snapshot[name].shape if name in snapshot else None
            here = arrays[name].numpy().shape if name in arrays else None
            if there != here:
                raise InputError(f"snapshot: {name} is of shape {there}, must be {here}: it belongs to another run")
        for name, array in arrays.items():
            array.assign(snapshot[name])
        self._started, self._next, self._body_steps = frame, frame + 1, body_steps

    def parked(self, frame: Frame) -> int:
        """How many bodies have left the bounds and stopped there."""
        if self._surroundings.bounds is None:
            return 0
        lower, upper = self._surroundings.bounds
        outside = ((frame.positions < lower) | (frame.positions > upper)).any(axis=1)
        return int(np.count_nonzero(outside & (frame.state == LANDED)))

    def close(self) -> None:
        """Let the device's threads or queues go."""
        self._stepper.close()

    def _start(self, frame: int) -> None:
        if frame > self._started:
            self._stepper.start(frame)
            self._started = frame

    def _launch(self, first: int, count: int, outputs: Outputs, record: bool) -> list[Any]:
        state, world = self._state, self._surroundings
        launches = []
        if world.bounds is not None:
            launches.append(
                wp.launch(
                    ground.park_outside,
                    dim=count,
                    inputs=[first, *(wp.vec3(*corner) for corner in world.bounds), state.evolving[1], state.evolving[0]],
                    device=self._device,
                    record_cmd=record,
                )
            )
        if world.ground_varies:
            mesh = wp.uint64(state.ground_mesh.id if state.ground_mesh else 0)
            launches.append(
                wp.launch(
                    ground.find_ground,
                    dim=count,
                    inputs=[
                        first, state.constants[0], state.schedule[0], state.constants[2], mesh, wp.float32(world.layering),
                        *state.evolving[:2],
                    ],
                    outputs=state.schedule[-2:],
                    device=self._device,
                    record_cmd=record,
                )
            )  # fmt: skip
        for law, start, end in self._runs:
            lower, upper = max(first, start), min(first + count, end)
            lift = state.evolving[-1 if law == "plates" else -2]
            if lower < upper:
                launches.append(
                    wp.launch(
                        self._kernels[law],
                        dim=upper - lower,
                        inputs=[lower, *state.constants, *state.schedule, *state.evolving[:-2], lift],
                        outputs=list(outputs.values()),
                        device=self._device,
                        record_cmd=record,
                    )
                )
        return launches

    def _initial_frame(self) -> Frame:
        start, real = self._initial, self._real
        moving = start.release_times <= 0.0
        return Frame(
            index=0,
            time=0.0,
            positions=start.positions.astype(real),
            orientations=start.orientations.astype(real),
            velocities=np.where(moving[:, None], start.velocities, 0.0).astype(real),
            angular_velocities=np.where(moving[:, None], start.angular_velocities, 0.0).astype(real),
            state=np.where(moving, MOVING, WAITING).astype(np.uint8),
            body_steps=0,
        )

    def _frame(self, index: int, outputs: Outputs, snapshot: Mapping[str, NDArray[Any]] | None) -> Frame:
        arrays = {name.removesuffix("_out"): array.numpy() for name, array in outputs.items()}
        self._body_steps += int(arrays["substeps"].sum(dtype=np.int64))
        return Frame(
            index=index,
            time=index / self._fps,
            positions=arrays["position"],
            orientations=arrays["orientation"],
            velocities=arrays["velocity"],
            angular_velocities=arrays["angular_velocity"],
            state=arrays["state"],
            body_steps=self._body_steps,
            snapshot=snapshot,
        )


def law_runs(groups: Sequence[Group]) -> list[tuple[str, int, int]]:
    """Stretches of bodies that one kernel moves: (its law, first body, first body after it)."""
    runs: list[tuple[str, int, int]] = []
    end = 0
    for group in groups:
        law = "plates" if group.level == "quasi_steady" and group.model.plates else group.level
        start, end = end, end + len(group.emission.positions)
        if runs and runs[-1][0] == law:
            start = runs.pop()[1]
        runs.append((law, start, end))
    return runs
