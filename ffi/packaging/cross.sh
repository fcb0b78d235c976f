# For scripts that source it: `cross TARGET` makes this machine, a Debian or Ubuntu, ready to build for a Rust target of another
# processor or system by Debian's cross compilers, and sets RUNNER to what runs its programs. Installs what is missing. WINEPREFIX
# names the folder of wine's files, which is made.

cross() {
  local target=$1 name compiler packages
  case $target in
    aarch64-unknown-linux-gnu)
      compiler=aarch64-linux-gnu-gcc RUNNER=qemu-aarch64-static
      packages=(gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user-static) ;;
    x86_64-pc-windows-gnu)
      compiler=x86_64-w64-mingw32-gcc RUNNER=wine
      packages=(gcc-mingw-w64-x86-64 wine wine64) ;;
    *) echo "there are no cross compilers for $target" >&2; return 1 ;;
  esac
  if ! { command -v $compiler && command -v $RUNNER; } > /dev/null; then
    local sudo
    sudo=$([ "$(id -u)" = 0 ] || echo sudo)
    $sudo apt-get update -q
    DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "${packages[@]}"
  fi
  [ -d "$(rustc --print sysroot)/lib/rustlib/$target" ] || rustup target add "$target"
  name=${target//-/_}
  export "CC_$name=$compiler" "CARGO_TARGET_${name^^}_LINKER=$compiler"
  export RUNNER
  [ $RUNNER != wine ] || with_wine "$compiler"
}

# wine: no windows, no questions. Debian 12's wine has no bcryptprimitives.dll, which Rust's standard library draws the keys of
# its hash maps from: one that asks the function below.
with_wine() {
  export WINEDEBUG=-all DISPLAY= WINEDLLOVERRIDES='mscoree,mshtml='
  mkdir -p "$WINEPREFIX/libraries"
  export WINEPATH="Z:$WINEPREFIX/libraries"
  "$1" -shared -O2 -x c - -o "$WINEPREFIX/libraries/bcryptprimitives.dll" -ladvapi32 <<'END'
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(PVOID, ULONG);
__declspec(dllexport) BOOL WINAPI ProcessPrng(PBYTE data, SIZE_T length) {
  return SystemFunction036(data, (ULONG)length);
}
END
}
