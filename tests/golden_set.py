#!/usr/bin/env python3
"""Frames and figures of the jobs of a fixed set of inputs: what a change of the planner changes.

    cargo build --release -p headway
    tests/golden_set.py run target/release/headway tests/golden/jobs.tsv     the whole set, about an hour of two cores
    tests/golden_set.py run HEADWAY OUT.tsv --only slices/ --only parts/cube  inputs whose names begin so
    tests/golden_set.py list                                                  the names
    tests/golden_set.py compare BEFORE.tsv AFTER.tsv                          exit 1 if the plans got worse
    tests/golden_set.py compare BEFORE.tsv AFTER.tsv --same                   exit 1 if a job has other frames

Goal: a change that is to leave plans alone leaves every frame; one that changes them answers for time, ground and processor
time. Method: each input is planned with `headway plan --json`, one after the other; the table has a hash of the input with its
options, a hash of the job's frames, and the command's own figures.
The header is left out: it has figures and settings in text, which change without the motion. Examples and drawn parts are the repository's; slices, waypoints and
some parts are read from ../shared/data. `--inputs FOLDER` adds what cannot lie there: FOLDER/gcode/*.gcode (the slicers' files
of docs/measurements/gcode.md), FOLDER/parts/*.stl, *.3mf, *.obj. What is missing is named and left out.

Twice, covered and outside are those of `--json`: covered is the reachable share, of parts with sparse infill that of solid
ground. J is seconds + 2 s/mm2 x (open + twice / 2), as in docs/measurements/optimiser.md. CPU is that of all threads.
"""

import argparse
import hashlib
import json
import os
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import golden_parts

ROOT = Path(__file__).resolve().parent.parent
DATA = ROOT / "../shared/data"
MACHINES = ROOT / "examples/machines"
COLUMNS = ["name", "input", "job", "seconds", "J", "covered", "twice", "outside_um", "passes", "cpu_s"]
PART = ["--layer-height", "0.2", "--walls", "2", "--infill-density", "20"]
# The machines of docs/measurements/six-axes.md.
WAYPOINT_MACHINES = ["trunnion", "arm-small", "gantry"]
PRICE_S_MM2 = 2.0
# What plans may lose: share of the sum and of one input in J, points of the lowest covered, depth in um, share of CPU (the
# same binary takes up to 3 % more or less from run to run).
SUM_MAX, ONE_MAX, COVERED_MAX, OUTSIDE_MAX_UM, CPU_MAX = 1.003, 1.03, 0.2, 1.0, 1.03


def machine(name):
    return ["-m", MACHINES / f"{name}.toml"]


def fast_gantry(folder):
    """The gantry with a z as fast as x, as the tests on surfaces have it."""
    text = (MACHINES / "gantry.toml").read_text()
    x, z = (text.partition(f"[joints.{axis}]\n")[2].partition("\n\n")[0] for axis in "xz")
    limits = lambda block: [line for line in block.splitlines() if "position" not in line]
    for of_z, of_x in zip(limits(z), limits(x)):
        z_then = z.replace(of_z, of_x)
        text, z = text.replace(z, z_then), z_then
    path = folder / "fast-gantry.toml"
    path.write_text(text)
    return ["-m", path]


def drawn(folder, name, triangles):
    path = folder / f"{name}.stl"
    if not path.exists():
        golden_parts.write_stl(path, triangles())
    return path


def examples():
    """The inputs of README.md and of examples/, with the options that README gives them."""
    own = ROOT / "examples"
    for path in sorted(own.iterdir()):
        if path.name == "dome-ring.json":
            yield path.name, [path, "--surface", own / "dome.stl", *machine("gantry")]
        elif path.name == "cap.stl":
            yield path.name, [path, "--curved-layers", "skin:3", *machine("gantry")]
        elif path.suffix == ".wpt":
            yield path.name, [path, *machine("gantry")]
        elif path.name != "dome.stl" and path.suffix in (".json", ".geojson", ".svg", ".stl"):
            yield path.name, [path]
    for shape in ("circle:0.4", "circle:0.8"):
        yield f"gear.json {shape}", [own / "gear.json", "--aperture", shape]


def surfaces(folder):
    for name in golden_parts.SURFACES:
        for outline in ("square", "L"):
            path = folder / f"{name}-{outline}.json"
            golden_parts.write_outline(path, *golden_parts.surface_outline(name, outline))
            mesh = drawn(folder, f"surface-{name}", lambda: golden_parts.surface(name))
            yield f"{name} {outline}", [path, "--surface", mesh, *fast_gantry(folder)]


def parts(folder, added):
    for name, draw in golden_parts.PARTS.items():
        yield name, [drawn(folder, name, draw), *PART]
    files = [ROOT / "examples/hook.stl"] + [DATA / name for name in ("field/bracket.stl", "peer/gear.stl", "peer/uwall.stl")]
    for path in files + added:
        yield path.name, [path, *PART]


