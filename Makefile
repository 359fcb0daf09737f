# make run, make test: each works alone in a clean clone, with Python >= 3.11, venv and pip.
PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test test-slow lint types bench clean

run: $(VENV)/.run
	$(BIN)/warp-immersed run falling_leaves -o out/falling_leaves.usdc

test: $(VENV)/.test
	$(BIN)/python -m pytest -n $(WORKERS)

test-slow: $(VENV)/.test
	$(BIN)/python -m pytest -n $(WORKERS) --slow -m slow

lint: $(VENV)/.test
	$(BIN)/ruff check .

types: $(VENV)/.test
	$(BIN)/mypy

bench: $(VENV)/.run
	$(BIN)/python benchmarks/simulate.py

clean:
	rm -rf $(VENV) out build *.egg-info

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $$($(PYTHON) --version) found, Python 3.11 or newer is needed: make PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(BIN)/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.test: $(BIN)/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[test]"
	@touch $@ $(VENV)/.run
