"""`warp-immersed run`."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from warp_immersed.commands.console import INTERRUPTED, DeviceOption, SceneArgument, bake_report, patience, start_warp
from warp_immersed.commands.output import check_output
from warp_immersed.fidelity import Fidelity


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