def inputs(folder, added):
    """Name and words of `headway plan` of every input, files as paths. Nothing large is drawn before it is asked for."""
    found = lambda place, *ends: sorted(p for end in ends for p in (added / place).glob(f"*.{end}")) if added else []
    groups = {
        "examples": examples(),
        "slices": ((path.stem, [path]) for path in sorted((DATA / "slices").glob("*.json"))),
        "parts": parts(folder, found("parts", "stl", "3mf", "obj")),
        "waypoints": (
            (f"{path.stem} {name}", [path, *machine(name)])
            for name in WAYPOINT_MACHINES
            for path in sorted((DATA / "waypoints").glob("*.txt"))
            if path.name != "LICENSE"
        ),
        "gcode": (
            (path.name, [path])
            for path in sorted((DATA / "peer").glob("*.gcode")) + [DATA / "field/scarf.gcode"] + found("gcode", "gcode")
        ),
        "surfaces": surfaces(folder),
        "curved": (
            (name, [drawn(folder, f"curved-{name}", draw), "--curved-layers", layers, *machine("gantry")])
            for name, (draw, layers) in golden_parts.CURVED.items()
        ),
    }
    for group, rows in groups.items():
        for name, words in rows:
            yield f"{group}/{name}", words


def digest(data):
    return hashlib.sha256(data).hexdigest()


def frames(job):
    """Of a job file: magic, length of the header, header, CRC, frames, index, start of the index and 16 bytes more."""
    (header,) = struct.unpack_from("<I", job, 8)
    (index,) = struct.unpack_from("<Q", job, len(job) - 24)
    return job[12 + header + 4 : index]


def digest_of_input(words):
    """Of the options and the contents of the files, not of where they lie."""
    parts = [word.read_bytes() if isinstance(word, Path) else word.encode() for word in words]
    return digest(b"".join(hashlib.sha256(part).digest() for part in parts))[:16]


def objective_s(figures):
    area_mm2 = figures["area_mm2"] * figures.get("layers", 1)
    if "solid_covered_pct" in figures:
        open_mm2 = (area_mm2 - figures["sparse_mm2"]) * (100 - figures["solid_covered_pct"]) / 100
    else:
        open_mm2 = area_mm2 * (figures["reachable_pct"] - figures["covered_pct"]) / 100
    return figures["print_s"] + PRICE_S_MM2 * (open_mm2 + 0.5 * area_mm2 * figures["overlap_pct"] / 100)


def planned(binary, words, job):
    """The row of an input, but for its name; a refusal has the hash of its text in place of the job's."""
    job.unlink(missing_ok=True)
    # Names of files stand in refusals and jobs: where the checkout lies may not.
    words = [os.path.relpath(word, ROOT) if isinstance(word, Path) else word for word in [*words, "-o", job, "--json"]]
    with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as errors:
        child = subprocess.Popen([binary.resolve(), "plan", *words], stdout=out, stderr=errors, cwd=ROOT)
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        texts = []
        for file in (out, errors):
            file.seek(0)
            texts.append(file.read())
    cpu_s = f"{usage.ru_utime + usage.ru_stime:.2f}"
    if child.returncode != 0 or not job.exists():
        last = (texts[1].strip().splitlines() or [b""])[-1]
        # Drawn inputs lie in a folder that has another name in each run.
        last = last.replace(os.path.relpath(job.parent, ROOT).encode(), b"FOLDER")
        print(f"    refused, status {child.returncode}: {last.decode(errors='replace')}", file=sys.stderr)
        return [f"refused-{child.returncode}-{digest(last)[:16]}", *["-"] * 6, cpu_s]
    figures = json.loads(texts[0])
    given = lambda value, digits: "-" if value is None else f"{value:.{digits}f}"
    covered = figures.get("solid_covered_pct", figures.get("covered_of_reachable_pct"))
    depth_mm = figures.get("outside_depth_mm")
    return [
        digest(frames(job.read_bytes()))[:32],
        given(figures["print_s"], 4),
        given(objective_s(figures) if covered is not None else None, 4),
        given(covered, 4),
        given(figures.get("overlap_pct"), 4),
        given(None if depth_mm is None else 1e3 * depth_mm, 3),
        given(figures.get("passes"), 0),
        cpu_s,
    ]


def commit():
    """The checkout's commit, with a mark if files that the command is built from differ from it."""
    ask = lambda *words: subprocess.run(["git", *words], cwd=ROOT, capture_output=True, text=True).stdout.strip()
    changed = ask("status", "--porcelain", "--", "host", "firmware", "protocol", "Cargo.lock", "Cargo.toml")
    return ask("rev-parse", "HEAD") + (" with changes" if changed else "")


def run(options):
    options.binary.stat()
    only = tuple(options.only or [""])
    rows = []
    with tempfile.TemporaryDirectory(dir=ROOT / "target") as folder:
        folder = Path(folder)
        for name, words in inputs(folder, options.inputs):
            if not name.startswith(only):
                continue
            missing = [word for word in words if isinstance(word, Path) and not word.exists()]
            if missing:
                print(f"{name}: left out, {missing[0]} is missing", file=sys.stderr)
                continue
            print(name, file=sys.stderr, flush=True)
            rows.append([name, digest_of_input(words), *planned(options.binary, words, folder / "job.hwj")])
    head = f"# planner: {options.commit or commit()}\n# {len(rows)} inputs; hashes are SHA-256, shortened\n"
    options.out.parent.mkdir(parents=True, exist_ok=True)
    options.out.write_text(head + "\n".join("\t".join(row) for row in [COLUMNS, *rows]) + "\n")


