# The verbs of RONA. Everything is installed into .venv; a second call finds its stamp and is instant.
#
#   make run           install, start the server and open its start page
#   make test          install what the tests need, and run the quick ones
#   make test-all      run every test: before a release (EXAMPLES=10 for ten times as many of each property)
#   make mutants       change the code in small ways and count what the tests notice (ARGS=--all)
#   make check         style, types, import contracts and architecture
#   make bench         figures beside those of peers (SUITE=path for one suite, JSON=1 a list, FULL=1 all seeds)
#   make profile       CPU time of a procedure by steps and functions (SEED=3, KEEP=1)
#   make metrics       write the tables of docs/metrics.md from the declared figures
#   make reliability   kills, cuts, floods, broken files, two programs on one file (FULL=1)
#   make accuracy      how wrong and how honest the boundary maps are, what fusion brings (FULL=1)
#   make demo          the whole procedure in the terminal, without a browser (SEED=3)
#   make demo-session  make sessions/demo.rona anew
#   make viewers       read exported files in VTK and SimpleITK, installed beside the project
#   make pictures      take the pictures of the user guide anew, in a headless browser
#   make animation     play the guided demo in a browser and make the animated picture of the README
#   make screens       take screenshots of all pages, light and dark, in two sizes, into build/screens
#   make gallery       draw the pictures of the examples anew
#   make api           write the reference of the public packages to build/api
#   make settings      write docs/settings.md from the declarations of the fields
#   make interoperability  write docs/interoperability.md from files of poses of every kind
#   make constraints   refresh the pinned versions
#   make clean         remove what the verbs made

SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
.DEFAULT_GOAL := help
.PHONY: help run test test-all mutants gallery api settings interoperability check bench viewers profile metrics reliability accuracy demo demo-session pictures animation screens constraints clean venv product browser

PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := -m pip install --quiet --disable-pip-version-check
PINNED := -c constraints.txt
RECIPE := pyproject.toml setup.py constraints.txt
SUITE ?=
SEED ?= 0
ONE_THREAD := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1
# many tests start a program: it would compile every module again, were byte code not kept
COMPILED := PYTHONDONTWRITEBYTECODE=
# all tests have three workers on two cores, since they wait for browsers and servers: one drives the browsers,
# the others take the files first that took longest in the last run (tests/conftest.py)
IN_FILES := --dist loadfile --no-loadscope-reorder
# the quick tests; .ci/run adds what is marked "ci": chains of steps, a whole procedure, a walk through a browser
TIER ?= not slow
# how many examples are drawn of each property, times those that it names
QUICK_EXAMPLES ?= 0.15
EXAMPLES ?= 1
# suites of `make reliability`
RELIABILITY := kills saving stop connections readers
# seconds: stops a run that hangs
TEST_LIMIT ?= 3600

help:
	@sed -n 's/^#   //p' Makefile

# -- environments -----------------------------------------------------------------------------

define make_venv
	@if ! $(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))'; then \
	    echo "RONA needs Python 3.11 or later; name one: make PYTHON=python3.11 $(MAKECMDGOALS)"; \
	    exit 1; \
	fi
	@if ! $(PYTHON) -c 'import ensurepip, venv' 2>/dev/null; then \
	    if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	        apt-get update -qq && \
	        DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends python3-venv; \
	    else \
	        echo "Python has no venv here. Run: sudo apt-get install python3-venv"; exit 1; \
	    fi; \
	fi
	$(PYTHON) -m venv $(1)
endef

$(BIN)/python:
	$(call make_venv,$(VENV))

$(VENV)/.product: $(RECIPE) | $(BIN)/python
	$(BIN)/python $(PIP) $(PINNED) -e .
	@touch $@

$(VENV)/.test: $(VENV)/.product
	$(BIN)/python $(PIP) $(PINNED) -e '.[test]'
	@touch $@

$(VENV)/.dev: $(VENV)/.test
	$(BIN)/python $(PIP) $(PINNED) -e '.[dev]'
	@touch $@

.venv-bench/.bench: $(RECIPE)
	$(call make_venv,.venv-bench)
	.venv-bench/bin/python $(PIP) $(PINNED) -e '.[bench]'
	@touch $@

