# bow from a fresh clone: `make sweep` and `make test` do everything. What the set-up does is in tools/setup_env.py.

PYTHON ?= python3
ARGS ?=
VENV := .venv/bin

# A sourced ROS installation or another environment of ROS wheels would send .venv's Python to other libraries, or to a
# middleware that is not in the wheels.
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH
unexport LD_LIBRARY_PATH ROS_DISTRO ROS_VERSION ROS_PYTHON_VERSION RMW_IMPLEMENTATION VIRTUAL_ENV

.DEFAULT_GOAL := help
.PHONY: help setup setup-tests sweep lint types test test-fast test-full bench dist docs diagrams format clean python

help:
	@echo 'make sweep       set up, then run the recorded basin map fig11d (more: make sweep ARGS="--view")'
	@echo 'make test        set up, then lint, types and all tests'
	@echo 'make setup       only the environment, .venv (PYTHON=python3.12 for another Python, UV=no for pip)'
	@echo 'make test-fast   set up, then lint, types and the fast tests'
	@echo 'make bench       kernel and graph against peers'
	@echo 'make docs        these pages and a reference as a site, docs/_build/html'
	@echo 'make dist        wheels of bow and bow_msgs and an sdist, in dist/: they install without a compiler'
	@echo 'make format      put the sources into the house format'
	@echo 'make clean       remove .venv, builds and caches; runs/ stays'

python:
	@command -v $(PYTHON) >/dev/null || { echo "setup: no $(PYTHON) here; on Debian:" \
	  "sudo apt-get install python3 python3-venv python3-dev g++" >&2; exit 1; }

# A Python named by the user, PYTHON=..., is the one .venv shall have; otherwise an existing .venv keeps its own.
this_python := $(if $(filter file,$(origin PYTHON)),,--this-python)

setup: python
	@$(PYTHON) tools/setup_env.py $(this_python)

setup-tests: python
	@$(PYTHON) tools/setup_env.py --tests $(this_python)

sweep: setup
	@$(VENV)/bow sweep fig11d $(ARGS)

lint: setup-tests
	$(VENV)/ruff check .
	$(VENV)/ruff format --check .

types: setup-tests
	$(VENV)/mypy

# Tests run two at a time, those of a file in one process; what is marked alone, as tests with a graph are, comes
# afterwards. `make test TWO=` runs all one at a time. With ARGS there may be none of a kind (5).
PYTEST := $(VENV)/python -m pytest --durations 20 --durations-min 5
TWO := --numprocesses 2 --dist loadfile
NONE := $(if $(ARGS),|| test $$? = 5)

test-fast: lint types
	$(PYTEST) -m "not full and not alone" $(TWO) $(ARGS) $(NONE)
	$(PYTEST) -m "not full and alone" $(ARGS) $(NONE)

# The fast tier first, so that what is simply broken shows in a minute.
test: test-fast
	$(PYTEST) -m "full and not alone" $(TWO) $(ARGS) $(NONE)
	$(PYTEST) -m "full and alone" $(ARGS) $(NONE)

bench: setup-tests
	$(VENV)/python -m bench $(ARGS)

# For machines of this kind (Linux, processor, release of Python): the interfaces are compiled.
dist: setup-tests
	$(VENV)/python -m build --outdir dist .
	$(VENV)/python -m build --wheel --outdir dist msg_defs

# Warnings are errors: a page or a docstring that Sphinx does not understand is one that nobody can read.
docs: setup-tests
	@$(VENV)/sphinx-build --quiet --fresh-env --fail-on-warning --keep-going --builder html docs docs/_build/html
	@echo 'docs: open docs/_build/html/index.html'

# Needs Graphviz; the pictures are in the repository, so only who changes them needs it.
diagrams: python
	@$(PYTHON) tools/diagrams.py

format: setup-tests
	$(VENV)/ruff check --fix-only .
	$(VENV)/ruff format .

clean:
	rm -rf .venv build install log dist docs/_build docs/reference/generated *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
