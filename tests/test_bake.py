import h5py
import numpy as np
import pytest

from warp_immersed.bake import bake, cached_bake, plan_bake
from warp_immersed.errors import InputError
from warp_immersed.field_scene import FieldScene
from warp_immersed.turbulence_grid import TurbulenceGrid

FIELD = """
[domain]
lower = [-4.0, 0.0, 0.0]
upper = [8.0, 4.0, 0.25]
cells = [48, 16, 1]
[boundary]
x_min = { kind = "inlet", velocity = [2.0, 0.0, 0.0], intensity = 0.1, length_scale = 0.3 }
x_max = { kind = "outlet" }
y_min = { kind = "wall" }
y_max = { kind = "slip" }
[[obstacle]]
box = [[0, 0, 0], [1, 1, 1]]
"""


@pytest.fixture
def field(tmp_path):
    path = tmp_path / "field.toml"
    path.write_text(FIELD)
    return path


def test_a_bake_is_a_file_that_bodies_can_sample(field, tmp_path):
    seen = []
    report = bake(field, tmp_path / "field.h5", threads=1, progress=seen.append)
    assert report.convergence.converged
    assert seen == list(report.convergence.history)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["field.h5", "field.toml"]
    grid = TurbulenceGrid.load(report.path)
    assert grid.cells == (48, 16, 1)
    assert grid.scene == FIELD
    assert grid.provenance["converged"] is True
    assert grid.history.shape == (len(seen), 5)
    assert not grid.fluid[18, 2, 0]
    assert (grid.k[grid.fluid] > 0.0).all()
    velocity, k, _ = grid.sample([[1.2, 0.3, 0.0], [0.5, 3.0, 0.0], [-90.0, 1.0, 0.0]])
    assert velocity[0, 0] < 0.0  # turns back in the lee
    assert velocity[1, 0] > 2.0  # speeds up above
    np.testing.assert_allclose(velocity[2], [2.0, 0.0, 0.0], rtol=1e-6)
    assert k[2] == pytest.approx(0.06)


def test_an_interrupted_bake_goes_on_to_the_same_file(field, tmp_path):
    whole = bake(field, tmp_path / "whole.h5", threads=1)

    def interrupt(now):
        if now.step >= 40:
            raise KeyboardInterrupt

    part = tmp_path / "part.h5"
    with pytest.raises(KeyboardInterrupt):
        bake(field, part, threads=1, progress=interrupt)
    assert not part.exists()
    assert (tmp_path / "part.h5.checkpoint.npz").exists()
    steps = []
    resumed = bake(field, part, resume=True, threads=1, progress=lambda now: steps.append(now.step))
    assert steps[0] == 50
    assert resumed.steps == whole.steps
    np.testing.assert_array_equal(TurbulenceGrid.load(part).velocity, TurbulenceGrid.load(whole.path).velocity)
    assert not (tmp_path / "part.h5.checkpoint.npz").exists()


def test_a_checkpoint_of_another_field_is_refused(field, tmp_path):
    def interrupt(now):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        bake(field, tmp_path / "out.h5", threads=1, progress=interrupt)
    field.write_text(FIELD.replace("2.0, 0.0, 0.0]", "3.0, 0.0, 0.0]"))
    with pytest.raises(InputError, match="another field"):
        bake(field, tmp_path / "out.h5", resume=True, threads=1)
    (tmp_path / "out.h5.checkpoint.npz").write_bytes(b"torn")
    with pytest.raises(InputError, match="cannot be read"):
        bake(field, tmp_path / "out.h5", resume=True, threads=1)


def test_a_flow_in_time_is_baked_as_snapshots(field, tmp_path):
    field.write_text(FIELD + "[unsteady]\nduration = 0.5\ninterval = 0.25\ngust = { amplitude = 0.3, period = 1.0 }\n")
    times = []
    report = bake(field, tmp_path / "gust.h5", threads=1, time_progress=times.append)
    assert times == pytest.approx([0.25, 0.5])
    grid = TurbulenceGrid.load(report.path)
    assert grid.velocity.shape == (3, 48, 16, 1, 3)
    early, late = (grid.sample([[-3.5, 2.0, 0.0]], time)[0][0, 0] for time in (0.0, 0.25))
    assert late > 1.2 * early
    with h5py.File(report.path) as file:
        assert file["time"].attrs["units"] == "s"


def test_too_many_cells_are_refused_before_they_are_allocated():
    scene = FieldScene.parse(FIELD.replace("cells = [48, 16, 1]", "cells = [40000, 40000, 40]"), name="big.toml")
    with pytest.raises(InputError, match=r"big\.toml: domain: .* GB free; use a coarser spacing"):
        plan_bake(scene)
    assert plan_bake(FieldScene.parse(FIELD)).memory < 1e6


def test_a_missing_folder_is_an_input_error(field, tmp_path):
    with pytest.raises(InputError, match="does not exist"):
        bake(field, tmp_path / "none" / "out.h5")


def test_a_cached_field_is_baked_once(tmp_path):
    seen = []
    scene = FieldScene.parse(FIELD)
    first = cached_bake(scene, tmp_path / "cache", threads=1, progress=seen.append)
    count = len(seen)
    assert count > 0
    assert cached_bake(scene, tmp_path / "cache", threads=1, progress=seen.append) == first
    assert len(seen) == count
    other = FieldScene.parse(FIELD.replace("[1, 1, 1]", "[1, 2, 1]"))
    assert cached_bake(other, tmp_path / "cache", threads=1) != first
