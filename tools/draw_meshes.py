"""Draws the meshes that sections are compared on: python3 draw_meshes.py FOLDER [--large]

Needs trimesh, shapely and manifold3d (pip install trimesh shapely manifold3d). Nothing here is part of the
product; the example examples/hook.stl was drawn by `hook`.
"""

import sys
from pathlib import Path

import numpy as np
import trimesh
from shapely.geometry import Point, Polygon, box
from shapely.ops import unary_union


def dome():
    """A hollow half sphere of 20 mm with walls of 1.6 mm, upright."""
    whole = trimesh.boolean.difference(
        [trimesh.creation.icosphere(5, 20.0), trimesh.creation.icosphere(5, 18.4)]
    )
    half = trimesh.creation.box((60, 60, 30), trimesh.transformations.translation_matrix((0, 0, 15)))
    return trimesh.boolean.intersection([whole, half])


def overhang():
    """A post with an arm that leans out, and a shelf."""
    post = Polygon([(0, 0), (8, 0), (8, 30), (26, 30), (26, 36), (0, 36)])
    lean = Polygon([(8, 8), (20, 20), (20, 24), (8, 14)])
    return trimesh.creation.extrude_polygon(unary_union([post, lean]), 10.0).apply_transform(
        trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))
    )


def thin_walls():
    """Ribs of 0.3 to 2 mm on a plate."""
    ribs = [box(4 * k, 0, 4 * k + t, 24) for k, t in enumerate((0.3, 0.5, 0.8, 1.2, 1.6, 2.0))]
    plate = trimesh.creation.box((28, 26, 1.5), trimesh.transformations.translation_matrix((11, 12, 0.75)))
    walls = [trimesh.creation.extrude_polygon(rib, 10.0) for rib in ribs]
    return trimesh.boolean.union([plate] + walls)


def small_holes():
    """A wedge with holes of 0.4 to 3 mm."""
    plate = box(0, 0, 40, 30)
    for i, radius in enumerate((0.2, 0.3, 0.5, 0.8, 1.2, 1.5)):
        for j in range(4):
            plate = plate.difference(Point(4 + 6 * i, 4 + 7 * j).buffer(radius, 32))
    block = trimesh.creation.extrude_polygon(plate, 8.0)
    cut = trimesh.creation.box((80, 80, 20), trimesh.transformations.rotation_matrix(0.12, (0, 1, 0)))
    return trimesh.boolean.difference([block, cut.apply_translation((20, 15, 15))])


def text():
    """Raised strokes on a rounded plate: H W."""
    strokes = [
        [(2, 2), (4, 2), (4, 12), (2, 12)],
        [(4, 6), (9, 6), (9, 8), (4, 8)],
        [(9, 2), (11, 2), (11, 12), (9, 12)],
        [(15, 12), (17, 2), (19, 2), (21, 9), (23, 2), (25, 2), (27, 12), (25, 12), (24, 6), (22, 12), (20, 12),
         (18, 6), (17, 12)],
    ]
    plate = trimesh.creation.extrude_polygon(box(2, 2, 27, 12).buffer(3, 24), 2.0)
    letters = [trimesh.creation.extrude_polygon(Polygon(s), 3.2) for s in strokes]
    return trimesh.boolean.union([plate] + letters)


def wavy(triangles):
    """A vase with a wavy wall, closed, of about so many triangles: 30 mm high, about 20 cm² of layer."""
    around = int(np.sqrt(triangles * 1.2))
    rows = int(triangles / 2 / around)
    z = np.linspace(0, 40, rows + 1)
    angle = np.linspace(0, 2 * np.pi, around, endpoint=False)
    a, h = np.meshgrid(angle, z)
    radius = 24 + 2.0 * np.sin(5 * a + h / 9) + 1.5 * np.sin(h / 6) + 0.3 * np.sin(40 * a)
    side = np.stack([radius * np.cos(a), radius * np.sin(a), h], axis=-1).reshape(-1, 3)
    vertices = np.vstack([side, [[0, 0, 0]], [[0, 0, 40]]])
    faces = []
    k = np.arange(around)
    for row in range(rows):
        p, q = row * around + k, row * around + (k + 1) % around
        faces.append(np.stack([p, q, q + around], axis=1))
        faces.append(np.stack([p, q + around, p + around], axis=1))
    low, high = len(side), len(side) + 1
    faces.append(np.stack([np.full(around, low), (k + 1) % around, k], axis=1))
    top = rows * around
    faces.append(np.stack([np.full(around, high), top + k, top + (k + 1) % around], axis=1))
    return trimesh.Trimesh(vertices, np.vstack(faces), process=False)


def hook():
    """A wall hook with two screw holes: what the guide prints."""
    side = Polygon([(0, 0), (5, 0), (5, 18), (20, 18), (24, 26), (21, 27), (17, 23), (5, 24), (5, 40), (0, 40)])
    body = trimesh.creation.extrude_polygon(side, 12.0)
    hole = trimesh.creation.cylinder(2.2, 20, sections=40)
    turned = trimesh.transformations.rotation_matrix(np.pi / 2, (0, 1, 0))
    holes = [hole.copy().apply_transform(turned).apply_translation((2, y, 6)) for y in (7, 33)]
    return trimesh.boolean.difference([body] + holes)


def torn(mesh, seed=3):
    """The same surface torn into triangles whose corners are moved by up to 1 µm, some flipped, some
    twice, some long edges divided on one side alone."""
    rng = np.random.default_rng(seed)
    soup = mesh.triangles.copy()
    soup += rng.uniform(-5e-4, 5e-4, soup.shape)
    flip = rng.random(len(soup)) < 0.05
    soup[flip] = soup[flip][:, ::-1]
    longest = np.argsort(-mesh.area_faces)[: max(1, len(soup) // 50)]
    middle = soup[longest].mean(axis=1, where=np.array([True, True, False])[None, :, None])
    pieces = np.concatenate(
        [
            np.stack([soup[longest, 0], middle, soup[longest, 2]], axis=1),
            np.stack([middle, soup[longest, 1], soup[longest, 2]], axis=1),
        ]
    )
    soup = np.delete(soup, longest, axis=0)
    soup = np.concatenate([soup, pieces, soup[:5]])
    return trimesh.Trimesh(**trimesh.triangles.to_kwargs(soup), process=False)


PARTS = {
    "dome": dome,
    "overhang": overhang,
    "thin_walls": thin_walls,
    "small_holes": small_holes,
    "text": text,
    "hook": hook,
}


def main():
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True, exist_ok=True)
    for name, draw in PARTS.items():
        mesh = draw()
        mesh.export(folder / f"{name}.stl")
        torn(mesh).export(folder / f"{name}_torn.stl")
    wavy(1e5).export(folder / "wavy_1e5.stl")
    if "--large" in sys.argv:
        wavy(1e6).export(folder / "wavy_1e6.stl")


if __name__ == "__main__":
    main()
