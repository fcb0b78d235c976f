#!/usr/bin/env python3
"""Fits many captures with Dask, on this computer or on a cluster.

    python many.py captures maps                            one process for each core
    python many.py captures maps --scheduler tcp://HOST:8786
    python many.py s3://bucket/captures s3://bucket/maps    with the package s3fs

Every folder in CAPTURES is a capture, or holds the photographs of one. Its maps go to OUT/NAME with `record.json`: a
folder is there only once it is complete. `OUT/table.parquet` has one row for each capture. Started again after
anything, it does what is left.

Needs the packages svbrdf, dask, distributed and pyarrow.

Exit status: 0 all captures have maps; 2 all but those whose input is at fault; 1 others failed; 130 interrupted."""
from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import fsspec

Row = dict[str, Any]
RECORD = "record.json"


class Place:
    """A folder on a disk that all workers see, or in an object store."""

    def __init__(self, url: str) -> None:
        self.is_store = "://" in url
        self.files, self.root = fsspec.core.url_to_fs(url if self.is_store else os.path.abspath(url))

    def path(self, *names: str) -> str:
        return "/".join([self.root.rstrip("/"), *names])

    def folders(self) -> list[str]:
        found = self.files.ls(self.root, detail=True)
        return sorted(Path(e["name"]).name for e in found if e["type"] == "directory")

    def read(self, *names: str) -> bytes | None:
        try:
            return bytes(self.files.cat_file(self.path(*names)))
        except FileNotFoundError:
            return None

    def fetch(self, name: str, below: Path) -> Path:
        """A folder of this place as one on a disk."""
        if not self.is_store:
            return Path(self.path(name))
        self.files.get(self.path(name) + "/", str(below / name) + "/", recursive=True)
        return below / name

    def make(self, *names: str) -> None:
        self.files.makedirs(self.path(*names), exist_ok=True)

    def publish(self, folder: Path, name: str) -> None:
        """Puts a complete folder here. Readers see all of it, or no record."""
        if self.is_store:
            self.make(name)
            rest = [path for path in folder.iterdir() if path.name != RECORD]
            for path in [*rest, folder / RECORD]:
                self.files.put_file(str(path), self.path(name, path.name))
            return
        target = Path(self.path(name))
        if target.exists():
            os.replace(target, folder.with_name(name + ".old"))
        os.replace(folder, target)

    def scratch(self) -> str | None:
        """Where folders begin that are published here: a rename does not cross disks."""
        return None if self.is_store else self.root


def record(out: Place, name: str, settings: Row) -> Row | None:
    """The row of a capture that has been fitted with these settings."""
    found = json.loads(out.read(name, RECORD) or b"{}")
    return found["row"] if found.get("settings") == settings else None


def fit(captures: str, out: str, name: str, settings: Row) -> Row:
    """Fits one capture, on a worker. What is raised is worth another try."""
    import numpy as np
    import svbrdf

    source, target = Place(captures), Place(out)
    done = record(target, name, settings)
    if done is not None:
        return done
    begun = time.monotonic()
    with tempfile.TemporaryDirectory(prefix=".fit-", dir=target.scratch()) as work:
        below = Path(work)
        capture = source.fetch(name, below / "in")
        try:
            # One thread: several fits with one thread each use a computer better than one fit with several.
            maps = svbrdf.fit(capture, threads=1, **settings)
        except (svbrdf.RejectedError, svbrdf.FieldError, svbrdf.FileError) as fault:
            # Not of the capture: a disk that cannot be read at the moment.
            os.listdir(capture)
            return {"capture": name, "status": "faulty", "message": str(fault)}
        rms = [p.reprojection_rms_px for p in maps.photos if p.reprojection_rms_px is not None]
        row: Row = {
            "capture": name,
            "status": "done",
            "message": "; ".join(f"{Path(str(p.source)).name}: {p.message}" for p in maps.photos if p.message),
            "photographs": len(maps.photos),
            "used": sum(p.accepted for p in maps.photos),
            "hints": [f"{i + 1}: {h.code}" for i, p in enumerate(maps.photos) for h in p.hints],
            "largest_reprojection_rms_px": max(rms, default=None),
            "seconds": time.monotonic() - begun,
            "process": os.getpid(),
        }
        for kind, deviations in (maps.deviations or {}).items():
            row[f"deviation_{kind}"] = float(np.sqrt(np.mean(np.square(deviations))))
        folder = below / "out" / name
        folder.mkdir(parents=True)
        maps.save(folder)
        (folder / RECORD).write_text(json.dumps({"settings": settings, "row": row}, indent=1))
        target.publish(folder, name)
    return row


