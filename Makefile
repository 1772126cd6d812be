# Every target works from a bare checkout: it makes its own virtual environment in .venv. Lines with ## are `make help`.

PYTHON ?= python3
BIN    := .venv/bin
SOURCES := Cargo.toml Cargo.lock pyproject.toml $(shell find rust -path rust/c -prune -o -name '*.rs' -print -o -name Cargo.toml -print)

TARGETS := help demo test lint docs bench benchmarks wheel nightly clean
PARTS   := toolchain rust-lint rust-test python-lint python-test instructions measured
CHECKS  := threads campaign fuzz ring sanitize memcheck miri soak oldest arm64 lints supply wheels
CHECK   ?= $(CHECKS)
BENCH   ?= rust peers ecoc

.PHONY: $(TARGETS) $(PARTS) $(addprefix nightly-,$(CHECKS)) $(addprefix bench-,rust peers ecoc decision counts accuracy archive)

# Parts stand beside each other: many use one core only. cargo shares out the cores itself.
MAKEFLAGS += --jobs=3
unexport MAKEFLAGS

# $(call step,name,command): says what runs, and the seconds that it took.
define step
	@printf '\033[1m[%s]\033[0m %s\n' '$(1)' '$(2)'
	@start=$$(date +%s); ( $(2) ); code=$$?; printf '\033[1m[%s]\033[0m %s s\n' '$(1)' $$(($$(date +%s) - start)); exit $$code
endef

# $(call needs,program,how to get it)
needs = command -v $(1) >/dev/null || { echo "this needs $(1): $(2)" >&2; exit 1; }

# uv, or pip where uv cannot be had; what tests and tools need is pinned.
PINNED := --constraint requirements.txt
UV     := $(BIN)/uv pip install --quiet
PIP    := $(BIN)/python -m pip install --quiet --disable-pip-version-check $(PINNED)
OURS   := $(UV) --python .venv $(PINNED) --requirement pyproject.toml

help:
	@sed -n 's/^## \?//p' Makefile

