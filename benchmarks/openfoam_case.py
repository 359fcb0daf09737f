"""The backward-facing step as an OpenFOAM v1912 case on the same cells, for `python -m benchmarks bake`.

Needs the Debian package `openfoam` (apt install openfoam). Same coefficients, wall functions and orders as `KEpsilonSolver`;
SIMPLEC with relaxation .9, which is what its tutorials use for this kind of flow.
"""

import os
import re
import subprocess
from pathlib import Path

import numpy as np

HEADER = "FoamFile {{ version 2.0; format ascii; class {kind}; object {name}; }}\n"
ENVIRONMENT = {"WM_PROJECT_DIR": "/usr/share/openfoam"}

BLOCK_MESH = """scale 1;
vertices
(
  ({x0} {y0} 0) ({x1} {y0} 0) ({x1} {y1} 0) ({x0} {y1} 0)
  ({x0} {y0} {h}) ({x1} {y0} {h}) ({x1} {y1} {h}) ({x0} {y1} {h})
);
blocks ( hex (0 1 2 3 4 5 6 7) ({nx} {ny} 1) simpleGrading (1 1 1) );
edges ();
boundary
(
  inlet {{ type patch; faces ( (0 4 7 3) ); }}
  outlet {{ type patch; faces ( (1 2 6 5) ); }}
  walls {{ type wall; faces ( (0 1 5 4) (3 7 6 2) ); }}
  frontAndBack {{ type empty; faces ( (0 3 2 1) (4 5 6 7) ); }}
  obstacle {{ type wall; faces (); }}
);
mergePatchPairs ();
"""

TOPO_SET = """actions
(
  {{ name fluid; type cellSet; action new; source boxToCell; sourceInfo {{ box (-100 -100 -100) (100 100 100); }} }}
  {{ name fluid; type cellSet; action subtract; source boxToCell; sourceInfo {{ box (-100 -100 -100) (0 1 100); }} }}
);
"""

CONTROL = """application simpleFoam; startFrom startTime; startTime 0; stopAt endTime; endTime {end}; deltaT 1;
writeControl timeStep; writeInterval {interval}; purgeWrite 0; writeFormat ascii; writePrecision 8; writeCompression off;
timeFormat general; timePrecision 8; runTimeModifiable false;
"""

SCHEMES = """ddtSchemes { default steadyState; }
gradSchemes { default Gauss linear; }
divSchemes
{
  default none;
  div(phi,U) bounded Gauss linearUpwind grad(U);
  div(phi,k) bounded Gauss limitedLinear 1;
  div(phi,epsilon) bounded Gauss limitedLinear 1;
  div((nuEff*dev2(T(grad(U))))) Gauss linear;
}
laplacianSchemes { default Gauss linear corrected; }
interpolationSchemes { default linear; }
snGradSchemes { default corrected; }
wallDist { method meshWave; }
"""

SOLUTION = """solvers
{
  p { solver GAMG; smoother GaussSeidel; tolerance 1e-8; relTol 0.1; }
  "(U|k|epsilon)" { solver smoothSolver; smoother symGaussSeidel; tolerance 1e-9; relTol 0.1; }
}
SIMPLE { nNonOrthogonalCorrectors 0; consistent yes; residualControl { p 1e-9; } }
relaxationFactors { equations { U 0.9; k 0.9; epsilon 0.9; } }
"""


def field(name: str, kind: str, dimensions: str, value: str, patches: dict[str, str]) -> str:
    """A field file of time 0."""
    sides = "".join(f"  {patch} {{ {text} }}\n" for patch, text in patches.items())
    sides += "  frontAndBack { type empty; }\n"
    head = HEADER.format(kind=kind, name=name)
    return f"{head}dimensions [{dimensions}];\ninternalField uniform {value};\nboundaryField\n{{\n{sides}}}\n"


