# One virtual environment for everything. Requirements: Python 3.11 to 3.14, and make.
#   make PYTHON=/path/to/python    another interpreter
#   make VENV=/path                another directory for the environment
#   make test ARGS="-k rotate"     more arguments for pytest
#   make fuzz SECONDS=600          shorter than an hour
#   make test-bounds NEWEST=/path/to/python    another interpreter for the highest versions
VENV ?= .venv
PYTHON ?= $(shell for p in python3.11 python3 python3.12 python3.13 python3.14; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 14))' >/dev/null 2>&1 && echo $$p && break; done)
NEWEST ?= $(shell for p in python3.14 ~/.pyenv/versions/3.14.*/bin/python python3.13 ~/.pyenv/versions/3.13.*/bin/python python3.12 python3.11; do \
	$$p -c '' >/dev/null 2>&1 && echo $$p && break; done)
ARGS ?=
SECONDS ?= 3600

BIN := $(VENV)/bin
PY := $(BIN)/python
# Without --no-compile, compiling all of torch takes longer than the installation.
PIP := $(PY) -m pip --disable-pip-version-check install --quiet --no-compile -c constraints.txt
DEMO := $(VENV)/.installed-demo
DEV := $(VENV)/.installed-dev
TEST := $(VENV)/.installed-test
REPORT := $(VENV)/.installed-report
LEARN := $(VENV)/.installed-learn
ACCURACY := $(VENV)/.installed-accuracy
PEERS := $(VENV)-peers/.installed
LEARNERS := $(addprefix $(VENV)-,$(addsuffix /.installed,benchmarl cleanrl lerobot rllib zoo))
CONFIG ?= configs/agents/ppo.yaml
AGENTS ?= $(foreach task,Transport Align Rotate Sort Singulate SortTwelve,$(task)/ideal $(task)/prototype) Align/phasor
# Those of the open tasks, each after the one it starts from; none if AGENTS is given.
OPEN ?= $(if $(filter file,$(origin AGENTS)),Swap/taught Swap/first Swap/second Swap/third Swap/ideal SwapCrowded/ideal \
	PackFull/taught PackFull/first PackFull/second PackFull/third PackFull/fourth PackFull/ideal FeedHeaps/ideal Feed/ideal \
	Pack/taught Pack/first Pack/ideal Pack/prototype Push/joint)
SEEDS ?= 0 1 2
OPEN_SEEDS ?= 1 2 3

# Install the package, then its EXTRAS. Meanwhile the idle core compiles kernels; those not compiled by the end of the
# installation are compiled on first use.
define install
	@echo "installing vibgym[$(EXTRAS)] in $(VENV)$(TAKES)"
	@$(PIP) -e .
	@nice $(PY) -m vibgym warm >$(VENV)/.warm.log 2>&1 & warm=$$!; \
		trap 'kill $$warm 2>/dev/null' EXIT; trap 'exit 130' INT TERM; \
		$(PIP) -e '.[$(EXTRAS)]' || exit; \
		if kill $$warm 2>/dev/null; then echo "some kernels are compiled, the others on first use (now: $(PY) -m vibgym warm)"; \
		else wait $$warm || { tail -n 5 $(VENV)/.warm.log; echo "kernels could not be compiled, see $(VENV)/.warm.log"; } >&2; fi
endef

.NOTPARALLEL:
.PHONY: help demo venv warm learners peers test test-all test-bounds fuzz report publish verify compare docs replicate accuracy benchmark train notebooks release \
	format clean

help:
	@echo "make demo        policies align and sort parts: a table, and a picture in runs/demo, in a minute"
	@echo "make test        lint, import contracts, types, tests of the core, in about 8 minutes"
	@echo "make test-all    all tests: also pages in a browser, documentation, wheels, other libraries, studies"
	@echo "make test-bounds tests of the core with the lowest supported versions of all packages, then with the highest"
	@echo "make fuzz        random scenes, files and calls for an hour, or SECONDS=; prints what was tried"
	@echo "make report      evaluate the shipped policies: runs/report/report.html"
	@echo "make publish     copy the results of make report to results/report/"
	@echo "make verify      evaluate a sample of results/report/ again and compare the figures with their intervals"
	@echo "make replicate   the thesis's figures beside the simulated ones: runs/replicate/replicate.html"
	@echo "make docs        build the documentation site: runs/docs/index.html"
	@echo "make accuracy    speed against error of all models and peers: runs/accuracy/"
	@echo "make benchmark   accuracy and speed, the figures of docs/accuracy.md"
	@echo "make compare     learned against classical on the same seeds: runs/agents-compared/"
	@echo "make train       train the shipped agents, three seeds each, and write their table: results/agents.csv"
	@echo "make notebooks   execute the notebooks in place: notebooks/, or NOTEBOOKS=first_steps"
	@echo "make release     build sdist and wheel and test them in empty environments, on 3.11 to 3.14: dist/"
	@echo "make venv        $(VENV) with everything for development"
	@echo "make warm        compile all kernels, otherwise compiled on first use"
	@echo "make learners    $(VENV)-benchmarl, -cleanrl, -lerobot, -rllib, -zoo: environments of other libraries, see docs/learners"
	@echo "make peers       $(VENV)-peers: EnvPool and gym-pusht for python -m studies.benchmarks.peers"
	@echo "make format      sort imports, format"
	@echo "make clean       remove the environment and all caches, but not runs/"

