# Two commands matter: `make book` and `make test`. Everything else is for contributors.
#
#   PYTHON=python3.12   the Python that makes the environment (3.11 or newer)
#   VENV=DIR            the environment's folder (default: .venv)
#   BUILD=DIR           where the executed notebooks and the book go (default: build); a folder of
#                       its own, which `make clean` removes whole
#   OLDEST=DIR          the environment of `make test-oldest` (default: .venv-oldest)
#   WORKERS=2           processes that run tests at the same time
#   JOBS=1              trainings, attempts or chapters of `make reproduce` at the same time
#   PRESET=tiny         size of networks and data, of book, tables and reproduce
#   SEED=0              the seed of chapters and attempts, of book and reproduce
#   DATA=DIR            frames from `hadr generate`, of tables and reproduce at another preset than tiny
#   OUT=DIR             where tables and reproduce write (default: the build folder)
#   PIP_FLAGS=...       more options for pip, such as another index for PyTorch's wheels

PYTHON    ?= python3
VENV      ?= .venv
OLDEST    ?= $(VENV)-oldest
BUILD     ?= build
PIP_FLAGS ?=
PRESET    ?= tiny
SEED      ?= 0
WORKERS   ?= 2
JOBS      ?= 1
# At preset tiny beside the book, whose chapters are then not executed a second time.
OUT       ?= $(BUILD)$(if $(filter tiny,$(PRESET)),,/$(PRESET))

BIN   := $(VENV)/bin
PY    := $(BIN)/python
READY := $(VENV)/.hadr-ready
ANY_PYTHON = $(if $(wildcard $(PY)),$(PY),$(PYTHON))
PYTEST = HADR_BOOK_HTML="$(BUILD_PATH)/html/_build/html" \
    $(PY) -m pytest -n $(WORKERS) --dist loadfile --durations=10

ifeq ($(strip $(BUILD)),)
$(error BUILD is empty: name a folder, such as BUILD=build)
endif
# The build folder's absolute path (abspath would cut it at a blank). Caches go there: the commands
# need no writable HOME.
BUILD_PATH := $(if $(filter /%,$(firstword $(BUILD))),,$(CURDIR)/)$(BUILD)
export MPLCONFIGDIR := $(BUILD_PATH)/hadr-cache/matplotlib
export XDG_CACHE_HOME := $(BUILD_PATH)/hadr-cache
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help book tables reproduce test test-long test-all test-oldest break lint env notebooks texts check-notebooks html readme-times readme-figure clean build-folder

help: ## what can be made
	@echo "usage: make TARGET [PYTHON=python3] [VENV=.venv] [BUILD=build]"
	@grep -E '^[a-z-]+:.*## ' $(firstword $(MAKEFILE_LIST)) | sed 's/:.*## /\t/' | \
	    awk -F'\t' '{ printf "  %-16s %s\n", $$1, $$2 }'

book: $(READY) ## execute all notebooks and build the HTML book
	@$(PY) -m hadr.cli book --build "$(BUILD)" --preset $(PRESET) --seed $(SEED)

tables: $(READY) ## train and compare all systems at PRESET (all but tiny: DATA=DIR)
	@$(BIN)/hadr reproduce --preset $(PRESET) --only tables --out "$(OUT)" \
	    $(if $(DATA),--data $(DATA))

reproduce: $(READY) ## tables, handover and chapters at PRESET; prints the plan first and goes on where it was stopped
	@$(BIN)/hadr reproduce --preset $(PRESET) --seed $(SEED) --out "$(OUT)" \
	    --jobs $(JOBS) $(if $(DATA),--data $(DATA))

html: $(READY) ## rebuild the HTML book from the notebooks executed last time
	@$(PY) -m hadr.cli book --build "$(BUILD)" --html-only

test: $(READY) ## run the tests, without those that take minutes; prints the ten slowest
	@$(PYTEST) $(PYTEST_FLAGS)

