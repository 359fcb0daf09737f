"""The command line: `warp-immersed run`, `preview`, `view` and the rest, a module each."""

import sys

import typer

from warp_immersed.commands.bake import bake
from warp_immersed.commands.chart import chart
from warp_immersed.commands.console import BAD_INPUT, FAILURE, INTERRUPTED
from warp_immersed.commands.export import export
from warp_immersed.commands.ground import ground
from warp_immersed.commands.info import info
from warp_immersed.commands.new import new
from warp_immersed.commands.preview import preview
from warp_immersed.commands.run import run
from warp_immersed.commands.scenes import scenes
from warp_immersed.commands.tensor import tensor
from warp_immersed.commands.view import view
from warp_immersed.errors import InputError

app = typer.Typer(
    help="Leaves, paper, coins and seeds that fall, drift and tumble right, as USD.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,  # which would swallow [charts] and [default: ...]
    pretty_exceptions_enable=False,
)
for command in (scenes, new, run, preview, view, export, ground, bake, tensor, chart, info):
    app.command()(command)


def main() -> None:
    """Entry point: one line and an exit status instead of a traceback."""
    try:
        # without standalone mode the exit status of typer.Exit comes back as a value
        sys.exit(app(standalone_mode=False) or 0)
    except InputError as error:
        fail(str(error), BAD_INPUT)
    except KeyboardInterrupt:
        fail("interrupted before the first frame; nothing was written", INTERRUPTED)
    except typer.Abort:
        sys.exit(INTERRUPTED)
    except Exception as error:
        show = getattr(error, "format_message", None)
        fail(show() if show else str(error), BAD_INPUT if show else FAILURE)


def fail(message: str, status: int) -> None:
    """Print a one-line error and leave."""
    print(f"error: {' '.join(message.split())}", file=sys.stderr)
    sys.exit(status)


if __name__ == "__main__":
    main()
