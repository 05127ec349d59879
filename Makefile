# Everything is installed into .venv from PyPI; nothing else is needed but Python 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

# Without a C compiler in PATH the FMUs are compiled by ziglang from PyPI.
HOST_CC := $(shell command -v $${CC:-cc} || command -v gcc || command -v clang)
RUN_EXTRAS := $(if $(HOST_CC),,[zig])

.PHONY: run studies test test-full lint bench fmus clean

run: $(VENV)/.run
	$(BIN)/build-fmus
	$(BIN)/cosim study gpc
	$(BIN)/cosim study preview-lq

studies: run
	$(BIN)/cosim study bench
	$(BIN)/cosim study three-axle
	$(BIN)/cosim study trench
	$(BIN)/cosim study hmmwv

test: $(VENV)/.test lint
	$(BIN)/build-fmus
	$(BIN)/python -m pytest -n auto --dist loadscope

# Also runs the studies once more and compares every verdict; a study uses all cores by itself.
test-full: test
	$(BIN)/python -m pytest -m full

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m benchmarks

fmus: $(VENV)/.run
	$(BIN)/build-fmus

clean:
	rm -rf fmus results build *.egg-info

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.$(RUN_EXTRAS)'
	touch $@

$(VENV)/.test: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[test,zig]'
	touch $@ $(VENV)/.run
