"""`warp-immersed scenes`."""

import textwrap

import typer


def scenes() -> None:
    """List the built-in scenes with their stories."""
    from warp_immersed.scene import Scene, builtin_scenes

    for name in sorted(builtin_scenes()):
        loaded = Scene.load(name)
        typer.echo(f"{name}: {loaded.body_count} bodies, {loaded.duration:g} s")
        typer.echo(textwrap.fill(loaded.story, 96, initial_indent="    ", subsequent_indent="    "))
