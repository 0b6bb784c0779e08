#!/usr/bin/env python3
"""How many lines of src/ the tests run; modules of tests, which are in there too, do not count. Most of what
studies do is not run by `cargo test` but by `experiment all --profile smoke`, whose results have bounds: that is not
counted here, since counting makes it twenty times as slow.

    python3 scripts/coverage.py              # prints a table, a row for each folder
    python3 scripts/coverage.py --missed     # and lists the lines that no test runs

Builds this crate, not its dependencies, with counters (rustc's `-C instrument-coverage`), runs `cargo test`
and reads the counters with llvm_profparser, which it installs below target/coverage. Takes a quarter
of an hour on two cores, most of it compiling. Python 3.9 or newer.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SCRATCH = ROOT / "target" / "coverage"
PROFILES = SCRATCH / "profiles"
READER = SCRATCH / "bin" / "cov"
READER_VERSION = "0.14.0"


def run(command, **more):
    done = subprocess.run(command, cwd=ROOT, text=True, **more)
    if done.returncode != 0:
        sys.stdout.write(done.stdout or "")
        sys.exit(f"failed: {' '.join(map(str, command[:4]))}")
    return done.stdout


def install_reader():
    if not READER.is_file():
        run([
            "cargo", "install", "llvm_profparser", "--version", READER_VERSION, "--locked", "--quiet",
            "--root", SCRATCH, "--target-dir", SCRATCH / "target",
        ])


def run_tests():
    """Runs all tests with counters; the programs that counted."""
    shutil.rmtree(PROFILES, ignore_errors=True)
    # Cargo hands only this crate to it: dependencies stay as they are, and are not counted.
    wrapper = SCRATCH / "rustc"
    wrapper.write_text('#!/bin/sh\nexec "$@" -C instrument-coverage\n')
    wrapper.chmod(0o755)
    counted = {
        "env": os.environ | {
            "RUSTC_WORKSPACE_WRAPPER": str(wrapper),
            # One file for each program, into which all its processes add what they count.
            "LLVM_PROFILE_FILE": str(PROFILES / "%m.profraw"),
        },
        "stdout": subprocess.PIPE,
    }
    messages = run(["cargo", "test", "--no-run", "--message-format=json", "--quiet"], **counted)
    artifacts = [json.loads(message) for message in messages.splitlines()]
    is_counted = lambda a: a.get("executable") and "example" not in a["target"]["kind"]
    programs = [artifact["executable"] for artifact in artifacts if is_counted(artifact)]
    run(["cargo", "test", "--quiet"], **counted)
    return programs


def hits_by_file(programs):
    """For each file of src/ how often its lines were run, by number; lines without code are missing."""
    command = [READER, "show"]
    for profile in sorted(PROFILES.iterdir()):
        command += ["--instr-profile", profile]
    for program in programs:
        command += ["--object", program]
    files, lines = {}, {}
    for line in run(command, stdout=subprocess.PIPE).splitlines():
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
    parser.add_argument("--missed", action="store_true", help="list the lines that no test runs")
    options = parser.parse_args()
    install_reader()
    files = hits_by_file(run_tests())
    folders = defaultdict(lambda: [0, 0])
    for path, hits in sorted(files.items()):
        hits = without_tests(path, hits)
        missed = [line for line, count in hits.items() if count == 0]
        folder = path.relative_to(ROOT).parent
        for name in {str(folder), "all"}:
            folders[name][0] += len(hits)
            folders[name][1] += len(hits) - len(missed)
        if options.missed and missed:
            print(f"{path.relative_to(ROOT)}: {' '.join(map(str, missed))}")
    print(f"{'folder':40} {'lines':>7} {'run':>7} {'%':>6}")
    for name, (lines, covered) in sorted(folders.items(), key=lambda item: (item[0] == "all", item[0])):
        print(f"{name:40} {lines:7} {covered:7} {100 * covered / max(lines, 1):6.1f}")


if __name__ == "__main__":
    main()
