"""What is installed is whole, and nothing of it lies where other packages live."""

import ast
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


@pytest.fixture(scope="module")
def wheel(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("wheel")
    # from a copy, because setuptools packs what it finds in an old build/; in this environment, so that nothing is downloaded
    source = out / "source"
    source.mkdir()
    for name in ("warp_immersed", "kernels", "scenes"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
    return next(out.glob("*.whl"))


def test_every_package_is_listed() -> None:
    """A folder left out works in a checkout and fails from the wheel."""
    folders = {"warp_immersed": "warp_immersed", "kernels": "warp_immersed.kernels", "scenes": "warp_immersed.scenes"}
    found = set()
    for top, name in folders.items():
        for init in (ROOT / top).rglob("__init__.py"):
            found.add(".".join([name, *init.parent.relative_to(ROOT / top).parts]))
    assert found == set(PROJECT["tool"]["setuptools"]["packages"])


def test_wheel_holds_every_module_and_scene(wheel) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
    for top, prefix in (
        ("warp_immersed", "warp_immersed"),
        ("kernels", "warp_immersed/kernels"),
        ("scenes", "warp_immersed/scenes"),
    ):
        for path in (ROOT / top).rglob("*"):
            if path.suffix in (".py", ".toml", ".typed"):
                assert f"{prefix}/{path.relative_to(ROOT / top).as_posix()}" in names
    tops = {name.split("/")[0] for name in names}
    assert {t for t in tops if not t.endswith(".dist-info")} == {"warp_immersed"}, "no top-level kernels or scenes"


def test_installed_wheel_works_and_leaves_kernels_to_others(wheel, tmp_path) -> None:
    """From the wheel alone, away from the checkout: kernels compile, scenes are found, `import kernels` is not ours."""
    site = tmp_path / "site"
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(site)
    script = """
import importlib.util, sys
assert importlib.util.find_spec("kernels") is None and importlib.util.find_spec("scenes") is None
import warp_immersed as wi
assert "site" in wi.__file__
run = wi.simulate(wi.Scene.load("falling_leaves").changed(count_scale=0.002), device="cpu")
assert run.positions.shape[0] == 240
"""
    paths = [str(site), *(p for p in sys.path if "site-packages" in p)]
    program = f"import sys; sys.path[:0] = {paths!r}\n{script}"
    (tmp_path / "program.py").write_text(program)
    result = subprocess.run(
        [sys.executable, "-P", "program.py"], cwd=tmp_path, capture_output=True, text=True, check=False, env={}
    )
    assert result.returncode == 0, result.stderr


def test_dependencies_are_those_imported() -> None:
    """Every third-party import is declared, and every declared dependency is imported (or needed by one, and says so)."""
    names = {"usd-core": "pxr", "warp-lang": "warp"}
    declared = {names.get(d, d) for d in (entry.split(">")[0].split("[")[0] for entry in PROJECT["project"]["dependencies"])}
    imported = set()
    for path in [*(ROOT / "warp_immersed").rglob("*.py"), *(ROOT / "kernels").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split(".")[0])
    extras = {"matplotlib", "mitsuba", "imageio_ffmpeg", "viser", "PIL", "mujoco", "capytaine"}  # PIL is pillow
    third_party = imported - set(sys.stdlib_module_names) - {"warp_immersed"} - extras
    assert third_party == declared - {"networkx", "pillow"}
