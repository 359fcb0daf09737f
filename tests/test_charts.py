"""What the documentation says of the charts, checked on the tables behind them: small ones here, the quick ones under --slow."""

import csv

import numpy as np
import pytest

from tests.bodies import model_in
from warp_immersed import library
from warp_immersed.charts import added_mass, fidelity, slides, stability, stability_figure, turbulence, work_precision
from warp_immersed.charts.baselines import variance_ratio
from warp_immersed.charts.bodies import test_bodies as bodies_to_compare
from warp_immersed.charts.body_rates import BodyRates, Q, dop853, rotate, started
from warp_immersed.charts.figures import Request, save_figure
from warp_immersed.charts.integrators import INTEGRATORS
from warp_immersed.fluid import AIR

pytest.importorskip("matplotlib")

FILM = 1e3 / 24.0


def silent(what: str, fraction: float) -> None:
    """No report."""


def published(module, rows, monkeypatch, tmp_path) -> list[dict[str, str]]:
    """The table a chart writes beside its picture, from rows measured before."""
    monkeypatch.setattr(module, "measure", lambda *args: rows)
    conclusion = module.chart(Request(tmp_path / "chart.png", quick=True))
    assert conclusion.endswith(".")
    assert "\n" not in conclusion
    assert (tmp_path / "chart.png").read_bytes().startswith(b"\x89PNG")
    with (tmp_path / "chart.csv").open(encoding="utf-8") as file:
        found = list(csv.DictReader(file))
    assert len(found) == len(rows)
    return found


ORDERS = {"explicit Euler": 1, "semi-implicit Euler": 1, "RK2": 2, "RK4, fixed step": 4, "Strang splitting": 2}


@pytest.mark.parametrize(("name", "order"), ORDERS.items())
def test_baseline_integrators_have_their_order(name: str, order: int) -> None:
    body = next(body for body in bodies_to_compare() if "1:2:4 cm in water" in body.name)
    rates = BodyRates([body.model], np.zeros(4, dtype=np.int64))
    start = rates.state(started(4, 2, (3.0, 5.0, 2.0)))
    exact = dop853(rates, start, np.array([0.2]), 1e-12)[0][0]
    step, errors = INTEGRATORS[name][0], []
    for count in (12, 24) if order == 4 else (40, 80):
        y = start
        for _ in range(count):
            y = step(rates, y, 0.2 / count)
        errors.append(np.linalg.norm(y - exact))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.35)


def test_noise_by_euler_maruyama_is_as_wrong_as_theory_says() -> None:
    """Variance over the exact one: 2 x / (1 - (1 - x)^2) at a step x."""
    for step in (0.1, 0.5, 1.0):
        assert variance_ratio("Euler-Maruyama", step) == pytest.approx(2.0 * step / (1.0 - (1.0 - step) ** 2), rel=0.05)
    assert variance_ratio("Euler-Maruyama", 2.1) == float("inf")
    assert variance_ratio("RK4, noise after", 0.5) == pytest.approx(1.583, rel=0.05)


@pytest.fixture(scope="module")
def precision() -> list[dict]:
    bodies = bodies_to_compare()
    return work_precision.measure_paths(bodies[0], True) + work_precision.measure_statistics(bodies[3], True)


def test_the_product_loses_no_body_at_any_frame_rate(precision) -> None:
    ours = [row for row in precision if row["integrator"] == work_precision.OURS]
    assert len(ours) > 8
    assert not any(row["lost"] for row in ours)
    assert np.isfinite([row["error"] for row in ours]).all()


def test_the_papers_statistics_are_right_at_film_rates_where_fixed_steps_diverge(precision) -> None:
    paper = [row for row in precision if row["chaotic"]]
    for row in paper:
        if row["integrator"] == work_precision.OURS and row["step_ms"] > 10.0:
            assert row["error"] < 4.0 * row["standard_error"] + 0.01, row
        if row["integrator"] in ("RK4, fixed step", "RK2", "explicit Euler") and row["step_ms"] > 10.0:
            assert not np.isfinite(row["error"]), "research: RK4 diverges above some 5 to 16 ms on the slides' paper"


