# One environment, .venv, built from the lock; every target sets it up first and may be run again.
.DELETE_ON_ERROR:
.PHONY: run test test-slow lint bench gpu table1 lock clean notebooks

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BIN := .venv/bin
INSTALLED := .venv/.installed
ifneq ($(wildcard ../shared/data),)
export AIRCL_DATA ?= $(abspath ../shared/data)
endif

run: $(INSTALLED)
	$(BIN)/python -m experiments.run env=gridworld run_dir=runs/first overwrite=true

test: $(INSTALLED)
	$(BIN)/python -m pytest -m "not slow" -n 2 --dist worksteal

test-slow: $(INSTALLED)
	$(BIN)/python -m pytest -m slow

lint: $(INSTALLED)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

bench: $(INSTALLED)
	$(BIN)/python -m experiments.benchmark env=gridworld

gpu: $(INSTALLED)  # on whatever accelerator is there; `make gpu scale=smoke` tests its machinery
	$(BIN)/python -m experiments.accelerator scale=$(scale)

scale ?= full
table1: $(INSTALLED)  # hours; `make table1 scale=smoke` tests its machinery in minutes
	$(BIN)/python -m experiments.table1 scale=$(scale)

notebooks: $(INSTALLED)  # from clean kernels, their outputs kept in them
	$(BIN)/jupyter execute --inplace notebooks/*.ipynb

lock: $(INSTALLED)  # needs uv; resolves pyproject.toml anew
	uv pip compile pyproject.toml --extra test --universal --fork-strategy fewest --python-version 3.11 \
	    --generate-hashes --no-header --no-annotate --upgrade --output-file requirements.lock

.venv-peer/.installed:  # the library that `python -m experiments.benchmark peer=true` is compared with
	$(PYTHON) -m venv .venv-peer
	.venv-peer/bin/python -m pip install --quiet "imitation==1.0.1" "gymnasium[mujoco]" "mujoco==2.3.7" "numpy<2"
	touch $@

clean:
	rm -rf .venv .venv-peer build *.egg-info

$(INSTALLED): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@
