"""Parts by formulas, for tests/golden_set.py: meshes as STL, outlines as polygon JSON, all in mm.

Surfaces, dome, wing and bracket are those of the tests (tests/tests/end_to_end/curved_ground/shapes.rs,
tests/src/curved_parts.rs); gear, lattice, vase and tower are like those of docs/measurements/parts.md. Only the standard
library is used, so that the same bytes come out everywhere.
"""

import json
import math
import struct

TAU = 2 * math.pi


def write_stl(path, triangles):
    facets = [struct.pack("<12fH", 0, 0, 0, *(c for corner in t for c in corner), 0) for t in triangles]
    path.write_bytes(bytes(80) + struct.pack("<I", len(facets)) + b"".join(facets))


def write_outline(path, exterior, holes=()):
    tidy = lambda ring: [[round(x, 6), round(y, 6)] for x, y in ring]
    outline = {"name": path.stem, "units": "mm", "exterior": tidy(exterior), "holes": [tidy(ring) for ring in holes]}
    path.write_text(json.dumps(outline))


def quad(a, b, c, d):
    return [(a, b, c), (a, c, d)]


def sheet(columns, rows, place):
    """A surface over a grid of so many cells, seen from above."""
    at = lambda i, j: place(i / columns, j / rows)
    cells = ((i, j) for j in range(rows) for i in range(columns))
    return [t for i, j in cells for t in quad(at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1))]


def solid(columns, rows, place):
    """What lies between a sheet and z = 0."""
    top = sheet(columns, rows, place)
    flat = lambda p: (p[0], p[1], 0.0)
    rim = [place(i / columns, 0) for i in range(columns)] + [place(1, j / rows) for j in range(rows)]
    rim += [place(1 - i / columns, 1) for i in range(columns)] + [place(0, 1 - j / rows) for j in range(rows)]
    sides = [t for k, p in enumerate(rim) for t in quad(flat(rim[k - 1]), flat(p), p, rim[k - 1])]
    return top + [tuple(map(flat, reversed(t))) for t in top] + sides


def tower_of(rings):
    """The closed mesh over rings of equally many corners, from the lowest up; flat ends are fans around (0, 0)."""
    count = len(rings[0])
    faces = []
    for low, high in zip(rings, rings[1:]):
        for k in range(count):
            n = (k + 1) % count
            faces += quad(low[k], low[n], high[n], high[k])
    for k in range(count):
        n = (k + 1) % count
        faces.append(((0, 0, rings[0][0][2]), rings[0][n], rings[0][k]))
        faces.append(((0, 0, rings[-1][0][2]), rings[-1][k], rings[-1][n]))
    return faces


def tube_of(outer, inner):
    """The same with a bore: rings of equally many corners outside and inside."""
    count = len(outer[0])
    faces = []
    for low, high, turn in ((outer[:-1], outer[1:], 1), (inner[:-1], inner[1:], -1)):
        for a, b in zip(low, high):
            for k in range(count):
                p, q = (k, (k + 1) % count)[::turn]
                faces += quad(a[p], a[q], b[q], b[p])
    for k in range(count):
        n = (k + 1) % count
        faces += quad(outer[-1][k], outer[-1][n], inner[-1][n], inner[-1][k])
        faces += quad(outer[0][n], outer[0][k], inner[0][k], inner[0][n])
    return faces


def ring(radius, corners, z):
    """A closed line at one height; the radius is a number or depends on the angle."""
    radius_at = radius if callable(radius) else lambda _: radius
    angles = (TAU * k / corners for k in range(corners))
    return [(radius_at(a) * math.cos(a), radius_at(a) * math.sin(a), z) for a in angles]


def box(low, high):
    base = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
    bottom, top = ([(x, y, z) for x, y in base] for z in (low[2], high[2]))
    sides = [t for k in range(4) for t in quad(bottom[k - 1], bottom[k], top[k], top[k - 1])]
    return quad(*top) + quad(*reversed(bottom)) + sides


def cube():
    return box((0, 0, 0), (20, 20, 20))


