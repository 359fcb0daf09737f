"""How one frame is launched: slices over a thread pool on the CPU, a captured graph on CUDA.

Both steppers keep two sets of output buffers, so that one frame can be written while the next is computed.
"""

import os
from collections.abc import Callable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import warp as wp

from warp_immersed.kernels.integrate import advance_clock

# Bodies a slice holds at least, for every launch has its price in Python; slices a thread gets on average, so that uneven work
# evens out.
SMALLEST_SLICE = 256
SLICES_PER_THREAD = 4

Outputs = Mapping[str, wp.array]
# Launches (or records) the frame kernels for bodies first ... first + count - 1 into one set of outputs.
LaunchFrame = Callable[[int, int, Outputs, bool], list[Any]]


def available_threads() -> int:
    """Processor cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def run_all(launches: list[Any]) -> None:
    """Run recorded launches one after the other."""
    for launch in launches:
        launch.launch()


class CpuStepper:
    """Steps frames on the CPU; a Warp launch runs on the thread that calls it, without Python's lock."""

    def __init__(self, bodies: int, threads: int, clock: wp.array, outputs: tuple[Outputs, Outputs], launch: LaunchFrame):
        slices = 1 if threads == 1 else threads * SLICES_PER_THREAD
        size = max(SMALLEST_SLICE, -(-bodies // slices))
        starts = range(0, bodies, size)
        # Recording loads the kernels, here and serially: first loads must not race.
        self._launches = [[launch(first, min(size, bodies - first), out, True) for first in starts] for out in outputs]
        self._outputs = outputs
        self._clock = clock.numpy()  # a view of the device array
        self._pool = ThreadPoolExecutor(min(threads, len(starts)), thread_name_prefix="bodies")
        self._running: list[Future[None]] = []
        self._frame = 0

    def start(self, frame: int) -> None:
        """Begin to compute frame number `frame`, once the one before it is complete."""
        self._finish()
        self._clock[0] = frame - 1
        self._running = [self._pool.submit(run_all, launches) for launches in self._launches[frame % 2]]
        self._frame = frame

    def wait(self, frame: int) -> Outputs:
        """Outputs of a started frame, valid until the frame after the next is started."""
        if frame == self._frame:
            self._finish()
        return self._outputs[frame % 2]

    def _finish(self) -> None:
        for future in self._running:
            future.result()

    def close(self) -> None:
        """Let the threads go."""
        self._pool.shutdown(wait=True)


class CudaStepper:
    """Steps frames on a CUDA device: one graph launch a frame, and a copy to the host that overlaps the next frame."""

    def __init__(self, bodies: int, device: wp.Device, clock: wp.array, outputs: tuple[Outputs, Outputs], launch: LaunchFrame):
        self._device = device
        self._outputs = outputs
        self._host: list[dict[str, wp.array]] = [
            {name: wp.empty(a.shape, dtype=a.dtype, device="cpu", pinned=True) for name, a in out.items()} for out in outputs
        ]
        self._copy_stream = wp.Stream(device)
        self._copied = [wp.Event(device), wp.Event(device)]
        self._graphs = []
        launch(0, bodies, outputs[0], True)  # recorded only: it compiles and loads the modules before capture
        for out in outputs:
            with wp.ScopedCapture(device) as capture:
                launch(0, bodies, out, False)
                wp.launch(advance_clock, dim=1, inputs=[clock], device=device)
            self._graphs.append(capture.graph)
        for event in self._copied:
            device.stream.record_event(event)

    def start(self, frame: int) -> None:
        """Queue frame number `frame` and its copy to the host; returns at once."""
        side = frame % 2
        stream = self._device.stream
        stream.wait_event(self._copied[side])
        wp.capture_launch(self._graphs[side], stream=stream)
        self._copy_stream.wait_event(stream.record_event())
        for name, array in self._outputs[side].items():
            wp.copy(self._host[side][name], array, stream=self._copy_stream)
        self._copy_stream.record_event(self._copied[side])

    def wait(self, frame: int) -> Outputs:
        """Host copies of a started frame's outputs, valid until the frame after the next is started."""
        wp.synchronize_event(self._copied[frame % 2])
        return self._host[frame % 2]

    def close(self) -> None:
        """Wait for what is queued."""
        wp.synchronize_device(self._device)
