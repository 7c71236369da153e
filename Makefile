# Python and make are all that a fresh machine needs.
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed

.PHONY: run memory test kernels long values mutants robots check pictures clean help

help: ## this list
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(STAMP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("skinnet needs Python 3.11 or newer; call make PYTHON=/path/to/python3.11" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test]'
	@touch $@

run: $(STAMP) ## the main job: a nursing robot holds a cylinder between its forearms and moves it by touch
	$(BIN)/skinnet run deployments/riba_cylinder.toml

memory: $(STAMP) ## teaches the HRP-2-like robot anew, and keeps what it learnt for hrp2_grasp
	$(BIN)/skinnet run deployments/hrp2_teach.toml --no-plots --out runs/hrp2_teach
	$(BIN)/skinnet memory export runs/hrp2_teach/memory.sqlite --out deployments/hrp2_memory.json

check: $(STAMP) ## style, types and import contracts
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

kernels: $(STAMP) ## compiles what most tests need
	$(BIN)/python tests/support/kernels.py

# The tests start hundreds of processes, each of which would compile all sources anew without bytecode.
test: export PYTHONDONTWRITEBYTECODE =
test: $(STAMP) ## everything that must hold
	@$(MAKE) --no-print-directory --jobs=2 check kernels
	$(BIN)/pytest -n logical --dist loadfile

long: $(STAMP) ## the tests that take too long for `test`: whole grasps, teaching, more seeds
	$(BIN)/pytest -n logical -m long

values: $(STAMP) ## runs every shipped deployment and compares values and metrics with the frozen ones
	$(BIN)/python tests/support/frozen_values.py

mutants: $(STAMP) ## puts 300 small faults into the code, one at a time, and says which ones no test notices (hours; goes on)
	$(BIN)/python tests/support/mutants.py --count 300 --results build/mutants.jsonl

robots: $(STAMP) ## puts skin on a dozen robots of other projects, whose models it fetches, and reports (an hour)
	$(BIN)/skinnet bench robots --fetch --json robots.json

pictures: $(STAMP) ## makes every picture of README.md and docs/ anew (docs/images/pictures.toml)
	$(BIN)/python docs/pictures.py

clean: ## removes the environment and all caches
	rm -rf $(VENV) build runs *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
