# Everything is installed into .venv from PyPI; nothing else is needed but Python 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

# Without a C compiler in PATH the FMUs are compiled by ziglang from PyPI.
HOST_CC := $(shell command -v $${CC:-cc} || command -v gcc || command -v clang)
RUN_EXTRAS := studies
ifeq ($(HOST_CC),)
RUN_EXTRAS := studies,zig
endif

.PHONY: run studies test test-full lint bench mutants fuzz fmus clean

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
	$(BIN)/python -m pytest -n auto --dist loadscope --no-loadscope-reorder

# Also runs the studies once more and compares every verdict; a study uses all cores by itself.
test-full: test
	$(BIN)/python -m pytest -m full

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/mypy

bench: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m benchmarks

# Small mistakes in what readers see, each of which some test should notice; what was tried before is not tried again.
mutants: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m tests.mutants

# A million cases of what others' files may hold; one that does not end as it should becomes a file of tests/fuzz/corpus.
fuzz: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m tests.fuzz --cases 1000000

fmus: $(VENV)/.run
	$(BIN)/build-fmus

clean:
	rm -rf fmus results build *.egg-info

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[$(RUN_EXTRAS)]'
	touch $@

$(VENV)/.test: pyproject.toml | $(VENV)/bin/python
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[test,zig]'
	touch $@ $(VENV)/.run
