"""Body-steps per second of the frame kernel: one core, all cores, CUDA if there is one; memory per body; USD writing.

    python benchmarks/simulate.py [--quick]

Prints a JSON line per measurement, machine facts first.
"""

import argparse
import json
import os
import platform
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import warp_immersed as wi
from warp_immersed.frame_stepper import available_threads
from warp_immersed.recording import DATASETS
from warp_immersed.simulation import choose_device, ensemble_of, manifest_of, plan

SCENE = """
duration = 100.0
fps = 24
[wind]
velocity = [0.5, 0.0, 0.0]
[turbulence]
kind = "homogeneous"
k = 0.05
epsilon = 0.02
[[bodies]]
name = "leaf"
count = 1000
shape = { library = "maple_leaf" }
emitter = { kind = "box", center = [0, 100, 0], size = [10, 10, 10] }
"""


def scene_of(count: int) -> wi.Scene:
    return wi.Scene.from_text(SCENE.replace("count = 1000", f"count = {count}"), "benchmark")


def rate(count: int, device: str, threads: int | None, seconds: float) -> dict[str, Any]:
    """Substeps per second in free fall with noise: median and best over blocks of frames."""
    ensemble = ensemble_of(plan(scene_of(count)), device, threads)
    block = max(1, 20_000 // count)
    frames = ensemble.frames(10**9)
    for _ in range(25):
        last = next(frames)
    rates, begin = [], time.perf_counter()
    while time.perf_counter() - begin < seconds or len(rates) < 5:
        start, before = time.perf_counter(), last.body_steps
        for _ in range(block):
            last = next(frames)
        rates.append((last.body_steps - before) / (time.perf_counter() - start))
    frames.close()
    ensemble.close()
    return {
        "what": "simulate",
        "bodies": count,
        "device": device,
        "threads": threads,
        "substeps_per_s": round(float(np.median(rates))),
        "best_substeps_per_s": round(max(rates)),
        "bytes_per_body": ensemble.bytes_per_body,
    }


def writing(count: int, frames: int) -> dict[str, Any]:
    """Time to write a USD file, against that of writing as many bytes to the same disk."""
    from warp_immersed.usd import UsdWriter

    planned = plan(scene_of(count))
    ensemble = ensemble_of(planned, "cpu")
    states = [replace(frame, **{name: getattr(frame, name).copy() for name in DATASETS}) for frame in ensemble.frames(24)]
    ensemble.close()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "crowd.usdc"
        usd, floor = [], []
        for _ in range(3):
            start = time.perf_counter()
            writer = UsdWriter(path, planned.prototypes, 24.0, manifest_of(planned, choose_device("cpu")))
            for frame in range(frames):
                writer.write(states[frame % 24])
            writer.finish()
            with open(path, "rb+") as file:
                os.fsync(file.fileno())
            usd.append(time.perf_counter() - start)
            size = path.stat().st_size
            block = np.random.default_rng(0).bytes(1 << 22)
            start = time.perf_counter()
            with open(Path(folder) / "floor", "wb") as file:
                for _ in range(size >> 22):
                    file.write(block)
                file.write(block[: size & ((1 << 22) - 1)])
                file.flush()
                os.fsync(file.fileno())
            floor.append(time.perf_counter() - start)
    return {
        "what": "usd", "bodies": count, "frames": frames, "bytes": size, "seconds": round(min(usd), 3),
        "disk_floor_seconds": round(min(floor), 3), "ratio": round(min(usd) / min(floor), 2),
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="a minute instead of several")
    quick = parser.parse_args().quick
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    seconds = 1.0 if quick else 5.0

    def show(row: dict[str, Any]) -> None:
        print(json.dumps(row), flush=True)

    show({
        "what": "machine", "processor": platform.processor() or platform.machine(), "cores": available_threads(),
        "python": platform.python_version(), "warp": wp.__version__, "devices": [d.name for d in wp.get_devices()],
    })  # fmt: skip
    for count in (1, 100, 1000, 10_000) if quick else (1, 100, 1000, 10_000, 100_000):
        show(rate(count, "cpu", 1, seconds))
    for count in (1000, 10_000) if quick else (1000, 10_000, 100_000):
        show(rate(count, "cpu", available_threads(), seconds))
    if wp.is_cuda_available():
        for count in (1000, 10_000, 100_000, 1_000_000):
            show(rate(count, "cuda:0", None, seconds))
    show(writing(1000, 240))
    show(writing(10_000, 240))


if __name__ == "__main__":
    main()