test-long: $(READY) ## run the tests that take minutes: every page at every width and theme, three chapters from the wheel
	@$(PYTEST) -m long $(PYTEST_FLAGS)

test-all: test test-long break ## run every test, and try to break all commands

# The lowest versions have wheels for Python 3.11. PyTorch is the pinned one, of which pip takes the
# build for CPUs; uv only says which versions these are. Attempts need the extra "handover".
test-oldest: ## run the tests of what users call with the oldest versions that pyproject.toml allows (PYTHON=python3.11)
	@$(PYTHON) -m venv "$(OLDEST)"
	@"$(OLDEST)/bin/python" -m pip install --quiet $(PIP_FLAGS) uv
	@grep '^torch==' constraints.txt >"$(OLDEST)/torch.txt"
	@"$(OLDEST)/bin/uv" pip compile --quiet --resolution lowest-direct --annotation-style line \
	    --python "$(OLDEST)/bin/python" -c "$(OLDEST)/torch.txt" pyproject.toml -o "$(OLDEST)/all.txt"
	@grep -F 'hadr (pyproject.toml)' "$(OLDEST)/all.txt" >"$(OLDEST)/direct.txt"
	@"$(OLDEST)/bin/python" -m pip install --quiet $(PIP_FLAGS) -c "$(OLDEST)/direct.txt" -e . pytest hypothesis
	@"$(OLDEST)/bin/python" -m pytest -q tests/test_cli.py tests/test_frame_io.py tests/test_restoration.py \
	    -k "not (another_run_has and handover)"

break: $(READY) ## bad inputs, kills, full disks, two at once: nothing lost, nothing false, each refused in a sentence
	@$(PY) benchmarks/break_it.py --workers $(WORKERS) --out "$(BUILD)/break_it.json"

lint: $(READY) ## ruff and mypy
	@$(BIN)/ruff check .
	@$(BIN)/ruff format --check .
	@$(BIN)/mypy
	@$(BIN)/mypy --config-file benchmarks/mypy.ini benchmarks

env: $(READY) ## make the environment only

notebooks: $(READY) ## write notebooks/*.ipynb from their text twins, and check the way back
	@$(PY) -m hadr.press.notebook_twins

texts: $(READY) ## write the text twins from notebooks that were edited in Jupyter
	@$(PY) -m hadr.press.notebook_twins --from-notebooks

check-notebooks: $(READY) ## compare notebooks and text twins, write nothing
	@$(PY) -m hadr.press.notebook_twins --check

readme-times: $(READY) ## write the run times that the last `make book` measured into README.md
	@$(PY) -m hadr.cli book --build "$(BUILD)" --readme-times

readme-figure: $(READY) ## draw the README's pictures
	@$(PY) book/restored_frame.py
	@$(PY) book/sample_sheet.py

clean: ## remove what was built (the environment stays)
	@$(ANY_PYTHON) -m hadr.records.output_folder "$(BUILD)"
	rm -rf .pytest_cache .mypy_cache .ruff_cache .hypothesis

build-folder:
	@$(ANY_PYTHON) -m hadr.records.output_folder --check "$(BUILD)"

$(READY): pyproject.toml constraints.txt | build-folder
	@$(PYTHON) -c 'import sys; v = sys.version_info; sys.exit(0 if v[:2] >= (3, 11) else \
	    "hadr needs Python 3.11 or newer, but $(PYTHON) is %d.%d; name another one: make PYTHON=python3.11 ..." % v[:2])'
	@$(PYTHON) -c 'import ensurepip' 2>/dev/null || { \
	    echo "$(PYTHON) cannot make environments: its module ensurepip is missing (on Debian and Ubuntu: install python3-venv)"; exit 1; }
	@test -x "$(PY)" || $(PYTHON) -m venv "$(VENV)"
	@echo "installing into $(VENV): a few minutes the first time"
	@$(PY) -m pip install --quiet $(PIP_FLAGS) -c constraints.txt -e '.[book,generate,handover,test]'
	@touch "$(READY)"
