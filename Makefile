# One virtual environment, two stamps: `make demo` installs only what the demo needs, everything else the whole house.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check
WORKERS ?= 2
# The tests of the page drive a real browser; without one they are left out, and the run says so.
CHROMIUM ?= $(shell command -v chromium || command -v chromium-browser || command -v google-chrome)
NO_BROWSER := $(if $(strip $(CHROMIUM)),, and not browser)
SAY_NO_BROWSER = $(if $(strip $(CHROMIUM)),,@echo "$@: the browser tests are LEFT OUT: no chromium on the PATH (Debian: apt-get install chromium)")

# More BLAS threads than free cores are far slower on the small matrices of the tests.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

.DEFAULT_GOAL := help
.PHONY: help setup demo test slow lint docs bench page clean

help: ## list the targets
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 8

setup: $(VENV)/.stamp-all ## make .venv with the package and everything to test, lint and document it

$(VENV)/.stamp-python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "Trigpoint needs Python 3.11 or later; '$(PYTHON)' is missing or older." \
	         "Name another one: make setup PYTHON=python3.12" >&2; exit 1; }
	@echo "setup: virtual environment $(VENV) ($$($(PYTHON) --version))"
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@touch $@

$(VENV)/.stamp-demo: pyproject.toml $(VENV)/.stamp-python
	@echo "setup: the package with what the demo needs"
	@$(PIP) -e '.[demo]'
	@touch $@

$(VENV)/.stamp-all: pyproject.toml $(VENV)/.stamp-python
	@echo "setup: the package with demo, test, lint and docs"
	@$(PIP) -e '.[demo,test,lint,docs]'
	@touch $@ $(VENV)/.stamp-demo

demo: $(VENV)/.stamp-demo ## run the demo
	@$(BIN)/trigpoint demo

lint: $(VENV)/.stamp-all ## style, types and the import contracts
	@echo "lint: ruff"
	@$(BIN)/ruff check --quiet .
	@$(BIN)/ruff format --check --quiet .
	@echo "lint: mypy --strict"
	@$(BIN)/mypy
	@echo "lint: import contracts"
	@PYTHONPATH=src $(BIN)/lint-imports

docs: $(VENV)/.stamp-all ## build the documentation, warnings are errors
	@echo "docs: sphinx"
	@$(BIN)/python -m sphinx -W --keep-going -n -q -b html docs docs/_build/html
	@echo "docs: docs/_build/html/index.html"

test: lint docs ## lint, docs and every test and doctest that is not slow
	$(SAY_NO_BROWSER)
	@echo "test: pytest"
	@$(BIN)/python -m pytest -q -n $(WORKERS) -m "not slow$(NO_BROWSER)" --doctest-modules --doctest-glob='*.md' src tests docs

slow: $(VENV)/.stamp-all ## the tests that take minutes
	$(SAY_NO_BROWSER)
	@echo "slow: pytest"
	@$(BIN)/python -m pytest -q -m "slow$(NO_BROWSER)" tests

bench: $(VENV)/.stamp-all ## every script in benchmarks/
	@for script in $(sort $(wildcard benchmarks/*.py)); do \
	  echo "bench: $$script"; $(BIN)/python $$script || exit 1; done
	@$(if $(wildcard benchmarks/*.py),,echo "bench: there is no benchmark yet")

PAGE := src/trigpoint/dashboard/web
page: ## build the page of `trigpoint watch` from its sources (needs node 20 and npm)
	@cd $(PAGE) && npm ci --silent --no-audit --no-fund && npm run --silent check && npm run --silent build

clean: ## remove what was built, except .venv
	rm -rf dist build docs/_build $(PAGE)/node_modules .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +
