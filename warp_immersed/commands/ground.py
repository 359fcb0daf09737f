"""`warp-immersed ground`."""

from pathlib import Path
from typing import Annotated

import typer

from warp_immersed.commands.console import SceneArgument
from warp_immersed.commands.output import check_folder


def ground(
    scene: SceneArgument,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A .usdc, .usda or .usd file. [default: out/SCENE_ground.usdc]")
    ] = None,
) -> None:
    """Write what a scene's bodies land on as USD, to import beside the crowd."""
    from warp_immersed.scene import Scene
    from warp_immersed.usd_ground import write_ground

    loaded = Scene.load(scene)
    path = output or Path("out") / f"{loaded.name}_ground.usdc"
    check_folder(path)
    write_ground(loaded, path)
    typer.echo(str(path))
