#!/usr/bin/env python3
"""Two builds of the command beside each other: what a change of the planner does to parts.

Run by hand: tests/compare_plans.py BEFORE AFTER FILE... [-- OPTIONS of `headway plan`]
BEFORE or AFTER may be `-`: the other one alone. Options go to both.

Goal: a stage that is taken away or added answers for print time, coverage and processor time on the same
parts. Method: each file is planned by both, one layer and six; a layer is (6 layers - 1) / 5, so that the way
from the machine's rest does not count; processor time is that of the plan of one layer, all threads. Figures
are those of `--json`. Prints one line a file, then the sums; shares are weighted by area.
"""
import json
import os
import resource
import subprocess
import sys
import tempfile

COLUMNS = ["layer s", "covered %", "twice %", "outside um", "passes", "CPU s"]


def planned(binary, file, layers, options, job):
    """Figures of a plan and the processor seconds that it took, or None where it is refused."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [binary, "plan", file, "-o", job, "--json", "--layers", str(layers), *options]
    done = subprocess.run(command, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if done.returncode != 0:
        print(f"{file}: {done.stderr.strip().splitlines()[-1:]}", file=sys.stderr)
        return None
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return json.loads(done.stdout), cpu_s


def row(binary, file, options, job):
    """Area, then the columns."""
    if binary == "-":
        return None
    one, six = (planned(binary, file, layers, options, job) for layers in (1, 6))
    if one is None or six is None:
        return None
    figures, cpu_s = one
    return [
        figures["area_mm2"],
        (six[0]["print_s"] - figures["print_s"]) / 5,
        figures["covered_of_reachable_pct"],
        figures["overlap_pct"],
        1e3 * figures["outside_depth_mm"],
        figures["passes"],
        cpu_s,
    ]


def cells(values):
    """A side of the table."""
    if values is None:
        return ["-"] * len(COLUMNS)
    _, layer_s, covered, twice, outside, passes, cpu_s = values
    return [f"{layer_s:.2f}", f"{covered:.2f}", f"{twice:.2f}", f"{outside:.2f}", f"{passes:.0f}", f"{cpu_s:.2f}"]


def summed(rows):
    """Sums of time, passes and processor time, means by area of shares, the most that is outside."""
    area = sum(r[0] for r in rows)
    mean = lambda k: sum(r[0] * r[k] for r in rows) / area
    total = lambda k: sum(r[k] for r in rows)
    return [area, total(1), mean(2), mean(3), max(r[4] for r in rows), total(5), total(6)]


def main(words):
    words, options = (words[: words.index("--")], words[words.index("--") + 1 :]) if "--" in words else (words, [])
    binaries, files = words[:2], words[2:]
    head = ["part"] + [f"{side} {name}" for side in ("before", "after") for name in COLUMNS] + ["time"]
    print("| " + " | ".join(head) + " |\n|" + " --- |" * len(head))
    both = []
    with tempfile.TemporaryDirectory() as folder:
        for file in files:
            sides = [row(binary, file, options, folder + "/job.hwj") for binary in binaries]
            ratio = f"{sides[1][1] / sides[0][1]:.3f}" if None not in sides else "-"
            name = os.path.splitext(os.path.basename(file))[0]
            print("| " + " | ".join([name, *cells(sides[0]), *cells(sides[1]), ratio]) + " |", flush=True)
            both.append(sides)
    if not both:
        return
    sums = [summed(rows) if rows else None for rows in ([s[k] for s in both if s[k]] for k in (0, 1))]
    ratio = f"{sums[1][1] / sums[0][1]:.3f}" if None not in sums else "-"
    print("| " + " | ".join([f"all {len(both)}", *cells(sums[0]), *cells(sums[1]), ratio]) + " |")
    if None not in sums:
        lowest = [min(s[k][2] for s in both if s[k]) for k in (0, 1)]
        slowest = max(s[1][1] / s[0][1] for s in both if None not in s)
        print(f"lowest covered {lowest[0]:.2f} and {lowest[1]:.2f} %; the slowest against before {slowest:.3f}")


if __name__ == "__main__":
    main(sys.argv[1:])
