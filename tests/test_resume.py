"""Runs that are cut short: killed, interrupted, out of disk. Whatever happens, the file that comes of it in the end is the
one that an undisturbed run leaves, byte for byte."""

import errno
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import warp_immersed as wi
from warp_immersed import checkpoint as checkpoint_module
from warp_immersed.checkpoint import checkpoint_path
from warp_immersed.frame_file import FrameFile
from warp_immersed.output_files import partial_path
from warp_immersed.recording import resume_recording, start_recording
from warp_immersed.simulation import Plan, choose_device, ensemble_of, manifest_of, plan
from warp_immersed.simulation import run as run_ensemble

ROOT = Path(__file__).parent.parent
# bodies that wait, fly in turbulence by several models, bounce, topple and lie, on a plane
SCENE = """
duration = 1.5
fps = 24
seed = 4
[turbulence]
kind = "homogeneous"
k = 0.1
epsilon = 0.2
[ground]
[[bodies]]
name = "coin"
count = 150
shape = { library = "disk", diameter = 0.02 }
thickness = 1e-3
density = 2700.0
fidelity = "quasi_steady"
emitter = { kind = "box", center = [0, 1, 0], size = [1, 0.5, 1], duration = 1.0 }
[[bodies]]
name = "leaf"
count = 150
shape = { library = "birch_leaf" }
fidelity = "quasi_steady"
emitter = { kind = "disk", center = [0, 0.6, 0], radius = 1.0 }
[[bodies]]
name = "dust"
count = 30
shape = { library = "disk", diameter = 0.002 }
fidelity = "point"
emitter = { kind = "disk", center = [0, 0.6, 0], radius = 1.0 }
[[bodies]]
name = "mote"
count = 30
shape = { library = "disk", diameter = 0.002 }
fidelity = "drift"
emitter = { kind = "disk", center = [0, 0.6, 0], radius = 1.0 }
"""


@pytest.fixture(scope="module")
def planned() -> Plan:
    return plan(wi.Scene.from_text(SCENE, "shower"), "cpu")


def record(planned: Plan, path: Path, resume: bool = False, threads: int = 2, compress: bool = False, **manifest: Any) -> int:
    """Simulate into a recording as the command does, with a checkpoint at every frame; frames there were before."""
    device = choose_device("cpu")
    described = (
        path,
        planned.prototypes,
        24.0,
        {**manifest_of(planned, device), **manifest},
        planned.scene.frame_count,
        compress,
    )
    ensemble = ensemble_of(planned, "cpu", threads)
    writer, found = resume_recording(*described) if resume else (start_recording(*described), None)
    if found is not None:
        ensemble.restore(found.frame, found.body_steps, found.state)
    before = ensemble.frames_done
    run_ensemble(ensemble, planned.scene.frame_count, [writer], snapshot_seconds=0.0)
    return before


