# `make demo` and `make test` work on a fresh Debian or Ubuntu with Python 3.11 or later: each first installs what it
# needs, and no more, into .venv, at the versions of constraints.txt.

VENV := .venv
BIN := $(VENV)/bin
# Python writes the bytecode of what it imports; pip would of everything.
INSTALL := $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -c constraints.txt

# Stamps: what the package itself needs is there; so is the viewer; so is what the tests and the linters need, and the
# documentation.
CORE := $(VENV)/core
VIEW := $(VENV)/viewer
STAMP := $(VENV)/installed
DOCS := $(VENV)/docs

# The tests start many Python processes; without bytecode, each would compile all modules that it imports.
unexport PYTHONDONTWRITEBYTECODE
export PYTHONPYCACHEPREFIX := $(CURDIR)/$(VENV)/pycache

.DELETE_ON_ERROR:
.PHONY: demo docs test test-slow test-browser test-lanes test-lowest mutate fuzz fuzz-files lint bench format clean

demo: $(VIEW)
	$(BIN)/warpvis demo --out demo

test: $(STAMP)
	-@./scripts/ensure_egl.sh
	-@./scripts/ensure_clang.sh $(BIN)/python
	$(BIN)/python -m pytest -n 2 --dist loadfile

DOCS_TESTS := $(addprefix tests/test_,$(addsuffix .py,site docs docs_tutorials))

# The documentation's site, in docs/_build/html: every warning is an error. Notebooks run, and nothing is read from a network.
docs: $(DOCS)
	-@./scripts/ensure_chromium.sh
	$(BIN)/python -m sphinx -W --keep-going -q docs docs/_build/html
	$(BIN)/python -m pytest -q -n 2 --dist loadfile -m "(docs or site) and not slow" $(DOCS_TESTS)

# What takes long: most parameters of the slowest tests, the native code under sanitizers over random scenes, Ray. Tests
# of the CUDA code on a CPU (cxx) all run, because together they must run every line.
test-slow: $(STAMP)
	-@./scripts/ensure_clang.sh $(BIN)/python
	$(BIN)/python -m pytest -n 2 --dist loadfile -m "slow or cxx"

# The live viewer in a real browser. Screenshots are in .pytest_cache/screenshots, or where WARPVIS_SCREENSHOTS says.
test-browser: $(STAMP)
	-@./scripts/ensure_chromium.sh
	$(BIN)/python -m pytest -m browser tests/test_viewer_browser.py tests/test_watch_browser.py

# The casters' tests again, compiled for AVX2 alone and for Warp's generic x86-64, which has AVX.
LANE_TESTS := $(addprefix tests/test_,$(addsuffix .py,casters packets worlds points point_packets table_packets object_visibility register))

test-lanes: $(STAMP)
	WARPVIS_CPU_FLAGS="-target-cpu haswell" $(BIN)/python -m pytest -q $(LANE_TESTS)
	WARPVIS_CPU_FLAGS="" $(BIN)/python -m pytest -q $(LANE_TESTS)

# The lowest versions that pyproject.toml names of every dependency, in a virtual environment of their own: of all first,
# then of the package's own once more, since those of the tests want newer ones.
LOWEST := .venv-lowest
LOWEST_INSTALL = $(LOWEST)/bin/uv pip install --quiet --python $(LOWEST)/bin/python --resolution lowest-direct
LOWEST_TESTS := $(addprefix tests/test_,$(addsuffix .py,camera pose scene scene_files casters worlds interop ros_bags \
	point_files pose_files batch_layouts mujoco_scene webots_worlds perspective_pictures cli))

test-lowest:
	./scripts/make_venv.sh $(LOWEST)
	$(LOWEST)/bin/python -m pip install --quiet --disable-pip-version-check uv
	$(LOWEST_INSTALL) -e . --group test
	$(LOWEST_INSTALL) --upgrade -e .
	$(LOWEST)/bin/python -m pytest -q -m "not gl" $(LOWEST_TESTS)

# Small mistakes in the casters' code, each of which a test has to notice. `make mutate MUTANTS="--count 60 --seed 3"`
mutate: $(STAMP)
	-@./scripts/ensure_clang.sh $(BIN)/python
	$(BIN)/python scripts/mutate.py $(MUTANTS)

# Random arguments for all that is public: each call is taken, or refused in a sentence. `make fuzz FUZZ="--count 5000"`
fuzz: $(STAMP)
	$(BIN)/python tests/fuzz_calls.py $(FUZZ)

# Changed files of all formats that are read, likewise. `make fuzz-files FUZZ="--seed 40000 --count 5000"`
fuzz-files: $(STAMP)
	$(BIN)/python tests/fuzz_files.py $(FUZZ)

NATIVE := $(wildcard kernels/native/*/*.h tests/native/*.h tests/native/*.cpp)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/clang-format --dry-run -Werror $(NATIVE)
	$(BIN)/python scripts/check_kernels.py
	$(BIN)/python scripts/check_prose.py
	$(BIN)/codespell
	$(BIN)/python scripts/typecheck.py
	$(BIN)/lint-imports

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	$(BIN)/clang-format -i $(NATIVE)

bench: $(STAMP)
	-@./scripts/ensure_egl.sh
	-@./scripts/ensure_peers.sh $(BIN)/python
	$(BIN)/python bench/run.py --figures

$(VENV)/pyvenv.cfg: scripts/make_venv.sh
	./scripts/make_venv.sh $(VENV)
	touch $@

$(CORE): $(VENV)/pyvenv.cfg pyproject.toml constraints.txt
	$(INSTALL) -e .
	touch $@

$(VIEW): $(CORE)
	$(INSTALL) -e '.[cli,view]'
	touch $@

$(STAMP): $(CORE)
	$(INSTALL) 'pip>=25.1'  # for dependency groups
	$(INSTALL) -e . --group test --group lint
	touch $@

$(DOCS): $(STAMP)
	$(INSTALL) -e . --group docs
	touch $@

clean:
	rm -rf $(VENV) build dist demo docs/_build docs/api docs/_site/static/live *.egg-info
