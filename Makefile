# Task runner. `make` alone lists the tasks; CMakePresets.json holds the settings.
PRESET ?= dev
JOBS ?= $(shell nproc 2>/dev/null || echo 2)
TEST_JOBS ?= 2

GPU_BUNDLE_TARGETS := cuda_parity cuda_bench cuda_devices device_parity plan_bounds voxelpipe voxelpiped mesh_fuzz \
  parser_fuzz whole_calls whole_calls_bench

# Of make fuzz: by the names of tests/fuzz/parsers/parsers.cpp.
FUZZERS ?= gltf glb draco stl ply off obj threemf image meshopt data_uri manifest options web
FUZZ_SECONDS ?= 7200

# By label, which is the name of the test's program.
SERVICE_TESTS := ^(library_order|server|service_.*)_test$$

# Where the preset builds: `dev` in build/, any other in build-<preset>/.
BUILD_DIR := $(if $(filter dev,$(PRESET)),build,build-$(PRESET))

# VOXELPIPE_WERROR=1 in the environment makes warnings errors, as CI does; they never stop a user's build.
CONFIGURE := cmake --preset $(PRESET) -DVOXELPIPE_WERROR=$(if $(filter 1 ON,$(VOXELPIPE_WERROR)),ON,OFF)

# Packages of npm come from its cache if they are there: its registry does not always answer.
export npm_config_prefer_offline := true

.DEFAULT_GOAL := help
.NOTPARALLEL:
.PHONY: help setup setup-programs configure build test test-further test-thorough test-asan test-tsan demo bench fuzz results option-tables format lint docker-test gpu-bundle clean

help: ## List the tasks
	@echo "usage: make TASK [PRESET=dev|release|cpu-only|asan|tsan] [JOBS=N]"
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  \1|\2/p' $(firstword $(MAKEFILE_LIST)) | awk -F'|' '{printf "%-14s%s\n", $$1, $$2}'

# What the programs take: all that `make demo` installs.
setup-programs:
	@bash tests/support/apt_install.sh docker/packages-build.txt
	@command -v npm >/dev/null || bash tests/support/apt_install.sh docker/packages-viewer.txt \
	  || echo "setup: going on without .html results"

setup: setup-programs ## Install the missing Debian packages (docker/packages-*.txt: build, viewer, python, browser, ...)
	@bash tests/support/apt_install.sh docker/packages-python.txt || echo "setup: going on without Python"
	@bash tests/support/apt_install.sh docker/packages-browser.txt docker/packages-formats.txt \
	  || echo "setup: going on without the tests of browsers and formats"
	@bash tests/support/apt_install.sh docker/packages-operations.txt || echo "setup: going on without those of operations"
	@bash tests/support/apt_install.sh docker/packages-valgrind.txt || echo "setup: going on without counted instructions"

configure: setup-programs
	@mkdir -p $(BUILD_DIR)
	@$(CONFIGURE) >$(BUILD_DIR)/configure.log 2>&1 || { cat $(BUILD_DIR)/configure.log; exit 1; }

build: setup configure ## Build everything; binaries land in build/bin
	cmake --build --preset $(PRESET) -j $(JOBS)

test: build ## Set up, build and run every test
	@bash tests/ci/commit_line.sh "make test" ctest --preset $(PRESET) --output-on-failure -j $(TEST_JOBS) \
	  --output-junit $(CURDIR)/$(BUILD_DIR)/tests.xml

test-further: build ## Tests for developers and CI: CUDA emulated, other architectures, missing includes
	cmake --build --preset $(PRESET) -j $(JOBS) --target further_tests
	@bash tests/ci/commit_line.sh "make test-further" ctest --preset $(PRESET) --output-on-failure -j $(TEST_JOBS) \
	  -C further -L '^further$$' --output-junit $(CURDIR)/$(BUILD_DIR)/further-tests.xml

test-thorough: build ## All cases of the emulated CUDA backend, and its search for races (hours)
	cmake --build --preset $(PRESET) -j $(JOBS) --target further_tests thorough_tests
	ctest --preset $(PRESET) --output-on-failure -j $(TEST_JOBS) -C thorough -L '^thorough$$'

test-asan: ## Run the service's tests with AddressSanitizer and UndefinedBehaviorSanitizer in server, clients and tests
	@$(MAKE) --no-print-directory PRESET=asan service-tests

test-tsan: ## Run the service's tests with ThreadSanitizer in server, clients and tests
	@$(MAKE) --no-print-directory PRESET=tsan service-tests

