"""Added-mass tensors kept on disk between runs, for a fluid of unit density.

One small JSON file a body, in the user's cache directory (WARP_IMMERSED_CACHE if set), named by a hash of its geometry, of
whether it is a sheet, of the accuracy asked for and of the version of the method. Files appear whole or not at all, so several
processes may share the directory; one that cannot be read counts as absent.
"""

import hashlib
import json
import os
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from platformdirs import user_cache_path

from warp_immersed.panel_refinement import MeshTensor

Array = NDArray[np.float64]

METHOD_VERSION = 2  # raise it when results change


def cache_directory() -> Path:
    """Where the files are: $WARP_IMMERSED_CACHE, or the place for caches on this system."""
    given = os.environ.get("WARP_IMMERSED_CACHE")
    return Path(given) if given else user_cache_path("warp-immersed", appauthor=False)


def geometry_key(vertices: Array, faces: NDArray[np.int64], closed: bool, settings: tuple[object, ...]) -> str:
    """Hash of a body as the solver sees it: vertices (V, 3) [m] about its centre of mass, faces (F, 3), settings."""
    digest = hashlib.sha256(json.dumps([METHOD_VERSION, "solid" if closed else "sheet", *settings]).encode())
    digest.update(np.ascontiguousarray(vertices, dtype="<f8").tobytes())
    digest.update(np.ascontiguousarray(faces, dtype="<i8").tobytes())
    return digest.hexdigest()


def load_tensor(key: str) -> MeshTensor | None:
    """The tensor stored under a key, or None."""
    try:
        stored = json.loads((cache_directory() / f"tensor-{key}.json").read_text())
        matrix = np.array(stored["matrix"], dtype=np.float64)
        tensor = MeshTensor(matrix, float(stored["error_estimate"]), int(stored["faces"]), str(stored["method"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return tensor if matrix.shape == (6, 6) and np.isfinite(matrix).all() else None


def store_tensor(key: str, tensor: MeshTensor) -> None:
    """Store a tensor; a directory that cannot be written to is passed over, for the cache only saves time."""
    content = {
        "matrix": tensor.matrix.tolist(),
        "error_estimate": tensor.error_estimate,
        "faces": tensor.faces,
        "method": tensor.method,
    }
    directory = cache_directory()
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=directory, prefix=".tensor-", delete=False) as file:
            json.dump(content, file)
        os.replace(file.name, directory / f"tensor-{key}.json")
    except OSError:
        return
