"""`warp-immersed bake`."""

from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.console import INTERRUPTED, DeviceOption, bake_report, start_warp
from warp_immersed.commands.output import check_folder


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
