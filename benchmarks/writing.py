"""USD and HDF5 against the disk: seconds to write a crowd, over those for as many bytes to the same disk."""

import os
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import warp_immersed as wi
from benchmarks.measurement import Row
from warp_immersed.recording import DATASETS, start_recording
from warp_immersed.simulation import choose_device, ensemble_of, manifest_of, plan
from warp_immersed.usd import UsdWriter

FRAMES = 240
SCENE = """
duration = 100.0
fps = 24
[turbulence]
kind = "homogeneous"
k = 0.05
epsilon = 0.02
[[bodies]]
name = "leaf"
count = COUNT
shape = { library = "maple_leaf" }
emitter = { kind = "box", center = [0, 100, 0], size = [10, 10, 10] }
"""


def rows(quick: bool) -> Iterator[Row]:
    """Crowds of leaves, 240 frames."""
    for count in (1000,) if quick else (1000, 10_000):
        planned = plan(wi.Scene.from_text(SCENE.replace("COUNT", str(count)), "benchmark"))
        ensemble = ensemble_of(planned, "cpu")
        states = [replace(f, **{name: getattr(f, name).copy() for name in DATASETS}) for f in ensemble.frames(24)]
        ensemble.close()
        manifest = manifest_of(planned, choose_device("cpu"))
        writers: dict[str, Callable[[Path], Any]] = {
            "usdc": lambda path, p=planned, m=manifest: UsdWriter(path, p.prototypes, 24.0, m),
            "h5": lambda path, p=planned, m=manifest: start_recording(path, p.prototypes, 24.0, m, FRAMES),
        }
        for ending, make in writers.items():
            yield {"what": "writing", "format": ending, "bodies": count, "frames": FRAMES, **timed(make, ending, states)}


def timed(make: Callable[[Path], Any], ending: str, states: list[Any]) -> Row:
    """Best of three: the writer until its bytes are on the disk, and plain writing of as many bytes."""
    ours, floor = [], []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"crowd.{ending}"
        for _ in range(3):
            start = time.perf_counter()
            writer = make(path)
            for frame in range(FRAMES):
                writer.write(replace(states[frame % len(states)], index=frame, time=frame / 24.0))
            writer.finish()
            with open(path, "rb+") as file:
                os.fsync(file.fileno())
            ours.append(time.perf_counter() - start)
            block, size = np.random.default_rng(0).bytes(1 << 22), path.stat().st_size
            start = time.perf_counter()
            with open(Path(folder) / "floor", "wb") as file:
                for _ in range(size >> 22):
                    file.write(block)
                file.write(block[: size & ((1 << 22) - 1)])
                file.flush()
                os.fsync(file.fileno())
            floor.append(time.perf_counter() - start)
    return {
        "bytes": size, "seconds": round(min(ours), 3), "disk_floor_seconds": round(min(floor), 3),
        "ratio": round(min(ours) / min(floor), 2),
    }  # fmt: skip
