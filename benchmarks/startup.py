"""What a user waits for before the first frame: import, a warm start, and kernels compiled for the first time."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from benchmarks.measurement import Row, seconds_of

COMMANDS = {
    "import": ["-c", "import warp_immersed"],
    "help": ["-m", "warp_immersed.cli", "--help"],
    "100 bodies, one second": ["-m", "warp_immersed.cli", "run", "falling_leaves", "--count-scale", "0.1", "-o", "a.h5"],
}


def rows(quick: bool) -> Iterator[Row]:
    """Wall seconds of whole processes, caches warm; and of the last with empty ones: it compiles and solves tensors."""
    for name, arguments in COMMANDS.items():
        run(arguments, {})
        yield {
            "what": "startup",
            "command": name,
            "caches": "warm",
            "seconds": round(seconds_of(lambda a=arguments: run(a, {})), 3),
        }
    if not quick:
        with tempfile.TemporaryDirectory() as cache:
            fresh = {"WARP_CACHE_PATH": str(Path(cache) / "warp"), "WARP_IMMERSED_CACHE": str(Path(cache) / "tensors")}
            seconds = seconds_of(lambda: run(arguments, fresh), 1)
            yield {"what": "startup", "command": name, "caches": "empty", "seconds": round(seconds, 3)}


def run(arguments: list[str], environment: dict[str, str]) -> None:
    """One process, in a folder of its own."""
    root = str(Path(__file__).resolve().parents[1])
    path = os.pathsep.join(filter(None, [root, os.environ.get("PYTHONPATH", "")]))
    with tempfile.TemporaryDirectory() as folder:
        variables = {**os.environ, "PYTHONPATH": path, **environment}
        subprocess.run([sys.executable, *arguments], check=True, cwd=folder, capture_output=True, env=variables)
