"""`python -m benchmarks [--quick] [--output FILE] [NAME ...]`: JSON lines, machine facts first."""

import argparse
import json
from importlib import import_module
from pathlib import Path

import warp as wp

from warp_immersed.charts.machine import machine_facts

# Every module has a function rows(quick) that yields its measurements.
BENCHMARKS = ("simulate", "startup", "tensor", "bake", "writing", "peers", "cuda")


def main() -> None:
    """Run the benchmarks named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"{', '.join(BENCHMARKS)} [all]")
    parser.add_argument("--quick", action="store_true", help="a few minutes instead of many")
    parser.add_argument("--output", type=Path, help="append the lines to this file too")
    given = parser.parse_args()
    unknown = set(given.names) - set(BENCHMARKS)
    if unknown:
        parser.error(f"{', '.join(sorted(unknown))}: must be of {', '.join(BENCHMARKS)}")
    wp.config.log_level = wp.LOG_ERROR
    wp.init()
    if given.output:
        given.output.parent.mkdir(parents=True, exist_ok=True)

    def show(row: dict) -> None:
        line = json.dumps(row)
        print(line, flush=True)
        if given.output:
            with given.output.open("a", encoding="utf-8") as file:
                file.write(line + "\n")

    show({"what": "machine", **machine_facts()})
    for name in given.names or BENCHMARKS:
        for row in import_module(f"benchmarks.{name}").rows(given.quick):
            show(row)


if __name__ == "__main__":
    main()
