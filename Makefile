# make demo | figures | pictures | test | slow | lint | docs | notebooks | validate | faults | score | benchmark | dist: each installs what it needs into .venv first.
PYTHON ?= python3
CORES ?= 2
PYTHONS ?= python3.11 python3.12 python3.13
VENV = .venv
BIN = $(VENV)/bin
export MPLBACKEND = Agg
# Tests run side by side: more threads of one would wait for each other. Those of one file stay in
# one process, which makes what they share once. Every process reads all tests first, which takes
# half a minute of CPU: no more processes than cores.
test slow validate: export OPENBLAS_NUM_THREADS = 1
test slow validate: export OMP_NUM_THREADS = 1
# Every process that a test starts would compile the sources anew, and each of pytest's all the tests.
test slow validate: export PYTHONDONTWRITEBYTECODE =
# No test depends on another: files, and the tests of each, run in an order that is drawn from this
# seed. Make prints the command with it, so that `make test SEED=...` repeats an order.
SEED ?= $(shell date +%s)
PYTEST = $(BIN)/python -m pytest -n $(CORES) --dist loadfile --randomly-seed=$(SEED)

.PHONY: demo figures pictures test slow lint docs notebooks validate faults score benchmark dist shipped-taps clean
.DELETE_ON_ERROR:

figures: $(VENV)/figures.installed
	$(BIN)/bgmodel figures --workers $(CORES) $(if $(FAST),--fast)

demo: $(VENV)/core.installed
	$(BIN)/bgmodel demo --force

# Small copies of the figures of a full run, kept with the documentation.
pictures: figures
	$(BIN)/python -m figures.gallery

# With SLOW=1, slow ones too: every process reads the tests, imports and compiles once for both.
test: $(VENV)/test.installed
	$(PYTEST) $(if $(SLOW),-m 'not validate')

# Tests of seconds: engines cell by cell, blocks of pages, commands that are stopped and go on.
slow: $(VENV)/test.installed
	$(PYTEST) -m 'slow and not validate'

lint: $(VENV)/test.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Pages of modules that are gone would be warnings: the list is made anew.
docs: $(VENV)/docs.installed
	rm -rf docs/_modules
	$(BIN)/python -m sphinx -W --keep-going -b html docs docs/_build/html

# Executes the tutorials in place; their pages show the stored outputs.
notebooks: $(VENV)/docs.installed $(VENV)/fit.installed
	$(BIN)/python docs/_notebooks.py

validate: $(VENV)/test.installed $(VENV)/docs.installed
	$(PYTEST) -m validate

# Thirty single faults in a clone of the last commit, one at a time: which of them do tests catch?
faults: $(VENV)/test.installed
	OPENBLAS_NUM_THREADS=1 $(BIN)/python tests/validation/faults.py

benchmark: $(VENV)/bench.installed
	$(BIN)/python -m benchmarks.speed.decisions
	$(BIN)/python -m benchmarks.speed.circuits
	$(BIN)/python -m benchmarks.speed.sessions
	$(BIN)/python -m benchmarks.speed.explorer

score: $(VENV)/figures.installed $(VENV)/compare.installed
	$(BIN)/python -m figures measure page --workers $(CORES) $(if $(FAST),--fast)

# Wheel and sdist, tried in fresh environments on each Python that is there.
dist: $(VENV)/release.installed
	$(BIN)/python tests/dist.py $(PYTHONS)

# The table of decoded taps that ships with the package, made again from nothing.
shipped-taps: figures
	@test -z '$(FAST)' || { echo 'The shipped table comes from a full run: leave FAST out.'; exit 1; }
	cp figures/out/held_out_taps.parquet bgmodel/data/

$(VENV)/pyvenv.cfg:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { echo "Python 3.11 or newer is needed: make PYTHON=python3.12 ..."; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(VENV)/core.installed: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e .
	@touch $@

$(VENV)/%.installed: $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(BIN)/python -m pip install -q --disable-pip-version-check -c constraints.txt -e '.[$*]'
	@touch $@

clean:
	rm -rf figures/out figures/fast docs/_build docs/_modules
