"""`bake`: solve the flow that a FIELD.toml describes and write it as a `TurbulenceGrid` file."""

import hashlib
import logging
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, pi, sin
from pathlib import Path

import numpy as np
import warp as wp

from warp_immersed.errors import InputError
from warp_immersed.field_scene import FieldScene, UnsteadyTable, far_boundary
from warp_immersed.flow_setup import FlowSetup
from warp_immersed.k_epsilon import BYTES_PER_CELL, Convergence, KEpsilonSolver, Progress
from warp_immersed.turbulence_grid import TurbulenceGrid
from warp_immersed.unsteady import UnsteadySolver

logger = logging.getLogger(__name__)

CHECKPOINT_SECONDS = 20.0
BYTES_PER_SNAPSHOT = 20  # velocity, k, epsilon of a cell
CELL_STEPS_PER_SECOND = 6.0e5  # of one CPU core, for the estimate shown before a bake
TYPICAL_STEPS = 800


@dataclass(frozen=True)
class BakePlan:
    """What a bake will take: cells (3,), memory [bytes] and, on a CPU, a typical time [s]; None where it is not known."""

    cells: tuple[int, int, int]
    memory: int
    seconds: float | None

    @property
    def text(self) -> str:
        """The plan in words."""
        took = "" if self.seconds is None else f", about {self.seconds:.0f} s"
        return f"{' x '.join(map(str, self.cells))} cells, {self.memory / 1e6:.0f} MB{took}"


@dataclass(frozen=True)
class BakeReport:
    """What a bake made: the file, the verdict of the solve, steps and wall time [s]."""

    path: Path
    convergence: Convergence
    steps: int
    seconds: float


