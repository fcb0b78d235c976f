#!/usr/bin/env bash
# Packs `scanner` as an AAR with POM and sources, laid out as a Maven repository, without Gradle:
#
#   android-example/aar.sh OUT [ABI=FOLDER]... [--notices FILE]
#   android-example/aar.sh check ABI=FOLDER...       only looks at the libraries; needs readelf alone
#
# OUT gets org/svbrdf/scanner/VERSION/scanner-VERSION.aar, .pom and -sources.jar: name it to Gradle by
# `maven { url = uri("OUT") }` and depend on `org.svbrdf:scanner:VERSION`.
#
# ABI is arm64-v8a or x86_64, FOLDER has libsvbrdf.so and libsvbrdf_jni.so for it. Without any, both
# ABIs are built: that needs ANDROID_NDK_HOME, cargo-ndk and rustup's targets (no check has run it).
# --notices: THIRD-PARTY.txt of ffi/packaging/notices.sh, which has to go with the libraries.
#
# Needs a JDK of 17 or later and a Kotlin compiler: KOTLIN_HOME, or that of tests/android-tools.sh.
set -euo pipefail
usage() { sed -n '2,16s/^# \{0,1\}//p' "$0" >&2; exit 2; }
[ $# -ge 1 ] || usage
out=
if [ "$1" != check ]; then
  mkdir -p "$1"
  out=$(cd "$1" && pwd)
fi
shift
notices=
libraries=()
while [ $# -gt 0 ]; do
  case $1 in
    --notices) notices=$(realpath "${2:?"--notices: a file is missing"}"); shift 2 ;;
    arm64-v8a=* | x86_64=*) libraries+=("${1%%=*}=$(realpath "${1#*=}")"); shift ;;
    *) usage ;;
  esac
done
[ -n "$out" ] || [ ${#libraries[@]} -gt 0 ] || usage
here=$(cd "$(dirname "$0")" && pwd)
root=$(dirname "$here")
export LC_ALL=C
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Finds faults here that would keep a device from loading the library, or end the app there.
readonly api=26
check() {
  local file=$1 machine=$2 name alignment dynamic symbols faults=0
  name=$(basename "$file")
  fault() { echo "$file: $1" >&2; faults=1; }
  [ -f "$file" ] || { echo "$file: no such file" >&2; exit 1; }
  dynamic=$(readelf -dW "$file")
  readelf -hW "$file" | grep -q "Machine:.*$machine" || fault "not for $machine"
  grep -q "SONAME.*\[$name\]" <<< "$dynamic" || fault "its SONAME is another"
  ! grep NEEDED <<< "$dynamic" | grep -Evq '\[(libsvbrdf|libc|libm|libdl|liblog)\.so\]' ||
    fault "it needs what Android does not have"
  ! grep -q TEXTREL <<< "$dynamic" || fault "its code would be changed while it is loaded (TEXTREL)"
  # Threads end after `dlclose`, with destructors in the library.
  grep -q 'FLAGS_1.*NODELETE' <<< "$dynamic" || fault "it can be unloaded (-z nodelete is missing)"
  # Devices may have pages of 16 KB.
  for alignment in $(readelf -lW "$file" | awk '$1 == "LOAD" { print $NF }'); do
    [ $((alignment)) -ge 16384 ] || fault "a segment is not aligned to 16 KB"
  done
  symbols=$(readelf --dyn-syms -W "$file" | awk '$7 == "UND" && $5 == "GLOBAL" && $8 != "" { print $8 }')
  # Android's libraries name the release that a symbol came with: LIBC, LIBC_N (API 24), LIBC_O (API 26), LIBC_P (28).
  for symbol in $symbols; do
    case $symbol in
      *@LIBC | *@LIBC_N | *@LIBC_O | *@LIBLOG | *@LIBLOG_[LMO]) ;;
      svbrdf_*) [ "$name" != libsvbrdf.so ] || fault "$symbol is missing" ;;
      *) fault "$symbol is not in API $api" ;;
    esac
  done
  exports "$file" > "$work/exported"
  case $name in
    libsvbrdf.so) grep '^svbrdf_' "$root/ffi/symbols.txt" | sort > "$work/expected" ;;
    *) echo JNI_OnLoad > "$work/expected" ;;
  esac
  for symbol in $(comm -23 "$work/exported" "$work/expected"); do fault "$symbol is exported"; done
  for symbol in $(comm -13 "$work/exported" "$work/expected"); do fault "$symbol is not exported"; done
  [ $faults = 0 ] || exit 1
}
exports() {
  readelf --dyn-syms -W "$1" |
    awk '$1 ~ /^[0-9]+:$/ && $7 != "UND" && $7 != "ABS" && $5 != "LOCAL" { sub(/@.*/, "", $8); print $8 }' | sort
}

each() {
  local given abi folder machine name
  for given in "${libraries[@]}"; do
    abi=${given%%=*} folder=${given#*=}
    case $abi in arm64-v8a) machine=AArch64 ;; x86_64) machine=X86-64 ;; esac
    for name in libsvbrdf.so libsvbrdf_jni.so; do
      check "$folder/$name" "$machine"
      [ -z "$out" ] || install -D -m 644 "$folder/$name" "$aar/jni/$abi/$name"
    done
  done
}
if [ -z "$out" ]; then
  each
  echo "fine for API $api: ${libraries[*]}"
  exit 0
