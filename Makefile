# `make cycle` runs a full aging cycle on the embedded bench, `make test` is every kind of check in minutes;
# `make diagnoses` repeats the long cases of the reconciling tool, a table each. CI runs both.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PROFILE ?= full
BENCH ?= emulated
OUT ?= out
RESUME ?=
CASES ?= 40
MINUTES ?= 14
PYTEST_ARGS ?=

DIAGNOSES := tests_unit/reconcile/whole tests_bench/test_repair.py

.PHONY: setup test diagnoses types style cycle report proof soak bench clean
# tests start the package in many processes: it is compiled once
unexport PYTHONDONTWRITEBYTECODE

setup: $(VENV)/.installed

$(VENV)/.installed: pyproject.toml
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	@touch $@

# Three at a time on two cores: tests of guard and kills mostly wait for processes that they have started.
test diagnoses: export OMP_NUM_THREADS = 1
test: setup
	@$(MAKE) --no-print-directory --output-sync -j 2 types style
	$(BIN)/python -m pytest tests_bench tests_unit $(addprefix --ignore ,$(DIAGNOSES)) -q -n 3 --dist worksteal

diagnoses: setup
	$(BIN)/python -m pytest $(DIAGNOSES) -q -n 2 --dist worksteal

types: setup
	$(BIN)/mypy

# Collecting shows what cannot be imported before the long part begins, and compiles the tests for all workers.
style: setup
	$(BIN)/ruff check .
	$(BIN)/lint-imports
	@$(BIN)/python -m pytest --collect-only -q tests_bench tests_unit >$(VENV)/collected \
		|| { cat $(VENV)/collected; exit 1; }

cycle: setup
	$(BIN)/python -m pytest -m cycle tests_bench --bench $(BENCH) --profile $(PROFILE) --out $(OUT) \
		--junitxml $(OUT)/junit.xml --alluredir $(OUT)/allure-results $(if $(RESUME),--resume) $(PYTEST_ARGS)

# Allure 3 is a command of the npm registry; without Node.js the results stay as they are.
report:
	@if command -v npx >/dev/null; then \
		npx --yes allure@3 generate $(OUT)/allure-results --output $(OUT)/allure-report; \
	else echo "make report: Node.js (npx) is not installed; the results are in $(OUT)/allure-results"; fi

# As many of the first 40 of the stated sample as a quarter of an hour allows; the table in docs/proof.md is of all 80.
proof: setup
	$(BIN)/python -m benchmarks.concealed.proof --cases $(CASES) --minutes $(MINUTES)

bench: setup
	$(BIN)/python -m benchmarks

soak: setup
	$(BIN)/python -m pytest -m slow tests_unit tests_bench

clean:
	rm -rf $(OUT) allure-results allure-report
