import numpy as np
import pytest
import warp as wp

from warp_immersed.boundaries import Inlet, LogInlet, Outlet, Periodic, Slip, Wall
from warp_immersed.charts.flow_cases import (
    backward_step,
    centers,
    cube_in_wind,
    decaying_duct,
    exact_decay,
    periodic_box,
    reattachment,
    taylor_green,
)
from warp_immersed.errors import InputError
from warp_immersed.flow_setup import FlowSetup
from warp_immersed.k_epsilon import DivergedError, KEpsilonSolver
from warp_immersed.kernels import k_epsilon as device
from warp_immersed.launch_plan import LaunchPlan
from warp_immersed.poisson import add_v_cycle
from warp_immersed.unsteady import UnsteadySolver


@pytest.mark.parametrize("step", [0.01, 0.1, 1.0, 10.0])
def test_sources_alone_are_exact_at_any_step(step):
    state = wp.array(np.array([[1.0, 1.0]], dtype=np.float32), dtype=wp.vec2, device="cpu")
    for n in range(1, max(3, int(10.0 / step)) + 1):
        wp.launch(device.advance_decay, 1, [step, 0.0, state], device="cpu")
        k, epsilon = exact_decay(n * step)
        assert state.numpy()[0, 0] == pytest.approx(k, rel=1e-4)
        assert state.numpy()[0, 1] == pytest.approx(epsilon, rel=1e-4)


@pytest.mark.parametrize("strain_rate", [3.0, 30.0])
def test_sources_with_production_match_a_fine_integration(strain_rate):
    from scipy.integrate import solve_ivp

    def rates(_, y):
        chi = np.exp(y[1])
        return [0.09 * strain_rate**2 / chi - chi, 0.44 * 0.09 * strain_rate**2 / chi - 0.92 * chi]

    state = wp.array(np.array([[1.0, 1.0]], dtype=np.float32), dtype=wp.vec2, device="cpu")
    wp.launch(device.advance_decay, 1, [1.0, strain_rate**2, state], device="cpu")
    k, epsilon = state.numpy()[0]
    log_k, log_chi = solve_ivp(rates, (0.0, 1.0), [0.0, 0.0], rtol=1e-10, atol=1e-12).y[:, -1]
    assert np.log(k) == pytest.approx(log_k, abs=2e-5)
    assert np.log(epsilon / k) == pytest.approx(log_chi, abs=2e-5)


@pytest.mark.parametrize(("k", "epsilon"), [(1e-12, 1e-12), (1.0, 1e-9), (1e-9, 1.0), (100.0, 1.0)])
def test_sources_stay_positive_and_finite(k, epsilon):
    state = wp.array(np.array([[k, epsilon]], dtype=np.float32), dtype=wp.vec2, device="cpu")
    for _ in range(20):
        wp.launch(device.advance_decay, 1, [1.0, 100.0, state], device="cpu")
        assert np.isfinite(state.numpy()).all()
        assert (state.numpy() > 0.0).all()


@pytest.mark.parametrize("cfl", [1.0, 10.0])
def test_turbulence_decays_along_a_duct(cfl):
    setup = decaying_duct(cells=100)
    solver = KEpsilonSolver(setup, cfl=cfl, threads=1)
    assert solver.solve(2000, 1e-5).converged
    fields = solver.fields()
    k, epsilon = exact_decay(centers(setup, 0), 0.01, 0.01)
    np.testing.assert_allclose(fields["k"][:, 1, 0], k, rtol=0.02)
    np.testing.assert_allclose(fields["epsilon"][:, 1, 0], epsilon, rtol=0.02)


def test_laminar_couette_flow_is_linear():
    sides = (Periodic(), Periodic(), Wall(), Wall(velocity=(1.0, 0.0, 0.0)), Slip(), Slip())
    solver = KEpsilonSolver(FlowSetup((0, 0, 0), (1, 1, 0.1), (4, 10, 1), sides, 0.1, turbulent=False), threads=1)
    assert solver.solve(2000, 1e-6).converged
    np.testing.assert_allclose(solver.fields()["velocity"][1, :, 0, 0], centers(solver.setup, 1), atol=1e-5)


