# Python >= 3.11 and make are all that a fresh machine needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.stamp

# small matrices: threads of a linear-algebra library cost more than they bring
export OPENBLAS_NUM_THREADS ?= 1
# tests start hundreds of interpreters: what one compiled the others load
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help setup fly demo paper test lint types types-packages types-tests contracts compiled tests quick flights bench study pictures blind docs docs-check wheel-check clean

help:  ## this list
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 12

setup: $(STAMP)  ## make or refresh .venv with the pinned packages; leaves .venv/bin/tippath

$(STAMP): pyproject.toml constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "tippath needs Python 3.11 or newer; try: make PYTHON=python3.12"; exit 1; }
	$(PYTHON) -m venv --clear $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

fly: $(STAMP)  ## open the app on the bundled simulated vehicle
	$(BIN)/tippath fly --sim hover

demo: $(STAMP)  ## the whole flight test, unattended, without a terminal
	$(BIN)/tippath demo

paper: $(STAMP)  ## the paper's tables and figures from simulated flights, ours beside the printed, into DIR; half an hour, goes on where it was
	$(BIN)/tippath paper -o $${DIR:-paper}

test: $(STAMP)  ## every check
	@$(MAKE) --no-print-directory -j2 lint types contracts compiled
	@$(MAKE) --no-print-directory tests

lint: $(STAMP)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .

types: types-packages types-tests

types-packages: $(STAMP)
	$(BIN)/mypy

types-tests: $(STAMP)
	$(BIN)/mypy --config-file tests/mypy.ini

contracts: $(STAMP)
	$(BIN)/lint-imports

compiled: $(STAMP)  # the tests are rewritten once, not by every process that runs them
	@$(BIN)/python -m pytest --collect-only -qq > $(VENV)/compiled.log 2>&1 || { cat $(VENV)/compiled.log; exit 1; }

tests: $(STAMP)  # what flies in real time mostly waits: it has a process of its own beside the others
	@$(MAKE) --no-print-directory -j2 flights quick

quick: $(STAMP)
	$(BIN)/python -m pytest -m 'not realtime and not thorough' --numprocesses 3 --dist loadfile

flights: $(STAMP)
	@$(BIN)/python -m pytest -m 'realtime and not thorough' $$(grep -rl --include='test_*.py' 'mark\.realtime' tests) > $(VENV)/flights.log 2>&1; status=$$?; echo; cat $(VENV)/flights.log; exit $$status

bench: $(STAMP)  ## speed, as ratios against peers in the same run
	$(BIN)/python -m pytest tests/benchmarks --override-ini 'python_files=bench_*.py' --override-ini 'python_functions=bench_*' -s -q

study: $(STAMP)  ## what only many flights show: optimum, honest errors, every effect planted; an hour
	$(BIN)/python -m pytest -m thorough --numprocesses auto --dist loadfile
	$(BIN)/python -m pytest tests/study --override-ini 'python_files=study_*.py' --override-ini 'python_functions=study_*' -s -q

pictures: $(STAMP)  ## every screen as PNG in every theme and size, into DIR; with FLIGHT what the app shows of that
	PYTHONPATH=.:tests $(BIN)/python tests/gcs/tui/draw_screens.py $${DIR:-pictures} $${FLIGHT:+--flight $$FLIGHT} $${SIZES:+--sizes $$SIZES} $${THEMES:+--themes $$THEMES}

blind: $(STAMP)  ## COUNT flights from seed FIRST that hide something or nothing, into FILE; stops after BUDGET minutes, goes on where it was
	$(BIN)/python tests/study/blind.py $${FILE:-blind.jsonl} --first $${FIRST:-1000000} --count $${COUNT:-300} $${BUDGET:+--budget $$BUDGET}
	$(BIN)/python tests/study/judge.py $${FILE:-blind.jsonl} --by-size

docs: $(VENV)/.docs-stamp  ## the site into build/docs/html; needs no network, to be made or to be read
	$(BIN)/python docs/site/stage.py build/docs/pages
	$(BIN)/python -m sphinx -b html -W --keep-going --quiet -c docs/site build/docs/pages build/docs/html
	@echo "open build/docs/html/index.html"

docs-check: docs  ## the site's links, and the first flight as its page says, live; some three minutes
	$(BIN)/python tests/docs/first_flight.py $(BIN)/tippath

wheel-check: $(STAMP)  ## a wheel built, installed in an empty environment, and the first flight with it from another folder
	rm -rf build && mkdir -p build
	$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir build/wheel .
	$(PYTHON) -m venv build/installed
	build/installed/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt build/wheel/*.whl
	@ls -l build/wheel
	@cd / && $(CURDIR)/build/installed/bin/python -X importtime -c 'import gcs.cli' 2>&1 | tail -n 1
	$(BIN)/python tests/docs/first_flight.py build/installed/bin/tippath

$(VENV)/.docs-stamp: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	@touch $@

clean:  ## remove what setup and the tests made
	rm -rf $(VENV) build .mypy_cache .ruff_cache .pytest_cache .import_linter_cache tippath.egg-info
