# Everything runs in a virtual environment of its own; `make demo` and `make test` need Python 3.11, Rust, make and cc.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
SOURCES := pyproject.toml Cargo.toml Cargo.lock $(shell find crates dissectors analyzer -name '*.rs' -o -name '*.toml')

.PHONY: demo test lint wheel bench captures vectors clean

demo: $(VENV)/.installed
	$(BIN)/modlens decode captures/pymodbus_disturbed/recording.jsonl --line 19200-8E1

test: $(VENV)/.tested
	cargo test --release --locked --package modlens-core
	$(BIN)/python -m pytest

lint: $(VENV)/.tested
	cargo fmt --check
	cargo clippy --release --locked --all-targets -- -D warnings
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

wheel: $(VENV)/.tested
	$(BIN)/pip wheel --quiet --no-deps --wheel-dir dist .

bench: $(VENV)/.tested
	$(BIN)/python bench/decode_speed.py

captures: $(VENV)/.tested
	$(BIN)/python -m tests.support.recording all

# Frames of other projects' tests, which are not part of this one: make vectors CORPUS=folder
vectors: $(VENV)/.tested
	CORPUS=$(CORPUS) $(BIN)/python -m pytest tests/corpus

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# An editable install builds the core once; it is built again when a source of it changes.
$(VENV)/.installed: $(BIN)/python $(SOURCES)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable .
	touch $@

$(VENV)/.tested: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[test]'
	touch $@

clean:
	rm -rf $(VENV) target dist
