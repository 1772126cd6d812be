# Every target works from a bare checkout: it makes its own virtual environment in .venv.

PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PACKAGE := $(VENV)/.package
TOOLS   := $(VENV)/.tools
DOCTOOLS := $(VENV)/.docs
MATURIN := $(shell sed -n 's/^requires = \["\(maturin[^"]*\)"\]/\1/p' pyproject.toml)
SOURCES := Cargo.toml Cargo.lock pyproject.toml $(shell find rust -name '*.rs' -o -name Cargo.toml)

# What is measured is the wheel, built for speed: the checkout's own build is made to compile quickly. It stands alone in
# its folder, and apart from the wheels of a release.
BUILT   := target/wheel
WHEEL   := $(BUILT)/.built
RELEASE := .venv-wheel
CLEAN   := .venv-clean
OLDEST  := .venv-oldest
BENCHES := .venv-bench
PUBLISH := target/publish

# Tests of functions that promise to be thread-safe, run once more in eight threads at a time.
THREADED := tests/python/core/test_features.py tests/python/core/test_features_arrays.py tests/python/core/test_signal_arrays.py \
	tests/python/core/test_buffer_arrays.py

# cargo shares out the cores itself, also where make runs targets beside each other.
unexport MAKEFLAGS

.PHONY: help demo docs test lint rust-lint python-lint rust-test python-test check-all threads bench benchmarks \
	bench-rust bench-peers bench-accuracy bench-ecoc oldest campaign loom stress sanitize soak fuzz deny notices counts \
	memcheck miri arm64 semver bench-decision bench-archive wheel wheels clean toolchain hosted-lint accuracy-data audit

help:
	@echo "make demo       evaluate simulated pushes, half a minute: tables on screen, report in ./demo"
	@echo "make test       lint, Rust tests, Python tests; with --jobs=3 beside each other"
	@echo "make check-all  all that takes long: threads, campaign, fuzz, loom, stress, sanitize, memcheck, counts, soak, oldest (hours)"
	@echo "make docs       the documentation site, in docs/_build/html"
	@echo "make lint       rustfmt, clippy, rustdoc, ruff, mypy, import-linter, stubtest, zizmor"
	@echo "make bench      criterion, then the same work side by side with scipy, numpy and numba"
	@echo "make benchmarks docs/benchmarks.md and the tables of README.md, measured anew (10 to 15 minutes on a quiet machine)"
	@echo "make bench-accuracy   our methods beside aeon's and others on real recordings, halves in time held out (minutes; 3 GB to install)"
	@echo "make oldest     the Python tests once more with the oldest versions of what is needed"
	@echo "make campaign   100,000 filters and 3,000 extractions against scipy, bit for bit; 100 forks of each kind;"
	@echo "                1,500 damaged files of each format; archives whose drivers are killed; what gap, interval and"
	@echo "                confidence promise, in 500 simulated data sets each (minutes)"
	@echo "make deny       licences, sources and known faults of the crates that are used, with cargo-deny"
	@echo "make audit      known faults of the Python packages in .venv, with pip-audit"
	@echo "make notices    LICENSE-THIRD-PARTY.yml, with cargo-bundle-licenses"
	@echo "make fuzz       model files and sensor packets, with cargo-fuzz (FUZZ_RUNS=10000000 for a long run)"
	@echo "make loom       the ring of the wrench buffer in all orders that the memory model allows (seconds, once it is compiled)"
	@echo "make stress     1e9 items through the wrench buffer, with a reader that sleeps (RING_ITEMS=...; minutes)"
	@echo "make sanitize   the Rust tests under AddressSanitizer, those with threads under ThreadSanitizer (minutes)"
	@echo "make counts     instructions of the hot paths, by callgrind, beside the stored ones (benches/counts.json)"
	@echo "make memcheck   the Rust tests of kernels and golden bits under valgrind, baseline and AVX2 (minutes)"
	@echo "make miri       the same under Miri, of a nightly compiler, in small sizes"
	@echo "make arm64      the Rust tests on arm64 by qemu; tests/arm64.sh does it with Debian's compiler (minutes)"
	@echo "make semver     the crate's public face beside that of SINCE=revision, by cargo-semver-checks"
	@echo "make soak       the sensor client beside a busy interpreter: 10 minutes at 500 Hz, 1 minute at 7000 Hz"
	@echo "make bench-decision   time from the last sample to the answer, beside scipy and scikit-learn"
	@echo "make bench-archive    archives of RECORDINGS=100000: written, extracted, identified, beside a user's Dask script (half an hour)"
	@echo "make wheel      build a wheel into ./$(BUILT), and try it in an empty environment"
	@echo "make wheels     all wheels for Linux and the source distribution into ./dist, audited and run (half an hour)"

