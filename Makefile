# `make paper` sets everything up and runs the main job; `make test` sets everything up and passes the tests.
PYTHON ?= python3
BIN := .venv/bin

.PHONY: paper test lock clean

paper: .venv/ready
	$(BIN)/python experiments/paper.py

test: .venv/ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/basedpyright
	$(BIN)/pytest

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
