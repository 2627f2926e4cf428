# Two commands: `make demo` plans the museum tour, `make test` runs all tests. Both set up .venv first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test proof mutants fuzz bench reference lint clean

demo: $(READY)
	$(BIN)/hpop plan examples/museum.yaml --out out/museum

test: $(READY)
	$(BIN)/python -m pytest -n 2 --dist loadfile

# The same tests, larger: all seeds, all instances. `make proof PART=search` runs one part of it.
proof: $(READY)
	$(BIN)/python tests/proof.py $(PART)

# Deliberate faults, the same ones each time: which of them the tests notice.
mutants: $(READY)
	$(BIN)/python -m tests.mutants

# Mutated inputs against every door, with fixed seeds. `make fuzz SECONDS=3600 SEED=1` throws more, and others.
SECONDS ?= 240
SEED ?= 0
fuzz: $(READY)
	$(BIN)/python tests/fuzz --seconds $(SECONDS) --seed $(SEED) --out out/fuzz.json

bench: $(READY)
	$(BIN)/python benchmarks/lattice.py --out out/bench/lattice.json
	$(BIN)/python benchmarks/first_answer.py --out out/bench/first_answer.json
	$(BIN)/python benchmarks/first_minute.py --out out/bench/first_minute.json
	$(BIN)/python benchmarks/graph.py --out out/bench/graph.json
	$(BIN)/python benchmarks/optimisers.py --out out/bench/optimisers.json
	$(BIN)/python benchmarks/criteria.py --out out/bench/criteria.json
	$(BIN)/python benchmarks/weighted_sum.py --out out/bench/weighted_sum.json
	$(BIN)/python benchmarks/epsilon_constraint.py --out out/bench/epsilon_constraint.json
	$(BIN)/python benchmarks/smoothing.py --out out/bench/smoothing.json
	$(BIN)/python benchmarks/any_angle.py --out out/bench/any_angle.json
	$(BIN)/python benchmarks/weighted_sum_corridor.py --out out/bench/weighted_sum_corridor.json
	$(BIN)/python benchmarks/mean.py --out out/bench/mean.json
	$(BIN)/python benchmarks/arm.py --out out/bench/arm.json
	$(BIN)/python benchmarks/arm_plans.py --out out/bench/arm_plans.json

reference: $(READY)
	$(BIN)/python docs/make_reference.py

lint: $(READY)
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; assert sys.version_info >= (3, 11), "hpop needs Python 3.11 or later, this is " + sys.version'
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[dev]'
	touch $(READY)

clean:
	rm -rf $(VENV) out
