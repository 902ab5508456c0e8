# The two commands of the README, each complete from a bare checkout: `make demo` and `make test`.
# Needs: Debian with Python 3.11 and make. Everything else is installed here, in folders of this checkout, or with apt-get.

# Debian's own where it is there: the packages run on it, and another 3.11 of the path may be right where this one is wrong
PYTHON ?= $(firstword $(wildcard /usr/bin/python3.11) python3.11)
VENV := .venv
TEST_VENV := .venv-test
MUTANTS_VENV := .venv-mutants
UV := .tools/bin/uv
STEPDIAG := $(VENV)/bin/stepdiag
# what builds the wheel is checked by its hash, like everything else
BUILD := --quiet --wheel --build-constraint tools/build.txt --require-hashes
# what an environment imports, and no library's own tests: a daemon that compiles what it imports during its first seconds stands
# still and misses the first stop. mypy is native code, and nobody imports fontTools, which matplotlib brings
COMPILE := -m compileall -q -j 0 -x '/(tests|mypy|mypyc|fontTools)/'
RELEASE ?= release
MINUTES ?= 10

.DEFAULT_GOAL := help
.PHONY: help demo test matrix explore mutants soak faults references bench honesty custody partners format rooms release deb docs clean

help: ## this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /\1\t/' | expand -t 12

demo: $(VENV)/.ready ## the whole job on a virtual machine, into demo/
	test ! -e demo || mv demo demo-$$(date +%Y%m%d-%H%M%S)
	$(STEPDIAG) demo --out demo

# Debian's packages and those of Node.js come beside the unit tests (tools/test), unless somebody has to be asked for them
test: $(TEST_VENV)/.ready ## style, types, layers and every test against the installed wheel
	tools/debian --asking
	tools/test $(TEST_VENV)

matrix: $(TEST_VENV)/.ready ## the unit tests on Python 3.11, 3.12 and 3.13
	tools/matrix dist

# the property tests with examples that nobody has seen, the long lists of cases whole, twenty times the changed files of somebody else, every file door of the command line
# with files that are right but for one field, and then these doors by turns for so many minutes: `make explore MINUTES=60`
explore: $(TEST_VENV)/.ready ## property tests and fuzzing with examples nobody has seen
	STEPDIAG_FUZZ_EXAMPLES=600 $(TEST_VENV)/bin/pytest --hypothesis-profile explore -n auto -m "not system and not page and not control and not partner" tests
	$(TEST_VENV)/bin/pytest --hypothesis-profile explore -n 8 --dist loadgroup -m "system and not control" tests/system/faults tests/system/recording tests/system/shop
	$(TEST_VENV)/bin/python tests/fuzz/by_turns.py $(MINUTES)

# libmodbus, Node, snap7's C server, Prometheus, DuckDB, polars, pandas: beside `make test`, for it has eleven of its twelve minutes
partners: $(VENV)/.ready ## every wire and file against an implementation that nobody here wrote
	tools/debian gcc libc6-dev libmodbus-dev linuxcnc-uspace linuxcnc-uspace-dev mbpoll nodejs npm pkg-config prometheus
	npm ci --prefix tests/partners/js --no-fund --no-audit --silent
	UV_PROJECT_ENVIRONMENT=.setup/partners $(UV) sync --frozen --quiet --all-extras --group partners --python $(PYTHON)
	test -e .setup/snap7 || $(UV) venv --quiet --python $(PYTHON) .setup/snap7
	$(UV) pip install --quiet --python .setup/snap7/bin/python --require-hashes -r tools/partners.txt
	.setup/partners/bin/pytest -q -p no:xdist -m partner tests/partners
	.setup/partners/bin/pytest -q -p no:xdist tests/system/control/test_tables.py tests/system/control/test_proof.py

# every change: a night; a sample: `make mutants COUNT=400 SEED=10`, see docs/testing.md
mutants: $(MUTANTS_VENV)/.ready ## how sharp the tests are: small changes that a test must notice
	tools/debian
	nice -n 19 $(MUTANTS_VENV)/bin/python tools/mutants $(if $(COUNT),--count $(COUNT)) $(if $(SEED),--seed $(SEED))

# kill -9, two hundred times in one survey
soak: $(TEST_VENV)/.ready ## two hundred kills in one survey
	STEPDIAG_SOAK_KILLS=200 $(TEST_VENV)/bin/pytest tests/system/recording/test_soak.py

faults: $(VENV)/.ready ## every fault from the wires to the files in the control: the table of docs/faults.md
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python tools/faults

# recorded inputs and what the program makes of them: tests/data/reference/README.md
references: $(VENV)/.ready ## the reference data of the tests, after a change that was to change figures
	OPENBLAS_NUM_THREADS=1 $(VENV)/bin/python tools/references

bench: $(VENV)/.ready ## every figure of speed beside its floor or its peer
	$(VENV)/bin/python -m benchmarks