fi
kotlin=${KOTLIN_HOME:-${CARGO_TARGET_DIR:-$root/target}/android-tools/kotlinc}
[ -f "$kotlin/lib/kotlin-compiler.jar" ] || { echo "no Kotlin compiler in $kotlin: set KOTLIN_HOME" >&2; exit 1; }
value() { sed -n "s/^$2 = \"\(.*\)\"/\1/p" "$1" | head -n 1; }
version=$(value "$root/Cargo.toml" version)
main=$here/scanner/src/main
aar=$work/aar
mkdir -p "$aar/META-INF/com/android/build/gradle" "$aar/META-INF/licenses/svbrdf" "$work/classes"
# Entries of archives get one time, so that the same input gives the same bytes.
pack() { (cd "$2" && jar --create --no-manifest --date=2000-01-01T00:00:00Z --file "$1" "${@:3}"); }

# Both libraries for an ABI with the NDK, into a folder.
build() {
  local abi=$1 arch=$2 ndk=${ANDROID_NDK_HOME:?"name libraries (ABI=FOLDER), or set ANDROID_NDK_HOME"}
  (cd "$root" && cargo ndk -t "$abi" --platform 26 -o "$work/built" build --profile dist -p svbrdf-ffi --features jxl)
  "$ndk"/toolchains/llvm/prebuilt/*/bin/"$arch"-linux-android26-clang -std=c11 -O2 -fPIC -shared \
    -fvisibility=hidden -I "$root/include" "$main"/cpp/*.c -L "$work/built/$abi" -lsvbrdf \
    -Wl,-soname,libsvbrdf_jni.so -Wl,-z,max-page-size=16384 -Wl,-z,nodelete -Wl,--no-undefined -s \
    -o "$work/built/$abi/libsvbrdf_jni.so"
  libraries+=("$abi=$work/built/$abi")
}
if [ ${#libraries[@]} = 0 ]; then
  build arm64-v8a aarch64
  build x86_64 x86_64
fi
each

# Metadata of an older version is read by the compilers of more apps. The compiler ends before it pays to optimise it.
java -Xmx1g -XX:TieredStopAtLevel=1 -XX:+UseSerialGC -cp "$kotlin/lib/kotlin-compiler.jar" org.jetbrains.kotlin.cli.jvm.K2JVMCompiler \
  -kotlin-home "$kotlin" -no-reflect -jvm-target 1.8 -language-version 2.2 -api-version 2.2 \
  -module-name svbrdf-scanner -cp "$kotlin/lib/kotlin-stdlib.jar:$kotlin/lib/kotlinx-coroutines-core-jvm.jar" \
  -d "$work/classes" "$main/kotlin"
pack "$aar/classes.jar" "$work/classes" .

cat > "$aar/AndroidManifest.xml" <<END
<?xml version="1.0" encoding="utf-8"?>
<manifest xmlns:android="http://schemas.android.com/apk/res/android"
    package="org.svbrdf.scanner">

    <uses-sdk
        android:minSdkVersion="26"
        android:targetSdkVersion="36" />
</manifest>
END
: > "$aar/R.txt"
cp "$here/scanner/consumer-rules.pro" "$aar/proguard.txt"
cat > "$aar/META-INF/com/android/build/gradle/aar-metadata.properties" <<END
aarFormatVersion=1.0
aarMetadataVersion=1.0
minCompileSdk=26
minCompileSdkExtension=0
minAndroidGradlePluginVersion=1.0.0
coreLibraryDesugaringEnabled=false
END
cp "$root/LICENSE-MIT" "$root/LICENSE-APACHE" "$aar/META-INF/licenses/svbrdf/"
[ -z "$notices" ] || cp "$notices" "$aar/META-INF/licenses/svbrdf/THIRD-PARTY.txt"

place=$out/org/svbrdf/scanner/$version
rm -rf "$place"
mkdir -p "$place"
name=$place/scanner-$version
pack "$name.aar" "$aar" AndroidManifest.xml classes.jar R.txt proguard.txt META-INF jni
mkdir -p "$work/sources"
cp -r "$main/kotlin/." "$work/sources/"
pack "$name-sources.jar" "$work/sources" .
repository=$(value "$root/Cargo.toml" repository)
cat > "$name.pom" <<END
<?xml version="1.0" encoding="UTF-8"?>
<project xmlns="http://maven.apache.org/POM/4.0.0"
    xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:schemaLocation="http://maven.apache.org/POM/4.0.0 https://maven.apache.org/xsd/maven-4.0.0.xsd">
  <modelVersion>4.0.0</modelVersion>
  <groupId>org.svbrdf</groupId>
  <artifactId>scanner</artifactId>
  <version>$version</version>
  <packaging>aar</packaging>
  <name>svbrdf scanner</name>
  <description>Material maps from a few flash photographs</description>
  <url>$repository</url>
  <licenses>
    <license>
      <name>MIT OR Apache-2.0</name>
      <url>$repository/blob/main/LICENSE-MIT</url>
    </license>
  </licenses>
  <dependencies>
    <dependency>
      <groupId>org.jetbrains.kotlin</groupId>
      <artifactId>kotlin-stdlib</artifactId>
      <version>2.2.0</version>
      <scope>compile</scope>
    </dependency>
    <dependency>
      <groupId>org.jetbrains.kotlinx</groupId>
      <artifactId>kotlinx-coroutines-core</artifactId>
      <version>1.8.0</version>
      <scope>compile</scope>
    </dependency>
  </dependencies>
</project>
END
(cd "$place" && sha256sum ./* | sed 's# ./# #' > "$work/sums" && while read -r sum file; do
  echo "$sum" > "$file.sha256"
done < "$work/sums")
echo "$name.aar"
