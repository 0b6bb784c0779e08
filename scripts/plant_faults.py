#!/usr/bin/env python3
"""Plants mistakes in a copy of the repository, one at a time, and tells which test or bound notices.

    python3 scripts/plant_faults.py              # all of scripts/faults.toml
    python3 scripts/plant_faults.py eq12-sign    # only these; of the others the rows stay as they are

Each goes through what .ci/run does, until something fails: tests, and the studies in miniature with their
bounds. Writes results/faults.csv. The exit code is 0 when every fault was
caught. (That the copy without one passes is what .ci/run shows.) Takes two minutes a fault on two cores, most of it compiling, and
6 GB below target/faults, which further runs use again. Python 3.11 or newer.
"""

import csv
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCRATCH = ROOT / "target" / "faults"
COPY = SCRATCH / "copy"
TABLE = ROOT / "results" / "faults.csv"
COLUMNS = ["fault", "what", "file", "stage", "caught_by", "seconds"]
# What hangs for so long has been noticed.
PATIENCE_S = 1800


def stages(fault):
    """What is run one after the other: cheap things that most likely notice before all that .ci/run runs."""
    first = ["--test", fault["first"]] if "first" in fault else ["--lib"]
    program = ["cargo", "run", "--quiet", "--"]
    return [
        ("tests", ["cargo", "test", *first]),
        ("tests", ["cargo", "test"]),
        ("smoke run", [*program, "experiment", "all", "--profile", "smoke"]),
        ("bounds", [*program, "check", "--profile", "smoke"]),
    ]


def read_faults():
    """The faults, after making sure that each still is what it says."""
    faults = tomllib.loads((ROOT / "scripts/faults.toml").read_text())["fault"]
    for fault in faults:
        text = (ROOT / fault["file"]).read_text()
        for old, _ in fault["edits"]:
            if text.count(old) != 1:
                sys.exit(f"{fault['name']}: {fault['file']} has {text.count(old)} times\n{old}")
    return faults


def copy_repository():
    """Makes COPY like this repository, changes included. Files that are equal stay untouched: no need to
    compile them again."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    names = {name for name in listed.stdout.decode().split("\0") if (ROOT / name).is_file()}
    # These tests look for the text of the faults, and would notice each by that.
    names.remove("tests/faults.rs")
    # Results of another fault's code must not be taken for this one's.
    for made in ["data/cache", "results/smoke"]:
        shutil.rmtree(COPY / made, ignore_errors=True)
    for name in names:
        theirs, ours = COPY / name, ROOT / name
        if not theirs.is_file() or theirs.read_bytes() != ours.read_bytes():
            theirs.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ours, theirs)
            shutil.copymode(ours, theirs)
    for folder, _, files in os.walk(COPY):
        for path in (Path(folder) / file for file in files):
            if str(path.relative_to(COPY)) not in names:
                path.unlink()


def plant(fault):
    for old, new in fault["edits"]:
        path = COPY / fault["file"]
        path.write_text(path.read_text().replace(old, new))


def complaints(text):
    """The names of failed tests, or bounds that do not hold, or else the message of an error."""
    names, target = [], ""
    for line in text.splitlines():
        if match := re.search(r"Running (?:unittests )?(\S+)|(Doc-tests)", line):
            target = Path(match[1] or match[2]).stem
        elif match := re.fullmatch(r"test (.+) \.\.\. FAILED", line):
            names.append(match[1] if target == "lib" else f"{target}: {match[1]}")
        elif match := re.match(r"(\S+ .+) \S+ OUTSIDE ", line):
            names.append(match[1])
    errors = [line for line in text.splitlines() if line.startswith("error")]
    return names or errors[:1] or ["no message"]


def run(fault):
    """Stage and names of what caught the fault, both empty when nothing did."""
    environment = os.environ | {
        "CARGO_TARGET_DIR": str(SCRATCH / "target"),
        # What passes or fails must not depend on data from elsewhere.
        "ARMPOSE_SHARED": str(SCRATCH / "nothing"),
        "CARGO_TERM_COLOR": "never",
        # Building is most of the time; what comes out is the same however it was optimised.
        "CARGO_PROFILE_DEV_OPT_LEVEL": "1",
        "CARGO_PROFILE_DEV_DEBUG": "0",
    }
    for stage, command in stages(fault):
        try:
            done = subprocess.run(
                command, cwd=COPY, env=environment, timeout=PATIENCE_S, text=True,
                stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
            )
        except subprocess.TimeoutExpired:
            return stage, ["hangs"]
        (SCRATCH / f"{fault['name']}.log").write_text(done.stdout)
        if "could not compile" in done.stdout:
            sys.exit(f"{fault['name']} does not compile:\n{done.stdout}")
        if done.returncode != 0:
            return stage, complaints(done.stdout)
    return "", []


def main():
    faults = read_faults()
    wanted = sys.argv[1:] or [fault["name"] for fault in faults]
    if unknown := set(wanted) - {fault["name"] for fault in faults}:
        sys.exit(f"no fault is called {', '.join(sorted(unknown))}; see scripts/faults.toml")
    rows = {}
    if TABLE.is_file():
        with TABLE.open(newline="") as file:
            rows = {row["fault"]: row for row in csv.DictReader(file)}
    for fault in faults:
        if fault["name"] not in wanted:
            continue
        start = time.monotonic()
        copy_repository()
        plant(fault)
        stage, names = run(fault)
        rows[fault["name"]] = {
            "fault": fault["name"],
            "what": fault["what"],
            "file": fault["file"],
            "stage": stage,
            "caught_by": "; ".join(names),
            "seconds": round(time.monotonic() - start),
        }
        print(f"{fault['name']}: {stage or 'NOT CAUGHT'}: {'; '.join(names)[:200]}", flush=True)
        with TABLE.open("w", newline="") as file:
            table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            table.writeheader()
            table.writerows(rows[f["name"]] for f in faults if f["name"] in rows)
    escaped = [name for name, row in rows.items() if row["stage"] == ""]
    sys.exit(f"not caught: {', '.join(escaped)}" if escaped else 0)


if __name__ == "__main__":
    main()