def tapered_tower():
    """A square of 20 mm at the foot and 16 at the top, 20 mm high."""
    square = lambda half, z: [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    return tower_of([square(10.0, 0.0), square(8.0, 20.0)])


def herringbone_gear():
    """24 rounded teeth, 25 degrees one way and back, 10 mm high, bore of 8 mm."""
    def outline(z):
        turn = math.tan(math.radians(25)) * (5 - abs(z - 5)) / 18
        radius = lambda a: 18 + 1.5 * max(-0.7, min(0.7, math.cos(24 * (a - turn))))
        return ring(radius, 408, z)
    heights = [0.25 * k for k in range(41)]
    return tube_of([outline(z) for z in heights], [ring(4.0, 408, z) for z in heights])


def lattice():
    """Struts of 1.6 mm along x, y and z in a cube of 30 mm, five each way."""
    at = [7.1 * k for k in range(5)]
    struts = []
    for u in at:
        for v in at:
            struts += box((0, u, v), (30, u + 1.6, v + 1.6))
            struts += box((u, 0, v), (u + 1.6, 30, v + 1.6))
            struts += box((u, v, 0), (u + 1.6, v + 1.6, 30))
    return struts


def twisted_vase():
    """Walls of 1.6 mm with five waves that turn by 90 degrees over 16 mm."""
    def rings(radius):
        heights = [0.4 * k for k in range(41)]
        wave = lambda z: lambda a: radius + 1.5 * math.cos(5 * (a - TAU / 4 * z / 16))
        return [ring(wave(z), 240, z) for z in heights]
    return tube_of(rings(12.0), rings(10.4))


def cone_with_bore():
    return tube_of([ring(12.0, 180, 0.0), ring(6.0, 180, 12.0)], [ring(3.0, 180, 0.0), ring(3.0, 180, 12.0)])


PARTS = {
    "cube": cube, "tower": tapered_tower, "gear": herringbone_gear, "lattice": lattice, "vase": twisted_vase,
    "cone": cone_with_bore,
}

# Heights, where an outline lies, and the box of the mesh.
AROUND = ((-15.0, -15.0), (15.0, 15.0))
SURFACES = {
    "arch": (lambda x, y: math.sqrt(400 - x * x), (5.3, 0.0), ((-18.5, -15.0), (18.5, 15.0))),
    "dome": (lambda x, y: math.sqrt(625 - x * x - y * y), (0.0, 0.0), AROUND),
    "saddle": (lambda x, y: (x * x - y * y) / 40, (0.0, 0.0), AROUND),
    "sine": (lambda x, y: 1.5 * math.sin(TAU * x / 20), (0.0, 0.0), AROUND),
    "cone": (lambda x, y: 30 - 0.7 * math.hypot(x, y), (15.0, 0.0), ((1.5, -15.0), (30.0, 15.0))),
    "free": (
        lambda x, y: 2 * math.exp(-((x - 4) ** 2 + (y + 2) ** 2) / 60)
        + 1.2 * math.sin(x / 6) * math.cos(y / 7) + 0.05 * x,
        (0.0, 0.0),
        AROUND,
    ),
}


def surface(name):
    """Facets of 0.2 mm."""
    height, _, (low, high) = SURFACES[name]
    def place(s, t):
        x, y = low[0] + s * (high[0] - low[0]), low[1] + t * (high[1] - low[1])
        return x, y, height(x, y)
    counts = [round((high[k] - low[k]) / 0.2) for k in (0, 1)]
    return sheet(*counts, place)


def surface_outline(name, outline):
    """Exterior and holes: a square of 20 mm with a hole of R 4, or an L."""
    dx, dy = SURFACES[name][1]
    moved = lambda points: [(x + dx, y + dy) for x, y in points]
    if outline == "square":
        hole = [(2 + 4 * math.cos(-TAU * k / 96), 1 + 4 * math.sin(-TAU * k / 96)) for k in range(96)]
        return moved([(-10, -10), (10, -10), (10, 10), (-10, 10)]), [moved(hole)]
    return moved([(-10, -10), (10, -10), (10, -3), (-2, -3), (-2, 10), (-10, 10)]), []


def dome_on_block():
    """A cap of R 60 on a block of 40 x 40 x 10 mm."""
    cap = lambda r: math.sqrt(max(60.0 ** 2 - r * r, 0.0))
    def place(s, t):
        x, y = 40 * s - 20, 40 * t - 20
        r = math.hypot(x, y)
        return x, y, 10 + cap(r) - cap(18) if r < 18 else 10.0
    return solid(160, 160, place)


def wing():
    """Half of a tapered wing that lies on its chord."""
    def place(s, t):
        x, u = 60 * s, 0.5 * (1 - math.cos(math.pi * t))
        chord = 30 - 0.2 * x
        profile = 0.2969 * math.sqrt(u) - 0.126 * u - 0.3516 * u ** 2 + 0.2843 * u ** 3 - 0.1036 * u ** 4
        return x, 0.1 * x + u * chord, 0.6 + 1.2 * chord * profile
    return solid(120, 120, place)


def plate_with_hole(x_mm, width_mm, hole, top):
    """A plate under a sheet from a round hole to the rim, closed around it."""
    cx, cy, radius = hole
    turns = [TAU * k / 96 for k in range(96)]
    corners = [(x_mm[0], 0), (x_mm[1], 0), (x_mm[1], width_mm), (x_mm[0], width_mm)]
    turns = sorted({round(a, 9) for a in turns + [math.atan2(y - cy, x - cx) % TAU for x, y in corners]})
    inner, outer = [], []
    for a in turns:
        cos, sin = math.cos(a), math.sin(a)
        ways = [(side - middle) / along
                for side, middle, along in ((x_mm[0], cx, cos), (x_mm[1], cx, cos), (0, cy, sin), (width_mm, cy, sin))
                if abs(along) > 1e-12]
        way = min(w for w in ways if w > 0)
        inner.append((cx + radius * cos, cy + radius * sin))
        outer.append((round(cx + way * cos, 9), round(cy + way * sin, 9)))
    at = lambda points, height: [(x, y, height(x)) for x, y in points]
    flat = lambda x: 0.0
    return tube_of([at(outer, flat), at(outer, top)], [at(inner, flat), at(inner, top)])


def bracket():
    """A foot of 4.13 mm and a ramp of 6.5 degrees from 6.07 mm on, a hole in each."""
    slope = math.tan(math.radians(6.5))
    foot = plate_with_hole((0, 14), 30, (7, 15, 2.5), lambda x: 4.13)
    return foot + plate_with_hole((14, 50), 30, (34, 15, 5), lambda x: 6.07 + (x - 14) * slope)


CURVED = {"dome": (dome_on_block, "skin:2"), "wing": (wing, "skin:3"), "bracket": (bracket, "skin:3")}
