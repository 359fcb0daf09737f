"""Sorting falls into regimes, on motions known in advance; the map and its table."""

import csv

import numpy as np
import pytest

from warp_immersed import library
from warp_immersed.added_mass import kirchhoff_tensor
from warp_immersed.body_model import body_model
from warp_immersed.charts import falls, regimes
from warp_immersed.charts.falls import CHAOTIC, GLIDING, PERIODIC, STEADY, TUMBLING, classify, disk_drag, model_at, simulate_falls
from warp_immersed.errors import InputError
from warp_immersed.fluid import AIR
from warp_immersed.force_law import CALIBRATED_PLATE

TIME = np.arange(480) / 8.0


def swung(tilt: np.ndarray) -> np.ndarray:
    """Normals (F, 1, 3) of a body that turns about one horizontal axis."""
    return np.stack([np.sin(tilt), np.cos(tilt), np.zeros_like(tilt)], axis=1)[:, None, :]


def test_known_motions_are_sorted() -> None:
    assert classify(swung(np.radians(2.0) * np.sin(TIME)))[0] == STEADY
    assert classify(swung(np.full_like(TIME, 0.5)))[0] == GLIDING
    assert classify(swung(1.2 * np.sin(TIME)))[0] == PERIODIC
    precession = np.stack([0.5 * np.sin(TIME), np.full_like(TIME, np.sqrt(0.75)), 0.5 * np.cos(TIME)], axis=1)
    assert classify(precession[:, None, :])[0] == PERIODIC
    assert classify(swung(2.0 * TIME + 0.5 * np.sin(2.0 * TIME)))[0] == TUMBLING
    assert classify(swung(-2.0 * TIME))[0] == TUMBLING
    # turns over, but back and forth
    assert classify(swung(4.0 * np.sin(0.5 * TIME)))[0] == CHAOTIC
    assert classify(swung(np.where(TIME < 40.0, 0.5 * np.sin(TIME), 0.5 * np.sin(TIME) + np.pi)))[0] == CHAOTIC


def test_a_tumbling_body_may_change_its_heading() -> None:
    turn, heading = 2.0 * TIME, 0.05 * TIME
    normals = np.stack([np.sin(turn) * np.cos(heading), np.cos(turn), np.sin(turn) * np.sin(heading)], axis=1)
    assert classify(normals[:, None, :])[0] == TUMBLING


def test_a_point_of_the_plane_has_its_numbers() -> None:
    """I* = pi rho_s t / (64 rho D), and the nominal speed is one diameter a second."""
    shape = library.disk(0.5, 1e-3, 900.0)
    tensor = kirchhoff_tensor(shape, AIR) / AIR.density
    base = body_model(shape, AIR, AIR.density * tensor, 1.0)
    model = model_at(base, shape, tensor, 400.0, 0.02, 1.0, CALIBRATED_PLATE)
    density = np.pi * 900.0 * 1e-3 / (64.0 * 0.02 * 0.5)
    # broadside added mass 8 rho a^3 / 3
    assert model.inertia[2, 2] - 1.0 == pytest.approx(8.0 / 3.0 * density * 0.25**3 / shape.mass, rel=2e-3)
    weight = model.net_weight * shape.mass
    assert weight == pytest.approx(0.5 * density * np.pi * 0.25**2 * 0.5**2 * float(disk_drag(400.0)), rel=2e-3)


def test_shapes_fall_alike_whatever_their_size() -> None:
    """Only Re, I* and the thickness ratio count."""
    small, large = (
        simulate_falls(library.disk(d, 1e-3 * d, 1000.0), 60.0, 0.01, tilts=(20.0,), window=10.0)[0].descent for d in (0.01, 1.0)
    )
    assert small == pytest.approx(large, rel=1e-3)


def test_a_shape_that_would_float_is_refused() -> None:
    with pytest.raises(InputError, match="would float"):
        simulate_falls(library.disk(0.1, 0.02, 1000.0), 100.0, 0.001)


def test_map_and_table_are_written(tmp_path, monkeypatch) -> None:
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(falls, "SETTLING", 5.0)
    points = tmp_path / "points.csv"
    points.write_text("Re,Istar,class\n40,0.006,steady\n200,0.006,periodic\n")
    conclusion = regimes.chart_regimes(tmp_path / "map.png", points, "rectangular_paper", count=3)
    assert conclusion.startswith("3 x 3 points")
    assert "2 measured points" in conclusion
    assert (tmp_path / "map.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "map.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 9
    assert {row["class"] for row in rows} <= set(falls.REGIMES)
    assert all(sum(int(row[f"releases_{name}"]) for name in falls.REGIMES) == len(falls.TILTS) for row in rows)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("Re,Istar,class\n10,0.1,sideways\n", "line 2.*one of steady"),
        ("Re,Istar\n10,0.1\n", "line 2"),
        ("Re,Istar,class\n-10,0.1,steady\n", "must be positive"),
        ("Re,Istar,class\n", "holds no points"),
    ],
)
def test_bad_points_are_named(tmp_path, text, message) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=message):
        regimes.read_points(path)
    with pytest.raises(InputError, match="cannot be read"):
        regimes.read_points(tmp_path / "none.csv")


def test_unknown_shapes_are_named() -> None:
    with pytest.raises(InputError, match="found 'brick', must be one of"):
        regimes.named_shape("brick")
    with pytest.raises(InputError, match="no defaults"):
        regimes.named_shape("sheet")
