"""`warp-immersed info`."""

from typing import Annotated

import typer

from warp_immersed.commands.console import bake_report, patience, start_warp


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
