# `just` lists what there is. CI runs .ci/run, which is the last word.

# List the recipes.
default:
    @just --list

# Build the program.
build:
    cargo build --release

# Build the live view. The Rerun SDK takes about ten minutes.
build-view:
    cargo build --release -p carl-view

# All tests of the program.
test:
    cargo test

# All tests of the live view.
test-view:
    cargo test -p carl-view

# The whole graph with tiny sizes.
smoke *args:
    cargo run -- run pipelines/smoke.toml {{args}}

# The main job.
run *args:
    cargo run --release -- run pipelines/planar_online.toml {{args}}

clippy:
    cargo clippy --workspace --all-targets -- -D warnings

fmt:
    cargo fmt --all

# Kill smoke.toml fifty times at random moments: nothing finished is lost or done twice.
chaos kills="50":
    CHAOS_KILLS={{kills}} CHAOS_PIPELINE=pipelines/smoke.toml cargo test --test it cli::chaos -- --nocapture

# The documentation of the code.
docs:
    cargo doc --no-deps --document-private-items --open

# Licences, advisories, sources and duplicates of dependencies (needs cargo-deny).
deny:
    cargo deny --workspace check

# What CI runs.
ci:
    .ci/run