def test_the_spheres_path_is_right_to_single_precision(precision) -> None:
    sphere = [row for row in precision if not row["chaotic"]]
    ours = [row["error"] for row in sphere if row["integrator"] == work_precision.OURS]
    assert max(ours) < 1e-3
    euler = min(row["error"] for row in sphere if row["integrator"] == "explicit Euler")
    assert min(ours) < 1e-2 * euler


@pytest.fixture(scope="module")
def atlas() -> list[dict]:
    return stability.measure(stability.Extent((0.1, 10.0), (2.0, 100.0), 6, 1.0, (1, 16)), silent)


def test_the_atlas_has_no_red_cell_of_ours(atlas) -> None:
    ours = [row for row in atlas if row["method"] == stability.OURS]
    assert len(ours) == 12
    assert all(row["largest_step_ms"] >= FILM - 1e-6 for row in ours), ours


def test_baselines_fail_where_they_are_said_to(atlas) -> None:
    def largest(method, density, aspect, setting=0):
        name = stability.SETTINGS[setting].name
        return next(
            row["largest_step_ms"] for row in atlas
            if (row["method"], row["density_ratio"], row["aspect_ratio"], row["setting"]) == (method, density, aspect, name)
        )  # fmt: skip

    # the added mass exceeds the mass: lagged, it diverges at any step
    assert largest("lagged added mass", 0.1, 2.0) == largest("lagged added mass", 0.1, 100.0) == 0.0
    # fast spin: Euler's methods diverge, RK4 at film rates too
    assert largest("explicit Euler", 10.0, 2.0, 1) < FILM
    assert largest("RK4, fixed step", 10.0, 100.0, 1) < FILM
    # nothing slows the printed equations down in still air
    assert largest("slides as printed", 10.0, 2.0) == 0.0
    # absolute momentum in a wind
    assert largest("absolute velocity, 3 m/s wind", 0.1, 100.0) == 0.0


def test_the_atlas_has_an_independent_reference() -> None:
    """The product in float64 with frames of 1/960 s against SciPy's DOP853, with which nothing is shared but the loads."""
    extent = stability.Extent((0.5, 100.0), (10.0,), 6, 1.0, (1,))
    for cell in extent.cells[:2]:
        found, lost = stability.product_motions([cell], extent, stability.REFERENCE_FPS, "float64")[0]
        rates = BodyRates([cell.model()], np.zeros(6, dtype=np.int64))
        times = np.arange(1, 25) / 24.0
        states, _ = dop853(rates, rates.state(started(6, 5)), times, 1e-9)
        velocities = np.einsum("nij,tnj->tni", rates.inverse, states[..., :6])
        expected = stability.Motion.of(rotate(states[..., Q], velocities[..., :3]), velocities[..., 3:])
        assert lost == 0
        assert found.fall == pytest.approx(expected.fall, rel=2e-3, abs=1e-3)
        assert found.spin == pytest.approx(expected.spin, rel=2e-3, abs=1e-2)


def test_the_atlas_becomes_a_picture(atlas, tmp_path) -> None:
    noise = [{"quantity": q, "method": stability.OURS, "at": x, "value": 1.0} for q in ("variance", "spin") for x in (0.1, 1.0)]
    save_figure(lambda: stability_figure.draw(atlas, noise), tmp_path / "atlas.png")
    assert (tmp_path / "atlas.png").read_bytes().startswith(b"\x89PNG")


