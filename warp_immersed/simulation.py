"""`simulate`: the one place that ties a scene, its bodies, a device and the files together."""

import hashlib
import platform
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import inf, radians, tan
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import warp as wp

from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.body_model import BodyModel, body_model
from warp_immersed.counter_random import random_key
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.emitters import emit, lowest_start
from warp_immersed.ensemble import Ensemble, Frame
from warp_immersed.errors import InputError
from warp_immersed.fidelity import Choice, Level
from warp_immersed.kernels.rigid_body import FAILED
from warp_immersed.level_choice import Scale, model_at_level
from warp_immersed.looks import Prototype
from warp_immersed.recording import DATASETS, Recording
from warp_immersed.scene import BodiesTable, Scene
from warp_immersed.scene_flow import scene_flow
from warp_immersed.scene_ground import scene_ground_mesh
from warp_immersed.shape import Shape
from warp_immersed.shape_table import make_shape
from warp_immersed.tensor_cache import cache_directory
from warp_immersed.turbulence_grid import TurbulenceGrid
from warp_immersed.version import __version__

if TYPE_CHECKING:
    from warp_immersed.k_epsilon import Progress


@dataclass(frozen=True)
class Kind:
    """One kind of body of a scene, ready to be simulated."""

    table: BodiesTable
    shape: Shape
    model: BodyModel
    choice: Choice

    @property
    def level(self) -> Level:
        """The level it is simulated at."""
        return self.choice.level


@dataclass(frozen=True)
class Plan:
    """A scene with its shapes made and its models worked out."""

    scene: Scene
    kinds: tuple[Kind, ...]
    surroundings: Surroundings
    notes: tuple[str, ...]

    @property
    def prototypes(self) -> tuple[Prototype, ...]:
        """How the kinds look."""
        return tuple(Prototype.from_shape(kind.table.name, kind.table.count, kind.shape) for kind in self.kinds)


class FrameSink(Protocol):
    """Where frames go as they are computed."""

    def write(self, frame: Frame) -> None:
        """Take the next frame; its arrays are valid during the call only."""

    def finish(self) -> None:
        """All frames have come: make the result whole."""

    def abort(self) -> None:
        """Leave nothing behind."""


@dataclass(frozen=True)
class Outcome:
    """How a run ended: frames written; body_steps taken; ids of failed bodies; how many were parked
    outside the bounds; whether it was interrupted."""

    frames: int
    body_steps: int
    failed: tuple[int, ...]
    parked: int
    interrupted: bool


def plan(scene: Scene, device: str = "cpu", baking: "Callable[[Progress], None] | None" = None) -> Plan:
    """Make the shapes of a scene and work out how its bodies move.

    A field that has not been baked yet is baked on `device`; `baking` is called as that goes on.

    Raises:
        InputError: a mesh or size cannot be used, or bodies would start in the ground; the message starts with the key.
    """
    fluid = scene.make_fluid()
    ground = None if scene.ground is None else scene.ground.height
    surroundings = Surroundings(
        fluid=fluid,
        gravity=scene.gravity,
        mean_wind=scene.wind.velocity if scene.wind else (0.0, 0.0, 0.0),
        turbulence=scene.make_turbulence(),
        ground_height=ground,
        flow=scene_flow(scene, device, baking),
        ground_mesh=scene_ground_mesh(scene),
        layering=0.0 if scene.ground is None else scene.ground.layering,
        bounds=None if scene.bounds is None else (scene.bounds.lower, scene.bounds.upper),
    )
    kinds, notes = [], []
    for index, table in enumerate(scene.bodies):
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                shape = make_shape(table.shape, table.density, table.thickness, scene.folder)
            except InputError as error:
                raise InputError(f"{scene.name}.toml: bodies[{index}].{error}") from error
        notes += [f"{table.name}: {warning.message}" for warning in caught]
        if table.color is not None:
            shape = shape.colored(table.color)
        if table.colors is not None:
            shape = shape.colored(*table.colors)
        if ground is not None:
            check_clearance(scene, index, shape, ground, fluid.density)
        model = body_model(shape, fluid, kirchhoff_tensor(shape, fluid), float(np.linalg.norm(scene.gravity)))
        scale = Scale(scene.tolerance, scene.duration, apparent_pixels(scene, table, shape))
        model, choice = model_at_level(shape, model, surroundings, table.fidelity, scale, cache_directory() / "pilots")
        kinds.append(Kind(table, shape, model, choice))
    return Plan(scene, tuple(kinds), surroundings, tuple(notes))


