# `make cycle` runs a full aging cycle on the embedded bench, `make test` is the whole check.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROFILE ?= full
OUT ?= out
PYTEST_ARGS ?=

.PHONY: setup test cycle report proof soak bench clean

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

test: setup
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest tests_unit tests_bench

cycle: setup
	$(BIN)/python -m pytest -m cycle tests_bench --profile $(PROFILE) --out $(OUT) $(PYTEST_ARGS)

proof: setup
	$(BIN)/python -m benchmarks.concealed.proof

bench: setup
	$(BIN)/python -m benchmarks

soak: setup
	$(BIN)/python -m pytest -m slow tests_unit tests_bench

clean:
	rm -rf $(OUT) allure-results allure-report
