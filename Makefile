# Every target creates .venv and installs what it needs when that is missing.
PYTHON ?= $(shell for python in python3 python3.11 python3.12 python3.13 python; do \
    $$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
    && echo $$python && break; done)
BIN := .venv/bin
# Compiled once, not by every process that a test starts.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo docs test pages test-kernels test-versions validate lint bench peers clean

# The main job: subgroup search, symbolic model, tables and figures of the paper.
demo: .venv/demo
	@$(BIN)/loopid paper --out out

# The documentation as a site; its search needs a server, as below.
docs: .venv/docs
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --quiet --site-dir site
	@echo 'site/index.html; with search: $(BIN)/python -m http.server -d site'

# As many processes as cores, each with one thread of linear algebra.
test pages test-kernels validate: export OPENBLAS_NUM_THREADS = 1

test: .venv/test
	$(BIN)/python -m pytest -n auto --dist worksteal

# What README, docs, docstrings and examples show is run, and the site is built. Reports are looked
# at in a browser.
pages: .venv/test
	$(BIN)/python -m pytest -m "pages and not validate" -n auto --dist worksteal \
	    $(addprefix tests/test_,api.py docs.py examples.py readme.py site.py) \
	    tests/report/test_html_pages.py

# What is numerical, but for Monte Carlo and refusals, with the linear algebra of processors without
# AVX-512, and without AVX.
NUMERICAL := tests/regressors \
    $(addprefix tests/identification/test_,consistent_fit.py correlation.py delay.py \
    identifiability.py identify.py least_squares.py numbers.py problem.py terms.py) \
    tests/export/test_identified_robots.py \
    $(addprefix tests/kinematics/test_,projection.py mobility.py) \
    $(addprefix tests/base_parameters/test_,ambiguous_rank.py exact_search.py known_robots.py \
    knee_base_parameters.py structure.py subgroup_limits.py ties.py)
test-kernels: .venv/test
	for kernel in Haswell Nehalem; do \
	    OPENBLAS_CORETYPE=$$kernel $(BIN)/python -m pytest -n auto --dist worksteal \
	        -m "not validate and not draws" -k "not refused and not cover" $(NUMERICAL) || exit 1; \
	done

# Each interpreter of this machine with the newest packages, the oldest one also with the lowest versions.
test-versions: .venv/pip
	$(BIN)/python tests/versions.py

# Monte Carlo and hammer tests that take minutes.
validate: .venv/test
	$(BIN)/python -m pytest -m validate -n auto --dist worksteal

lint: .venv/lint
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy

# What each one measures: docs/benchmarks.md.
bench: .venv/test peers
	$(BIN)/python benchmarks/startup.py
	$(BIN)/python benchmarks/search.py
	$(BIN)/python benchmarks/ranks.py
	$(BIN)/python benchmarks/symbolic.py
	$(BIN)/python benchmarks/identification.py
	$(BIN)/python benchmarks/observation.py
	$(BIN)/python benchmarks/logs.py
	$(BIN)/python benchmarks/intervals.py --runs 20
	$(BIN)/python benchmarks/friction.py --runs 16
	$(BIN)/python benchmarks/delays.py --runs 20
	$(BIN)/python benchmarks/log_faults.py --runs 20
	$(BIN)/python benchmarks/verdicts.py
	$(BIN)/python benchmarks/estimators.py
	$(BIN)/python benchmarks/consistency.py
	$(BIN)/python benchmarks/codegen.py
	$(BIN)/python benchmarks/peers.py
	$(BIN)/python benchmarks/certificates.py
	$(BIN)/python benchmarks/excitation.py

# Packages that loopid is compared with, in an environment of their own.
peers: .venv/peers/ready

clean:
	rm -rf .venv

# Stamps: an install runs again only when the dependencies change.
.venv/pip:
	@test -n "$(PYTHON)" || { echo "loopid needs Python 3.11 or newer on the PATH"; exit 1; }
	$(PYTHON) -m venv .venv
	@touch $@

.venv/demo: .venv/pip pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[symbolic]'
	@touch $@

.venv/docs: .venv/pip pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[docs]'
	@touch $@

.venv/test: .venv/pip pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test]'
	@touch $@ .venv/demo

.venv/lint: .venv/pip pyproject.toml
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[test,lint]'
	@touch $@ .venv/demo .venv/test

.venv/peers/ready: .venv/pip benchmarks/requirements-peers.txt
	$(PYTHON) -m venv .venv/peers
	.venv/peers/bin/python -m pip install --quiet --disable-pip-version-check \
	    -r benchmarks/requirements-peers.txt
	@touch $@
