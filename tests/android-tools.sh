#!/usr/bin/env bash
# Gets the tools of android-example's checks that Debian 12 does not have, into
# target/android-tools: a Kotlin compiler (npm has it) and Android's class library with dx (from
# Debian 11, which had them last, on the mirror this machine uses; unpacked, not installed).
set -euo pipefail
cd "$(dirname "$0")/.."
tools=${CARGO_TARGET_DIR:-target}/android-tools
kotlin=2.4.20
kotlin_sha256=c23dab400d7ce5ea8b6c909947c0ca5454189e4bb1108695b5f464500e5e950f

if [ ! -f "$tools/kotlinc/lib/kotlin-compiler.jar" ]; then
  work=$(mktemp -d)
  trap 'rm -rf "$work"' EXIT
  npm pack --silent --pack-destination "$work" "kotlin-compiler@$kotlin"
  echo "$kotlin_sha256  $work/kotlin-compiler-$kotlin.tgz" | sha256sum --check --quiet
  tar xzf "$work/kotlin-compiler-$kotlin.tgz" -C "$work"
  mkdir -p "$tools"
  rm -rf "$tools/kotlinc"
  mv "$work/package" "$tools/kotlinc"
fi

if [ ! -f "$tools/root/usr/share/java/com.android.dx.jar" ]; then
  mirror=$(apt-get indextargets --format '$(CODENAME) $(COMPONENT) $(REPO_URI)' "Created-By: Packages" |
    awk '$1 !~ /-/ && $2 == "main" { print $3; exit }')
  [ -n "$mirror" ] || { echo "apt has no mirror of Debian's main packages" >&2; exit 1; }
  mkdir -p "$tools/apt/lists/partial" "$tools/apt/cache/archives/partial"
  apt=$(cd "$tools/apt" && pwd)
  echo "deb $mirror bullseye main" > "$apt/sources.list"
  options=(-o "Dir::Etc::SourceList=$apt/sources.list" -o Dir::Etc::SourceParts=-
           -o "Dir::State::Lists=$apt/lists" -o "Dir::Cache=$apt/cache" -o APT::Sandbox::User=)
  apt-get "${options[@]}" update -q
  (cd "$apt" && apt-get "${options[@]}" download -q libandroid-23-java dalvik-exchange)
  mkdir -p "$tools/root"
  for package in "$apt"/*.deb; do
    dpkg -x "$package" "$tools/root"
  done
  rm -rf "$apt"
fi
