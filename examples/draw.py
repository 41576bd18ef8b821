#!/usr/bin/env python3
"""Draws the example parts beside this file. Own drawing, mm, exterior counter-clockwise.

Run it after a change and commit what it writes; the planner never needs it.
"""
import json
import math
import pathlib
import struct

HERE = pathlib.Path(__file__).parent


def arc(cx, cy, radius, start_deg, end_deg, sagitta_mm=0.002):
    """Points on an arc, both ends included; chords stray by no more than sagitta_mm."""
    sweep = math.radians(end_deg - start_deg)
    step = 2 * math.acos(1 - sagitta_mm / radius)
    count = max(2, math.ceil(abs(sweep) / step))
    return [
        (cx + radius * math.cos(math.radians(start_deg) + sweep * k / count),
         cy + radius * math.sin(math.radians(start_deg) + sweep * k / count))
        for k in range(count + 1)
    ]


def circle(cx, cy, radius):
    """A hole: clockwise, first point not repeated."""
    return arc(cx, cy, radius, 360, 0)[:-1]


def tidy(ring):
    points = [[round(x, 4), round(y, 4)] for x, y in ring]
    return [p for k, p in enumerate(points) if p != points[k - 1]]


def write(name, about, exterior, holes=()):
    part = {
        "name": name,
        "about": about,
        "units": "mm",
        "exterior": tidy(exterior),
        "holes": [tidy(hole) for hole in holes],
    }
    (HERE / f"{name}.json").write_text(json.dumps(part, separators=(",", ":")) + "\n")


def u_part():
    """A wide arm of 6 mm, a narrow one of 0.7 mm (one bead), a bottom of 3 mm."""
    return (arc(3, 3, 3, 180, 270) + arc(17, 3, 3, 270, 360)
            + [(20, 24), (19.3, 24)]
            + arc(17.3, 5, 2, 360, 270) + arc(8, 5, 2, 270, 180)
            + [(6, 24), (0, 24)])


def bracket():
    """An L of 30 x 20 mm, 7 mm wide, round outer corners, four holes, an inner fillet."""
    outline = (arc(2, 2, 2, 180, 270) + arc(28, 2, 2, 270, 360)
               + arc(28, 5, 2, 0, 90)
               + arc(9.5, 9.5, 2.5, 270, 180)
               + arc(5, 18, 2, 0, 90) + arc(2, 18, 2, 90, 180))
    holes = [circle(3.5, 3.5, 1.6), circle(14, 3.5, 1.1),
             circle(25.5, 3.5, 1.6), circle(3.5, 16, 1.6)]
    return outline, holes


def gear(teeth=12, root=8.0, tip=10.0, bore=3.0):
    """Trapezoid teeth with straight flanks, a bore with a keyway, three lightening holes."""
    outline = []
    pitch = 360.0 / teeth
    for k in range(teeth):
        at = k * pitch
        outline += arc(0, 0, root, at - 0.5 * pitch, at - 0.28 * pitch)
        outline += arc(0, 0, tip, at - 0.16 * pitch, at + 0.16 * pitch)
        outline += arc(0, 0, root, at + 0.28 * pitch, at + 0.5 * pitch)[:-1]
    half = 0.8
    angle = math.degrees(math.asin(half / bore))
    key = (arc(0, 0, bore, 90 - angle, 90 + angle - 360)
           + [(-half, bore + 0.9), (half, bore + 0.9)])
    holes = [key]
    for k in range(3):
        a = math.radians(30 + 120 * k)
        holes.append(circle(5.6 * math.cos(a), 5.6 * math.sin(a), 1.0))
    return outline, holes


def taper():
    """A passage whose width falls from 3.2 to 0.5 mm over 30 mm: from three beads to one."""
    return [(0, -1.6), (5, -1.6), (35, -0.25), (40, -0.25),
            (40, 0.25), (35, 0.25), (5, 1.6), (0, 1.6)]


