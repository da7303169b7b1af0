# Two commands need nothing but git, make and Python 3.11+ (venv):  make run  |  make test
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
TASK ?= press-and-slide
OUT ?= out/$(TASK)

.PHONY: run test lint docs verify audit lock clean
run: $(VENV)/run.stamp
	@rm -rf "$(OUT)"
	$(BIN)/impedance run $(TASK) --out "$(OUT)"

# Whatever runs in real time runs alone, after the rest. 5: PYTEST_ARGS left one of the two nothing to do.
test: $(VENV)/develop.stamp $(VENV)/ros2.stamp
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n 2 -m "not ros and not realtime" $(PYTEST_ARGS) || [ $$? = 5 ]
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -m "ros or realtime" $(PYTEST_ARGS) || [ $$? = 5 ]

lint: $(VENV)/develop.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

# The reference of all modules, from their docstrings; pdoc refuses a module that cannot be imported. Nothing is drawn:
# MuJoCo would look for a window by a program of its own, which pdoc does not let run.
docs: $(VENV)/docs.stamp
	@rm -rf out/docs
	MUJOCO_GL=disable $(BIN)/python -m pdoc --docformat google --no-show-source -o out/docs impedance_modules impedance_experiments
	@echo "wrote out/docs/index.html"

# Everything: all tests, mutants, experiments of the thesis. Stopped, it goes on when it is started again.
verify: $(VENV)/develop.stamp $(VENV)/docs.stamp
	$(BIN)/python -m tests.verify $(VERIFY_ARGS)

# Known vulnerabilities of all locked versions, asked of pypi.org; --strict: what could not be looked up is a failure.
audit: out/audit/stamp
	for file in requirements/*.txt; do \
		echo "$$file" && out/audit/bin/pip-audit --strict --require-hashes --disable-pip -r "$$file" || exit 1; \
	done

out/audit/stamp: requirements/audit.txt
	$(PYTHON) -m venv out/audit
	out/audit/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/audit.txt
	@touch $@

# Versions and hashes come from requirements/*.txt; nothing is resolved on the user's machine.
$(VENV)/run.stamp: requirements/run.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(None if sys.version_info >= (3, 11) else "impedance_modules needs Python 3.11 or newer, this is " + sys.version.split()[0])'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/run.txt
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

$(VENV)/develop.stamp: requirements/develop.txt $(VENV)/run.stamp
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/develop.txt
	@touch $@

# ROS 2's wheels set library paths for every program of their environment, so they have one of their own.
$(VENV)/ros2.stamp: requirements/ros2.txt $(VENV)/run.stamp
	$(PYTHON) -m venv $(VENV)/ros2
	$(VENV)/ros2/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/ros2.txt
	@touch $@

$(VENV)/docs.stamp: requirements/docs.txt $(VENV)/run.stamp
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements/docs.txt
	@touch $@

# Needs uv: writes the locked versions anew.
lock:
	uv pip compile pyproject.toml --extra plots --extra bags --group build --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate -q --upgrade -o requirements/run.txt
	uv pip compile pyproject.toml --extra plots --extra bags --group build --group test --group lint --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate -q --upgrade -o requirements/develop.txt
	uv pip compile pyproject.toml --extra plots --extra bags --group benchmark --constraint requirements/develop.txt --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate -q --upgrade -o requirements/benchmark.txt
	uv pip compile pyproject.toml --extra plots --extra bags --group docs --constraint requirements/develop.txt --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate -q --upgrade -o requirements/docs.txt
	uv pip compile --group ros2 --constraint requirements/develop.txt --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate -q --upgrade -o requirements/ros2.txt
	uv pip compile --group audit --constraint requirements/develop.txt --universal --python-version 3.11 --generate-hashes --no-emit-index-url --no-header --no-annotate -q --upgrade -o requirements/audit.txt

clean:
	rm -rf $(VENV) out build dist
