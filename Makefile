# make report   every mechanism in every engine -> reports/latest/index.html
# make test     ruff, mypy and all tests
# make check    the fast tests only
# make wheel    a wheel for this system's Python with machine code -> dist
# make outside  every mechanism in our engines and in those of plugins/ -> build/outside/report/index.html
# make docs     the site -> docs/_build/html/index.html
#
# Needs Python 3.11 to 3.13 with pip; everything else is installed into .venv, once.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
STAMP  := $(VENV)/installed
OUT    ?= reports/latest
JOBS   ?= 2
# One more than cores: browsers and limits of time let a tester wait.
TESTERS ?= 3
# Levels of processor that a wheel has machine code for; on aarch64: make wheel LEVELS=generic
LEVELS ?= x86-64-v3 x86-64-v4

.PHONY: report outside test check docs lint wheel clean

report: $(STAMP)
	$(BIN)/crosscheck run --out $(OUT) --jobs $(JOBS) --baseline reports/baseline

# Engines of others have an environment of their own, 2.5 GB below build/, made once.
outside:
	$(PYTHON) plugins/outside.py prepare
	$(PYTHON) plugins/outside.py report --jobs $(JOBS)

# Types are checked by tests/test_types.py, beside the other tests.
test: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pytest -n $(TESTERS) --dist worksteal

check: $(STAMP)
	$(BIN)/pytest -n $(TESTERS) --dist worksteal -m "not slow and not browser"

# A warning is an error; links to files and within the site are checked, too.
docs: $(STAMP)
	$(BIN)/sphinx-build --fail-on-warning --keep-going -b html docs docs/_build/html

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# Where the system's Python comes without ensurepip (Debian), the system's pip fills the environment instead.
$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c "import sys; sys.exit(sys.version_info < (3, 11) and 'flexinv needs Python 3.11 or newer')"
	$(PYTHON) -m venv $(VENV) || { $(PYTHON) -m venv --clear --without-pip $(VENV) && \
		$(PYTHON) -m pip --python $(BIN)/python install pip; }
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[all]"
	-$(BIN)/flexinv warm --jobs $(JOBS)
	touch $@

# Machine code is compiled level by level, into caches of its own; pip takes it into the wheel (setup.py).
wheel: $(STAMP)
	rm -rf build dist
	for level in $(LEVELS); do \
		NUMBA_CPU_NAME=$$level NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=build/cache/$$level \
			$(BIN)/flexinv warm --jobs $(JOBS) --ship build/machine_code/$$level || exit 1; \
	done
	$(BIN)/python -m pip wheel --quiet --no-deps --wheel-dir dist .

# Compiled kernels (in __pycache__) stay: they depend on the source only and take a minute or two to make again.
clean:
	rm -rf $(VENV) docs/_build docs/examples docs/mechanisms docs/reference/generated build .pytest_cache .mypy_cache .ruff_cache
