"""A fixed sequence of kernel launches, recorded once and replayed: a graph on CUDA, slabs over threads on the CPU."""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import warp as wp

FIRST_PLANE = object()
"""Stands in a launch's inputs for the first plane of the slab that the launch covers."""

SLAB_CELLS = 4096  # a launch smaller than this is not worth handing to another thread


class LaunchPlan:
    """Kernel launches that always run in the same order.

    Every kernel of a plan writes a cell from its neighbours only, so a launch may be cut into slabs of planes of constant
    x without changing a bit of the result. Warp runs a CPU launch on the thread that makes it and lets go of Python's
    lock meanwhile, so slabs run on several cores.

    Args:
        device: Warp device.
        threads: CPU threads; None for all cores. Ignored on CUDA.
    """

    def __init__(self, device: wp.Device, threads: int | None = None) -> None:
        self.device = device
        self.threads = 1 if device.is_cuda else max(1, threads or os.cpu_count() or 1)
        self.pool = ThreadPoolExecutor(self.threads - 1) if self.threads > 1 else None
        self.steps: list[list[Any]] = []
        self.graph: Any = None

    def add(self, kernel: Any, dim: Sequence[int], inputs: Sequence[Any]) -> None:
        """Append a launch over `dim` (planes, ...); `inputs` holds FIRST_PLANE where the kernel takes it."""
        planes, *rest = dim
        size = planes
        for n in rest:
            size *= n
        slabs = max(1, min(self.threads, size // SLAB_CELLS, planes))
        bounds = [planes * s // slabs for s in range(slabs + 1)]
        slices = []
        for first, last in pairwise(bounds):
            given = [first if value is FIRST_PLANE else value for value in inputs]
            slices.append(wp.launch(kernel, (last - first, *rest), given, device=self.device, record_cmd=True))
        self.steps.append(slices)

    def run(self) -> None:
        """Run every launch once, in order."""
        if self.device.is_cuda:
            if self.graph is None:
                with wp.ScopedCapture(device=self.device) as capture:
                    self.run_each()
                self.graph = capture.graph
            wp.capture_launch(self.graph)
        else:
            self.run_each()

    def run_each(self) -> None:
        """Run every launch once without a graph."""
        for slices in self.steps:
            if self.pool is None or len(slices) == 1:
                for command in slices:
                    command.launch()
                continue
            others = [self.pool.submit(command.launch) for command in slices[1:]]
            slices[0].launch()
            for other in others:
                other.result()
