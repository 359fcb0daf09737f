"""`warp-immersed chart`."""

from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.console import start_warp
from warp_immersed.commands.output import check_folder
from warp_immersed.errors import InputError


def chart(
    name: Annotated[str, typer.Argument(help="field (needs a bake file), regimes, turbulence-sources or added-mass-failures.")],
    source: Annotated[Path | None, typer.Argument(help="A bake file (field), or measured points (regimes).")] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="A .png file. [default: NAME.png]")] = None,
    shape: Annotated[str | None, typer.Option(help="Library shape for regimes. [default: a disk]")] = None,
    at: Annotated[float | None, typer.Option("--time", help="Snapshot of a flow in time, s. [default: the last]")] = None,
) -> None:
    """Draw a figure (needs the extra: pip install warp-immersed[charts])."""
    path = output or Path(f"{name}.png")
    names = ("field", "regimes", "turbulence-sources", "added-mass-failures")
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
        elif name == "regimes":
            from warp_immersed.charts.regimes import chart_regimes

            start_warp()
            typer.echo(chart_regimes(path, source, shape))
        elif name == "added-mass-failures":
            from warp_immersed.charts.added_mass import chart_failures

            chart_failures(path)
        else:
            from warp_immersed.charts.turbulence_sources import chart_sources

            chart_sources(path)
    except ModuleNotFoundError as error:
        raise InputError(f"chart: needs {error.name}; pip install 'warp-immersed[charts]'") from error
    typer.echo(str(path))
