import numpy as np
import pytest

from warp_immersed.charts import field, turbulence_sources
from warp_immersed.charts.field import slice_indices
from warp_immersed.charts.figures import Request
from warp_immersed.charts.turbulence_sources import exact, explicit, patankar, relative_error
from warp_immersed.errors import InputError
from warp_immersed.turbulence_grid import TurbulenceGrid

pytest.importorskip("matplotlib")


def make_grid(cells, solid=None):
    shape = (*cells, 3)
    fluid = np.ones(cells, dtype=bool)
    if solid is not None:
        fluid[solid] = False
    velocity = np.zeros(shape, dtype=np.float32)
    velocity[..., 0] = 1.0 + np.arange(cells[1])[:, None]
    values = np.full(cells, 0.1, dtype=np.float32)
    velocity[~fluid], values[~fluid] = 0.0, 0.0
    return TurbulenceGrid((0, 0, 0), (0.5, 0.5, 0.5), velocity, values, values, fluid)


@pytest.mark.parametrize("cells", [(16, 8, 1), (16, 8, 6)])
def test_a_bake_becomes_a_picture(cells, tmp_path):
    make_grid(cells, np.s_[4:6, :3, :2]).save(tmp_path / "field.h5")
    picture = tmp_path / "field.png"
    assert "reaches 8 m/s" in field.chart(Request(picture, source=tmp_path / "field.h5"))
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_slices_pass_through_the_obstacle():
    assert slice_indices(make_grid((16, 8, 9), np.s_[4:6, 0:5, 3:6])) == (2, 4)
    assert slice_indices(make_grid((16, 8, 9), np.s_[4:6, 0:5, 0:3]))[1] == 0


def test_a_picture_that_cannot_be_written_is_an_input_error(tmp_path):
    make_grid((16, 8, 1)).save(tmp_path / "field.h5")
    with pytest.raises(InputError, match="cannot be written"):
        field.chart(Request(tmp_path / "none" / "field.png", source=tmp_path / "field.h5"))


def test_only_the_explicit_sources_leave_positive_numbers():
    assert relative_error(explicit, 0.01) < 0.02
    assert relative_error(explicit, 1.0) == float("inf")
    assert np.isfinite(relative_error(patankar, 10.0))
    assert relative_error(exact, 10.0) < 1e-12


def test_the_sources_become_a_picture(tmp_path):
    turbulence_sources.chart(Request(tmp_path / "sources.png"))
    assert (tmp_path / "sources.png").read_bytes().startswith(b"\x89PNG")
    assert len((tmp_path / "sources.csv").read_text().splitlines()) == 1 + 3 * 25