def plan_bake(scene: FieldScene, device: str = "cpu", threads: int | None = None) -> BakePlan:
    """Memory and time a bake needs, before anything is allocated.

    Raises:
        InputError: the grid does not fit into the device's free memory.
    """
    count = int(np.prod(scene.cells))
    unsteady = scene.tables.unsteady
    snapshots = 0 if unsteady is None else ceil(unsteady.duration / unsteady.interval) + 1
    memory = (BYTES_PER_CELL + 3 * BYTES_PER_SNAPSHOT * snapshots) * count
    target = wp.get_device(device)
    free = target.free_memory if target.is_cuda else available_memory()
    needed = memory if target.is_cuda else 2 * memory  # building the hierarchy takes as much again on the host
    if needed > free:
        raise InputError(
            f"{scene.name}: domain: {list(scene.cells)} cells need {needed / 1e9:.1f} GB, {device} has {free / 1e9:.1f} GB free; "
            f"use a coarser spacing or a smaller domain"
        )
    cores = min(threads or os.cpu_count() or 1, max(1, count // 8192))
    seconds = None if target.is_cuda else count * TYPICAL_STEPS / (CELL_STEPS_PER_SECOND * cores)
    return BakePlan(scene.cells, memory, seconds)


def available_memory() -> float:
    """Memory that programs can still get [bytes]; infinite where the system does not tell."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            for line in lines:
                if line.startswith("MemAvailable:"):
                    return 1024.0 * float(line.split()[1])
        return float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    except (OSError, AttributeError, ValueError):
        return float("inf")


def bake(
    field: str | Path | FieldScene,
    output: str | Path,
    device: str = "cpu",
    *,
    resume: bool = False,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    time_progress: Callable[[float], None] | None = None,
) -> BakeReport:
    """Solve a field and write it to an HDF5 file; a flow that did not converge is written too, and says so.

    With an [unsteady] table the steady flow is where the flow in time starts, and its snapshots are written.

    The state is kept beside the output (`OUTPUT.checkpoint.npz`) while the solve runs, also when it is interrupted, and
    removed at the end.

    Args:
        field: FIELD.toml, or the scene read from it.
        resume: go on from the checkpoint of an interrupted bake of the same field; without one, start.
        progress: called at every check of the residuals. time_progress: called with the time [s] of every snapshot.

    Raises:
        InputError: the field cannot be used, does not fit, or the checkpoint belongs to another field.
        DivergedError: the solution stopped being finite; no file is written.
    """
    scene = field if isinstance(field, FieldScene) else FieldScene.load(field)
    target = Path(output)
    if not target.parent.is_dir():
        raise InputError(f"{target}: the folder {str(target.parent)!r} does not exist; make it first")
    started = time.perf_counter()
    plan_bake(scene, device, threads)
    setup = scene.setup(device)
    settings = scene.tables.solver
    solver = KEpsilonSolver(setup, device, cfl=settings.cfl, threads=threads)
    checkpoint = target.with_name(target.name + ".checkpoint.npz")
    digest = setup_digest(setup, scene.text)
    if resume and checkpoint.is_file():
        restore(solver, checkpoint, digest)
    saved = time.perf_counter()

    def checked(now: Progress) -> None:
        nonlocal saved
        if time.perf_counter() - saved > CHECKPOINT_SECONDS:
            keep(solver, checkpoint, digest)
            saved = time.perf_counter()
        if progress is not None:
            progress(now)

    try:
        convergence = solver.solve(settings.max_steps, settings.tolerance, checked)
    except KeyboardInterrupt:
        keep(solver, checkpoint, digest)
        raise
    grid = grid_of(scene, setup, solver, convergence)
    if scene.tables.unsteady is not None:
        keep(solver, checkpoint, digest)
        grid = in_time(grid, solver, scene.tables.unsteady, time_progress)
    grid.save(target)
    checkpoint.unlink(missing_ok=True)
    return BakeReport(target, convergence, solver.steps_taken, time.perf_counter() - started)


def cached_bake(
    scene: FieldScene,
    folder: str | Path,
    device: str = "cpu",
    *,
    threads: int | None = None,
    progress: Callable[[Progress], None] | None = None,
    time_progress: Callable[[float], None] | None = None,
) -> Path:
    """The bake file of a field in a cache folder, made if it is not there; named by what defines the field.

    Raises:
        InputError, DivergedError: as `bake`.
    """
    digest = setup_digest(scene.setup(device), scene.text)
    path = Path(folder) / f"field-{digest[:24]}.h5"
    if not path.is_file():
        logger.info("baking %s, once: %s", scene.name, plan_bake(scene, device, threads).text)
        path.parent.mkdir(parents=True, exist_ok=True)
        bake(scene, path, device, resume=True, threads=threads, progress=progress, time_progress=time_progress)
    return path


def grid_of(scene: FieldScene, setup: FlowSetup, solver: KEpsilonSolver, convergence: Convergence) -> TurbulenceGrid:
    """The solved flow with its provenance."""
    fields = solver.fields()
    fluid = setup.fluid_mask()
    rows = [(p.step, p.velocity_change, p.k_change, p.epsilon_change, p.divergence) for p in convergence.history]
    return TurbulenceGrid(
        lower=setup.lower,
        spacing=setup.spacing,
        velocity=np.where(fluid[..., None], fields["velocity"], 0.0).astype(np.float32),
        k=np.where(fluid, fields["k"], 0.0).astype(np.float32),
        epsilon=np.where(fluid, fields["epsilon"], 0.0).astype(np.float32),
        fluid=fluid,
        far=far_boundary(scene.boundaries(), setup.velocity),
        scene=scene.text,
        history=np.array(rows, dtype=np.float64).reshape(-1, 5),
        provenance={
            "warp": wp.__version__,
            "numpy": np.__version__,
            "device": str(solver.device),
            "steps": solver.steps_taken,
            "cfl": solver.cfl,
            "converged": convergence.converged,
            "advice": convergence.advice,
        },
    )


def in_time(
    grid: TurbulenceGrid, solver: KEpsilonSolver, table: UnsteadyTable, progress: Callable[[float], None] | None
) -> TurbulenceGrid:
    """The flow in time that starts from a solved one."""
    gust = table.gust

    def factor(time: float) -> float:
        return 1.0 if gust is None else 1.0 + gust.amplitude * sin(2.0 * pi * time / gust.period)

    longest = solver.cell / solver.speed / (1.0 + (gust.amplitude if gust else 0.0))
    steps = ceil(table.interval / longest)
    unsteady = UnsteadySolver(solver, table.interval / steps, gust=None if gust is None else factor)
    flow = unsteady.snapshots(table.duration, table.interval, progress)
    fluid = grid.fluid
    return replace(
        grid,
        time=flow.time,
        velocity=np.where(fluid[..., None], flow.velocity, 0.0).astype(np.float32),
        k=np.where(fluid, flow.k, 0.0).astype(np.float32),
        epsilon=np.where(fluid, flow.epsilon, 0.0).astype(np.float32),
    )


def setup_digest(setup: FlowSetup, text: str) -> str:
    """A fingerprint of a field: its file and its obstacle cells."""
    solid = b"" if setup.solid is None else np.packbits(setup.solid).tobytes()
    return hashlib.sha256(text.encode() + solid).hexdigest()


def keep(solver: KEpsilonSolver, path: Path, digest: str) -> None:
    """Write the solver's state beside the output; the old checkpoint is replaced only by a complete one."""
    part = path.with_name(path.name + ".part")
    with part.open("wb") as file:
        np.savez(file, digest=digest, **solver.checkpoint())  # type: ignore[arg-type]
    os.replace(part, path)


def restore(solver: KEpsilonSolver, path: Path, digest: str) -> None:
    """Put a checkpoint into the solver. Raises InputError if it is of another field or cannot be read."""
    try:
        with np.load(path) as stored:
            if str(stored["digest"]) != digest:
                raise InputError(f"{path}: is the checkpoint of another field; bake without resuming, or restore the field")
            solver.restore({name: stored[name] for name in stored.files if name != "digest"})
    except (OSError, ValueError, KeyError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read ({str(error).splitlines()[0]}); bake without resuming") from error