# Width of the picture in which a body's size counts, and bodies looked at.
PICTURE_WIDTH, SAMPLE = 1920, 500


def apparent_pixels(scene: Scene, table: BodiesTable, shape: Shape) -> float:
    """Median length of bodies, where they start, in a picture of the scene's view 1920 pixels wide; endless without a view."""
    if scene.view is None:
        return inf
    starts = emit(table.emitter, min(table.count, SAMPLE), scene.seed, random_key(table.name)).positions
    distance = float(np.median(np.linalg.norm(starts - np.asarray(scene.view.position), axis=1)))
    focal = PICTURE_WIDTH / 2.0 / tan(radians(scene.view.field_of_view) / 2.0)
    return 2.0 * float(shape.semi_axes[0]) * focal / max(distance, 1e-9)


def check_clearance(scene: Scene, index: int, shape: Shape, ground: float, fluid_density: float) -> None:
    """Refuse an emitter that would start bodies in the ground."""
    table = scene.bodies[index]
    lowest = lowest_start(table.emitter)
    if lowest - shape.bounding_radius < ground:
        effect, density = "", shape.mass / shape.volume
        if density < fluid_density:
            effect = f", and lighter than the fluid ({density:.4g} < {fluid_density:.4g} kg/m^3) be thrown out of it"
        raise InputError(
            f"{scene.name}.toml: bodies[{index}].emitter: {table.name} would start in the ground{effect}: its centres reach "
            f"down to y = {lowest:.4g} m and it reaches {shape.bounding_radius:.4g} m from its centre; "
            f"raise the emitter by {ground - lowest + shape.bounding_radius:.3g} m"
        )


def choose_device(name: str | None) -> wp.Device:
    """The device named, or CUDA if there is one, else the CPU.

    Raises:
        InputError: there is no such device.
    """
    if name is None:
        return wp.get_device("cuda:0" if wp.is_cuda_available() else "cpu")
    try:
        return wp.get_device(name)
    except (ValueError, RuntimeError) as error:
        there = ", ".join(device.alias for device in wp.get_devices())
        raise InputError(f"device {name!r}: no such device here; there is {there}") from error


def ensemble_of(plan: Plan, device: Any = "cpu", threads: int | None = None) -> Ensemble:
    """The bodies of a plan on a device."""
    groups = []
    for kind in plan.kinds:
        key = random_key(kind.table.name)
        groups.append(Group(kind.model, emit(kind.table.emitter, kind.table.count, plan.scene.seed, key), key, kind.level))
    return Ensemble(groups, plan.surroundings, plan.scene.fps, device, plan.scene.seed, threads)


def manifest_of(plan: Plan, device: wp.Device) -> dict[str, Any]:
    """Where a result comes from: enough to make it again. Holds no time of day, so that equal runs give equal files."""
    return {
        "version": __version__,
        "warp": wp.__version__,
        "platform": f"{platform.system()} {platform.machine()}",
        "device": device.name,
        "scene": plan.scene.name,
        "scene_digest": plan.scene.digest,
        "data_digest": data_digest(plan),
        "scene_text": plan.scene.text,
        "seed": plan.scene.seed,
        "fidelity": ", ".join(f"{kind.table.name}: {kind.level}" for kind in plan.kinds),
    }


def data_digest(plan: Plan) -> str:
    """SHA-256 of what the scene refers to but does not hold: meshes of bodies and ground, a baked flow."""
    digest = hashlib.sha256()
    for mesh in (*(kind.shape.mesh for kind in plan.kinds), plan.surroundings.ground_mesh):
        if mesh is not None:
            digest.update(np.asarray(mesh.vertices, dtype=np.float32).tobytes())
            digest.update(np.asarray(mesh.faces, dtype=np.int32).tobytes())
    if isinstance(plan.surroundings.flow, TurbulenceGrid):
        for value in vars(plan.surroundings.flow).values():
            if isinstance(value, np.ndarray):
                digest.update(np.ascontiguousarray(value).tobytes())
    return digest.hexdigest()


