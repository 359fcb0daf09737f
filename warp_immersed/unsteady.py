"""`UnsteadySolver`: the flow in time, by semi-Lagrangian steps as in Algorithm 1: convect, project, then the turbulence."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
import warp as wp
from numpy.typing import NDArray

from warp_immersed.boundaries import Boundary, Inlet, LogInlet
from warp_immersed.errors import InputError
from warp_immersed.flow_setup import FlowSetup, device_sides
from warp_immersed.k_epsilon import DivergedError, KEpsilonSolver
from warp_immersed.kernels import flow, k_epsilon, pressure, semi_lagrangian
from warp_immersed.launch_plan import FIRST_PLANE, LaunchPlan
from warp_immersed.poisson import add_v_cycle, half_dim

PRESSURE_CYCLES = 3
# Share of the step in the Rhie-Chow coupling: .5 would be consistent, but costs Taylor-Green vortices 6 times the error.
COUPLING = 0.1


@dataclass(frozen=True, eq=False)
class Snapshots:
    """A flow in time: time (nt,) [s], velocity (nt, nx, ny, nz, 3) [m/s], k and epsilon (nt, nx, ny, nz)."""

    time: NDArray[np.float64]
    velocity: NDArray[np.float32]
    k: NDArray[np.float32]
    epsilon: NDArray[np.float32]


class UnsteadySolver:
    """Time-accurate flow on the grid of a `FlowSetup`.

    A step: half of the viscous stress and pressure gradient act where a parcel leaves and half where it arrives (Crank
    and Nicolson along the path, pressure in increments), so the step is of second order; k and epsilon are convected,
    take their sources exactly, and diffuse implicitly. Steps are limited to CFL 2: longer ones stay finite and are wrong.

    Args:
        start: the flow to begin from (a steady solver, which lends its arrays), or a setup.
        dt: step [s]; None for a CFL number of 1 in the reference speed.
        gust: factor on the velocity of every inlet, of time [s].
        device, threads: as for `KEpsilonSolver`, where a setup is given.

    Raises:
        InputError: the step is above CFL 2.
    """

    def __init__(
        self,
        start: KEpsilonSolver | FlowSetup,
        dt: float | None = None,
        *,
        gust: Callable[[float], float] | None = None,
        device: str = "cpu",
        threads: int | None = None,
    ) -> None:
        self.base = start if isinstance(start, KEpsilonSolver) else KEpsilonSolver(start, device, threads=threads)
        self.setup = self.base.setup
        base = self.base
        self.dt = base.cell / base.speed if dt is None else dt
        cfl = self.dt * base.speed / base.cell
        if not 0.0 < cfl <= 2.0 + 1e-6:
            longest = 2.0 * base.cell / base.speed
            raise InputError(f"dt: found {self.dt!r} s, which is CFL {cfl:.3g}, must be at most CFL 2 ({longest:.4g} s)")
        self.gust = gust
        self.time = 0.0
        self.midway = wp.clone(base.velocity)
        self.convected = wp.clone(base.velocity)
        self.convected_turbulence = wp.clone(base.turbulence)
        self.left_source = wp.zeros_like(base.source)
        self.still = [wp.zeros_like(flux) for flux in (base.flux_x, base.flux_y, base.flux_z)]
        self.plan = LaunchPlan(base.device, base.workers)
        self.record()

    def record(self) -> None:
        """Record the launches of one step."""
        base, plan, dt = self.base, self.plan, self.dt
        grid, faces, sides, nu, shape = base.grid, base.faces, base.sides, self.setup.viscosity, self.setup.cells
        gradients = [base.dx, base.dy, base.dz]
        fluxes = [base.flux_x, base.flux_y, base.flux_z]
        inlets = sum(1 << s for s, side in enumerate(self.setup.effective_sides) if isinstance(side, Inlet | LogInlet))
        plan.add(flow.differentiate_velocity, shape, [grid, FIRST_PLANE, faces, sides, base.velocity, *gradients])
        if self.setup.turbulent:
            inputs = [grid, FIRST_PLANE, nu, base.eddy_cap, faces, sides, base.velocity, base.turbulence, *gradients]
            plan.add(k_epsilon.close_model, shape, [*inputs, base.eddy, base.source])
        self.add_stress(base.velocity)
        inputs = [grid, FIRST_PLANE, dt, inlets, faces, sides, base.velocity, self.midway, base.residual, base.turbulence]
        plan.add(semi_lagrangian.convect, shape, [*inputs, self.convected, self.convected_turbulence])
        self.add_stress(self.convected)
        for _ in range(base.sweeps):
            for color in (0, 1):
                inputs = [grid, FIRST_PLANE, color, base.stencil, base.residual, base.change]
                plan.add(flow.sweep_momentum, half_dim(shape), inputs)
        inputs = [grid, FIRST_PLANE, COUPLING * dt, faces, sides, self.convected, base.change, base.gradient]
        plan.add(pressure.predict_fluxes, shape, [*inputs, base.pressure, *fluxes])
        potential = base.levels[0]
        for cycle in range(PRESSURE_CYCLES):
            plan.add(pressure.diverge, shape, [grid, FIRST_PLANE, faces, *fluxes, potential.b])
            add_v_cycle(plan, base.levels)
            inputs = [grid, FIRST_PLANE, 2.0 / dt, faces, potential.x, self.convected, base.change, base.pressure, *fluxes]
            plan.add(pressure.project, shape, inputs)
            if cycle == 0:
                plan.add(semi_lagrangian.clear, shape, [FIRST_PLANE, base.change])
        plan.add(semi_lagrangian.accept, shape, [FIRST_PLANE, self.convected, base.velocity, self.midway])
        if self.setup.turbulent:
            self.record_turbulence()

    def add_stress(self, velocity: wp.array) -> None:
        """Append viscous stress less grad p of a velocity field, and the implicit equation of half of it."""
        base = self.base
        inputs = [base.grid, FIRST_PLANE, self.setup.viscosity, 2.0 / self.dt, 0, base.faces, base.sides]
        inputs += [velocity, base.dx, base.dy, base.dz, base.turbulence, base.eddy, base.pressure, *self.still]
        inputs += [base.stencil, base.residual, base.gradient, base.change]
        self.plan.add(flow.assemble_momentum, self.setup.cells, inputs)

    def record_turbulence(self) -> None:
        """Append the sources of k and epsilon, exactly, and their diffusion, implicitly."""
        base, plan, shape = self.base, self.plan, self.setup.cells
        inputs = [base.grid, FIRST_PLANE, self.dt, base.faces, self.convected_turbulence, base.source]
        plan.add(semi_lagrangian.exchange_turbulence, shape, [*inputs, base.turbulence, self.left_source])
        base.add_transport(plan, 1.0 / self.dt, self.left_source, self.still)

    def advance(self, duration: float) -> None:
        """March by `duration` [s], to the nearest whole number of steps.

        Raises:
            DivergedError: the flow stopped being finite.
        """
        steps = max(1, round(duration / self.dt))
        for _ in range(steps):
            if self.gust is not None:
                self.base.sides.assign(device_sides(gusty(self.setup, self.gust(self.time + self.dt)), self.base.device))
            self.plan.run()
            self.time += self.dt
        if not np.isfinite(self.base.velocity.numpy()).all() or not np.isfinite(self.base.turbulence.numpy()).all():
            raise DivergedError(f"the flow diverged before t = {self.time:.4g} s; lower the step (now {self.dt:.4g} s)")

    def snapshots(self, duration: float, interval: float, progress: Callable[[float], None] | None = None) -> Snapshots:
        """March `duration` [s] and keep the flow at the start and every `interval` [s]; progress takes the time [s]."""
        count = max(1, ceil(duration / interval - 1e-6))
        kept = [self.base.fields()]
        times = [self.time]
        for _ in range(count):
            self.advance(interval)
            kept.append(self.base.fields())
            times.append(self.time)
            if progress is not None:
                progress(self.time)
        velocity, k, epsilon = (np.stack([fields[name] for fields in kept]) for name in ("velocity", "k", "epsilon"))
        return Snapshots(np.array(times), velocity, k, epsilon)


def gusty(setup: FlowSetup, factor: float) -> FlowSetup:
    """The setup with the velocity of its inlets multiplied."""
    sides: list[Boundary] = []
    for side in setup.sides:
        if isinstance(side, Inlet):
            x, y, z = side.velocity
            sides.append(replace(side, velocity=(factor * x, factor * y, factor * z)))
        elif isinstance(side, LogInlet):
            sides.append(replace(side, friction_velocity=factor * side.friction_velocity))
        else:
            sides.append(side)
    return replace(setup, sides=tuple(sides))  # type: ignore[arg-type]
