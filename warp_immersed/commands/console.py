"""What the commands share: options, exit statuses, and what they say while they work."""

import logging
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Annotated, Any

import typer

FAILURE, BAD_INPUT, INTERRUPTED = 1, 2, 130
LINE_EVERY = 3.0  # seconds between lines where there is no terminal

SceneArgument = Annotated[str, typer.Argument(help="A scene file (.toml) or the name of a built-in scene.")]
DeviceOption = Annotated[str | None, typer.Option(help="cpu, cuda:0, ... [default: CUDA if there is one, else the CPU]")]


@contextmanager
def patience(reason: str) -> Iterator[None]:
    """Say why it takes so long, if it does: a first run on a machine would be a long silence."""
    timer = threading.Timer(2.5, lambda: typer.echo(reason, err=True))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()


def start_warp() -> None:
    """Initialise Warp without its chatter, and let the library say what it is at."""
    import warp as wp

    logging.basicConfig(format="%(message)s", stream=sys.stderr)
    logging.getLogger("warp_immersed").setLevel(logging.INFO)
    wp.config.log_level = wp.LOG_ERROR
    # Without a GPU driver Warp warns from native code, straight to standard error.
    sys.stderr.flush()
    saved = os.dup(2)
    try:
        with open(os.devnull, "w") as quiet:
            os.dup2(quiet.fileno(), 2)
            wp.init()
    finally:
        os.dup2(saved, 2)
        os.close(saved)


def bake_report(now: Any) -> None:
    """Show how a solve stands, on one line of a terminal or now and then elsewhere."""
    text = f"baking: step {now.step}, change {now.change:.1e} a flow-through, divergence {now.divergence:.1e}"
    if sys.stderr.isatty():
        print(f"\r{text}   ", end="", file=sys.stderr, flush=True)
    elif now.step % 100 == 0:
        print(text, file=sys.stderr, flush=True)


@contextmanager
def solving_report() -> Iterator[Callable[[str, float], None]]:
    """A function to be told what a solver does and how much is done: on one line of a terminal, or a line every few seconds."""
    start = last = time.monotonic()
    shown = False
    terminal = sys.stderr.isatty()

    def report(label: str, fraction: float) -> None:
        nonlocal last, shown
        now = time.monotonic()
        if now - start > 1.0 and now - last > (0.1 if terminal else LINE_EVERY):
            last, shown = now, True
            text = f"{label}: {100.0 * fraction:.0f} %, {now - start:.0f} s"
            print(f"\r{text:<60}" if terminal else text, end="" if terminal else "\n", file=sys.stderr, flush=True)

    try:
        yield report
    finally:
        if terminal and shown:
            print(f"\r{'':<60}\r", end="", file=sys.stderr, flush=True)


@contextmanager
def notes_printed() -> Iterator[None]:
    """Warnings as plain lines."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    for warning in caught:
        typer.echo(f"note: {warning.message}", err=True)
