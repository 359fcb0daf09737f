"""Emitters: distributions, and bodies that do not depend on how many there are."""

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from tests.bodies import rotate
from warp_immersed.emitters import Emitter, emit, lowest_start

EMITTERS = {
    "box": {"kind": "box", "center": [1, 5, 0], "size": [2, 1, 4], "duration": 3.0},
    "disk": {"kind": "disk", "center": [1, 5, 0], "radius": 2.0, "normal": [1, 1, 0], "start": 1.0},
    "points": {"kind": "points", "points": [[0, 3, 0], [1, 4, 0]]},
}


def parse(values):
    return TypeAdapter(Emitter).validate_python(values)


@pytest.mark.parametrize("kind", EMITTERS)
def test_a_body_starts_the_same_however_many_there_are(kind) -> None:
    emitter = parse(EMITTERS[kind])
    few, many = emit(emitter, 20, 1, 2), emit(emitter, 2000, 1, 2)
    for name in vars(few):
        assert np.array_equal(getattr(few, name), getattr(many, name)[:20])


def test_box_is_filled_uniformly() -> None:
    start = emit(parse(EMITTERS["box"]), 40_000, 1, 2)
    unit = (start.positions - [1, 5, 0]) / [2, 1, 4]
    assert np.abs(unit).max() <= 0.5
    assert np.abs(unit.mean(axis=0)).max() < 4.0 * np.sqrt(1 / 12 / 40_000)
    assert np.allclose(unit.var(axis=0), 1 / 12, rtol=0.03)
    assert np.abs(np.corrcoef(np.column_stack([unit, start.release_times]).T) - np.eye(4)).max() < 0.02
    assert 0.0 <= start.release_times.min() < 0.01
    assert 2.99 < start.release_times.max() < 3.0


def test_disk_is_flat_and_filled_uniformly() -> None:
    emitter = parse(EMITTERS["disk"])
    offset = emit(emitter, 40_000, 1, 2).positions - [1, 5, 0]
    assert np.abs(offset @ [1, 1, 0]).max() < 1e-12
    radius = np.linalg.norm(offset, axis=1)
    assert radius.max() <= 2.0
    assert (radius**2).mean() == pytest.approx(2.0, rel=0.02)
    assert lowest_start(emitter) == pytest.approx(5.0 - 2.0 / np.sqrt(2.0))


def test_points_are_taken_in_turn() -> None:
    assert np.array_equal(emit(parse(EMITTERS["points"]), 5, 1, 2).positions[:, 0], [0, 1, 0, 1, 0])


def test_random_orientations_are_uniform() -> None:
    q = emit(parse(EMITTERS["points"]), 40_000, 1, 2).orientations
    assert np.allclose(np.linalg.norm(q, axis=1), 1.0)
    for axis in np.eye(3):
        turned = rotate(q, np.tile(axis, (len(q), 1)))
        assert np.abs(turned.mean(axis=0)).max() < 4.0 / np.sqrt(3 * len(q))
        assert np.allclose((turned**2).mean(axis=0), 1 / 3, atol=0.01)


def test_given_orientation_and_velocities_reach_every_body() -> None:
    values = {**EMITTERS["points"], "orientation": [0, 0, 0.6, 0.8], "velocity": [1, 2, 3], "angular_velocity": [4, 5, 6]}
    start = emit(parse(values), 3, 1, 2)
    assert np.allclose(start.orientations, [0, 0, 0.6, 0.8])
    assert np.allclose(start.velocities, [1, 2, 3])
    assert np.allclose(start.angular_velocities, [4, 5, 6])


@pytest.mark.parametrize(
    "change",
    [
        {"size": [1, -1, 1]},
        {"duration": -1.0},
        {"start": float("nan")},
        {"center": [0, 0]},
        {"orientation": [0, 0, 0, 2]},
        {"colour": 1},
    ],
)
def test_bad_values_are_refused(change) -> None:
    with pytest.raises(ValidationError):
        parse({**EMITTERS["box"], **change})
