"""`warp-immersed view`."""

import webbrowser
from pathlib import Path
from typing import Annotated

import typer


def view(
    source: Annotated[Path, typer.Argument(help="A recording (.h5) or a USD file.")],
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to serve on; the next free one if it is taken.")] = 8080,
    host: Annotated[str, typer.Option(help="Address to serve on; 0.0.0.0 lets other machines in.")] = "127.0.0.1",
    browser: Annotated[bool, typer.Option(help="Open the browser.")] = True,
) -> None:
    """Play a shot in the browser: orbit, scrub, follow a body (needs the extra: pip install warp-immersed[view])."""
    from warp_immersed.shot import open_shot
    from warp_immersed.viewer import Viewer

    with open_shot(source) as shot:
        viewer = Viewer(shot, host, port)
        address = f"http://{'localhost' if host in ('127.0.0.1', '0.0.0.0') else host}:{viewer.port}"
        typer.echo(f"{address}  (Ctrl-C to stop)")
        if browser:
            webbrowser.open(address)
        try:
            viewer.play()
        except KeyboardInterrupt:
            pass
        finally:
            viewer.close()