toolchain:
	@command -v cargo >/dev/null || { echo "granular_id needs a Rust toolchain, 1.89 or later: install rustup, then run this again" >&2; exit 1; }
	@cargo --version | awk '{ split($$2, v, "."); exit !(v[1] > 1 || v[2] >= 89) }' || { echo "granular_id needs Rust 1.89 or later, got $$(cargo --version): run rustup update" >&2; exit 1; }
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' 2>/dev/null || { echo "granular_id needs Python 3.10 or later as '$(PYTHON)'; name another with: make PYTHON=python3.12 ..." >&2; exit 1; }

$(BIN)/python: | toolchain
	@$(PYTHON) -m venv $(VENV) || { echo "could not make a virtual environment: install Python's venv module (Debian: python3-venv)" >&2; exit 1; }

# Editable: Python files are used where they are, Rust is built again when it changes. maturin shows cargo's progress,
# which pip would hide.
$(PACKAGE): $(SOURCES) | toolchain $(BIN)/python
	@echo "[1 of 2] fetching maturin, which builds the package"
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check '$(MATURIN)'
	@echo "[2 of 2] fetching numpy, scikit-learn, matplotlib, then compiling: the last two take half of the time"
	@VIRTUAL_ENV='$(CURDIR)/$(VENV)' PIP_QUIET=1 $(BIN)/maturin develop --extras app
	@touch $@

$(TOOLS): requirements-dev.txt $(PACKAGE)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements-dev.txt
	@touch $@

$(WHEEL): $(SOURCES) python/README.md LICENSE-THIRD-PARTY.yml $(shell find python -type f -not -name '*.so' -not -path '*/__pycache__/*') | toolchain $(BIN)/python
	@echo "building the wheel (two minutes the first time)"
	@rm -rf $(BUILT)
	@$(BIN)/python -m pip wheel --quiet --disable-pip-version-check --no-deps --wheel-dir $(BUILT) .
	@touch $@

# An environment with the wheel: $(call environment,folder,file of requirements,extras)
define environment
	@$(PYTHON) -m venv $(1)
	@$(1)/bin/python -m pip install --quiet --disable-pip-version-check --force-reinstall --no-deps $(BUILT)/*.whl
	@$(1)/bin/python -m pip install --quiet --disable-pip-version-check $(2) "$$(echo $(BUILT)/*.whl)$(3)"
	@touch $@
endef

$(RELEASE)/.package: $(WHEEL)
	$(call environment,$(RELEASE),$(shell grep -h '^pandas==\|^numba==' requirements-dev.txt requirements-bench.txt),[all])

# The peers want other versions than the tools do.
$(BENCHES)/.package: requirements-bench.txt $(WHEEL)
	$(call environment,$(BENCHES),--requirement requirements-bench.txt)

# The oldest versions that pyproject.toml admits.
$(OLDEST)/.package: requirements-oldest.txt $(WHEEL)
	$(call environment,$(OLDEST),--requirement requirements-oldest.txt,[app])

demo: $(PACKAGE)
	$(BIN)/granular-id demo --output demo --force

$(DOCTOOLS): requirements-docs.txt $(PACKAGE)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check --requirement requirements-docs.txt
	@touch $@

# The reference of the crate is part of the site; a warning is an error, and so is a link that leads nowhere. rustdoc adds to
# what is there: other crates that somebody documented would be published, too.
docs: $(DOCTOOLS)
	@$(BIN)/python -m sphinx --jobs auto --fail-on-warning --keep-going --quiet docs docs/_build/html
	@rm -rf target/doc docs/_build/html/rust
	@RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps
	@cp -r target/doc docs/_build/html/rust
	@$(BIN)/python docs/links.py docs/_build/html
	@echo "the site is there: open docs/_build/html/index.html"

test: rust-lint python-lint hosted-lint rust-test python-test
	@echo "make test: everything passed"

# A command, and how far it is: $(call step,3 of 9,command)
define step
	@printf '\033[1m[%s]\033[0m %s\n' '$(1)' '$(2)'
	@$(2)
endef

lint: rust-lint python-lint hosted-lint

FEATURES := $(shell sed -n '/^\[features\]/,/^$$/s/^\([a-z-]*\) = .*/\1/p' Cargo.toml)

