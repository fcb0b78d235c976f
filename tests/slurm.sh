#!/usr/bin/env bash
# The job array of docs/many-captures.md on Slurm: a cluster of two nodes on this machine, with its own munge, below a
# temporary folder. One task is cancelled half-way, one node crashes half-way, one is lost by the controller while its
# task goes on. In the end every capture has complete maps, and no capture was fitted again after it was complete.
#
#   tests/slurm.sh [SVBRDF]      SVBRDF: the command; else target/release/svbrdf
#
# Installs Debian's slurm-wlm and munge when missing. By hand: three minutes on two cores.
set -euo pipefail
cd "$(dirname "$0")/.."
. tests/tools.sh
has "many captures on Slurm" slurmctld slurm-wlm || exit 0
has "many captures on Slurm" munged munge || exit 0
svbrdf=$(realpath "${1:-${CARGO_TARGET_DIR:-target}/release/svbrdf}")
script=$PWD/cli/batch/fit-all.sh
truth=$PWD/examples/captures/tile/truth
count=12

work=$(mktemp -d /tmp/svbrdf-slurm.XXXXXX)
chmod 755 "$work"
daemons=()
declare -A slurmd
finish() {
  local status=$?
  [ $status = 0 ] || tail -n 5 "$work"/*.log "$work"/out/*.log 2>/dev/null || true
  scancel --full --signal=KILL --user="$(id -un)" 2>/dev/null || true
  for pid in "${daemons[@]}"; do kill -KILL "$pid" 2>/dev/null || true; done
  # Processes that Slurm runs beside its daemons, of this cluster only.
  for name in a b; do steps "$name" | xargs -r kill -KILL 2>/dev/null || true; done
  rm -rf "$work"
  exit $status
}
trap finish EXIT
fail() { echo "FAILED: $*" >&2; exit 1; }
# Processes of the tasks of a node; before them the daemon's helpers, which would report the end of a task.
steps() {
  local pids
  pids=$( (grep -lzx "SLURMD_NODENAME=$1" /proc/[0-9]*/environ 2>/dev/null || true) | cut -d / -f 3 | while read -r pid; do
    if grep -qzx "SLURM_CONF=$work/slurm.conf" "/proc/$pid/environ" 2>/dev/null; then echo "$pid"; fi
  done)
  for pid in $pids; do ps -o ppid= -p "$pid" || true; done | sort -un | while read -r pid; do
    case $(ps -o comm= -p "$pid") in slurmstepd*) echo "$pid" ;; esac
  done
  echo "$pids"
}

# A cluster.
host=$(hostname -s)
port=$((20000 + $$ % 20000))
head -c 1024 /dev/urandom > "$work/munge.key"
chmod 600 "$work/munge.key"
munged --foreground --force --key-file="$work/munge.key" --socket="$work/munge.socket" --pid-file="$work/munge.pid" \
  --seed-file="$work/munge.seed" --log-file="$work/munge.log" --num-threads=2 > "$work/munged.log" 2>&1 &
daemons+=($!)
disown
mkdir "$work/state" "$work/spool-a" "$work/spool-b" "$work/out"
export SLURM_CONF=$work/slurm.conf
cat > "$SLURM_CONF" <<END
ClusterName=svbrdf
SlurmctldHost=$host(127.0.0.1)
SlurmUser=$(id -un)
SlurmdUser=$(id -un)
SlurmctldPort=$port
AuthType=auth/munge
AuthInfo=socket=$work/munge.socket
StateSaveLocation=$work/state
SlurmdSpoolDir=$work/spool-%n
SlurmctldPidFile=$work/slurmctld.pid
SlurmdPidFile=$work/slurmd-%n.pid
SlurmctldLogFile=$work/slurmctld.log
SlurmdLogFile=$work/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SlurmdTimeout=10
KillWait=5
ReturnToService=2
MpiDefault=none
SchedulerParameters=sched_interval=2,batch_sched_delay=1
NodeName=a NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 1)) CPUs=1 RealMemory=1000
NodeName=b NodeHostname=$host NodeAddr=127.0.0.1 Port=$((port + 2)) CPUs=1 RealMemory=1000
PartitionName=all Nodes=ALL Default=YES MaxTime=30 State=UP
END
node() {
  slurmd -D -N "$1" > "$work/slurmd-$1.out" 2>&1 &
  slurmd[$1]=$!
  daemons+=($!)
  disown
}
# A busy machine takes its time.
until_true() {
  local seconds=600 i
  for ((i = 0; i < 5 * seconds; i++)); do
    if "$@"; then return 0; fi
    sleep 0.2
  done
  squeue --array >&2 || true
  sinfo >&2 || true
  fail "not within $seconds s: $*"
}
until_true test -S "$work/munge.socket"
slurmctld -D -c > "$work/slurmctld.out" 2>&1 &
daemons+=($!)
disown
node a
node b
idle() { [ "$(sinfo -h -t idle -o %D 2>/dev/null)" = 2 ]; }
until_true idle
echo "$(slurmctld -V): two nodes are idle"

