"""Recordings: what is written is read back; foreign and damaged files are refused."""

import h5py
import numpy as np
import pytest

import warp_immersed as wi
from warp_immersed.recording import DATASETS, PER_FRAME, start_recording

SCENE = """
duration = 1.0
fps = 24
seed = 4
[ground]
[[bodies]]
name = "coin"
count = 30
shape = { library = "disk", diameter = 0.02 }
thickness = 1e-3
density = 2700.0
emitter = { kind = "box", center = [0, 1, 0], size = [1, 0.5, 1], duration = 0.5 }
[[bodies]]
name = "leaf"
count = 20
shape = { library = "birch_leaf" }
emitter = { kind = "disk", center = [0, 1, 0], radius = 1.0 }
"""


@pytest.fixture(scope="module")
def recording() -> wi.Recording:
    return wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu")


def test_shapes_and_units_are_those_promised(recording) -> None:
    assert recording.times.shape == (24,)
    assert np.allclose(recording.times, np.arange(24) / 24.0)
    assert recording.positions.shape == (24, 50, 3)
    assert recording.orientations.shape == (24, 50, 4)
    assert recording.velocities.shape == recording.angular_velocities.shape == (24, 50, 3)
    assert recording.state.shape == (24, 50)
    assert recording.body_steps[0] == 0
    assert (np.diff(recording.body_steps) > 0).all()
    assert [(p.name, p.count) for p in recording.prototypes] == [("coin", 30), ("leaf", 20)]
    assert np.allclose(np.linalg.norm(recording.orientations, axis=2), 1.0, atol=1e-5)
    for key in ("version", "warp", "device", "scene", "scene_digest", "scene_text", "seed", "fidelity"):
        assert key in recording.manifest


def test_velocities_are_the_derivatives_of_positions(recording) -> None:
    moving = (recording.state[:-1] == 1).all(axis=0) & (recording.state[-1] == 1)
    assert moving.sum() > 5
    x, v = recording.positions[:, moving].astype(float), recording.velocities[:, moving]
    central = (x[2:] - x[:-2]) * 12.0
    simpson = (v[:-2] + 4.0 * v[1:-1] + v[2:]) / 6.0
    assert np.median(np.linalg.norm(central - simpson, axis=2)) < 0.02 * np.median(np.linalg.norm(central, axis=2))


def test_saving_and_loading_changes_nothing(recording, tmp_path) -> None:
    path = tmp_path / "run.h5"
    recording.save(path)
    again = wi.Recording.load(path)
    for name in (*DATASETS, *PER_FRAME):
        assert np.array_equal(getattr(again, name), getattr(recording, name))
    assert again.manifest == recording.manifest
    assert again.fps == recording.fps
    for one, other in zip(again.prototypes, recording.prototypes, strict=True):
        for name in ("name", "count", "colors", "roughness", "metallic", "is_sheet"):
            assert getattr(one, name) == getattr(other, name)
        assert np.array_equal(one.vertices, other.vertices)
        assert np.array_equal(one.faces, other.faces)
    with h5py.File(path) as file:
        assert file["positions"].chunks == (1, 50, 3)
        assert {name: file[name].attrs["units"] for name in DATASETS} == {
            "positions": "m", "orientations": "1", "velocities": "m s-1", "angular_velocities": "rad s-1", "state": "1",
        }  # fmt: skip
    assert [p.name for p in tmp_path.iterdir()] == ["run.h5"]


def test_equal_runs_give_equal_files(recording, tmp_path) -> None:
    recording.save(tmp_path / "a.h5")
    wi.simulate(wi.Scene.from_text(SCENE, "coins"), device="cpu", threads=3).save(tmp_path / "b.h5")
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "b.h5").read_bytes()


def test_abort_leaves_nothing(recording, tmp_path) -> None:
    writer = start_recording(tmp_path / "run.h5", recording.prototypes, 24.0, {}, 24)
    writer.write(recording.frame(0))
    writer.abort()
    assert not list(tmp_path.iterdir())


def test_damaged_and_foreign_files_are_refused(recording, tmp_path) -> None:
    whole = tmp_path / "run.h5"
    recording.save(whole)
    (tmp_path / "cut.h5").write_bytes(whole.read_bytes()[:20_000])
    (tmp_path / "text.h5").write_text("no")
    with h5py.File(tmp_path / "foreign.h5", "w") as file:
        file["x"] = 1
    recording.save(tmp_path / "later.h5")
    with h5py.File(tmp_path / "later.h5", "a") as file:
        file.attrs["schema_version"] = 99
    for name, message in (
        ("cut.h5", "damaged"),
        ("text.h5", "damaged"),
        ("foreign.h5", "not a recording"),
        ("later.h5", "schema version 99"),
        ("none.h5", "no such file"),
    ):
        with pytest.raises(wi.InputError, match=message):
            wi.Recording.load(tmp_path / name)


def test_ctrl_c_keeps_the_frames_there_are(monkeypatch) -> None:
    from warp_immersed import simulation as module

    class Impatient(module.MemorySink):
        def write(self, frame) -> None:
            if frame.index == 7:
                raise KeyboardInterrupt
            super().write(frame)

    monkeypatch.setattr(module, "MemorySink", Impatient)
    assert len(module.simulate(wi.Scene.from_text(SCENE), device="cpu").times) == 7


def test_a_full_disk_met_while_reading_is_not_called_damage(recording, tmp_path) -> None:
    recording.save(tmp_path / "coins.h5")
    with pytest.raises(OSError, match="No space left"), wi.open_recording(tmp_path / "coins.h5"):
        raise OSError(28, "No space left on device")
