PYTHON ?= python3.11
VENV ?= .venv
BIN := $(VENV)/bin
INSTALLED := $(VENV)/.installed
INSTALLED_DOCS := $(VENV)/.installed-docs

PYTEST_ARGS ?= -n auto
FUZZ_INPUTS ?= 2000
DEMO_RUN ?= runs/demo
DEMO_TRAIN ?= -m train ppo --out $(DEMO_RUN) --overwrite
DEMO_SCORE ?= -m eval score $(DEMO_RUN)

.DEFAULT_GOAL := help
.DELETE_ON_ERROR:
.PHONY: help test coverage check docs site lint types layers wheel clients workbench fuzz compat demo drill pin clean

help: ## this list
	@awk -F ':.*## ' '/^[a-z]+:.*## / { printf "make %-9s %s\n", $$1, $$2 }' $(firstword $(MAKEFILE_LIST))

demo: $(INSTALLED) ## train PPO on the paper's scene and score it against the oracle
	$(BIN)/python $(DEMO_TRAIN)
	$(BIN)/python $(DEMO_SCORE)

test: $(INSTALLED) ## install once into .venv, run the tests
	$(BIN)/python -m pytest $(PYTEST_ARGS)

coverage: $(INSTALLED) ## the tests, and the share of lines and branches that they run
	$(BIN)/python -m pytest $(PYTEST_ARGS) --cov --cov-report=term

check: lint types layers wheel ## ruff, mypy, import layers, the wheel

lint: $(INSTALLED) ## ruff: style and format
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(INSTALLED) ## mypy
	$(BIN)/mypy

layers: $(INSTALLED) ## import-linter: who may import whom
	$(BIN)/lint-imports

wheel: $(INSTALLED) ## build the wheel, install it alone, step the environment
	$(BIN)/python .ci/check_wheel.py

site: $(INSTALLED_DOCS) ## the site into build/docs: every notebook run, every link checked
	$(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet -b html docs build/docs

docs: site ## the site, and the examples in docstrings
	$(BIN)/python -m pytest $(PYTEST_ARGS) --quiet tests/test_doctests.py

clients: $(INSTALLED) ## the blocks of code for other libraries, each in an environment of its own
	$(BIN)/python .ci/clients.py $(CLIENTS)

workbench: $(INSTALLED) ## the workbench's page in a headless Chromium, which the machine must have
	$(BIN)/python .ci/workbench.py

fuzz: $(INSTALLED) ## hostile scenes, maps, arguments, run folders, command lines: FUZZ_INPUTS of each (2000)
	$(BIN)/python tests/fuzz.py --inputs $(FUZZ_INPUTS)

compat: ## the tests of irs_gym on Python 3.11 to 3.13, each with the oldest and the latest Gymnasium
	$(PYTHON) .ci/compat.py

drill: $(INSTALLED) ## kill a training ten times, resume it, and hold it against one left in peace
	$(BIN)/python .ci/kill_drill.py

$(INSTALLED): pyproject.toml constraints.txt | $(BIN)/python
	@echo "Installing irs_gym, its trainers and its test tools into $(VENV): a few minutes, once"
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[train,test,sweep]" -c constraints.txt
	@touch $@

$(INSTALLED_DOCS): $(INSTALLED)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e ".[docs]" -c constraints.txt
	@touch $@

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# torch moves by hand, once all its builds (CPU and CUDA) are out. Each build has a tag (+cpu) and GPU packages of its
# own, which are left out, so that the pins hold for any of them.
PIN_TORCH ?= torch==2.13.0

pin: ## write constraints.txt anew
	tmp=$$(mktemp -d) && trap 'rm -rf "$$tmp"' EXIT && $(PYTHON) -m venv "$$tmp" && \
	"$$tmp/bin/python" -m pip install --quiet ".[train,test,sweep,play,sionna,peers,workbench,docs,datasets]" "$(PIN_TORCH)" playwright && \
	"$$tmp/bin/python" -m pip freeze --all --exclude pip --exclude irs_gym > "$$tmp/freeze" && \
	sed -e 's/+.*//' -e '/^nvidia/d' -e '/^cuda/d' -e '/^triton/d' "$$tmp/freeze" > "$$tmp/constraints.txt" && \
	mv "$$tmp/constraints.txt" constraints.txt

clean: ## remove .venv, caches and builds (runs/ stays)
	rm -rf $(VENV) build dist docs/environments docs/api docs/models docs/changelog.md docs/contributing.md .coverage .hypothesis .import_linter_cache .mypy_cache .pytest_cache .ruff_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
