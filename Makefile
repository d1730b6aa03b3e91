# Everything runs from a bare Python >= 3.11: the first target that needs it makes .venv here, and a
# stamp per extra keeps the next one from installing again until pyproject.toml changes.
PYTHON ?= python3
BIN := .venv/bin
# A file of tests stays in one process, since tests of one file share what they compiled; processes
# share what takes long to compile by a cache that goes with the environment.
PYTEST := JAX_COMPILATION_CACHE_DIR=$(CURDIR)/.venv/programs \
    JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS=0.3 \
    $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder

.PHONY: help demo paper record test test-slow lint format notebooks bench hunt calibrate clean
.DEFAULT_GOAL := help

help:  ## list the targets
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*## /\t/' | expand -t 14

demo: .venv/.core  ## name the fault in three drives; identify others, and simulate with what was found
	$(BIN)/vdmsi diagnose configs/demo/fault/run_1.csv configs/demo/fault/run_2.csv \
	    configs/demo/fault/run_3.csv --config configs/demo/fault/vehicle.toml --out out/demo/diagnose
	$(BIN)/vdmsi identify configs/demo/powertrain_steps.csv configs/demo/steering_steps.csv \
	    --config configs/demo/vehicle.toml --out out/demo/identify
	$(BIN)/vdmsi simulate out/demo/identify/identify.json configs/demo/bend.csv configs/demo/s_curve.csv \
	    --config configs/demo/vehicle.toml --out out/demo/simulate
	@echo "Open report.html in out/demo/diagnose, out/demo/identify and out/demo/simulate"

paper: .venv/.paper  ## make the paper's experiments again, and the report of them as PDF
	$(BIN)/vdmsi reproduce --out out/paper --pdf

record: .venv/.core  ## run the studies beyond the paper anew, and ship what came of them
	$(BIN)/vdmsi reproduce --out out/record --beyond --no-report
	cp out/record/beyond.json vdmsi_jax/reproduce/recorded/beyond.json

test: .venv/.test  ## the tests, without the slow ones
	$(PYTEST) --durations=10

test-slow: .venv/.test  ## the slow tests only
	$(PYTEST) -m slow --durations=10

lint: .venv/.dev  ## ruff and pyright
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright

format: .venv/.dev  ## let ruff mend what it can
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

notebooks: .venv/.test  ## run the notebooks in place
	$(BIN)/python notebooks/run.py

bench: .venv/.bench  ## time this project against its peers, in one run
	$(BIN)/python -m pip list | grep -iE '^(jax|scipy|numba|control|sippy_unipi|sysidentpy) '
	for script in benchmarks/*.py; do $(BIN)/python $$script || exit 1; done

hunt: .venv/.test  ## hide every cause in made-up logs and count what is found; goes on where it stopped
	$(BIN)/python tests/hidden/hunt.py --out docs/hunt

calibrate: .venv/.test  ## what every cause gains on drives without any, beside its price; goes on likewise
	$(BIN)/python tests/hidden/calibrate.py --out docs/calibration

clean:  ## remove the environment and what commands wrote
	rm -rf .venv out

$(BIN)/python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	    { echo "vdmsi_jax needs Python 3.11 or later: make PYTHON=python3.12 ..." >&2; exit 1; }
	$(PYTHON) -m venv .venv

.venv/.core: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable .
	@touch $@

.venv/.%: pyproject.toml | $(BIN)/python
	$(BIN)/python -m pip install --quiet --editable '.[$*]'
	@touch $@
