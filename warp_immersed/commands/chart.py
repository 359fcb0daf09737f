"""`warp-immersed chart`."""

import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.console import start_warp
from warp_immersed.commands.output import check_folder
from warp_immersed.errors import InputError

# Every module of warp_immersed.charts named here has a function chart(request) that writes the picture, with the table behind
# it beside it, and returns its conclusion in one line.
CHARTS = {
    "work-precision": "work_precision",
    "stability": "stability",
    "fidelity": "fidelity",
    "slides": "slides",
    "added-mass": "added_mass",
    "added-mass-failures": "added_mass_failures",
    "turbulence": "turbulence",
    "turbulence-sources": "turbulence_sources",
    "regimes": "regimes",
    "field": "field",
}
PICTURES = (".png", ".pdf", ".svg")


def chart(
    name: Annotated[str, typer.Argument(help=f"{', '.join(CHARTS)}.")],
    source: Annotated[Path | None, typer.Argument(help="A bake file (field), or measured points (regimes).")] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A folder, or a .png, .pdf or .svg file. [default: NAME.png]")
    ] = None,
    shape: Annotated[str | None, typer.Option(help="Library shape for regimes. [default: a disk]")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="Fewer cases: a minute rather than several.")] = False,
    at: Annotated[float | None, typer.Option("--time", help="Snapshot of a flow in time, s. [default: the last]")] = None,
) -> None:
    """Measure and draw a figure, with the table behind it (needs the extra: pip install warp-immersed[charts])."""
    if name not in CHARTS:
        raise InputError(f"chart: found {name!r}, must be one of {', '.join(CHARTS)}")
    path = output or Path(f"{name}.png")
    if path.suffix not in PICTURES:
        if path.suffix and not path.is_dir():
            raise InputError(
                f"output {str(path)!r}: found ending {path.suffix!r}, must be a folder or end in {', '.join(PICTURES)}"
            )
        path /= f"{name}.png"
    check_folder(path)
    start_warp()
    try:
        import matplotlib  # noqa: F401  before the work, not after it

        from warp_immersed.charts.figures import Request

        module = import_module(f"warp_immersed.charts.{CHARTS[name]}")
        path.parent.mkdir(parents=True, exist_ok=True)
        conclusion = module.chart(Request(path, quick, source, at, shape, progress))
    except ModuleNotFoundError as error:
        raise InputError(f"chart: needs {error.name}; pip install 'warp-immersed[charts]'") from error
    progress("", 1.0)
    typer.echo(conclusion)
    typer.echo(str(path))


def progress(what: str, fraction: float) -> None:
    """Say how far a chart is: on one line of a terminal, in lines elsewhere."""
    if sys.stderr.isatty():
        print(f"\r\x1b[K{100 * fraction:3.0f} %  {what}" if what else "\r\x1b[K", end="", file=sys.stderr, flush=True)
    elif what:
        print(f"{100 * fraction:3.0f} %  {what}", file=sys.stderr, flush=True)
