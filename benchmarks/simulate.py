"""Body-steps per second of the frame kernels: one core, all cores; memory a body takes."""

from collections.abc import Iterator

from benchmarks.measurement import Row, frames_done, rates, thin_ellipsoids
from warp_immersed.frame_stepper import available_threads


def rows(quick: bool) -> Iterator[Row]:
    """Thin ellipsoids in gusts at 24 fps: substeps per CPU second and per second."""
    counts = (1, 100, 1000, 10_000, 100_000) if quick else (1, 10, 100, 1000, 10_000, 100_000, 1_000_000)
    for threads in (1, available_threads()):
        for count in counts:
            if threads > 1 and count < 1000:
                continue
            ensemble = thin_ellipsoids(count, 24.0, threads=threads)
            found = rates(frames_done(ensemble, max(3, 10_000 // count)), 1.0 if quick else 4.0)
            memory = ensemble.bytes_per_body
            ensemble.close()
            yield {"what": "simulate", "bodies": count, "threads": threads, **found, "bytes_per_body": memory}
