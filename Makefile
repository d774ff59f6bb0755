# The short way on a fresh machine: make demo, make test. Everything is set up in .venv.
# Without make (Windows, say): the pip commands are in CONTRIBUTING.md.

VENV := .venv

ifeq ($(OS),Windows_NT)
BIN := $(VENV)/Scripts
else
BIN := $(VENV)/bin
endif

# The first Python that is new enough; choose another with `make PYTHON=/path/to/python demo`.
NEW_ENOUGH := import sys; sys.exit(sys.version_info < (3, 11))
ifeq ($(origin PYTHON),undefined)
PYTHON := $(shell for python in python3 python3.14 python3.13 python3.12 python3.11 python; do \
	$$python -c '$(NEW_ENOUGH)' >/dev/null 2>&1 && echo $$python && break; done)
endif

# xdist gives every core a test process; threads of the linear algebra would only get in the way.
TEST_THREADS := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 MKL_NUM_THREADS=1

.PHONY: help demo test lint types mutants clean distclean

help:
	@echo "make demo    the whole path on made-up data; tables and pictures in demo/"
	@echo "make test    the quick tests"
	@echo "make lint    ruff: style and format"
	@echo "make types   mypy"
	@echo "make mutants ROOM=tracks   80 small changes of a room: which does no test notice?"
	@echo "make clean   remove what was made, but not .venv (make distclean removes that too)"

demo: $(VENV)/installed-all
	$(BIN)/mocap-fit demo --out demo

test: $(VENV)/installed-test
	$(TEST_THREADS) $(BIN)/python -m pytest -n auto -m "not slow and not real_data"

lint: $(VENV)/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/installed-dev
	$(BIN)/mypy

mutants: $(VENV)/installed-dev
	$(BIN)/python tests/mutants.py $(ROOM)

$(VENV)/created:
	@if [ -z "$(PYTHON)" ] || ! "$(PYTHON)" -c '$(NEW_ENOUGH)'; then \
		echo "mocap-fit needs Python 3.11 or newer; found: $(or $(PYTHON),none)." >&2; \
		echo "Install one, or name it: make PYTHON=/path/to/python3.11" >&2; \
		exit 1; \
	fi
	"$(PYTHON)" -m venv $(VENV)
	@touch $@

# A stamp a set of requirements: pip runs again only when pyproject.toml has changed.
$(VENV)/installed-all: EXTRAS := all
$(VENV)/installed-test: EXTRAS := all,test
$(VENV)/installed-dev: EXTRAS := dev
$(VENV)/installed-all $(VENV)/installed-test $(VENV)/installed-dev: pyproject.toml | $(VENV)/created
	$(BIN)/python -m pip install --disable-pip-version-check --quiet -e ".[$(EXTRAS)]"
	@touch $@

clean:
	rm -rf demo build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find mocap_fit corpus_tools tests fixtures benchmarks -name __pycache__ -type d -prune \
		-exec rm -rf {} +

distclean: clean
	rm -rf $(VENV)