honesty: $(VENV)/.ready ## does what the solver says of itself hold, against exact machines
	$(VENV)/bin/python -m benchmarks.honesty
	$(VENV)/bin/python -m benchmarks.honesty --explained 20
	$(VENV)/bin/python -m benchmarks.large_angles 20
	for each in wrong_tables hasty designs; do $(VENV)/bin/python -m benchmarks.$$each || exit 1; done

# ten thousand bits, and machines that stand exactly at their tolerance: half an hour
custody: $(VENV)/.ready ## is every flipped bit found, and how often is a machine at its limit accepted
	$(VENV)/bin/python -m benchmarks.custody
	$(VENV)/bin/python -m benchmarks.acceptance

format: $(VENV)/.ready rooms ## style mended, the tree of rooms written
	$(VENV)/bin/ruff format .
	$(VENV)/bin/ruff check --fix .

rooms: ## the tree of rooms into docs/architecture.md, the findings into docs/findings.md
	tools/rooms docs/architecture.md
	tools/findings docs/findings.md

# the wheel is built twice, and must come out the same; how to sign: docs/security.md
release: $(VENV)/.ready ## wheel, locked requirements, SBOM, licences and hashes, into release/
	rm -rf $(RELEASE) && mkdir -p $(RELEASE)
	$(UV) build $(BUILD) --out-dir $(RELEASE)
	$(UV) build $(BUILD) --out-dir $(RELEASE)/again
	cmp $(RELEASE)/*.whl $(RELEASE)/again/*.whl && rm -r $(RELEASE)/again $(RELEASE)/.gitignore
	$(UV) export --frozen --quiet --no-dev --no-emit-project --output-file $(RELEASE)/requirements.txt
	$(UV) export --frozen --quiet --no-dev --preview-features sbom-export --format cyclonedx1.5 --output-file $(RELEASE)/sbom.cdx.json
	$(VENV)/bin/python tools/licences uv.lock > $(RELEASE)/LICENCES.md
	cp LICENSE $(RELEASE)/
	tools/sums $(RELEASE)

deb: $(VENV)/.ready ## packages for Debian 12, 13 and Ubuntu 24.04 on amd64 and arm64, into release/, listed in its SHA256SUMS
	rm -rf $(RELEASE)/wheel && mkdir -p $(RELEASE)/wheel
	$(UV) build $(BUILD) --out-dir $(RELEASE)/wheel
	for suite in bookworm trixie noble; do for architecture in amd64 arm64; do \
	    tools/deb $(RELEASE)/wheel/*.whl $$architecture $(RELEASE) $$suite || exit 1; done; done
	rm -r $(RELEASE)/wheel

docs: $(VENV)/.ready ## the documentation as a site, into .setup/site/; a link that leads nowhere ends it
	tools/docs .setup/docs
	UV_PROJECT_ENVIRONMENT=.setup/docs-venv $(UV) sync --frozen --quiet --only-group docs --no-install-project --python $(PYTHON)
	NO_MKDOCS_2_WARNING=1 .setup/docs-venv/bin/mkdocs --quiet build --strict

clean: ## all that this Makefile made
	rm -rf $(VENV) $(TEST_VENV) $(MUTANTS_VENV) .mutants .tools .setup dist build $(RELEASE)

$(UV): tools/bootstrap tools/uv.txt
	tools/bootstrap $(PYTHON)
	touch $@

# What `stepdiag` needs to run from this checkout, and what a developer wants beside it.
$(VENV)/.ready: pyproject.toml uv.lock | $(UV)
	UV_PROJECT_ENVIRONMENT=$(VENV) $(UV) sync --frozen --quiet --all-extras --python $(PYTHON)
	$(VENV)/bin/python $(COMPILE) $(VENV)/lib solver exporters daq stepdiag
	touch $@

$(MUTANTS_VENV)/.ready: pyproject.toml uv.lock | $(UV)
	UV_PROJECT_ENVIRONMENT=$(MUTANTS_VENV) $(UV) sync --frozen --quiet --all-extras --compile-bytecode --group mutants --python $(PYTHON)
	touch $@

# the same libraries, but stepdiag as the built wheel: what is tested is what is installed
$(TEST_VENV)/.ready: pyproject.toml uv.lock $(shell find solver exporters daq stepdiag systemd -type f -not -path "*/__pycache__/*") | $(UV)
	UV_PROJECT_ENVIRONMENT=$(TEST_VENV) $(UV) sync --frozen --quiet --all-extras --no-install-project --python $(PYTHON)
	rm -rf dist
	$(UV) build $(BUILD) --out-dir dist
	$(UV) pip install --quiet --python $(TEST_VENV)/bin/python --no-deps --reinstall dist/stepdiag-*.whl
	$(TEST_VENV)/bin/python $(COMPILE) $(TEST_VENV)/lib
	touch $@

.setup/debian: tools/debian-packages tools/debian
	tools/debian
	mkdir -p .setup && touch $@

.setup/node: $(wildcard tests/*/node/package-lock.json) | .setup/debian
	for folder in $(dir $^); do npm ci --prefix $$folder --no-fund --no-audit --silent || exit 1; done
	mkdir -p .setup && touch $@