rust-lint: | toolchain
	$(call step,Rust lint 1 of 5,cargo fmt --all --check && cargo fmt --check --manifest-path tests/fuzz/Cargo.toml)
	$(call step,Rust lint 2 of 5,cargo clippy --quiet --workspace --all-targets -- -D warnings)
	$(call step,Rust lint 3 of 5,cargo clippy --quiet --manifest-path tests/fuzz/Cargo.toml --no-default-features --target-dir target -- -D warnings)
	$(call step,Rust lint 4 of 5,RUSTDOCFLAGS="-D warnings" cargo doc --quiet --no-deps)
	$(call step,Rust lint 5 of 5: no feature and each alone,for feature in "" $(FEATURES); do cargo clippy --quiet --lib --no-default-features --features "$$feature" -- -D warnings || exit; done)

python-lint: $(TOOLS)
	$(call step,Python lint 1 of 5,$(BIN)/ruff check --quiet)
	$(call step,Python lint 2 of 5,$(BIN)/ruff format --quiet --check)
	$(call step,Python lint 3 of 5,$(BIN)/mypy --no-error-summary)
	$(call step,Python lint 4 of 5,$(BIN)/lint-imports --no-logo)
	$(call step,Python lint 5 of 5,$(BIN)/python -m mypy.stubtest --concise granular_id._core)

# With GH_TOKEN zizmor also asks whether the pinned commits are those of the versions beside them.
hosted-lint: $(TOOLS)
	$(call step,Hosted checks,$(BIN)/zizmor --quiet $(if $(GH_TOKEN),,--offline) .github)

rust-test: | toolchain
	$(call step,Rust tests,cargo test --quiet)

# Tests wait for clocks and other processes a quarter of their time: half as many processes again as there are cores.
PROCESSES = $(shell $(BIN)/python -c 'from granular_id._core import available_cores as n; print((3 * n() + 1) // 2)')

python-test: $(TOOLS)
	$(call step,Python tests 1 of 2,$(BIN)/python -m pytest --numprocesses $(PROCESSES) --dist worksteal)
	$(call step,Python tests 2 of 2: eight threads,GRANULAR_ID_CASES=13 $(BIN)/python -m pytest -p run-parallel --parallel-threads 8 $(firstword $(THREADED)))

# What takes too long for every change. `make test` runs a short form of each.
check-all: threads campaign fuzz loom stress sanitize memcheck counts soak oldest

threads: $(TOOLS)
	$(BIN)/python -m pytest -p run-parallel --parallel-threads 8 $(THREADED)

bench: bench-rust bench-peers bench-ecoc

bench-rust: | toolchain
	cargo bench --package granular-id-benches

# Other programs wait meanwhile, where the system grants it.
REALTIME ?= $(shell chrt -f 1 true 2>/dev/null && echo chrt -f 1)

benchmarks: $(RELEASE)/.package
	$(REALTIME) $(RELEASE)/bin/python benches/results.py
	$(RELEASE)/bin/python benches/page.py

bench-peers: $(RELEASE)/.package
	$(RELEASE)/bin/python benches/peers.py

# Folders of recordings for bench-accuracy, and further options of it: `make benchmarks` makes the page of what it writes.
FOLDERS ?= $(if $(GRANULAR_ID_DATA),$(addprefix $(GRANULAR_ID_DATA)/,sliding_wrench robot_failures))
ACCURACY ?= --out benches/accuracy.json

# Before anything is installed.
accuracy-data:
	@test -n "$(FOLDERS)" && ls -d $(FOLDERS) > /dev/null || { echo "make bench-accuracy needs recordings: set GRANULAR_ID_DATA to a folder with the data sets named in docs/guide/features.md, or FOLDERS=\"one two\" to folders of your own" >&2; exit 1; }

