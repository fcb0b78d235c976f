#!/usr/bin/env bash
# Makes the book in target/book: these pages (mdBook), rustdoc of the crate in rust/, Doxygen of the C
# header in c/. Checks that the pages' links to these lead somewhere.
set -euo pipefail
cd "$(dirname "$0")"
for tool in mdbook doxygen; do
  command -v "$tool" >/dev/null ||
    { echo "$tool is missing (cargo install --locked mdbook; Debian: doxygen)" >&2; exit 1; }
done
book=$(cd .. && pwd)/target/book
mdbook build .
(cd .. && cargo doc --release --no-deps --quiet -p svbrdf -p svbrdf-models)
rm -rf "$book/rust" "$book/c"
cp -r "${CARGO_TARGET_DIR:-../target}/doc" "$book/rust"
doxygen - <<EOF
PROJECT_NAME = svbrdf
PROJECT_BRIEF = "C interface"
INPUT = ../include/svbrdf.h ../include/svbrdf.hpp ../include/svbrdf
OUTPUT_DIRECTORY = $book
HTML_OUTPUT = c
GENERATE_LATEX = NO
JAVADOC_AUTOBRIEF = YES
OPTIMIZE_OUTPUT_FOR_C = YES
EXTRACT_ALL = YES
HAVE_DOT = NO
QUIET = YES
WARN_IF_UNDOCUMENTED = NO
EOF
faults=0
for link in $(grep -ohE '\]\((rust|c)/[^)#]*' ./*.md | sed 's/^](//'); do
  [ -f "$book/$link" ] || { echo "$link is not in the book" >&2; faults=1; }
done
[ "$faults" = 0 ] && echo "$book/index.html"
