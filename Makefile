# Everything a newcomer needs. `make help` lists the targets; each sets up .venv first if it is missing or out of date.

SHELL := /bin/bash
.DEFAULT_GOAL := help

VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DOCS_STAMP := $(VENV)/.docs

# Number of test processes; one per core of a small machine.
JOBS = 2
# A Python to build .venv with. Empty: python3 if it is 3.11, else python3.11, because pybullet has wheels for 3.11 only.
PYTHON =
# Extras that `make test-stacks` tests: training libraries, and Ray for studies.
STACKS = train sb3 rllib torchrl benchmarl ray
# What `make test-bounds` runs with every index of a kernel checked, and where it keeps the kernels compiled for that.
BOUNDS_TESTS = tests/unit/planners tests/unit/maps tests/unit/fleet tests/contract
BOUNDS_DIR = build/bounds
# Further words for the command, such as ARGS="--site small --robots 8".
ARGS =

# Tells of every twentieth package that pip comes to, and when it has fetched all of them: minutes pass, also where no bar can be drawn.
PIP_PROGRESS = { n=0; while IFS= read -r line; do case "$$line" in \
  Collecting*) n=$$((n + 1)); if [ $$((n % 20)) -eq 0 ]; then echo "$$n packages looked up and fetched so far, of about 110"; fi;; \
  "Installing collected packages"*) echo "All fetched; unpacking them takes a minute or two.";; \
  esac; done; }

.PHONY: help setup demo test test-long test-all test-rules test-bounds test-stacks test-interop notebooks zoo check format bench docs hooks hooks-check clean

help: ## List the targets.
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-12s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

setup: $(STAMP) ## Create .venv and install the project with what the guide's examples need.

# Kernels that were kept by an older source are thrown away: some cannot be read after a rename.
$(STAMP): pyproject.toml
	@set -e -o pipefail; \
	python="$(PYTHON)"; \
	if [ -z "$$python" ]; then \
	  for name in python3 python3.11; do \
	    if "$$name" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' >/dev/null 2>&1; then python="$$name"; break; fi; \
	  done; \
	fi; \
	if [ -z "$$python" ]; then \
	  echo "make: Python 3.11 is missing (found: $$(python3 --version 2>&1 | head -n 1)). pybullet has ready wheels for 3.11 only: install python3.11, or name one with 'make PYTHON=/path/to/python3.11 ...'." >&2; \
	  exit 1; \
	fi; \
	if ! "$$python" -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	  echo "make: PYTHON=$$python is not Python 3.11 or newer; install python3.11, or name one with 'make PYTHON=/path/to/python3.11 ...'." >&2; \
	  exit 1; \
	fi; \
	if ! "$$python" -c 'import ensurepip, venv' >/dev/null 2>&1; then \
	  echo "make: $$python cannot create virtual environments: its venv module is missing (Debian, Ubuntu: apt-get install python3.11-venv)." >&2; \
	  exit 1; \
	fi; \
	echo "Setting up $(VENV) with $$("$$python" --version); the first time takes a few minutes: about 700 MB to fetch, 2 GB on the disk."; \
	if ! $(BIN)/python -c '' >/dev/null 2>&1; then "$$python" -m venv --clear $(VENV); fi; \
	find fleet maps planners -name "*.nb[ic]" -delete; \
	$(BIN)/python -m pip install --progress-bar off --disable-pip-version-check --editable '.[dev,interop,mcap,notebook,open-floor,rmf,ros,vda5050]' \
	  2> >(grep -v '^WARNING: ' >&2) | $(PIP_PROGRESS); \
	echo "Compiling the kernels once, about half a minute."; \
	out=$$(mktemp -d); \
	$(BIN)/python -m fleet.demo --site cell --robots 1 --tasks 1 --duration 8 --out "$$out" >/dev/null; \
	rm -rf "$$out"; \
	touch $@

demo: $(STAMP) ## Three cars and the arms of a site deliver parcels; ARGS adds options.
	@$(BIN)/python -m fleet.demo --robots 3 $(ARGS)

test: $(STAMP) ## The tests, but those of whole runs and pages and the slow ones.
	@$(BIN)/python -m pytest -q -m "not slow and not long and not interop" -n $(JOBS) --dist loadfile $(ARGS)

