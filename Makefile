# Every target sets itself up: .venv, pinned packages; for the tests also the system libraries of OpenGL. Paths are relative, so that a checkout in a
# folder with spaces works. `make PYTHON=... <target>` picks the Python that .venv is made with.
.DEFAULT_GOAL := help
.PHONY: help setup demo test test-slow lint types clean package dev system
export PYTHON
.NOTPARALLEL: # package and dev write the same .venv

# Starts with a wrong guess in another room, so that one sees the belief collapse.
SEED ?= 0
STEPS ?= 60
PLAN ?= apartment

help: ## list the targets
	@echo "make <target>, with"
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  \1|\2/p' Makefile | awk -F '|' '{printf "%-12s %s\n", $$1, $$2}'

setup: dev system ## everything needed to run and test galoc, in .venv

demo: package ## walk a home and localize; pictures in runs/demo (PLAN=apartment SEED=0 STEPS=60)
	@.venv/bin/galoc-env demo --plan "$(PLAN)" --steps "$(STEPS)" --seed "$(SEED)" --out runs/demo

test: dev system ## the tests, without those that take minutes
	@.venv/bin/python -m pytest -q -n 2 -m "not slow"

test-slow: dev system ## the tests that take minutes
	@.venv/bin/python -m pytest -q -m slow

lint: dev ## style: ruff check and ruff format --check
	@.venv/bin/python -m ruff check .
	@.venv/bin/python -m ruff format --check .

types: dev ## static types: mypy
	@.venv/bin/python -m mypy

clean: ## remove .venv, caches and built packages; runs/ stays
	@rm -rf .venv build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

package:
	@sh scripts/setup.sh package

dev:
	@sh scripts/setup.sh dev

system: package
	@.venv/bin/python scripts/system_check.py
