"""What a number was measured on."""

import os
import platform
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

from warp_immersed.frame_stepper import available_threads
from warp_immersed.version import __version__


def machine_facts() -> dict[str, Any]:
    """Processor, cores, load, devices, versions and date: what every figure and benchmark states."""
    return {
        "processor": processor_name(),
        "cores": available_threads(),
        "load": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "devices": [device.name for device in wp.get_devices() if device.is_cuda] or ["cpu"],
        "platform": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "warp": wp.__version__,
        "numpy": np.__version__,
        "warp_immersed": __version__,
        "date": datetime.now(UTC).strftime("%Y-%m-%d"),
    }


def processor_name() -> str:
    """The processor in words, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def stamp() -> str:
    """The facts in a line, for the foot of a figure."""
    facts = machine_facts()
    cuda = "" if facts["devices"] == ["cpu"] else f" ({', '.join(facts['devices'])} present, not used)"
    return (
        f"{facts['processor']}, {facts['cores']} cores{cuda} · device cpu · warp_immersed {facts['warp_immersed']}, "
        f"Warp {facts['warp']}, NumPy {facts['numpy']}, Python {facts['python']} · {facts['date']}"
    )
