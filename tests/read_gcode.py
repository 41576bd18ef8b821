#!/usr/bin/env python3
"""Files of slicers against a reading of their G-code that is not Headway's.

Run by hand: tests/read_gcode.py HEADWAY FILE...

Goal: what printers' files say is read as it is meant. Method: another reading of G0 to G3 (arcs in closed form), G20,
G21, G90 to G92, G28, M82 and M83, in both ways in which E may be meant at the start: the one that is nearer is taken, and
named. Its length of beads and its filament beside `headway inspect --json`; volume is Headway's, of the filament's
diameter that it reports or 1.75 mm. Layers are distinct heights of beads in the plane. One line a file; status 1
where a figure differs by more than 0.1 %.
"""
import json
import math
import re
import subprocess
import sys

WORD = re.compile(r"([A-Za-z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")
LINE = re.compile(r"(?:N\d+\s*)?([GM])0*(\d+(?:\.\d+)?)(.*)", re.I)
SHARE_MAX = 1e-3


def sweep_rad(start, end, clockwise):
    """Angle that an arc goes round, a full turn where it ends as it begins."""
    turn = (start - end if clockwise else end - start) % (2 * math.pi)
    return turn if turn > 1e-9 else 2 * math.pi


def way_mm(at, to, code, args, unit):
    """Length of a move."""
    if code in ("G0", "G1") or not ("I" in args or "J" in args):
        return math.dist(at, to)
    i, j = args.get("I", 0.0) * unit, args.get("J", 0.0) * unit
    start = math.atan2(-j, -i)
    end = math.atan2(to[1] - at[1] - j, to[0] - at[0] - i)
    return math.hypot(math.hypot(i, j) * sweep_rad(start, end, code == "G2"), to[2] - at[2])


def reading(lines, e_relative):
    """Length of the beads, their filament, the number of their heights."""
    at, offset, e, unit, relative = [0.0] * 3, [0.0] * 3, 0.0, 1.0, False
    length, filament, heights = 0.0, 0.0, set()
    for line in lines:
        found = LINE.match(re.sub(r"\([^)]*\)", "", line.split(";")[0]).strip())
        if not found:
            continue
        code = found[1].upper() + found[2]
        args = {letter.upper(): float(number) for letter, number in WORD.findall(found[3])}
        if code in ("G90", "G91"):
            relative = code == "G91"
        elif code in ("M82", "M83"):
            e_relative = code == "M83"
        elif code in ("G20", "G21"):
            unit = 25.4 if code == "G20" else 1.0
        elif code == "G92":
            for axis, letter in enumerate("XYZ"):
                if letter in args:
                    offset[axis] = at[axis] - args[letter] * unit
            e = args.get("E", e / unit) * unit
        elif code == "G28":
            named = [axis for axis, letter in enumerate("XYZ") if letter in found[3].upper()]
            for axis in named or range(3):
                at[axis] = offset[axis] = 0.0
        elif code in ("G0", "G1", "G2", "G3"):
            to = list(at)
            for axis, letter in enumerate("XYZ"):
                if letter in args:
                    to[axis] = args[letter] * unit + (at[axis] if relative else offset[axis])
            fed = 0.0
            if "E" in args:
                fed = args["E"] * unit - (0.0 if e_relative or relative else e)
                e += fed
            way = way_mm(at, to, code, args, unit)
            if fed > 1e-9 and way > 1e-4:
                length += way
                filament += fed
                if math.dist(at[:2], to[:2]) > 1e-4 or code in ("G2", "G3"):
                    heights.add(round(to[2], 3))
            at = to
    return length, filament, len(heights)


def inspected(headway, file):
    """Length, volume and layers as Headway has them, or what it says."""
    command = [headway, "inspect", file, "--from", "gcode", "--json"]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        return None, done.stderr.strip()
    return json.loads(done.stdout), ""


def main(headway, files):
    is_right = True
    for file in files:
        ours, refusal = inspected(headway, file)
        if ours is None:
            print(f"{file}: {refusal}")
            continue
        with open(file, "rb") as opened:
            lines = re.split(r"\r\n|\r|\n", opened.read().decode("latin-1"))
        print_mm, volume_mm3 = ours["length_mm"], ours["volume_mm3"]
        readings = {way: reading(lines, way == "relative") for way in ("absolute", "relative")}
        way = min(readings, key=lambda way: abs(readings[way][0] - print_mm))
        length, filament, heights = readings[way]
        # The diameter that makes one of the other; files say it.
        diameter = 2.0 * math.sqrt(volume_mm3 / math.pi / filament) if filament else 0.0
        beside = print_mm / length - 1.0 if length else 0.0
        is_right &= abs(beside) < SHARE_MAX
        print(
            f"{file}: {way}, {print_mm:.1f} mm ({1e2 * beside:+.4f} %), filament of {diameter:.4f} mm, "
            f"{ours['layers']} layers, {heights} heights"
        )
    return 0 if is_right else 1


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    sys.exit(main(sys.argv[1], sys.argv[2:]))
