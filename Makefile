# Two commands do everything on a fresh machine: `make demo` and `make test`.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
GMM_GPU := .venv-gmm-gpu
# Neighbouring tests share what they prepare: each worker begins with a half of its own, and takes from the other's at the end.
SPREAD := -n auto --dist worksteal
OPEN3D_LIBRARIES := libGL.so.1 libEGL.so.1 libX11.so.6 libusb-1.0.so.0 libudev.so.1 libidn2.so.0 libgomp.so.1
OPEN3D_PACKAGES := libgl1 libegl1 libx11-6 libusb-1.0-0 libudev1 libidn2-0 libgomp1

.PHONY: help setup system-libraries demo test test-all test-more lint format paper paper-fast bench bench-engine bench-accuracy bench-sweeps clean

help:
	@echo "make demo       set up, simulate two scans of a corridor, find what changed, write the report"
	@echo "make test       set up, run the tests (two to six minutes on two cores)"
	@echo "make test-all   the slow tests and those on real scans (NOVELTY_DATA) as well"
	@echo "make lint       ruff (lint and format) and mypy"
	@echo "make paper      the paper's experiments in our numbers, one page (make paper-fast: a small part of them)"
	@echo "make bench      the benchmarks (pytest-benchmark), as bench.json and bench.html"
	@echo "make bench-engine    the engine beside oneDAL, scikit-learn, gmcluster and gmm-gpu, in one table"
	@echo "make bench-accuracy  how well changes are found, in seven tables (ARGS='--table mosd --seeds 2' for a part)"
	@echo "make bench-sweeps    what sweeps cost and what they survive, in five points (ARGS='1 2 --small' for a part)"

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml constraints.txt | system-libraries
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Python 3.11 or newer is needed; name one with make PYTHON=...")'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	@touch $@

# Open3D links against these; installed only where this user may, otherwise the command is printed.
system-libraries:
	@missing=; for library in $(OPEN3D_LIBRARIES); do \
	    PATH="$$PATH:/sbin:/usr/sbin" ldconfig -p 2>/dev/null | grep -q "$$library" || missing="$$missing $$library"; done; \
	if [ -n "$$missing" ] && command -v apt-get >/dev/null; then \
	    if [ "$$(id -u)" = 0 ]; then sudo=; elif sudo -n true 2>/dev/null; then sudo="sudo -n"; else sudo=none; fi; \
	    if [ "$$sudo" = none ]; then echo "Open3D needs:$$missing; run: sudo apt-get install $(OPEN3D_PACKAGES)"; \
	    else $$sudo apt-get update -qq && $$sudo env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $(OPEN3D_PACKAGES) >/dev/null; fi; fi

demo: setup
	$(BIN)/novelty demo --out demo-output

test: setup
	$(BIN)/python -m pytest $(SPREAD)

test-all: setup
	$(BIN)/python -m pytest $(SPREAD) -m "slow or data or not slow"

# What `make test` leaves out: CI runs it after `make test`.
test-more: setup
	$(BIN)/python -m pytest $(SPREAD) -m "slow or data"

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

format: setup
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

paper: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[figures]'
	$(BIN)/novelty paper --out paper-output

paper-fast: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[figures]'
	$(BIN)/novelty paper --fast --out paper-output

bench: setup
	$(BIN)/python -m pytest benchmarks -o python_files="bench_*.py" -m "" --benchmark-only --benchmark-columns=median,iqr,rounds --benchmark-json=bench.json $(ARGS)
	$(BIN)/novelty report --benchmarks bench.json --out bench.html

bench-engine: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'
	test -x $(GMM_GPU)/bin/python || $(PYTHON) -m venv $(GMM_GPU)
	$(GMM_GPU)/bin/python -m pip install --quiet --disable-pip-version-check -c constraints.txt 'numpy<2' gmm-gpu
	OMP_WAIT_POLICY=PASSIVE $(BIN)/python -m benchmarks.engine $(ARGS)

bench-accuracy: setup
	$(BIN)/python -m benchmarks.accuracy $(ARGS)

bench-sweeps: setup
	$(BIN)/python -m benchmarks.sweeps $(ARGS)

clean:
	rm -rf $(VENV) $(GMM_GPU) demo-output paper-output accuracy-output .mypy_cache .pytest_cache .ruff_cache .hypothesis