def test_added_mass_is_right_on_thin_bodies_too(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(added_mass, "ASPECT_RATIOS", (1, 50))
    rows = added_mass.measure(True, silent)
    for row in published(added_mass, rows, monkeypatch, tmp_path):
        if row["method"] == added_mass.OURS and row["faces"] == "320":
            assert float(row["worst_percent"]) < 2.0
        if row["method"] == added_mass.FUNDAMENTAL and int(row["aspect_ratio"]) >= 50:
            assert float(row["worst_percent"]) > 50.0
        if row["method"] == added_mass.CAPYTAINE:
            assert float(row["worst_percent"]) < 30.0


def test_the_advantage_is_read_at_equal_time() -> None:
    rows = [
        {"method": m, "aspect_ratio": a, "cpu_ms": t, "worst_percent": e}
        for a in added_mass.ASPECT_RATIOS
        for m, t, e in ((added_mass.OURS, 1.0, 1.0), (added_mass.OURS, 100.0, 0.01), (added_mass.CAPYTAINE, 10.0, 1.0))
    ]
    assert added_mass.advantage(rows, added_mass.CAPYTAINE) == pytest.approx(dict.fromkeys(added_mass.ASPECT_RATIOS, 10.0))
    assert added_mass.advantage(rows, added_mass.FUNDAMENTAL) == {}


def test_the_precompute_converges(monkeypatch, tmp_path) -> None:
    flows = {name: flow for name, flow in turbulence.FLOWS.items() if "step" not in name}
    monkeypatch.setattr(turbulence, "FLOWS", flows)
    rows = published(turbulence, turbulence.measure(True, silent), monkeypatch, tmp_path)
    for flow in flows:
        for cfl in {row["cfl"] for row in rows if row["flow"] == flow}:
            errors = [float(row["error"]) for row in rows if (row["flow"], row["cfl"]) == (flow, cfl)]
            assert errors[-1] < 0.5 * errors[0], f"{flow} at CFL {cfl}: {errors}"


def test_the_slides_table_is_the_slides(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(slides, "step_cost", lambda *args: (1e-4, 1.0))
    monkeypatch.setattr(slides, "model_in", lambda *args: None)
    rows = published(slides, slides.measure(True, silent), monkeypatch, tmp_path)
    assert [float(row["slides_ms"]) for row in rows] == [1.59, 1.63, 1.65, 1.71, 1.73, 1.86]
    assert [int(row["faces_here"]) for row in rows[:4]] == [320, 320, 320, 1280]
    assert int(rows[4]["faces_here"]) == pytest.approx(1024, rel=0.02)


def test_what_a_step_costs_is_counted() -> None:
    shape, fluid = library.elliptic_paper(), AIR
    model = model_in(shape, fluid)
    seconds, substeps = slides.step_cost(model, fluid, 5.0, 4, 10)
    assert seconds > 0.0
    assert 1.0 <= substeps < 10.0


def test_every_level_is_charted(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(fidelity, "builtin_scenes", lambda: {"falling_leaves": None})
    rows = published(fidelity, fidelity.measure(True, silent), monkeypatch, tmp_path)
    assert {row["level"] for row in rows} == set(fidelity.LEVELS)
    for body in {row["body"] for row in rows}:
        assert sum(int(row["auto"]) for row in rows if row["body"] == body) == 1
    full = [row for row in rows if row["level"] == fidelity.LEVELS[-1]]
    assert all(float(row["fall_error"]) < 4.0 * float(row["standard_error"]) + 0.02 for row in full)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["work_precision", "stability"])
def test_quick_charts_say_what_the_documentation_says(name: str, tmp_path) -> None:
    module = {"work_precision": work_precision, "stability": stability}[name]
    conclusion = module.chart(Request(tmp_path / "chart.png", quick=True))
    with (tmp_path / "chart.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    if name == "stability":
        ours = [row for row in rows if row["method"] == stability.OURS]
        assert len(ours) == 36
        assert "wrong in 0" in conclusion
        assert (tmp_path / "chart-noise.csv").exists()
    else:
        for row in rows:
            if row["integrator"] == work_precision.OURS:
                assert float(row["lost"]) == 0.0
                if row["chaotic"] == "1":
                    assert float(row["error"]) < 4.0 * float(row["standard_error"]) + 0.02