def run(
    ensemble: Ensemble,
    frames: int,
    sinks: Sequence[FrameSink],
    report: Callable[[int, int], None] | None = None,
    snapshot_seconds: float = float("inf"),
) -> Outcome:
    """Simulate and hand every frame up to number frames - 1 to the sinks; after Ctrl-C they are finished with those there are.

    report: called with (frames done, body_steps) after each frame. snapshot_seconds: wall time between frames that carry a
    snapshot for the sinks. On any other exception the sinks are aborted.
    """
    done, body_steps, interrupted = ensemble.frames_done, 0, False
    snapshot_time = time.monotonic()

    def snapshot_due() -> bool:
        nonlocal snapshot_time
        due = time.monotonic() - snapshot_time >= snapshot_seconds
        if due:
            snapshot_time = time.monotonic()
        return due

    asked_to_stop = threading.Event()
    failed = np.zeros(0, dtype=np.int64)
    parked = 0
    try:
        try:
            with interrupts_held(asked_to_stop):
                for frame in ensemble.frames(frames - done, snapshot_due):
                    for sink in sinks:
                        sink.write(frame)
                    done, body_steps = done + 1, frame.body_steps
                    failed = np.flatnonzero(frame.state == FAILED)
                    parked = ensemble.parked(frame)
                    if report is not None:
                        report(done, body_steps)
                    if asked_to_stop.is_set():
                        raise KeyboardInterrupt
        except KeyboardInterrupt:
            interrupted = True
            if done == 0:
                raise
        for sink in sinks:
            sink.finish()
    except BaseException:
        for sink in sinks:
            sink.abort()
        raise
    finally:
        ensemble.close()
    return Outcome(done, body_steps, tuple(failed.tolist()), parked, interrupted)


@contextmanager
def interrupts_held(asked: threading.Event) -> Iterator[None]:
    """Ctrl-C sets `asked` instead of breaking into the middle of a frame; a second one breaks. Main thread only."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def hold(number: int, stack: FrameType | None) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    before = signal.signal(signal.SIGINT, hold)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class MemorySink:
    """Keeps all frames in memory."""

    def __init__(self, frames: int, bodies: int):
        shapes = {"positions": (3,), "orientations": (4,), "velocities": (3,), "angular_velocities": (3,), "state": ()}
        self.arrays = {
            name: np.empty((frames, bodies, *shape), dtype=np.uint8 if name == "state" else np.float32)
            for name, shape in shapes.items()
        }
        self.times: list[float] = []
        self.body_steps: list[int] = []

    def write(self, frame: Frame) -> None:
        """Copy a frame."""
        for name in DATASETS:
            self.arrays[name][len(self.times)] = getattr(frame, name)
        self.times.append(frame.time)
        self.body_steps.append(frame.body_steps)

    def finish(self) -> None:
        """Drop the room for frames that did not come."""
        self.arrays = {name: array[: len(self.times)] for name, array in self.arrays.items()}

    def abort(self) -> None:
        """Nothing to undo."""


def simulate(
    scene: Scene | str | Path,
    device: str | None = None,
    seed: int | None = None,
    progress: bool = False,
    threads: int | None = None,
) -> Recording:
    """Simulate a scene (or its name or path) and keep all frames in memory.

    device: "cpu", "cuda:0", ...; by default CUDA if there is one. seed: replaces the scene's. progress: show a progress
    bar. threads: CPU threads, which do not change the result. Ctrl-C returns the frames there are.

    Raises:
        InputError: the scene cannot be used, or there is no such device.
    """
    from warp_immersed.progress import progress_of

    if not isinstance(scene, Scene):
        scene = Scene.load(scene)
    if seed is not None:
        scene = scene.changed(seed=seed)
    where = choose_device(device)
    planned = plan(scene, where.alias)
    sink = MemorySink(scene.frame_count, scene.body_count)
    ensemble = ensemble_of(planned, where, threads)
    with progress_of(scene.frame_count, shown=progress) as report:
        run(ensemble, scene.frame_count, [sink], report)
    return Recording(
        times=np.array(sink.times),
        body_steps=np.array(sink.body_steps),
        fps=scene.fps,
        prototypes=planned.prototypes,
        manifest=manifest_of(planned, where),
        **sink.arrays,
    )
