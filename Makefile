# `make sweep` sets everything up and reproduces both papers; `make test` passes the tests.
PYTHON ?= python3
VENV   ?= .venv
BIN    := $(VENV)/bin
READY  := $(VENV)/.ready
RESULTS ?= results
SCALE  ?= normal
JOBS   ?= 2
PAPERS := $(patsubst experiments/%.yaml,%,$(sort $(wildcard experiments/kapucu_baysec_1997/*.yaml experiments/bruschetta_2011/*.yaml)))
BOUND := $(filter-out at_the_bound/leaderboard,$(patsubst experiments/%.yaml,%,$(sort $(wildcard experiments/at_the_bound/*.yaml experiments/peers/*.yaml))))

export OMP_NUM_THREADS := 1
export OPENBLAS_NUM_THREADS := 1

.PHONY: docs bound gap rig machines test-socketcan setup sweep sweep-full papers figures leaderboard smoke test check check-full lint types bench lock clean help

help:
	@grep -E '^[a-z-]+:.*##' Makefile | sed -E 's/:.*## /\t/' | expand -t 16

setup: $(READY) ## the locked environment in .venv

$(READY): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or later is needed; $(PYTHON) is older. Say PYTHON=python3.12 or the like."; exit 2; }
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV) || { rm -rf $(VENV); echo "$(PYTHON) cannot make environments: install its venv module (Debian: apt-get install python3-venv)."; exit 2; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

sweep: $(READY) ## both papers: every figure, table and claim (under 15 minutes)
	@set -e; for study in $(PAPERS); do $(BIN)/sysid-bench sweep experiment=$$study results_dir=$(RESULTS) scale=$(SCALE); done
	@$(BIN)/sysid-bench papers results_dir=$(RESULTS) out=$(RESULTS)/papers.md

sweep-full: ## the same with 200 and 100 runs per point (under 90 minutes)
	@$(MAKE) sweep SCALE=full RESULTS=$(RESULTS)/full

papers: $(READY) ## docs/papers.md from the results of `make sweep`
	$(BIN)/sysid-bench papers results_dir=$(RESULTS) out=docs/papers.md

leaderboard: $(READY) ## every method against the Cramer-Rao bound: docs/leaderboard.md
	$(BIN)/sysid-bench sweep experiment=at_the_bound/leaderboard results_dir=$(RESULTS) scale=$(SCALE)
	$(BIN)/python -m sysid_bench.views.leaderboard $(RESULTS) docs/leaderboard.md

bound: $(READY) ## maximum likelihood and the peers at the Cramer-Rao bound, hard conditions too: docs/at_the_bound.md
	@set -e; for study in $(BOUND); do $(BIN)/sysid-bench sweep experiment=$$study results_dir=$(RESULTS) scale=$(SCALE); done
	$(BIN)/python -m sysid_bench.views.bound_page $(RESULTS) docs/at_the_bound.md

figures: $(READY) ## the README's figures from the results of `make sweep`
	@mkdir -p docs/figures
	cp $(RESULTS)/bruschetta_2011/fig5_2_5/figures/readme.png docs/figures/readme.png

smoke: $(READY) ## all methods on all plants in about 20 s
	$(BIN)/sysid-bench sweep experiment=smoke results_dir=$(RESULTS)

test: $(READY) ## the tests and the exact regression check
	$(BIN)/python -m pytest -m "not slow" -n $(JOBS)
	$(BIN)/sysid-bench check

check: $(READY) ## `make test` goes first; this adds the paired regression check, planted faults, kills (minutes)
	$(BIN)/sysid-bench check tier=paired
	$(BIN)/python -m pytest -m "slow and not full" -n $(JOBS)

check-full: check ## and claims on fresh seeds, coverage of intervals, every override (under an hour)
	$(BIN)/sysid-bench check tier=fresh
	$(BIN)/python -m pytest -m full -n $(JOBS)

rig: $(READY) ## emulator, measurement over a loopback bus, log, identification, M, D, K against the plant (2 minutes)
	$(BIN)/sysid-bench rig out=$(RESULTS)/rig

machines: $(READY) ## measured machines through the gap workflow, where SYSID_BENCH_DATA names their data (a minute)
	RESULTS=$(RESULTS) $(BIN)/python experiments/measured_machines/machines.py run

gap: $(READY) ## a hidden effect in the emulated rig, measured over CAN, named blind, then the seal opened (3 minutes)
	$(BIN)/python experiments/hidden_effects/blind.py --out $(RESULTS)/gap

test-socketcan: $(READY) ## device and host over a real SocketCAN kernel, candump as witness (minutes; says what to install)
	$(BIN)/python -m pytest -rs tests/socketcan

docs: $(READY) ## the documentation's site in site/, every link checked
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-docs.lock
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

lint: $(READY) ## ruff
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(READY) ## pyright (the build that brings its own node), strict where files and results are made
	$(BIN)/basedpyright --pythonpath $(BIN)/python sysid_bench

bench: $(READY) ## every benchmark, ratios with medians
	@set -e; for file in benchmarks/*.py; do echo "== $$file"; $(BIN)/python $$file; done

lock: ## requirements.lock and requirements-docs.lock from pyproject.toml: pinned, hashed, no addresses
	$(BIN)/python -m uv --version >/dev/null 2>&1 || $(BIN)/python -m pip install --quiet uv
	$(BIN)/python -m uv pip compile --quiet --universal --generate-hashes --no-header --extra dev pyproject.toml -o requirements.lock
	$(BIN)/python -m uv pip compile --quiet --universal --generate-hashes --no-header --extra docs -c requirements.lock pyproject.toml -o requirements-docs.lock

clean: ## the environment and all results but the reference
	rm -rf $(VENV) build dist site; find results -mindepth 1 -maxdepth 1 ! -name reference -exec rm -rf {} +
