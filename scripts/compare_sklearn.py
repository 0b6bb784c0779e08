"""Trains two trees on two threads, armpose and scikit-learn in turn, on the very same samples.

    pip install -r scripts/requirements.txt
    python scripts/compare_sklearn.py --features-per-node 22 > data/comparisons/sklearn_22.csv

480,000 samples of 500 features and 15 joint angles: the paper's first fold. Both draw a bootstrap
sample for each tree, split until leaves of 5, and look at the same number of features at a node. The
time begins with the features in memory, as 32-bit floats for scikit-learn and 16-bit integers for
armpose, whose binning counts as training. The error is that of all joints over 12,000 pixels of the 40
images left out, in degrees.
"""

import argparse
import csv
import pathlib
import statistics
import subprocess
import sys
import time

import numpy as np
from sklearn.ensemble import RandomForestRegressor

ROOT = pathlib.Path(__file__).resolve().parent.parent
FEATURES, JOINTS = 500, 15


def armpose(*arguments):
    command = ["cargo", "run", "--quiet", "--example", "compare_training", "--", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, check=True, stdout=subprocess.PIPE, text=True).stdout


def samples(folder, name):
    x = np.fromfile(folder / f"{name}.x", "<i2").reshape(FEATURES, -1)
    y = np.fromfile(folder / f"{name}.y", "<f8").reshape(-1, JOINTS)
    return np.ascontiguousarray(x.T, dtype=np.float32), y


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--features-per-node", type=int, default=22)
    parser.add_argument("--repetitions", type=int, default=5)
    parser.add_argument("--folder", type=pathlib.Path, default=ROOT / "target/compare", help="for the samples")
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    armpose("export", options.folder)
    x, y = samples(options.folder, "train")
    test_x, test_y = samples(options.folder, "test")

    table = csv.writer(sys.stdout, lineterminator="\n")
    header = ["repetition", "armpose_s", "sklearn_s", "ratio"]
    header += ["armpose_error_deg", "sklearn_error_deg", "armpose_leaves", "sklearn_leaves"]
    table.writerow(header)
    ratios = []
    for repetition in range(options.repetitions):
        answer = armpose("train", options.folder, options.features_per_node, repetition)
        ours, our_error, our_leaves = map(float, answer.split(","))
        forest = RandomForestRegressor(
            n_estimators=2,
            min_samples_leaf=5,
            max_features=options.features_per_node,
            n_jobs=2,
            random_state=repetition,
        )
        start = time.perf_counter()
        forest.fit(x, y)
        theirs = time.perf_counter() - start
        their_error = np.degrees(np.sqrt(np.mean((forest.predict(test_x) - test_y) ** 2)))
        ratios.append(theirs / ours)
        row = [f"{value:.4g}" for value in [ours, theirs, ratios[-1], our_error, their_error]]
        their_leaves = sum(tree.get_n_leaves() for tree in forest.estimators_)
        table.writerow([repetition, *row, int(our_leaves), their_leaves])
        sys.stdout.flush()
    print(f"ratio,{statistics.median(ratios):.4g}")


if __name__ == "__main__":
    main()
