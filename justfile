# `just` lists what there is. CI runs .ci/run, which is the last word.

features := ""

# List the recipes.
default:
    @just --list

# Build the program; `just features=--no-default-features build` leaves the Rerun SDK out.
build:
    cargo build --release {{features}}

# Everything that `cargo test` checks.
test:
    cargo test {{features}}

# The whole graph with tiny sizes.
smoke *args:
    cargo run {{features}} -- run pipelines/smoke.toml {{args}}

# The main job.
run *args:
    cargo run --release {{features}} -- run pipelines/planar_online.toml {{args}}

clippy:
    cargo clippy --no-default-features --all-targets -- -D warnings

fmt:
    cargo fmt --all

# Kill smoke.toml fifty times at random moments: nothing finished is lost or done twice.
chaos kills="50":
    CHAOS_KILLS={{kills}} CHAOS_PIPELINE=pipelines/smoke.toml cargo test {{features}} --test cli_chaos -- --nocapture

# The documentation of the code.
docs:
    cargo doc --no-default-features --no-deps --document-private-items --open

# Licences, advisories, sources and duplicates of dependencies (needs cargo-deny).
deny:
    cargo deny check

# What CI runs.
ci:
    .ci/run