def thin_web():
    """Two blocks of 10 x 12 mm joined by a web of 0.7 mm, 10 mm long."""
    return [(0, 0), (10, 0), (10, 5.65), (20, 5.65), (20, 0), (30, 0),
            (30, 12), (20, 12), (20, 6.35), (10, 6.35), (10, 12), (0, 12)]


def letter_r():
    """A capital R, 15 x 20 mm: strokes of about 3 mm, one counter, a leg with a sharp foot."""
    outline = ([(0, 0), (3, 0), (3, 8), (6.4, 8), (11, 0), (14.6, 0), (9.6, 8.6)]
               + arc(8.4, 14, 6, -60, 90)
               + [(0, 20)])
    counter = [(3, 10.8), (3, 17.2)] + arc(8.4, 14, 3.2, 90, -90)
    return outline, [counter]


def dome(radius=40.0, base=16.0, half=20, step=2):
    """The top of a ball as a sheet of triangles: what a nozzle that tilts prints on."""
    def corner(x, y):
        return x, y, math.sqrt(radius ** 2 - x * x - y * y) - base
    triangles = []
    for x in range(-half, half, step):
        for y in range(-half, half, step):
            a, b, c, d = (corner(x, y), corner(x + step, y),
                          corner(x + step, y + step), corner(x, y + step))
            triangles += [(a, b, c), (a, c, d)]
    return triangles


def cap():
    """A cap of a sphere of 30 mm on a round block of 12 mm, 2 mm high: a top that layers can follow."""
    radii = [9 * k / 10 for k in range(11)] + [10.0, 11.0, 12.0]
    rings, around = len(radii) - 1, 72
    foot = math.sqrt(30**2 - 9**2)

    def place(ring, k):
        turn = 2 * math.pi * (k % around) / around
        radius = radii[ring]
        height = 2 + (math.sqrt(30**2 - radius**2) - foot if radius < 9 else 0)
        return (radius * math.cos(turn), radius * math.sin(turn), height)

    def below(k):
        return place(rings, k)[:2] + (0.0,)

    triangles = []
    for k in range(around):
        triangles.append((place(0, 0), place(1, k), place(1, k + 1)))
        for ring in range(1, rings):
            a, b = place(ring, k), place(ring + 1, k)
            c, d = place(ring + 1, k + 1), place(ring, k + 1)
            triangles += [(a, b, c), (a, c, d)]
        a, b, c, d = below(k), below(k + 1), place(rings, k + 1), place(rings, k)
        triangles += [(a, b, c), (a, c, d), ((0.0, 0.0, 0.0), b, a)]
    return triangles


def write_stl(name, triangles):
    facet = lambda corners: struct.pack("<12fH", 0, 0, 0, *sum(corners, ()), 0)
    (HERE / f"{name}.stl").write_bytes(
        bytes(80) + struct.pack("<I", len(triangles)) + b"".join(map(facet, triangles)))


def main():
    write("u-part", "a narrow and a wide arm", u_part())
    write("bracket", "an angle with four holes", *bracket())
    write("gear", "twelve teeth, a keyed bore, three holes", *gear())
    write("taper", "a passage that narrows from several beads to one", taper())
    write("letter", "a capital R", *letter_r())
    write("thin-web", "two blocks joined by a web of one bead", thin_web())
    write("dome-ring", "a ring for dome.stl", circle(0, 0, 16)[::-1], [circle(0, 0, 6)])
    write_stl("dome", dome())
    write_stl("cap", cap())
    (HERE / "washers.geojson").write_text(json.dumps({
        "type": "FeatureCollection", "units": "mm", "name": "washers",
        "features": [{
            "type": "Feature", "properties": {"name": f"washer {k}"},
            "geometry": {"type": "Polygon", "coordinates": [
                (lambda r: r + r[:1])(tidy(arc(x, 0, outer, 0, 360)[:-1])),
                (lambda r: r + r[:1])(tidy(circle(x, 0, inner)))]},
        } for k, (x, outer, inner) in enumerate([(0, 6, 3), (14, 5, 3.8), (25, 4, 1.5)])],
    }, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()
