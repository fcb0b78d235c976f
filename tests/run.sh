#!/usr/bin/env bash
# Runs the checks of the repository:
#
#   tests/run.sh            all of them; arguments are handed to cargo test
#   tests/run.sh --quick    formatting, spelling, unit tests, documents, command line, C and C++ clients
#
# --quick needs Rust and a C and a C++ compiler, and installs nothing: 12 minutes on two cores the first time, four
# where dependencies have been compiled. It leaves out the installed package, the C examples, also those of the
# documents, and valgrind.
#
# Without --quick, everything is compiled once, and lints, packages, exports, report and Python module are checked
# beside the tests: 24 minutes on two cores the first time, 14 where dependencies have been compiled. The
# last line says how long the run took. Packages that are missing are installed by apt (as root, or by sudo), one
# call a tool, so that one that cannot be had leaves the others in place:
#   clang, libclang-dev, libopencv-dev, pkg-config   OpenCV as an oracle of the calibration
#   gcc, g++, valgrind, cmake, parallel              C and C++ clients, the installed package, the batch script
#   default-jdk-headless, npm, aapt, zipalign, apksigner, android-framework-res   the Kotlin binding and the app
#   nodejs, chromium, fonts-dejavu-core, python3-venv   validators of exports, report.html in a browser
# and, below target/, packages of npm and PyPI (validators, typos; maturin, numpy, pytest and mypy for the Python
# module), a Kotlin compiler, and a Swift compiler from Debian 13: 2 GB altogether.
#
# Debian 12 and 13 have all of these packages. Ubuntu's chromium is a snap, which these checks cannot start as
# root, and the Swift and Android tools come from a Debian mirror: both are skipped there.
#
# Apart from these, because they compile the library once more or download much: tests/aarch64.sh,
# tests/thread-sanitizer.sh, tests/blender.sh, tests/web.sh, tests/cross.sh, tests/conda.sh, tests/many.sh (Dask); and those that
# start daemons or change roots: tests/slurm.sh, tests/image.sh, tests/bionic.sh.
#
# Skipped checks are reported, counted at the end, and fail the run with SVBRDF_STRICT=1. SVBRDF_TEST_DATA
# may name a folder with further captures: a missing file there is a failure. Without it, tests that need it
# are skipped.
set -euo pipefail
cd "$(dirname "$0")/.."

quick=
if [ "${1:-}" = --quick ]; then
  quick=1
  shift
elif [ "${1:-}" = --help ] || [ "${1:-}" = -h ]; then
  sed -n '2,/^set /{/^set /d;s/^# \{0,1\}//;p}' "$0"
  exit 0
fi

SVBRDF_SKIPPED=$(mktemp)
export SVBRDF_SKIPPED
finish() {
  local status=$? count
  # Checks that still run beside a failed one.
  kill $(jobs -p) 2>/dev/null || true
  count=$(sort -u "$SVBRDF_SKIPPED" | wc -l)
  if [ "$count" -gt 0 ]; then
    sort -u "$SVBRDF_SKIPPED" | sed 's/^/  /'
    echo "SKIPPED: these $count checks; SVBRDF_TEST_DATA or a tool is missing"
    if [ "$status" = 0 ] && [ "${SVBRDF_STRICT:-}" = 1 ]; then
      echo "SVBRDF_STRICT=1: what is skipped fails" >&2
      status=1
    fi
  fi
  rm -f "$SVBRDF_SKIPPED"
  echo "tests/run.sh: $((SECONDS / 60)) min $((SECONDS % 60)) s"
  exit "$status"
}
trap finish EXIT

if [ -n "$quick" ]; then
  cargo fmt --all --check
  tests/spelling.sh --installed
  # One selection of packages: of one package alone, dependencies would be compiled anew.
  packages=(-p svbrdf -p svbrdf-models -p svbrdf-cli -p svbrdf-ffi)
  tests=(--lib --bins --test structure --test documents --test dependencies --test session --test header --test fit
    --test commands)
  # Everything at once, so that no processor waits; then the shared library, which no test is linked with. With a
  # test in the selection, its dependencies have the same features.
  cargo test --no-run --release "${packages[@]}" "${tests[@]}" --test clients
  cargo build --release "${packages[@]}" --lib --test clients
  export SVBRDF_LIBRARY=${CARGO_TARGET_DIR:-$PWD/target}/release/libsvbrdf.so
  cargo test --release "${packages[@]}" "${tests[@]}" "$@"
  SVBRDF_TEST_QUICK=1 cargo test --release "${packages[@]}" --test clients "$@" -- \
    --skip valgrind --skip examples_run --skip packaging::
  exit 0
fi

. tests/tools.sh

has "C clients" gcc gcc libc6-dev || true
has "C++ clients" g++ g++ || true
has "memory checks" valgrind valgrind || true
has "the batch script with GNU parallel" parallel parallel || true
has "the CMake package" cmake cmake make || true
has "the pkg-config package" pkg-config pkg-config || true
oracle=()
need "OpenCV as an oracle" "pkg-config --exists opencv4" libopencv-dev &&
  need "OpenCV as an oracle" "ls /usr/lib/llvm-*/lib/libclang.so*" clang libclang-dev ||
  oracle=(--exclude svbrdf-opencv-oracle)
has "the comparison of C ABIs" clang clang || true
has "the Kotlin binding" javac default-jdk-headless || true
has "the Kotlin binding" npm npm || true
for tool in aapt zipalign apksigner; do
  has "the Android app" "$tool" "$tool" || true
done
need "the Android app" "test -f /usr/share/android-framework-res/framework-res.apk" \
  android-framework-res || true
# Downloads, while the compiler works.
{
  tests/swift-tools.sh || echo "a Swift compiler, for ffi/swift" >> "$SVBRDF_SKIPPED"
  tests/android-tools.sh || echo "tools for android-example" >> "$SVBRDF_SKIPPED"
} &
tools=$!

# Everything is compiled as one selection of packages: of one package alone, dependencies would have other
# features and be compiled anew.
packages=(--workspace "${oracle[@]}")
cargo fmt --all --check
cargo build --release "${packages[@]}" --lib --bins --tests
export SVBRDF_LIBRARY=${CARGO_TARGET_DIR:-$PWD/target}/release/libsvbrdf.so
wait "$tools"

# Beside the tests, which leave a processor idle while they wait for the last of a file; shown at the end. Checks that
# use cargo come last: the tests hold the lock of its folder until they are compiled. Lints and documentation
# use the macros and build scripts that are there, and check dependencies once for both.
log=$(mktemp)
(
  tests/package.sh
  tests/licences.sh
  tests/spelling.sh
  tests/report.sh
  tests/exports.sh
  cargo clippy --release "${packages[@]}" --all-targets --quiet -- -D warnings
  RUSTDOCFLAGS="-D warnings" cargo doc --release --no-deps "${packages[@]}" --quiet
  tests/inlined.sh
  tests/python.sh
) > "$log" 2>&1 &
others=$!
failed=0
cargo test --release "${packages[@]}" "$@" || failed=1
wait "$others" || failed=1
cat "$log"
rm -f "$log"
exit "$failed"
