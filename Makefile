# Each target works on a fresh machine with Python 3.11 or newer, git and a package registry; a second run is instant.
PYTHON ?= python3
VENV ?= .venv
JOBS ?= 2

BIN := $(abspath $(VENV))/bin
READY := $(VENV)/.ready
EXTRAS := --extra planning --extra kitchen --extra control --extra pipeline --extra dask --extra dev

export VIRTUAL_ENV := $(abspath $(VENV))
export PATH := $(BIN):$(PATH)
export DVC_NO_ANALYTICS := 1
# Parallel work is done by processes: one thread of linear algebra in each.
export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1
export MKL_NUM_THREADS := 1
unexport PYTHONPATH PYTHONHOME
# Without bytecode beside the packages, each of the many processes would compile them again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: results test check thesis bench lock clean
.DELETE_ON_ERROR:

results: $(READY) ## the pipeline at its default scale
	$(BIN)/dvc repro

test: $(READY) ## all tests
	$(BIN)/pytest -n $(JOBS) --dist loadfile

check: $(READY) ## style, types, direction of imports
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

thesis: $(READY) ## the pipeline at the thesis's scale
	$(BIN)/dvc repro thesis/dvc.yaml

bench: $(READY) ## speed, measured on this machine; LARGE=--large adds 100 million generated tokens
	$(BIN)/python -m stages.bench $(LARGE)
	$(BIN)/uv pip install --quiet --require-hashes -r requirements-peers.lock
	$(BIN)/python -m stages.planning.motion_bench params.yaml --peers
	$(BIN)/python -m stages.control.speeds params.yaml --peer

lock: $(READY) ## pin every dependency anew, by hash
	$(BIN)/uv pip compile --quiet --upgrade --universal --generate-hashes --python-version 3.11 --no-header $(EXTRAS) \
		pyproject.toml --output-file requirements.lock
	$(BIN)/uv pip compile --quiet --universal --generate-hashes --python-version 3.11 --no-header $(EXTRAS) --extra peers --extra sb3 \
		--constraint requirements.lock pyproject.toml --output-file requirements-peers.lock

clean: ## the environment and the tools' caches; data and reports stay
	rm -rf $(VENV) .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis build dist
	find src stages tests -type d -name __pycache__ -prune -exec rm -rf {} +

# uv's own pin is the block of lines that begins with its name in the lock. uv does not read pip's settings, so a
# registry set there is handed on.
$(READY): requirements.lock pyproject.toml
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is not there: install Python 3.11 or newer, or name one: make PYTHON=/path/to/python" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v >= (3, 11) else "$(PYTHON) is Python %d.%d; expected 3.11 or newer: make PYTHON=/path/to/python3.11" % v[:2])'
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "$(PYTHON) has no venv module: install it (Debian and Ubuntu: apt install python3-venv)" >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)
	sed -n '/^uv==/,/[^\\]$$/p' requirements.lock > $(VENV)/uv.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r $(VENV)/uv.lock
	index=$$($(BIN)/python -m pip config get global.index-url 2>/dev/null); index=$${PIP_INDEX_URL:-$$index}; \
	if [ -n "$$index" ]; then export UV_DEFAULT_INDEX="$${UV_DEFAULT_INDEX:-$$index}"; fi; \
	$(BIN)/uv pip sync --quiet --require-hashes requirements.lock
	$(BIN)/uv pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@