@pytest.fixture(scope="module")
def whole(planned, tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "shower.h5"
    record(planned, path)
    assert [p.name for p in path.parent.iterdir()] == ["shower.h5"]
    state = wi.Recording.load(path).state
    assert {0, 1, 2} <= set(np.unique(state)), "bodies wait, move and lie"
    return path.read_bytes()


def cut(monkeypatch: pytest.MonkeyPatch, frame: int, error: Callable[[], BaseException]) -> None:
    """Let writing fail at a frame, half of it written."""
    write = FrameFile.write

    def failing(self: FrameFile, index: int, values: dict[str, Any]) -> None:
        if index == frame:
            write(self, index, {"positions": np.full_like(values["positions"], 7.0)})
            raise error()
        write(self, index, values)

    monkeypatch.setattr(FrameFile, "write", failing)


def full() -> OSError:
    return OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("frame", [2, 17, 35])
def test_a_full_disk_keeps_what_can_be_gone_on_from(planned, whole, tmp_path, monkeypatch, frame) -> None:
    path = tmp_path / "shower.h5"
    with monkeypatch.context() as patch:
        cut(patch, frame, full)
        with pytest.raises(wi.InputError, match=rf"cannot write \(No space left on device\); {frame} frames are kept.*--resume"):
            record(planned, path)
    assert not path.exists()
    assert record(planned, path, resume=True, threads=1) == frame
    assert path.read_bytes() == whole
    assert [p.name for p in tmp_path.iterdir()] == ["shower.h5"]


def test_a_full_disk_before_the_first_checkpoint_leaves_nothing(planned, tmp_path, monkeypatch) -> None:
    cut(monkeypatch, 1, full)
    with pytest.raises(wi.InputError, match="cannot write"):
        record(planned, tmp_path / "shower.h5")
    assert not list(tmp_path.iterdir())


def test_a_checkpoint_that_cannot_be_written_leaves_the_one_before(planned, whole, tmp_path, monkeypatch) -> None:
    path = tmp_path / "shower.h5"
    saved, save = 0, np.savez

    def failing(file: Any, **arrays: Any) -> None:
        nonlocal saved
        saved += 1
        save(file, **arrays)
        if saved == 9:
            raise full()

    with monkeypatch.context() as patch:
        patch.setattr(checkpoint_module.np, "savez", failing)
        with pytest.raises(wi.InputError, match="cannot write"):
            record(planned, path)
    assert record(planned, path, resume=True) == 9
    assert path.read_bytes() == whole


def test_ctrl_c_leaves_a_whole_file_and_it_can_go_on(planned, whole, tmp_path, monkeypatch) -> None:
    path = tmp_path / "shower.h5"
    with monkeypatch.context() as patch:
        cut(patch, 20, KeyboardInterrupt)
        record(planned, path)
    short = wi.Recording.load(path)
    assert len(short.times) == 20
    assert not partial_path(path).exists()
    assert record(planned, path, resume=True) == 20
    assert path.read_bytes() == whole
    assert np.array_equal(short.positions, wi.Recording.load(path).positions[:20])
    assert [p.name for p in tmp_path.iterdir()] == ["shower.h5"]


def test_packed_files_hold_the_same_and_go_on_too(planned, whole, tmp_path, monkeypatch) -> None:
    plain, packed = tmp_path / "plain.h5", tmp_path / "packed.h5"
    plain.write_bytes(whole)
    with monkeypatch.context() as patch:
        cut(patch, 20, full)
        with pytest.raises(wi.InputError):
            record(planned, packed, compress=True)
    record(planned, packed, resume=True, compress=True)
    assert packed.stat().st_size < 0.9 * len(whole)
    one, other = wi.Recording.load(plain), wi.Recording.load(packed)
    for name in ("times", "body_steps", "positions", "orientations", "velocities", "angular_velocities", "state"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name


@pytest.fixture
def unfinished(planned, tmp_path, monkeypatch) -> Path:
    """A run that stopped at frame 10."""
    with monkeypatch.context() as patch:
        cut(patch, 10, full)
        with pytest.raises(wi.InputError):
            record(planned, tmp_path / "shower.h5")
    return tmp_path / "shower.h5"


def test_another_run_is_refused_and_nothing_is_touched(planned, whole, unfinished) -> None:
    for key, value in {"seed": 5, "version": "0.0.1", "device": "NVIDIA", "scene_digest": "0", "data_digest": "0"}.items():
        name = key.replace("_", " ")
        with pytest.raises(wi.InputError, match=f"cannot go on with another run: its {name} is .* not .*without --resume"):
            record(planned, unfinished, resume=True, **{key: value})
    record(planned, unfinished, resume=True)
    assert unfinished.read_bytes() == whole


@pytest.mark.skipif(os.name != "posix", reason="needs locks on files")
@pytest.mark.parametrize("resume", [False, True])
def test_a_file_that_is_being_written_is_left_alone(planned, tmp_path, resume) -> None:
    path = tmp_path / "shower.h5"
    writer = start_recording(path, planned.prototypes, 24.0, {}, planned.scene.frame_count)
    with pytest.raises(wi.InputError, match="another process is writing it"):
        record(planned, path, resume)
    assert partial_path(path).is_file()
    writer.abort()
    assert not list(tmp_path.iterdir())


def test_an_unfinished_file_is_not_a_recording(unfinished) -> None:
    with pytest.raises(wi.InputError, match=r"unfinished, 10 of 36 frames; finish it with warp-immersed run --resume"):
        wi.Recording.load(partial_path(unfinished))


def test_damaged_files_are_refused(planned, unfinished) -> None:
    partial, mark = partial_path(unfinished), checkpoint_path(unfinished)
    good = mark.read_bytes()
    mark.write_bytes(good[: len(good) // 2])
    with pytest.raises(wi.InputError, match=r"checkpoint .* damaged .*run without --resume"):
        record(planned, unfinished, resume=True)
    mark.write_bytes(good)
    os.truncate(partial, 5000)
    with pytest.raises(wi.InputError, match=r"cannot go on .*run without --resume"):
        record(planned, unfinished, resume=True)
    record(planned, unfinished)
    assert [p.name for p in unfinished.parent.iterdir()] == ["shower.h5"]


def test_without_anything_to_go_on_from_a_run_starts(planned, whole, tmp_path) -> None:
    path = tmp_path / "shower.h5"
    assert record(planned, path, resume=True) == 0
    assert path.read_bytes() == whole


def test_a_snapshot_of_other_bodies_is_refused(planned) -> None:
    ensemble = ensemble_of(planned, "cpu", 1)
    with pytest.raises(wi.InputError, match="belongs to another run"):
        ensemble.restore(3, 10, {"clock_0": np.zeros(1, np.int32)})
    ensemble.close()


def test_frames_come_as_they_are_whether_snapshots_are_taken_or_not(planned) -> None:
    def digest(due: Callable[[], bool] | None) -> list[bytes]:
        ensemble = ensemble_of(planned, "cpu", 2)
        frames = [frame.positions.tobytes() + frame.state.tobytes() for frame in ensemble.frames(30, due)]
        ensemble.close()
        return frames

    assert digest(None) == digest(lambda: True)


# ---------------------------------------------------------------- kill -9


@dataclass
class Killed:
    """A run of the command line that is killed at given moments after it has begun to write, then resumed to its end."""

    folder: Path

    def start(self, resume: bool) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "warp_immersed.cli", "run", "shower.toml", "-o", "shower.h5", "--device", "cpu"]
        command += ["--checkpoint-seconds", "0", "--no-progress", *(["--resume"] if resume else [])]
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        return subprocess.Popen(
            command, cwd=self.folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )

    def kill(self, checkpoints: int, delay: float, resume: bool) -> None:
        """Kill a run so many seconds after it was seen to write so many checkpoints; 0: after it began to write."""
        begin, seen = time.time_ns(), set()
        process = self.start(resume)
        partial, mark = partial_path(self.folder / "shower.h5"), checkpoint_path(self.folder / "shower.h5")
        while process.poll() is None and len(seen) < max(checkpoints, 1):
            try:
                changed = (mark if checkpoints else partial).stat().st_mtime_ns
                seen |= {changed} if changed > begin else set()
            except FileNotFoundError:
                pass
            time.sleep(0.0005)
        time.sleep(delay)
        process.kill()
        process.communicate()

    def finish(self, resume: bool) -> str:
        process = self.start(resume)
        out, err = process.communicate(timeout=300)
        assert process.returncode == 0, err
        return out


@pytest.fixture
def runner(planned, tmp_path) -> Killed:
    (tmp_path / "shower.toml").write_text(SCENE)
    return Killed(tmp_path)


def assert_no_corrupt_file(runner: Killed, expected: bytes) -> None:
    final = runner.folder / "shower.h5"
    assert not final.exists() or final.read_bytes() == expected


@pytest.mark.skipif(os.name != "posix", reason="sends kill -9")
def test_killed_again_and_again_a_run_still_completes(runner, whole) -> None:
    for round_, checkpoints in enumerate((4, 9, 5)):
        runner.kill(checkpoints, 0.0, resume=round_ > 0)
        assert_no_corrupt_file(runner, whole)
    out = runner.finish(resume=True)
    assert "going on after frame" in out or "finished already" in out
    assert (runner.folder / "shower.h5").read_bytes() == whole
    assert sorted(p.name for p in runner.folder.iterdir()) == ["shower.h5", "shower.toml"]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="sends kill -9")
def test_killed_at_twenty_random_moments_a_run_completes(runner, whole) -> None:
    begin = time.perf_counter()
    runner.kill(0, 1e-9, resume=False)
    writing_starts = time.perf_counter() - begin
    begin = time.perf_counter()
    runner.finish(resume=False)
    seconds = max(time.perf_counter() - begin - writing_starts, 0.5)
    for delay in np.random.default_rng(11).uniform(0.0, 1.1 * seconds, 20):
        (runner.folder / "shower.h5").unlink()
        runner.kill(0, delay, resume=False)
        assert_no_corrupt_file(runner, whole)
        runner.finish(resume=True)
        assert (runner.folder / "shower.h5").read_bytes() == whole
        assert sorted(p.name for p in runner.folder.iterdir()) == ["shower.h5", "shower.toml"]
    assert "finished already" in runner.finish(resume=True)
