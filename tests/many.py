"""examples/python/many.py on three workers of which one is killed; run by tests/many.sh with the wheel installed.

many.py SVBRDF FOLDER: the command, which makes the captures, and an empty folder."""
import logging
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time

import fsspec
from distributed import Client, LocalCluster
from pyarrow import parquet

ROOT = pathlib.Path(__file__).resolve().parents[1]
COUNT = 12
#: Not the best maps, but soon.
QUICK = ["--steps", 8]


def run(*arguments, status, on_line=lambda line: None):
    """Runs the example, whose lines are handed on as they come."""
    command = [sys.executable, str(ROOT / "examples/python/many.py"), *map(str, arguments)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    lines = []
    for line in process.stdout:
        lines.append(line.rstrip())
        print("  " + lines[-1])
        on_line(lines[-1])
    assert process.wait() == status, f"exit status {process.returncode} instead of {status}"
    return lines


def table(out):
    rows = parquet.read_table(out / "table.parquet").to_pylist()
    return {row["capture"]: row for row in rows}


def times(out):
    return {path.parent.name: path.stat().st_mtime_ns for path in out.glob("*/normal.png")}


def one_is_killed(captures, out):
    """Three workers; the first that works after two captures are done is killed."""
    killed = []
    with LocalCluster(n_workers=3, threads_per_worker=1, memory_limit="2GB", dashboard_address=None) as cluster:
        with Client(cluster) as client:

            def kill(line):
                if line.startswith("[2/") and not killed:
                    working = {address for address, tasks in client.processing().items() if tasks}
                    pids = client.run(os.getpid)
                    killed.append(next(pid for address, pid in pids.items() if address in working))
                    os.kill(killed[0], signal.SIGKILL)
                    print(f"  worker {killed[0]} is killed")

            begun = time.monotonic()
            run(captures, out, *QUICK, "--scheduler", cluster.scheduler_address, status=2, on_line=kill)
            print(f"{COUNT} captures, three workers of which one is killed: {time.monotonic() - begun:.1f} s")
    assert killed
    rows = table(out)
    assert len(rows) == COUNT + 1
    assert rows.pop("faulty")["status"] == "faulty"
    for name, row in rows.items():
        assert row["status"] == "done" and row["used"] == row["photographs"] == 3, row
        assert 0 < row["deviation_roughness"] < 1 and row["seconds"] > 0, row
        assert row["deviation_coat"] is None, "the example has no coat"
        assert (out / name / "maps.exr").is_file()
    # The worker that takes the place of the killed one is among them, or the others have done its captures.
    assert len({row["process"] for row in rows.values()} - set(killed)) >= 2
    assert not list(out.glob(".fit-*")) or remove_rests(out) == 1, "the killed fit left one unfinished folder"


def remove_rests(out):
    rests = list(out.glob(".fit-*"))
    for rest in rests:
        shutil.rmtree(rest)
    return len(rests)


def in_a_store(captures, expected):
    """The protocol of S3, answered by a server on this computer."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    os.environ.update(
        AWS_ENDPOINT_URL="http://{}:{}".format(*server.get_host_and_port()),
        AWS_ACCESS_KEY_ID="none", AWS_SECRET_ACCESS_KEY="none", AWS_DEFAULT_REGION="us-east-1",
    )
    files = fsspec.filesystem("s3")
    files.mkdir("scans")
    files.put(str(captures) + "/", "scans/captures/", recursive=True)
    for before in (0, 1):
        lines = run("s3://scans/captures", "s3://scans/maps", "--workers", 1, "--steps", 2, status=0)
        assert lines[0] == f"1 captures, {before} of them done before"
        files.invalidate_cache()
    assert files.cat_file("scans/maps/00/normal.png") == expected.read_bytes()
    assert files.exists("scans/maps/table.parquet")
    server.stop()


def main():
    # Shells start background jobs with Ctrl-C ignored, and the example would inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    svbrdf, work = sys.argv[1], pathlib.Path(sys.argv[2])
    captures, out = work / "captures", work / "maps"
    for i in range(COUNT):
        source = ["simulate", ROOT / "examples/captures/tile/truth", "--out", captures / f"{i:02}", "--seed", i]
        subprocess.run([svbrdf, *map(str, source), "--frames", "3", "--rectified"], check=True, capture_output=True)
    (captures / "faulty").mkdir()
    one_is_killed(captures, out)

    before = times(out)
    lines = run(captures, out, *QUICK, "--workers", 1, status=2)
    assert lines[0] == f"{COUNT + 1} captures, {COUNT} of them done before" and times(out) == before

    print("other settings: one capture, on a disk and in an object store")
    few = work / "few"
    few.mkdir()
    shutil.copytree(captures / "00", few / "00")
    run(few, out, "--workers", 1, "--steps", 2, status=0)
    assert times(out)["00"] > before["00"]
    in_a_store(few, out / "00" / "normal.png")

    print("too little memory")
    run(few, work / "poor", "--workers", 1, "--memory", "150MiB", status=1)
    row = table(work / "poor")["00"]
    assert row["status"] == "failed" and "memory" in row["message"], row
    assert not (work / "poor" / "00").exists()

    print("interrupted")
    interrupted = []

    def interrupt(line):
        if line.startswith("[2/"):
            interrupted.append(line)
            # To the example alone: a terminal would signal its workers as well.
            children = subprocess.run(["pgrep", "-P", str(os.getpid()), "-f", "many.py"], capture_output=True, text=True, check=True)
            for pid in children.stdout.split():
                os.kill(int(pid), signal.SIGINT)

    run(captures, work / "interrupted", *QUICK, "--workers", 2, status=130, on_line=interrupt)
    done = [row for row in table(work / "interrupted").values() if row["status"] == "done"]
    assert interrupted and 1 <= len(done) < COUNT
    print("many: all fine")


if __name__ == "__main__":
    main()