def read(path):
    lines = [line.split("\t") for line in path.read_text().splitlines() if not line.startswith("#")]
    return {cells[0]: dict(zip(lines[0], cells)) for cells in lines[1:]}


def number(row, column):
    return float(row[column]) if row[column] != "-" else None


def summed(pairs):
    """Cells of a group: seconds, J, the worst J, covered, outside, CPU; and whether plans kept to what they may lose."""
    both = lambda column: [p for p in ((number(b, column), number(a, column)) for b, a in pairs) if None not in p]
    ratio = lambda found: sum(a for _, a in found) / max(sum(b for b, _ in found), 1e-12) if found else 1.0
    objective = [
        (b, a) for b, a in (
            [number(row, "J") or number(row, "seconds") for row in pair] for pair in pairs
        ) if None not in (b, a)
    ]
    worst = max((a / b for b, a in objective), default=1.0)
    covered, outside = both("covered"), both("outside_um")
    lowest = [min((p[side] for p in covered), default=100.0) for side in (0, 1)]
    deepest = [max((p[side] for p in outside), default=0.0) for side in (0, 1)]
    cpu = ratio(both("cpu_s"))
    kept = {
        f"sum of J at most {SUM_MAX}": ratio(objective) <= SUM_MAX,
        f"J of each at most {ONE_MAX}": worst <= ONE_MAX,
        f"lowest covered within {COVERED_MAX}": lowest[1] >= lowest[0] - COVERED_MAX,
        f"outside at most {OUTSIDE_MAX_UM} um, or as before": deepest[1] <= max(OUTSIDE_MAX_UM, deepest[0]),
        f"CPU at most {CPU_MAX}": cpu <= CPU_MAX,
    }
    cells = [
        f"{ratio(both('seconds')):.4f}", f"{ratio(objective):.4f}", f"{worst:.4f}",
        f"{lowest[0]:.2f}, {lowest[1]:.2f}", f"{deepest[0]:.2f}, {deepest[1]:.2f}", f"{cpu:.3f}",
    ]
    return cells, [rule for rule, holds in kept.items() if not holds]


def compare(options):
    before, after = read(options.before), read(options.after)
    shared = [name for name in before if name in after and before[name]["input"] == after[name]["input"]]
    for name in sorted(set(before) | set(after)):
        if name not in shared:
            what = "another input" if name in before and name in after else "in one table only"
            print(f"{name}: {what}, not compared")
    changed = [name for name in shared if before[name]["job"] != after[name]["job"]]
    # A plan that became a refusal, or the other way round.
    broken = [name for name in changed if "refused" in before[name]["job"] + after[name]["job"]]
    for name in changed:
        b, a = before[name], after[name]
        values = ", ".join(f"{column} {b[column]} to {a[column]}" for column in COLUMNS[3:9] if b[column] != a[column])
        print(f"{name}: other bytes; {values or 'the same figures'}" + (f"; {a['job']}" if name in broken else ""))
    print("\n| inputs | same bytes | seconds | J | worst J | lowest covered % | deepest outside um | CPU |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- |")
    groups = {name.split("/")[0]: None for name in shared}
    lost = []
    for group in [*groups, "all"]:
        names = [name for name in shared if group in (name.split("/")[0], "all")]
        cells, lost = summed([(before[name], after[name]) for name in names])
        same = sum(name not in changed for name in names)
        print(f"| {group} | {same} of {len(names)} | " + " | ".join(cells) + " |")
    if options.same:
        sys.exit(bool(changed) or not shared)
    for rule in lost:
        print(f"not kept: {rule}")
    sys.exit(bool(lost or broken) or not shared)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    modes = parser.add_subparsers(required=True)
    for name, act in (("run", run), ("list", None)):
        mode = modes.add_parser(name)
        mode.set_defaults(act=act)
        mode.add_argument("--inputs", type=Path, help="a folder with further gcode/ and parts/")
        if act:
            mode.add_argument("binary", type=Path)
            mode.add_argument("out", type=Path)
            mode.add_argument("--only", action="append", help="inputs whose names begin so")
            mode.add_argument("--commit", help="of which planner the binary is, if not of this checkout")
    mode = modes.add_parser("compare")
    mode.set_defaults(act=compare)
    mode.add_argument("before", type=Path)
    mode.add_argument("after", type=Path)
    mode.add_argument("--same", action="store_true", help="any other byte is a failure")
    options = parser.parse_args()
    if options.act:
        options.act(options)
        return
    with tempfile.TemporaryDirectory() as folder:
        for name, words in inputs(Path(folder), options.inputs):
            print(name, *(os.path.relpath(w, ROOT) if isinstance(w, Path) else w for w in words[1:]))


if __name__ == "__main__":
    main()