test-long: $(STAMP) ## The tests of whole runs, of the pages of the guide and of the benchmarks.
	@$(BIN)/python -m pytest -q -m "long and not slow and not interop" -n $(JOBS) --dist loadfile $(ARGS)

test-all: $(STAMP) ## All tests, but for those with foreign partners.
	@$(BIN)/python -m pytest -q -m "not interop" -n $(JOBS) --dist loadfile $(ARGS)

notebooks: $(STAMP) ## Run all notebooks and write them as pages into build/notebooks; ARGS names some.
	@$(BIN)/python -m notebooks $(ARGS)

test-rules: $(STAMP) ## Line coverage of the dispatch rules by their unit tests alone.
	@NUMBA_DISABLE_JIT=1 $(BIN)/python -m pytest -q tests/unit/fleet/missions tests/unit/fleet/dispatch \
	  --cov=fleet.missions --cov=fleet.dispatch --cov-fail-under=85 $(ARGS)

test-bounds: $(STAMP) ## With the indices of all kernels checked: their tests and a run of every site; slow.
	@set -e; mkdir -p $(BOUNDS_DIR); export NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR="$(CURDIR)/$(BOUNDS_DIR)/kernels"; \
	$(BIN)/python -m pytest -q -m "not slow" -n $(JOBS) --dist loadfile $(BOUNDS_TESTS) $(ARGS); \
	for site in maps/data/*.toml; do for fidelity in grid kinematic physics; do \
	  echo "$$site, $$fidelity"; \
	  $(BIN)/python -m fleet.demo --site "$$site" --fidelity $$fidelity --robots 3 --tasks 6 --duration 60 --battery --lidar \
	    --out $(BOUNDS_DIR)/run >$(BOUNDS_DIR)/run.txt 2>&1 || { cat $(BOUNDS_DIR)/run.txt; exit 1; }; \
	done; done

test-stacks: $(STAMP) ## One environment for each training library and Ray, in .stacks, and its tests; STACKS chooses.
	@set -e; \
	for stack in $(STACKS); do \
	  python=.stacks/$$stack/bin/python; \
	  echo "$$stack: setting up .stacks/$$stack, one or two gigabytes"; \
	  if ! $$python -c '' >/dev/null 2>&1; then $(BIN)/python -m venv --clear .stacks/$$stack; fi; \
	  $$python -m pip install --quiet --quiet --disable-pip-version-check --editable ".[$$stack]" pytest; \
	  $$python -m pytest -q tests/stacks/test_$$stack*.py $(ARGS); \
	done

test-interop: $(STAMP) ## Set up programs of others (ROS, vda-5050-lib, mosquitto and more) and run the tests that need them.
	@$(BIN)/python -m tests.interop $(ARGS)

zoo: $(STAMP) ## Every scenario of the deadlock zoo with every fidelity, and the page of results; slow.
	@$(BIN)/python -m tests.zoo --out docs/zoo.md $(ARGS)

check: $(STAMP) ## Linter, formatter, type checker, import rules.
	@$(BIN)/ruff check
	@$(BIN)/ruff format --check
	@$(BIN)/mypy
	@$(BIN)/lint-imports

format: $(STAMP) ## Repair what the linter and the formatter can.
	@$(BIN)/ruff check --fix
	@$(BIN)/ruff format

bench: $(STAMP) ## Every benchmark, with few repetitions.
	@$(BIN)/python -m benchmarks --quick $(ARGS)

$(DOCS_STAMP): $(STAMP)
	@$(BIN)/python -m pip install --quiet --quiet --disable-pip-version-check --editable '.[docs]'
	@touch $@

docs: $(DOCS_STAMP) ## The site, in build/site; a link that leads nowhere or a docstring that cannot be read ends it.
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict $(ARGS)
	@echo "build/site/index.html"

hooks: $(STAMP) ## Let git run the pre-commit hooks before each commit.
	@$(BIN)/pre-commit install

hooks-check: $(STAMP) ## Run the pre-commit hooks on all files.
	@$(BIN)/pre-commit run --all-files

clean: ## Remove .venv, caches and the output of runs.
	@rm -rf $(VENV) .venv-ros .partners .stacks .coverage .import_linter_cache .mypy_cache .pytest_cache .ruff_cache build dist runs
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +
