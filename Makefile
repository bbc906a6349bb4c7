# A machine with Python 3.11 and make needs two commands: `make demo` and `make test`.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin

# Three test processes on two cores: one waits for instruments most of the time, two compute at a lower priority
# (tests/conftest.py).
TESTING := -m 'not slow' -n 3 --dist loadgroup

# More threads for linear algebra would slow them down.
export OPENBLAS_NUM_THREADS ?= 1
# The tests start hundreds of processes: without compiled modules each needs two seconds more.
unexport PYTHONDONTWRITEBYTECODE
STAMP  := $(VENV)/.installed

.PHONY: demo test test-slow explore blind foreign confidence soak lint types bench site clean

$(STAMP): pyproject.toml constraints.txt
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "armscope needs Python 3.11 or later")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[test,lint]'
	touch $@

demo: $(STAMP)
	$(BIN)/python -m armscope demo

test: $(STAMP)
	$(BIN)/python -m pytest $(TESTING)

test-slow: $(STAMP)
	$(BIN)/python -m pytest -m slow

# The properties of the suite on examples that nobody has seen: `make test` draws the same ones every time.
explore: $(STAMP)
	grep -rl '^@given\|^    @given' tests | xargs $(BIN)/python -m pytest $(TESTING) --hypothesis-profile=explore

blind: $(STAMP)
	$(BIN)/python -m tests.blind

# Arms that are not the Puma: effects hidden in MuJoCo's arms (1 to 2 minutes per case and core), then 500 random arms.
foreign: $(STAMP)
	$(BIN)/python -m tests.foreign.proving_ground
	$(BIN)/python -m tests.foreign

# How often names are right: new cases (SEED=...; hours), then the table and the diagram of stated confidence.
confidence: $(STAMP)
	$(if $(SEED),$(BIN)/python -m tests.confidence run --seed $(SEED))
	$(BIN)/python -m tests.confidence fit

# 10 minutes; HOURS=12 or MINUTES=60 for more. Writes soak/soak.json and soak/soak.md.
soak: $(STAMP)
	$(BIN)/python -m tests.soak $(if $(HOURS),--hours $(HOURS),--minutes $(or $(MINUTES),10))

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

bench: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[bench]'

# The documents as a site in site/, which works from the folder: open site/index.html.
site: $(STAMP)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -c constraints.txt -e '.[site]'
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

clean:
	rm -rf $(VENV) build dist site *.egg-info