toolchain:
	@command -v cargo >/dev/null || { echo "granular_id needs a Rust toolchain, 1.89 or later: install rustup, then run this again" >&2; exit 1; }
	@cargo --version | awk '{ split($$2, v, "."); exit !(v[1] > 1 || v[2] >= 89) }' || { echo "granular_id needs Rust 1.89 or later, got $$(cargo --version): run rustup update" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || { echo "granular_id needs Python 3.10 or later as '$(PYTHON)'; name another with: make PYTHON=python3.12 ..." >&2; exit 1; }

$(BIN)/python: | toolchain
	@$(PYTHON) -m venv .venv || { echo "could not make a virtual environment: install Python's venv module (Debian: python3-venv)" >&2; exit 1; }
	@$(PIP) maturin
	@$(PIP) uv || echo "without uv: pip takes longer"

# Editable: Python files are used where they are, Rust is built again when it changes. The core compiles while packages
# come. Without isolation, as a new environment for each build would compile pyo3 anew.
.venv/.app: $(SOURCES) requirements.txt | toolchain $(BIN)/python
	@echo "[1 of 2] fetching numpy, scikit-learn, matplotlib ...; compiling the core"
	@test ! -x $(BIN)/uv || $(OURS) --extra app & cargo build --package granular-id && wait $$!
	@echo "[2 of 2] compiling the extension module"
	@export PATH="$(CURDIR)/$(BIN):$$PATH"; if [ -x $(BIN)/uv ]; then $(UV) --python .venv $(PINNED) --reinstall-package granular-id \
		--no-build-isolation --editable '.[app]'; else $(PIP) --no-build-isolation --editable '.[app]'; fi
	@touch $@

.venv/.tools: .venv/.app
	@if [ -x $(BIN)/uv ]; then $(OURS) --all-extras --group dev; else $(PIP) --requirement requirements.txt; fi
	@touch $@

.venv/.docs: .venv/.tools
	@if [ -x $(BIN)/uv ]; then $(OURS) --group docs; fi
	@touch $@

## make demo       evaluates simulated pushes: tables on screen, report in ./demo
demo: .venv/.app
	$(BIN)/granular-id demo --output demo --force

## make test       lint, Rust tests, Python tests: all that must pass
test: python-test lint rust-test
	@echo "make test: everything passed"

## make lint       rustfmt, clippy, rustdoc, ruff, mypy, import-linter, stubtest, zizmor
lint: python-lint rust-lint

RUSTDOC := RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps

rust-lint: | toolchain
	$(call step,rustfmt,cargo fmt --all --check && cargo fmt --check --manifest-path tests/fuzz/Cargo.toml)
	$(call step,clippy,cargo clippy --quiet --package granular-id --package granular-id-c --package granular-id-python --all-targets -- -D warnings)
	$(call step,rustdoc,$(RUSTDOC))

rust-test: | toolchain
	$(call step,Rust tests,cargo test --quiet --package granular-id --package granular-id-c)

# Of the build of the tests; of what ships: make bench BENCH=counts
instructions: rust-test
	$(call step,instructions,! command -v valgrind >/dev/null || $(PYTHON) benches/counts.py --profile dev)

python-lint: .venv/.tools
	$(call step,ruff,$(BIN)/ruff check --quiet && $(BIN)/ruff format --quiet --check)
	$(call step,generated pages,$(BIN)/python benches/page.py --check)
	$(call step,zizmor,$(BIN)/zizmor --quiet --offline .github)
	$(call step,mypy,$(BIN)/mypy --no-error-summary)
	$(call step,import-linter,$(BIN)/lint-imports --no-logo)
	$(call step,stubtest,$(BIN)/python -m mypy.stubtest --concise granular_id._core)

# Tests wait for clocks and other processes a quarter of their time: half as many processes again as there are cores.
PROCESSES = $(shell $(BIN)/python -c 'from granular_id._core import available_cores as n; print((3 * n() + 1) // 2)')

python-test: .venv/.tools
	$(call step,Python tests,$(BIN)/python -m pytest --numprocesses $(PROCESSES) --dist worksteal)

## make docs       the documentation site, in docs/_build/html
# A warning is an error, and so is a link that leads nowhere. The reference of the crate is part of the site.
docs: .venv/.docs
	$(call step,pages and gallery,$(BIN)/python -m sphinx --jobs auto --fail-on-warning --keep-going --quiet docs docs/_build/html)
	@$(RUSTDOC)
	@rm -rf docs/_build/html/rust && cp -r target/doc docs/_build/html/rust
	$(call step,links,$(BIN)/python docs/links.py docs/_build/html)
	@echo "the site is there: open docs/_build/html/index.html"

## make bench      times beside scipy, numpy, numba: BENCH="rust peers ecoc decision counts accuracy archive", or some
bench:
	@for name in $(BENCH); do $(MAKE) --no-print-directory bench-$$name || exit; done

bench-rust: | toolchain
	cargo bench --package granular-id-benches

bench-peers bench-ecoc bench-decision: bench-%: measured
	target/measure/bin/python benches/$*.py

bench-archive: measured
	target/measure/bin/python benches/archive.py --folder target/archive --recordings $(or $(RECORDINGS),100000)

# Public recordings, or FOLDERS="one two" of your own. The peers bring 3 GB.
FOLDERS ?= $(addprefix $(GRANULAR_ID_DATA)/,sliding_wrench robot_failures)

bench-accuracy: measured
	@ls -d $(FOLDERS) >/dev/null || { echo "set GRANULAR_ID_DATA to a folder with the sets of docs/guide/features.md, or FOLDERS" >&2; exit 1; }
	@$(UV) --python target/measure --group accuracy
	target/measure/bin/python benches/accuracy.py $(FOLDERS) --out benches/accuracy.json

bench-counts: | toolchain
	@$(call needs,valgrind,apt install valgrind)
	$(PYTHON) benches/counts.py

# What is measured is the wheel, built for speed: the checkout's own build is made to compile quickly.
measured: target/wheel/.built
	@$(PYTHON) -m venv target/measure
	@$(UV) --python target/measure --group bench --reinstall-package granular-id "$$(echo target/wheel/*.whl)[all]"

# Other programs wait meanwhile, where the system grants it.
REALTIME ?= $(shell chrt -f 1 true 2>/dev/null && echo chrt -f 1)

## make benchmarks docs/benchmarks.md and the table of README.md, measured anew (15 quiet minutes)
benchmarks: measured
	$(REALTIME) target/measure/bin/python benches/results.py
	target/measure/bin/python benches/page.py

target/wheel/.built: $(SOURCES) README.md LICENSE-THIRD-PARTY.yml $(shell find python -name '*.py*' -not -name '*.pyc') | toolchain $(BIN)/python
	@rm -rf target/wheel
	$(BIN)/maturin build --release --quiet --out target/wheel
	@touch $@

## make wheel      a wheel in target/wheel, tried in an empty environment
wheel: target/wheel/.built
	@rm -rf target/empty && $(PYTHON) -m venv target/empty
	@target/empty/bin/python -m pip install --quiet --disable-pip-version-check target/wheel/*.whl
	@target/empty/bin/python -I examples/first_lines.py
	@target/empty/bin/python -m pip install --quiet --disable-pip-version-check "$$(echo target/wheel/*.whl)[app]"
	@target/empty/bin/granular-id demo --output target/empty/demo > /dev/null
	@echo "it works; install it into yours: pip install \"$$(echo target/wheel/*.whl)[app]\""

## make clean      removes all that was made
clean:
	rm -rf .venv target dist demo docs/_build docs/gallery docs/reference/api/generated

## make nightly    what takes too long for every change, hours; or one of it, CHECK=name:
nightly:
	@for name in $(CHECK); do $(MAKE) --no-print-directory nightly-$$name || exit; done

##   threads       tests of functions that promise to be thread-safe, in eight threads at a time
nightly-threads: .venv/.tools
	$(BIN)/python -m pytest -p run-parallel --parallel-threads 8 $(addprefix tests/python/core/test_,features.py features_arrays.py signal_arrays.py buffer_arrays.py)

##   campaign      the long form of tests: simulations of 500 data sets, 100 forks, damaged files, killed archives
nightly-campaign: .venv/.tools
	GRANULAR_ID_CASES=100000 $(BIN)/python -m pytest tests/python/core/test_signal_properties.py -k campaign -s
	GRANULAR_ID_CASES=3000 $(BIN)/python -m pytest tests/python/core/test_features.py -k scipy
	GRANULAR_ID_CASES=500 $(BIN)/python -m pytest tests/python/evaluation/test_simulations.py -s
	GRANULAR_ID_FORKS=100 $(BIN)/python -m pytest tests/python/core/test_fork.py
	GRANULAR_ID_CASES=1500 $(BIN)/python -m pytest tests/python/io/test_bad_files.py -k damaged
	GRANULAR_ID_CASES=200 $(BIN)/python -m pytest tests/python/archive/test_exactly_once.py
	GRANULAR_ID_CASES=500 $(BIN)/python -m pytest tests/python/confidence/test_confidence_simulations.py -s
	GRANULAR_ID_CASES=20000 cargo test --test core buffer_model
	GRANULAR_ID_CASES=5000 $(BIN)/python -m pytest tests/python/core/test_stream.py

# cargo-fuzz wants a nightly compiler; the stable one takes the same flags with RUSTC_BOOTSTRAP.
##   fuzz          model files, sensor packets and calls from C, by cargo-fuzz (FUZZ_RUNS=200000 of each)
nightly-fuzz: .venv/.tools
	@$(call needs,cargo-fuzz,cargo install cargo-fuzz)
	$(BIN)/python tests/fuzz/model_file_seeds.py
	for target in "model_file -- -dict=tests/fuzz/model_file.dict" "rdt_packets --" "c_interface --"; do \
		RUSTC_BOOTSTRAP=1 cargo fuzz run --fuzz-dir tests/fuzz $$target -runs=$(or $(FUZZ_RUNS),200000) -max_len=4096 || exit; done

# Compiled apart, as all dependencies see the flag.
##   ring          the wrench buffer in all orders of memory, by loom; then 1e9 items through it (RING_ITEMS)
nightly-ring: | toolchain
	RUSTFLAGS="--cfg loom" cargo test --quiet --target-dir target/loom --lib ring::model
	GRANULAR_ID_RING_ITEMS=$(or $(RING_ITEMS),1000000000) cargo test --release --test core buffer_stress -- --nocapture

# The stable compiler has the sanitizers of nightly ones, too.
SANITIZE = RUSTC_BOOTSTRAP=1 cargo test --quiet --target $(shell rustc -vV | sed -n 's/host: //p')

##   sanitize      the Rust tests under AddressSanitizer, those with threads under ThreadSanitizer
nightly-sanitize: | toolchain
	RUSTFLAGS=-Zsanitizer=address $(SANITIZE) --target-dir target/address --tests --package granular-id --package granular-id-c
	RUSTFLAGS="-Zsanitizer=thread -Cunsafe-allow-abi-mismatch=sanitizer" GRANULAR_ID_RING_ITEMS=1000000 \
	TSAN_OPTIONS=suppressions=$(CURDIR)/tests/data/tsan_suppressions.txt $(SANITIZE) --target-dir target/thread --test core -- buffer_stress rdt

MEMCHECK := PROPTEST_CASES=4 cargo test --quiet --config 'target."cfg(unix)".runner="valgrind --quiet --error-exitcode=9"'

# valgrind knows no AVX-512.
##   memcheck      kernels and golden bits under valgrind, baseline and AVX2
nightly-memcheck: | toolchain
	@$(call needs,valgrind,apt install valgrind)
	GRANULAR_ID_SIMD=baseline $(MEMCHECK) --test core golden
	GRANULAR_ID_SIMD=avx2 $(MEMCHECK) --test core golden
	$(MEMCHECK) --lib -- kernel:: dsp:: --test-threads=1

MIRI := PROPTEST_CASES=2 MIRIFLAGS=-Zmiri-disable-isolation cargo +nightly miri test --quiet

# Miri detects no vector unit beyond the baseline.
##   miri          the same under Miri, of a nightly compiler, in small sizes
nightly-miri:
	@cargo +nightly miri --version >/dev/null 2>&1 || { echo "this needs: rustup toolchain install nightly --component miri,rust-src" >&2; exit 1; }
	$(MIRI) --test core golden
	$(MIRI) --lib -- kernel:: dsp::

##   soak          the sensor client beside a busy interpreter for 11 minutes; from a force beyond its limit to stop()
nightly-soak: measured
	target/measure/bin/python benches/rdt_soak.py --rate-hz 500 --seconds 600
	target/measure/bin/python benches/rdt_soak.py --rate-hz 7000 --seconds 60
	target/measure/bin/python benches/limit_to_stop.py --hits 200 --busy 2

##   oldest        the Python tests with the oldest versions that pyproject.toml admits
nightly-oldest: target/wheel/.built
	@rm -rf target/oldest && $(PYTHON) -m venv target/oldest
	$(UV) --python target/oldest --resolution lowest-direct "$$(echo target/wheel/*.whl)[all]"
	$(UV) --python target/oldest hypothesis mcap pytest pytest-run-parallel
	target/oldest/bin/python -m pytest -o filterwarnings=default

# Debian: gcc-aarch64-linux-gnu, qemu-user. tests/arm64.sh does it where rustup has no such target.
##   arm64         the Rust tests on arm64, by qemu
nightly-arm64: export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER = aarch64-linux-gnu-gcc
nightly-arm64: export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER = qemu-aarch64 -L /usr/aarch64-linux-gnu
nightly-arm64: | toolchain
	cargo test --quiet --target aarch64-unknown-linux-gnu --lib --tests

FEATURES = $(shell sed -n '/^\[features\]/,/^$$/s/^\([a-z-]*\) = .*/\1/p' Cargo.toml)

##   lints         clippy of each feature alone, of the benches and of the fuzz targets
nightly-lints: | toolchain
	cargo clippy --quiet --package granular-id-benches --all-targets -- -D warnings
	for feature in "" $(FEATURES); do cargo clippy --quiet --lib --no-default-features --features "$$feature" -- -D warnings || exit; done
	cargo clippy --quiet --manifest-path tests/fuzz/Cargo.toml --no-default-features --target-dir target -- -D warnings

# Wheels hold the crates; their licences want to be there, too.
##   supply        known faults, licences and pins of what is used: cargo-deny, cargo-bundle-licenses, pip-audit, uv
nightly-supply: .venv/.tools
	@$(call needs,cargo-deny,cargo install cargo-deny) && $(call needs,cargo-bundle-licenses,cargo install cargo-bundle-licenses)
	cargo deny --workspace check
	cd rust/python && cargo bundle-licenses --format yaml --prefer MIT --output $(CURDIR)/LICENSE-THIRD-PARTY.yml
	$(BIN)/$$(sed -n '2s/^# *//p' requirements.txt) --quiet
	git diff --exit-code LICENSE-THIRD-PARTY.yml requirements.txt
	$(BIN)/uv tool run pip-audit@2.10.1 --requirement requirements.txt --no-deps --disable-pip

##   wheels        all wheels for Linux and the source distribution in ./dist, audited and run
nightly-wheels: $(BIN)/python
	$(UV) --python .venv $(PINNED) --group release
	$(BIN)/python tests/wheels.py