def write_table(out: Place, rows: list[Row]) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    texts, counts = ["capture", "status", "message"], ["photographs", "used", "process"]
    numbers = ["largest_reprojection_rms_px", "seconds"]
    # Those of the optional lobes are empty where the material has none.
    kinds = ("normal", "diffuse", "specular", "roughness", "anisotropy", "coat", "sheen")
    numbers += [f"deviation_{kind}" for kind in kinds]
    schema = pa.schema(
        [(key, pa.string()) for key in texts]
        + [(key, pa.int64()) for key in counts]
        + [(key, pa.float64()) for key in numbers]
        + [("hints", pa.list_(pa.string()))]
    )
    table = pa.Table.from_pylist(sorted(rows, key=lambda row: row["capture"]), schema=schema)
    with tempfile.TemporaryDirectory(dir=out.scratch()) as work:
        parquet.write_table(table, f"{work}/table.parquet")
        if out.is_store:
            out.files.put_file(f"{work}/table.parquet", out.path("table.parquet"))
        else:
            os.replace(f"{work}/table.parquet", out.path("table.parquet"))


def outcome(name: str, future: Any) -> Row:
    """The row of a fit that has ended, however it did."""
    from distributed import CancelledError, KilledWorker

    try:
        return dict(future.result())
    except KilledWorker as killed:
        why = f"its process ended {killed.allowed_failures + 1} times: out of memory?"
    except (Exception, CancelledError) as fault:  # Of one capture: the others go on.
        why = f"{type(fault).__name__}: {fault}"
    return {"capture": name, "status": "failed", "message": why}


def run(client: Any, given: argparse.Namespace) -> list[Row]:
    """Fits what is left, and tells of each capture that has ended. Rows of all that are known in the end."""
    from distributed import as_completed

    captures, out = Place(given.captures), Place(given.out)
    settings = {"resolution": given.resolution, "steps": given.steps}
    names = captures.folders()
    known = {name: record(out, name, settings) for name in names}
    rows = [row for row in known.values() if row is not None]
    left = [name for name in names if known[name] is None]
    print(f"{len(names)} captures, {len(rows)} of them done before", flush=True)
    futures = {
        client.submit(
            fit, given.captures, given.out, name, settings, key=f"fit {name}", retries=given.retries, pure=False
        ): name
        for name in left
    }
    try:
        for future in as_completed(futures):
            row = outcome(futures[future], future)
            rows.append(row)
            told = f"{row['used']} of {row['photographs']} photographs, {row['seconds']:.1f} s" if "used" in row else row["message"]
            print(f"[{len(rows)}/{len(names)}] {row['capture']}: {row['status']}: {told}", flush=True)
    except KeyboardInterrupt:
        client.cancel(list(futures))
        given.interrupted = True
    write_table(out, rows)
    return rows


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("captures", help="folder of captures, or its address in an object store")
    parser.add_argument("out", help="folder for maps and table.parquet")
    parser.add_argument("--scheduler", help="address of a Dask scheduler; else workers are started here")
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes, where they are started here")
    parser.add_argument("--memory", default="1GB", help="limit of each of these processes; one that exceeds it is ended")
    parser.add_argument("--retries", type=int, default=2, help="further tries after errors such as unreadable disks")
    parser.add_argument("--resolution", type=int, default=256, choices=[256, 512, 1024, 2048])
    parser.add_argument("--steps", type=int, help="limits the optimisers' steps on each photograph")
    return parser.parse_args(namespace=argparse.Namespace(interrupted=False))


def main() -> int:
    import dask
    from distributed import Client, LocalCluster

    given = arguments()
    Place(given.out).make()
    # A fit cannot be moved to a disk: a worker goes on until it reaches its limit, and is then begun anew.
    memory = {f"distributed.worker.memory.{share}": False for share in ("target", "spill", "pause")}
    with dask.config.set({**memory, "distributed.worker.memory.terminate": 0.95}):
        if given.scheduler:
            with Client(given.scheduler) as client:
                rows = run(client, given)
        else:
            with (
                LocalCluster(
                    n_workers=given.workers, threads_per_worker=1, memory_limit=given.memory, dashboard_address=None
                ) as cluster,
                Client(cluster) as client,
            ):
                rows = run(client, given)
    count = {status: sum(row["status"] == status for row in rows) for status in ("done", "faulty", "failed")}
    print(f"{count['done']} done, {count['faulty']} at fault, {count['failed']} failed")
    if given.interrupted:
        return 130
    return 1 if count["failed"] else 2 if count["faulty"] else 0


if __name__ == "__main__":
    sys.exit(main())
