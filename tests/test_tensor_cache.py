"""The cache on disk, shared by several processes at once."""

import json
import os
import subprocess
import sys

import numpy as np

from warp_immersed.panel_refinement import MeshTensor
from warp_immersed.tensor_cache import load_tensor, store_tensor

WORKER = """
import sys
import numpy as np
from warp_immersed.panel_refinement import MeshTensor
from warp_immersed.tensor_cache import load_tensor, store_tensor
torn = 0
for turn in range(200):
    for key in ("one", "two", "three"):
        found = load_tensor(key)
        expected = np.full((6, 6), float(len(key)))
        if found is not None and not (found.matrix == expected).all():
            torn += 1
        if found is None and turn > 0:
            torn += 1
        store_tensor(key, MeshTensor(expected, 0.01, 100, "x" * 5000))
print(torn)
"""

SOLVER = """
import warp as wp
wp.config.log_level = wp.LOG_ERROR
from tests.surfaces import disk
import trimesh
from warp_immersed.added_mass import kirchhoff_solution
from warp_immersed.fluid import AIR
from warp_immersed.shape import Shape
vertices, faces = disk(5)
shape = Shape.from_mesh(trimesh.Trimesh(vertices, faces, process=False), density=500.0, thickness=1e-3)
print(kirchhoff_solution(shape, AIR).matrix.tobytes().hex())
"""


def started(code: str, directory: str) -> subprocess.Popen[str]:
    environment = {**os.environ, "WARP_IMMERSED_CACHE": directory, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.Popen([sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE, text=True)


def test_processes_that_write_the_same_keys_never_see_half_a_file(tmp_path) -> None:  # type: ignore[no-untyped-def]
    workers = [started(WORKER, str(tmp_path)) for _ in range(4)]
    assert [worker.communicate(timeout=120)[0].strip() for worker in workers] == ["0"] * 4
    assert sorted(path.name for path in tmp_path.iterdir()) == ["tensor-one.json", "tensor-three.json", "tensor-two.json"]
    assert all(json.loads(path.read_text())["faces"] == 100 for path in tmp_path.iterdir())


def test_processes_that_solve_the_same_body_agree(tmp_path) -> None:  # type: ignore[no-untyped-def]
    solvers = [started(SOLVER, str(tmp_path)) for _ in range(3)]
    results = {solver.communicate(timeout=300)[0].splitlines()[-1] for solver in solvers}
    assert len(results) == 1
    assert len(list(tmp_path.iterdir())) == 1


def test_what_is_stored_comes_back(tmp_path, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    monkeypatch.setenv("WARP_IMMERSED_CACHE", str(tmp_path))
    tensor = MeshTensor(np.diag(np.arange(1.0, 7.0)) / 3.0, 0.0123, 444, "panels")
    store_tensor("key", tensor)
    found = load_tensor("key")
    assert found is not None
    assert found.matrix.tobytes() == tensor.matrix.tobytes()
    assert (found.error_estimate, found.faces, found.method) == (0.0123, 444, "panels")
