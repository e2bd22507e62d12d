# Two commands to know: `make demo` and `make test`. Both set everything up by themselves.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: setup demo kernels test bench lint clean

$(VENV)/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable '.[dev]'
	@touch $@

setup: $(VENV)/.installed
	$(BIN)/searchparty warm missions/quickstart.toml

demo: setup
	$(BIN)/searchparty swarm missions/quickstart.toml

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

kernels: $(VENV)/.installed
	$(BIN)/searchparty warm

# The type checker keeps one core busy and compiling leaves some free.
test: setup
	$(MAKE) --jobs=2 lint kernels
	$(BIN)/pytest --dist worksteal -n auto

bench: setup
	$(BIN)/python -m benchmarks

clean:
	rm -rf $(VENV) dist build .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks
