# Two commands: `make demo` plans the museum tour, `make test` runs all tests. Both set up .venv first, the
# second with the tools of development.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
TOOLS := $(VENV)/.tools

.PHONY: demo test proof mutants fuzz bench reference docs web lint wheel-search pythons clean

demo: $(READY)
	$(BIN)/hpop demo

test: $(TOOLS)
	$(BIN)/python -m pytest -n 2 --dist loadfile

# The same tests, larger: all seeds, all instances. `make proof PART=search` runs one part of it.
proof: $(TOOLS)
	$(BIN)/python tests/proof.py $(PART)

# Deliberate faults, the same ones each time: which of them the tests notice.
mutants: $(TOOLS)
	$(BIN)/python -m tests.mutants

# Mutated inputs against every door, with fixed seeds. `make fuzz SECONDS=3600 SEED=1` throws more, and others.
SECONDS ?= 240
SEED ?= 0
fuzz: $(TOOLS)
	$(BIN)/python tests/fuzz --seconds $(SECONDS) --seed $(SEED) --out out/fuzz.json

bench: $(TOOLS)
	$(BIN)/python benchmarks/lattice.py --out out/bench/lattice.json
	$(BIN)/python benchmarks/first_answer.py --out out/bench/first_answer.json
	$(BIN)/python benchmarks/first_minute.py --out out/bench/first_minute.json
	$(BIN)/python benchmarks/many_queries.py --out out/bench/many_queries.json
	$(BIN)/python benchmarks/scale.py --out out/bench/scale.json
	$(BIN)/python benchmarks/batch.py --out out/bench/batch.json
	$(BIN)/python benchmarks/speeds.py --out out/bench/speeds.json
	$(BIN)/python benchmarks/tours.py --out out/bench/tours.json
	$(BIN)/python benchmarks/graph.py --out out/bench/graph.json
	$(BIN)/python benchmarks/general.py --out out/bench/general.json
	$(BIN)/python benchmarks/optimisers.py --out out/bench/optimisers.json
	$(BIN)/python benchmarks/criteria.py --out out/bench/criteria.json
	$(BIN)/python benchmarks/weighted_sum.py --out out/bench/weighted_sum.json
	$(BIN)/python benchmarks/epsilon_constraint.py --out out/bench/epsilon_constraint.json
	$(BIN)/python benchmarks/smoothing.py --out out/bench/smoothing.json
	$(BIN)/python benchmarks/any_angle.py --out out/bench/any_angle.json
	$(BIN)/python benchmarks/weighted_sum_corridor.py --out out/bench/weighted_sum_corridor.json
	$(BIN)/python benchmarks/mean.py --out out/bench/mean.json
	$(BIN)/python benchmarks/live.py --out out/bench/live.json
	$(BIN)/python benchmarks/drive.py --out out/bench/drive.json
	$(BIN)/python benchmarks/ride.py --out out/bench/ride.json
	$(BIN)/python benchmarks/page.py --out out/bench/page.json
	$(BIN)/python benchmarks/corridor.py --out out/bench/corridor.json
	$(BIN)/python benchmarks/arm.py --out out/bench/arm.json
	$(BIN)/python benchmarks/arm_plans.py --out out/bench/arm_plans.json
	$(BIN)/python benchmarks/timed.py --out out/bench/timed.json
	$(BIN)/python benchmarks/preference.py --out out/bench/preference.json
	$(BIN)/python benchmarks/ratings.py --out out/bench/ratings.json

reference: $(TOOLS)
	$(BIN)/python docs/make_reference.py

# The documentation site in out/docs: pictures by running the examples, the pages, and whether every link leads somewhere.
docs: $(TOOLS)
	$(BIN)/python docs/make_pictures.py
	$(BIN)/python -m sphinx -W --keep-going -n -q -d out/doctrees docs out/docs
	$(BIN)/python docs/check_site.py out/docs

# The scripts of the pages, bundled from web/ with node, and committed: to install hpop or test it needs no node.
web:
	cd web && npm ci --silent && npm run --silent build && npm run --silent check

lint: $(TOOLS)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# The search alone, as the small wheel hpop-search in out/wheels.
wheel-search: $(TOOLS)
	$(BIN)/python tools/search/build.py out/wheels

# Other versions of Python, those that are found: the wheel, what it needs, the demo and some tests.
pythons:
	tools/pythons.sh

# What hpop needs, and no more; then the tools of its development. Both are in one environment, of the versions pinned:
# wheels alone, each with its hash, so that no package runs code while it is installed; then hpop, built without isolation
# by the setuptools that is locked too.
$(READY): pyproject.toml requirements-lock.txt
	$(call install,requirements-lock.txt)
	touch $(READY)

$(TOOLS): pyproject.toml requirements-lock-dev.txt
	$(call install,requirements-lock-dev.txt)
	touch $(READY) $(TOOLS)

define install
$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "hpop needs Python 3.11 or later, this is " + sys.version'
test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes --no-deps --only-binary :all: -r $(1)
$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
$(BIN)/python -m pip --quiet --disable-pip-version-check check
endef

clean:
	rm -rf $(VENV) out
