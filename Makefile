# One virtual environment for everything; it needs nothing but Python 3.11 (or 3.12, 3.13) and make.
#   make PYTHON=/path/to/python    another interpreter
#   make VENV=/path                another place for the environment
#   make test ARGS="-k rotate"     more arguments for pytest
#   make fuzz SECONDS=600          shorter than an hour
VENV ?= .venv
PYTHON ?= $(shell for p in python3.11 python3 python3.12 python3.13; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' >/dev/null 2>&1 && echo $$p && break; done)
ARGS ?=
SECONDS ?= 3600

BIN := $(VENV)/bin
PY := $(BIN)/python
# Python compiles what it imports; doing so for all of torch beforehand takes longer than the installation.
PIP := $(PY) -m pip --disable-pip-version-check install --quiet --no-compile -c constraints.txt
DEV := $(VENV)/.installed-dev
REPORT := $(VENV)/.installed-report
LEARN := $(VENV)/.installed-learn
ACCURACY := $(VENV)/.installed-accuracy
PEERS := $(VENV)-peers/.installed
LEARNERS := $(VENV)-cleanrl/.installed $(VENV)-rllib/.installed $(VENV)-zoo/.installed
CONFIG ?= configs/agents/ppo.yaml
AGENTS ?= $(foreach task,Transport Align Rotate Sort Singulate SortTwelve,$(task)/ideal $(task)/prototype) Align/phasor

# Install the package with its EXTRAS. As soon as it runs without, its kernels are compiled beside the rest of the installation,
# which leaves a core with nothing to do. Nobody waits for them: what is compiled by then is kept, the rest is when it is needed.
define install
	$(PIP) -e .
	@nice $(PY) -m vibgym warm >$(VENV)/.warm.log 2>&1 & warm=$$!; \
		trap 'kill $$warm 2>/dev/null' EXIT; trap 'exit 130' INT TERM; \
		$(PIP) -e '.[$(EXTRAS)]' || exit; \
		if kill $$warm 2>/dev/null; then echo "some kernels are compiled, the others when they are first needed (now: make warm)"; \
		else wait $$warm || { tail -n 5 $(VENV)/.warm.log; echo "kernels could not be compiled, see $(VENV)/.warm.log"; } >&2; fi
endef

.NOTPARALLEL:
.PHONY: help venv warm learners peers test fuzz report publish verify compare docs replicate accuracy benchmark train notebooks release \
	format clean

help:
	@echo "make test        lint, import contracts, types, tests"
	@echo "make fuzz        random scenes, files and calls for an hour, or SECONDS=; prints what was tried"
	@echo "make report      evaluate the shipped policies: runs/report/report.html"
	@echo "make publish     keep what make report found: results/report/"
	@echo "make verify      play a sample of results/report/ again: does each figure lie in its interval?"
	@echo "make replicate   the thesis's figures beside ours: runs/replicate/replicate.html"
	@echo "make docs        these pages as a site: runs/docs/index.html"
	@echo "make accuracy    speed against error of all models and peers: runs/accuracy/"
	@echo "make benchmark   accuracy and speed, as docs/accuracy.md quotes them"
	@echo "make compare     learned against classical on the same seeds: runs/agents-compared/"
	@echo "make train       train the shipped agents, three seeds each, and write their table: results/agents.csv"
	@echo "make notebooks   execute the notebooks, which keep their pictures: notebooks/, or NOTEBOOKS=first_steps"
	@echo "make release     build sdist and wheel and try both in empty environments, on 3.11, 3.12, 3.13: dist/"
	@echo "make venv        $(VENV) with everything for development"
	@echo "make warm        all kernels, which are else compiled when they are first needed"
	@echo "make learners    $(VENV)-cleanrl, -rllib, -zoo: what other libraries' learners need, see docs/learners"
	@echo "make peers       $(VENV)-peers: EnvPool and gym-pusht, which python -m studies.benchmarks.peers compares with"
	@echo "make format      sort imports, format"
	@echo "make clean       remove the environment and all caches; runs/ stays"

venv: $(DEV)

warm: $(DEV)
	$(PY) -m vibgym warm

$(VENV)/pyvenv.cfg:
	@test -n "$(PYTHON)" || { echo "No Python 3.11, 3.12 or 3.13 found; name one with make PYTHON=..." >&2; exit 1; }
	$(PYTHON) -m venv --clear $(VENV) || { rm -f $@; exit 1; }

# The development extras hold all others, so they satisfy every stamp.
$(DEV): EXTRAS = dev
$(DEV): $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(install)
	@touch $(DEV) $(REPORT) $(LEARN) $(ACCURACY)

$(REPORT): EXTRAS = render,report
$(REPORT): $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(install)
	@touch $(REPORT)

$(ACCURACY): EXTRAS = accuracy,mujoco
$(ACCURACY): $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(install)
	@touch $(ACCURACY)

$(LEARN): EXTRAS = learn,render,report
$(LEARN): $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(install)
	@touch $(LEARN) $(REPORT)

# From an empty cache, so that no kernel is an old one. Kernels are compiled while one core would have nothing to do.
test: $(DEV) $(LEARNERS)
	@cache=$$(mktemp -d) && trap 'rm -rf "$$cache"' EXIT INT TERM && export NUMBA_CACHE_DIR="$$cache" && \
		{ $(PY) -m vibgym warm >"$$cache/warm.log" 2>&1 & } && warm=$$! && \
		$(BIN)/ruff check && $(BIN)/ruff format --check && $(BIN)/lint-imports && $(BIN)/pyright --pythonpath $(PY) && \
		{ wait $$warm || { cat "$$cache/warm.log"; exit 1; }; } && \
		$(PY) -m pytest -n 2 --dist worksteal $(ARGS)

# Each of two processes runs every fuzzer, on seeds of its own.
fuzz: $(DEV)
	VIBGYM_FUZZ_SECONDS=$(SECONDS) $(PY) -m pytest -n 2 --dist each $(ARGS) tests/fuzz

report: $(REPORT)
	$(PY) -m agents evaluate configs/evaluations/report.yaml

publish: $(REPORT)
	$(PY) -m agents publish configs/evaluations/report.yaml

# What is published comes out again: ARGS="--episodes 100", ARGS="--task Align".
verify: $(REPORT)
	$(PY) -m agents verify $(ARGS)

replicate: $(REPORT)
	$(PY) -m studies.thesis

# Without a network; a warning is an error, so that no link is dead.
docs: $(DEV)
	$(BIN)/sphinx-build -W --keep-going -q -b html docs runs/docs
	@echo "site: runs/docs/index.html"

accuracy: $(ACCURACY)
	$(PY) -m studies.accuracy configs/accuracy/shipped.yaml

learners: $(DEV) $(LEARNERS)

peers: $(DEV) $(PEERS)

# What needs other versions than ours, learners and environments to compare with: an environment each, which shows ours beneath
# what differs.
vpath %.txt docs/learners studies/benchmarks
$(VENV)-%/.installed: %.txt $(VENV)/pyvenv.cfg | $(DEV)
	$(PY) -m venv --clear --without-pip $(@D)
	$(PY) -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
		>"$$($(@D)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beneath.pth"
	$(@D)/bin/python -m pip --disable-pip-version-check install --quiet --no-compile -r $<
	@touch $@

# CleanRL's release forbids Python 3.11. Of it we need one file, which asks for nothing but what we have.
$(VENV)-cleanrl/.installed: $(VENV)/pyvenv.cfg | $(DEV)
	$(PIP) --no-deps --ignore-requires-python --upgrade --target $(@D) cleanrl==1.2.0
	@touch $@

benchmark: $(DEV) $(PEERS)
	$(PY) -m studies.benchmarks.accuracy
	$(PY) -m studies.benchmarks.kernel
	$(PY) -m studies.benchmarks.peers
	$(PY) -m studies.benchmarks.speed
	$(PY) -m studies.benchmarks.contacts
	$(PY) -m studies.benchmarks.crowds
	$(PY) -m studies.benchmarks.pile
	$(PY) -m studies.benchmarks.camera
	$(PY) -m studies.benchmarks.control
	$(PY) -m studies.benchmarks.training
	$(PY) -m studies.benchmarks.costs

# Some hours: three seeds of every agent; then their table and the best of each. AGENTS="Align/ideal" for some of them.
train: $(LEARN)
	@for agent in $(AGENTS); do for seed in 0 1 2; do $(PY) -m agents train $(CONFIG) --agent $$agent --seed $$seed || exit; done; done
	$(PY) -m agents tabulate $(CONFIG) $(AGENTS:%=--agent %) --ship vibgym/policies/trained/shipped --page docs/agents.md

compare: $(REPORT)
	$(PY) -m agents compare configs/comparisons/agents.yaml

NOTEBOOKS ?=
notebooks: $(DEV)
	$(PY) -m studies.notebooks $(NOTEBOOKS)

# What has passed lies in dist. ARGS="--extras play,learn" trains there, too; ARGS="--tag v0.2.0" is what the workflow says.
release: $(DEV)
	$(PY) -m studies.release $(ARGS)

format: $(DEV)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean:
	rm -rf .venv .venv-* build dist .hypothesis .import_linter_cache .pytest_cache .ruff_cache
	find vibgym agents studies tests -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true