bench-accuracy: accuracy-data $(BENCHES)/.package
	$(BENCHES)/bin/python benches/accuracy.py $(FOLDERS) $(ACCURACY)

bench-ecoc: $(RELEASE)/.package
	$(RELEASE)/bin/python benches/ecoc.py

bench-decision: $(RELEASE)/.package
	$(RELEASE)/bin/python benches/decision.py

# Synthetic recordings for bench-archive: they stay in target/archive, 14 KB each.
RECORDINGS ?= 100000

bench-archive: $(RELEASE)/.package
	$(RELEASE)/bin/python benches/archive.py --folder target/archive --recordings $(RECORDINGS)

oldest: $(OLDEST)/.package
	$(OLDEST)/bin/python -m pytest -o filterwarnings=default

campaign: $(TOOLS)
	GRANULAR_ID_CASES=100000 $(BIN)/python -m pytest tests/python/core/test_signal_properties.py -k campaign -s
	GRANULAR_ID_CASES=3000 $(BIN)/python -m pytest tests/python/core/test_features.py -k campaign -s
	GRANULAR_ID_CASES=500 $(BIN)/python -m pytest tests/python/evaluation/test_simulations.py -s
	GRANULAR_ID_FORKS=100 $(BIN)/python -m pytest tests/python/core/test_fork.py
	GRANULAR_ID_CASES=1500 $(BIN)/python -m pytest tests/python/io/test_bad_files.py -k damaged
	GRANULAR_ID_CASES=200 $(BIN)/python -m pytest tests/python/archive/test_exactly_once.py
	GRANULAR_ID_CASES=500 $(BIN)/python -m pytest tests/python/confidence/test_confidence_simulations.py -s
	GRANULAR_ID_CASES=20000 cargo test --test core buffer_model
	GRANULAR_ID_CASES=5000 $(BIN)/python -m pytest tests/python/core/test_stream.py tests/python/core/test_stream_identifier.py

FUZZ_RUNS ?= 200000

# Items through the wrench buffer under stress: a short run is part of the tests.
RING_ITEMS ?= 1000000000

# Compiled apart, as all dependencies are told of loom.
loom: | toolchain
	RUSTFLAGS="--cfg loom" cargo test --quiet --target-dir target/loom --lib ring::model

stress: | toolchain
	GRANULAR_ID_RING_ITEMS=$(RING_ITEMS) cargo test --release --test core buffer_stress -- --nocapture

# The stable compiler has the sanitizers of nightly ones when told to.
SANITIZE := RUSTC_BOOTSTRAP=1 cargo test --quiet --target $(shell rustc -vV | sed -n 's/host: //p')

sanitize: | toolchain
	RUSTFLAGS=-Zsanitizer=address $(SANITIZE) --target-dir target/address --tests
	RUSTFLAGS="-Zsanitizer=thread -Cunsafe-allow-abi-mismatch=sanitizer" GRANULAR_ID_RING_ITEMS=1000000 \
	TSAN_OPTIONS=suppressions=$(CURDIR)/tests/data/tsan_suppressions.txt $(SANITIZE) --target-dir target/thread --test core -- buffer_stress rdt

counts: | toolchain
	@command -v valgrind >/dev/null || { echo "make counts needs valgrind" >&2; exit 1; }
	$(PYTHON) benches/counts.py

# valgrind knows no AVX-512.
MEMCHECK := PROPTEST_CASES=4 cargo test --quiet --config 'target."cfg(unix)".runner="valgrind --quiet --error-exitcode=9"'

memcheck: | toolchain
	@command -v valgrind >/dev/null || { echo "make memcheck needs valgrind" >&2; exit 1; }
	GRANULAR_ID_SIMD=baseline $(MEMCHECK) --test core golden
	GRANULAR_ID_SIMD=avx2 $(MEMCHECK) --test core golden
	$(MEMCHECK) --lib -- kernel:: dsp:: --test-threads=1

# Miri detects no vector unit beyond the baseline.
MIRI := PROPTEST_CASES=2 MIRIFLAGS=-Zmiri-disable-isolation cargo +nightly miri test --quiet

