# `make help` lists what there is to make. Everything that is built goes to target/ (or CARGO_TARGET_DIR).

SHELL := /bin/bash
TARGET := $(or $(CARGO_TARGET_DIR),target)
VENV := $(TARGET)/venv
# The page: what the bundle is made of, where it goes, and the feature that puts it into the binary.
WEB := $(wildcard web/src/* web/*.mjs web/*.json)
export PAGE_BUNDLE := $(abspath $(TARGET))/web
FEATURES := --features page
# Real meshes for the tests, where there are any; samples are made and used in any case.
ifneq ($(wildcard ../shared/meshes),)
export TESSERAE_TEST_MESHES ?= $(abspath ../shared/meshes)
endif
# Without a desktop, Mesa's device-select layer makes libwayland complain on standard error.
export NODEVICE_SELECT ?= 1
export TESSERAE_LISTEN ?= 127.0.0.1:8080
# Mesa asks Wayland's library for displays, which complains on standard error where this is not set.
export XDG_RUNTIME_DIR ?= /tmp

.PHONY: help
help:  ## list these targets
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1\t\2/p' $(MAKEFILE_LIST) | expand -t 16

.PHONY: run
run: bundle  ## install what is missing, build, and serve on http://127.0.0.1:8080, with a page there (TESSERAE_* variables are settings)
	cargo build --release --locked $(FEATURES)
	@echo "open http://$(TESSERAE_LISTEN)/ in a browser; press Ctrl-C to stop"
	@exec $(TARGET)/release/tesserae serve

.PHONY: test
test: lint  ## install what is missing and check everything, on cpu and on a software gpu
	@$(MAKE) --no-print-directory unit end-to-end bucket page outputs memory crash farm fuzz deploy

.PHONY: lint
lint: install-test bundle  ## formatting, clippy, documentation and choices of cargo features, warnings denied
	cargo fmt --check
	cargo clippy --locked --all-targets $(FEATURES) -- -D warnings
	cargo rustc --locked --lib --profile check -- --cfg fuzzing -D warnings
	tests/scripts/features.sh
	web/node_modules/.bin/prettier --log-level warn --check web/src web/tests web/bundle.mjs
	RUSTDOCFLAGS="-D warnings -A rustdoc::private-intra-doc-links" cargo doc --locked $(FEATURES) --no-deps --document-private-items

.PHONY: unit
unit: install-test bundle  ## the tests of the crate
	cargo test --locked $(FEATURES) --no-fail-fast

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

$(TARGET)/node/ready: tests/scripts/gltf/package.json | install-test
	@echo "installing into $(TARGET)/node: gltf-validator"
	mkdir -p $(TARGET)/node
	cp $< $(TARGET)/node/
	npm install --silent --no-fund --no-audit --no-package-lock --prefix $(TARGET)/node
	touch $@

.PHONY: page
page: debug-binary  ## the page in Chromium, against the service; pictures of it go to target/pictures
	node web/tests/page.mjs $(TARGET)/debug/tesserae --pictures $(TARGET)/pictures $(TESSERAE_TEST_MESHES)

.PHONY: memory
memory: debug-binary  ## whether memory stays the same over many jobs (MEMORY_JOBS=1000)
	python3 tests/scripts/memory.py $(TARGET)/debug/tesserae $(or $(MEMORY_JOBS),1000)

.PHONY: throughput
throughput: bundle  ## measure small jobs a second
	cargo build --release --locked $(FEATURES)
	python3 tests/scripts/throughput.py $(TARGET)/release/tesserae

.PHONY: crash
crash: debug-binary  ## kill the service at random moments under load (KILLS=100 within CRASH_SECONDS=60), and count
	python3 tests/scripts/crash.py $(TARGET)/debug/tesserae $(or $(KILLS),100) $(or $(CRASH_SECONDS),60)

.PHONY: farm
farm: debug-binary  ## several services on one PostgreSQL, killed at random (FARM_JOBS=100 FARM_KILLS=8 FARM_STOPS=2), and count
	python3 tests/scripts/farm.py $(TARGET)/debug/tesserae $(or $(FARM_JOBS),100) $(or $(FARM_KILLS),8) $(or $(FARM_STOPS),2)

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
	cargo bench --locked $(FEATURES) --bench stages -- $(FILTER)

.PHONY: bench-peers
bench-peers: bundle $(TARGET)/bench-venv/ready  ## the same work by us and by peers, in turns: target/bench/peers.md and .json
	cargo build --release --locked $(FEATURES)
	$(TARGET)/bench-venv/bin/python benches/peers.py $(TARGET)/release/tesserae $(TARGET)/bench $(TESSERAE_TEST_MESHES)

$(TARGET)/bench-venv/ready: benches/requirements.txt | install-test
	@echo "installing into $(TARGET)/bench-venv: $$(grep -v '^#' $< | tr '\n' ' ')"
	python3 -m venv $(TARGET)/bench-venv
	$(TARGET)/bench-venv/bin/pip install --quiet --disable-pip-version-check -r $<
	touch $@

.PHONY: pages
pages: debug-binary $(VENV)/ready  ## write settings and output of commands into README and guide, after a change of either
	UPDATE_PAGES=1 cargo test --locked $(FEATURES) --test guide
	$(VENV)/bin/python tests/scripts/pages.py $(TARGET)/debug/tesserae --update

.PHONY: picture
picture: debug-binary $(VENV)/ready  ## draw docs/knot.png and docs/remesh.png anew, and take the pictures of the page
	node web/tests/page.mjs $(TARGET)/debug/tesserae --pictures docs
	$(TARGET)/debug/tesserae sample knot --faces 200000 $(TARGET)/knot.obj
	$(TARGET)/debug/tesserae cluster $(TARGET)/knot.obj --clusters 400 --labels $(TARGET)/knot.npy
	$(VENV)/bin/python docs/render.py $(TARGET)/knot.obj $(TARGET)/knot.npy docs/knot.png
	$(TARGET)/debug/tesserae cluster $(TARGET)/knot.obj --clusters 1500 --labels $(TARGET)/knot.npy --remesh $(TARGET)/remesh.obj
	$(VENV)/bin/python docs/render.py $(TARGET)/knot.obj $(TARGET)/knot.npy docs/remesh.png $(TARGET)/remesh.obj

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
