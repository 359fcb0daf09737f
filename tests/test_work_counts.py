"""A guard on speed that is no timer: launches, allocations, substeps and the size of the generated code."""

import re
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from tests.bodies import model_in, random_orientations, started
from warp_immersed import library
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.ensemble import KERNELS, Ensemble
from warp_immersed.fluid import AIR
from warp_immersed.turbulence import HomogeneousTurbulence

ALLOCATORS = ("zeros", "empty", "full", "ones", "clone", "zeros_like", "empty_like", "from_numpy")
GUSTY = Surroundings(AIR, turbulence=HomogeneousTurbulence(0.05, 0.02))


def leaves(count: int = 600) -> Group:
    start = started(orientations=random_orientations(count, 1), positions=(0.0, 100.0, 0.0), count=count)
    return Group(model_in(library.maple_leaf(), AIR), start, 1)


@pytest.mark.parametrize("threads", [1, 2])
def test_a_frame_is_one_launch_a_slice_and_allocates_nothing(monkeypatch: pytest.MonkeyPatch, threads: int) -> None:
    ensemble = Ensemble([leaves()], GUSTY, fps=24.0, threads=threads)
    list(ensemble.frames(2))  # to the end, so that nothing runs while the counting begins
    launches, allocations, recorded = [], [], []
    launch, made = wp.Launch.launch, wp.array.__init__

    def counted(self, *args, **kwargs):
        launches.append(self.kernel.key)
        return launch(self, *args, **kwargs)

    def allocated(self, data=None, *args, **kwargs):
        allocations.append(data) if data is not None or kwargs.get("ptr") is None else None
        return made(self, data, *args, **kwargs)

    monkeypatch.setattr(wp.Launch, "launch", counted)
    monkeypatch.setattr(wp.array, "__init__", allocated)
    monkeypatch.setattr(wp, "launch", lambda *args, **kwargs: recorded.append(args))
    for name in ALLOCATORS:
        monkeypatch.setattr(wp, name, lambda *args, name=name, **kwargs: allocations.append(name))
    slices = 1 if threads == 1 else 3  # of 256 bodies at least
    assert sum(1 for _ in ensemble.frames(10)) == 10
    monkeypatch.undo()
    ensemble.close()
    assert len(launches) == 10 * slices, "one frame kernel a slice, nothing else"
    assert not recorded, "no launch is set up in Python after the first frame"
    assert not allocations


def test_the_work_of_a_leaf_is_what_it_was() -> None:
    """Substeps a falling leaf takes in a frame at 24 fps: a stricter rule or stiffer law shows here, on any machine."""
    ensemble = Ensemble([leaves()], Surroundings(AIR), fps=24.0, threads=1)
    steps = [frame.body_steps for frame in ensemble.frames(49)]
    ensemble.close()
    assert (steps[48] - steps[24]) / (24 * 600) == pytest.approx(5.0, abs=1.0)


def test_generated_code_stays_small() -> None:
    """Lines of C++ of the frame kernels: compile time, instruction cache and registers grow with them."""
    ensemble = Ensemble([leaves(1)], GUSTY, fps=24.0, threads=1)
    list(ensemble.frames(2))
    ensemble.close()
    folder = Path(wp.config.kernel_cache_dir)
    identifier = KERNELS["quasi_steady"].module.get_module_identifier()
    sources = list(folder.glob(f"{identifier.rsplit('_', 1)[0]}*/*.cpp"))
    newest = max(sources, key=lambda path: path.stat().st_mtime).read_text(encoding="utf-8")
    assert "adj_" not in re.sub(r"//.*", "", newest.split("kernel_forward")[-1]), "no adjoint code"
    assert newest.count("\n") < 20_000


def test_memory_of_a_body_does_not_grow() -> None:
    ensemble = Ensemble([leaves(10)], GUSTY, fps=24.0)
    assert ensemble.bytes_per_body <= 256
    ensemble.close()
    assert np.isfinite(ensemble.bytes_per_body)
