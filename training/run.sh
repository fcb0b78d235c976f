#!/bin/sh
# Trains auto-encoder and photo network side by side, or goes on with them, on whatever machine this
# is: packs the materials, generates procedural ones meanwhile, trains until LIMIT seconds have
# passed, and leaves weights and logs in OUT. Call it again with the same WORK until it says that the
# training is complete.
#
#   MATERIALS  tar file of bundle.py or folder of materials; empty: procedural ones alone
#   LICENCES   permissive (CC0, CC-BY, this project's own) or all
#   WORK, OUT  folders of what is needed to go on, and of results
#   MINUTES    length of the photo network's training; LIMIT seconds of this call
#   COUNT, SEED  procedural materials and their seed
#   INIT "exported": the photo network goes on from ../models, "": afresh
#   BATCH, LR  of the photo network: examples a step and peak learning rate; OPTIONS further ones
#   ENCODER    share of MINUTES that the auto-encoder trains as well, 0: not at all
set -eu
cd "$(dirname "$0")"
begun=$(date +%s)
: "${MATERIALS=}" "${LICENCES:=permissive}" "${WORK:=../data/training}" "${OUT:=$WORK/out}" "${MINUTES:=11}" "${LIMIT:=570}"
: "${COUNT:=2400}" "${SEED:=10}" "${INIT=exported}" "${BATCH:=384}" "${LR:=8e-4}" "${OPTIONS:=--rounds 3 --deep}"
: "${ENCODER:=0}" "${PYTHON:=python3}"
jobs=$(nproc)
export OMP_NUM_THREADS=1
mkdir -p "$WORK" "$OUT"
# what is left of this call, less what comes after training
left() { echo $((LIMIT - $(date +%s) + begun - 25)); }

packs="$WORK/procedural-1 $WORK/procedural-2 $WORK/procedural-3"
(for part in 1 2 3; do
    if [ ! -e "$WORK/procedural-$part/meta.json" ]; then
        timeout "$(left)" $PYTHON procedural.py --out "$WORK/procedural-$part" --count $((COUNT / 3)) --seed "$SEED$part" --jobs "$jobs"
    fi
done) &
generator=$!
if [ -n "$MATERIALS" ]; then
    if [ ! -e "$WORK/real/meta.json" ]; then
        folder=$MATERIALS
        if [ -f "$MATERIALS" ]; then
            folder=$WORK/materials
            mkdir -p "$folder"
            tar -xf "$MATERIALS" -C "$folder"
        fi
        $PYTHON data.py --materials "$folder" --licences "$LICENCES" --out "$WORK/real" --jobs "$jobs"
    fi
    packs="$WORK/real $packs"
else
    wait "$generator"
fi
if [ "$INIT" = exported ]; then
    if [ ! -e "$WORK/exported.pt" ]; then
        $PYTHON import_weights.py --models ../models --out "$WORK/exported.pt"
    fi
    OPTIONS="$OPTIONS --init $WORK/exported.pt"
fi

# SIGTERM makes them save; the rest of the limit is for that and for what follows
train() {
    network=$1
    shift
    # shellcheck disable=SC2086 # a list of words
    timeout -k 20 "$(left)" $PYTHON "train_$network.py" --packs $packs --real-share 0.5 --log-every 100 \
        --work "$WORK" "$@"
}
networks=photo photo=0 autoencoder=0 encoder=
if [ "$ENCODER" != 0 ]; then
    networks="photo autoencoder"
    train autoencoder --minutes "$(awk "BEGIN {print $ENCODER * $MINUTES}")" --batch 96 --lr 1e-3 --fine-from 0.8 &
    encoder=$!
fi
# shellcheck disable=SC2086
train photo --minutes "$MINUTES" --batch "$BATCH" --lr "$LR" --fine-from 0.7 $OPTIONS || photo=$?
if [ -n "$encoder" ]; then wait "$encoder" || autoencoder=$?; fi
for network in $networks; do
    cp "$WORK/$network-weights.pt" "$OUT"
    # none before its first lines
    if [ -e "$WORK/$network.jsonl" ]; then
        cp "$WORK/$network.jsonl" "$OUT"
        tail -n 1 "$WORK/$network.jsonl"
    fi
done
case $photo-$autoencoder in
0-0) echo "training complete: evaluate and export $OUT/*-weights.pt" ;;
124-* | *-124) echo "not complete: call again" ;;
*) exit 1 ;;
esac
