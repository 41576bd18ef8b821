"""Compares our sections of meshes with trimesh's, layer by layer:

    cargo build --release -p headway-tests --bin mesh_sections
    python3 tools/draw_meshes.py meshes --large
    python3 tools/compare_sections.py target/release/mesh_sections 0.2 meshes/*.stl

Needs trimesh, shapely, scipy, networkx, rtree. For every layer: the area by which the two differ, over the length
of the outline, in µm (how far one outline lies from the other on average). Exit 1 above 1 µm on any layer
or 0.1 % of the volume. A torn mesh is compared with the whole one: trimesh does not mend.
"""

import json
import subprocess
import sys
import time
from pathlib import Path

import trimesh
from shapely.geometry import Polygon
from shapely.ops import unary_union

LIMIT_UM = 1.0
LIMIT_VOLUME = 1e-3


def theirs(mesh, z):
    section = mesh.section(plane_origin=(0, 0, z), plane_normal=(0, 0, 1))
    if section is None:
        return Polygon()
    # Closing at 1e-8 mm: coordinates are not rounded.
    planar, to_3d = section.to_2D(to_2D=trimesh.transformations.translation_matrix((0, 0, -z)))
    return unary_union([polygon.buffer(0) for polygon in planar.polygons_full])


def main():
    binary, layer, files = sys.argv[1], sys.argv[2], [Path(f) for f in sys.argv[3:]]
    failed = False
    print("| mesh | triangles | layers | worst layer, µm | mean, µm | volume, % | ours, s |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for file in files:
        begun = time.time()
        ours = json.loads(subprocess.run([binary, file, layer], check=True, capture_output=True).stdout)
        seconds = time.time() - begun
        whole = file.with_name(file.name.replace("_torn", ""))
        mesh = trimesh.load(whole)
        worst, total = (0.0, 0.0), 0.0
        for number, own in enumerate(ours["layers"]):
            rings = own["regions"]
            own_area = unary_union([Polygon(r[0], r[1:]) for r in rings])
            other = theirs(mesh, own["z_mm"])
            length = max(own_area.length, other.length, 1e-9)
            apart_um = 1e3 * own_area.symmetric_difference(other).area / length
            worst = max(worst, (apart_um, own["z_mm"]))
            total += apart_um
        volume = abs(ours["volume_mm3"] / mesh.volume - 1)
        failed |= worst[0] > LIMIT_UM or volume > LIMIT_VOLUME
        print(
            f"| {file.stem} | {len(mesh.faces)} | {len(ours['layers'])} | {worst[0]:.4f} (z {worst[1]:.2f}) | "
            f"{total / len(ours['layers']):.5f} | {100 * volume:.6f} | {seconds:.2f} |",
            flush=True,
        )
        for note in ours["notes"]:
            print("    " + note, file=sys.stderr)
    sys.exit(failed)


if __name__ == "__main__":
    main()