def test_the_surface_layer_keeps_its_profile():
    wind = LogInlet.from_reference((1.0, 0.0, 0.0), 5.0, 10.0, 0.05)
    sides = (wind, Outlet(), Wall(roughness=0.05), Slip(), Slip(), Slip())
    setup = FlowSetup((0, 0, 0), (200, 40, 2), (50, 20, 1), sides, 1.5e-5)
    solver = KEpsilonSolver(setup, threads=1)
    assert solver.solve(2000).converged
    fields = solver.fields()
    y = centers(setup, 1)
    low = y < 20.0
    u = np.array([wind.speed(height) for height in y])
    np.testing.assert_allclose(fields["velocity"][-1, low, 0, 0], u[low], rtol=0.04)
    np.testing.assert_allclose(fields["k"][-1, low, 0], wind.friction_velocity**2 / 0.3, rtol=0.1)


def test_an_oblique_wind_enters_through_two_sides():
    wind = LogInlet.from_reference((2.0, 0.0, 1.0), 5.0, 10.0, 0.05)
    sides = (wind, Outlet(), Wall(roughness=0.05), Slip(), wind, Outlet())
    setup = FlowSetup((0, 0, 0), (60, 30, 60), (15, 12, 15), sides, 1.5e-5)
    solver = KEpsilonSolver(setup, threads=1)
    assert solver.solve(1000).converged
    velocity = solver.fields()["velocity"]
    np.testing.assert_allclose(velocity[..., 0], 2.0 * velocity[..., 2], atol=0.1)
    speed = np.array([wind.speed(height) for height in centers(setup, 1)])
    np.testing.assert_allclose(np.linalg.norm(velocity[7, :, 7], axis=-1), speed, rtol=0.05)


@pytest.mark.parametrize("cfl", [2.0, 10.0])
@pytest.mark.parametrize(("k", "epsilon"), [(None, None), (1e-12, 1e-12), (0.0, 0.0), (1.0, 1e-9), (1e-9, 1.0), (100.0, 1.0)])
def test_any_start_stays_positive_and_finite(k, epsilon, cfl):
    setup = backward_step(4, k, epsilon, length=8.0)
    solver = KEpsilonSolver(setup, cfl=cfl, threads=1)
    fluid = setup.fluid_mask()
    for _ in range(40):
        solver.step()
        turbulence = solver.turbulence.numpy()[fluid]
        assert np.isfinite(turbulence).all()
        assert (turbulence > 0.0).all()
        assert np.isfinite(solver.velocity.numpy()).all()


def test_the_wake_is_the_same_from_every_wind_and_conserves_mass():
    flows = []
    for axis, forward in ((0, True), (2, False), (0, False), (2, True)):
        setup = cube_in_wind(3, axis, forward)
        solver = KEpsilonSolver(setup, threads=1)
        verdict = solver.solve(1500, 1e-5)
        assert verdict.converged
        assert verdict.history[-1].divergence < 1e-3
        flux = solver.flux_x.numpy() if axis == 0 else solver.flux_z.numpy().transpose(2, 1, 0)
        assert flux[-1].sum() == pytest.approx(flux[0].sum(), rel=1e-4)
        velocity, k = solver.fields()["velocity"], solver.fields()["k"]
        if axis == 2:
            velocity, k = velocity.transpose(2, 1, 0, 3)[..., ::-1], k.transpose(2, 1, 0)
        if not forward:
            velocity, k = velocity[::-1] * np.array([-1.0, 1.0, 1.0]), k[::-1]
        flows.append((velocity, k))
    velocity, k = flows[0]
    assert velocity[3 * 4 + 1, 0, 7, 0] < 0.0  # the flow turns back behind the cube
    np.testing.assert_allclose(velocity[:, :, ::-1] * np.array([1.0, 1.0, -1.0]), velocity, atol=1e-3)
    for other_velocity, other_k in flows[1:]:
        np.testing.assert_allclose(other_velocity, velocity, atol=1e-3)
        np.testing.assert_allclose(other_k, k, atol=1e-3 * k.max())


