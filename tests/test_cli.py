"""The command line as a user meets it: files, messages, exit statuses."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from pxr import Usd, UsdGeom

import warp_immersed as wi
from warp_immersed.output_files import partial_path
from warp_immersed.recording import Recording

ROOT = Path(__file__).parent.parent
SMALL = """
duration = 1.0
[[bodies]]
name = "coin"
count = 20
shape = { library = "disk" }
emitter = { kind = "box", center = [0, 3, 0], size = [1, 1, 1] }
"""


@pytest.fixture(scope="module", autouse=True)
def compiled_kernels() -> None:
    """A first run on a machine says that it compiles; the tests are about the runs after it."""
    wi.simulate(wi.Scene.from_text(SMALL), device="cpu")


def run(*arguments: str, cwd: Path, **options) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "warp_immersed.cli", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    return subprocess.run(command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300, check=False, **options)


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    path = tmp_path / "coins.toml"
    path.write_text(SMALL)
    return path


def assert_refused(result: subprocess.CompletedProcess[str], *words: str) -> None:
    assert result.returncode == 2, result.stderr
    assert "Traceback" not in result.stderr
    errors = result.stderr.strip().splitlines()
    assert len(errors) == 1
    assert errors[0].startswith("error: ")
    for word in words:
        assert word in errors[0]


def test_run_writes_usd_and_says_what_it_did(scene, tmp_path) -> None:
    result = run("run", "coins.toml", "--device", "cpu", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "20 bodies, 24 frames at 24 fps" in result.stdout
    assert "coin: 20 x quasi_steady (auto: " in result.stdout
    last = result.stdout.strip().splitlines()[-1]
    assert last.startswith("out/coins.usdc: ")
    assert "body-steps/s" in last
    assert not result.stderr, "nothing but results on a short run"
    stage = Usd.Stage.Open(str(tmp_path / "out/coins.usdc"))
    crowd = UsdGeom.PointInstancer.Get(stage, "/World/Crowd")
    assert len(crowd.GetPositionsAttr().Get(24)) == 20
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["coins.usdc"]


def test_options_change_what_they_say(scene, tmp_path) -> None:
    for name, *options in (
        ("a", "--seed", "1"),
        ("b", "--seed", "2"),
        ("c", "--count-scale", "0.5"),
        ("d", "--threads", "1", "--seed", "1"),
    ):
        result = run("run", "coins.toml", "-o", f"{name}.h5", "--no-progress", *options, cwd=tmp_path)
        assert result.returncode == 0, result.stderr
    a, b, c, d = (Recording.load(tmp_path / f"{name}.h5") for name in "abcd")
    assert (a.positions[-1] != b.positions[-1]).all()
    assert c.positions.shape == (24, 10, 3)
    assert (a.positions == d.positions).all()
    assert (tmp_path / "a.h5").read_bytes() == (tmp_path / "d.h5").read_bytes()


def test_export_gives_the_file_that_run_gives(scene, tmp_path) -> None:
    assert run("run", "coins.toml", "-o", "a.h5", cwd=tmp_path).returncode == 0
    assert run("run", "coins.toml", "-o", "a.usdc", cwd=tmp_path).returncode == 0
    assert run("export", "a.h5", "-o", "b.usdc", cwd=tmp_path).returncode == 0
    assert (tmp_path / "a.usdc").read_bytes() == (tmp_path / "b.usdc").read_bytes()


def test_export_and_run_take_the_same_options(scene, tmp_path) -> None:
    options = [
        "--up-axis",
        "z",
        "--units",
        "cm",
        "--fps",
        "48",
        "--start-frame",
        "101",
        "--no-motion-blur",
        "--chunk-frames",
        "10",
    ]
    assert run("run", "coins.toml", "-o", "run.h5", "--compress", cwd=tmp_path).returncode == 0
    result = run("run", "coins.toml", "-o", "a.usdc", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    result = run("export", "run.h5", "-o", "out/a.usdc", *options, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "24 frames, 20 bodies" in result.stdout
    for part in ("a.usdc", *(f"a.usdc.parts/{name}.usdc" for name in ("manifest", "clip_0000", "clip_0001", "clip_0002"))):
        assert (tmp_path / part).read_bytes() == (tmp_path / "out" / part).read_bytes(), part
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert (stage.GetStartTimeCode(), stage.GetEndTimeCode(), stage.GetTimeCodesPerSecond()) == (101.0, 147.0, 48.0)
    result = run(
        "export", "run.h5", "-o", "b.usdz", "--frames", "5:10", "--bodies", "0:7", "--instancing", "xforms", cwd=tmp_path
    )
    assert result.returncode == 0, result.stderr
    assert "5 frames, 7 bodies" in result.stdout
    assert Usd.Stage.Open(str(tmp_path / "b.usdz")).GetEndTimeCode() == 10.0


def test_info_describes_scene_and_installation(scene, tmp_path) -> None:
    result = run("info", cwd=tmp_path)
    assert result.returncode == 0
    for word in ("warp-immersed", "device cpu", "falling_leaves", "maple_leaf"):
        assert word in result.stdout
    result = run("info", "falling_leaves", cwd=tmp_path)
    assert result.returncode == 0
    for word in ("240 frames", "T_L", "no grid is needed", "substeps a frame", "added mass"):
        assert word in result.stdout


def test_a_failed_body_is_named_and_the_file_kept(scene, tmp_path) -> None:
    scene.write_text(
        SMALL.replace("size = [1, 1, 1]", "size = [1, 1, 1], velocity = [1e25, 0, 0]").replace("count = 20", "count = 2")
    )
    result = run("run", "coins.toml", "-o", "a.h5", cwd=tmp_path)
    assert result.returncode == 1
    assert "error: 2 of 2 bodies failed and were frozen where they were: coin 0, coin 1" in result.stderr
    assert "Traceback" not in result.stderr
    assert (Recording.load(tmp_path / "a.h5").state[-1] == 3).all()


BAD_COMMANDS = [
    (["run", "no_such_scene"], ["no_such_scene", "built in: "]),
    (["run", "missing.toml"], ["missing.toml", "cannot be read"]),
    (["run", "coins.toml", "--device", "cuda:7"], ["device 'cuda:7'", "cpu"]),
    (["run", "coins.toml", "--device", "gpu"], ["device 'gpu'", "cpu"]),
    (["run", "coins.toml", "-o", "a.abc"], ["'.abc'", ".usdc"]),
    (["run", "coins.toml", "--count-scale", "-1"], ["count scale"]),
    (["run", "coins.toml", "--seed", "-5"], ["seed: found -5"]),
    (["run", "coins.toml", "--fidelity", "super"], ["super"]),
    (["run", "coins.toml", "--sed", "5"], ["--sed"]),
    (["run"], ["scene"]),
    (["export", "missing.h5", "-o", "a.usdc"], ["no such file"]),
    (["run", "coins.toml", "-o", "a.usdc", "--resume"], ["--resume: needs a recording", "export a.h5 -o a.usdc"]),
    (["run", "coins.toml", "-o", "a.usdc", "--compress"], ["--compress: needs a recording"]),
    (["run", "coins.toml", "-o", "a.h5", "--shards", "2"], ["a.h5", "no options of USD"]),
    (["run", "coins.toml", "-o", "a.usdc", "--shards", "21"], ["shards: found 21", "20 bodies"]),
    (["run", "coins.toml", "--shards", "2", "--chunk-frames", "5"], ["chunk frames and shards: exclude each other"]),
    (["run", "coins.toml", "--up-axis", "x"], ["'x'", "'y', 'z'"]),
    (["run", "coins.toml", "--count-scale", "200", "--instancing", "xforms"], ["at most 2000 bodies, here are 4000"]),
    (["run", "coins.toml", "-o", "a.usdz", "--shards", "2"], ["a .usdz is one file"]),
    (["fly"], ["fly"]),
]


@pytest.mark.parametrize(("arguments", "words"), BAD_COMMANDS, ids=[" ".join(a) for a, _ in BAD_COMMANDS])
def test_bad_commands_are_refused_in_one_line(scene, tmp_path, arguments, words) -> None:
    assert_refused(run(*arguments, cwd=tmp_path), *words)
    assert [p.name for p in tmp_path.iterdir()] == ["coins.toml"]


def test_bad_scenes_are_refused_in_one_line(scene, tmp_path) -> None:
    scene.write_text(SMALL.replace("count", "cuont"))
    assert_refused(run("run", "coins.toml", cwd=tmp_path), "coins.toml: bodies[0].cuont: unknown key", "'count'")
    assert [p.name for p in tmp_path.iterdir()] == ["coins.toml"]


def test_an_output_that_cannot_be_written_is_refused_first(scene, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    assert_refused(run("run", "coins.toml", "-o", "file/a.usdc", cwd=tmp_path), "file/a.usdc", "cannot be written")
    (tmp_path / "folder.usdc").mkdir()
    assert_refused(run("run", "coins.toml", "-o", "folder.usdc", cwd=tmp_path), "is a folder")


def test_what_an_unfinished_run_holds_of_the_disk_counts_as_free(tmp_path, monkeypatch) -> None:
    from warp_immersed.commands import output

    monkeypatch.setattr(output.shutil, "disk_usage", lambda _: SimpleNamespace(free=1_000_000))
    with pytest.raises(wi.InputError, match="needs about 2 MB, the disk has 1 MB left"):
        output.check_output(tmp_path / "a.h5", 400, 100, wi.ExportOptions())
    partial_path(tmp_path / "a.h5").write_bytes(bytes(1_500_000))
    output.check_output(tmp_path / "a.h5", 400, 100, wi.ExportOptions())


@pytest.mark.skipif(os.name != "posix" or os.geteuid() == 0, reason="root may write anywhere")
def test_a_read_only_folder_is_refused(scene, tmp_path) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    assert_refused(run("run", "coins.toml", "-o", "locked/a.usdc", cwd=tmp_path), "locked/a.usdc", "cannot be written")


@pytest.mark.skipif(os.name != "posix", reason="needs a limit on the size of files")
@pytest.mark.parametrize("output", ["a.usdc", "a.h5"])
def test_a_full_disk_leaves_nothing_behind(scene, tmp_path, output) -> None:
    """A limit on file size stands in for the full disk: writes fail in the same way."""
    scene.write_text(SMALL.replace("count = 20", "count = 3000"))

    import resource  # not on Windows

    def limit() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (400_000, 400_000))

    assert_refused(run("run", "coins.toml", "-o", output, cwd=tmp_path, preexec_fn=limit), "cannot write", output)
    assert [p.name for p in tmp_path.iterdir()] == ["coins.toml"]


def test_resume_refuses_another_seed(scene, tmp_path) -> None:
    assert run("run", "coins.toml", "-o", "a.h5", cwd=tmp_path).returncode == 0
    before = (tmp_path / "a.h5").read_bytes()
    result = run("run", "coins.toml", "-o", "a.h5", "--seed", "9", "--resume", cwd=tmp_path)
    assert_refused(result, "a.h5", "cannot go on with another run: its seed is '0', not '9'")
    assert (tmp_path / "a.h5").read_bytes() == before


def test_parts_that_are_not_there_are_refused(scene, tmp_path) -> None:
    assert run("run", "coins.toml", "-o", "a.h5", cwd=tmp_path).returncode == 0
    for options, words in (
        (["--frames", "30:40"], ["frames: found '30:40'", "0 to 23"]),
        (["--bodies", "leaf"], ["bodies: found 'leaf'", "coin"]),
        (["-o", "a.h5"], ["'.h5'", ".usdc"]),
    ):
        assert_refused(run("export", "a.h5", "-o", "b.usdc", *options, cwd=tmp_path), *words)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.h5", "coins.toml"]


@pytest.mark.skipif(os.name != "posix", reason="sends an interrupt")
def test_ctrl_c_keeps_the_frames_there_are(scene, tmp_path) -> None:
    scene.write_text(SMALL.replace("duration = 1.0", "duration = 2000.0"))
    command = [sys.executable, "-m", "warp_immersed.cli", "run", "coins.toml", "-o", "a.usdc"]
    process = subprocess.Popen(
        command, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a runner in the background ignores it
    )  # fmt: skip
    partial = tmp_path / ".a.partial.usdc"
    deadline = time.monotonic() + 120.0
    while not (partial.exists() and partial.stat().st_size > 100_000) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert "interrupted: a.usdc is whole with the first" in out
    stage = Usd.Stage.Open(str(tmp_path / "a.usdc"))
    samples = UsdGeom.PointInstancer.Get(stage, "/World/Crowd").GetPositionsAttr().GetTimeSamples()
    assert 24 <= len(samples) < 48_000
    assert samples == list(range(1, len(samples) + 1))
    assert stage.GetEndTimeCode() == len(samples)
    assert f"first {len(samples)} of 48000 frames" in out
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a.usdc", "coins.toml"]


FIELD = """
[domain]
lower = [-4.0, 0.0, -3.0]
upper = [8.0, 6.0, 3.0]
cells = [24, 12, 12]
[boundary]
x_min = { kind = "inlet", velocity = [1, 0, 0], intensity = 0.1, length_scale = 0.5 }
x_max = { kind = "outlet" }
y_min = { kind = "wall" }
y_max = { kind = "slip" }
[[obstacle]]
box = [[-1, 0, -1], [1, 2, 1]]
"""


def test_bake_chart_and_run_in_the_field(scene, tmp_path) -> None:
    (tmp_path / "block.toml").write_text(FIELD)
    result = run("bake", "block.toml", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "24 x 12 x 12 cells" in result.stdout
    assert "block.h5: converged in" in result.stdout
    result = run("chart", "field", "block.h5", "-o", "block.png", cwd=tmp_path)
    if "pip install" not in result.stderr:
        assert result.returncode == 0, result.stderr
        assert (tmp_path / "block.png").read_bytes().startswith(b"\x89PNG")
    scene.write_text(SMALL + '[turbulence]\nkind = "grid"\nfield = "block.h5"\n')
    result = run("run", "coins.toml", "-o", "a.h5", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert Recording.load(tmp_path / "a.h5").velocities[-1, :, 0].mean() > 0.05


def test_tensor_prints_a_table_or_json(tmp_path) -> None:
    import json

    import trimesh

    trimesh.creation.icosphere(2, 0.05).export(tmp_path / "ball.stl")
    result = run("tensor", "ball.stl", "--fluid", "water", "--density", "500", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for word in ("translation [kg]", "rotation [kg m^2]", "estimated error", "of the mass"):
        assert word in result.stdout
    result = run("tensor", "ball.stl", "--fluid", "1000", "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    tensor = json.loads(result.stdout)["tensor"]
    volume = trimesh.creation.icosphere(2, 0.05).volume
    assert tensor[0][0] == pytest.approx(0.5 * 1000.0 * volume, rel=0.02)


MORE_BAD_COMMANDS = [
    (["tensor", "none.stl"], ["none.stl", "no such file"]),
    (["tensor", "coins.toml", "--fluid", "honey"], ["fluid: found 'honey'"]),
    (["bake", "none.toml"], ["none.toml", "cannot be read"]),
    (["bake", "coins.toml"], ["coins.toml"]),
    (["chart", "pie"], ["'pie'", "field"]),
    (["chart", "field"], ["missing the bake file"]),
]


@pytest.mark.parametrize(("arguments", "words"), MORE_BAD_COMMANDS, ids=[" ".join(a) for a, _ in MORE_BAD_COMMANDS])
def test_other_bad_commands_are_refused_in_one_line(scene, tmp_path, arguments, words) -> None:
    assert_refused(run(*arguments, cwd=tmp_path), *words)
    assert [p.name for p in tmp_path.iterdir()] == ["coins.toml"]


def test_scenes_are_listed_and_a_new_one_can_be_run(tmp_path) -> None:
    result = run("scenes", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for words in ("autumn_crowd: 10000 bodies", "snow: 100000 bodies", "Maple, oak and birch leaves"):
        assert words in result.stdout
    result = run("new", "my_scene", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    before = (tmp_path / "my_scene.toml").read_bytes()
    assert_refused(run("new", "my_scene", cwd=tmp_path), "my_scene.toml", "exists already")
    assert (tmp_path / "my_scene.toml").read_bytes() == before
    result = run("run", "my_scene.toml", "--count-scale", "0.1", "-o", "a.h5", "--no-progress", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert Recording.load(tmp_path / "a.h5").positions.shape == (144, 20, 3)
    text = before.decode().replace("# [", "[").replace("# lower", "lower").replace("# upper", "upper")
    text = (
        text.replace("# position", "position")
        .replace("# target", "target")
        .replace("# hills", "hills")
        .replace("# colors", "colors")
    )
    assert wi.Scene.from_text(text).ground.hills is not None, "what is commented out is right too"


def test_the_ground_of_a_scene_comes_as_usd(tmp_path) -> None:
    result = run("ground", "autumn_crowd", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    stage = Usd.Stage.Open(str(tmp_path / "out/autumn_crowd_ground.usdc"))
    mesh = UsdGeom.Mesh.Get(stage, "/World/Ground")
    low, high = mesh.GetExtentAttr().Get()
    assert low[1] == 0.0
    assert 1.4 < high[1] <= 1.6 + 1e-6
    assert stage.GetDefaultPrim().GetPath() == "/World"
    (tmp_path / "coins.toml").write_text(SMALL)
    assert_refused(run("ground", "coins.toml", cwd=tmp_path), "ground: missing")
