# make demo   install missing packages, build the commands of one run, indent a phantom, print the force and the result files
# make test   install missing packages, build, run all tests
# make build  only build, all commands
# make check  the tests under address and undefined-behaviour sanitizers
# make check-quick   those of the solver only, without marches that take minutes under sanitizers
# make check-threads   the tests under the thread sanitizer
# make fuzz   a million damaged files for each reader, under sanitizers (clang); 5000 valid ones compared with other libraries
# make bench  time of each stage and limits of this processor; results in tests/bench/results
# make converge, make atlas, make chart   the studies of tests/studies: IMAGE=FILE for your own, STUDY="--options of the study"
# make wheel  the Python module as a wheel, for this system: build/wheel
# make deb    packages for Debian 12: build/package/dimple_*.deb, libdimple-dev_*.deb
# make docs   the user's guide as a site with search: build/docs/index.html
# make clean  remove everything that was built

BUILD := build/release
DIMPLE := $(BUILD)/dimple
DEMO := out/demo
FUZZ_RUNS := 1000000

.PHONY: demo test build check check-quick check-threads fuzz bench converge atlas chart studies wheel deb docs clean bootstrap

demo: bootstrap
	cmake --preset release -DDIMPLE_TESTS=OFF
	cmake --build $(BUILD) --target dimple
	@mkdir -p $(DEMO)
	$(DIMPLE) phantom $(DEMO)/brain.nrrd
	$(DIMPLE) run $(DEMO)/brain.nrrd -o $(DEMO)/results --force

test: bootstrap
	cmake --preset release -DDIMPLE_TESTS=ON
	cmake --build $(BUILD)
	ctest --test-dir $(BUILD) --output-on-failure -j 3

build: bootstrap
	cmake --preset release -DDIMPLE_TESTS=OFF
	cmake --build $(BUILD) --target dimple dimple_all

check: bootstrap
	cmake --preset asan
	cmake --build build/asan
	LSAN_OPTIONS=suppressions=$(CURDIR)/tests/leaks.supp ctest --test-dir build/asan --output-on-failure -j 2

check-quick: bootstrap
	cmake --preset asan -B build/asan-solver -DDIMPLE_SOLVER_ONLY=ON
	cmake --build build/asan-solver --target solver_test discretise_test
	LSAN_OPTIONS=suppressions=$(CURDIR)/tests/leaks.supp ctest --test-dir build/asan-solver --output-on-failure -j 2 -L unit \
	  -E '^(BetweenFrames|Frames|Live|LoadSlowly|Recovery|Restart|Steps)\.|OtherCaches|HoweverManyRows'

# The sanitizer does not see work passed between threads of ITK or VTK. It sees ITK's plain threads; VTK gets one.
check-threads: bootstrap
	cmake --preset tsan
	cmake --build build/tsan
	TSAN_OPTIONS=halt_on_error=1 ITK_GLOBAL_DEFAULT_THREADER=platform VTK_SMP_BACKEND_IN_USE=Sequential \
	  ctest --test-dir build/tsan --output-on-failure

fuzz:
	@./bootstrap clang libclang-rt-14-dev
	cmake --preset fuzz
	cmake --build --preset fuzz
	tests/fuzz/run build/fuzz/dimple_fuzz $(FUZZ_RUNS)
	cmake --preset release -DDIMPLE_TESTS=ON
	cmake --build $(BUILD) --target differential_test
	DIMPLE_SEED=$${DIMPLE_SEED:-$$(date +%s)} DIMPLE_FILES=5000 $(BUILD)/tests/end_to_end/differential_test

bench:
	@./bootstrap libbenchmark-dev
	cmake --preset release -DDIMPLE_BENCH=ON
	cmake --build $(BUILD) --target dimple_bench
	$(BUILD)/dimple_bench --results=tests/bench/results --version=$$(git describe --always --dirty)

# Debian's Python, whatever the path holds before it.
wheel: bootstrap
	@./bootstrap pybind11-dev python3-dev python3-build python3-setuptools python3-venv python3-numpy python3-wheel
	cmake --preset release -DDIMPLE_PYTHON=ON
	cmake --build $(BUILD) --target dimple_python
	DIMPLE_BUILD=$(BUILD) /usr/bin/python3 -m build --wheel --no-isolation -o build/wheel apps/python

# Studies of accuracy, of usable scenes, and of error against wall time, with the wheel in its own environment.
IMAGE :=
STUDY :=
STUDIES := DIMPLE_PROGRAM=$(DIMPLE) build/studies/bin/python tests/studies

converge: studies
	@mkdir -p out
	@[ -n "$(IMAGE)" ] || $(DIMPLE) phantom out/block.nrrd --shape block --size 60,60,30 --spacing 0.5
	$(STUDIES)/converge.py $(or $(IMAGE),out/block.nrrd) -o out/converge $(STUDY)

atlas: studies
	$(STUDIES)/atlas.py $(IMAGE) -o out/atlas $(STUDY)

chart: studies
	$(STUDIES)/chart.py $(IMAGE) -o out/chart $(STUDY)

studies: wheel
	@./bootstrap python3-matplotlib
	cmake --build $(BUILD) --target dimple dimple_all
	/usr/bin/python3 -m venv --clear --system-site-packages build/studies
	build/studies/bin/python -m pip install --quiet --disable-pip-version-check --no-index build/wheel/pydimple-*.whl

deb:
	@./bootstrap dpkg-dev file
	cmake --preset release -B build/package -DDIMPLE_TESTS=OFF
	cmake --build build/package
	cd build/package && cpack

# The program prints the reference; make docs DIMPLE_PROGRAM=FILE uses an existing build.
DIMPLE_PROGRAM := $(CURDIR)/$(BUILD)/whole/dimple
docs:
	@/usr/bin/python3 -c 'import furo, myst_parser, sphinx' 2>/dev/null || \
	  { echo "make docs needs three Debian packages: apt-get install python3-sphinx python3-myst-parser furo" >&2; exit 1; }
	@[ "$(origin DIMPLE_PROGRAM)" = "command line" ] || $(MAKE) build
	rm -rf build/docs build/docs-source
	@mkdir -p build
	cp -r apps/guide build/docs-source
	DIMPLE_PROGRAM=$(DIMPLE_PROGRAM) /usr/bin/python3 -m sphinx -q -W --keep-going -b html build/docs-source build/docs
	@echo "open     build/docs/index.html in a browser"

clean:
	rm -rf build out

bootstrap:
	@./bootstrap
