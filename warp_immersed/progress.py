"""Progress of a run: a bar on a terminal, a line now and then elsewhere."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

# Seconds between plain lines.
LINE_EVERY = 5.0

Report = Callable[[int, int], None]


@contextmanager
def progress_of(frames: int, shown: bool) -> Iterator[Report | None]:
    """A function to be called with (frames done, body_steps) after each frame, or None if nothing is to be shown."""
    if not shown:
        yield None
        return
    console = Console(file=sys.stderr)
    if not console.is_terminal:
        yield plain_lines(frames)
        return
    columns = (
        TextColumn("frames"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task("frames", total=frames, rate="")
        start = time.perf_counter()

        def report(done: int, body_steps: int) -> None:
            bar.update(task, completed=done, rate=rate_text(body_steps, time.perf_counter() - start))

        yield report


def plain_lines(frames: int) -> Report:
    """Reports as lines on standard error, at most one every LINE_EVERY seconds."""
    start = time.perf_counter()
    last = start

    def report(done: int, body_steps: int) -> None:
        nonlocal last
        now = time.perf_counter()
        if now - last >= LINE_EVERY and done < frames:
            last = now
            left = (now - start) / done * (frames - done)
            print(f"frame {done}/{frames}, {rate_text(body_steps, now - start)}, {left:.0f} s left", file=sys.stderr, flush=True)

    return report


def rate_text(body_steps: int, seconds: float) -> str:
    """Body-steps per second in words."""
    rate = body_steps / max(seconds, 1e-9)
    for unit, size in (("G", 1e9), ("M", 1e6), ("k", 1e3)):
        if rate >= size:
            return f"{rate / size:.1f} {unit} body-steps/s"
    return f"{rate:.0f} body-steps/s"
