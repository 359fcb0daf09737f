"""The ensemble: determinism, waiting, failure, cost."""

import numpy as np
import pytest
import warp as wp

from tests.bodies import ideal_body, model_in, random_orientations, started, trajectory
from warp_immersed import library
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.emitters import BoxEmitter, emit
from warp_immersed.ensemble import Ensemble
from warp_immersed.errors import InputError
from warp_immersed.fluid import AIR
from warp_immersed.kernels.rigid_body import FAILED, LANDED, MOVING, WAITING
from warp_immersed.turbulence import HomogeneousTurbulence

GUSTY = Surroundings(AIR, mean_wind=(0.5, 0.0, 0.0), turbulence=HomogeneousTurbulence(0.05, 0.02), ground_height=0.0)
BOX = BoxEmitter(kind="box", center=(0.0, 2.0, 0.0), size=(4.0, 2.0, 4.0), duration=1.0)


def leaves(count: int) -> Group:
    return Group(model_in(library.birch_leaf(), AIR), emit(BOX, count, seed=5, key=9), 9)


def coins(count: int) -> Group:
    return Group(model_in(library.disk(0.02, 1e-3, 2700.0), AIR), emit(BOX, count, seed=5, key=8), 8)


def run(groups, **options):
    return trajectory(groups, None, GUSTY, 24.0, 60, seed=5, **options)


def same(one, other, bodies=slice(None)) -> bool:
    names = ("positions", "orientations", "velocities", "angular_velocities", "state")
    return all(one[name][:, bodies].tobytes() == other[name][:, bodies].tobytes() for name in names)


def test_threads_do_not_change_a_byte() -> None:
    runs = [run([leaves(700), coins(300)], threads=threads) for threads in (1, 2, 4)]
    assert same(runs[0], runs[1])
    assert same(runs[0], runs[2])


def test_a_body_takes_the_same_path_in_any_company() -> None:
    few, many, mixed = run([leaves(100)]), run([leaves(10_000)]), run([coins(37), leaves(100)])
    for body in (0, 17, 99):
        assert np.array_equal(few["positions"][:, body], many["positions"][:, body])
        assert np.array_equal(few["orientations"][:, body], many["orientations"][:, body])
        assert np.array_equal(few["positions"][:, body], mixed["positions"][:, 37 + body])


def test_seeds_change_every_path() -> None:
    one = trajectory([leaves(50)], None, GUSTY, 24.0, 40, seed=5)
    other = trajectory([leaves(50)], None, GUSTY, 24.0, 40, seed=6)
    assert (np.abs(one["positions"][-1] - other["positions"][-1]).max(axis=1) > 1e-6).all()


def test_frames_may_be_asked_for_in_pieces() -> None:
    whole = run([leaves(100)])
    ensemble = Ensemble([leaves(100)], GUSTY, 24.0, seed=5)
    pieces = [f.positions.copy() for n in (1, 20, 39) for f in ensemble.frames(n)]
    ensemble.close()
    assert np.array_equal(np.array(pieces), whole["positions"])


def test_float32_follows_float64() -> None:
    """Within the first half second, before chaos tells them apart."""
    start = started(orientations=random_orientations(50, 3), positions=(0.0, 100.0, 0.0), count=50)
    model = model_in(library.maple_leaf(), AIR)
    ends = [trajectory(model, start, GUSTY, 24.0, 13, precision=p)["positions"][-1] for p in ("float32", "float64")]
    assert np.abs(ends[0] - ends[1]).max() < 1e-4


def test_bodies_wait_at_rest_until_their_moment() -> None:
    times = np.array([0.0, 0.1, 0.5, 0.51, 10.0])
    body = ideal_body(pull=9.81)
    start = started(positions=(0.0, 50.0, 0.0), velocities=(1.0, 0.0, 0.0), release_times=times, count=5)
    frames = trajectory(body, start, Surroundings(AIR), 24.0, 25)
    for frame in range(25):
        t = frame / 24.0
        for i, release in enumerate(times):
            free = max(0.0, t - release)
            # a release on the very frame shows at the next one
            waiting = t < release or (release > 0.0 and free == 0.0)
            assert frames["state"][frame, i] == (WAITING if waiting else MOVING)
            assert np.allclose(frames["positions"][frame, i], [free, 50.0 - 9.81 * free**2 / 2.0, 0.0], atol=2e-5)
            assert np.allclose(frames["velocities"][frame, i], [0.0 if waiting else 1.0, -9.81 * free, 0.0], atol=2e-5)


def test_a_failed_body_is_frozen_and_alone() -> None:
    count = 20
    orientations = random_orientations(count, 4)
    velocities = np.zeros((count, 3))
    velocities[7] = 1e25
    model = model_in(library.maple_leaf(), AIR)
    place = (0.0, 50.0, 0.0)
    bad = trajectory(model, started(place, orientations, velocities, count=count), GUSTY, 24.0, 20)
    good = trajectory(model, started(place, orientations, count=count), GUSTY, 24.0, 20)
    assert (bad["state"][-1] == np.where(np.arange(count) == 7, FAILED, MOVING)).all()
    assert np.isfinite(bad["positions"]).all()
    assert np.allclose(bad["positions"][:, 7], place)
    assert not bad["velocities"][1:, 7].any()
    others = np.arange(count) != 7
    assert np.array_equal(bad["positions"][:, others], good["positions"][:, others])


def test_state_fits_into_256_bytes() -> None:
    ensemble = Ensemble([leaves(10)], GUSTY, 24.0)
    assert ensemble.bytes_per_body <= 256
    assert ensemble.bodies == 10
    ensemble.close()


def test_dust_is_refused_with_a_reason() -> None:
    with pytest.raises(InputError, match="too small for quasi_steady"):
        Ensemble([Group(model_in(library.disk(2e-6, 1e-7), AIR), started(), 1)], GUSTY, 24.0)


def test_all_cores_are_used_without_changing_the_launches() -> None:
    ensemble = Ensemble([leaves(1000)], GUSTY, 24.0, threads=3)
    launches = ensemble._stepper._launches
    assert len(launches) == 2
    assert len(launches[0]) >= 3
    ensemble.close()


def test_landed_bodies_cost_no_substeps() -> None:
    model = model_in(library.disk(), AIR)
    start = started(positions=(0.0, 0.3, 0.0), orientations=random_orientations(50, 5), count=50)
    frames = trajectory(model, start, Surroundings(AIR, ground_height=0.0), 24.0, 120)
    assert (frames["state"][-1] == LANDED).all()
    landed = np.flatnonzero((frames["state"] == LANDED).all(axis=1))[0]
    assert frames["body_steps"][-1] == frames["body_steps"][landed]


@pytest.mark.gpu
def test_cuda_follows_the_cpu() -> None:
    start = started(orientations=random_orientations(500, 3), positions=(0.0, 100.0, 0.0), count=500)
    model = model_in(library.maple_leaf(), AIR)
    cpu = trajectory(model, start, GUSTY, 24.0, 13)
    cuda = trajectory(model, start, GUSTY, 24.0, 13, device="cuda:0")
    again = trajectory(model, start, GUSTY, 24.0, 13, device="cuda:0")
    assert same(cuda, again)
    assert np.abs(cpu["positions"][-1] - cuda["positions"][-1]).max() < 1e-4
    wp.synchronize_device("cuda:0")
