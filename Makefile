# Everything is installed into .venv from PyPI; nothing else is needed but Python 3.11 or newer.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin

# Without a C compiler in PATH the FMUs are compiled by ziglang from PyPI.
HOST_CC := $(shell set -- $${CC:-cc}; command -v "$$1" || command -v gcc || command -v clang)
RUN_EXTRAS := studies
ifeq ($(HOST_CC),)
RUN_EXTRAS := studies,zig
endif

.PHONY: run studies test tests test-full test-courses test-platforms test-pythons test-pages test-judges test-kernels test-embedded release lint bench mutants fuzz snapshots docs pictures fmus clean

run: $(VENV)/.run
	@echo "1 of 3: the FMUs for this machine, into fmus/ (some minutes the first time, then seconds)"
	@$(BIN)/build-fmus
	@echo "2 of 3: the main experiment, generalized predictive control of a HMMWV, into results/gpc/"
	@$(BIN)/cosim study gpc
	@echo "3 of 3: the second one, optimal preview control, into results/preview-lq/"
	@$(BIN)/cosim study preview-lq
	@echo "Open results/gpc/report.html in a browser. $(BIN)/cosim list shows what else there is, make studies runs it all."

studies: run
	$(BIN)/cosim study bench
	$(BIN)/cosim study three-axle
	$(BIN)/cosim study trench
	$(BIN)/cosim study hmmwv
	$(BIN)/cosim study gpc-readings
	$(BIN)/cosim study hmmwv-readings
	$(BIN)/cosim study trench-readings
	$(BIN)/cosim study ride

# Bytecode is kept even where the environment says otherwise: the tests start hundreds of programs.
test tests test-full: export PYTHONDONTWRITEBYTECODE :=
test: $(VENV)/.test
	$(MAKE) -j 2 lint tests  # types are checked, on one core, while FMUs are built and the first tests run

tests: fmus
	$(BIN)/python -m pytest -n auto --dist loadscope --no-loadscope-reorder

# Also runs the studies once more and compares every verdict; a study uses all cores by itself.
test-full: test
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[jax]' || echo "the extra [jax] cannot be installed here"
	$(BIN)/python -m pytest -m full

# Reads the measured courses (OpenCRG) in the folder that SUSPENSION_ROADS names; they are no part of the repository.
test-courses: $(VENV)/.test
	@test -n "$$SUSPENSION_ROADS" || { echo "skipped: SUSPENSION_ROADS names no folder of measured courses (*.crg)"; exit 0; }; \
	$(BIN)/python -m pytest -m courses tests/roads

# Builds all FMUs for all platforms (ziglang) and runs those for Windows under Wine and those for ARM under QEMU. From Debian:
# apt install wine64 qemu-user-static libc6-arm64-cross. What is not installed is skipped, and said.
test-platforms: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m pytest -m platforms -rs tests/conformance/test_other_platforms.py

# Installs the wheel, with what it needs from PyPI, into a fresh environment of every supported Python that is found (PATH, pyenv, or
# those that SUSPENSION_PYTHONS names), builds an FMU there and runs it. Which are not found is said.
test-pythons: $(VENV)/.test
	$(BIN)/python -m pytest -m pythons -rs tests/install/test_pythons.py

# Builds FMUs and runs the numeric tests under each kernel of OpenBLAS that this processor executes (the FMUs stay in fmus/.kernels).
test-kernels: $(VENV)/.test
	$(BIN)/python -m pytest -m kernels -rs tests/kernels

# Runs FMUs in other importers and compares with their reference results. Which are not there is said: OMSimulator's package downloads a program,
# fmusim is a program of the Reference FMUs.
test-judges: $(VENV)/.test
	$(BIN)/build-fmus
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[judges]' || echo "not every package of the extra [judges] can be installed here"
	$(BIN)/python -m pytest -m judges -rs tests/judges

# Builds controllers for Cortex-M4F and M7 and runs them in QEMU: 100,000 samples of each law and filter, closed loops of the MPCs, their longest samples.
# From Debian: apt install gcc-arm-none-eabi qemu-system-arm. What is not installed is skipped, and said.
test-embedded: $(VENV)/.test
	$(BIN)/build-fmus
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[embedded]' || echo "not every package of the extra [embedded] can be installed here"
	$(BIN)/python -m pytest -n auto --dist worksteal -m '' -rs tests/target

# Looks at reports, live pages and the documentation site in Chromium, with axe-core from npm, at two widths and in both color schemes: one of every kind of content, and
# those that studies have left in results/. From Debian: apt install chromium npm. What is not installed is said.
test-pages: $(VENV)/.test
	$(BIN)/python -m pytest -m pages -rs tests/report/test_browser.py tests/export/test_live_browser.py tests/docs/test_site_browser.py

# What is published: all FMUs for all platforms (ziglang, some ten minutes the first time), wheel and source distribution.
release: $(VENV)/.test
	$(BIN)/python .ci/release.py build/release

lint: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check --quiet .
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

# Renews the snapshots of messages (__snapshots__ beside the tests); look at the differences before you commit them.
snapshots: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m pytest -n auto --dist loadfile --snapshot-update \
		$$(grep -rlE '[^.](raises|warns|sentence)\(' --include='test_*.py' tests)

# The documentation as a site: build/site/html/index.html, with the reports that `make studies` has left.
docs: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m cosim.experiments.live_pages build/live
	$(BIN)/python docs/write_site.py

# Takes the pictures of live pages and reports that the documentation shows, of what studies have left in results/; as test-pages, it needs
# Chromium and npm.
pictures: $(VENV)/.test
	$(BIN)/build-fmus
	$(BIN)/python -m cosim.experiments.live_pages build/live
	$(BIN)/python docs/write_pictures.py

fmus: $(VENV)/.run
	$(BIN)/build-fmus

clean:
	rm -rf fmus results build *.egg-info

define needs_python_3_11
@$(1) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2> /dev/null || { \
	echo "Python 3.11 or newer is needed; $(1) is $$($(1) --version 2>&1 | head -n 1). Choose another one: make PYTHON=python3.12$(2)" >&2; exit 1; }
endef

$(VENV)/bin/python:
	$(call needs_python_3_11,$(PYTHON))
	$(PYTHON) -m venv $(VENV)

$(VENV)/.run: pyproject.toml | $(VENV)/bin/python
	$(call needs_python_3_11,$(BIN)/python, (remove $(VENV) first))
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[$(RUN_EXTRAS)]'
	touch $@

$(VENV)/.test: pyproject.toml | $(VENV)/bin/python
	$(call needs_python_3_11,$(BIN)/python, (remove $(VENV) first))
	$(BIN)/pip install --quiet --disable-pip-version-check -e '.[test,zig]'
	touch $@ $(VENV)/.run
