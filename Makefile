# `make paper` sets everything up and runs the main job; `make test` sets everything up and passes the
# tests; `make test-all` runs the long tests too and checks the shapes of arrays in all of them;
# `make docs` sets everything up and builds the site of the pages; `make release` makes what a release
# consists of, in dist/.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: paper check test test-all docs release lock clean

paper: .venv/ready
	$(BIN)/python experiments/paper.py

check: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright

test: check
	$(BIN)/pytest -m "not long"

test-all: check
	JAXNET_CHECK_SHAPES=1 $(BIN)/pytest

# The site, in site/; first the lists of docs/keys.md, which are made from the code.
docs: .venv/ready
	$(BIN)/python docs/site/keys.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

# Wheel, sdist, site and checksums in dist/, if versions and dates agree and all tests pass. No upload.
release: .venv/ready
	$(BIN)/python packaging/release.py --check
	$(MAKE) test docs
	$(BIN)/python packaging/release.py

.venv/ready: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	$(BIN)/pip install --quiet --constraint constraints.txt --editable ".[test]"
	touch $@

# Resolve the locked versions anew, for every supported Python at once.
lock: .venv/ready
	$(BIN)/pip install --quiet uv
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --all-extras --upgrade \
	  --no-emit-find-links --no-emit-index-url --no-annotate --no-header pyproject.toml --output-file constraints.txt

clean:
	rm -rf .venv