venv: $(DEV)

warm: $(DEV)
	$(PY) -m vibgym warm

$(VENV)/pyvenv.cfg:
	@test -n "$(PYTHON)" || { echo "No Python 3.11 to 3.14 found; name one with make PYTHON=..." >&2; exit 1; }
	@echo "creating $(VENV) with $(PYTHON)"
	@$(PYTHON) -m venv --clear $(VENV) || { rm -f $@; exit 1; }

# Stamps of installed extras. ALSO: those whose extras are among them.
$(DEMO): EXTRAS = policies,render
$(DEMO): TAKES = : 130 MB of packages, about 15 s and the download
$(REPORT): EXTRAS = render,report
$(REPORT): ALSO = $(DEMO)
$(ACCURACY): EXTRAS = accuracy,mujoco
$(LEARN): EXTRAS = learn,render,report
$(LEARN): ALSO = $(REPORT) $(DEMO)
$(TEST): EXTRAS = test
$(TEST): TAKES = : 500 MB of packages, about 1 minute and the download
$(TEST): ALSO = $(LEARN) $(REPORT) $(DEMO)
$(DEV): EXTRAS = dev
$(DEV): ALSO = $(TEST) $(LEARN) $(ACCURACY) $(REPORT) $(DEMO)
$(DEMO) $(REPORT) $(ACCURACY) $(LEARN) $(TEST) $(DEV): $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(install)
	@touch $@ $(ALSO)

# Kernels are compiled on one core while the checks run on the other. The cache is keyed by the digests of the sources, so
# only kernels that have changed are compiled again. Imports that cannot be found are warnings of the type checker: make test
# runs without the optional libraries; make test-all, with all of them, fails on warnings. PLW1514: text files have an encoding,
# which is not UTF-8 by default on Windows.
define checks
	{ $(PY) -m vibgym warm >$(VENV)/.warm.log 2>&1 & } && warm=$$! && \
		$(BIN)/ruff check && $(BIN)/ruff format --check && $(BIN)/lint-imports && \
		$(BIN)/ruff check --preview --select PLW1514 vibgym agents studies && \
		$(BIN)/pyright $(1) --pythonpath $(PY) && \
		{ wait $$warm || { cat $(VENV)/.warm.log; exit 1; }; }
endef

# Policies align and sort parts: a table, and a picture in runs/demo.
demo: $(DEMO)
	@echo "policies align and sort parts: about 20 s, 10 s once all kernels are compiled"
	@$(PY) examples/demo.py

# What every change must pass: python and make only, no browser, no other RL libraries.
test: $(TEST)
	@echo "lint, import contracts and types; kernels are compiled meanwhile: about 2 minutes, or seconds once they are"
	@$(call checks,--level error)
	@echo "tests of the core: about 5 minutes on two idle cores"
	@$(PY) -m pytest -n 2 --dist worksteal -m "not full" $(ARGS) @tests/core.txt

# All tests; CI runs this. Fuzzers run four times as many examples as in make test.
test-all: $(DEV) $(LEARNERS)
	@$(call checks,--warnings) && VIBGYM_FUZZ_FACTOR=4 $(PY) -m pytest -n 2 --dist worksteal $(ARGS)

# Tests of the core, without torch, in environments of their own and without constraints.txt: with the lowest versions that
# pyproject.toml allows, and with the highest ones on the newest Python.
test-bounds: $(VENV)/.installed-uv
	$(call bounds,lowest-direct,$(PYTHON))
	$(call bounds,highest,$(NEWEST))

$(VENV)/.installed-uv: $(VENV)/pyvenv.cfg constraints.txt
	$(PIP) uv
	@touch $@

define bounds
$(BIN)/uv venv --quiet --no-python-downloads --clear --python $(2) $(VENV)-$(1)
$(BIN)/uv pip install --quiet --python $(VENV)-$(1)/bin/python --resolution $(1) --editable '.[bounds]'
NUMBA_CACHE_DIR=$(abspath $(VENV)-$(1)/kernels) $(VENV)-$(1)/bin/python -m pytest -n 2 --dist worksteal -m "not full" $(ARGS) @tests/core.txt
endef

# Two processes run every fuzzer, each with its own seeds.
fuzz: $(DEV)
	VIBGYM_FUZZ_SECONDS=$(SECONDS) $(PY) -m pytest -n 2 --dist each --timeout 0 $(ARGS) tests/fuzz

report: $(REPORT)
	$(PY) -m agents evaluate configs/evaluations/report.yaml

