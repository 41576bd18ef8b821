"""How long a turned nozzle takes for sliced parts: python3 follow_gcode.py HEADWAY FOLDER [PART...]

Slices the meshes PART.stl of FOLDER (those of tools/draw_meshes.py, and a cube of 20 mm) with `prusa-slicer` at
60 mm/s everywhere and the accelerations of Headway's built-in machine, plans each with the nozzle of 1.2 x 0.4 mm and with
a round one of 0.4 mm, and prints a row of a table for each part: the slicer's estimate, both times beside it, and how much
is laid at another width than the file's.
"""

import json
import re
import struct
import subprocess
import sys
from pathlib import Path

PARTS = ["cube", "text", "hook", "thin_walls", "overhang", "dome", "small_holes"]
WITH_SUPPORT = ["hook", "overhang", "dome"]
SPEEDS = [
    "perimeter", "external-perimeter", "small-perimeter", "infill", "solid-infill", "top-solid-infill", "gap-fill",
    "bridge", "support-material", "support-material-interface", "first-layer",
]
SETTINGS = {
    "center": "100,100", "layer-height": 0.2, "first-layer-height": 0.2, "nozzle-diameter": 0.4, "perimeters": 2,
    "fill-density": "20%", "skirts": 0, "gcode-flavor": "marlin2", "travel-speed": 150, "retract-speed": 33,
    "retract-length": 1, "machine-limits-usage": "time_estimate_only",
    "machine-max-acceleration-x": 3000, "machine-max-acceleration-y": 3000, "machine-max-acceleration-z": 200,
    "machine-max-acceleration-e": 3300, "machine-max-acceleration-extruding": 3000,
    "machine-max-acceleration-retracting": 3300, "machine-max-acceleration-travel": 3000,
    "machine-max-feedrate-x": 250, "machine-max-feedrate-y": 250, "machine-max-feedrate-z": 20,
    "machine-max-feedrate-e": 33, "machine-max-jerk-x": 8, "machine-max-jerk-y": 8, "machine-max-jerk-z": 0.4,
    "machine-max-jerk-e": 2.5,
}
OFF = re.compile(r"([\d.]+) mm of ([\d.]+) mm of beads are laid at corners.*, ([\d.]+) mm of them by more than a third")


def cube(path):
    """A binary STL of a cube of 20 mm."""
    corners = [[x, y, z] for z in (0, 20) for y in (0, 20) for x in (0, 20)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    triangles = [t for a, b, c, d in quads for t in ((a, b, c), (a, c, d))]
    facets = [struct.pack("<12fH", 0, 0, 0, *(v for k in t for v in corners[k]), 0) for t in triangles]
    path.write_bytes(bytes(80) + struct.pack("<I", len(facets)) + b"".join(facets))


def sliced(mesh):
    """The G-code of a mesh."""
    path = mesh.with_suffix(".gcode")
    settings = SETTINGS | {f"{name}-speed": 60 for name in SPEEDS}
    words = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    words += ["--support-material"] if mesh.stem in WITH_SUPPORT else []
    subprocess.run(["prusa-slicer", "-g", *words, "-o", path, mesh], check=True, capture_output=True)
    return path


def planned(headway, gcode, aperture):
    """Figures of a job, and what is said of its widths."""
    command = [headway, "plan", gcode, "--aperture", aperture, "--json", "-o", gcode.with_suffix(".hwj")]
    run = subprocess.run(command, check=True, capture_output=True, text=True)
    return json.loads(run.stdout), OFF.search(run.stderr)


def main():
    headway, folder = sys.argv[1], Path(sys.argv[2])
    print("| part | slicer s | turned s, ratio | round s, ratio | an eighth off % | a third off % |")
    print("| --- | --- | --- | --- | --- | --- |")
    for part in sys.argv[3:] or PARTS:
        mesh = folder / f"{part}.stl"
        if part == "cube" and not mesh.exists():
            cube(mesh)
        gcode = sliced(mesh)
        turned, off = planned(headway, gcode, "ellipse:1.2x0.4")
        plain, _ = planned(headway, gcode, "circle:0.4")
        estimate_s = turned["slicer_estimate_s"]
        times = [f"{f['print_s']:.0f}, {f['print_s'] / estimate_s:.2f}" for f in (turned, plain)]
        shares = [f"{100 * float(off[k]) / float(off[2]):.1f}" if off else "0" for k in (1, 3)]
        print(f"| {part} | {estimate_s:.0f} | {times[0]} | {times[1]} | {shares[0]} | {shares[1]} |", flush=True)


if __name__ == "__main__":
    main()
