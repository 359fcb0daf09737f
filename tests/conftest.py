"""Shared set-up: a quiet Warp, the --slow switch, and bodies simple enough to have exact answers."""

import atexit
import os
import shutil
import tempfile

import pytest
import warp as wp

# what earlier runs left in the user's cache must not decide a test
if "WARP_IMMERSED_CACHE" not in os.environ:
    os.environ["WARP_IMMERSED_CACHE"] = tempfile.mkdtemp(prefix="warp-immersed-test-")
    atexit.register(shutil.rmtree, os.environ["WARP_IMMERSED_CACHE"], ignore_errors=True)
wp.config.log_level = wp.LOG_ERROR
wp.init()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="run the long validation tests too")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    skip_slow = pytest.mark.skip(reason="slow: give --slow to run it")
    skip_gpu = pytest.mark.skip(reason="needs a CUDA device")
    for item in items:
        if "slow" in item.keywords and not config.getoption("--slow"):
            item.add_marker(skip_slow)
        if "gpu" in item.keywords and not wp.is_cuda_available():
            item.add_marker(skip_gpu)
