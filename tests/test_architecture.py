"""The house rules, read off the source: device code in kernels/ and nowhere else, imports one way."""

import ast
from pathlib import Path

import pytest
import warp as wp

from tests.bodies import ideal_body, started
from warp_immersed.device_state import Group, Surroundings
from warp_immersed.ensemble import Ensemble
from warp_immersed.fluid import AIR

ROOT = Path(__file__).parent.parent
KERNELS = sorted((ROOT / "kernels").glob("*.py"))
HOST = sorted((ROOT / "warp_immersed").rglob("*.py"))

# Higher rooms may import lower ones only.
FLOORS = [
    {"version", "errors", "motion", "frame_file", "launch_plan", "remesh", "mesh_size", "fluid_sectors", "feature_curves"},
    {
        "export_options",
        "output_files",
        "fluid",
        "mass_properties",
        "sheet_mesh",
        "leaf_outlines",
        "fidelity",
        "exact_tensors",
        "mesh_normals",
        "boundaries",
        "height_field",
        "poisson",
        "smooth_surface",
        "decimation",
        "slab",
    },
    {
        "checkpoint",
        "shape",
        "turbulence",
        "counter_random",
        "turbulence_grid",
        "flow_setup",
        "graded_mesh",
        "mesh_checks",
        "panel_solver",
        "stretching",
    },
    {
        "seen_turbulence",
        "looks",
        "library",
        "force_law",
        "resting",
        "emitters",
        "obstacles",
        "k_epsilon",
        "panel_mesh",
        "fundamental_solutions",
    },
    {"plates", "seen_turbulence", "shape_table", "field_scene", "unsteady", "fan_mesh", "globe_mesh", "mesh_errors"},
    {"body_model", "panel_refinement"},
    {"device_state", "frame_stepper", "scene", "bake", "tensor_cache"},
    {"ensemble", "added_mass", "scene_flow"},
    {"pilot"},
    {"level_choice"},
    {"recording", "progress", "tensor_report", "usd_samples", "scene_ground"},
    {"usd", "simulation"},
    {"usd_clips", "usd_ground", "usd_shards", "usd_xforms"},
    {"usd_export", "summary", "shot"},
    {"framing"},
    {"picture"},
    {"preview", "viewer"},
    {"cli"},
]
HOST_ONLY_CALLS = {
    "launch", "launch_tiled", "zeros", "empty", "full", "ones", "clone", "copy", "from_numpy", "zeros_like", "empty_like",
    "get_device", "set_device", "synchronize", "synchronize_device", "ScopedCapture", "ScopedDevice", "Stream", "init",
    "load_module",
}  # fmt: skip


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"), str(path))


def imported_modules(tree: ast.Module) -> set[str]:
    names = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    return names


def decorators(tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found |= {ast.unparse(d).split("(")[0] for d in node.decorator_list}
    return found


@pytest.mark.parametrize("path", HOST, ids=lambda p: p.name)
def test_no_device_code_outside_kernels(path: Path) -> None:
    assert not decorators(tree_of(path)) & {"wp.kernel", "wp.func", "wp.struct", "warp.kernel", "warp.func", "warp.struct"}


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.name)
def test_kernels_hold_device_code_only(path: Path) -> None:
    tree = tree_of(path)
    outside = {
        name
        for name in imported_modules(tree)
        if not name.startswith(("warp_immersed.kernels", "typing", "math")) and name != "warp"
    }
    assert not outside, "kernels/ imports warp, math, typing and its siblings only"
    calls = {
        node.func.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) == "wp"
    }
    assert not calls & HOST_ONLY_CALLS
    names = {node.func.id for node in ast.walk(tree) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
    assert not names & {"open", "print", "exec", "eval"}


@pytest.mark.parametrize("path", KERNELS, ids=lambda p: p.name)
def test_kernels_are_documented_and_forward_only(path: Path) -> None:
    tree = tree_of(path)
    assert ast.get_docstring(tree)
    device = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.decorator_list]
    assert all(ast.get_docstring(node) for node in device)
    if device:
        assert '"enable_backward": False' in path.read_text(encoding="utf-8")


def test_imports_run_one_way() -> None:
    floor = {name: level for level, names in enumerate(FLOORS) for name in names}
    for path in HOST:
        if path.name == "__init__.py" or path.parent.name in ("charts", "commands"):  # the top floor: these import anything
            continue
        assert path.stem in floor, f"{path.name} has no floor in this test"
        for module in imported_modules(tree_of(path)):
            parts = module.split(".")
            if parts[0] == "warp_immersed" and len(parts) > 1 and parts[1] in floor:
                assert floor[parts[1]] < floor[path.stem], f"{path.name} imports {parts[1]}, which does not lie below it"


def test_every_public_function_is_documented() -> None:
    for path in HOST:
        for node in tree_of(path).body:
            if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_"):
                assert ast.get_docstring(node), f"{path.name}: {node.name} has no docstring"


def test_no_kernel_is_made_after_the_first_frame(monkeypatch: pytest.MonkeyPatch) -> None:
    ensemble = Ensemble([Group(ideal_body(), started(count=3), 1)], Surroundings(AIR), fps=24.0, threads=2)
    frames = ensemble.frames(10)
    next(frames), next(frames)
    made = []
    monkeypatch.setattr(wp.Kernel, "__init__", lambda self, *args, **kwargs: made.append(args))
    assert sum(1 for _ in frames) == 8
    ensemble.close()
    assert not made
