# One environment, .venv, built from the lock; every target sets it up first and may be run again.
# `make docs` has .venv-docs beside it, with what builds the pages; there everything else is found in .venv.
.DELETE_ON_ERROR:
.PHONY: run test test-slow lint docs wheel bench gpu table1 lock clean notebooks

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

docs: .venv-docs/.installed  # → build/site/docs/index.html; a warning is an error
	.venv-docs/bin/python -m sphinx -q -W --keep-going -c docs -d build/doctrees . build/site

wheel: $(INSTALLED)  # builds it, installs it without an index, runs it from elsewhere
	$(BIN)/python -m pytest -m slow tests/test_wheel.py

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
	$(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]["docs"], sep="\n")' | \
	    uv pip compile - --constraint requirements.lock --universal --fork-strategy fewest --python-version 3.11 \
	    --generate-hashes --no-header --no-annotate --upgrade --output-file docs/requirements.lock

.venv-peer/.installed:  # the library that `python -m experiments.benchmark peer=true` is compared with
	$(PYTHON) -m venv .venv-peer
	.venv-peer/bin/python -m pip install --quiet "imitation==1.0.1" "stable-baselines3==2.2.1" "gymnasium[mujoco]==0.29.1" "mujoco==2.3.7" "numpy<2"
	touch $@

.venv-docs/.installed: docs/requirements.lock $(INSTALLED)
	test -x .venv-docs/bin/python || $(PYTHON) -m venv .venv-docs
	.venv-docs/bin/python -m pip install --quiet --require-hashes --requirement docs/requirements.lock
	$(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))' > "$$(.venv-docs/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/project.pth"
	touch $@

clean:
	rm -rf .venv .venv-docs .venv-peer build *.egg-info

$(INSTALLED): requirements.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --require-hashes --requirement requirements.lock
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable .
	touch $@
