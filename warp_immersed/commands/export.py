"""`warp-immersed export`."""

from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.output import check_output


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