miri:
	@cargo +nightly miri --version >/dev/null 2>&1 || { echo "make miri needs: rustup toolchain install nightly --component miri,rust-src" >&2; exit 1; }
	$(MIRI) --test core golden
	$(MIRI) --lib -- kernel:: dsp::

# Debian: gcc-aarch64-linux-gnu, qemu-user.
arm64: export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER = aarch64-linux-gnu-gcc
arm64: export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_RUNNER = qemu-aarch64 -L /usr/aarch64-linux-gnu
arm64: | toolchain
	cargo test --quiet --target aarch64-unknown-linux-gnu --lib --tests

SINCE ?= $(shell git describe --tags --abbrev=0 2>/dev/null || echo HEAD~1)

semver: | toolchain
	@cargo semver-checks --version >/dev/null 2>&1 || { echo "make semver needs cargo-semver-checks: cargo install cargo-semver-checks" >&2; exit 1; }
	cargo semver-checks --package granular-id --baseline-rev $(SINCE)

soak: $(RELEASE)/.package
	$(RELEASE)/bin/python benches/rdt_soak.py --rate-hz 500 --seconds 600
	$(RELEASE)/bin/python benches/rdt_soak.py --rate-hz 7000 --seconds 60

# cargo-fuzz wants a nightly compiler; the stable one takes the same flags when told to.
FUZZ := RUSTC_BOOTSTRAP=1 cargo fuzz run --fuzz-dir tests/fuzz

deny: | toolchain
	@cargo deny --version >/dev/null 2>&1 || { echo "make deny needs cargo-deny: cargo install cargo-deny" >&2; exit 1; }
	cargo deny --workspace check

audit: $(TOOLS)
	@command -v pip-audit >/dev/null || { echo "make audit needs pip-audit: pipx install pip-audit" >&2; exit 1; }
	pip-audit --path "$$($(BIN)/python -c 'import sysconfig; print(sysconfig.get_path("platlib"))')"

# Wheels hold the crates; their licences want to be there, too.
notices: | toolchain
	@cargo bundle-licenses --version >/dev/null 2>&1 || { echo "make notices needs cargo-bundle-licenses: cargo install cargo-bundle-licenses" >&2; exit 1; }
	cd rust/python && cargo bundle-licenses --format yaml --prefer MIT --output $(CURDIR)/LICENSE-THIRD-PARTY.yml

fuzz: $(TOOLS)
	@cargo fuzz --version >/dev/null 2>&1 || { echo "make fuzz needs cargo-fuzz: cargo install cargo-fuzz" >&2; exit 1; }
	$(BIN)/python tests/fuzz/model_file_seeds.py
	$(FUZZ) model_file -- -runs=$(FUZZ_RUNS) -max_len=4096 -dict=tests/fuzz/model_file.dict
	$(FUZZ) rdt_packets -- -runs=$(FUZZ_RUNS) -max_len=4096

# Bare: numpy and scikit-learn come with it and nothing else. Then the command line beside it, as for [app].
wheel: $(WHEEL)
	@echo "installing it into an empty environment"
	@rm -rf $(CLEAN)
	@$(PYTHON) -m venv $(CLEAN)
	@$(CLEAN)/bin/python -m pip install --quiet --disable-pip-version-check $(BUILT)/*.whl
	@$(CLEAN)/bin/python -I examples/first_lines.py
	@$(CLEAN)/bin/python -m pip install --quiet --disable-pip-version-check "$$(echo $(BUILT)/*.whl)[app]"
	@$(CLEAN)/bin/granular-id --version
	@$(CLEAN)/bin/granular-id demo --output $(CLEAN)/demo > /dev/null
	@rm -rf $(CLEAN)
	@echo "both work; install it into yours: pip install \"$$(echo $(BUILT)/*.whl)[app]\""

wheels: | toolchain
	@$(PYTHON) -m venv $(PUBLISH)
	@$(PUBLISH)/bin/python -m pip install --quiet --disable-pip-version-check --requirement requirements-release.txt
	@$(PUBLISH)/bin/python tests/wheels.py

clean:
	rm -rf $(VENV) $(RELEASE) $(CLEAN) $(OLDEST) $(BENCHES) target dist demo docs/_build docs/gallery docs/reference/api/generated
