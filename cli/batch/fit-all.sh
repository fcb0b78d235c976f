#!/bin/sh
#SBATCH --job-name=svbrdf
#SBATCH --cpus-per-task=4
#SBATCH --mem-per-cpu=600M
# Fits every capture of a folder, several at once, and passes over what is done:
#
#   fit-all.sh CAPTURES OUT [options of `svbrdf fit`]
#
# Every folder in CAPTURES is one capture, or holds the photographs of one; its maps go to OUT/NAME, what
# was said to OUT/NAME.log. Started again after anything, it does what is left.
#
# Exit status: 0 all are done; 2 all but those whose input is at fault, which another try does not
# mend; 1 others failed; 130 interrupted.
#
# SVBRDF_JOBS: fits at once, one thread each (default: cores). SVBRDF: the command. SVBRDF_SHARES and
# SVBRDF_SHARE: do one share of the captures, counted from 0; known without them in a Slurm array
# (sbatch --array=0-7 --cpus-per-task=4 fit-all.sh CAPTURES OUT) and, but for the number, in a Kubernetes Job.
set -u
if [ $# -lt 2 ]; then
  sed -n '5,18s/^# \{0,1\}//p' "$0" >&2
  exit 2
fi
captures=$1
out=$2
shift 2
shares=${SVBRDF_SHARES:-${SLURM_ARRAY_TASK_COUNT:-1}}
first=${SLURM_ARRAY_TASK_MIN:-0}
share=${SVBRDF_SHARE:-${JOB_COMPLETION_INDEX:-$((${SLURM_ARRAY_TASK_ID:-$first} - first))}}
jobs=${SVBRDF_JOBS:-${SLURM_CPUS_PER_TASK:-$(nproc)}}
SVBRDF=${SVBRDF:-svbrdf}
[ -d "$captures" ] || { echo "$captures: no such folder" >&2; exit 2; }
[ "$share" -lt "$shares" ] || { echo "share $share of $shares: they are counted from 0" >&2; exit 2; }
mkdir -p "$out" || exit 1
results=$(mktemp -d) || exit 1
trap 'rm -rf "$results"' EXIT
export SVBRDF

# One capture: its status is left where the end of this script looks.
# shellcheck disable=SC2016
one='
  capture=$1; out=$2; results=$3; shift 3
  name=$(basename "$capture")
  "$SVBRDF" fit "$capture" --out "$out/$name" --skip-existing --threads 1 "$@" > "$out/$name.log" 2>&1
  status=$?
  echo $status > "$results/$name"
  [ $status = 0 ] || echo "$name: status $status: $(tail -n 1 "$out/$name.log")" >&2
'
mine() {
  n=0
  for capture in "$captures"/*/; do
    [ -d "$capture" ] || continue
    [ $((n % shares)) -ne "$share" ] || printf '%s\0' "${capture%/}"
    n=$((n + 1))
  done
}
expected=$(mine | tr -dc '\0' | wc -c)
if [ "$expected" -gt 0 ]; then
  if command -v parallel >/dev/null; then
    mine | parallel --null --quote --jobs "$jobs" sh -c "$one" fit {} "$out" "$results" "$@"
  else
    mine | xargs -0 -P "$jobs" -I {} sh -c "$one" fit {} "$out" "$results" "$@"
  fi
fi

count() { cat "$results"/* 2>/dev/null | grep -c "$1"; }
done=$(count '^0$') faulty=$(count '^2$') interrupted=$(count '^130$')
echo "$done of $expected captures are done, $faulty are at fault" >&2
[ "$interrupted" = 0 ] || exit 130
[ $((done + faulty)) = "$expected" ] || exit 1
[ "$faulty" = 0 ] || exit 2
