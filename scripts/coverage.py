#!/usr/bin/env python3
"""How many lines of src/ are run by what .ci/run runs: the tests, and all studies in miniature. Modules of
tests, which are in src/ too, do not count.

    python3 scripts/coverage.py              # prints a table, a row for each folder
    python3 scripts/coverage.py --missed     # and lists the lines that nothing runs
    python3 scripts/coverage.py --least 85   # and fails when it is less than that, in percent

Builds this crate, not its dependencies, with counters (rustc's `-C instrument-coverage`) and reads them with
llvm_profparser, which it installs below target/coverage; where that fails the exit code is 2. Took us
twenty minutes on two cores, six when it was built before. Python 3.9 or newer.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCRATCH = ROOT / "target" / "coverage"
PROFILES = SCRATCH / "profiles"
COPY = SCRATCH / "copy"
READER = SCRATCH / "bin" / "cov"
READER_VERSION = "0.14.0"


def run(command, **more):
    done = subprocess.run(command, text=True, **{"cwd": ROOT, "stdout": subprocess.PIPE, **more})
    if done.returncode != 0:
        sys.stdout.write(done.stdout)
        raise SystemExit(f"failed: {' '.join(map(str, command))}")
    return done.stdout


def install_reader():
    if not READER.is_file():
        command = ["cargo", "install", "llvm_profparser", "--version", READER_VERSION, "--locked", "--quiet"]
        try:
            run([*command, "--root", SCRATCH, "--target-dir", SCRATCH / "target"])
        except SystemExit as failure:
            print(failure, file=sys.stderr)
            sys.exit(2)


def build():
    """Builds the tests and the program with counters: the paths of the tests, and that of the program."""
    SCRATCH.mkdir(parents=True, exist_ok=True)
    # Cargo hands only this crate to it: dependencies stay as they are, and are not counted.
    wrapper = SCRATCH / "rustc"
    wrapper.write_text('#!/bin/sh\nexec "$@" -C instrument-coverage\n')
    wrapper.chmod(0o755)
    environment = os.environ | {
        "RUSTC_WORKSPACE_WRAPPER": str(wrapper),
        # Scripts of the build count too.
        "LLVM_PROFILE_FILE": "/dev/null",
    }
    messages = run(["cargo", "test", "--no-run", "--message-format=json", "--quiet"], env=environment)
    artifacts = [artifact for artifact in map(json.loads, messages.splitlines()) if artifact.get("executable")]
    tests = [artifact["executable"] for artifact in artifacts if artifact["profile"]["test"]]
    [program] = [
        artifact["executable"] for artifact in artifacts
        if artifact["target"]["kind"] == ["bin"] and not artifact["profile"]["test"]
    ]
    return tests, program


def run_all(tests, program):
    """Runs tests and studies, as many at once as there are cores, each with one thread: threads that share
    counters wait for each other."""
    for folder in [PROFILES, COPY]:
        shutil.rmtree(folder, ignore_errors=True)
    # Elsewhere, where nothing has been run before.
    shutil.copytree(ROOT / "experiments", COPY / "experiments")
    shutil.copytree(ROOT / "data", COPY / "data", ignore=lambda _, names: {"cache"} & set(names))
    shutil.copy(ROOT / "Cargo.toml", COPY)
    environment = os.environ | {
        "RAYON_NUM_THREADS": "1",
        # One file for each program, into which all its processes add what they count.
        "LLVM_PROFILE_FILE": str(PROFILES / "%m.profraw"),
    }
    studies = sorted(path.stem for path in COPY.glob("experiments/*.toml"))
    jobs = [([program, "experiment", study, "--profile", "smoke", "--threads", "1"], COPY) for study in studies]
    jobs += [([test, "--quiet", "--test-threads", "1"], ROOT) for test in tests]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        execute = lambda job: run(job[0], cwd=job[1], env=environment, stderr=subprocess.STDOUT)
        list(pool.map(execute, jobs))


def hits_by_file(programs):
    """For each file of src/ how often its lines were run, by number; lines without code are missing."""
    command = [READER, "show"]
    for profile in sorted(PROFILES.iterdir()):
        command += ["--instr-profile", profile]
    for program in programs:
        command += ["--object", program]
    files, lines = {}, {}
    for line in run(command).splitlines():
        if match := re.match(r" *(\d+)\| *(\d*)\|", line):
            if match[2]:
                lines[int(match[1])] = int(match[2])
        elif line:
            path = ROOT / line
            # Lines of files elsewhere are read and forgotten.
            lines = files.setdefault(path, {}) if path.is_relative_to(ROOT / "src") else {}
    return files


def without_tests(path, hits):
    """The lines before the module of tests, which stands at the end."""
    if path.name == "tests.rs":
        return {}
    text = path.read_text().splitlines()
    end = text.index("#[cfg(test)]") + 1 if "#[cfg(test)]" in text else len(text) + 1
    return {line: count for line, count in hits.items() if line < end}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--missed", action="store_true", help="list the lines that nothing runs")
    parser.add_argument("--least", type=float, default=0, metavar="PERCENT", help="fail below that")
    options = parser.parse_args()
    install_reader()
    tests, program = build()
    run_all(tests, program)
    folders = defaultdict(lambda: [0, 0])
    for path, hits in sorted(hits_by_file([*tests, program]).items()):
        hits = without_tests(path, hits)
        missed = [line for line, count in hits.items() if count == 0]
        for name in {str(path.relative_to(ROOT).parent), "all"}:
            folders[name][0] += len(hits)
            folders[name][1] += len(hits) - len(missed)
        if options.missed and missed:
            print(f"{path.relative_to(ROOT)}: {' '.join(map(str, missed))}")
    percent = lambda lines, covered: 100 * covered / max(lines, 1)
    print(f"{'folder':40} {'lines':>7} {'run':>7} {'%':>6}")
    for name, counts in sorted(folders.items(), key=lambda item: (item[0] == "all", item[0])):
        print(f"{name:40} {counts[0]:7} {counts[1]:7} {percent(*counts):6.1f}")
    if percent(*folders["all"]) < options.least:
        sys.exit(f"less than {options.least:g} % of the lines are run; --missed lists the others")


if __name__ == "__main__":
    main()
