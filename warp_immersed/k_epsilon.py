"""`KEpsilonSolver`: the steady mean flow and its k and epsilon on a voxel grid, by marching in pseudo-time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import ceil

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warp_immersed.errors import InputError
from warp_immersed.flow_setup import FlowSetup, device_geometry, device_sides, face_codes, initial_state
from warp_immersed.kernels import flow, k_epsilon, pressure, reduction, transport
from warp_immersed.kernels.grid import Stencil
from warp_immersed.launch_plan import FIRST_PLANE, LaunchPlan, make_workers
from warp_immersed.poisson import add_v_cycle, build_levels, half_dim

BYTES_PER_CELL = 380  # device memory of the solver, all arrays and the multigrid levels
CHECK_INTERVAL = 10
START = 2.0  # flow-throughs that count as the start
SETTLED = 1e-3
FASTER = 1.5  # how much faster than what enters the flow may be before the step is shortened
STATE = ("velocity", "turbulence", "pressure", "flux_x", "flux_y", "flux_z")


class DivergedError(RuntimeError):
    """The solution stopped being finite; the message says where, and what to change."""


@dataclass(frozen=True)
class Progress:
    """How a solve stands.

    step; change: what velocity, k and epsilon would change by in one flow-through at the present rate, relative to the
    reference speed (root mean square) and to the mean k and epsilon; divergence: max |div u| dx / U.
    """

    step: int
    velocity_change: float
    k_change: float
    epsilon_change: float
    divergence: float

    @property
    def change(self) -> float:
        """The largest of the three changes."""
        return max(self.velocity_change, self.k_change, self.epsilon_change)


@dataclass(frozen=True)
class Convergence:
    """The verdict of a solve: whether it converged, its history (one row a check), and what to change if it did not."""

    converged: bool
    advice: str
    history: tuple[Progress, ...]


class KEpsilonSolver:
    """Standard k-epsilon (or laminar) flow on a uniform voxel grid, marched to its steady state.

    A step: gradients and nu_T; implicit momentum (linear upwind with a limiter as deferred correction, red-black
    sweeps); Rhie-Chow fluxes; one multigrid cycle for the pressure increment; k and epsilon with positive (Patankar)
    sources. All terms of the standard model act. docs/k-epsilon.md has the equations and the measured accuracy.

    Args:
        setup: the flow.
        device: Warp device, "cpu" or "cuda:0".
        cfl: time step times reference speed over cell size; 10 damps the unsteadiness of thin shear layers, 5 is safer.
        pressure_relaxation: share of the pressure increment that is kept; None for .5 at the start, then .2, less above CFL 15.
        sweeps: red-black sweeps of momentum and of k and epsilon a step; None for 4 to CFL 5, 6 at 10.
        threads: CPU threads (None: all cores). The result does not depend on it.
        limited: limit second-order convection of momentum; without, plain linear upwind.

    Raises:
        InputError: a step or relaxation that cannot work.
    """

    def __init__(
        self,
        setup: FlowSetup,
        device: str = "cpu",
        *,
        cfl: float = 10.0,
        pressure_relaxation: float | None = None,
        sweeps: int | None = None,
        threads: int | None = None,
        limited: bool = True,
    ) -> None:
        if not 0.0 < cfl <= 50.0:
            raise InputError(f"cfl: found {cfl!r}, must be above 0 and at most 50 (5 is safe)")
        self.setup = setup
        self.device = wp.get_device(device)
        self.cfl = cfl
        self.pressure_relaxation = min(0.2, 3.0 / cfl) if pressure_relaxation is None else pressure_relaxation
        self.sweeps = min(max(4, round(2.0 + 0.4 * cfl)), 8) if sweeps is None else sweeps
        self.limited = limited
        self.steps_taken = 0
        self.speed = setup.reference_speed
        active = [axis for axis in range(3) if setup.cells[axis] > 1]
        self.cell = min(setup.spacing[axis] for axis in active)
        self.dt = cfl * self.cell / self.speed
        lengths = [setup.upper[axis] - setup.lower[axis] for axis in active]
        self.flow_through = max(lengths) / self.speed
        self.eddy_cap = max(0.1 * self.speed * max(lengths), 1e5 * setup.viscosity)
        self.allocate()
        # Keeping more of the pressure increments settles the start sooner; later it would let thin shear layers oscillate.
        self.start_steps = ceil(START * self.flow_through / self.dt) if pressure_relaxation is None else 0
        self.workers = make_workers(self.device, threads)
        self.set_step(self.dt)
        self.check_plan = self.record_check()

    def allocate(self) -> None:
        """Put the state and all work arrays on the device; nothing is allocated later."""
        setup, device = self.setup, self.device
        shape = setup.cells
        nx, ny, nz = shape
        codes = face_codes(setup)
        self.grid = device_geometry(setup)
        self.sides = device_sides(setup, device)
        self.faces = wp.array(codes, dtype=int, device=device)
        velocity, turbulence = initial_state(setup)
        if not setup.turbulent:
            turbulence[:] = 0.0
        self.velocity = wp.array(velocity, dtype=wp.vec3, device=device)
        self.turbulence = wp.array(turbulence, dtype=wp.vec2, device=device)
        self.velocity_before = wp.clone(self.velocity)
        self.turbulence_before = wp.clone(self.turbulence)
        self.pressure, self.eddy, self.divergence = (wp.zeros(shape, dtype=float, device=device) for _ in range(3))
        vectors = [wp.zeros(shape, dtype=wp.vec3, device=device) for _ in range(7)]
        self.dx, self.dy, self.dz, self.residual, self.gradient, self.change, self.source = vectors
        self.slope_x, self.slope_y, self.slope_z = (wp.zeros(shape, dtype=wp.vec2, device=device) for _ in range(3))
        self.stencil, self.k_equation, self.epsilon_equation = (wp.zeros(shape, dtype=Stencil, device=device) for _ in range(3))
        self.flux_x = wp.zeros((nx + 1, ny, nz), dtype=float, device=device)
        self.flux_y = wp.zeros((nx, ny + 1, nz), dtype=float, device=device)
        self.flux_z = wp.zeros((nx, ny, nz + 1), dtype=float, device=device)
        self.sums = wp.zeros((nx, ny), dtype=reduction.Sums, device=device)
        self.good = {name: wp.clone(getattr(self, name)) for name in STATE}  # the last state known to be sound
        self.good_step = 0
        self.top_speed = 0.0
        wraps = tuple(int(w) for w in self.grid.wraps)
        self.levels = build_levels(codes, wraps, np.array(setup.spacing), device)  # type: ignore[arg-type]

    def set_step(self, dt: float) -> None:
        """Take steps of dt [s] from now on. The steady state does not depend on it."""
        self.dt = dt
        self.start_plan = self.record(min(0.5, 5.0 / self.cfl))
        self.plan = self.record(self.pressure_relaxation)

    def record(self, pressure_relaxation: float) -> LaunchPlan:
        """The launches of one step."""
        grid, faces, sides, nu = self.grid, self.faces, self.sides, self.setup.viscosity
        shape = self.setup.cells
        fluxes = [self.flux_x, self.flux_y, self.flux_z]
        gradients = [self.dx, self.dy, self.dz]
        coupling = 0.5 * self.cell / self.speed
        plan = LaunchPlan(self.device, self.workers)
        plan.add(flow.differentiate_velocity, shape, [grid, FIRST_PLANE, faces, sides, self.velocity, *gradients])
        if self.setup.turbulent:
            inputs = [grid, FIRST_PLANE, nu, self.eddy_cap, faces, sides, self.velocity, self.turbulence, *gradients]
            plan.add(k_epsilon.close_model, shape, [*inputs, self.eddy, self.source])
        inputs = [grid, FIRST_PLANE, nu, 1.0 / self.dt, int(self.limited), faces, sides]
        inputs += [self.velocity, *gradients, self.turbulence]
        inputs += [self.eddy, self.pressure, *fluxes, self.stencil, self.residual, self.gradient, self.change]
        plan.add(flow.assemble_momentum, shape, inputs)
        for _ in range(self.sweeps):
            for color in (0, 1):
                inputs = [grid, FIRST_PLANE, color, self.stencil, self.residual, self.change]
                plan.add(flow.sweep_momentum, half_dim(shape), inputs)
        inputs = [grid, FIRST_PLANE, coupling, faces, sides, self.velocity, self.change, self.gradient, self.pressure, *fluxes]
        plan.add(pressure.predict_fluxes, shape, inputs)
        potential = self.levels[0]
        plan.add(pressure.diverge, shape, [grid, FIRST_PLANE, faces, *fluxes, potential.b])
        add_v_cycle(plan, self.levels)
        factor = pressure_relaxation / self.dt
        inputs = [grid, FIRST_PLANE, factor, faces, potential.x, self.velocity, self.change, self.pressure, *fluxes]
        plan.add(pressure.project, shape, inputs)
        if self.setup.turbulent:
            self.add_transport(plan, 1.0 / self.dt, self.source, fluxes)
        return plan

    def record_check(self) -> LaunchPlan:
        """The launches that measure what a step changed."""
        shape = self.setup.cells
        plan = LaunchPlan(self.device, self.workers)
        fluxes = [self.flux_x, self.flux_y, self.flux_z]
        plan.add(pressure.diverge, shape, [self.grid, FIRST_PLANE, self.faces, *fluxes, self.divergence])
        inputs = [FIRST_PLANE, self.faces, self.velocity, self.turbulence, self.velocity_before, self.turbulence_before]
        plan.add(reduction.measure_change, shape[:2], [*inputs, self.divergence, self.sums])
        return plan

    def add_transport(self, plan: LaunchPlan, inverse_dt: float, source: wp.array, fluxes: list[wp.array]) -> None:
        """Append the transport of k and epsilon by the fluxes and nu_T, with their sources."""
        grid, faces, shape = self.grid, self.faces, self.setup.cells
        slopes = [self.slope_x, self.slope_y, self.slope_z]
        plan.add(transport.difference_turbulence, shape, [grid, FIRST_PLANE, faces, self.sides, self.turbulence, *slopes])
        inputs = [grid, FIRST_PLANE, self.setup.viscosity, inverse_dt, faces, self.sides, self.turbulence, *slopes]
        inputs += [self.eddy, source, *fluxes, self.k_equation, self.epsilon_equation]
        plan.add(transport.assemble_turbulence, shape, inputs)
        for _ in range(self.sweeps):
            for color in (0, 1):
                inputs = [grid, FIRST_PLANE, color, self.k_equation, self.epsilon_equation, self.turbulence]
                plan.add(transport.sweep_turbulence, half_dim(shape), inputs)

    def step(self, count: int = 1) -> None:
        """March `count` steps."""
        for _ in range(count):
            (self.start_plan if self.steps_taken < self.start_steps else self.plan).run()
            self.steps_taken += 1

    def measured_step(self) -> Progress:
        """March one step and measure what it changed.

        Raises:
            DivergedError: the solution is no longer finite.
        """
        wp.copy(self.velocity_before, self.velocity)
        wp.copy(self.turbulence_before, self.turbulence)
        self.step()
        self.check_plan.run()
        rows = self.sums.numpy().reshape(-1, 8)
        total = rows[:, :6].sum(axis=0)
        if not np.isfinite(total).all():
            raise DivergedError(self.where_it_broke())
        for name, kept in self.good.items():
            wp.copy(kept, getattr(self, name))
        self.good_step = self.steps_taken
        self.top_speed = float(np.sqrt(rows[:, 7].max()))
        rate = self.flow_through / self.dt
        velocity = float(np.sqrt(total[0] / self.setup.fluid_cells)) / self.speed * rate
        k = float(total[1] / max(total[2], 1e-30)) * rate
        epsilon = float(total[3] / max(total[4], 1e-30)) * rate
        return Progress(self.steps_taken, velocity, k, epsilon, float(rows[:, 6].max()) * self.cell / self.speed)

    def where_it_broke(self) -> str:
        """Go back to the last state that was sound, step to the first that is not, name the cell, and say what helps."""
        last = self.steps_taken
        for name, kept in self.good.items():
            wp.copy(getattr(self, name), kept)
        self.steps_taken = self.good_step
        bad = np.zeros(self.setup.cells, dtype=bool)
        while not bad.any() and self.steps_taken < last:
            self.step()
            bad = ~(np.isfinite(self.velocity.numpy()).all(-1) & np.isfinite(self.turbulence.numpy()).all(-1))
        cell = tuple(int(c) for c in np.argwhere(bad)[0]) if bad.any() else (0, 0, 0)
        at = [low + (c + 0.5) * h for low, c, h in zip(self.setup.lower, cell, self.setup.spacing, strict=True)]
        where = ", ".join(f"{x:.4g}" for x in at)
        step = self.steps_taken
        return f"the flow diverged at step {step}, in cell {cell} at ({where}) m; lower cfl (now {self.cfl:g}) and run again"

    def solve(
        self,
        max_steps: int = 4000,
        tolerance: float = 2e-5,
        progress: Callable[[Progress], None] | None = None,
        check_interval: int = CHECK_INTERVAL,
    ) -> Convergence:
        """March until one flow-through would change velocity, k and epsilon by less than `tolerance`, or nothing improves.

        The step is shortened where the flow gets much faster than what enters, and halved (twice at most) when nothing improves.
        A solution that keeps oscillating, but would change by less than a thousandth in a flow-through, counts as
        converged and is said to oscillate.

        Args:
            max_steps: total steps, those of a resumed solve included.
            progress: called with the state at every check. check_interval: steps between checks.

        Raises:
            DivergedError: the solution is no longer finite.
        """
        history: list[Progress] = []
        best, best_step = float("inf"), self.steps_taken
        patience = max(300, int(5.0 * self.flow_through / self.dt))
        while self.steps_taken < max_steps:
            self.step(max(min(check_interval, max_steps - self.steps_taken) - 1, 0))
            now = self.measured_step()
            history.append(now)
            if progress is not None:
                progress(now)
            if now.change < tolerance:
                return Convergence(True, "converged", tuple(history))
            if now.change < 0.9 * best:
                best, best_step = now.change, now.step
            if now.step - best_step > patience:
                if best < SETTLED or self.dt < 0.3 * self.cell * self.cfl / max(self.speed, self.top_speed):
                    break
                self.set_step(0.5 * self.dt)
                best, best_step = now.change, now.step
            elif self.top_speed * self.dt > FASTER * self.cfl * self.cell:
                self.set_step(self.cfl * self.cell / self.top_speed)
        return Convergence(best < SETTLED, self.advice(best, best_step), tuple(history))

    def advice(self, change: float, step: int) -> str:
        """What to say about a solve that stopped before its tolerance, and what to change."""
        if change < SETTLED:
            return f"settled: it keeps oscillating by {change:.1e} a flow-through"
        if self.steps_taken - step > 1:
            low = "raise cfl to 10" if self.cfl < 10.0 else "lower cfl to 5"
            return (
                f"not converged: the change stays at {change:.1e} a flow-through since step {step}; the flow may have no steady "
                f"state on this grid: {low}, coarsen the grid, or move the outlet downstream"
            )
        return f"not converged: the change is {change:.1e} a flow-through after {self.steps_taken} steps; allow more steps"

    def fields(self) -> dict[str, NDArray[np.float32]]:
        """velocity (nx, ny, nz, 3) [m/s], pressure over density and k [m^2/s^2], epsilon [m^2/s^3], eddy_viscosity [m^2/s]."""
        turbulence = self.turbulence.numpy().copy()
        return {
            "velocity": self.velocity.numpy().copy(),
            "pressure": self.pressure.numpy().copy(),
            "k": turbulence[..., 0],
            "epsilon": turbulence[..., 1],
            "eddy_viscosity": self.eddy.numpy().copy(),
        }

    def checkpoint(self) -> dict[str, NDArray[np.generic]]:
        """Everything a later solver of the same setup needs to go on bit for bit from the last `measured_step`.

        It can be taken at any time, also after an interrupt in the middle of a step.
        """
        stored: dict[str, NDArray[np.generic]] = {name: kept.numpy().copy() for name, kept in self.good.items()}
        stored["steps_taken"] = np.array(self.good_step)
        stored["dt"] = np.array(self.dt)
        return stored

    def restore(self, stored: Mapping[str, NDArray[np.generic]]) -> None:
        """Go on from a checkpoint.

        Raises:
            InputError: the checkpoint is of another grid.
        """
        for name in STATE:
            array = getattr(self, name)
            if stored[name].shape[:3] != tuple(array.shape):
                raise InputError(f"checkpoint {name}: found shape {stored[name].shape[:3]}, must be {tuple(array.shape)}")
            array.assign(stored[name])
            self.good[name].assign(stored[name])
        self.steps_taken = self.good_step = int(stored["steps_taken"])
        self.set_step(float(stored["dt"]))
