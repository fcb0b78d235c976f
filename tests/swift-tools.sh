#!/usr/bin/env bash
# A Swift compiler and its libraries into target/swift-tools (0.6 GB), for the checks of ffi/swift: from
# Debian 13, which has it, on the mirror this machine uses; unpacked, not installed. They run with the C
# library they were built for, which is beside them.
set -euo pipefail
cd "$(dirname "$0")/.."
tools=${CARGO_TARGET_DIR:-target}/swift-tools
[ ! -f "$tools/complete" ] || exit 0
[ "$(uname -m)" = x86_64 ] || { echo "on x86_64 only" >&2; exit 1; }
mirror=$(apt-get indextargets --format '$(CODENAME) $(COMPONENT) $(REPO_URI)' "Created-By: Packages" |
  awk '$1 !~ /-/ && $2 == "main" { print $3; exit }')
[ -n "$mirror" ] || { echo "apt has no mirror of Debian's main packages" >&2; exit 1; }
rm -rf "$tools"
mkdir -p "$tools/apt/lists/partial" "$tools/apt/cache/archives/partial" "$tools/root"
apt=$(cd "$tools/apt" && pwd)
echo "deb $mirror trixie main" > "$apt/sources.list"
options=(-o "Dir::Etc::SourceList=$apt/sources.list" -o Dir::Etc::SourceParts=-
         -o "Dir::State::Lists=$apt/lists" -o "Dir::Cache=$apt/cache" -o APT::Sandbox::User=)
apt-get "${options[@]}" update -q
(cd "$apt" && apt-get "${options[@]}" download -q swiftlang libswiftlang libc6 libgcc-s1 libstdc++6 libtinfo6 \
  libuuid1 libzstd1 zlib1g)
# Without the debugger and the files of other platforms.
swift=./usr/libexec/swift
for package in "$apt"/*.deb; do
  dpkg-deb --fsys-tarfile "$package" | tar x -C "$tools/root" --wildcards \
    --exclude="$swift/lib/*lldb*" --exclude="$swift/lib/libsourcekit*" --exclude="$swift/lib/libLTO*" \
    --exclude="$swift/lib/swift_static" --exclude="$swift/lib/swift/embedded" \
    --exclude="$swift/lib/swift/pm" --exclude="$swift/lib/swift/FrameworkABIBaseline" \
    --exclude="$swift/bin/[!s]*" --exclude="$swift/bin/s[!w]*" --exclude="$swift/libexec" \
    --exclude="$swift/bin/swift-[!f]*" --exclude="$swift/bin/swift-format" --exclude='./usr/share'
done
rm -rf "$apt"
touch "$tools/complete"
