"""The benchmarks run and count rightly; how fast they are is nobody's business here."""

import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

from benchmarks.__main__ import BENCHMARKS
from benchmarks.measurement import frames_done, paired_ratio, thin_ellipsoids

ROOT = Path(__file__).parent.parent


@pytest.mark.parametrize("name", BENCHMARKS)
def test_every_benchmark_has_rows(name: str) -> None:
    assert callable(import_module(f"benchmarks.{name}").rows)


def test_work_is_counted_in_substeps() -> None:
    ensemble = thin_ellipsoids(10, 1000.0)
    block = frames_done(ensemble, 5)
    assert block() == block() == 50.0  # a substep a body and frame of 1 ms
    ensemble.close()


def test_ratios_are_ours_over_theirs() -> None:
    def work(amount: float):
        def block() -> float:
            return amount * sum(1 for _ in range(20_000)) / 20_000

        return block

    assert paired_ratio(work(1000.0), work(1.0), 0.01) > 10.0


@pytest.mark.slow
def test_lines_are_json_and_begin_with_the_machine(tmp_path) -> None:
    command = [sys.executable, "-m", "benchmarks", "--quick", "--output", str(tmp_path / "lines.jsonl"), "simulate", "cuda"]
    printed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    rows = [json.loads(line) for line in printed.splitlines() if line.startswith("{")]
    assert rows[0]["what"] == "machine"
    assert {"processor", "cores", "warp", "date", "devices"} <= set(rows[0])
    assert any(row["what"] == "simulate" for row in rows)
    registers = [row["registers"] for row in rows if row["what"] == "cuda resources" and "registers" in row]
    assert all(0 < count <= 255 for count in registers)
    assert len((tmp_path / "lines.jsonl").read_text().splitlines()) == len(rows)
