#!/usr/bin/env bash
# Takes what debuggers and crash reporters need out of a built library (ELF), and puts it apart:
#
#   ffi/symbols.sh LIBRARY FOLDER
#
# FOLDER gets the library as it ships, and NAME.debug with its symbols and, from the profile
# `dist-debug`, its line numbers. A link inside the library names the file, which debuggers look for
# beside it and in .debug/.
set -euo pipefail
if [ $# -ne 2 ]; then
  sed -n '2,9s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
name=$(basename "$1")
mkdir -p "$2"
objcopy=${OBJCOPY:-objcopy}
"$objcopy" --only-keep-debug "$1" "$2/$name.debug"
"$objcopy" --strip-unneeded "$1" "$2/$name"
chmod 644 "$2/$name.debug"
(cd "$2" && "$objcopy" --add-gnu-debuglink="$name.debug" "$name")
echo "$2/$name: $(stat -c %s "$2/$name") bytes, $name.debug: $(stat -c %s "$2/$name.debug")"
