"""The body kernels on a CUDA device: throughput, graphs, substeps a launch, and where they stand under the roofline.

Registers and spills come from the code that NVRTC makes for an H100, with or without a device; the rest needs one. The part that
needs a device has not been run: no machine with one was at hand.
"""

import struct
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import warp as wp

from benchmarks.measurement import Row, frames_done, rates, thin_ellipsoids
from warp_immersed.ensemble import KERNELS

# Of one H100 SXM: memory [B/s] and single precision [flop/s].
MEMORY, FLOPS = 3.35e12, 6.7e13
# Counted on the source: four evaluations of the right-hand side and their sums.
FLOP_PER_SUBSTEP = 1200.0


def rows(quick: bool) -> Iterator[Row]:
    """Resources of the kernels; then N = 1e3 ... 1e7 with graphs, 1e5 without, and 1 to 64 substeps a launch."""
    yield from resources()
    if not wp.is_cuda_available():
        yield {"what": "cuda", "skipped": "no CUDA device on this machine: throughput, graphs and roofline were not measured"}
        return
    for count in (10**3, 10**4, 10**5, 10**6) if quick else (10**3, 10**4, 10**5, 10**6, 10**7):
        yield {"what": "cuda", "bodies": count, "fps": 24.0, "graph": True, **device_rate(count, 24.0)}
    for fps in (1536.0, 384.0, 96.0, 24.0):  # 1 substep a launch and more
        yield {"what": "cuda substeps a launch", "bodies": 10**5, "fps": fps, **device_rate(10**5, fps)}
    yield {"what": "cuda", "bodies": 10**5, "fps": 24.0, "graph": False, **without_graph(10**5, 24.0)}


def device_rate(count: int, fps: float) -> Row:
    """Substeps per second with the frames' copies to the host, and the shares of the device's peaks they come to."""
    ensemble = thin_ellipsoids(count, fps, "cuda:0", None)
    found = rates(frames_done(ensemble, 20), 2.0)
    memory = ensemble.bytes_per_body
    ensemble.close()
    return {
        "substeps_per_s": found["per_s"],
        "share_of_flops": round(found["per_s"] * FLOP_PER_SUBSTEP / FLOPS, 4),
        "bytes_per_body": memory,
        "share_of_memory_at_one_substep_a_frame": round(found["per_s"] * memory / MEMORY, 4),
    }


def without_graph(count: int, fps: float, frames: int = 50) -> Row:
    """The same launches from Python, one by one."""
    ensemble = thin_ellipsoids(count, fps, "cuda:0", None)
    frames_done(ensemble, 4)
    launches = ensemble._launch(0, count, ensemble._state.outputs[0], True)
    wp.synchronize_device("cuda:0")
    start = time.perf_counter()
    for _ in range(frames):
        for launch in launches:
            launch.launch()
    wp.synchronize_device("cuda:0")
    seconds = (time.perf_counter() - start) / frames
    ensemble.close()
    return {"seconds_a_frame": seconds}


def resources(architecture: int = 90) -> Iterator[Row]:
    """Registers a thread, and bytes of stack (spills and local arrays) of each kernel, read off the compiled code."""
    thin_ellipsoids(1, 24.0).close()  # makes the overload of the generic kernel
    with tempfile.TemporaryDirectory() as folder:
        try:
            wp.compile_aot_module(KERNELS["quasi_steady"].module, arch=architecture, module_dir=folder, use_ptx=False)
        except Exception as error:  # Warp raises several kinds where it was built without NVRTC
            yield {"what": "cuda resources", "skipped": f"this Warp cannot compile for CUDA: {error}"}
            return
        for path in sorted(Path(folder).glob("*.cubin")):
            for kernel, numbers in kernel_resources(path.read_bytes()).items():
                yield {"what": "cuda resources", "kernel": kernel, "architecture": f"sm_{architecture}", **numbers}


def kernel_resources(cubin: bytes) -> dict[str, Row]:
    """Registers and stack of each kernel of a cubin: an ELF file whose .nv.info section holds them by attribute, 0x2f
    (registers) and 0x11 (frame size), each with a symbol and a value."""
    offset, count, names_at = struct.unpack_from("<Q", cubin, 0x28)[0], *struct.unpack_from("<HH", cubin, 0x3C)
    headers = [struct.unpack_from("<IIQQQQIIQQ", cubin, offset + 64 * n) for n in range(count)]

    def text(section: int, at: int) -> str:
        start = headers[section][4] + at
        return cubin[start : cubin.index(b"\0", start)].decode()

    symbols, info = [], b""
    for name, kind, _, _, at, size, link, *_ in headers:
        if kind == 2:  # symbol table
            symbols = [text(link, struct.unpack_from("<I", cubin, at + 24 * n)[0]) for n in range(size // 24)]
        if text(names_at, name) == ".nv.info":
            info = cubin[at : at + size]
    found: dict[str, Row] = {}
    at = 0
    while at + 4 <= len(info):
        form, attribute, size = struct.unpack_from("<BBH", info, at)
        at += 4
        if form != 4:  # the value stands in place of the size
            continue
        if attribute in (0x2F, 0x11) and size == 8:
            symbol, value = struct.unpack_from("<II", info, at)
            if "kernel_forward" in symbols[symbol]:
                found.setdefault(symbols[symbol], {})["registers" if attribute == 0x2F else "stack_bytes"] = value
        at += size
    return found
