# The two that matter: make demo, make test. Both set up everything in .venv first.
BIN := .venv/bin
PYTEST := $(BIN)/python -m pytest
SPHINX := $(BIN)/python -m sphinx -n -W --keep-going -q -j 2 -d docs/_build/doctrees
# The processes of a test run share the cores: matrix products in several threads each would only compete.
export OPENBLAS_NUM_THREADS ?= 1
# Tests start many processes; without bytecode, each would compile the package.
unexport PYTHONDONTWRITEBYTECODE
# An index out of bounds in a kernel overwrites memory silently; these tests run with bounds checks too.
KERNEL_TESTS := $(addprefix tests/unit/,kernels association triangulation left_right tracking trajectory kinematics biomechanics)
LOCK := pyproject.toml uv.lock scripts/bootstrap.sh

.PHONY: demo test test-long check lint types borders format benchmark docs docs-fast docs-links clean

demo: .venv/.installed
	$(BIN)/posefuse demo --output demo

test: .venv/.installed-dev
	$(BIN)/posefuse warm-up
	$(PYTEST) -n 2 --dist worksteal
	NUMBA_DISABLE_JIT=1 $(PYTEST) -n 2 -m no_jit

test-long: .venv/.installed-dev
	POSEFUSE_EXAMPLES_FACTOR=40 $(PYTEST) -n 2 -m hypothesis
	$(PYTEST) -n 2 -m long
	NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=.pytest_cache/bounds $(PYTEST) -n 2 $(KERNEL_TESTS)
	$(MAKE) docs

check: lint types borders

lint: .venv/.installed-dev
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/python scripts/check_vocabulary.py
	$(BIN)/codespell
	$(BIN)/check-jsonschema -qq --builtin-schema vendor.github-workflows .github/workflows/*.yml
	$(BIN)/check-jsonschema -qq --builtin-schema vendor.github-issue-forms .github/ISSUE_TEMPLATE/[!c]*.yml

types: .venv/.installed-dev
	$(BIN)/pyright

borders: .venv/.installed-dev
	$(BIN)/lint-imports

format: .venv/.installed-dev
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

# The site with the gallery executed: docs/_build/html/index.html.
docs: .venv/.installed-dev
	$(SPHINX) -b html docs docs/_build/html

# The same pages and checks, but the examples of the gallery do not run.
docs-fast: .venv/.installed-dev
	POSEFUSE_GALLERY=off $(SPHINX) -b html docs docs/_build/fast

# Needs the network.
docs-links: .venv/.installed-dev
	POSEFUSE_GALLERY=off $(SPHINX) -b linkcheck docs docs/_build/linkcheck

benchmark: .venv/.installed-dev
	$(BIN)/python benchmarks/run.py

.venv/.installed: $(LOCK)
	sh scripts/bootstrap.sh --no-dev
	@touch $@

.venv/.installed-dev: $(LOCK)
	sh scripts/bootstrap.sh --all-extras --group docs
	@touch .venv/.installed $@

clean:
	rm -rf docs/_build docs/generated docs/gallery .venv demo .pytest_cache .ruff_cache .hypothesis
