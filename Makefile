# `make demo` and `make test` do all their own set-up.

BIN := .venv/bin
DEMO_OUT := demo_out
SURVEYS := build/surveys

AUDIT := build/audit
SLOW := -m 'not slow'

# Where it is set, hundreds of processes would each compile what they import.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: help install demo test test-all tests kernels axe lint settings picture bench performance accuracy \
	faults soak fuzz lock sbom audit clean

help:
	@echo 'make install   make .venv with plc_inspect in it'
	@echo 'make demo      fly the demo flight live: node and player over DDS, then a report'
	@echo 'make test      linter, types and all tests but the slow ones'
	@echo 'make test-all  the same with the slow ones: flights, killed processes, browsers'
	@echo 'make settings  write config/plc_inspect.yaml, docs/settings.md, docs/constants.md from the code'
	@echo 'make picture   draw the picture of README.md from the demo flight'
	@echo 'make bench     print the table of the paper beside that of plc_inspect'
	@echo 'make performance  run all benches of the pipeline, write docs/performance.md'
	@echo 'make accuracy  run all scenes and real clouds, write docs/accuracy.md (half an hour)'
	@echo 'make faults    do all faults to the node, write docs/faults.md (half an hour)'
	@echo 'make soak      fly for an hour with faults at random, figures against limits; MINUTES=12'
	@echo 'make fuzz      damage what the readers read, a minute each (atheris)'
	@echo 'make lock      write requirements.lock anew, with hashes'
	@echo 'make sbom      write build/sbom.json, what .venv holds, as CycloneDX'
	@echo 'make audit     bandit over the package, known vulnerabilities of the lock'
	@echo 'make clean     remove what was made'

install:
	@tools/install

demo: install
	@$(BIN)/python -m plc_inspect.ros.demo bags/demo $(DEMO_OUT)

lint: install
	$(BIN)/ruff check .
	$(BIN)/mypy

# The tests of the monitor's page for accessibility; without npm they are skipped, and say so.
axe:
	@command -v npm >/dev/null || echo 'axe: no npm here: the page is not tested for accessibility'
	@! command -v npm >/dev/null || [ -d test/npm/node_modules/axe-core ] \
		|| npm ci --prefix test/npm --no-audit --no-fund --loglevel error \
		|| echo 'axe: npm cannot get axe-core: the page is not tested for accessibility'

# Once, before the workers of the tests: each would compile for itself what all need.
kernels: install
	@$(BIN)/python tools/compile_kernels.py

# One worker more than cores: some tests wait for real time to pass.
tests: install axe kernels
	$(BIN)/pytest -n 3 --dist loadfile $(SLOW)

# Beside each other: mypy and the kernels keep a core each, npm waits for the network.
test: install
	@$(MAKE) --no-print-directory --jobs 3 lint tests

test-all:
	@$(MAKE) --no-print-directory test SLOW=

settings: install
	$(BIN)/python -m plc_inspect.offline.readers.parameter_file
	$(BIN)/python tools/make_constants.py

picture: demo
	$(BIN)/python tools/make_picture.py $(DEMO_OUT) docs/images/demo.png

bench: install
	$(BIN)/python bench/table2.py --cache $(SURVEYS)

performance: install
	$(BIN)/python bench/table2.py --cache $(SURVEYS) --write
	$(BIN)/python bench/scaling.py --cache $(SURVEYS) --write
	$(BIN)/python bench/survey_io.py --cache $(SURVEYS) --write
	$(BIN)/python bench/startup.py --write

accuracy: install
	$(BIN)/python bench/accuracy.py --cache $(SURVEYS)

faults: install
	$(BIN)/python bench/faults.py --write

soak: install
	$(BIN)/python bench/soak.py $(if $(MINUTES),--minutes $(MINUTES))

fuzz: install
	$(BIN)/python -c 'import atheris' 2>/dev/null || $(BIN)/pip install --quiet 'atheris>=3.0,<4'
	$(BIN)/python tools/fuzz.py --seconds 60

$(AUDIT)/bin/uv:
	python3 -m venv $(AUDIT)
	$(AUDIT)/bin/pip install --quiet uv bandit pip-audit cyclonedx-bom

lock: $(AUDIT)/bin/uv
	$(AUDIT)/bin/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
		--extra dev --custom-compile-command 'make lock' requirements.in setup.py -o requirements.lock

sbom: install $(AUDIT)/bin/uv
	$(AUDIT)/bin/cyclonedx-py environment $(BIN)/python --output-format JSON -o build/sbom.json

# OSV=all.zip reads a dump of OSV in place of asking the package index.
audit: $(AUDIT)/bin/uv
	$(AUDIT)/bin/bandit --quiet -c pyproject.toml -r plc_inspect
	$(AUDIT)/bin/python tools/audit.py requirements.lock $(if $(OSV),--osv $(OSV))

clean:
	rm -rf .venv $(DEMO_OUT) build install log *.egg-info .pytest_cache .mypy_cache .ruff_cache
