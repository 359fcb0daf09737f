"""Measurements of speed: `python -m benchmarks [--quick] [--output FILE] [NAME ...]`. Nothing here is asserted in the tests."""