def write_step(folder: Path, cells_per_height: int, iterations: int, interval: int) -> None:
    """Write the case of `tests/flow_cases.backward_step`."""
    n = cells_per_height
    for part in ("0", "constant", "system"):
        (folder / part).mkdir(parents=True, exist_ok=True)
    k, epsilon, inflow = 0.00375, 0.00026952605085934974, "type fixedValue; value $internalField;"
    out, zero = "type zeroGradient;", "type zeroGradient;"
    wall = {
        "U": "type noSlip;",
        "p": zero,
        "k": f"type kqRWallFunction; value uniform {k};",
        "epsilon": f"type epsilonWallFunction; value uniform {epsilon};",
        "nut": "type nutkWallFunction; value uniform 0;",
    }
    calculated = "type calculated; value uniform 0;"
    fields = {
        "U": ("volVectorField", "0 1 -1 0 0 0 0", "(1 0 0)", inflow, out),
        "p": ("volScalarField", "0 2 -2 0 0 0 0", "0", zero, "type fixedValue; value uniform 0;"),
        "k": ("volScalarField", "0 2 -2 0 0 0 0", str(k), inflow, out),
        "epsilon": ("volScalarField", "0 2 -3 0 0 0 0", str(epsilon), inflow, out),
        "nut": ("volScalarField", "0 2 -1 0 0 0 0", "0", calculated, calculated),
    }
    for name, (kind, dimensions, value, inlet, outlet) in fields.items():
        patches = {"inlet": inlet, "outlet": outlet, "walls": wall[name], "obstacle": wall[name]}
        (folder / "0" / name).write_text(field(name, kind, dimensions, value, patches))
    mesh = BLOCK_MESH.format(x0=-4, x1=20, y0=0, y1=3, h=1.0 / n, nx=24 * n, ny=3 * n)
    dictionaries = {
        "system/blockMeshDict": mesh,
        "system/topoSetDict": TOPO_SET.format(),
        "system/controlDict": CONTROL.format(end=iterations, interval=interval),
        "system/fvSchemes": SCHEMES,
        "system/fvSolution": SOLUTION,
        "constant/transportProperties": f"transportModel Newtonian; nu [0 2 -1 0 0 0 0] {1.0 / 36000.0!r};\n",
        "constant/turbulenceProperties": "simulationType RAS; RAS { RASModel kEpsilon; turbulence on; printCoeffs off; }\n",
    }
    for name, text in dictionaries.items():
        (folder / name).write_text(HEADER.format(kind="dictionary", name=Path(name).name) + text)


def run(folder: Path, command: str) -> str:
    """Run one OpenFOAM tool in a case and return what it printed."""
    done = subprocess.run(
        command.split(), cwd=folder, env={**os.environ, **ENVIRONMENT}, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise RuntimeError(f"{command} failed:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return done.stdout


def solve_step(folder: Path, cells_per_height: int, iterations: int, interval: int) -> float:
    """Write, mesh and solve the case; returns the CPU time of the solver [s]."""
    write_step(folder, cells_per_height, iterations, interval)
    run(folder, "blockMesh")
    run(folder, "topoSet")
    run(folder, "subsetMesh -overwrite -patch obstacle fluid")
    return float(re.findall(r"ExecutionTime = ([\d.]+) s", run(folder, "simpleFoam"))[-1])


def read_field(folder: Path, iteration: int, name: str) -> np.ndarray:
    """Cell values of a field at an iteration, (cells,) or (cells, 3)."""
    text = (folder / str(iteration) / name).read_text()
    body = re.search(r"internalField\s+nonuniform List<\w+>\s*(\d+)\s*\((.*?)\n\)", text, re.DOTALL)
    if body is None:
        raise ValueError(f"{folder}/{iteration}/{name}: holds no list of cell values")
    values = np.array(re.findall(r"[-+\d.eE]+", body.group(2)), dtype=float)
    return values.reshape(int(body.group(1)), -1).squeeze()