publish: $(REPORT)
	$(PY) -m agents publish configs/evaluations/report.yaml

# Options: ARGS="--episodes 100", ARGS="--task Align".
verify: $(REPORT)
	$(PY) -m agents verify $(ARGS)

replicate: $(REPORT)
	$(PY) -m studies.thesis

# Needs no network. Warnings are errors, so links are checked.
docs: $(DEV)
	$(BIN)/sphinx-build -W --keep-going -q -b html docs runs/docs
	@echo "site: runs/docs/index.html"

accuracy: $(ACCURACY)
	$(PY) -m studies.accuracy configs/accuracy/shipped.yaml

learners: $(DEV) $(LEARNERS)

peers: $(DEV) $(PEERS)

# Learners and environments that need other versions of our dependencies: one environment each, layered over ours. The argument
# is for pip.
define layer
	$(PY) -m venv --clear --without-pip $(@D)
	$(PY) -c 'import sysconfig; print("import site; site.addsitedir(%r)" % sysconfig.get_path("purelib"))' \
		>"$$($(@D)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))')/beneath.pth"
	$(@D)/bin/python -m pip --disable-pip-version-check install --quiet --no-compile $(1) -r $<
endef
vpath %.txt docs/learners studies/benchmarks
$(VENV)-%/.installed: %.txt $(VENV)/pyvenv.cfg | $(DEV)
	$(layer)
	@touch $@

# BenchMARL requires libraries for videos.
$(VENV)-benchmarl/.installed: benchmarl.txt $(VENV)/pyvenv.cfg | $(DEV)
	$(call layer,--no-deps)
	@touch $@

# LeRobot's release excludes the tested torch, so its requirements are listed in full. OPERATORS: see that file.
OPERATORS := docs/learners/torchvision_operators.py
$(VENV)-lerobot/.installed: lerobot.txt $(OPERATORS) $(VENV)/pyvenv.cfg | $(DEV)
	$(call layer,--no-deps)
	@$(@D)/bin/python -c 'import torchvision' 2>/dev/null || { \
		site=$$($(@D)/bin/python -c 'import sysconfig; print(sysconfig.get_path("purelib"))') && cp $(OPERATORS) "$$site" && \
		echo 'import torchvision_operators' >"$$site/torchvision_operators.pth" && $(@D)/bin/python -c 'import torchvision'; }
	@touch $@

# CleanRL's release excludes Python 3.11; the one file used here runs on it.
$(VENV)-cleanrl/.installed: $(VENV)/pyvenv.cfg | $(DEV)
	$(PIP) --no-deps --ignore-requires-python --upgrade --target $(@D) cleanrl==1.2.0
	@touch $@

benchmark: $(DEV) $(PEERS)
	$(PY) -m studies.benchmarks.accuracy
	$(PY) -m studies.benchmarks.versions plain ace0233 --measures steps kernel
	$(PY) -m studies.benchmarks.peers
	$(PY) -m studies.benchmarks.contacts
	$(PY) -m studies.benchmarks.camera
	$(PY) -m studies.benchmarks.training
	$(PY) -m studies.benchmarks.costs
	$(PY) -m studies.benchmarks.steps action-cost hardware-cost contacts-cost shapes-cost

# Takes hours: three seeds of every agent, then their table and the best of each. AGENTS="Align/ideal" trains some of them.
define train
@for agent in $(2); do for seed in $(3); do $(PY) -m agents train $(1) --agent $$agent --seed $$seed || exit; done; done; \
	$(PY) -m agents tabulate $(1) $(patsubst %,--agent %,$(filter-out %/taught %/first %/second %/third %/fourth %/tuned,$(2))) --seeds $(3) \
	--output results --ship vibgym/policies/trained/shipped --page docs/agents.md
endef
train: $(LEARN)
	$(call train,$(CONFIG),$(AGENTS),$(SEEDS))
	$(if $(OPEN),$(call train,configs/agents/open.yaml,$(OPEN),$(OPEN_SEEDS)))
	$(if $(OPEN),$(call train,configs/agents/generalist.yaml,AlignShapes/generalist,$(SEEDS)))
	$(if $(OPEN),$(call train,configs/agents/generalist.yaml,SortShapes/taught SortShapes/generalist PackShapes/taught PackShapes/generalist,0))

compare: $(REPORT)
	$(PY) -m agents compare configs/comparisons/agents.yaml

NOTEBOOKS ?=
notebooks: $(DEV)
	$(PY) -m studies.notebooks $(NOTEBOOKS)

# Tested files are in dist/. ARGS="--extras play,learn" also trains there; the workflow passes ARGS="--tag v0.2.0".
release: $(DEV)
	$(PY) -m studies.release $(ARGS)

format: $(DEV)
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

clean:
	rm -rf .venv .venv-* build dist .hypothesis .import_linter_cache .pytest_cache .ruff_cache
	find vibgym gym_vibgym agents studies tests -name __pycache__ -type d -prune -exec rm -rf {} + 2>/dev/null || true