# Captures whose fits take some seconds.
for ((i = 0; i < count; i++)); do
  "$svbrdf" simulate "$truth" --out "$work/captures/$(printf %02d $i)" --frames 3 --seed $i --rectified > /dev/null 2>&1
done
# The command, which notes whether it fitted. Complete maps are noted with the time they are of.
cat > "$work/svbrdf" <<END
#!/bin/sh
"$svbrdf" "\$@"
status=\$?
echo "\$(basename "\$2") \$SLURMD_NODENAME \$status \$(stat -c %y "\$4/report.json" 2>/dev/null | tr ' ' T)" >> "$work/ledger"
exit \$status
END
chmod 755 "$work/svbrdf"
export SVBRDF=$work/svbrdf
: > "$work/ledger"
complete() { cat "$work"/maps/*/report.json 2>/dev/null | grep -c '"interrupted": *false'; }
at_least() { [ "$(complete)" -ge "$1" ]; }
submit() {
  sbatch --parsable --array=0-3 --cpus-per-task=1 --output="$work/out/%A_%a.log" "$script" "$work/captures" "$work/maps" --no-report
}
running() { squeue -h --array -t RUNNING -o '%i %N' -j "$1"; }
task_on() { running "$1" | awk -v node="$2" '$2 == node && !found++ { print $1 }'; }
busy() { [ -n "$(task_on "$job" "$1")" ]; }
state() { scontrol show job "$1" | sed -n 's/.*JobState=\([A-Z_]*\).*/\1/p' | sort -u | tr '\n' ' '; }
down() { sinfo -h -n "$1" -o %T | grep -q down; }
# Slurm lets a task that it queues again wait for two minutes.
no_jobs() {
  squeue -h --array -t PENDING -o '%i %r' | awk '$2 == "BeginTime" { print $1 }' | while read -r task; do
    scontrol update JobId="$task" StartTime=now || true
  done
  [ -z "$(squeue -h)" ]
}

job=$(submit)
until_true at_least 2
cancelled=$(task_on "$job" a)
scancel "$cancelled"
echo "task $cancelled is cancelled with $(complete) of $count captures done"
gone() { [ "$(task_on "$job" a)" != "$cancelled" ]; }
until_true gone

# A crash of a node: its daemon and all that runs there.
until_true busy b
crashed=$(task_on "$job" b)
kill -KILL "${slurmd[b]}"
steps b | xargs -r kill -KILL
echo "node b has crashed with $crashed, $(complete) of $count captures done"
until_true down b
node b
until_true no_jobs
echo "first submission: $(complete) of $count captures done; $(state "$job")"
at_least $((count - 3)) || fail "more than the cancelled task's captures are missing"
at_least $count && fail "the cancelled task had nothing left to do: it was cancelled too late"

# The same command again, and a controller that loses a node whose task goes on.
job=$(submit)
until_true busy a
lost=$(task_on "$job" a)
kill -KILL "${slurmd[a]}"
until_true down a
node a
until_true no_jobs
echo "second submission, with node a lost under $lost: $(complete) of $count captures done; $(state "$job")"
at_least $count || fail "captures are missing"

# Every capture's complete maps are of one time, however often it was asked for.
twice=$(awk '$3 == 0 { print $1, $4 }' "$work/ledger" | sort -u | cut -d ' ' -f 1 | uniq -d)
sort "$work/ledger" | awk '{ print "  " $0 }'
[ -z "$twice" ] || fail "fitted twice: $twice"
asked=$(wc -l < "$work/ledger")
job=$(submit)
until_true no_jobs
[ "$(state "$job")" = "COMPLETED " ] || fail "third submission: $(state "$job")"
twice=$(awk '$3 == 0 { print $1, $4 }' "$work/ledger" | sort -u | cut -d ' ' -f 1 | uniq -d)
[ -z "$twice" ] || fail "fitted twice: $twice"
echo "third submission: nothing to do"
"$svbrdf" compare "$work/maps/00" "$truth" > /dev/null
echo "slurm: all fine; $count captures, $asked fits asked for before the last submission, none lost, none done twice"
