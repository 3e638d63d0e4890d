# Everything runs in a virtual environment of its own, which is made when it is needed.
# `make demo` and `make test` need Python 3.11, Rust, make and a C compiler; see CONTRIBUTING.md for the rest.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# What the extension is made of: sources, and the tables that are embedded in it.
SOURCES := pyproject.toml Cargo.toml Cargo.lock \
	$(shell find $(filter-out crates/modlens-bench,$(wildcard crates/*)) dissectors analyzer -name '*.rs' -o -name '*.toml')

.PHONY: demo check test lint recipes wheel load soak settings bench bench-text bench-readings bench-exports speed accuracy noise fuzz properties captures vectors corpus clean

demo: $(VENV)/.installed
	$(BIN)/modlens decode captures/pymodbus_disturbed/recording.jsonl --line 19200-8E1

test: $(VENV)/.tested
	cargo test --release --locked --workspace
	$(BIN)/python -m pytest

# The inner loop: the linters, and the tests of what changed since main.
check: $(VENV)/.tested
	$(BIN)/python -m tests.support.changed

lint: $(VENV)/.tested
	cargo fmt --check
	cargo clippy --release --locked --all-targets -- -D warnings
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

# The recipes of CONTRIBUTING.md, carried out on a copy of the tree.
recipes: $(VENV)/.tested
	MODLENS_RECIPES=1 $(BIN)/python -m pytest tests/docs/test_recipes.py

wheel: $(BIN)/python
	$(PIP) wheel --no-deps --wheel-dir dist .

bench: $(VENV)/.tested
	$(BIN)/python bench/decode_speed.py
	$(BIN)/python -m bench.capture_speed

# Logs in every dialect, to byte strings and to transactions; two minutes.
bench-text: $(VENV)/.tested
	$(BIN)/python -m bench.text_speed

# Framer, pairing and rows through the Rust API, and their memory; minutes.
speed:
	cargo run --release --locked --package modlens-bench -- speed --noise-mb 1000 --bytes 16000000

bench-readings: $(VENV)/.tested
	$(BIN)/python -m bench.readings_cost

# What exports cost, beside tshark.
bench-exports: $(VENV)/.tested
	$(BIN)/python -m bench.export_speed

# A saturated line through a tap for minutes: loss, CPU, latency. The soak tells memory at its end.
load: $(VENV)/.tested
	$(BIN)/python bench/tap_load.py --seconds 600 --floor
	$(BIN)/python bench/tap_load.py --seconds 600 --view table
	$(BIN)/python bench/tap_load.py --seconds 60 --baud 3000000

soak: $(VENV)/.tested
	$(BIN)/python bench/tap_load.py --seconds 1200 --load 0.4

# Settings found by listening: every standard rate, every shape of a character; two minutes.
settings: $(VENV)/.tested
	$(BIN)/python -m bench.settings_sweep --seeds 2

# The engine and its rivals against simulated buses, scenario by scenario; minutes.
accuracy:
	cargo run --release --locked --package modlens-bench -- accuracy --scenarios all

# What is taken for frames in 64 MB of each kind of noise, three seeds, cold and warm; many minutes.
noise:
	cargo run --release --locked --package modlens-bench -- noise --noise-mb 64 --algorithms modlens

# libFuzzer on stable Rust, without sanitizers: make fuzz SECONDS=60. What it finds stays in fuzz/artifacts.
SECONDS ?= 600
fuzz: export CARGO_TARGET_DIR := target/fuzz
fuzz: export RUSTFLAGS := -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
	-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
	-Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1
fuzz:
	for target in session text; do \
		mkdir -p fuzz/corpus/$$target fuzz/artifacts/$$target && \
		cargo run --release --manifest-path fuzz/Cargo.toml --target $$(rustc -vV | sed -n 's/host: //p') --bin $$target -- \
			-max_total_time=$(SECONDS) -max_len=2048 -artifact_prefix=fuzz/artifacts/$$target/ fuzz/corpus/$$target || exit 1; \
	done

# Property tests with examples that no run before had: make properties CASES=20000
CASES ?= 5000
properties: $(VENV)/.tested
	PROPTEST_CASES=$(CASES) cargo test --release --locked --workspace
	$(BIN)/python -m pytest -m hypothesis

captures: $(VENV)/.tested
	$(BIN)/python -m tests.support.recording all

# Frames of other projects' tests, which are not part of this one: make vectors CORPUS=folder
vectors: $(VENV)/.tested
	CORPUS=$(CORPUS) $(BIN)/python -m pytest tests/corpus

# Recordings of other people, which are not part of this one either: make corpus CORPUS=folder
corpus: $(VENV)/.tested
	$(BIN)/python -m tests.corpus.score $(CORPUS)

# A venv that was begun only (Debian without python3-venv) is taken away, so that the next try begins anew.
$(BIN)/python:
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); false; }

# An editable install builds the core once; it is built again when a source of it changes.
$(VENV)/.installed: $(BIN)/python $(SOURCES)
	$(PIP) install --editable .
	touch $@

# The packages that tests need change with pyproject.toml only. With maturin among them, a change in Rust needs no index.
$(VENV)/.packages: $(BIN)/python pyproject.toml
	$(PIP) install --editable '.[test]'
	touch $@

$(VENV)/.tested: $(VENV)/.packages $(SOURCES)
	PATH="$(abspath $(BIN)):$$PATH" $(PIP) install --no-deps --no-build-isolation --editable .
	touch $(VENV)/.installed $@

clean:
	rm -rf $(VENV) target dist
