# `make cycle` runs a full aging cycle on the embedded bench, `make test` is the whole check.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROFILE ?= full
BENCH ?= emulated
OUT ?= out
RESUME ?=
PYTEST_ARGS ?=

.PHONY: setup test cycle report proof soak bench clean

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

test: setup
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest tests_unit -q -n 2 --dist loadfile
	$(BIN)/python -m pytest tests_bench -q

cycle: setup
	$(BIN)/python -m pytest -m cycle tests_bench --bench $(BENCH) --profile $(PROFILE) --out $(OUT) \
		--junitxml $(OUT)/junit.xml --alluredir $(OUT)/allure-results $(if $(RESUME),--resume) $(PYTEST_ARGS)

# Allure 3 is a command of the npm registry; without Node.js the results stay as they are.
report:
	@if command -v npx >/dev/null; then \
		npx --yes allure@3 generate $(OUT)/allure-results --output $(OUT)/allure-report; \
	else echo "make report: Node.js (npx) is not installed; the results are in $(OUT)/allure-results"; fi

proof: setup
	$(BIN)/python -m benchmarks.concealed.proof

bench: setup
	$(BIN)/python -m benchmarks

soak: setup
	$(BIN)/python -m pytest -m slow tests_unit tests_bench

clean:
	rm -rf $(OUT) allure-results allure-report
