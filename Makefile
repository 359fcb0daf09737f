# make run, make test: each works alone in a clean clone, with Python >= 3.11, venv and pip.
PYTHON ?= python3
WORKERS ?= 2
VENV := .venv
BIN := $(VENV)/bin

.PHONY: run test test-slow lint types bench gallery clean

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
	$(BIN)/python -m benchmarks --output out/benchmarks.jsonl

# The pictures in docs/gallery, each from its scene's own output. After a change of the physics: make -B gallery
gallery: $(patsubst scenes/%.toml,docs/gallery/%.png,$(wildcard scenes/*.toml))

docs/gallery/%.png: scenes/%.toml | $(VENV)/.preview
	$(BIN)/warp-immersed run $* -o out/gallery/$*.h5
	$(BIN)/warp-immersed preview out/gallery/$*.h5 -o $@ --size 640x360 --samples 64 --small

clean:
	rm -rf $(VENV) out build *.egg-info

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $$($(PYTHON) --version) found, Python 3.11 or newer is needed: make PYTHON=python3.12"; exit 2; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: $(BIN)/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e .
	@touch $@

$(VENV)/.preview: $(BIN)/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[preview]"
	@touch $@ $(VENV)/.run

$(VENV)/.test: $(BIN)/python pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[test]"
	@touch $@ $(VENV)/.run
