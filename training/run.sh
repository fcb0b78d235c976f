#!/bin/sh
# Trains the photo network, or goes on with it, on whatever machine this is: packs the materials,
# generates procedural ones, trains until LIMIT seconds have passed, and leaves weights and log in OUT.
# Call it again with the same WORK until it says that the training is complete.
#
#   MATERIALS  tar file of bundle.py or folder of materials; empty: procedural ones alone
#   LICENCES   all or permissive (CC0, CC-BY, this project's own)
#   WORK, OUT  folders of what is needed to go on, and of results
#   MINUTES    length of the whole training; LIMIT seconds of this call
#   COUNT      procedural materials; INIT "exported" goes on from ../models, "" starts afresh
#   BATCH, LR  examples a step and peak learning rate; OPTIONS further ones of train_photo.py
set -eu
cd "$(dirname "$0")"
begun=$(date +%s)
: "${MATERIALS=}" "${LICENCES:=all}" "${WORK:=../data/training}" "${OUT:=$WORK/out}" "${MINUTES:=24}" "${LIMIT:=570}"
: "${COUNT:=1600}" "${INIT=exported}" "${BATCH:=256}" "${LR:=1e-3}" "${OPTIONS:=--spread}" "${PYTHON:=python3}"
jobs=$(nproc)
export OMP_NUM_THREADS=1
mkdir -p "$WORK" "$OUT"

packs=""
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
    packs="$WORK/real"
fi
if [ ! -e "$WORK/procedural/meta.json" ]; then
    $PYTHON procedural.py --out "$WORK/procedural" --count "$COUNT" --seed 101 --jobs "$jobs"
fi
packs="$packs $WORK/procedural"
if [ "$INIT" = exported ]; then
    if [ ! -e "$WORK/exported.pt" ]; then
        $PYTHON import_weights.py --models ../models --out "$WORK/exported.pt"
    fi
    OPTIONS="$OPTIONS --init $WORK/exported.pt"
fi

# SIGTERM makes it save; the rest of the limit is for that and for what follows
left=$((LIMIT - $(date +%s) + begun - 25))
status=0
# shellcheck disable=SC2086 # lists of words
timeout -k 20 "$left" $PYTHON train_photo.py --packs $packs --work "$WORK" --minutes "$MINUTES" --batch "$BATCH" \
    --lr "$LR" --fine-from 0.7 $OPTIONS || status=$?
cp "$WORK/photo-weights.pt" "$WORK/photo.jsonl" "$OUT"
tail -n 1 "$WORK/photo.jsonl"
case $status in
0) echo "training complete: evaluate and export $OUT/photo-weights.pt" ;;
124) echo "not complete: call again" ;;
*) exit "$status" ;;
esac
