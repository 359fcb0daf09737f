"""`warp-immersed export`."""

from pathlib import Path
from typing import Annotated

import typer

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
from warp_immersed.export_options import USD_ENDINGS, ExportOptions


def export(
    recording: Annotated[Path, typer.Argument(help="A recording (.h5).")],
    output: Annotated[Path, typer.Option("--output", "-o", help="A .usdc, .usda, .usd or .usdz file.")],
    frames: Annotated[
        str | None, typer.Option(help="Frames a:b, counted from 0, b left out, either may be missing. [default: all]")
    ] = None,
    bodies: Annotated[
        str | None, typer.Option(help="Kinds by name and ranges of body numbers, as in maple,0:100. [default: all]")
    ] = None,
    up_axis: UpAxisOption = "y",
    units: UnitsOption = "m",
    fps: FpsOption = None,
    start_frame: StartFrameOption = 1,
    motion_blur: MotionBlurOption = True,
    chunk_frames: ChunkFramesOption = None,
    shards: ShardsOption = None,
    instancing: InstancingOption = "points",
) -> None:
    """Write a recording, or a part of it, as USD."""
    options = ExportOptions(up_axis, units, fps, start_frame, motion_blur, chunk_frames, shards, instancing)
    if output.suffix not in USD_ENDINGS:
        raise InputError(f"output {str(output)!r}: found ending {output.suffix!r}, must be one of {', '.join(USD_ENDINGS)}")
    from warp_immersed.output_files import written_size
    from warp_immersed.recording import open_recording
    from warp_immersed.summary import mass_text
    from warp_immersed.usd_export import chosen_bodies, chosen_frames, export_usd

    with open_recording(recording) as opened:
        count, total = opened.positions.shape[:2]
        chosen = range(count) if frames is None else chosen_frames(frames, count)
        ids = None if bodies is None else chosen_bodies(bodies, opened.prototypes)
        body_count = total if ids is None else len(ids)
        check_output(output, len(chosen), body_count, options)
        output.parent.mkdir(parents=True, exist_ok=True)
        export_usd(opened, output, options, chosen, ids)
    typer.echo(f"{output}: {mass_text(written_size(output))}, {len(chosen)} frames, {body_count} bodies")
