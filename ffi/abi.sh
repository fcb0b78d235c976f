#!/usr/bin/env bash
# Compares the C ABI with that of the last release, ffi/abi.txt: what programs built then rely on must
# still be there. New functions, constants and structs are fine, and so are new fields at the end of
# structs that begin with their size.
#
#   ffi/abi.sh            fails and names what is missing or changed
#   ffi/abi.sh release    writes ffi/abi.txt anew: part of a release, for no other time
#
# As clang sees the header for 64-bit Linux: functions and types, values of constants, and where each
# field of a struct lies. That the library exports what the header declares is tested elsewhere.
set -euo pipefail
export LC_ALL=C
cd "$(dirname "$0")"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
header=${SVBRDF_HEADER:-../include/svbrdf.h}
see() { clang --target=x86_64-linux-gnu -std=c99 -x c "$@" "$header"; }

{
  # The first of them guards the header.
  see -E -dM | sed -n 's/^#define \(SVBRDF_[A-Z0-9_]*\) \(.*\)$/constant \1 \2/p' | grep -v _VERSION_
  see -fsyntax-only -Xclang -ast-print | sed -n \
    -e 's/^typedef \(.*svbrdf_.*\);$/type \1/p' \
    -e '/^[^ ].*[ *]svbrdf_[a-z0-9_]*(.*);$/ { s/\([ *]\)[a-z_0-9]*\([,)]\)/\1\2/g; s/ \([,)]\)/\1/g; s/;$//; s/(void)/()/; s/^/function /; p }'
  # What is reserved may become a field. Fields of fields are indented further, and belong to their own struct.
  see -fsyntax-only -Xclang -fdump-record-layouts-complete | awk '
    /\| struct svbrdf_/ && /^ *0 \| struct/ { name = $4; next }
    /^\*\*\*/ { name = "" }
    name == "" { next }
    /\[sizeof=/ { sub(/.*sizeof=/, ""); print "struct", name, "bytes", $0 + 0; name = ""; next }
    match($0, /\|   [^ ]/) { offset = $1; sub(/.*\|   /, ""); if (!/ reserved[a-z_]*$/) print "struct", name, "at", offset, $0 }'
} | sort -u > "$work/now"
grep -q '^function ' "$work/now" && grep -q '^struct ' "$work/now" && grep -q '^constant ' "$work/now" ||
  { echo "clang's output is not understood" >&2; exit 1; }

if [ "${1:-}" = release ]; then
  cp "$work/now" abi.txt
  echo "ffi/abi.txt: $(wc -l < abi.txt) lines"
  exit 0
fi
comm -23 abi.txt "$work/now" > "$work/gone"
# A struct that begins with its size may grow.
awk '
  FILENAME == ARGV[1] { if ($1 == "struct" && $3 == "bytes") bytes[$2] = $4
                        if ($0 ~ /at 0 size_t size$/) sized[$2] = 1
                        next }
  $1 == "struct" && $3 == "bytes" && sized[$2] && bytes[$2] > $4 { next }
  { print }' "$work/now" "$work/gone" > "$work/broken"
if [ -s "$work/broken" ]; then
  echo "The C ABI of the last release is broken; missing or changed:" >&2
  sed 's/^/  /' "$work/broken" >&2
  exit 1
fi
echo "C ABI: compatible with the last release, $(comm -13 abi.txt "$work/now" | wc -l) lines new"
