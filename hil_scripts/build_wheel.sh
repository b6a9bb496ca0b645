#!/usr/bin/env bash
# Builds the wheel of the Python package: target/wheels/starloop-VERSION-cp39-abi3-PLATFORM.whl, with the program in it.
#
#   hil_scripts/build_wheel.sh
#
# The module and the program are those of the workspace's release build, so that nothing is compiled a second time; the wheel
# is put together by hil_scripts/make_wheel.py.
set -euo pipefail
cd "$(dirname "$0")/.."

target="${CARGO_TARGET_DIR:-target}"
cargo build --locked --workspace --all-features --release --lib --bins
python3 hil_scripts/make_wheel.py --target "$target" --out "$target/wheels"
