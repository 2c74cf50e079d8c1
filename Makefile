# Every target does its own set-up: a virtual environment in .venv, filled from the lock files.

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUNTIME := $(VENV)/runtime.stamp
DEVELOPMENT := $(VENV)/development.stamp
# Bytecode is kept wherever what numba compiles is: else each of the processes that tests start would
# compile all that it imports.
unexport PYTHONDONTWRITEBYTECODE
PIP := $(BIN)/pip --disable-pip-version-check --quiet

.PHONY: help install run quick test hil page oracles docs lint bench experiments mutation lock clean

help:
	@echo "make run          emulated lab, daemon and a client: once round a rectangle, live"
	@echo "make quick        lint, types and cheap tests of every package, after each change"
	@echo "make test         lint, types and tests"
	@echo "make hil          the daemon as processes, through every fault, and scenes that make test has"
	@echo "                  shorter ones of: twenty minutes"
	@echo "make page         the operator's page in a real Chromium, with its pictures"
	@echo "make oracles      the planner and its distances beside OMPL and coal, which it installs"
	@echo "make docs         the documentation as a site, in build/docs; a dead link is an error"
	@echo "make bench        measure latency and CPU time; prints one JSON, plots to runs/bench"
	@echo "make experiments  the long checks: a million fuzzed inputs, then the studies (hours)"
	@echo "make mutation     test the tests of safety/: every small fault in it must be noticed"
	@echo "make install      only the set-up;  make lint: only lint and types"

install: $(DEVELOPMENT)

$(RUNTIME): requirements.lock pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@echo "installing what tentacled runs on (once)"
	@$(PIP) install -r requirements.lock
	@$(PIP) install --no-deps --no-build-isolation --editable .
	@touch $@

# Most of what is installed is never imported, and need not become bytecode.
$(DEVELOPMENT): $(RUNTIME) requirements-test.lock
	@echo "installing what the tests need, and compiling what a lab and a daemon need (once)"
	@$(BIN)/python -m daemon.commands.terminal.compiled & compiled=$$!; \
		$(PIP) install --no-compile -r requirements-test.lock; installed=$$?; \
		wait $$compiled && exit $$installed
	@touch $@

run: $(RUNTIME)
	@$(BIN)/tentacled demo

quick: $(DEVELOPMENT)
	@$(BIN)/python -m tests.quick

# Three on two cores: tests of processes in real time wait more than they compute.
WORKERS ?= 3

# What numba compiles is kept: tests with a clock of their own must not wait for it. Types are
# checked meanwhile, on the other core. Of a fresh clone most is compiled while packages are
# installed, and pytest rewrites all tests once here; else each worker would, all of them at the
# same time.
test: $(DEVELOPMENT)
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/mypy & types=$$!; \
		$(BIN)/python -m daemon.commands.terminal.compiled && \
			$(BIN)/python -m daemon.commands.terminal.compiled risk; compiled=$$?; \
		ls tests/__pycache__/test_floors.*-pytest-*.pyc >/dev/null 2>&1 || \
			$(BIN)/pytest --collect-only >/dev/null; \
		wait $$types && exit $$compiled
	@$(BIN)/pytest -n $(WORKERS) --dist loadgroup -m "not long and not page"

hil: $(DEVELOPMENT)
	@$(BIN)/pytest -n 2 --dist loadgroup -m long

page: $(DEVELOPMENT)
	@$(BIN)/pytest -m page

oracles: $(DEVELOPMENT)
	@$(PIP) install --no-build-isolation --editable '.[oracles]'
	@$(BIN)/pytest tests/oracles

docs: $(DEVELOPMENT)
	@$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet docs build/docs
	@echo "build/docs/index.html"

lint: $(DEVELOPMENT)
	@$(BIN)/ruff format --check .
	@$(BIN)/ruff check .
	@$(BIN)/mypy

bench: $(DEVELOPMENT)
	@$(BIN)/python -m tests.benchmarks --plots runs/bench

experiments: $(DEVELOPMENT)
	@$(BIN)/python -m tests.fuzz --inputs 1000000
	@$(BIN)/python -m tests.experiments.body_point
	@$(BIN)/python -m tests.experiments.grazing
	@$(BIN)/python -m tests.experiments.grazing --tubes --aware-only --seeds 50
	@$(BIN)/python -m tests.experiments.planning
	@$(BIN)/python -m tests.experiments.chaos --pairs 200
	@$(BIN)/python -m tests.experiments.undeclared_load
	@$(BIN)/python -m tests.experiments.led_bodies
	@$(BIN)/python -m tests.experiments.led_paths
	@$(BIN)/python -m tests.experiments.held_out
	@$(BIN)/python -m tests.experiments.led_tendons
	@$(BIN)/python -m tests.experiments.led_designs
	@$(BIN)/python -m tests.experiments.led_hard_designs
	@$(BIN)/python -m tests.experiments.led_tubes
	@$(BIN)/python -m tests.experiments.from_nothing
	@$(BIN)/python -m tests.experiments.load_steps
	@for robot in tendon_arm soft_arm; do $(BIN)/tentacled mdn calibrate config/robots/$$robot.yaml \
		--model config/models/$$robot.npz --out runs/calibrated/$$robot || exit 1; done
	@$(BIN)/tentacled reproduce ho2018 --out runs/ho2018
	@$(BIN)/tentacled compare --out runs/compared
	@$(BIN)/python -m tests.docs

mutation: $(DEVELOPMENT)
	@nice -n 19 $(BIN)/python -m tests.mutation

# The lock files are what a clean environment resolves to today.
lock:
	@rm -rf build/lock && mkdir -p build && $(PYTHON) -m venv build/lock
	@build/lock/bin/pip --quiet install --upgrade pip "setuptools>=77"
	@build/lock/bin/pip --quiet install .
	@build/lock/bin/pip freeze --all --exclude tentacled --exclude pip > requirements.lock
	@build/lock/bin/pip --quiet install '.[test]'
	@build/lock/bin/pip freeze --all --exclude tentacled --exclude pip | sed 's/+cpu$$//' > requirements-test.lock
	@rm -rf build

clean:
	@rm -rf $(VENV) build *.egg-info