.PHONY: service-tests
service-tests: configure
	cmake --build --preset $(PRESET) -j $(JOBS) --target service_tests
	ctest --preset $(PRESET) -j $(TEST_JOBS) -L '$(SERVICE_TESTS)'

demo: configure ## Send a real mesh to a server, get voxels and a picture back (build/demo)
	cmake --build --preset $(PRESET) -j $(JOBS) --target voxelpipe voxelpiped
	@bash tests/ci/commit_line.sh "make demo" bash tests/support/demo.sh $(BUILD_DIR)

.PHONY: wheels
wheels: setup configure ## Make the Python wheels, for every Linux with a glibc at least as new, in build/wheels
	cmake --build --preset $(PRESET) -j $(JOBS) --target voxelpipe voxelpiped voxelpipe_core_module
	@bash client/python/make_wheels.sh $(BUILD_DIR)/wheels $(BUILD_DIR)/client/python/core/package \
	  $(BUILD_DIR)/bin/voxelpiped $(BUILD_DIR)/bin/voxelpipe
	@ls -sh $(BUILD_DIR)/wheels

bench: configure ## Measure the pipeline; BENCH_ARGS="--mesh=NAME=FILE --threads=N --benchmark_filter=REGEX"
	@bash tests/support/apt_install.sh docker/packages-bench.txt || echo "bench: going on without peers to compare with"
	@$(CONFIGURE) -DVOXELPIPE_BENCH=ON >$(BUILD_DIR)/configure.log
	cmake --build --preset $(PRESET) -j $(JOBS) --target voxelize_bench
	@bash tests/bench/bench.sh $(BUILD_DIR) $(BENCH_ARGS)

.PHONY: instruction-counts
instruction-counts: configure ## Count the instructions of small cases anew (tests/bench/instructions/instruction_counts.json)
	@bash tests/support/apt_install.sh docker/packages-valgrind.txt
	cmake --build --preset $(PRESET) -j $(JOBS) --target instruction_counts

results: ## Make tests/bench/RESULTS.md and its plot of tests/bench/results/*.json
	@bash tests/support/python.sh tests/bench/make_results.py

option-tables: configure ## Put the option tables of voxelpiped into server/OPERATIONS.md
	cmake --build --preset $(PRESET) -j $(JOBS) --target voxelpiped
	@bash tests/support/python.sh tests/support/option_tables.py $(BUILD_DIR)/bin/voxelpiped server/OPERATIONS.md

format: ## Format all sources in place (clang-format 14)
	@bash tests/support/lint.sh format $(BUILD_DIR)

lint: ## Check the format, clang-tidy on .cpp, buf lint on the protos where buf is installed
	@bash tests/support/lint.sh lint $(BUILD_DIR)

docker-test: configure ## Build the image with a local engine, run it, call it from the host (root; slow)
	cmake --build --preset $(PRESET) -j $(JOBS) --target voxelpipe
	VOXELPIPE_DOCKER_TEST=1 bash tests/docker/docker_test.sh $(BUILD_DIR)/bin/voxelpipe

.PHONY: fresh-test
fresh-test: ## Run make demo and make test each in a bare Debian 12 (root; slow); FRESH_ARGS="--only demo": one
	@bash tests/fresh/fresh_test.sh $(FRESH_ARGS)

fuzz: ## Fuzz the parsers under sanitizers, FUZZ_SECONDS long each; FUZZERS="stl ply": these (docker/packages-fuzz.txt)
	@bash tests/support/apt_install.sh docker/packages-fuzz.txt
	@$(MAKE) --no-print-directory PRESET=fuzz configure
	cmake --build --preset fuzz -j $(JOBS) --target $(FUZZERS:%=%_fuzz)
	@bash tests/fuzz/run.sh build-fuzz $(FUZZ_SECONDS) $(FUZZERS)

gpu-bundle: setup ## Put what a GPU machine needs to prove and measure CUDA into gpu-bundle/ (run.sh there); GPU_MODELS="FILE..."
	@mkdir -p build-gpu-bundle
	@cmake --preset gpu-bundle >build-gpu-bundle/configure.log 2>&1 || { cat build-gpu-bundle/configure.log; exit 1; }
	cmake --build --preset gpu-bundle -j $(JOBS) --target $(GPU_BUNDLE_TARGETS)
	@bash tests/gpu/bundle.sh build-gpu-bundle gpu-bundle $(GPU_MODELS)

clean: ## Remove what the preset built
	rm -rf $(BUILD_DIR)
