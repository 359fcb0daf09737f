"""A fixed sequence of kernel launches, recorded once and replayed: a graph on CUDA, slabs over threads on the CPU."""

import os
import threading
import weakref
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import warp as wp

FIRST_PLANE = object()
"""Stands in a launch's inputs for the first plane of the slab that the launch covers."""

SLAB_CELLS = 4096  # a launch smaller than twice this is not worth handing to another thread


class Workers:
    """Threads that each run one task at a time; handing over by bare locks, since a step has a hundred short launches.

    Args:
        count: tasks that can run at once, the caller's own included.
    """

    def __init__(self, count: int) -> None:
        self.count = count
        self.tasks: list[Callable[[], None] | None] = [None] * (count - 1)
        self.go = [threading.Lock() for _ in self.tasks]
        self.done = [threading.Lock() for _ in self.tasks]
        for n in range(count - 1):
            self.go[n].acquire()
            self.done[n].acquire()
            threading.Thread(target=serve, args=(self.tasks, n, self.go[n], self.done[n]), daemon=True).start()
        weakref.finalize(self, dismiss, self.tasks, self.go)

    def run(self, tasks: Sequence[Callable[[], None]]) -> None:
        """Run tasks side by side, the first on the calling thread, and wait for all."""
        for n, task in enumerate(tasks[1:]):
            self.tasks[n] = task
            self.go[n].release()
        tasks[0]()
        for n in range(len(tasks) - 1):
            self.done[n].acquire()


def serve(tasks: list[Callable[[], None] | None], n: int, go: threading.Lock, done: threading.Lock) -> None:
    """What worker n does until it is handed no task."""
    while True:
        go.acquire()
        task = tasks[n]
        if task is None:
            return
        task()
        done.release()


def dismiss(tasks: list[Callable[[], None] | None], go: list[threading.Lock]) -> None:
    """Let the workers end."""
    for n, lock in enumerate(go):
        tasks[n] = None
        lock.release()


class LaunchPlan:
    """Kernel launches that always run in the same order.

    Every kernel of a plan writes a cell from its neighbours only, so a launch may be cut into slabs of planes of constant
    x without changing a bit of the result. Warp runs a CPU launch on the thread that makes it and lets go of Python's
    lock meanwhile, so slabs run on several cores.

    Args:
        device: Warp device.
        workers: CPU threads to use; None for the calling one alone. Ignored on CUDA.
    """

    def __init__(self, device: wp.Device, workers: Workers | None = None) -> None:
        self.device = device
        self.workers = None if device.is_cuda else workers
        self.steps: list[list[Callable[[], None]]] = []
        self.graph: Any = None

    def add(self, kernel: Any, dim: Sequence[int], inputs: Sequence[Any]) -> None:
        """Append a launch over `dim` (planes, ...); `inputs` holds FIRST_PLANE where the kernel takes it."""
        planes, *rest = dim
        size = planes
        for n in rest:
            size *= n
        slabs = 1 if self.workers is None else max(1, min(self.workers.count, size // SLAB_CELLS, planes))
        bounds = [planes * s // slabs for s in range(slabs + 1)]
        slices = []
        for first, last in pairwise(bounds):
            given = [first if value is FIRST_PLANE else value for value in inputs]
            slices.append(wp.launch(kernel, (last - first, *rest), given, device=self.device, record_cmd=True).launch)
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
            if self.workers is None or len(slices) == 1:
                for launch in slices:
                    launch()
            else:
                self.workers.run(slices)


def make_workers(device: wp.Device, threads: int | None) -> Workers | None:
    """Workers for a device: `threads` on the CPU (None: one a core), none on CUDA."""
    count = 1 if device.is_cuda else max(1, threads or os.cpu_count() or 1)
    return Workers(count) if count > 1 else None
