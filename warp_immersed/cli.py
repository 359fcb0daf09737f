"""The command line: `warp-immersed run`, `export`, `bake`, `tensor`, `chart`, `info`."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from warp_immersed.errors import InputError
from warp_immersed.fidelity import Fidelity

FAILURE, BAD_INPUT, INTERRUPTED = 1, 2, 130

app = typer.Typer(
    help="Leaves, paper, coins and seeds that fall, drift and tumble right, as USD.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # which would swallow [charts] and [default: ...]
    pretty_exceptions_enable=False,
)

SceneArgument = Annotated[str, typer.Argument(help="A scene file (.toml) or the name of a built-in scene.")]
DeviceOption = Annotated[str | None, typer.Option(help="cpu, cuda:0, ... [default: CUDA if there is one, else the CPU]")]


@app.command()
def run(
    scene: SceneArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .usdc, .usda, .usd or .h5 file. [default: out/SCENE.usdc]")
    ] = None,
    device: DeviceOption = None,
    seed: Annotated[int | None, typer.Option(help="Replaces the scene's seed.")] = None,
    count_scale: Annotated[float, typer.Option(help="Multiplies the number of bodies of every kind.")] = 1.0,
    fidelity: Annotated[Fidelity | None, typer.Option(help="Body model, for all bodies.")] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; they do not change the result.")] = None,
    progress: Annotated[bool, typer.Option(help="Show progress.")] = True,
) -> None:
    """Simulate a scene and write it as USD (or as an HDF5 recording, if OUT ends in .h5)."""
    begin = time.perf_counter()
    start_warp()
    from warp_immersed.progress import progress_of, rate_text
    from warp_immersed.scene import Scene
    from warp_immersed.simulation import choose_device, ensemble_of, manifest_of, plan
    from warp_immersed.simulation import run as run_ensemble
    from warp_immersed.summary import kind_line, mass_text

    loaded = Scene.load(scene).changed(seed=seed, count_scale=count_scale, fidelity=fidelity)
    where = choose_device(device)
    path = output or Path("out") / f"{loaded.name}.usdc"
    check_output(path, loaded.frame_count, loaded.body_count)
    with patience("working out the added mass of new shapes, once"):
        planned = plan(loaded, where.alias, bake_report if progress else None)
    for note in planned.notes:
        typer.echo(f"note: {note}")
    with patience("compiling kernels for this machine, once"):
        ensemble = ensemble_of(planned, where, threads)
    sink = open_sink(path, planned.prototypes, loaded.fps, manifest_of(planned, where))
    typer.echo(f"{loaded.name}: {loaded.body_count} bodies, {loaded.frame_count} frames at {loaded.fps:g} fps, on {where.name}")
    for kind in planned.kinds:
        typer.echo(f"  {kind_line(kind, planned.surroundings)}")
    ready = time.perf_counter()
    with progress_of(loaded.frame_count, shown=progress) as report:
        outcome = run_ensemble(ensemble, loaded.frame_count, [sink], report)
    end = time.perf_counter()
    size = mass_text(path.stat().st_size)
    speed = rate_text(outcome.body_steps, end - ready)
    if outcome.interrupted:
        typer.echo(f"interrupted: {path} is whole with the first {outcome.frames} of {loaded.frame_count} frames ({size})")
        raise typer.Exit(INTERRUPTED)
    typer.echo(f"{path}: {size}, {end - begin:.2f} s of which {ready - begin:.2f} s start-up, {speed}")
    if outcome.failed:
        raise RuntimeError(failure_text(outcome.failed, [(kind.table.name, kind.table.count) for kind in planned.kinds]))


@app.command()
def export(
    recording: Annotated[Path, typer.Argument(help="A recording (.h5).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="A .usdc, .usda or .usd file.")],
) -> None:
    """Write a recording as USD."""
    from warp_immersed.recording import Recording
    from warp_immersed.summary import mass_text
    from warp_immersed.usd import export_usd

    loaded = Recording.load(recording)
    check_output(output, len(loaded.times), loaded.positions.shape[1])
    output.parent.mkdir(parents=True, exist_ok=True)
    export_usd(loaded, output)
    typer.echo(f"{output}: {mass_text(output.stat().st_size)}, {len(loaded.times)} frames")


@app.command()
def bake(
    field: Annotated[Path, typer.Argument(help="A field file (.toml).")],
    output: Annotated[Path | None, typer.Option("--output", "-o", help="An .h5 file. [default: FIELD.h5]")] = None,
    device: DeviceOption = None,
    resume: Annotated[bool, typer.Option(help="Go on from the checkpoint of an interrupted bake.")] = False,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; they do not change the result.")] = None,
    progress: Annotated[bool, typer.Option(help="Show progress.")] = True,
) -> None:
    """Solve the mean wind and turbulence of a field, once, for scenes to use."""
    start_warp()
    from warp_immersed.bake import bake as bake_field
    from warp_immersed.bake import plan_bake
    from warp_immersed.field_scene import FieldScene
    from warp_immersed.simulation import choose_device

    where = choose_device(device)
    described = FieldScene.load(field)
    path = output or field.with_suffix(".h5")
    check_folder(path)
    typer.echo(f"{field.name}: {plan_bake(described, where.alias, threads).text}, on {where.name}")
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        report = bake_field(
            described,
            path,
            where.alias,
            resume=resume,
            threads=threads,
            progress=bake_report if progress else None,
            time_progress=(lambda t: typer.echo(f"snapshot at {t:.3g} s", err=True)) if progress else None,
        )
    except KeyboardInterrupt:
        typer.echo(f"interrupted: the state is kept beside {path}; go on with --resume", err=True)
        raise typer.Exit(INTERRUPTED) from None
    verdict = "converged" if report.convergence.converged else "not converged"
    advice = f": {report.convergence.advice}" if report.convergence.advice else ""
    typer.echo(f"{path}: {verdict} in {report.steps} steps, {report.seconds:.1f} s{advice}")


@app.command()
def tensor(
    mesh: Annotated[Path, typer.Argument(help="A mesh file: closed, or open with a thickness.")],
    thickness: Annotated[float | None, typer.Option(help="Of an open sheet, m.")] = None,
    density: Annotated[float | None, typer.Option(help="Of the material, kg/m^3: adds shares of mass and inertia.")] = None,
    fluid: Annotated[str, typer.Option(help="air, water, or a density in kg/m^3.")] = "air",
    scale: Annotated[float, typer.Option(help="Multiplies the mesh's coordinates.")] = 1.0,
    tolerance: Annotated[float, typer.Option(help="Relative error wanted.")] = 0.01,
    json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    cache: Annotated[bool, typer.Option(help="Look it up on disk, and keep it there.")] = True,
) -> None:
    """Print the added mass (Kirchhoff tensor) of a mesh."""
    import json as json_module

    start_warp()
    from warp_immersed.added_mass import kirchhoff_solution
    from warp_immersed.fluid import PRESETS, Fluid
    from warp_immersed.shape import Shape
    from warp_immersed.tensor_report import tensor_dict, tensor_table

    if fluid in PRESETS:
        medium = PRESETS[fluid]
    else:
        try:
            medium = Fluid(float(fluid), 1e-6)
        except ValueError as error:
            raise InputError(f"fluid: found {fluid!r}, must be air, water or a positive density [kg/m^3]") from error
    with notes_printed():
        shape = Shape.from_mesh(mesh, 1000.0 if density is None else density, thickness, scale=scale)
        with patience("solving; a large mesh takes a while"):
            solution = kirchhoff_solution(shape, medium, tolerance=tolerance, cache=cache)
    if json:
        typer.echo(json_module.dumps(tensor_dict(solution, shape, medium, mesh.name, density is not None), indent=1))
    else:
        typer.echo(tensor_table(solution, shape, medium, mesh.name, density is not None))


@app.command()
def chart(
    name: Annotated[str, typer.Argument(help="field (needs a bake file), turbulence-sources or added-mass-failures.")],
    source: Annotated[Path | None, typer.Argument(help="What to draw, where the chart needs it.")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="A .png file. [default: NAME.png]")] = None,
    at: Annotated[float | None, typer.Option("--time", help="Snapshot of a flow in time, s. [default: the last]")] = None,
) -> None:
    """Draw a figure (needs the extra: pip install warp-immersed[charts])."""
    path = output or Path(f"{name}.png")
    names = ("field", "turbulence-sources", "added-mass-failures")
    if name not in names:
        raise InputError(f"chart: found {name!r}, must be one of {', '.join(names)}")
    check_folder(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        if name == "field":
            from warp_immersed.charts.field import chart_field

            if source is None:
                raise InputError("chart field: missing the bake file (.h5) to draw")
            chart_field(source, path, at)
        elif name == "added-mass-failures":
            from warp_immersed.charts.added_mass import chart_failures

            chart_failures(path)
        else:
            from warp_immersed.charts.turbulence_sources import chart_sources

            chart_sources(path)
    except ModuleNotFoundError as error:
        raise InputError(f"chart: needs {error.name}; pip install 'warp-immersed[charts]'") from error
    typer.echo(str(path))


@app.command()
def info(scene: Annotated[str | None, typer.Argument(help="A scene file or built-in scene to describe.")] = None) -> None:
    """Say what a scene would do, or without one, what there is: versions, devices, built-in scenes."""
    start_warp()
    from warp_immersed.summary import describe_installation, describe_scene

    if scene is None:
        lines = describe_installation()
    else:
        from warp_immersed.scene import Scene
        from warp_immersed.simulation import plan

        with patience("working out the added mass of new shapes, once"):
            lines = describe_scene(plan(Scene.load(scene), baking=bake_report))
    for line in lines:
        typer.echo(line)


@contextmanager
def patience(reason: str) -> Iterator[None]:
    """Say why it takes so long, if it does: a first run on a machine would be a long silence."""
    timer = threading.Timer(2.5, lambda: typer.echo(reason, err=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def start_warp() -> None:
    """Initialise Warp without its chatter, and let the library say what it is at."""
    import logging
    import os

    import warp as wp

    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger("warp_immersed").setLevel(logging.INFO)
    wp.config.log_level = wp.LOG_ERROR
    # Without a GPU driver Warp warns from native code, straight to standard error.
    sys.stderr.flush()
    saved = os.dup(2)
    try:
        with open(os.devnull, "w") as quiet:
            os.dup2(quiet.fileno(), 2)
            wp.init()
    finally:
        os.dup2(saved, 2)
        os.close(saved)


def bake_report(now: Any) -> None:
    """Show how a solve stands, on one line of a terminal or now and then elsewhere."""
    text = f"baking: step {now.step}, change {now.change:.1e} a flow-through, divergence {now.divergence:.1e}"
    if sys.stderr.isatty():
        print(f"\r{text}   ", end="", file=sys.stderr, flush=True)
    elif now.step % 100 == 0:
        print(text, file=sys.stderr, flush=True)


@contextmanager
def notes_printed() -> Iterator[None]:
    """Warnings as plain lines."""
    import warnings

    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for warning in caught:
        typer.echo(f"note: {warning.message}", err=True)


def check_output(path: Path, frames: int, bodies: int) -> None:
    """Refuse an output that cannot be written, before the work is done."""
    import shutil

    endings = (".usdc", ".usda", ".usd", ".h5")
    if path.suffix not in endings:
        raise InputError(f"output {str(path)!r}: found ending {path.suffix!r}, must be one of {', '.join(endings)}")
    check_folder(path)
    needed = frames * bodies * (250 if path.suffix == ".usda" else 54 if path.suffix == ".h5" else 45)
    free = shutil.disk_usage(next(parent for parent in path.absolute().parents if parent.exists())).free
    if needed > free:
        raise InputError(f"output {str(path)!r}: needs about {needed / 1e6:.0f} MB, the disk has {free / 1e6:.0f} MB left")


def check_folder(path: Path) -> None:
    """Refuse a file whose folder cannot be written to, or made."""
    import tempfile

    folder = next(parent for parent in path.absolute().parents if parent.exists())
    try:
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise InputError(f"output {str(path)!r}: cannot be written ({error.strerror})") from error
    if path.is_dir():
        raise InputError(f"output {str(path)!r}: is a folder, must be a file")


def open_sink(path: Path, prototypes: tuple[Any, ...], fps: float, manifest: dict[str, Any]) -> Any:
    """The writer for a path's ending; makes the folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".h5":
        from warp_immersed.recording import RecordingWriter

        return RecordingWriter(path, prototypes, fps, manifest)
    from warp_immersed.usd import UsdWriter

    return UsdWriter(path, prototypes, fps, manifest)


def failure_text(failed: tuple[int, ...], kinds: list[tuple[str, int]]) -> str:
    """Names of failed bodies, kind by kind."""
    names = []
    first = 0
    for name, count in kinds:
        names += [f"{name} {i - first}" for i in failed if first <= i < first + count]
        first += count
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return f"{len(names)} of {first} bodies failed and were frozen where they were: {shown}"


def main() -> None:
    """Entry point: one line and an exit status instead of a traceback."""
    try:
        # without standalone mode the exit status of typer.Exit comes back as a value
        sys.exit(app(standalone_mode=False) or 0)
    except InputError as error:
        fail(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        fail("interrupted before the first frame; nothing was written", INTERRUPTED)
    except typer.Abort:
        sys.exit(INTERRUPTED)
    except Exception as error:
        show = getattr(error, "format_message", None)
        fail(show() if show else str(error), BAD_INPUT if show else FAILURE)


def fail(message: str, status: int) -> None:
    """Print a one-line error and leave."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
