"""Options of a USD export, as the commands that write USD share them."""

from typing import Annotated

import typer

from warp_immersed.export_options import Instancing, Units, UpAxis

UpAxisOption = Annotated[UpAxis, typer.Option(help="USD: which axis points up.")]
UnitsOption = Annotated[Units, typer.Option(help="USD: metres or centimetres.")]
FpsOption = Annotated[
    float | None, typer.Option("--fps", help="USD: time codes per second; the speed stays. [default: the simulation's]")
]
StartFrameOption = Annotated[int, typer.Option(help="USD: time code of the simulation's first frame.")]
MotionBlurOption = Annotated[bool, typer.Option(help="USD: write velocities, which renderers blur by.")]
ChunkFramesOption = Annotated[
    int | None, typer.Option(help="USD: spread the frames over value clips of so many frames, in a folder beside the file.")
]
ShardsOption = Annotated[
    int | None, typer.Option(help="USD: spread the bodies over so many point instancers, in a folder beside the file.")
]
InstancingOption = Annotated[
    Instancing, typer.Option(help="USD: one point instancer, or a transform a body (small crowds) for tools without.")
]
