# Installs the tools of checks, for the scripts that source it. Packages come by apt (Debian, Ubuntu), one call
# a tool, so that one that cannot be had leaves the others in place. Missing tools are reported, and noted in
# the file that SVBRDF_SKIPPED names.

skip() {
  echo "SKIPPED: $*"
  echo "$*" >> "${SVBRDF_SKIPPED:-/dev/null}"
}

# Lists of packages are fetched once, and only if something is missing.
updated=
install() {
  local sudo
  sudo=$([ "$(id -u)" = 0 ] || echo sudo)
  command -v apt-get >/dev/null || return 1
  if [ -z "$updated" ]; then
    $sudo apt-get update -q || true
    updated=1
  fi
  DEBIAN_FRONTEND=noninteractive $sudo apt-get install -qy --no-install-recommends "$@"
}

# need WHAT CHECK PACKAGE...: installs the packages unless the command CHECK finds the tool.
need() {
  local what=$1 check=$2
  shift 2
  eval "$check" >/dev/null 2>&1 && return 0
  install "$@" && eval "$check" >/dev/null 2>&1 && return 0
  skip "$what: $* cannot be installed"
  return 1
}

# has WHAT PROGRAM PACKAGE...: the same for a program on the path.
has() { need "$1" "command -v $2" "${@:3}"; }

# The last one that takes Debian 12's Node.
PLAYWRIGHT=playwright-core@1.61

# modules WHAT FOLDER PACKAGE...: the same for packages of npm, each with a version or none, below a folder.
modules() {
  local what=$1 folder=$2 package
  shift 2
  mkdir -p "$folder"
  for package; do
    [ -d "$folder/node_modules/${package%@*}" ] && continue
    npm install --silent --no-audit --no-fund --prefix "$folder" "$@" && return 0
    skip "$what: $* cannot be installed"
    return 1
  done
}
