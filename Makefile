# `make demo` shows what the project does, `make test` proves it; both set everything up first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: setup demo test fuzz bench docs lint clean

setup: $(VENV)/.ready

$(VENV)/.ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed (make PYTHON=...)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev,cluster]'
	@touch $@

demo: setup
	$(BIN)/python -m studies.demo.first_run
	$(BIN)/python -m studies.demo.missing_effect

test: setup
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n 2

fuzz: setup
	$(BIN)/python -m tests.fuzz.families --inputs $(or $(INPUTS),600) --seed $(or $(SEED),0)
	EDHAS_FUZZ_INPUTS=$(or $(INPUTS),5000) $(BIN)/python -m pytest tests/fuzz -n 0 --maxfail=100

bench: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[bench]'
	$(BIN)/python benchmarks/accuracy.py
	$(BIN)/python benchmarks/step_size.py
	$(BIN)/python benchmarks/abrupt_starts.py
	$(BIN)/python benchmarks/gradients.py
	$(BIN)/python benchmarks/model_functions.py
	$(BIN)/python benchmarks/operations.py
	$(BIN)/python benchmarks/fmu.py
	$(BIN)/python benchmarks/throughput.py
	$(BIN)/python benchmarks/peers.py

docs: setup
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	@mkdir -p build/tutorials # where the tutorials write
	cd build/tutorials && ../../$(BIN)/python -m mkdocs build --quiet -f ../../mkdocs.yml
	@echo "build/site/index.html"

lint: setup
	$(BIN)/ruff check --fix .

clean:
	rm -rf $(VENV) runs build *.egg-info
