# Everything a checkout needs; `make help` lists it. Each target sets up .venv first if it must.

VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/.installed
TORCH  := $(shell grep '^torch==' constraints.txt)
# The first interpreter that really starts, has venv, and is of a supported version.
PYTHON ?= $(shell for p in python3.11 python3.12 python3.13 python3; do \
	$$p -c 'import ensurepip, sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' \
	2>/dev/null && echo $$p && break; done)
# Test processes, each on one thread: two of them beat one with two threads. They start a hundred
# others, which are to find what the first one compiled, wherever Python was told to keep nothing.
WORKERS ?= 2
PYTEST  := PYTHONDONTWRITEBYTECODE= OMP_NUM_THREADS=1 $(BIN)/pytest -n $(WORKERS) --max-worker-restart=0

.PHONY: help env fit demo test pytest test-long lint format bench docs stranger wheel-smoke docker docker-run
.DEFAULT_GOAL := help

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "  make %-12s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

env: $(STAMP) ## set up .venv (1 to 3 minutes; nothing to do if nothing changed)

# torch first and by exact version: left to the resolver, CUDA packages of gigabytes may come.
$(STAMP): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "error: no Python 3.11 to 3.13 with venv found;" \
		"install one or say which: make env PYTHON=/path/to/python3" >&2; exit 1; }
	@echo "environment: $(VENV) with $(PYTHON)"
	@$(PYTHON) -m venv $(VENV)
	@echo "environment: installing $(TORCH)"
	@$(BIN)/pip install -qq --disable-pip-version-check "$(TORCH)"
	@echo "environment: installing the rest (a minute; 2 to 3 where uv is not to be had)"
	@rest="-c constraints.txt -e .[dev]"; \
		{ $(BIN)/pip install -qq --disable-pip-version-check uv && \
		$(BIN)/uv pip install -q --python $(BIN)/python $$rest; } || \
		$(BIN)/pip install -qq --disable-pip-version-check $$rest
	@touch $@

fit: env ## train, evaluate and register World Translation on the simulated R5
	$(BIN)/wt fit --config conf/r5.yaml $(ARGS)

demo: env ## both halves on small examples, a minute and a half: leaves demo/
	$(BIN)/wt demo $(ARGS)

test: env ## lint, types and all tests
	@$(MAKE) --no-print-directory -j2 lint pytest

pytest: env ## the tests alone
	$(PYTEST) $(ARGS)

test-long: env ## the tests that take minutes each, which test leaves out
	$(PYTEST) -m long $(ARGS)

lint: env ## ruff, its formatter and mypy
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --check --quiet .
	$(BIN)/mypy

format: env ## lay the code out as lint wants it
	$(BIN)/ruff check --fix --quiet .
	$(BIN)/ruff format --quiet .

# Those that take an hour or more, or a part of the machine for themselves, are run by hand: trials, toys, firmware, real and the public
# robots, and the long forms of envs, diagnose and stream; each says how in its first lines.
bench: env ## print the tables of speed
	$(BIN)/python benchmarks/steps.py
	$(BIN)/python benchmarks/bare.py
	$(BIN)/python benchmarks/collect.py
	$(BIN)/python benchmarks/train.py
	$(BIN)/python benchmarks/runner.py
	$(BIN)/python benchmarks/watched.py
	$(BIN)/python benchmarks/drift.py
	$(BIN)/python benchmarks/finetune.py
	$(BIN)/python benchmarks/envs.py --short
	$(BIN)/python benchmarks/diagnose.py --seconds 10
	$(BIN)/python benchmarks/stream.py --short

docs: env ## build the documentation's site: leaves site/
	$(BIN)/pip install -qq --disable-pip-version-check -c constraints.txt -e '.[docs]'
	$(BIN)/mkdocs build --strict

stranger: ## what a stranger does first, in a fresh clone: set up, make demo, open each product
	tests/end_to_end/stranger.sh

wheel-smoke: ## build the wheel, install it in fresh environments, run the smoke test
	PYTHON=$(PYTHON) tests/wheel_smoke.sh

docker: ## the same in a container, which stays as the image world-translation
	docker build -t world-translation --target whole .

docker-run: ## a small image with wt-run alone, as world-translation-run
	docker build -t world-translation-run --target run .