.venv-viewers/.viewers: $(RECIPE)
	$(call make_venv,.venv-viewers)
	.venv-viewers/bin/python $(PIP) $(PINNED) -e '.[test,viewers]'
	@touch $@

venv: $(BIN)/python
product: $(VENV)/.product

# -- the browser that the tests drive -----------------------------------------------------------

browser: $(VENV)/.test
	@PYTHON=$(BIN)/python bash tests/tools/install_browser.sh

# -- verbs ----------------------------------------------------------------------------------------

run: $(VENV)/.product
	$(BIN)/rona serve

demo: $(VENV)/.product
	$(BIN)/rona demo --seed $(SEED)

PYTEST := $(ONE_THREAD) $(COMPILED) timeout --foreground --kill-after=20 $(TEST_LIMIT) $(BIN)/python -m pytest

test: $(VENV)/.test
	RONA_EXAMPLES=$(QUICK_EXAMPLES) $(PYTEST) -n 2 $(IN_FILES) -m "$(TIER)" $(ARGS)

test-all: $(VENV)/.test browser
	RONA_EXAMPLES=$(EXAMPLES) $(PYTEST) -n 3 $(IN_FILES) $(ARGS)

viewers: .venv-viewers/.viewers
	$(ONE_THREAD) .venv-viewers/bin/python -m pytest -q tests/core/mapping/files tests/core/devices/files/test_igs_mha.py $(ARGS)

mutants: $(VENV)/.test
	RONA_EXAMPLES=$(QUICK_EXAMPLES) $(ONE_THREAD) $(BIN)/python -m tests.tools.mutants $(ARGS)

gallery: $(VENV)/.product
	$(ONE_THREAD) $(BIN)/python -m examples.gallery

api: $(VENV)/.product
	$(BIN)/python -m docs.guide.api_reference build/api

settings: $(VENV)/.product
	$(BIN)/python -m docs.guide.settings_page

interoperability: $(VENV)/.product
	$(BIN)/python -m docs.guide.interoperability_page

check: $(VENV)/.dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyrefly check --python-interpreter-path $(BIN)/python
	$(BIN)/python -m pytest -q tests/test_architecture.py tests/test_prose.py tests/test_types.py

bench: .venv-bench/.bench
	$(ONE_THREAD) .venv-bench/bin/python -m benchmarks $(SUITE) $(if $(JSON),--json) $(if $(FULL),--full)

profile: $(VENV)/.product
	$(ONE_THREAD) $(BIN)/python -m benchmarks.procedure_profile --seed $(SEED) $(if $(KEEP),--keep)

demo-session: $(VENV)/.product
	$(BIN)/rona demo --seed 0 --out sessions/demo.rona

pictures: $(VENV)/.test
	RONA_SCREENSHOTS=1 $(BIN)/python -m pytest -q tests/ui/browser/test_browser.py -k "copy_of_the_demo or by_hand"

animation: $(VENV)/.test browser
	$(BIN)/python -m tests.tools.animation

screens: $(VENV)/.test
	$(BIN)/python -m tests.tools.screens

metrics: $(VENV)/.product
	$(BIN)/python -m benchmarks.metrics_page

accuracy: $(VENV)/.product
	$(ONE_THREAD) $(BIN)/python -m benchmarks accuracy $(if $(FULL),--full)

reliability: $(VENV)/.product
	$(ONE_THREAD) $(BIN)/python -m benchmarks $(RELIABILITY) $(if $(FULL),--full)

constraints: $(BIN)/python
	@rm -rf build/constraints && $(PYTHON) -m venv build/constraints
	build/constraints/bin/python $(PIP) -e '.[dev]'
	{ sed -n '/^#/p' constraints.txt; \
	  build/constraints/bin/python -m pip freeze --exclude-editable; } > build/constraints.txt
	mv build/constraints.txt constraints.txt
	@rm -rf build/constraints

clean:
	rm -rf $(VENV) .venv-bench build dist *.egg-info .pytest_cache .ruff_cache .hypothesis \
	    .import_linter_cache tests/ui/output
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
