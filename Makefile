# `make help` lists what there is to make. Everything that is built goes to target/ (or CARGO_TARGET_DIR).

SHELL := /bin/bash
TARGET := $(or $(CARGO_TARGET_DIR),target)
VENV := $(TARGET)/venv
# The page: what the bundle is made of, where it goes, and the feature that puts it into the binary.
WEB := $(wildcard web/src/* web/*.mjs web/*.json)
export PAGE_BUNDLE := $(abspath $(TARGET))/web
FEATURES := --features page,postgres,s3
# What `make run` needs: it keeps jobs and files in a folder.
RUN_FEATURES := --features page
# Real meshes for the tests, where there are any; samples are made and used in any case.
ifneq ($(wildcard ../shared/meshes),)
export TESSERAE_TEST_MESHES ?= $(abspath ../shared/meshes)
endif
# CGAL's remesh, for `make bench-peers`: where headers of CGAL 6.1 or later are found, which no Debian release has yet.
CGAL_INCLUDE ?= /usr/include
ifeq ($(shell awk '/define CGAL_VERSION_NR/ { print ($$3 >= 1060100000) }' $(CGAL_INCLUDE)/CGAL/version.h 2>/dev/null),1)
CGAL_DRIVER := $(TARGET)/bench/cgal_remesh
endif
# Without a desktop, Mesa's device-select layer makes libwayland complain on standard error.
export NODEVICE_SELECT ?= 1
export TESSERAE_LISTEN ?= 127.0.0.1:8080
# Mesa asks Wayland's library for displays, which complains on standard error where this is not set.
export XDG_RUNTIME_DIR ?= /tmp

.PHONY: help
help:  ## list these targets
	@sed -n 's/^\([a-z0-9-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 16

.PHONY: run
run: bundle  ## install what is missing, build, and serve on http://127.0.0.1:8080, with a page there (TESSERAE_* variables are settings)
	cargo build --release --locked $(RUN_FEATURES)
	@echo "open http://$(TESSERAE_LISTEN)/ in a browser; press Ctrl-C to stop"
	@exec $(TARGET)/release/tesserae serve

# What most suites need is built first; then four of them run at a time, since most of them wait for much of their time.
# The longest come first. `unit` takes longest and compiles in the folder that `lint` waits for, so that it goes before
# others (nice, so little that they do not starve beside busy processes) and compiles on all cores (without the flags by
# which make limits cargo). The two that measure processor time run at the end, a core each. A suite that hangs fails
# when its time has passed, with what it printed.
SUITES := unit page farm python end-to-end lint fuzz bucket memory crash outputs gpu-pages deploy
MEASURES := page-times costs
.PHONY: test
test: install-test  ## install what is missing and check everything, on cpu and on a software gpu
	@$(MAKE) --no-print-directory --jobs $$(nproc) debug-binary wheel $(VENV)/ready
	@failed=0; \
		$(MAKE) --no-print-directory --jobs 4 --keep-going --output-sync=target $(SUITES:%=bounded-%) || failed=1; \
		$(MAKE) --no-print-directory --jobs 2 --keep-going --output-sync=target $(MEASURES:%=bounded-%) || failed=1; \
		exit $$failed

bounded-%:
	@TIMEFORMAT="$*: %0R s, of processors %0U s"; \
		time nice -n $(if $(filter unit $(MEASURES),$*),0,4) timeout --foreground --verbose --kill-after 1m 45m \
		$(MAKE) --no-print-directory --old-file debug-binary --old-file wheel $*

.PHONY: lint
lint: install-test bundle  ## formatting, clippy, documentation and choices of cargo features, warnings denied
	cargo fmt --check
	cargo fmt --check --manifest-path python/Cargo.toml
	cargo clippy --locked --all-targets $(FEATURES) -- -D warnings
	cargo clippy --locked --test costs $(FEATURES) -- -D warnings
	cargo clippy --locked --manifest-path python/Cargo.toml --target-dir $(abspath $(TARGET)) -- -D warnings
	tests/scripts/features.sh
	web/node_modules/.bin/prettier --log-level warn --check web/src web/tests web/bundle.mjs
	RUSTDOCFLAGS="-D warnings -A rustdoc::private-intra-doc-links" cargo doc --locked $(FEATURES) --no-deps --document-private-items

.PHONY: unit
unit: install-test bundle  ## the tests of the three crates
	MAKEFLAGS= cargo test --locked $(FEATURES) --no-fail-fast
	MAKEFLAGS= cargo test --locked $(FEATURES) --no-run --test costs

.PHONY: gpu-pages
gpu-pages: install-test bundle  ## buffers beyond the largest binding, on a software gpu that has arrays of bindings
	driver=$$(tests/scripts/newer_mesa.sh $(TARGET)/mesa); if [ "$$driver" ]; then \
		VK_DRIVER_FILES=$$driver MAKEFLAGS= cargo test --locked $(FEATURES) --test gpu pages::; fi

.PHONY: test-long
test-long: debug-binary  ## what `make test` has shorter runs of: choices of features, damaged and real meshes, devices, requests at random, memory, kills of services and farms
	cargo rustc --locked -p tesserae-mesh --lib --profile check -- --cfg fuzzing -D warnings
	cargo rustc --locked -p tesserae-service --lib --profile check -- --cfg fuzzing -D warnings
	TESSERAE_TEST_LONG=1 tests/scripts/features.sh
	TESSERAE_TEST_LONG=1 cargo test --locked $(FEATURES) --no-fail-fast --test clustering --test gpu --test complex
	TESSERAE_TEST_LONG=1 $(MAKE) --no-print-directory --old-file debug-binary end-to-end fuzz
	$(MAKE) --no-print-directory --old-file debug-binary crash KILLS=1000 CRASH_SECONDS=600
	$(MAKE) --no-print-directory --old-file debug-binary farm FARM_JOBS=1000 FARM_KILLS=40 FARM_STOPS=5
	$(MAKE) --no-print-directory --old-file debug-binary memory MEMORY_JOBS=10000

.PHONY: costs
costs: debug-binary  ## processor time of hostile inputs, with the engine optimised as in the debug binary
	cargo test --locked $(FEATURES) --test costs -- --test-threads 1

.PHONY: end-to-end
end-to-end: debug-binary $(VENV)/ready  ## service and command line from outside, results scored independently
	$(VENV)/bin/python tests/scripts/end_to_end.py $(TARGET)/debug/tesserae $(TESSERAE_TEST_MESHES)
	$(VENV)/bin/python tests/scripts/pages.py $(TARGET)/debug/tesserae

.PHONY: bucket
bucket: debug-binary $(VENV)/ready  ## files of jobs in a bucket of S3, of a server that runs meanwhile (moto)
	$(VENV)/bin/python tests/scripts/s3.py cargo test --locked $(FEATURES) --lib blobs::
	$(VENV)/bin/python tests/scripts/bucket.py $(TARGET)/debug/tesserae

.PHONY: outputs
outputs: debug-binary $(VENV)/ready $(TARGET)/node/ready  ## outputs as the programs read them that people use
	$(VENV)/bin/python tests/scripts/outputs.py $(TARGET)/debug/tesserae --node $(TARGET)/node $(TESSERAE_TEST_MESHES)

BLENDER_VENV := $(TARGET)/blender-venv

.PHONY: blender
blender: debug-binary $(BLENDER_VENV)/ready  ## outputs as Blender opens them (a download of 500 MB, Python 3.11 only)
	$(BLENDER_VENV)/bin/python tests/scripts/blender.py $(TARGET)/debug/tesserae $(TESSERAE_TEST_MESHES)

$(BLENDER_VENV)/ready: | install-test
	@echo "installing into $(BLENDER_VENV): bpy"
	python3 -m venv $(BLENDER_VENV)
	$(BLENDER_VENV)/bin/pip install --quiet --disable-pip-version-check bpy==4.2.0
	touch $@

# Labels are integers on every processor: the table of labels, by a binary for another one, emulated.
AARCH64 := aarch64-unknown-linux-gnu
AARCH64_COMMAND = qemu-aarch64 -L /usr/aarch64-linux-gnu $(abspath $(TARGET))/$(AARCH64)/debug/tesserae

.PHONY: aarch64
aarch64: install-test bundle  ## the labels of samples and real meshes on a 64-bit ARM processor, emulated, beside the table
	deploy/install-missing.sh aarch64
	CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER=aarch64-linux-gnu-gcc \
		cargo build --locked -p tesserae-cli --target $(AARCH64) --no-default-features --config profile.dev.package.tesserae-mesh.opt-level=2
	$(AARCH64_COMMAND) devices
	TESSERAE_TEST_COMMAND="$(AARCH64_COMMAND)" cargo test --locked $(FEATURES) --test clustering labels::

PYTHON_VENV := $(abspath $(TARGET))/python-venv
WHEELS := $(abspath $(TARGET))/wheels

# The wheel has neither service nor gpu; `pip install ./python` builds the same, with optimisation across crates, which
# takes two fifths of the processor time of a build.
.PHONY: wheel
wheel: $(PYTHON_VENV)/ready
	rm -rf $(WHEELS)
	CARGO_PROFILE_RELEASE_LTO=off \
		$(PYTHON_VENV)/bin/maturin build --manifest-path python/Cargo.toml --release --locked --auditwheel repair \
		--interpreter $(PYTHON_VENV)/bin/python --target-dir $(abspath $(TARGET)) --out $(WHEELS)

# pyacvd's own tests, which its source distribution leaves out.
PYACVD := $(abspath $(TARGET))/pyacvd-0.4.0

.PHONY: pyacvd-tests
pyacvd-tests:
	@test -d $(PYACVD)/tests || GIT_TERMINAL_PROMPT=0 timeout 120 git -c advice.detachedHead=false clone --quiet --depth 1 \
		--branch v0.4.0 https://github.com/pyvista/pyacvd $(PYACVD) || echo "skipped: pyacvd's own tests cannot be fetched"

.PHONY: python
python: debug-binary wheel pyacvd-tests  ## build the Python package, check its types, and run its tests
	$(PYTHON_VENV)/bin/pip install --quiet --disable-pip-version-check --no-deps --force-reinstall $(WHEELS)/*.whl
	$(PYTHON_VENV)/bin/vermin --quiet --no-tips --eval-annotations --target=3.9- --violations python/tesserae_mesh
	cd python && $(PYTHON_VENV)/bin/mypy --cache-dir $(PYTHON_VENV)/mypy tesserae_mesh examples tests
	cd python && $(PYTHON_VENV)/bin/pyright --pythonpath $(PYTHON_VENV)/bin/python tesserae_mesh examples
	TESSERAE_BINARY=$(abspath $(TARGET))/debug/tesserae TESSERAE_WHEEL=$$(echo $(WHEELS)/*.whl) \
		PYACVD_TESTS=$(PYACVD)/tests $(PYTHON_VENV)/bin/pytest -q -p no:cacheprovider python/tests

.PHONY: python-install
python-install: $(PYTHON_VENV)/ready  ## install the Python package into a new environment, from its source distribution as pip does
	rm -rf $(TARGET)/python-install
	$(PYTHON_VENV)/bin/maturin sdist --manifest-path python/Cargo.toml --out $(TARGET)/python-install
	python3 -m venv $(TARGET)/python-install/venv
	CARGO_TARGET_DIR=$(abspath $(TARGET)) $(TARGET)/python-install/venv/bin/pip install --quiet --disable-pip-version-check \
		$(TARGET)/python-install/tesserae_mesh-*.tar.gz
	cd $(TARGET)/python-install && venv/bin/python $(CURDIR)/python/examples/cluster_arrays.py

# The runtime is clang's; Rust's own is linked to programs only. LeakSanitizer finds what Python keeps to its end.
ASAN := $(abspath $(TARGET))/asan
ASAN_HOST = $(shell rustc -vV | sed -n 's/^host: //p')
ASAN_RUNTIME = $(lastword $(wildcard /usr/lib/llvm-*/lib/clang/*/lib/linux/libclang_rt.asan-$(shell uname -m).so))

.PHONY: python-asan
python-asan: $(PYTHON_VENV)/ready  ## 10,000 random inputs to the Python package under an address sanitizer (libclang-rt-dev)
	@test -n "$(ASAN_RUNTIME)" || { echo "there is no libclang_rt.asan: apt-get install libclang-rt-19-dev"; exit 1; }
	RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=address CARGO_PROFILE_DEV_OPT_LEVEL=1 CARGO_PROFILE_DEV_CODEGEN_UNITS=16 \
		CARGO_PROFILE_DEV_DEBUG=line-tables-only \
		cargo build --locked --manifest-path python/Cargo.toml --target $(ASAN_HOST) --target-dir $(ASAN) \
		--config 'profile.dev.package."*".opt-level=1' --config 'profile.dev.package."*".codegen-units=16'
	rm -rf $(ASAN)/package
	mkdir $(ASAN)/package
	cp -r python/tesserae_mesh $(ASAN)/package/
	cp $(ASAN)/$(ASAN_HOST)/debug/lib_native.so $(ASAN)/package/tesserae_mesh/_native.abi3.so
	LD_PRELOAD=$(ASAN_RUNTIME) ASAN_OPTIONS=detect_leaks=0:allocator_may_return_null=1 PYTHONMALLOC=malloc \
		PYTHONPATH=$(ASAN)/package $(PYTHON_VENV)/bin/python -W ignore -X faulthandler python/tests/test_random_inputs.py 10000

$(PYTHON_VENV)/ready: python/requirements-test.txt | install-test
	@echo "installing into $(PYTHON_VENV): $$(grep -v '^#' $< | tr '\n' ' ')"
	python3 -m venv $(PYTHON_VENV)
	$(PYTHON_VENV)/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@

$(TARGET)/node/ready: tests/scripts/gltf/package.json | install-test
	@echo "installing into $(TARGET)/node: gltf-validator three"
	mkdir -p $(TARGET)/node
	cp $< $(TARGET)/node/
	npm install --silent --no-fund --no-audit --no-package-lock --prefix $(TARGET)/node
	touch $@

.PHONY: page
page: debug-binary  ## the page in Chromium, against the service; pictures of it go to target/pictures
	node web/tests/page.mjs $(TARGET)/debug/tesserae --pictures $(TARGET)/pictures $(TESSERAE_TEST_MESHES)

.PHONY: page-times
page-times: debug-binary  ## what the page takes: until the first pictures, and for a frame of the slider
	node web/tests/page.mjs $(TARGET)/debug/tesserae --times

.PHONY: memory
memory: debug-binary  ## whether memory stays the same over many jobs (MEMORY_JOBS=500)
	python3 tests/scripts/memory.py $(TARGET)/debug/tesserae $(or $(MEMORY_JOBS),500)

.PHONY: throughput
throughput: bundle  ## measure small jobs a second
	cargo build --release --locked $(FEATURES)
	python3 tests/scripts/throughput.py $(TARGET)/release/tesserae

.PHONY: crash
crash: debug-binary  ## kill the service at random moments under load (KILLS=100 within CRASH_SECONDS=60), and count
	python3 tests/scripts/crash.py $(TARGET)/debug/tesserae $(or $(KILLS),100) $(or $(CRASH_SECONDS),60)

.PHONY: farm
farm: debug-binary  ## several services on one PostgreSQL, killed at random (FARM_JOBS=100 FARM_KILLS=8 FARM_STOPS=2 FARM_STREAMS=1000), and count
	python3 tests/scripts/farm.py $(TARGET)/debug/tesserae $(or $(FARM_JOBS),100) $(or $(FARM_KILLS),8) $(or $(FARM_STOPS),2) \
		$(or $(FARM_STREAMS),1000)

.PHONY: fuzz
fuzz: debug-binary $(VENV)/ready  ## the service against its OpenAPI document
	$(VENV)/bin/python tests/scripts/fuzz_api.py $(TARGET)/debug/tesserae

.PHONY: deploy
deploy: $(VENV)/ready  ## check Dockerfile, compose files, systemd unit and alert rules
	deploy/promtool.sh $(abspath $(VENV))/bin
	deploy/check.sh $(abspath $(VENV))/bin

.PHONY: image
image:  ## build the container image and try it as compose.yaml runs it (ENGINE=docker)
	deploy/try-image.sh $(or $(ENGINE),docker)

.PHONY: fuzz-parsers
fuzz-parsers:  ## fuzz every parser, FUZZ_SECONDS (60) each; needs `cargo install cargo-fuzz`
	fuzz/run.sh $(or $(FUZZ_SECONDS),60)

.PHONY: bench
bench: bench-stages bench-peers  ## measure the stages, and everything beside pyacvd, higra and scikit-learn

.PHONY: bench-stages
bench-stages: bundle  ## measure the stages before the clustering (FILTER=topology: a part of them)
	cargo bench --locked $(FEATURES) -p tesserae-mesh --bench stages -- $(FILTER)

.PHONY: bench-peers
bench-peers: bundle $(TARGET)/bench-venv/ready $(CGAL_DRIVER)  ## the same work by us and by peers, in turns: target/bench/{peers,remesh}.{md,json}
	cargo build --release --locked $(FEATURES)
	$(TARGET)/bench-venv/bin/pip install --quiet --disable-pip-version-check ./python
	$(TARGET)/bench-venv/bin/python benches/peers.py $(TARGET)/release/tesserae $(TARGET)/bench $(TESSERAE_TEST_MESHES)
	$(TARGET)/bench-venv/bin/python benches/remesh.py $(TARGET)/release/tesserae $(TARGET)/bench $(TESSERAE_TEST_MESHES) \
		$(if $(CGAL_DRIVER),--cgal $(CGAL_DRIVER))

$(TARGET)/bench/cgal_remesh: benches/cgal_remesh.cpp
	mkdir -p $(TARGET)/bench
	g++ -std=c++17 -O2 -DNDEBUG -I$(CGAL_INCLUDE) -I/usr/include/eigen3 $< -o $@ -lgmp -lmpfr

$(TARGET)/bench-venv/ready: benches/requirements.txt | install-test
	@echo "installing into $(TARGET)/bench-venv: $$(grep -v '^#' $< | tr '\n' ' ')"
	python3 -m venv $(TARGET)/bench-venv
	$(TARGET)/bench-venv/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@

.PHONY: gpu-check
gpu-check: gpu-check-pack  ## measure the graphics card of this machine, and say which constants suit it (GPU_CHECK_MINUTES=40)
	python3 $(TARGET)/gpu-check/gpu_check.py --out benches/results --minutes $(or $(GPU_CHECK_MINUTES),40)

.PHONY: gpu-check-pack
gpu-check-pack: install-test  ## pack target/gpu-check for a machine with a card and without network (GPU_CHECK_PROFILE=release)
	CARGO_TARGET_DIR=$(TARGET) benches/gpu_check_pack.sh $(TARGET)/gpu-check $(GPU_CHECK_PROFILE)

.PHONY: pages
pages: debug-binary $(VENV)/ready  ## write settings and output of commands into README and guide, after a change of either
	UPDATE_PAGES=1 cargo test --locked $(FEATURES) --test guide
	$(VENV)/bin/python tests/scripts/pages.py $(TARGET)/debug/tesserae --update

# Draws the shapes of a mesh in some clusters, by a name and angles.
shapes = $(TARGET)/debug/tesserae cluster $(1) --clusters $(2) --energy shapes --labels $(TARGET)/$(3).npy \
	--shapes-out $(TARGET)/$(3).json && \
	$(VENV)/bin/python docs/render.py $(1) $(TARGET)/$(3).npy docs/shapes-$(3).png shapes=$(TARGET)/$(3).json $(4)

.PHONY: picture
picture: debug-binary $(VENV)/ready  ## draw the pictures of the guide anew, and take those of the page (after `make python`)
	node web/tests/page.mjs $(TARGET)/debug/tesserae --pictures docs
	mv docs/share.jpg web/src/
	node web/tests/gallery.mjs $(TARGET)/debug/tesserae $(TARGET)/gallery --only '^empty$$'
	cp $(TARGET)/gallery/empty-1280-light.png docs/page-slider.png
	$(TARGET)/debug/tesserae sample knot --faces 200000 $(TARGET)/knot.obj
	$(TARGET)/debug/tesserae cluster $(TARGET)/knot.obj --clusters 400 --labels $(TARGET)/knot.npy
	$(VENV)/bin/python docs/render.py $(TARGET)/knot.obj $(TARGET)/knot.npy docs/knot.png
	$(TARGET)/debug/tesserae cluster $(TARGET)/knot.obj --clusters 1500 --labels $(TARGET)/knot.npy --remesh $(TARGET)/remesh.obj
	$(VENV)/bin/python docs/render.py $(TARGET)/knot.obj $(TARGET)/knot.npy docs/remesh.png $(TARGET)/remesh.obj
	$(TARGET)/debug/tesserae cluster $(TARGET)/knot.obj --clusters 40 --labels $(TARGET)/knot.npy
	$(VENV)/bin/python docs/render.py $(TARGET)/knot.obj $(TARGET)/knot.npy docs/chunks.png apart=0.35
	$(TARGET)/debug/tesserae sample part --faces 12528 $(TARGET)/part.obj
	$(call shapes,$(TARGET)/part.obj,13,part,tilt=-2.2 turn=5.2)
	test -z "$(TESSERAE_TEST_MESHES)" || { $(call shapes,$(TESSERAE_TEST_MESHES)/fandisk.obj,22 --resolution 1e-4,fandisk,\
		tilt=-2.3 turn=0.2); }
	MPLBACKEND=agg $(PYTHON_VENV)/bin/python -W ignore docs/render_guides.py

# The program that is tried from outside: with checks and named faults.
.PHONY: debug-binary
debug-binary: install-test bundle
	cargo build --locked $(FEATURES)

.PHONY: bundle
bundle: $(PAGE_BUNDLE)/page.js

$(PAGE_BUNDLE)/page.js: $(WEB) web/node_modules/ready
	web/node_modules/.bin/tsc --project web
	node web/bundle.mjs $(PAGE_BUNDLE)

web/node_modules/ready: web/package-lock.json web/.npmrc
	@deploy/install-missing.sh build
	@echo "installing into web/node_modules what web/package-lock.json lists"
	cd web && npm ci --silent
	touch $@

.PHONY: install-test
install-test:
	@deploy/install-missing.sh test

$(VENV)/ready: tests/scripts/requirements.txt | install-test
	@echo "installing into $(VENV): $$(grep -v '^#' $< | tr '\n' ' ')"
	python3 -m venv $(VENV)
	$(VENV)/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@