def test_the_number_of_threads_changes_nothing():
    states = []
    for threads in (1, 3):
        solver = KEpsilonSolver(cube_in_wind(4), threads=threads)
        solver.step(4)
        progress = solver.measured_step()
        states.append((progress, *solver.fields().values()))
    assert states[0][0] == states[1][0]
    for one, other in zip(states[0][1:], states[1][1:], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_checkpoint_goes_on_bit_for_bit():
    first = KEpsilonSolver(backward_step(4), threads=1)
    first.step(9)
    first.measured_step()
    stored = first.checkpoint()
    first.step(10)
    second = KEpsilonSolver(backward_step(4), threads=1)
    second.restore(stored)
    second.step(10)
    assert second.steps_taken == 20
    np.testing.assert_array_equal(first.velocity.numpy(), second.velocity.numpy())
    np.testing.assert_array_equal(first.turbulence.numpy(), second.turbulence.numpy())
    with pytest.raises(InputError, match="must be"):
        KEpsilonSolver(backward_step(5), threads=1).restore(stored)


def test_a_diverged_solve_names_the_cell_and_what_to_do():
    solver = KEpsilonSolver(backward_step(4), threads=1)
    solver.measured_step()
    velocity = solver.velocity.numpy().copy()
    velocity[30, 8, 0] = np.nan
    for array in (solver.velocity, solver.good["velocity"]):
        array.assign(velocity)
    with pytest.raises(DivergedError, match=r"cell \(\d+, \d+, 0\) at .*lower cfl"):
        solver.solve(100)


def test_one_multigrid_cycle_divides_the_residual_by_four():
    solver = KEpsilonSolver(cube_in_wind(4), threads=1)
    top = solver.levels[0]
    rng = np.random.default_rng(1)
    b = rng.standard_normal(top.b.shape) * solver.setup.fluid_mask()
    top.b.assign(b.astype(np.float32))
    plan = LaunchPlan(wp.get_device("cpu"))
    add_v_cycle(plan, solver.levels)
    plan.run()
    p, x = top.stencil.numpy().astype(float), top.x.numpy().astype(float)
    pad = np.pad(x, 1)
    middle = slice(1, -1)
    near = [pad[:-2, middle, middle], pad[2:, middle, middle], pad[middle, :-2, middle], pad[middle, 2:, middle]]
    near += [pad[middle, middle, :-2], pad[middle, middle, 2:]]
    residual = b - (sum(p[..., f] * near[f] for f in range(6)) - p[..., 7] * x)
    assert np.linalg.norm(residual) < 0.25 * np.linalg.norm(b)


def test_taylor_green_vortices_decay_at_second_order():
    coarse, fine = taylor_green(32, 1.0), taylor_green(64, 1.0)
    assert fine < 5.3e-4
    assert np.log2(coarse / fine) > 2.0


def test_turbulence_in_a_still_box_decays_exactly():
    solver = UnsteadySolver(periodic_box((4, 4, 1), (1, 1, 0.25), 1.5e-5, k=1.0, epsilon=1.0), dt=0.2, threads=1)
    snapshots = solver.snapshots(2.0, 1.0)
    assert snapshots.time == pytest.approx([0.0, 1.0, 2.0])
    for n, time in enumerate(snapshots.time):
        k, epsilon = exact_decay(time)
        np.testing.assert_allclose(snapshots.k[n], k, rtol=1e-4)
        np.testing.assert_allclose(snapshots.epsilon[n], epsilon, rtol=1e-4)


def test_an_unsteady_step_keeps_a_steady_flow():
    base = KEpsilonSolver(backward_step(4, length=8.0), threads=1)
    base.solve(800)
    x = centers(base.setup, 0)
    before = reattachment(base.fields()["velocity"], x)
    UnsteadySolver(base).advance(2.0)
    assert reattachment(base.fields()["velocity"], x) == pytest.approx(before, rel=0.1)


def test_a_gust_comes_in_with_the_inlet():
    sides = (Inlet((1.0, 0.0, 0.0), 0.01, 0.01), Outlet(), Slip(), Slip(), Slip(), Slip())
    setup = FlowSetup((0, 0, 0), (2, 0.5, 0.1), (20, 5, 1), sides, 1e-5)
    solver = UnsteadySolver(setup, dt=0.05, gust=lambda time: 1.0 + 0.5 * time, threads=1)
    solver.advance(0.5)
    np.testing.assert_allclose(solver.base.fields()["velocity"][..., 0], 1.25, rtol=5e-3)


@pytest.mark.parametrize("given", [{"cfl": 0.0}, {"cfl": 80.0}])
def test_a_step_that_cannot_work_is_refused(given):
    with pytest.raises(InputError, match="cfl"):
        KEpsilonSolver(backward_step(4), **given)


def test_an_unsteady_step_above_cfl_2_is_refused():
    with pytest.raises(InputError, match="CFL 2"):
        UnsteadySolver(backward_step(4), dt=1.0)
