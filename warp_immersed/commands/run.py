"""`warp-immersed run`."""

import time
from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.console import INTERRUPTED, DeviceOption, SceneArgument, bake_report, patience, start_warp
from warp_immersed.commands.output import check_output
from warp_immersed.commands.usd_options import (
    ChunkFramesOption,
    FpsOption,
    InstancingOption,
    MotionBlurOption,
    ShardsOption,
    StartFrameOption,
    UnitsOption,
    UpAxisOption,
)
from warp_immersed.errors import InputError
from warp_immersed.export_options import ExportOptions
from warp_immersed.fidelity import Fidelity


def run(
    scene: SceneArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .usdc, .usda, .usd, .usdz or .h5 file. [default: out/SCENE.usdc]")
    ] = None,
    device: DeviceOption = None,
    seed: Annotated[int | None, typer.Option(help="Replaces the scene's seed.")] = None,
    count_scale: Annotated[float, typer.Option(help="Multiplies the number of bodies of every kind.")] = 1.0,
    fidelity: Annotated[Fidelity | None, typer.Option(help="Body model, for all bodies.")] = None,
    threads: Annotated[int | None, typer.Option(min=1, help="CPU threads; they do not change the result.")] = None,
    progress: Annotated[bool, typer.Option(help="Show progress.")] = True,
    resume: Annotated[bool, typer.Option("--resume", help="H5: go on with a run that was cut short.")] = False,
    compress: Annotated[bool, typer.Option("--compress", help="H5: pack the finished file.")] = False,
    checkpoint_seconds: Annotated[
        float, typer.Option(min=0.0, help="H5: time between checkpoints, from which --resume goes on.")
    ] = 5.0,
    up_axis: UpAxisOption = "y",
    units: UnitsOption = "m",
    fps: FpsOption = None,
    start_frame: StartFrameOption = 1,
    motion_blur: MotionBlurOption = True,
    chunk_frames: ChunkFramesOption = None,
    shards: ShardsOption = None,
    instancing: InstancingOption = "points",
) -> None:
    """Simulate a scene and write it as USD (or as an HDF5 recording, if OUT ends in .h5)."""
    begin = time.perf_counter()
    options = ExportOptions(up_axis, units, fps, start_frame, motion_blur, chunk_frames, shards, instancing)
    start_warp()
    from warp_immersed.output_files import written_size
    from warp_immersed.progress import progress_of, rate_text
    from warp_immersed.scene import Scene
    from warp_immersed.simulation import FrameSink, choose_device, ensemble_of, manifest_of, plan
    from warp_immersed.simulation import run as run_ensemble
    from warp_immersed.summary import kind_line, mass_text

    loaded = Scene.load(scene).changed(seed=seed, count_scale=count_scale, fidelity=fidelity)
    where = choose_device(device)
    path = output or Path("out") / f"{loaded.name}.usdc"
    check_options(path, options, resume, compress)
    check_output(path, loaded.frame_count, loaded.body_count, options)
    with patience("working out the added mass of new shapes, once"):
        planned = plan(loaded, where.alias, bake_report if progress else None)
    for note in planned.notes:
        typer.echo(f"note: {note}")
    with patience("compiling kernels for this machine, once"):
        ensemble = ensemble_of(planned, where, threads)
    manifest = manifest_of(planned, where)
    path.parent.mkdir(parents=True, exist_ok=True)
    sink: FrameSink
    if path.suffix == ".h5":
        from warp_immersed.recording import is_finished, resume_recording, start_recording

        described = (path, planned.prototypes, loaded.fps, manifest, loaded.frame_count, compress)
        if resume and is_finished(path, manifest, loaded.frame_count):
            typer.echo(f"{path}: finished already, all {loaded.frame_count} frames are there")
            return
        sink, checkpoint = resume_recording(*described) if resume else (start_recording(*described), None)
        if checkpoint is not None:
            ensemble.restore(checkpoint.frame, checkpoint.body_steps, checkpoint.state)
    else:
        from warp_immersed.usd_export import usd_writer

        sink = usd_writer(path, planned.prototypes, loaded.fps, manifest, options)
    typer.echo(f"{loaded.name}: {loaded.body_count} bodies, {loaded.frame_count} frames at {loaded.fps:g} fps, on {where.name}")
    for kind in planned.kinds:
        typer.echo(f"  {kind_line(kind, planned.surroundings)}")
    if ensemble.frames_done > 0:
        typer.echo(f"going on after frame {ensemble.frames_done}")
    ready = time.perf_counter()
    with progress_of(loaded.frame_count, shown=progress) as report:
        outcome = run_ensemble(ensemble, loaded.frame_count, [sink], report, checkpoint_seconds)
    end = time.perf_counter()
    size = mass_text(written_size(path))
    speed = rate_text(outcome.body_steps, end - ready)
    if outcome.interrupted:
        typer.echo(f"interrupted: {path} is whole with the first {outcome.frames} of {loaded.frame_count} frames ({size})")
        raise typer.Exit(INTERRUPTED)
    typer.echo(f"{path}: {size}, {end - begin:.2f} s of which {ready - begin:.2f} s start-up, {speed}")
    if outcome.parked:
        typer.echo(f"note: {outcome.parked} of {loaded.body_count} bodies left the bounds and were parked there")
    if outcome.failed:
        raise RuntimeError(failure_text(outcome.failed, [(kind.table.name, kind.table.count) for kind in planned.kinds]))


def check_options(path: Path, options: ExportOptions, resume: bool, compress: bool) -> None:
    """Refuse options that the output cannot take, rather than leave them without effect."""
    if path.suffix == ".h5" and options != ExportOptions():
        raise InputError(f"output {str(path)!r}: a recording takes no options of USD; give them to warp-immersed export")
    for name, given in (("--resume", resume), ("--compress", compress)):
        if given and path.suffix != ".h5":
            recording = f"{path.stem}.h5"
            raise InputError(
                f"{name}: needs a recording, found {str(path)!r}; run -o {recording}, then export {recording} -o {path.name}"
            )


def failure_text(failed: tuple[int, ...], kinds: list[tuple[str, int]]) -> str:
    """Names of failed bodies, kind by kind."""
    names = []
    first = 0
    for name, count in kinds:
        names += [f"{name} {i - first}" for i in failed if first <= i < first + count]
        first += count
    shown = ", ".join(names[:5]) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
    return f"{len(names)} of {first} bodies failed and were frozen where they were: {shown}"
