# Everything runs in a virtual environment of its own, which is made when it is needed.
# `make demo` and `make test` need Python 3.11, Rust, make and a C compiler; see CONTRIBUTING.md for the rest.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
# What the extension is made of: sources, and the tables that are embedded in it.
SOURCES := pyproject.toml Cargo.toml Cargo.lock \
	$(shell find $(filter-out crates/modlens-bench crates/modlens-tap crates/modlens-web,$(wildcard crates/*)) dissectors analyzer -name '*.rs' -o -name '*.toml')

# The core of the page, compiled for WebAssembly. As one type of crate: Rust optimises nothing across crates while the other
# type, which tests link, is made along. Its linker would leave five bytes for each address.
PAGE_CORE := analyzer/page/modlens.wasm.gz

.PHONY: demo check test page lint minimum-rust actionlint recipes docs pictures wheel wheels try-wheels try-windows quick-wheels sdist licences shell-files gateway deb try-gateway load spark soak line-loss growth esphome grafana openings settings bench bench-family bench-memory bench-captures bench-text bench-page bench-readings bench-exports bench-threads false-alarms speed accuracy noise fuzz miri asan properties mutations deny audit lock captures vectors corpus clean

demo: export PAGER := cat
demo: $(VENV)/.installed
	$(BIN)/modlens decode captures/pymodbus_disturbed/recording.jsonl --line 19200-8E1

test: $(VENV)/.tested $(PAGE_CORE)
	cargo test --release --locked --workspace
	$(BIN)/python -m pytest

# The page that decodes recordings in a browser, as modlens.html.
page: $(VENV)/.installed $(PAGE_CORE)
	$(BIN)/modlens page -o modlens.html

$(PAGE_CORE): $(SOURCES) $(shell find crates/modlens-web -name '*.rs' -o -name '*.toml') | $(VENV)/.packer
	rustup target list --installed | grep -qx wasm32-unknown-unknown || rustup target add wasm32-unknown-unknown
	cargo rustc --profile web --locked --package modlens-web --target wasm32-unknown-unknown \
		--crate-type cdylib -- -C link-arg=--compress-relocations
	$(BIN)/python -c 'import sys, zopfli.gzip; sys.stdout.buffer.write(zopfli.gzip.compress(sys.stdin.buffer.read(), numiterations=5, blocksplittingmax=60))' \
		< target/wasm32-unknown-unknown/web/modlens_web.wasm > target/modlens.wasm.gz
	mv target/modlens.wasm.gz $@

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

# The oldest Rust that Cargo.toml promises, installed by rustup where it is missing.
MINIMUM_RUST := $(shell sed -n 's/^rust-version = "\(.*\)"/\1/p' Cargo.toml)
minimum-rust:
	rustup toolchain install --no-self-update --profile minimal $(MINIMUM_RUST)
	cargo +$(MINIMUM_RUST) check --locked --workspace --target-dir target/minimum-rust

# The workflows. The linter is a program in Go, which is built where it is not installed.
actionlint:
	$(or $(shell command -v actionlint),go run github.com/rhysd/actionlint/cmd/actionlint@v1.7.12)

# The recipes of CONTRIBUTING.md, carried out on a copy of the tree.
recipes: $(VENV)/.tested
	MODLENS_RECIPES=1 $(BIN)/python -m pytest tests/docs/test_recipes.py

# The site, in site/: generated reference, executed notebook; what would be a warning is an error. Its search is tried.
docs: $(VENV)/.documented
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict --clean
	$(BIN)/python -m docs.make.try_search

# The pictures of screens and the moving one of the README, drawn from the real program; tests compare them with it.
pictures: $(VENV)/.tested
	$(BIN)/python -m docs.make.screens
	$(BIN)/python -m docs.make.moving_picture
	$(BIN)/python -m docs.make.report_pictures

wheel: $(BIN)/python
	$(PIP) wheel --no-deps --wheel-dir dist .

# Wheels for other systems, checked: make wheels TARGETS="manylinux-x86_64 manylinux-aarch64"; all of
# release/targets.py if none is named, half an hour of one core.
TARGETS ?=
QUICK_TARGETS ?= manylinux-x86_64 manylinux-armv7l
wheels: $(VENV)/.release
	$(BIN)/python -m release.wheels $(TARGETS)

# Those for Linux where they are meant for, by means of qemu-user and Debian's Python (mmdebstrap).
try-wheels: $(VENV)/.release $(VENV)/.installed
	$(BIN)/python -m release.try_wheel $(or $(TARGETS),manylinux-x86_64 manylinux-aarch64 manylinux-armv7l)

# The one for Windows, under wine, in a Python for Windows from Maven Central: apt install wine.
try-windows: $(VENV)/.release $(VENV)/.installed
	$(BIN)/python -m release.try_windows

# A wheel for this machine and an emulated one, in a fraction of the time, built and tried: what .ci/run does.
quick-wheels: $(VENV)/.release $(VENV)/.installed
	$(BIN)/python -m release.wheels --quick $(QUICK_TARGETS)
	$(BIN)/python -m release.try_wheel --quick $(QUICK_TARGETS)

sdist: $(VENV)/.release
	$(BIN)/maturin sdist --out dist

# The tap without Python for gateways, static: make gateway MACHINE=aarch64, and as a package of Debian: make deb. Tried
# on a pseudo terminal, those for other processors under qemu-user: make try-gateway MACHINE=armv7.
MACHINE ?= x86_64
gateway: $(VENV)/.release $(VENV)/.installed $(PAGE_CORE)
	$(BIN)/python -m release.gateways $(MACHINE)

deb: $(VENV)/.release $(VENV)/.installed $(PAGE_CORE)
	$(BIN)/python -m release.gateways --deb $(MACHINE)

# Alerts on an ordinary day of 24 hours, and what diff finds between pairs of days (HOURS each).
false-alarms: $(VENV)/.installed
	$(BIN)/python -m tests.support.usual_days alarms --days 3
	$(BIN)/python -m tests.support.usual_days diff --hours $(or $(HOURS),24)

try-gateway: $(VENV)/.release $(VENV)/.installed
	$(BIN)/python -m release.try_gateway $(MACHINE)

# Generated files that are checked in: licences of the crates and the list of them, completion, manual pages.
licences:
	$(PYTHON) -m release.licences
	$(PYTHON) -m release.sbom

shell-files: $(VENV)/.tested
	$(BIN)/python -m release.shell_files

# Beside the peers that are installed, and YARDSTICK=folder with limit.rs; PAGE=1 writes the table into docs/figures.md.
bench: $(VENV)/.tested
	$(BIN)/python -m bench.compare $(if $(YARDSTICK),--yardstick $(YARDSTICK)) $(if $(PAGE),--page)

# The same on twenty kinds of ordinary traffic, with the median and the worst; ten minutes.
bench-family: $(VENV)/.tested
	$(BIN)/python -m bench.family $(if $(YARDSTICK),--yardstick $(YARDSTICK))

# Peak memory at 64 MB, 512 MB and 2 GB of bus bytes; half an hour, and 10 GB of room for temporary files.
bench-memory: $(VENV)/.tested
	$(BIN)/python -m bench.peak_memory

bench-captures: $(VENV)/.tested
	$(BIN)/python -m bench.capture_speed

# Reading, jumps, cancelling and memory of the page, in Chromium; two minutes.
bench-page: $(VENV)/.tested $(PAGE_CORE)
	$(BIN)/python -m bench.page_speed

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

# What several threads gain over one, on 512 MB of bus bytes. On a machine that does nothing else; minutes.
bench-threads: $(VENV)/.tested
	$(BIN)/python -m bench.threads

# A saturated line through a tap for minutes: loss, CPU, latency. `make memory` reports memory at its end.
load: $(VENV)/.tested
	$(BIN)/python bench/tap_load.py --seconds 600 --floor
	$(BIN)/python bench/tap_load.py --seconds 600 --view table
	$(BIN)/python bench/tap_load.py --seconds 60 --baud 3000000

memory: $(VENV)/.tested
	$(BIN)/python bench/tap_load.py --seconds 1200 --load 0.4

# Spark and one file after the other on an archive of 203 files; tests take one of 27. A minute.
spark: $(VENV)/.tested
	MODLENS_SPARK=1 $(BIN)/python -m pytest tests/analyzer/test_spark.py

# Memory and time of every command on recordings of 1, 4 and 16 MB; minutes.
growth: $(VENV)/.tested
	$(BIN)/python -m tests.faults.growth

# Three megabaud for ten minutes into both taps, beside processes that compute: what the kernel refused, what a tap lost.
line-loss: $(VENV)/.tested
	$(BIN)/python -m bench.line_loss --seconds 600

# Everything against both taps at once: stalled output, a full disk, no broker, a port unplugged, a clock that is set.
soak: $(VENV)/.tested
	$(BIN)/python -m tests.faults.soak --seconds 600

# A real ESPHome of the platform `host` beside a direct tap, row by row. MINUTES=30; installs ESPHome and builds it.
MINUTES ?= 30
esphome: $(VENV)/.tested
	test -x $(VENV)-esphome/bin/esphome || { $(PYTHON) -m venv $(VENV)-esphome && $(VENV)-esphome/bin/python -m pip --quiet install esphome; }
	$(BIN)/python -m tests.support.esphome_host --minutes $(MINUTES) --esphome $(VENV)-esphome/bin/esphome

# The dashboards for Grafana, read strictly by the types of its own SDK, which is a module of Go.
grafana: $(VENV)/.tested
	for name in grafana grafana-parquet; do $(BIN)/modlens dashboards $$name -o target/$$name.json || exit 1; done
	cd tests/analyzer/dashboards/grafana_validator && go run . $(abspath target)/grafana.json $(abspath target)/grafana-parquet.json

# What the other side of a line sees of 1,000 openings, and of 100 with a slow driver; six minutes.
openings: $(VENV)/.tested
	$(BIN)/python -m tests.faults.opening --times 1000
	$(BIN)/python -m tests.faults.opening --times 100 --slow-us 1000

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
FUZZ_TARGETS ?= session text recording tables diagnosis profiles recorder
fuzz: export CARGO_TARGET_DIR := target/fuzz
fuzz: export RUSTFLAGS := -Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4 \
	-Cllvm-args=-sanitizer-coverage-inline-8bit-counters -Cllvm-args=-sanitizer-coverage-pc-table \
	-Cllvm-args=-sanitizer-coverage-trace-compares -Ccodegen-units=1
fuzz:
	for target in $(FUZZ_TARGETS); do \
		mkdir -p fuzz/corpus/$$target fuzz/artifacts/$$target && \
		cargo run --release --manifest-path fuzz/Cargo.toml --target $$(rustc -vV | sed -n 's/host: //p') --bin $$target -- \
			-max_total_time=$(SECONDS) -max_len=2048 -artifact_prefix=fuzz/artifacts/$$target/ fuzz/corpus/$$target || exit 1; \
	done

# The unsafe blocks that Miri can execute, on nightly Rust: rustup toolchain install nightly --component miri rust-src
miri:
	RUSTFLAGS="-Ctarget-feature=+pclmulqdq,+sse4.1" MIRIFLAGS=-Zmiri-disable-isolation PROPTEST_CASES=4 CARGO_TARGET_DIR=target/miri \
		cargo +nightly miri test --locked --package modlens-protocol --lib -- checksum::tests::all_implementations checksum::tests::checksums

# The unsafe blocks that call the system, with AddressSanitizer; stable Rust has it where it may use what is unstable.
asan:
	RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address CARGO_TARGET_DIR=target/asan \
		cargo test --locked --package modlens-recorder --target $$(rustc -vV | sed -n 's/host: //p')

# Property tests with examples that no run before had: make properties CASES=20000
CASES ?= 5000
properties: $(VENV)/.tested
	PROPTEST_CASES=$(CASES) cargo test --release --locked --workspace
	$(BIN)/python -m pytest -m hypothesis

# Damaged recordings through the command, made of everything in captures/; five minutes of a free core.
mutations: $(VENV)/.tested
	$(BIN)/python -m tests.faults.mutation_bar --cases 10000

# Licences, versions and sources of the crates, as deny.toml allows them, and advisories, whose database is on the network:
# without it they are skipped, with a word. ADVISORIES=yes fails then, ADVISORIES=no does not ask.
ADVISORIES ?= auto
deny:
	@cargo deny --version >/dev/null 2>&1 || { echo "make deny needs cargo-deny: cargo install --locked cargo-deny" >&2; false; }
	cargo deny --locked check bans licenses sources
	@case $(ADVISORIES) in \
	no) echo "advisories: NOT checked (ADVISORIES=no)" ;; \
	yes) cargo deny --locked check advisories ;; \
	*) if cargo deny --locked fetch db >/dev/null 2>&1; then cargo deny --locked check advisories; \
		else echo "advisories: NOT checked, their database cannot be reached; ADVISORIES=yes makes that a failure"; fi ;; \
	esac

# Known vulnerabilities: of the crates and of the Python packages. Both databases are on the network.
audit: $(BIN)/python
	@cargo audit --version >/dev/null 2>&1 || { echo "make audit needs cargo-audit: cargo install --locked cargo-audit" >&2; false; }
	cargo audit
	test -x $(VENV)-audit/bin/pip-audit || { $(PYTHON) -m venv $(VENV)-audit && $(VENV)-audit/bin/python -m pip --quiet install pip-audit==2.10.1; }
	$(VENV)-audit/bin/pip-audit --require-hashes --disable-pip --requirement requirements/test.txt

# The versions that tests run with, for every system and Python.
lock: $(BIN)/python
	test -x $(VENV)-audit/bin/uv || { $(PYTHON) -m venv $(VENV)-audit && $(VENV)-audit/bin/python -m pip --quiet install uv; }
	{ head -n 1 requirements/test.txt; $(VENV)-audit/bin/uv pip compile --quiet pyproject.toml --extra test --generate-hashes \
		--universal --python-version 3.11 --no-header --no-emit-index-url --no-annotate; } > requirements/test.new
	mv requirements/test.new requirements/test.txt

captures: $(VENV)/.tested
	$(BIN)/python -m tests.support.recording all

# Frames of other projects' tests, which are not part of this one: make vectors CORPUS=folder
vectors: $(VENV)/.tested
	CORPUS=$(CORPUS) $(BIN)/python -m pytest tests/corpus

# Recordings of other people, which are not part of this one either: make corpus CORPUS=folder
corpus: $(VENV)/.tested
	$(BIN)/python -m tests.corpus.score $(CORPUS)

# A venv that was begun only (Debian without python3-venv) is taken away, so that the next try starts from scratch.
$(BIN)/python:
	$(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); false; }

# An editable install builds the core once; it is built again when a source of it changes.
$(VENV)/.installed: $(BIN)/python $(SOURCES)
	$(PIP) install --editable .
	touch $@

# The packages that tests need change with their list only. With maturin among them, a change in Rust needs no index.
$(VENV)/.packages: $(BIN)/python requirements/test.txt
	$(PIP) install --require-hashes --requirement requirements/test.txt
	touch $@

# What packs the core of the page: a twentieth smaller than gzip -9.
$(VENV)/.packer: $(BIN)/python
	$(PIP) install zopfli==0.4.3
	touch $@

# What builds releases.
$(VENV)/.release: $(BIN)/python release/requirements.txt
	$(PIP) install --requirement release/requirements.txt
	touch $@

$(VENV)/.tested: $(VENV)/.packages $(SOURCES)
	PATH="$(abspath $(BIN)):$$PATH" $(PIP) install --no-deps --no-build-isolation --editable .
	touch $(VENV)/.installed $@

$(VENV)/.documented: $(VENV)/.tested pyproject.toml
	$(PIP) install $$($(BIN)/python -c 'import tomllib; print(*tomllib.load(open("pyproject.toml", "rb"))["dependency-groups"]["docs"])')
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-audit target dist site
