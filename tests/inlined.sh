#!/usr/bin/env bash
# Fails if a vector instruction of ours stayed a function call. A closure inside a kernel causes that if it is compiled
# apart, without the kernel's processor features.
set -euo pipefail
cd "$(dirname "$0")/.."
[ "$(uname -m)" = x86_64 ] || { echo "SKIPPED: inlining of vector instructions is checked on x86-64"; exit 0; }
cargo build --quiet --release --workspace --bin svbrdf
objdump -dC --no-show-raw-insn "${CARGO_TARGET_DIR:-target}/release/svbrdf" | awk '
  /^[0-9a-f]+ <.*>:$/ { function_name = $0; if (/svbrdf::/) ours++ }
  /(call|jmp) .*_mm(256)?_/ && function_name !~ /tract|rustfft|jxl/ { print function_name; found = 1 }
  END {
    if (!ours) { print "no symbols: nothing was checked"; exit 1 }
    exit found
  }' | sort | uniq -c
echo "vector instructions: all inlined"
